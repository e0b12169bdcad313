"""An indented JSON text, as ``json.dumps`` lays it out, in less than half its time: a result is a large part of a run.

The fast encoder of ``json`` knows no indents; with them it asks each part for what it is again and again.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from io import StringIO
from json.encoder import encode_basestring
from typing import Any


def indented(value: Any, end: str = "") -> str:
    """The text of ``json.dumps(value, ensure_ascii=False, indent=1, allow_nan=False)``.

    ``value``: dicts with text as keys, lists, text, numbers, truth values and None. TypeError for anything else, also
    for subclasses of dict and list; ValueError for numbers that are not finite.
    """
    text = StringIO()  # a list of the parts would take several times as much memory
    _write(value, "\n", text.write)
    text.write(end)
    return text.getvalue()


def _write(value: Any, line: str, put: Callable[[str], object]) -> None:
    """Put the parts of the text; ``line``: the line break and indent of what holds the value."""
    kind = type(value)
    if kind is dict and value:
        inner = line + " "
        lead = "{" + inner
        for name, item in value.items():
            leaf = LEAVES.get(type(item))
            if leaf is not None:
                put(f"{lead}{encode_basestring(name)}: {leaf(item)}")
            else:
                put(f"{lead}{encode_basestring(name)}: ")
                _write(item, inner, put)
            lead = "," + inner
        put(line + "}")
    elif kind is list and value:
        inner = line + " "
        lead = "[" + inner
        for item in value:
            leaf = LEAVES.get(type(item))
            if leaf is not None:
                put(lead + leaf(item))
            else:
                put(lead)
                _write(item, inner, put)
            lead = "," + inner
        put(line + "]")
    elif kind in LEAVES:
        put(LEAVES[kind](value))
    elif kind is dict or kind is list:
        put("{}" if kind is dict else "[]")
    elif isinstance(value, (str, int, float)):
        put(json.dumps(value, ensure_ascii=False, allow_nan=False))
    else:
        raise TypeError(f"{kind.__name__} has no text in JSON")


def _float(value: float) -> str:
    if value - value != 0.0:  # infinite or NaN; as quick as it can be asked
        raise ValueError(f"{value!r} is no number of JSON")
    return repr(value)


LEAVES: dict[type, Callable[[Any], str]] = {
    str: encode_basestring,
    float: _float,
    int: repr,
    bool: lambda value: "true" if value else "false",
    type(None): lambda value: "null",
}
"""What holds nothing else."""
