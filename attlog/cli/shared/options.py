"""Options that several commands take, each declared once: single ones as annotated types, sets of them as dataclasses.

A command takes a set as one parameter; :func:`expanded` gives Typer an option for each of its fields.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import typer

from attlog.base.errors import UsageError
from attlog.cli.shared import completion

Logs = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG|DIR|GLOB...",
        readable=False,
        show_default=False,
        help="Read these flight logs (.ulg, .bin, .log, .tlog, .px4log, .mcap, .db3), folders, quoted patterns.",
    ),
]
Places = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG|DIR|GLOB|URL...",
        show_default=False,
        help="Read these flight logs (.ulg, .bin, .log, .tlog, .px4log, .mcap, .db3), folders, quoted patterns, "
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
Folder = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Write pages and data to this folder.")]
OneFile = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write to this file. [default: print]")
]
Jobs = Annotated[int, typer.Option("-j", "--jobs", metavar="N", min=1, help="Work on N at a time.")]
JobsOfCores = Annotated[
    int | None,
    typer.Option("-j", "--jobs", metavar="N", min=1, help="Work on N at a time. [default: one for each core]"),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, one line for each log.")]
TableForm = Literal["md", "csv", "tex"]
"""As in ``compare.tables.files``, which is not imported for help."""
Form = Annotated[
    TableForm | None,
    typer.Option(
        "--format", metavar="md|csv|tex", help="Print the table as Markdown, CSV or LaTeX. [default: for reading]"
    ),
]
Figures = Annotated[
    Path | None,
    typer.Option("--figures", metavar="DIR", help="Write the figures to this folder too, as SVG and PNG for papers."),
]
Open = Annotated[bool, typer.Option("--open", help="Open the page in a browser.")]
Reference = Annotated[
    str | None,
    typer.Option(
        metavar="R",
        autocompletion=completion.references,
        help="Compare with auto, truth, smoother, onboard, onboard:NAME or none. [default: auto]",
    ),
]
Truth = Annotated[
    str | None,
    typer.Option(
        metavar="FILE|DIR|TOPIC",
        help="Compare with this trajectory (TUM, EuRoC, CSV), log or bag, with one of a folder, or with a topic of the "
        "log; :offset=S,north=true,topic=T may follow. [default: none]",
    ),
]
GyroBias = Annotated[
    str | None,
    typer.Option(
        metavar="rest|none|onboard",
        help="Subtract this gyro bias: the mean at rest before take-off, none, or the onboard estimator's. "
        "[default: rest]",
    ),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        metavar="F.toml|F.json", help="Read settings from a file or an earlier result; options win. [default: none]"
    ),
]
Boot = Annotated[
    int | None,
    typer.Option(metavar="N", min=0, help="Take this power-up of several, from 0. [default: with most data]"),
]
System = Annotated[
    int | None,
    typer.Option(metavar="N", min=0, max=255, help="Take this MAVLink system of several. [default: the autopilot]"),
]


def one_form(json: bool, form: str | None) -> None:
    """UsageError where two things are to be printed on standard output."""
    if json and form is not None:
        raise UsageError("--json and --format: one or the other; both print on standard output")


def finite(value: float | None) -> float | None:
    """The value of an option that is a number, for its callback: "nan" and "inf" are none."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter("use a finite number")
    return value


def _no_color(wanted: bool) -> None:
    if wanted:
        os.environ["NO_COLOR"] = "1"


def _key(named: Path | None) -> Path | None:
    """The key for this process and its children, which read logs for it."""
    if named is not None:
        from attlog.formats.ulog.encrypted import KEY

        os.environ[KEY] = str(named.absolute())
    return named


@dataclass(frozen=True, slots=True)
class CommonOptions:
    """Options of every command, which may stand before the command too."""

    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")] = False
    verbose: Annotated[
        int,
        typer.Option(
            "-v", "--verbose", count=True, show_default=False, help="Print more; -vv shows a traceback for a bug."
        ),
    ] = 0
    no_color: Annotated[
        bool,
        typer.Option("--no-color", callback=_no_color, is_eager=True, help="Print without colours (as NO_COLOR does)."),
    ] = False
    key: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.pem",
            callback=_key,
            help="Open encrypted logs (.ulge) with this private key. [default: that of ATTLOG_KEY]",
        ),
    ] = None


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """The command with an option for each field of its sets of options, and those of every command.

    A parameter whose type is a dataclass is such a set. What Typer sees is the signature; what it calls puts the sets
    together.
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
        command(**{name: value for name, value in values.items() if name in hints})

    run.__signature__ = inspect.Signature(seen + common)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in seen + common}
    return run


def _parameters(kind: Any) -> Iterator[inspect.Parameter]:
    """The fields of a set of options as parameters."""
    hints = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        default = inspect.Parameter.empty if field.default is MISSING else field.default
        yield inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hints[field.name]
        )
