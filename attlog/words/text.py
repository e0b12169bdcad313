"""Clean and format texts: untrusted texts, narrow encodings, sentences, Markdown."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from attlog.words.numbers import CLOCK_FROM_S, MINUS, moment, unit_sign

ASCII_SIGNS = {
    "°": "deg",
    "±": "+/-",
    "−": "-",
    "×": "x",
    "√": "sqrt",
    "µ": "u",
    "²": "^2",
    "σ": "sigma",
    "·": "-",
    "…": "...",
    "–": "-",
    "—": "-",
    "→": "->",
    "≤": "<=",
    "≥": ">=",
    "’": "'",
    "‘": "'",
    "“": '"',
    "”": '"',
    "●": "*",
    "‹": "<",
    "›": ">",
    "≈": "~",
    "Δ": "delta",
    "\N{REPLACEMENT CHARACTER}": "?",
}


def encodable(text: str, encoding: str) -> str:
    """Replace characters that ``encoding`` lacks."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return "".join(_encodable_sign(c, text[i - 1] if i else "", encoding) for i, c in enumerate(text))
    return text


def on_encode_error(error: UnicodeError) -> tuple[str, int]:
    """Replace characters that an encoding lacks, as :func:`codecs.register_error` needs it."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object
    shown = (_encodable_sign(text[i], text[i - 1] if i else "", error.encoding) for i in range(error.start, error.end))
    return "".join(shown), error.end


def _encodable_sign(char: str, before: str, encoding: str) -> str:
    try:
        char.encode(encoding)
    except UnicodeEncodeError:
        pass
    else:
        return char
    if "\udc80" <= char <= "\udcff":  # Python's surrogate for a non-UTF-8 byte of a file name
        return f"\\x{ord(char) - 0xDC00:02x}"
    if char == "°" and before.isdigit():
        return " deg"
    plain = unicodedata.normalize("NFKD", char).encode("ascii", "ignore").decode("ascii")
    return ASCII_SIGNS.get(char) or plain or char.encode("ascii", "backslashreplace").decode("ascii")


# Clean untrusted texts, typeset sentences, format values of unknown type.

CONTROL = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff"
    r"\U000e0000-\U000e007f]"
)


def clean(text: str) -> str:
    """Replace control and direction characters of a log's text by a visible mark."""
    text = str(text)
    return text if text.isascii() and text.isprintable() else CONTROL.sub("\ufffd", text)


def for_terminal(text: str) -> str:
    """Remove terminal commands from a text; escape bytes that are not UTF-8."""
    return clean(encodable(text, "utf-8"))


def json_for_terminal(text: str) -> str:
    """Escape terminal commands in a JSON text as JSON does."""
    import json

    return CONTROL.sub(lambda found: json.dumps(found[0])[1:-1], text)


def cleaned(value: Any) -> Any:
    """Clean every text in a JSON value; numbers that JSON lacks become null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, str):
        return clean(value)
    if isinstance(value, dict):
        return {k: cleaned(v) for k, v in value.items()}
    return [cleaned(v) for v in value] if isinstance(value, Iterable) else value


UNITS_IN_TEXT = (
    (re.compile(r"(?<![\w.])-(?=0(\.0+)?( |°|,|$))"), ""),
    (re.compile(r" deg/(min|s|h)\b"), r"°/\1"),
    (re.compile(r" deg\b"), "°"),
    (re.compile(r"\+-(?=\d)"), "±"),
    (re.compile(r"(?<=\d) m/s\^2"), " m/s²"),
    (re.compile(r"(?<=\d) uT\b"), " µT"),
    (re.compile(r"(?<![\w.])-(?=\d+(\.\d+)?([ °,;:)]|$))"), MINUS),
)


# Blank between a number and its unit.
UNIT_BLANK = re.compile(r"(?<=\d) (?=\S{1,4}(?:[\s.,;:)]|$))")


def with_fixed_units(text: str) -> str:
    """Put a no-break space between each number and its unit."""
    return UNIT_BLANK.sub("\u00a0", text)


# A time on the log's clock in a sentence.
INSTANT = re.compile(r"\b(at|from|until) (\d{3,}(?:\.\d+)?) s\b")


@lru_cache(maxsize=1024)  # the same reason appears in hundreds of cells
def typeset(text: str) -> str:
    """Typeset units, signs and times of a sentence: ``±6.0°/min``, ``at 0:17:23``."""
    text = INSTANT.sub(
        lambda m: f"{m[1]} {moment(float(m[2])) if float(m[2]) >= CLOCK_FROM_S else m[2] + ' s'}", clean(text)
    )
    for found, written in UNITS_IN_TEXT:
        text = found.sub(written, text)
    return text


def plain_value(value: Any, unit: str = "") -> str:
    """Format a value of unknown type."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        sign = unit_sign(unit)
        text = f"{value + 0.0:.4g}".replace("-", MINUS)
        return f"{text}{sign}" if sign.startswith("°") else f"{text} {sign}".rstrip()
    return f"{value} {unit_sign(unit)}".rstrip()


# Untrusted texts in Markdown: nothing is read as markup, HTML or another cell.

MARKDOWN_SIGNS = re.compile(r"([\\`*_\[\]~|#])")
LINE_BREAKS = re.compile("[\t\r\n]+")


def escape_markdown(text: str) -> str:
    """Escape a text for Markdown, on one line, also in a table cell."""
    plain = CONTROL.sub(" ", LINE_BREAKS.sub(" ", text)).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return MARKDOWN_SIGNS.sub(r"\\\1", plain)
