"""Every field that a flight is read from, whole, as no sensor gives it: one field and one value for each number.

:mod:`tests.fuzz.values` breaks columns at random. Here the product of fields and values is enumerated, so that a
run over ``range(count(messages))`` leaves nothing out: ``swept(messages, number)`` is the log with one field changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import flight
from attlog.base.errors import AttlogError
from attlog.formats.base import Messages, Table

Column = NDArray[Any]
Key = tuple[str, int]
Read = tuple[Key, str]


def _all(value: float) -> Callable[[Column], Column]:
    """Every record holds a value, or what comes next to it in the column's type."""

    def filled(x: Column) -> Column:
        if x.dtype.kind == "f":
            return np.full_like(x, value)
        info = np.iinfo(x.dtype)
        return np.full_like(x, int(min(max(np.nan_to_num(value, nan=-1.0), float(info.min)), float(info.max) * 0.999)))

    return filled


def _limit(largest: bool) -> Callable[[Column], Column]:
    def filled(x: Column) -> Column:
        info: Any = np.finfo(x.dtype) if x.dtype.kind == "f" else np.iinfo(x.dtype)
        return np.full_like(x, info.max if largest else info.min)

    return filled


def _ramp(x: Column) -> Column:
    """From the smallest to the largest of its values, evenly."""
    if len(x) == 0 or not np.isfinite(x.astype(np.float64)).any():
        return x
    low, high = float(np.nanmin(x)), float(np.nanmax(x))
    line = np.linspace(low, high, len(x)).reshape(-1, *[1] * (x.ndim - 1))
    return np.broadcast_to(line, x.shape).astype(x.dtype)


def _shuffled(x: Column) -> Column:
    return x[np.random.default_rng(0).permutation(len(x))]


VALUES: dict[str, Callable[[Column], Column]] = {
    "nan": _all(np.nan),
    "inf": _all(np.inf),
    "-inf": _all(-np.inf),
    "zero": _all(0.0),
    "max": _limit(True),
    "min": _limit(False),
    "1e38": _all(1e38),
    "denormal": _all(1e-40),
    "negative": lambda x: -x,
    "constant": lambda x: np.broadcast_to(x[:1], x.shape).copy() if len(x) else x,
    "ramp": _ramp,
    "shuffled": _shuffled,
}
"""What becomes of the field, from first record to last."""


def read_fields(messages: Messages) -> list[Read]:
    """The numeric fields that a flight asks for, in the order of the log."""
    asked: set[Read] = set()

    def watched(key: Key, table: Table) -> Table:
        def decoded(column: str, wanted: NDArray[np.int64]) -> Column:
            asked.add((key, column))
            return table._decode(column, wanted)

        return Table(table.name, table.instance, table.fields, table.offsets, decoded)

    tables = {key: watched(key, table) for key, table in messages.tables.items()}
    try:
        flight.flight_in(replace(messages, tables=tables))
    except AttlogError:
        pass  # what was asked for before the log was given up counts as well
    return [
        (key, name)
        for key, table in messages.tables.items()
        for name, field in table.fields.items()
        if (key, name) in asked and field.dtype.base.kind in "iuf"
    ]


def count(fields: list[Read]) -> int:
    """How many different numbers there are."""
    return len(fields) * len(VALUES)


def name(fields: list[Read], number: int) -> str:
    """What a number changes, in words."""
    which, value = divmod(number % count(fields), len(VALUES))
    (message, instance), field = fields[which]
    return f"{message}:{instance}.{field} {list(VALUES)[value]}"


def swept(messages: Messages, number: int, fields: list[Read] | None = None) -> Messages:
    """The log with one field changed throughout; the log itself where no flight is read from it."""
    fields = read_fields(messages) if fields is None else fields
    if not fields:
        return messages
    which, value = divmod(number % count(fields), len(VALUES))
    key, field = fields[which]
    old, change = messages.tables[key], list(VALUES.values())[value]

    def decoded(column: str, wanted: NDArray[np.int64]) -> Column:
        if column != field:
            return old._decode(column, wanted)
        whole = np.array(old._decode(column, old.offsets))
        with np.errstate(all="ignore"):
            return change(whole)[np.searchsorted(old.offsets, wanted)]

    changed = Table(old.name, old.instance, old.fields, old.offsets, decoded)
    return replace(messages, tables={**messages.tables, key: changed})
