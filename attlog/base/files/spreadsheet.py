"""CSV that a spreadsheet shows and does not run: all cells and headers that attlog writes go through here.

Excel, LibreOffice and Google Sheets take a cell that begins with one of a few signs for a formula, also where it is
quoted in the file; a log's names and texts can say anything (``=HYPERLINK(...)``, ``@SUM(...)``, ``=cmd|...``).
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from typing import Any

FORMULA = re.compile(r"[\s\"]*[=+\-@＝＋－＠].|[\t\r\n].", re.DOTALL)
"""Beginnings that spreadsheets take for a formula, full-width signs included; they skip white space before them."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)", re.ASCII)
"""What stays a number: formulas begin like these too."""
LINE_END = re.compile(r"\r\n?")
ANOTHER = re.compile(r"([;\t\n])")
"""What ends a cell elsewhere."""
UNSEEN = re.compile(
    r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2060\u2066-\u2069\ufeff\ud800-\udfff]"
)
"""Control and direction signs, marks of byte order, bytes that are no UTF-8: they would steer the terminal that shows
the file, or hide how it begins."""


def cell(value: Any) -> Any:
    """A value as a CSV cell: a text that would be run gets an apostrophe before it, all else stays what it is.

    So does the rest of a text behind a line end, a tab or a semicolon: read with another separator, it is a cell. Line
    ends become ``\\n``, for a lone ``\\r`` ends a row in spreadsheets and is not quoted by those who write CSV.
    """
    if not isinstance(value, str):
        return value
    text = UNSEEN.sub("\ufffd", LINE_END.sub("\n", value))
    parts = ANOTHER.split(text)
    return _quoted(parts[0], text) + "".join(_quoted(part, part) for part in parts[1:])


def _quoted(text: str, whole: str) -> str:
    """A part of a text, behind an apostrophe where it, or the whole that it begins, would be run."""
    return f"'{text}" if FORMULA.match(whole) and not NUMBER.fullmatch(text.strip()) else text


def csv_text(lines: Iterable[Sequence[Any]]) -> str:
    """Lines of cells as CSV, head and all; None is an empty cell."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([cell(value) for value in line] for line in lines)
    return out.getvalue()
