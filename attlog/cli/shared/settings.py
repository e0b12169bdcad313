"""The sets of options that make a Config: how a log is analysed, how settings are compared; checked before any log."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.base.errors import PluginError, UsageError
from attlog.cli.shared import completion
from attlog.cli.shared.options import Boot, ConfigFile, Folder, Form, GyroBias, Json, Reference, System, Truth, one_form

if TYPE_CHECKING:
    from attlog.analysis.config import Config


@dataclass(frozen=True, slots=True)
class LogOptions:
    """How a log is analysed: options of ``analyze`` and ``batch``. None: not asked for."""

    estimators: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            autocompletion=completion.rows,
            help="Run these filters, with commas: default, all, NAME[@PRESET][:k=v,...], FILE.py. [default: default]",
        ),
    ] = None
    imu: Annotated[
        str | None, typer.Option(metavar="N|all", help="Replay this IMU. [default: the one used in flight]")
    ] = None
    mag: Annotated[
        str | None, typer.Option(metavar="N|none", help="Replay this magnetometer. [default: the log's choice]")
    ] = None
    reference: Reference = None
    truth: Truth = None
    window: Annotated[
        str | None,
        typer.Option(
            metavar="W",
            autocompletion=completion.windows,
            help="Show the table of this window: all, rest, armed, airborne, hover, cruise, idle or T0:T1 (s). "
            "[default: all]",
        ),
    ] = None
    gyro_bias: GyroBias = None
    params: Annotated[
        str | None,
        typer.Option(
            metavar="F.param",
            help="Use the parameters of this file for the autopilots' filters. [default: those of the log]",
        ),
    ] = None
    config: ConfigFile = None
    boot: Boot = None
    system: System = None
    deterministic: Annotated[
        bool, typer.Option("--deterministic", help="Leave measured times out: the same log gives the same bytes.")
    ] = False


@dataclass(frozen=True, slots=True)
class ComparisonOptions:
    """How settings are compared on logs: options of ``compare``, ``sweep`` and ``tune``."""

    output: Folder = Path("reports")
    form: Form = None
    json: Json = False
    reference: Reference = None
    truth: Truth = None
    gyro_bias: GyroBias = None
    config: ConfigFile = None

    def __post_init__(self) -> None:
        one_form(self.json, self.form)

    @property
    def for_a_program(self) -> bool:
        """Whether standard output is for a program: what people read goes to standard error."""
        return self.json or self.form is not None

    def of_analysis(self) -> dict[str, Any]:
        """The options that prepare a log, as far as they were typed, by their names in a configuration."""
        options = {"reference": self.reference, "truth": self.truth, "gyro_bias": self.gyro_bias}
        return {name: value for name, value in options.items() if value is not None}


def configured(options: LogOptions) -> Config:
    """The configuration of options and of the file that they name. UsageError for what is wrong.

    Parameter files and names of filters are looked at here too: what is wrong is said once, not for each log.
    """
    config = from_file(options.config, _typed(options))
    check_window(config.window)
    if config.params is not None:
        from attlog.flight.parameters.file import read_file

        read_file(config.params)
    for item in config.estimators:
        check_filter(item)
    return config


def from_file(file: Path | None, options: dict[str, Any]) -> Config:
    """The configuration of a file, where there is one, and of typed values that win."""
    from attlog.analysis.config import Config, gyro_bias_of, reference_of

    for name, parse in (("reference", reference_of), ("gyro_bias", gyro_bias_of)):
        if name in options:
            try:
                parse(options[name])
            except ValueError as error:
                raise UsageError(f"--{name.replace('_', '-')} {options[name]!r} {error}") from None
    found = Config.trusted(options) if file is None else Config.load(file, **options)
    check_truth(found)
    return found


def check_truth(config: Config) -> None:
    """UsageError for a truth that cannot be one, before any log is read."""
    if config.truth is None:
        return
    if config.reference not in ("auto", "truth"):
        raise UsageError(f"--truth {config.truth}: the reference is {config.reference}; leave out one of the two")
    from attlog import truth

    truth.check(config.truth)


def for_comparison(options: ComparisonOptions, before: dict[str, Any] | None = None) -> Config:
    """The configuration in which settings are compared; filters of its file are left out. Options win over others."""
    defaults = {} if options.config is None else {"estimators": ["default"]}
    return from_file(options.config, defaults | (before or {}) | options.of_analysis())


def _typed(options: LogOptions) -> dict[str, Any]:
    """The options that were typed, by their names in a configuration."""
    names = [field.name for field in fields(options) if field.name not in ("config", "deterministic")]
    found = {name: value for name in names if (value := getattr(options, name)) is not None}
    if "estimators" in found:
        from attlog import estimators

        found["estimators"] = estimators.items(found["estimators"])
    if "imu" in found:
        found["imu"] = _instance(found["imu"], "all", "--imu")
    if "mag" in found:
        found["mag"] = _instance(found["mag"], "none", "--mag")
    return found


def _instance(text: str, word: str, option: str) -> int | str:
    if text == word:
        return text
    if not text.isdecimal():
        raise UsageError(f"{option} {text!r}: use a number from 0 or {word}")
    return int(text)


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
        with suppress(PluginError):  # what a filter of a package does stands in its row
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


def commands(options: LogOptions, logs: Sequence[str]) -> list[str]:
    """For each log the command that makes its report alone."""
    words: list[str] = []
    for field in fields(options):
        value = getattr(options, field.name)
        if value != field.default:
            words += [f"--{field.name.replace('_', '-')}", *([] if value is True else [str(value)])]
    return [shlex.join(["attlog", "analyze", log, *words]) for log in logs]
