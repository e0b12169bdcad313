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

FORMULA = re.compile(r"\s*[=+\-@＝＋－＠].|[\t\r\n]", re.DOTALL)
"""Beginnings that spreadsheets take for a formula, full-width signs included; they skip white space before them."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)", re.ASCII)
"""What stays a number: formulas begin like these too."""
UNSEEN = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control and direction signs, and bytes that are no UTF-8: they would steer the terminal that shows the file."""


def cell(value: Any) -> Any:
    """A value as a CSV cell: a text that would be run gets an apostrophe before it, all else stays what it is."""
    if not isinstance(value, str):
        return value
    text = UNSEEN.sub("\ufffd", value)
    return f"'{text}" if FORMULA.match(text) and not NUMBER.fullmatch(text) else text


def csv_text(lines: Iterable[Sequence[Any]]) -> str:
    """Lines of cells as CSV, head and all; None is an empty cell."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([cell(value) for value in line] for line in lines)
    return out.getvalue()
