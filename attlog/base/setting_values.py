"""What the value of a setting may be: each kind says it in words and makes a plain value of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(slots=True, eq=False)
class Kind:
    """``says``: what it may be, each a part of a list in words. ``of``: the value, ValueError where it is none."""

    says: tuple[str, ...]
    of: Callable[[Any], Any]

    def checked(self, value: Any) -> Any:
        """The value as it is kept. ValueError with a sentence that says what it may be."""
        try:
            return self.of(value)
        except (ValueError, OverflowError):
            *others, last = self.says
            may = f"{', '.join(others)} or {last}" if others else last
            raise ValueError(f"use {may} (got {value!r:.80})") from None


def whole(least: int | None = None, largest: int | None = None) -> Kind:
    """A whole number, also as text or as a float without a fraction."""

    def of(value: Any) -> int:
        found = int(_plain_number(value)) if not isinstance(value, str) else int(value)
        if not isinstance(value, str) and found != value:
            raise ValueError
        _within(found, least, largest)
        return found

    return Kind((f"a whole number{_range(least, largest)}",), of)


def number(least: float, largest: float) -> Kind:
    """A finite number, also as text."""
    return Kind(
        (f"a number{_range(least, largest)}",),
        lambda value: _within(float(value if isinstance(value, str) else _plain_number(value)), least, largest),
    )


def text() -> Kind:
    """Any text."""
    return Kind(("text",), _text)


def words(*known: str) -> Kind:
    """One of a few words."""

    def of(value: Any) -> str:
        if not isinstance(value, str) or value not in known:
            raise ValueError
        return value

    return Kind(known, of)


def truth() -> Kind:
    """Yes or no."""

    def of(value: Any) -> bool:
        word = value.strip().lower() if isinstance(value, str) else value
        for means, said in ((True, TRUE), (False, FALSE)):
            if word in said:
                return means
        raise ValueError

    return Kind(("true", "false"), of)


TRUE: tuple[Any, ...] = (True, "true", "on", "yes", "1")
FALSE: tuple[Any, ...] = (False, "false", "off", "no", "0")


def either(*kinds: Kind) -> Kind:
    """What the first of them takes."""

    def of(value: Any) -> Any:
        for kind in kinds[:-1]:
            try:
                return kind.of(value)
            except (ValueError, OverflowError):
                continue
        return kinds[-1].of(value)

    return Kind(tuple(word for kind in kinds for word in kind.says), of)


def or_none(kind: Kind) -> Kind:
    """None where nothing is set."""
    return Kind(kind.says, lambda value: None if value is None else kind.of(value))


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError
    return value


def _plain_number(value: Any) -> int | float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError
    return value


def _within(value: Any, least: float | None, largest: float | None) -> Any:
    if not math.isfinite(value) or (least is not None and value < least) or (largest is not None and value > largest):
        raise ValueError
    return value


def _range(least: float | None, largest: float | None) -> str:
    if least is None:
        return ""
    return f" from {least:,.0f}" + ("" if largest is None else f" to {largest:,.0f}")
