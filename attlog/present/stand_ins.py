"""ASCII stand-ins for signs that an output cannot show, and escapes for file names that are not UTF-8."""

from __future__ import annotations

import unicodedata

SIGNS = {
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


def stand_in(text: str, encoding: str) -> str:
    """The text as ``encoding`` can show it; unchanged where it can show all of it."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return "".join(_shown(c, text[i - 1] if i else "", encoding) for i, c in enumerate(text))
    return text


def on_encode_error(error: UnicodeError) -> tuple[str, int]:
    """The same as an error handler of :func:`codecs.register_error`."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object
    shown = (_shown(text[i], text[i - 1] if i else "", error.encoding) for i in range(error.start, error.end))
    return "".join(shown), error.end


def _shown(char: str, before: str, encoding: str) -> str:
    try:
        char.encode(encoding)
    except UnicodeEncodeError:
        pass
    else:
        return char
    if "\udc80" <= char <= "\udcff":  # a byte of a file name that is not UTF-8, as Python keeps it
        return f"\\x{ord(char) - 0xDC00:02x}"
    if char == "°" and before.isdigit():
        return " deg"
    plain = unicodedata.normalize("NFKD", char).encode("ascii", "ignore").decode("ascii")
    return SIGNS.get(char) or plain or char.encode("ascii", "backslashreplace").decode("ascii")
