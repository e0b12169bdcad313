"""Short texts of objects for prompt, log file and notebook: ten lines at most, whatever an object holds."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import PurePath
from typing import Any

import numpy as np

# Lines of a text and characters of a line; a notebook on half a screen is this wide.
MAX_LINES, MAX_WIDTH = 10, 110
# Characters of a text or of a list within it.
MAX_CHARACTERS = 70
# Items of a list that are named, and characters below which an item is a name.
MAX_NAMED, MAX_NAME = 12, 24


def brief(value: Any) -> str:
    """Return a dataclass as ``Name(field=..., ...)`` without defaults, arrays by their shape; use as ``__repr__``."""
    parts = [f"{name}={_short(one)}" for name, one in _said(value)]
    text = f"{type(value).__name__}({', '.join(parts)})"
    lines = textwrap.wrap(text, MAX_WIDTH, subsequent_indent="    ", break_long_words=True, break_on_hyphens=False)
    return "\n".join(_limited(lines))


def table_text(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Return a title and its rows (name, text) as lines; control characters are escaped."""
    rows = rows[: MAX_LINES - 1]
    width = max((len(name) for name, _ in rows), default=0)
    lines = [title, *(f"  {name:<{width}}  {text}" for name, text in rows)]
    return "\n".join(_cut(_printable(line), MAX_WIDTH) for line in lines)


def table_html(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Return a title and its rows (name, text) as a table for notebooks; all text is escaped."""
    import html

    def cell(text: str) -> str:
        return html.escape(_cut(_printable(text), 2 * MAX_WIDTH))

    style = ' style="text-align:left;vertical-align:top"'
    lines = [f"<tr><th{style}>{cell(n)}</th><td{style}>{cell(text)}</td></tr>" for n, text in rows[: MAX_LINES - 1]]
    return f"<table><caption{style}><b>{cell(title)}</b></caption>{''.join(lines)}</table>"


def counted(items: Collection[Any] | int, one: str) -> str:
    """Format a number, or that of items, with its noun: ``1 step``, ``28 steps``."""
    n = len(items) if isinstance(items, Collection) else items
    return f"{n:,} {one}{'' if n == 1 else 's'}"


def listed(names: Collection[str], most: int = MAX_NAMED) -> str:
    """Return names separated by commas, the first of many."""
    shown = [str(name) for name, _ in zip(names, range(most), strict=False)]
    return ", ".join(shown) + (f" and {len(names) - most} more" if len(names) > most else "")


def first_part(text: str, *ends: str) -> str:
    """Return the text before the first of ``ends``, brackets whole."""
    depth = 0
    for k, sign in enumerate(text):
        if not depth and text.startswith(ends, k):
            return text[:k]
        depth = max(depth + (sign in "([") - (sign in ")]"), 0)
    return text


def _said(value: Any) -> list[tuple[str, Any]]:
    """Return the fields of a dataclass that are shown and differ from their default."""
    found = []
    for one in fields(value):
        if not one.repr:
            continue
        held = getattr(value, one.name)
        default = one.default if one.default_factory is MISSING else one.default_factory()
        if type(held) is not type(default) or isinstance(held, np.ndarray) or held != default:
            found.append((one.name, held))
    return found


def _short(value: Any) -> str:
    """Return a value in at most MAX_CHARACTERS."""
    if isinstance(value, np.ndarray):
        return repr(value.item()) if value.ndim == 0 else f"{value.dtype}{list(value.shape)}"
    if isinstance(value, str):
        return _cut(repr(value), MAX_CHARACTERS)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, PurePath):
        return repr(str(value))
    if hasattr(type(value), "__dataclass_fields__"):
        return f"{type(value).__name__}(...)"
    if isinstance(value, Mapping):
        return f"{{{_items(list(value))}}}"
    if isinstance(value, list | tuple | set | frozenset):
        return f"[{_items(list(value))}]"
    return _cut(repr(value), MAX_CHARACTERS)


def _items(items: list[Any]) -> str:
    """Return short items themselves, else their number and type."""
    texts = [repr(x) if isinstance(x, str) else f"{x:.6g}" if isinstance(x, float) else str(x) for x in items[:8]]
    if len(items) <= 8 and all(isinstance(x, str | int | float) for x in items):
        text = ", ".join(texts)
        if len(text) <= MAX_CHARACTERS:
            return text
    kinds = {type(x).__name__ for x in items}
    return f"{len(items)} x {kinds.pop()}" if len(kinds) == 1 else f"{len(items)} items"


def _limited(lines: list[str]) -> list[str]:
    return lines if len(lines) <= MAX_LINES else [*lines[: MAX_LINES - 1], "    ...)"]


def _printable(text: str) -> str:
    """Escape what is no printable character: a log may hold terminal sequences."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 3] + "..."
