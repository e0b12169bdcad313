"""How a command prints: plain tables, lines to a terminal or a pipe, results on standard output, messages on error."""

from __future__ import annotations

import errno
import math
import os
import sys
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from attlog.base.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console

GAP = 2
NARROWEST = 30


@dataclass(frozen=True, slots=True)
class Line:
    """One line of text; ``style`` is empty, ``bold``, ``dim`` or a colour."""

    text: str
    style: str = ""


SENTENCES = 100
"""Columns over which sentences are laid out; longer lines are hard to read."""


def wrapped(label: str, text: str, width: int) -> Iterator[Line]:
    """A sentence after its label, broken between words."""
    lines = textwrap.wrap(text, min(width, SENTENCES) - len(label), break_long_words=False, break_on_hyphens=False)
    for i, line in enumerate(lines or [""]):
        yield Line(((label if i == 0 else " " * len(label)) + line).rstrip())


def columns(rows: Iterable[tuple[str, ...]], width: int, indent: str = "  ") -> list[list[str]]:
    """The lines of each row; all but the last column are as wide as their longest cell."""
    listed = list(rows)
    widths = [max(len(row[i]) for row in listed) + GAP for i in range(len(listed[0]) - 1)] if listed else []
    before = len(indent) + sum(widths)
    room = max(width - before, NARROWEST)
    found = []
    for row in listed:
        head = indent + "".join(cell.ljust(w) for cell, w in zip(row, widths, strict=False))
        last = textwrap.wrap(row[-1], room, break_long_words=False, break_on_hyphens=False) or [""]
        found.append([(head + last[0]).rstrip(), *(" " * before + line for line in last[1:])])
    return found


def _no_color(wanted: bool) -> None:
    if wanted:
        os.environ["NO_COLOR"] = "1"


Logs = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG|DIR|GLOB...",
        readable=False,
        show_default=False,
        help="Flight logs (.ulg, .bin, .log, .tlog, .px4log, any of them as .gz), folders, quoted patterns.",
    ),
]
Places = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG|DIR|GLOB|URL...",
        show_default=False,
        help="Flight logs (.ulg, .bin, .log, .tlog, .px4log, any of them as .gz), folders, quoted patterns, "
        "zip archives and members, URLs.",
    ),
]
Log = Annotated[
    Path,
    typer.Argument(
        metavar="LOG", readable=False, show_default=False, help="A flight log (told apart by content; .gz works too)."
    ),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print JSON on standard output (--json - does the same), one line for each log.")
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")]
Verbose = Annotated[
    int,
    typer.Option("-v", "--verbose", count=True, show_default=False, help="Say more; -vv shows a traceback for a bug."),
]
NoColor = Annotated[
    bool, typer.Option("--no-color", callback=_no_color, is_eager=True, help="No colours (also by NO_COLOR).")
]
Boot = Annotated[
    int | None,
    typer.Option(
        "--boot", metavar="N", help="Which power-up of a log with several, from 0. [default: the one with most data]"
    ),
]
System = Annotated[
    int | None,
    typer.Option(
        "--system", metavar="N", help="Which MAVLink system of a log with several. [default: the autopilot heard most]"
    ),
]


class Piped:
    """Standard output or error where it is no terminal: lines without styles, wide, and nothing to import for them."""

    width = 160

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    @property
    def encoding(self) -> str:
        """Of the stream."""
        return (self._stream.encoding or "utf-8").lower()

    def lines(self, texts: Iterable[str]) -> None:
        """Write each as a line, tabs as blanks."""
        for text in texts:
            self._stream.write(text.expandtabs().rstrip() + "\n")
        self._stream.flush()


LIKE_A_TERMINAL = ("FORCE_COLOR", "TTY_COMPATIBLE")
"""Variables by which people have colours where the output is no terminal."""


def console(stderr: bool = False) -> Console | Piped:
    """What to print to: a terminal, or plain text where the output is none, wide where it is piped."""
    stream = sys.stderr if stderr else sys.stdout
    if not stream.isatty() and not any(os.environ.get(name) for name in LIKE_A_TERMINAL):
        return Piped(stream)
    return terminal(stderr)


def terminal(stderr: bool = False) -> Console:
    """A terminal to print to; also for an output that is none, which then is as wide as a piped one."""
    from rich.console import Console

    class Terminal(Console):
        def on_broken_pipe(self) -> None:
            # rich would end with 1, which means a difference that info --verify found
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else Piped.width
    if os.environ.get("NO_COLOR"):
        return Terminal(stderr=stderr, highlight=False, soft_wrap=False, width=width, color_system=None)
    return Terminal(stderr=stderr, highlight=False, soft_wrap=False, width=width)


def to_stderr(text: str) -> None:
    """A message on standard error; whatever a log called itself steers no terminal."""
    from attlog.present.text import for_terminal

    if sys.stderr is not None:
        print(for_terminal(text), file=sys.stderr, flush=True)


def to_stdout(text: str) -> None:
    """A line of results on standard output, as :func:`to_stderr`."""
    from attlog.present.text import for_terminal

    print(for_terminal(text))


def json_to_stdout(text: str) -> None:
    """JSON on standard output, as it is but for escapes of what would steer a terminal."""
    from attlog.present.text import json_for_terminal

    print(json_for_terminal(text).rstrip("\n"))


def json_line(document: dict[str, Any]) -> str:
    """A document as one line of JSON; with JSON's own escapes where standard output cannot show what is in it."""
    import json

    layout: dict[str, Any] = {"separators": (",", ":"), "allow_nan": False}
    text = json.dumps(document, ensure_ascii=False, **layout)
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        return json.dumps(document, **layout)
    return text


def say(lines: Iterable[Line], out: Console | Piped) -> None:
    """Print lines as they are: not broken, nothing in them taken for markup, no blanks behind them."""
    from attlog.present.stand_ins import stand_in
    from attlog.present.text import for_terminal

    if isinstance(out, Piped):
        out.lines(stand_in(for_terminal(line.text), out.encoding) for line in lines)
        return
    from rich.text import Text

    for line in lines:
        out.print(Text(stand_in(for_terminal(line.text), out.encoding).rstrip(), line.style), soft_wrap=True)


def one_log(path: Path) -> Path:
    """The one log that a name means, also where it is a folder or a pattern. Errors as in ``fleet.find``."""
    from attlog.fleet.sources.find import find

    logs, wrong = find([path])
    if wrong:
        raise wrong[0]
    if len(logs) > 1:
        raise UsageError(
            f"{path}: {len(logs)} logs; this command takes one ({', '.join(p.name for p in logs[:3])} ...)"
        )
    return logs[0]


def number_or(text: str, words: tuple[str, ...], option: str) -> float | str:
    """An option that is a number or one of a few words. UsageError otherwise."""
    if text in words:
        return text
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise UsageError(f"{option} {text!r}: use a number or {' or '.join(words)}")
    return number


def finite(value: float | None) -> float | None:
    """The value of an option that is a number, for its callback: "nan" and "inf" are none."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter("use a finite number")
    return value
