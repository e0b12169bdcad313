"""Lines of text, and plain tables whose last column is broken between words; no line ends with blanks."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

GAP = 2
NARROWEST = 30


@dataclass(frozen=True, slots=True)
class Line:
    """One line of text; ``style`` is empty, ``bold``, ``dim`` or a colour."""

    text: str
    style: str = ""


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
