"""An indented JSON text, as ``json.dumps`` lays it out, in less than half its time: a result is a large part of a run.

The fast encoder of ``json`` knows no indents; with them it asks each part for what it is again and again.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from json.encoder import encode_basestring
from typing import Any


def indented(value: Any) -> str:
    """The text of ``json.dumps(value, ensure_ascii=False, indent=1, allow_nan=False)``.

    ``value``: dicts with text as keys, lists, text, numbers, truth values and None. TypeError for anything else, also
    for subclasses of dict and list; ValueError for numbers that are not finite.
    """
    parts: list[str] = []
    _write(value, "\n", parts.append)
    return "".join(parts)


def _write(value: Any, line: str, put: Callable[[str], None]) -> None:
    """Put the parts of the text; ``line``: the line break and indent of what holds the value."""
    kind = type(value)
    if kind is dict and value:
        inner = line + " "
        lead = "{" + inner
        for name, item in value.items():
            put(f"{lead}{encode_basestring(name)}: ")
            _write(item, inner, put)
            lead = "," + inner
        put(line + "}")
    elif kind is list and value:
        inner = line + " "
        lead = "[" + inner
        for item in value:
            put(lead)
            _write(item, inner, put)
            lead = "," + inner
        put(line + "]")
    else:
        put(_leaf(kind, value))


def _leaf(kind: type, value: Any) -> str:
    if kind is str:
        return encode_basestring(value)
    if kind is float:
        if not math.isfinite(value):
            raise ValueError(f"{value!r} is no number of JSON")
        return repr(value)
    if kind is int:
        return repr(value)
    if kind in WORDS:
        return WORDS[kind](value)
    if isinstance(value, (str, int, float)):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    raise TypeError(f"{kind.__name__} has no text in JSON")


WORDS: dict[type, Callable[[Any], str]] = {
    bool: lambda value: "true" if value else "false",
    type(None): lambda value: "null",
    dict: lambda value: "{}",
    list: lambda value: "[]",
}
"""What is left: words, and empty containers."""
