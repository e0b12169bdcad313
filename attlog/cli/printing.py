"""How a command prints: plain tables, lines to a terminal or a pipe, results on standard output, messages on error."""

from __future__ import annotations

import errno
import os
import re
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.console import Console

    from attlog.compare.tables import TableForm

GAP = 2
NARROWEST = 30


@dataclass(frozen=True, slots=True)
class TextLine:
    """One line of text; ``style`` is empty, ``bold``, ``dim`` or a colour."""

    text: str
    style: str = ""


SENTENCES = 100
"""Columns over which sentences are laid out; longer lines are hard to read."""


UNIT = re.compile(r"(?<=\d) (?=\S{1,4}(?:[\s.,;:)]|$))")
"""A blank between a number and its unit."""


def wrapped(label: str, text: str, width: int) -> Iterator[TextLine]:
    """A sentence after its label, broken between words, but not between a number and its unit."""
    text = UNIT.sub("\u00a0", text)
    lines = textwrap.wrap(text, min(width, SENTENCES) - len(label), break_long_words=False, break_on_hyphens=False)
    for i, line in enumerate(lines or [""]):
        yield TextLine(((label if i == 0 else " " * len(label)) + line).replace("\u00a0", " ").rstrip())


def aligned(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[TextLine]:
    """A table: words of the last and first column to the left, all between to the right"""
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    for number, row in enumerate([head, *rows]):
        cells = [
            c.ljust(w) if i in (0, len(head) - 1) else c.rjust(w)
            for i, (c, w) in enumerate(zip(row, widths, strict=True))
        ]
        yield TextLine("  " + "  ".join(cells).rstrip(), "bold" if number == 0 else "")


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
            # rich would end with 1, which means that a gate failed
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else Piped.width
    if os.environ.get("NO_COLOR"):
        return Terminal(stderr=stderr, highlight=False, soft_wrap=False, width=width, color_system=None)
    return Terminal(stderr=stderr, highlight=False, soft_wrap=False, width=width)


def to_stderr(text: str) -> None:
    """A message on standard error; whatever a log called itself steers no terminal."""
    from attlog.words.text import for_terminal

    if sys.stderr is not None:
        print(for_terminal(text), file=sys.stderr, flush=True)


def to_stdout(text: str) -> None:
    """A line of results on standard output, as :func:`to_stderr`."""
    from attlog.words.text import for_terminal

    print(for_terminal(text))


def table_to_stdout(form: TableForm, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on standard output as Markdown, CSV or LaTeX."""
    from attlog.compare.tables import table_text

    text_to_stdout(table_text(form, head, rows))


def text_to_stdout(text: str) -> None:
    """A text of several lines on standard output, as :func:`to_stderr`."""
    say(map(TextLine, text.splitlines()), Piped(sys.stdout))


def json_to_stdout(text: str) -> None:
    """JSON on standard output, as it is but for escapes of what would steer a terminal."""
    from attlog.words.text import json_for_terminal

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


def say(lines: Iterable[TextLine], out: Console | Piped) -> None:
    """Print lines as they are: not broken, nothing in them taken for markup, no blanks behind them."""
    from attlog.words.text import encodable, for_terminal

    if isinstance(out, Piped):
        out.lines(encodable(for_terminal(line.text), out.encoding) for line in lines)
        return
    from rich.text import Text

    for line in lines:
        out.print(Text(encodable(for_terminal(line.text), out.encoding).rstrip(), line.style), soft_wrap=True)
