"""The options that say how a log is analysed: the same for ``analyze`` and ``batch``, and the Config they make."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from attlog.base.errors import PluginError, UsageError
from attlog.cli.shared import completion
from attlog.cli.shared.printing import finite, number_or

if TYPE_CHECKING:
    from attlog.config import Config


def _filter_timeout(seconds: float | None) -> None:
    """The processes of filters, at whatever depth they are started, ask the environment."""
    if seconds is not None:
        os.environ["ATTLOG_FILTER_TIMEOUT"] = f"{seconds:g}"


Estimators = Annotated[
    str | None,
    typer.Option(
        metavar="LIST",
        autocompletion=completion.rows,
        help="default, all, NAME[@PRESET][:k=v,...] and FILE.py, with commas. [default: default]",
    ),
]
ImuOption = Annotated[str | None, typer.Option(metavar="N|all", help="IMU to replay. [default: the one that flew]")]
MagOption = Annotated[
    str | None, typer.Option(metavar="N|none", help="Magnetometer to use. [default: the log's choice]")
]
ReferenceOption = Annotated[
    str | None,
    typer.Option(
        metavar="R",
        autocompletion=completion.references,
        help="auto, truth, smoother, onboard, onboard:NAME or none. [default: auto]",
    ),
]
Window = Annotated[
    str | None,
    typer.Option(
        metavar="W",
        autocompletion=completion.windows,
        help="all, rest, rest.long, idle, armed, airborne, hover, cruise or T0:T1 (s). [default: all]",
    ),
]
ScoreFrom = Annotated[
    float | None, typer.Option(metavar="S", callback=finite, help="Compare from this time on. [default: 15 s]")
]
Clock = Annotated[
    str | None, typer.Option(metavar="sample|publication", help="Which time stamps count. [default: sample]")
]
Declination = Annotated[
    str | None, typer.Option(metavar="DEG|model|param", help="Magnetic declination. [default: model, else parameter]")
]
Trim = Annotated[
    str | None, typer.Option(metavar="on|off", help="Apply the autopilot's trim to the replay. [default: on]")
]
InputDelay = Annotated[
    str | None, typer.Option(metavar="MS|off", help="Known delay of the logged IMU. [default: from the log]")
]
GyroBias = Annotated[
    str | None,
    typer.Option(
        metavar="rest|none|onboard",
        help="Gyro bias to take off for every filter: its mean at rest before take-off, none, or the onboard "
        "estimator's. [default: rest]",
    ),
]
Params = Annotated[
    str | None,
    typer.Option(
        metavar="F.param",
        help="What if: parameters for the autopilots' filters, and where the log has none. [default: none]",
    ),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        metavar="F.toml|F.json", help="Options from a file or from an earlier result; options here win. [default: none]"
    ),
]
FilterTimeout = Annotated[
    float | None,
    typer.Option(
        "--filter-timeout",
        metavar="S",
        min=0,
        callback=_filter_timeout,
        show_default=False,
        help="Seconds that one run of a filter that is not attlog's may take; 0: any time. [default: 60]",
    ),
]
Plotly = Annotated[str, typer.Option(metavar="inline|shared", help="shared: one plotly bundle beside many reports.")]
Deterministic = Annotated[
    bool, typer.Option("--deterministic", help="Leave measured times out of JSON and report: same log, same bytes.")
]
BUNDLES: dict[str, Literal["inline", "shared"]] = {"inline": "inline", "shared": "shared"}
"""Where reports have plotly from."""
OF_A_LOG = frozenset(
    (
        "estimators",
        "imu",
        "mag",
        "reference",
        "window",
        "score_from",
        "clock",
        "declination",
        "trim",
        "input_delay",
        "gyro_bias",
        "params",
        "config",
        "boot",
        "system",
        "plotly",
        "deterministic",
    )
)
"""Options that decide what is written of a log; others decide where, how many at a time and what is printed."""


def bundle(word: str) -> Literal["inline", "shared"]:
    """The value of ``--plotly``."""
    if word not in BUNDLES:
        raise UsageError(f"--plotly {word}: use inline or shared")
    return BUNDLES[word]


def settings(file: Path | None, **options: Any) -> Config:
    """The configuration of a file and of options as they were typed (None: not given). UsageError for what is wrong.

    Parameter files and names of filters are looked at here too: what is wrong is said once, not for each log.
    """
    from attlog.config import Config

    read = {"imu": _imu, "mag": _mag, "declination": _declination, "trim": _trim, "input_delay": _input_delay}
    given = {k: read[k](v) if k in read else v for k, v in options.items() if v is not None}
    config = Config.build(given) if file is None else Config.load(file, **given)
    check_window(config.window)
    if config.params is not None:
        from attlog.flight.parameters.file import read_file

        read_file(config.params)
    for item in config.estimators:
        check_filter(item)
    return config


def check_window(window: str | None) -> None:
    """UsageError for what is no window, before any log is read."""
    if window is not None:
        from attlog.segments.model import Segments

        try:
            Segments().spans(window)
        except ValueError as error:
            raise UsageError(f"--{error}") from None


def check_filter(item: str) -> None:
    """UsageError for a filter, preset or parameter that is not there; a file's own code runs with the logs only."""
    from attlog import estimators

    name = item.partition(":")[0].partition("@")[0]
    if not (name.endswith((".py", ".csv")) and os.path.isfile(name)):
        with suppress(PluginError):  # what a filter of a package does is told in its row
            try:
                estimators.select(item)
            except UsageError as error:
                if hint := _of_compare(item):
                    raise UsageError(f"{error}{hint}") from None
                raise


def _of_compare(item: str) -> str:
    """The end of an error sentence for a filter with something that ``attlog compare`` puts before it; else empty."""
    from attlog.compare.configurations.settings import SETTINGS

    name, _, pairs = item.partition(":")
    before = [key for pair in pairs.split(",") if (key := pair.partition("=")[0].strip()) in SETTINGS]
    return f"; {', '.join(before)} may come before a filter: attlog compare LOG {name} {item}" if before else ""


def commands(context: typer.Context, logs: Sequence[str]) -> list[str]:
    """For each log the command that makes its report alone, with the options of this one that matter to it."""
    given = []
    for option in context.command.params:
        name = str(option.name)
        source = context.get_parameter_source(name)
        if name in OF_A_LOG and source is not None and source.name == "COMMANDLINE":
            value = context.params[name]
            given += [option.opts[-1], *([] if value is True else [str(value)])]
    return [shlex.join(["attlog", "analyze", log, *given]) for log in logs]


def _imu(text: str) -> int | str:
    return _int_or(text, "all", "--imu")


def _mag(text: str) -> int | str:
    return _int_or(text, "none", "--mag")


def _declination(text: str) -> float | str:
    return number_or(text, ("auto", "model", "param"), "--declination")


def _input_delay(text: str) -> float | str:
    return number_or(text, ("auto", "off"), "--input-delay")


def _int_or(text: str, word: str, option: str) -> int | str:
    if text == word:
        return text
    if not text.isdecimal():
        raise UsageError(f"{option} {text!r}: use a number from 0 or {word}")
    return int(text)


def _trim(text: str) -> bool:
    if text in ("on", "off"):
        return text == "on"
    raise UsageError(f"--trim {text!r}: use on or off")
