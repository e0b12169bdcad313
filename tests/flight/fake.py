"""Messages made of arrays, for eras and faults that no log in hand holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.table import Boot, Field, Messages, ParamChange, Table, Text

Columns = Mapping[str, NDArray[Any]]


def table(name: str, instance: int, columns: Columns, offsets: NDArray[np.int64]) -> Table:
    """A table whose records stand at the given places in the file."""
    stored = {c: np.asarray(x) for c, x in columns.items()}
    fields = {c: Field(c, np.dtype((x.dtype, x.shape[1:])) if x.ndim > 1 else x.dtype) for c, x in stored.items()}

    def decode(column: str, wanted: NDArray[np.int64]) -> NDArray[Any]:
        return stored[column][np.searchsorted(offsets, wanted)]

    return Table(name, instance, fields, offsets, decode)


def messages(
    kind: str,
    tables: Mapping[tuple[str, int], Columns],
    params: Mapping[str, float] | Sequence[ParamChange] = (),
    texts: Sequence[Text] = (),
    info: Mapping[str, Any] | None = None,
) -> Messages:
    """An opened log of a format (``ulog``, ``dataflash``, ``tlog`` ...); records lie in the order of the tables."""
    made, begin = {}, 1000
    for (name, instance), columns in tables.items():
        n = len(next(iter(columns.values())))
        made[name, instance] = table(name, instance, columns, begin + 100 * np.arange(n, dtype=np.int64))
        begin += 100 * n
    if isinstance(params, Mapping):
        params = [ParamChange(name, value) for name, value in params.items()]
    result = Messages(Path("made.log"), kind, begin, made, list(params), list(texts), dict(info or {}))
    result.boots = [Boot(0, begin)]
    return result


def micros(n: int, rate: float, start: int = 10_000_000) -> NDArray[np.uint64]:
    """Even stamps (n,) in us."""
    return (start + np.round(np.arange(n) * 1e6 / rate)).astype(np.uint64)


def level(n: int) -> NDArray[np.float32]:
    """Quaternions (n, 4) of a vehicle that stands level and looks north."""
    return np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1))


def gravity(n: int) -> NDArray[np.float32]:
    """Specific force (n, 3) of a vehicle that stands level."""
    return np.tile(np.array([0, 0, -9.81], np.float32), (n, 1))
