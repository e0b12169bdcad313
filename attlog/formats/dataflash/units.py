"""What FMTU, UNIT and MULT records say of the units of DataFlash columns."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Table
from attlog.formats.dataflash.content import is_integer, is_number, is_text
from attlog.formats.dataflash.index import LETTER_SCALES, RecordIndex
from attlog.formats.dataflash.tables import Units, build_tables
from attlog.formats.mapping import text_of
from attlog.formats.mapping import texts_of as decoded

_PREFIXES = {1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n", 1e3: "k"}


def units_of(data: NDArray[np.uint8], index: RecordIndex) -> Units:
    """For each layout that FMTU describes: its unit ids, and the unit text of every column."""
    describes = np.array([f.name in ("FMTU", "UNIT", "MULT") for f in index.layouts])
    chosen = describes[index.layout].nonzero()[0]
    some = RecordIndex(index.layouts, index.offsets[chosen], index.layout[chosen], np.zeros(0, np.int64))
    tables = build_tables(data, some, by_instance=False)
    described = tables.get(("FMTU", 0))
    if described is None or not is_integer(described, "FmtType"):
        return {}
    if not (is_text(described, "UnitIds") and is_text(described, "MultIds")):
        return {}
    names = {i: text_of(t) for i, t in _pairs(tables.get(("UNIT", 0)), "Label", is_text)}
    factors = {i: float(m) for i, m in _pairs(tables.get(("MULT", 0)), "Mult", is_number)}
    by_type: dict[int, list[int]] = {}
    for k, fmt in enumerate(index.layouts):
        by_type.setdefault(fmt.type, []).append(k)
    since = {kind: [index.layouts[k].offset for k in mine] for kind, mine in by_type.items()}
    unit_text = cache(_unit_text)  # the same few combinations in every message

    @cache
    def texts_of(letters: str, ids: str, mults: str) -> tuple[str | None, ...]:
        return tuple(
            unit_text(names.get(u, ""), u, factors.get(m, 0.0), m, LETTER_SCALES.get(letter, 1.0))
            for letter, u, m in zip(letters, ids, mults.ljust(len(ids), "-"), strict=False)
        )

    result: Units = {}
    rows = zip(
        described["FmtType"].tolist(),
        decoded(described["UnitIds"]),
        decoded(described["MultIds"]),
        described.offsets.tolist(),
        strict=True,
    )
    for kind, ids, mults, offset in rows:
        mine = by_type.get(kind)
        if mine:
            fmt_at = mine[max(bisect_left(since[kind], offset) - 1, 0)]
            result[fmt_at] = (ids, partial(texts_of, index.layouts[fmt_at].letters, ids, mults))
    return result


def _pairs(table: Table | None, column: str, is_fit: Callable[[Table, str], bool]) -> list[tuple[str, Any]]:
    """Id and value of UNIT or MULT records; none where the log gives these columns another type."""
    if table is None or not is_fit(table, column) or not is_integer(table, "Id"):
        return []
    ids = [chr(int(i) & 0xFF) for i in table["Id"].tolist()]
    return list(zip(ids, table[column].tolist(), strict=True))


def _unit_text(name: str, unit_id: str, factor: float, mult_id: str, scale: float) -> str | None:
    """The unit of the printed number, None if the log does not tell.

    Logged value times multiplier is in ``name``. The letter's scale is often part
    of the multiplier already (c with B = 0.01, L with G = 1e-7) or the multiplier
    is left at 1 beside a scaled letter: both mean that the printed number is in
    ``name``. What remains becomes an SI prefix or a factor.
    """
    if unit_id in "-?#" or mult_id == "?" or not name or not 0.0 <= factor < np.inf:
        return None
    if mult_id == "-" or factor == 0.0 or (scale != 1.0 and factor == 1.0):
        return name
    rest = float(f"{factor / scale:.6g}")
    if rest == 1.0:
        return name
    return _PREFIXES[rest] + name if rest in _PREFIXES else f"{rest:g} {name}"
