"""Options that several commands take, each declared once: annotated types, and dataclasses for sets of options.

A command takes a set as one parameter; :func:`expanded` gives Typer an option for each field. Completion imports
nothing before TAB is pressed.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import typer

from attlog.cli.process import reuse_freed_memory
from attlog.core.errors import AttlogError, PluginError, UsageError

if TYPE_CHECKING:
    from attlog.pipeline.config import Config


# Sections of the help.
OUTPUT, LOGS, COMMON = "Output", "Logs and filters", "Every command"


def complete_rows(incomplete: str) -> list[str]:
    """Complete the last item of a list of rows: sets, filters, and their presets behind @."""
    from attlog.estimators import get, names

    done, comma, last = incomplete.rpartition(",")
    name, at, _ = last.partition("@")
    offered = ["default", "all", *names()]
    if at:
        try:
            offered = [f"{name}@{preset}" for preset in get(name).presets]
        except AttlogError:
            offered = []
    return [f"{done}{comma}{item}" for item in offered if item.startswith(last)]


def complete_filters(incomplete: str) -> list[str]:
    from attlog.estimators import names

    return [name for name in names() if name.startswith(incomplete)]


def complete_scenarios(incomplete: str) -> list[str]:
    from attlog.simulate.scenario import scenario_names

    return [name for name in scenario_names() if name.startswith(incomplete)]


def complete_windows(incomplete: str) -> list[str]:
    from attlog.segments.model import WINDOWS

    return [name for name in WINDOWS if name.startswith(incomplete)]


def complete_references(incomplete: str) -> list[str]:
    names = ("auto", "truth", "smoother", "onboard", "onboard:", "none")
    return [name for name in names if name.startswith(incomplete)]


def complete_messages(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete the messages of the log named before; nothing for what is no log."""
    from attlog import formats

    log: Any = ctx.params.get("log")
    try:
        names = formats.open(log).names() if log else []
    except AttlogError:
        return []
    return [name for name in names if name.startswith(incomplete)]


Logs = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG|DIR|GLOB...",
        readable=False,
        show_default=False,
        help="Read these flight logs (.ulg, .bin, .log, .tlog, .mcap, .db3), folders, quoted patterns.",
    ),
]
Places = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG|DIR|GLOB|URL...",
        show_default=False,
        help="Read these flight logs (.ulg, .bin, .log, .tlog, .mcap, .db3), folders, quoted patterns, "
        "zip archives, URLs.",
    ),
]
Log = Annotated[
    Path,
    typer.Argument(
        metavar="LOG",
        readable=False,
        show_default=False,
        help="Read this flight log, known by its content; also as .gz.",
    ),
]
Folder = Annotated[
    Path,
    typer.Option("-o", "--output", metavar="DIR", help="Write pages and data to this folder.", rich_help_panel=OUTPUT),
]
OneFile = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="FILE", help="Write to this file. [default: print]", rich_help_panel=OUTPUT),
]
Jobs = Annotated[int, typer.Option("-j", "--jobs", metavar="N", min=1, help="Work on N at a time.")]
JobsOfCores = Annotated[
    int | None,
    typer.Option("-j", "--jobs", metavar="N", min=1, help="Work on N at a time. [default: one for each core]"),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print JSON on standard output, one line for each log.", rich_help_panel=OUTPUT)
]
TableForm = Literal["md", "csv", "tex"]  # as in attlog.compare.tables, which is not imported for help
Form = Annotated[
    TableForm | None,
    typer.Option(
        "--format",
        metavar="md|csv|tex",
        help="Print the table as Markdown, CSV or LaTeX. [default: for reading]",
        rich_help_panel=OUTPUT,
    ),
]
Figures = Annotated[
    Path | None,
    typer.Option("--figures", metavar="DIR", help="Write the figures to this folder too, as SVG and PNG for papers."),
]
Open = Annotated[bool, typer.Option("--open", help="Open the page in a browser.", rich_help_panel=OUTPUT)]
Reference = Annotated[
    str | None,
    typer.Option(
        metavar="R",
        autocompletion=complete_references,
        help="Compare with auto, truth, smoother, onboard, onboard:NAME or none. [default: auto]",
        rich_help_panel=LOGS,
    ),
]
Truth = Annotated[
    str | None,
    typer.Option(
        metavar="FILE|DIR|TOPIC",
        help="Compare with this trajectory (TUM, EuRoC, CSV), log or bag, with one of a folder, or with a topic of the "
        "log; :offset=S,north=true,topic=T may follow. [default: none]",
        rich_help_panel=LOGS,
    ),
]
GyroBias = Annotated[
    str | None,
    typer.Option(
        metavar="rest|none|onboard",
        help="Subtract this gyro bias: the mean at rest before take-off, none, or the onboard estimator's. "
        "[default: rest]",
        rich_help_panel=LOGS,
    ),
]
SignalSelection = Literal["none", "standard", "all"]  # as in attlog.pipeline.signal_traces, not imported for help
Signals = Annotated[
    SignalSelection | None,
    typer.Option(
        metavar="none|standard|all",
        help="Let the page draw no signals of the log, those that people look at, or all. [default: standard]",
        rich_help_panel=OUTPUT,
    ),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        metavar="F.toml|F.json",
        help="Read settings from a file or an earlier result; options win. [default: none]",
        rich_help_panel=LOGS,
    ),
]
Boot = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=0,
        help="Take this power-up of several, from 0. [default: with most data]",
        rich_help_panel=LOGS,
    ),
]
System = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=0,
        max=255,
        help="Take this MAVLink system of several. [default: the autopilot]",
        rich_help_panel=LOGS,
    ),
]


def one_form(json: bool, form: str | None) -> None:
    """Raise UsageError if two outputs would share standard output."""
    if json and form is not None:
        raise UsageError("--json and --format: one or the other; both print on standard output")


def require_finite(value: float | None) -> float | None:
    """Refuse "nan" and "inf" as value of an option."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter("use a finite number")
    return value


def _no_color(wanted: bool) -> None:
    if wanted:
        os.environ["NO_COLOR"] = "1"


def _key(named: Path | None) -> Path | None:
    """Set the key for this process and its children."""
    if named is not None:
        from attlog.formats.ulog.encrypted import KEY_VARIABLE

        os.environ[KEY_VARIABLE] = str(named.absolute())
    return named


@dataclass(frozen=True, slots=True)
class CommonOptions:
    """Options of every command, which may stand before the command too."""

    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.", rich_help_panel=COMMON)] = False
    verbose: Annotated[
        int,
        typer.Option(
            "-v",
            "--verbose",
            count=True,
            show_default=False,
            help="Print more; -vv shows a traceback for a bug.",
            rich_help_panel=COMMON,
        ),
    ] = 0
    no_color: Annotated[
        bool,
        typer.Option(
            "--no-color",
            callback=_no_color,
            is_eager=True,
            help="Print without colours (as NO_COLOR does).",
            rich_help_panel=COMMON,
        ),
    ] = False
    key: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.pem",
            callback=_key,
            help="Open encrypted logs (.ulge) with this private key. [default: that of ATTLOG_KEY]",
            rich_help_panel=COMMON,
        ),
    ] = None


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command an option for each field of its sets of options, and those of every command.

    A set is a parameter whose type is a dataclass.
    """
    hints = get_type_hints(command, include_extras=True)
    sets: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
    seen: list[inspect.Parameter] = []
    for name, parameter in inspect.signature(command).parameters.items():
        if name not in sets:
            seen.append(parameter.replace(annotation=hints[name], kind=inspect.Parameter.KEYWORD_ONLY))
        elif sets[name] is not CommonOptions:
            seen += _parameters(sets[name])
    common = list(_parameters(CommonOptions))

    @functools.wraps(command)
    def run(**values: Any) -> None:
        for name, kind in sets.items():
            values[name] = kind(**{field.name: values.pop(field.name) for field in fields(kind)})
        reuse_freed_memory()
        command(**{name: value for name, value in values.items() if name in hints})

    run.__signature__ = inspect.Signature(seen + common)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in seen + common}
    return run


def _parameters(kind: Any) -> Iterator[inspect.Parameter]:
    """Yield the fields of a set of options as parameters."""
    hints = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        default = inspect.Parameter.empty if field.default is MISSING else field.default
        yield inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hints[field.name]
        )


# The sets of options that make a Config: how a log is analysed, how settings are compared; checked before any log.


@dataclass(frozen=True, slots=True)
class LogOptions:
    """Options of ``analyze`` and ``batch`` about the analysis of a log; None: default."""

    estimators: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            autocompletion=complete_rows,
            help="Run these filters, with commas: default, all, NAME[@PRESET][:k=v,...], FILE.py. [default: default]",
            rich_help_panel=LOGS,
        ),
    ] = None
    imu: Annotated[
        str | None,
        typer.Option(metavar="N|all", help="Replay this IMU. [default: the one used in flight]", rich_help_panel=LOGS),
    ] = None
    mag: Annotated[
        str | None,
        typer.Option(
            metavar="N|none", help="Replay this magnetometer. [default: the log's choice]", rich_help_panel=LOGS
        ),
    ] = None
    reference: Reference = None
    truth: Truth = None
    window: Annotated[
        str | None,
        typer.Option(
            metavar="W",
            autocompletion=complete_windows,
            help="Show the table of this window: all, rest, armed, airborne, hover, cruise, idle or T0:T1 (s). "
            "[default: all]",
            rich_help_panel=LOGS,
        ),
    ] = None
    gyro_bias: GyroBias = None
    params: Annotated[
        str | None,
        typer.Option(
            metavar="F.param",
            help="Use the parameters of this file for the autopilots' filters. [default: those of the log]",
            rich_help_panel=LOGS,
        ),
    ] = None
    signals: Signals = None
    config: ConfigFile = None
    boot: Boot = None
    system: System = None
    deterministic: Annotated[
        bool,
        typer.Option(
            "--deterministic",
            help="Leave measured times out: the same log gives the same bytes.",
            rich_help_panel=OUTPUT,
        ),
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
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Study parameters of a re-run EKF that does not follow what flew, too.")
    ] = False

    def __post_init__(self) -> None:
        one_form(self.json, self.form)

    @property
    def for_a_program(self) -> bool:
        """True if standard output is for a program, so that text for people goes to standard error."""
        return self.json or self.form is not None

    def of_analysis(self) -> dict[str, Any]:
        """Return typed options that prepare a log, by their names in a configuration."""
        options = {"reference": self.reference, "truth": self.truth, "gyro_bias": self.gyro_bias}
        return {name: value for name, value in options.items() if value is not None}


def build_configuration(options: LogOptions) -> Config:
    """Build the configuration from options and their file.

    UsageError also for parameter files and filters: errors appear once, not for each log.
    """
    config = from_file(options.config, _typed(options))
    check_window(config.window)
    if config.params is not None:
        from attlog.flight.parameters import read_parameter_file

        read_parameter_file(config.params)
    for item in config.estimators:
        check_filter(item)
    return config


def from_file(file: Path | None, options: dict[str, Any]) -> Config:
    """Build the configuration from a file, if any, and typed values, which win."""
    from attlog.pipeline.config import Config, gyro_bias_of, reference_of

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
    """Raise UsageError for an impossible truth, before any log is read."""
    if config.truth is None:
        return
    if config.reference not in ("auto", "truth"):
        raise UsageError(f"--truth {config.truth}: the reference is {config.reference}; leave out one of the two")
    from attlog.external import read

    read.check_truth(config.truth)


def for_comparison(options: ComparisonOptions, before: dict[str, Any] | None = None) -> Config:
    """Build the configuration of a comparison without the filters of its file; options win over ``before``."""
    defaults = {} if options.config is None else {"estimators": ["default"]}
    return from_file(options.config, defaults | (before or {}) | options.of_analysis())


def _typed(options: LogOptions) -> dict[str, Any]:
    """Return typed options by their names in a configuration."""
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
    """Raise UsageError for a wrong window, before any log is read."""
    if window is not None:
        from attlog.segments.model import Segments

        try:
            Segments().spans(window)
        except ValueError as error:
            raise UsageError(f"--{error}") from None


def check_filter(item: str) -> None:
    """Raise UsageError for an unknown filter, preset or parameter; code of files runs with the logs only."""
    from attlog import estimators

    name = item.partition(":")[0].partition("@")[0]
    if not (name.endswith((".py", ".csv")) and os.path.isfile(name)):
        with suppress(PluginError):  # an error of a package's filter is reported in its row
            try:
                estimators.select(item)
            except UsageError as error:
                if hint := _of_compare(item):
                    raise UsageError(f"{error}{hint}") from None
                raise


def _of_compare(item: str) -> str:
    """Suggest ``attlog compare`` for a filter with a setting that comes before it."""
    from attlog.compare.setting import SETTINGS

    name, _, pairs = item.partition(":")
    before = [key for pair in pairs.split(",") if (key := pair.partition("=")[0].strip()) in SETTINGS]
    return f"; {', '.join(before)} may come before a filter: attlog compare LOG {name} {item}" if before else ""


def commands(options: LogOptions, logs: Sequence[str]) -> list[str]:
    """Return for each log the command that makes its report alone."""
    words: list[str] = []
    for field in fields(options):
        value = getattr(options, field.name)
        if value != field.default:
            words += [f"--{field.name.replace('_', '-')}", *([] if value is True else [str(value)])]
    return [shlex.join(["attlog", "analyze", log, *words]) for log in logs]
