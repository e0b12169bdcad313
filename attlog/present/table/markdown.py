"""Texts of strangers as Markdown that shows them: nothing in them is taken for markup, HTML or another cell."""

from __future__ import annotations

import re

from attlog.present.text import CONTROL

SPECIAL = re.compile(r"([\\`*_\[\]~|#])")
LINES = re.compile("[\t\r\n]+")


def escaped(text: str) -> str:
    """The text as it is, on one line, also in a cell of a table."""
    plain = CONTROL.sub(" ", LINES.sub(" ", text)).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return SPECIAL.sub(r"\\\1", plain)
