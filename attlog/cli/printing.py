"""Output of commands: lines and tables of text, results on standard output, messages on standard error.

Tables are laid out here, because rich would cost 40 ms of every start; it is imported for colours on a terminal.
"""

from __future__ import annotations

import errno
import os
import sys
import textwrap
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

if TYPE_CHECKING:
    from rich.console import Console

    from attlog.compare.tables import TableForm

GAP = "  "
SENTENCE_COLUMNS = 100  # longer lines are hard to read
MIN_COLUMNS = 30
# Variables that ask for colours where the output is no terminal.
COLOR_VARIABLES = ("FORCE_COLOR", "TTY_COMPATIBLE")


class TextLine(NamedTuple):
    """One line of text; ``style`` is empty, ``bold``, ``dim`` or a colour."""

    text: str
    style: str = ""


def wrapped(label: str, text: str, width: int, style: str = "") -> Iterator[TextLine]:
    """Break a sentence after its label between words, but not between a number and its unit."""
    from attlog.words.text import with_fixed_units

    text = with_fixed_units(text)
    room = min(width, SENTENCE_COLUMNS) - len(label)
    lines = textwrap.wrap(text, room, break_long_words=False, break_on_hyphens=False) or [""]
    for i, line in enumerate(lines):
        yield TextLine(((" " * len(label) if i else label) + line).replace("\u00a0", " ").rstrip(), style)


def table(
    rows: Iterable[Sequence[str]],
    head: Sequence[str] = (),
    *,
    left: Collection[int] = (0,),
    width: int = 0,
    indent: str = "",
    styles: Sequence[str] = (),
) -> Iterator[TextLine]:
    """Lay out a table: columns ``left`` (-1: the last) to the left, all others to the right.

    A heading may have several lines. With ``width`` the last column is wrapped between words. ``styles``: of the rows.
    """
    body = [[cell.split("\n") for cell in row] for row in rows]
    heading = [cell.split("\n") for cell in head]
    every = [heading, *body] if head else body
    if not every:
        return
    widths = [max(len(line) for row in every for line in row[i]) for i in range(len(every[0]))]
    if width:
        before = len(indent) + sum(widths[:-1]) + len(GAP) * (len(widths) - 1)
        room = max(width - before, MIN_COLUMNS)
        for row in every:
            row[-1] = textwrap.wrap(row[-1][0], room, break_long_words=False, break_on_hyphens=False) or [""]
    adjust = [str.ljust if {i, i - len(widths)} & set(left) else str.rjust for i in range(len(widths))]
    for number, row in enumerate(every, start=0 if head else 1):
        height = max(map(len, row))
        padded = [
            [""] * (height - len(cell)) + cell if number == 0 else cell + [""] * (height - len(cell)) for cell in row
        ]
        style = "bold" if number == 0 else styles[number - 1] if styles else ""
        for cells in zip(*padded, strict=True):
            text = GAP.join(to(cell, size) for to, cell, size in zip(adjust, cells, widths, strict=True))
            yield TextLine((indent + text).rstrip(), style)


class Piped:
    """Standard output or error that is no terminal: wide lines without styles."""

    width = 160

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    @property
    def encoding(self) -> str:
        return (self._stream.encoding or "utf-8").lower()

    def lines(self, texts: Iterable[str]) -> None:
        """Write lines, tabs as blanks."""
        for text in texts:
            self._stream.write(text.expandtabs().rstrip() + "\n")
        self._stream.flush()


def console(stderr: bool = False) -> Console | Piped:
    """Return the terminal to print to, or plain text where the output is none."""
    stream = sys.stderr if stderr else sys.stdout
    if not stream.isatty() and not any(os.environ.get(name) for name in COLOR_VARIABLES):
        return Piped(stream)
    return terminal(stderr)


def terminal(stderr: bool = False) -> Console:
    """Return a rich console, as wide as :class:`Piped` where the output is no terminal."""
    from rich.console import Console

    class Terminal(Console):
        def on_broken_pipe(self) -> None:  # rich would end with 1, the code of a gate that failed
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    width = None if (sys.stderr if stderr else sys.stdout).isatty() else Piped.width
    colors: Any = {"color_system": None} if os.environ.get("NO_COLOR") else {}
    return Terminal(stderr=stderr, highlight=False, soft_wrap=False, width=width, **colors)


def say(lines: Iterable[TextLine | str], out: Console | Piped) -> None:
    """Print lines as they are: not broken, no markup, no control characters, signs that the output can show."""
    from attlog.words.text import encodable, for_terminal

    safe = ((line, "") if isinstance(line, str) else (line.text, line.style) for line in lines)
    shown = ((encodable(for_terminal(text), out.encoding), style) for text, style in safe)
    if isinstance(out, Piped):
        out.lines(text for text, _ in shown)
        return
    from rich.text import Text

    for text, style in shown:
        out.print(Text(text.rstrip(), style), soft_wrap=True)


class GrowingText:
    """Text that is printed from its beginning while its end is not known yet."""

    def __init__(self, out: Console | Piped, before: Iterable[str] = ()) -> None:
        """``before``: lines above it."""
        self.out, self._before = out, list(before)
        self.width = out.width  # a terminal may be resized between the parts
        self._shown: list[TextLine] = []

    def show(self, lines: Iterable[TextLine]) -> None:
        """Print the lines that were not printed before; all of them where those were others."""
        lines = list(lines)
        known = len(self._shown)
        say([*self._before, *(lines[known:] if lines[:known] == self._shown else lines)], self.out)
        self._shown, self._before = lines, []


def to_stderr(text: str) -> None:
    """Print a message on standard error, without control characters."""
    from attlog.words.text import for_terminal

    if sys.stderr is not None:
        print(for_terminal(text), file=sys.stderr, flush=True)


def to_stdout(text: str) -> None:
    """Print results on standard output, without control characters."""
    from attlog.words.text import for_terminal

    print(for_terminal(text))


def table_to_stdout(form: TableForm, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table as Markdown, CSV or LaTeX."""
    from attlog.compare.tables import table_text

    text_to_stdout(table_text(form, head, rows))


def text_to_stdout(text: str) -> None:
    """Print a text of several lines on standard output."""
    say(text.splitlines(), Piped(sys.stdout))


def json_to_stdout(document: dict[str, Any] | str) -> None:
    """Print JSON, a document as one line; what standard output cannot show, or would steer a terminal, is escaped."""
    import json

    from attlog.words.text import json_for_terminal

    text = document if isinstance(document, str) else ""
    if not text:
        text = json.dumps(document, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
        try:
            text.encode(sys.stdout.encoding or "utf-8")
        except UnicodeEncodeError:
            text = json.dumps(document, separators=(",", ":"), allow_nan=False)
    print(json_for_terminal(text).rstrip("\n"))
