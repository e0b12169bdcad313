"""Options that several commands share, and how a command talks."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog.errors import LogUnreadable, UsageError

if TYPE_CHECKING:
    from rich.console import Console


def _no_color(wanted: bool) -> None:
    if wanted:
        os.environ["NO_COLOR"] = "1"


Log = Annotated[
    Path,
    typer.Argument(
        metavar="LOG", readable=False, help="A flight log: .ulg, .bin, .log, .tlog (told apart by content)."
    ),
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")]
Verbose = Annotated[int, typer.Option("-v", "--verbose", count=True, help="Say more; -vv shows a traceback for a bug.")]
NoColor = Annotated[
    bool, typer.Option("--no-color", callback=_no_color, is_eager=True, help="No colours (also by NO_COLOR).")
]
Boot = Annotated[int | None, typer.Option("--boot", metavar="N", help="Which power-up of a log with several, from 0.")]
System = Annotated[
    int | None, typer.Option("--system", metavar="N", help="Which MAVLink system of a log with several.")
]


def console(stderr: bool = False) -> Console:
    """A terminal to print to; plain text where the output is no terminal, wide where it is piped."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else 160
    if os.environ.get("NO_COLOR"):
        return Console(stderr=stderr, highlight=False, soft_wrap=False, width=width, color_system=None)
    return Console(stderr=stderr, highlight=False, soft_wrap=False, width=width)


def existing(path: Path) -> Path:
    """The path of a log that is a file. UsageError for ``-``, LogUnreadable for what is not there."""
    if str(path) == "-":
        raise UsageError("a log cannot come from standard input: it is memory-mapped; give a file name")
    if not path.exists():
        raise LogUnreadable(f"{path}: no such file")
    if path.is_dir():
        raise LogUnreadable(f"{path}: is a folder; name a log file inside it")
    return path


def number_or(text: str, words: tuple[str, ...], option: str) -> float | str:
    """An option that is a number or one of a few words. UsageError otherwise."""
    if text in words:
        return text
    try:
        return float(text)
    except ValueError:
        raise UsageError(f"{option} {text!r}: use a number or {' or '.join(words)}") from None
