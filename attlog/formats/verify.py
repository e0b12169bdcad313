"""Does our reading of a log equal that of the official library, value by value?

The users' own log is read a second time with pyulog or pymavlink (see
:mod:`attlog.formats.oracles`). Where the readers differ on purpose
(``docs/formats.md``) the difference is listed as explained.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats import oracles
from attlog.formats.base import Messages
from attlog.formats.mapping import text_of

LIBRARIES = {"ulog": "pyulog"}
NOT_COMPARED = {("FMT", "Columns"), ("FMT", "Format"), ("FILE", "Data")}
"""Binary content and the description of FMT itself, which the libraries build in."""


@dataclass(slots=True)
class Verification:
    """What comparing two readings of one log gave.

    ``agrees`` is False where a difference is not ``explained``. ``differences`` and
    ``explained`` are sentences with counts; ``text`` sums up.
    """

    oracle: str
    agrees: bool
    text: str
    messages: int = 0
    records: int = 0
    values: int = 0
    differences: list[str] = field(default_factory=list)
    explained: list[str] = field(default_factory=list)


def verify(path: Path | str) -> Verification:
    """The comparison of every message, field and record with pyulog or pymavlink. Errors as ``formats.open``."""
    from attlog.formats import open as open_log

    path = Path(path)
    log = open_log(path)
    try:
        other = oracles.read(path, log.format)
    except Exception as error:  # the other library may fail in any way on a log that we can read
        library = LIBRARIES.get(log.format, "pymavlink")
        return Verification(library, False, f"it cannot read this log ({type(error).__name__}: {error}); not compared")
    found = Verification(other.library, True, "")
    redefined = _redefined(log)
    for key in _keys(log, other.columns):
        if key[0] in redefined:
            found.explained.append(
                f"{key[0]}: defined anew inside the file; {other.library} applies the last definition to all records, "
                "attlog each from its place on"
            )
        else:
            _compare(log, key, other.columns.get(key), found)
    found.agrees = not found.differences
    found.text = f"{found.messages} messages, {found.records} records, {found.values} values compared"
    if log.damage_bytes:
        found.text += f"; the file is damaged, attlog left out {log.damage_bytes} bytes"
    return found


def _keys(log: Messages, theirs: oracles.Columns) -> list[oracles.Key]:
    """Messages of both, in our naming where the library splits by instance, else without instance."""
    by_instance = log.format in ("ulog", "tlog", "mavlink")
    ours: list[oracles.Key] = list(log) if by_instance else [(name, None) for name in log.names()]
    skipped = ("FMT",) if log.format == "dataflash_text" else ()
    return [key for key in dict.fromkeys([*ours, *theirs]) if key[0] not in skipped]


def _redefined(log: Messages) -> set[str]:
    """DataFlash messages of which a type, layout or name changes inside the file (logs of two boots in one)."""
    table = log.tables.get(("FMT", 0))
    if table is None or not {"Type", "Name", "Length", "Format"} <= table.fields.keys():
        return set()
    rows = set(zip(*(table[c].tolist() for c in ("Type", "Name", "Length", "Format")), strict=True))
    types, names = Counter(row[0] for row in rows), Counter(row[1] for row in rows)
    return {text_of(row[1]) for row in rows if types[row[0]] > 1 or names[row[1]] > 1}


def _compare(log: Messages, key: oracles.Key, theirs: dict[str, Any] | None, found: Verification) -> None:
    name = key[0] if key[1] is None else f"{key[0]}:{key[1]}"
    ours = official_columns(log, key)
    if ours is None or theirs is None:
        present = ours if ours is not None else theirs
        count = len(next(iter(present.values()))) if present else 0
        reader = "attlog" if ours is not None else found.oracle
        _note(found, log, f"{name}: only {reader} reads it ({count} records)")
        return
    found.messages += 1
    shared = [f for f in ours if f in theirs and (key[0], f) not in NOT_COMPARED]
    for column in [f for f in theirs if f not in ours]:
        if column.rpartition(".")[2].startswith("_padding"):
            found.explained.append(f"{name}.{column}: padding, left out by attlog")
        elif column:
            found.differences.append(f"{name}.{column}: only {found.oracle} has this field")
    found.differences += [
        f"{name}.{f}: only attlog has this field"
        for f in ours
        if f not in theirs and f != "_t_us" and (key[0], f) not in NOT_COMPARED
    ]
    if not shared:
        return
    n, m = len(ours[shared[0]]), len(theirs[shared[0]])
    if n != m or any(len(theirs[f]) != m for f in shared):
        _compare_rows(log, name, [ours[f] for f in shared], [theirs[f] for f in shared], found)
        return
    found.records += n
    for column in shared:
        found.values += int(np.size(ours[column]))
        unequal = n - int(np.count_nonzero(_equal(ours[column], theirs[column])))
        if unequal:
            found.differences.append(f"{name}.{column}: {unequal} of {n} values differ")


def _compare_rows(log: Messages, name: str, ours: list[Any], theirs: list[Any], found: Verification) -> None:
    """Different numbers of records: which of them do both have?"""
    mine, other = (Counter(zip(*(map(spelled, c) for c in columns), strict=False)) for columns in (ours, theirs))
    more, less = (mine - other).total(), (other - mine).total()
    common = mine.total() - more
    found.records += common
    found.values += common * len(ours)
    _note(found, log, f"{name}: {more} records only attlog reads, {less} only {found.oracle}, {common} equal in both")


def _note(found: Verification, log: Messages, sentence: str) -> None:
    """A difference in what is there at all: on a damaged file the readers may lose different records."""
    (found.explained if log.damage or log.damage_bytes else found.differences).append(sentence)


def official_columns(log: Messages, key: oracles.Key) -> dict[str, Any] | None:
    """Our columns as the library names and scales them; instances of one message merged in file order if it does so."""
    if log.format == "ulog":
        return _flat(log, key) if key in log else None  # type: ignore[operator]
    tables = [log[key[0], i] for i in (log.instances(key[0]) if key[1] is None else [key[1]]) if (key[0], i) in log]
    if not tables:
        return None
    order = np.argsort(np.concatenate([t.offsets for t in tables]), kind="stable")
    columns: dict[str, Any] = {}
    for name, described in tables[0].fields.items():
        plain = described.dtype.kind in "iub" and described.scale == 1.0
        stored = plain or described.dtype.shape or described.dtype.kind == "S"
        column = np.concatenate([t[name] if stored else t.value(name) for t in tables if name in t])[order]
        columns[name] = _texts(column, key[1] is not None) if column.dtype.kind == "S" else column
    return columns


def _flat(log: Messages, key: Any) -> dict[str, NDArray[Any]]:
    """ULog: one column per array element, text as small integers."""
    found: dict[str, NDArray[Any]] = {}
    for name, described in log[key].fields.items():
        column = log[key][name]
        if described.dtype.kind == "S":
            width = described.dtype.itemsize
            raw = np.frombuffer(column.tobytes(), np.int8).reshape(len(column), width)
            found |= {f"{name}[{i}]": raw[:, i] for i in range(width)} if width > 1 else {name: raw[:, 0]}
        elif column.ndim == 2:
            found |= {f"{name}[{i}]": column[:, i] for i in range(column.shape[1])}
        else:
            found[name] = column
    return found


def _texts(column: NDArray[np.bytes_], ascii_only: bool) -> NDArray[np.object_]:
    """Texts as the library decodes them: MAVLink as ASCII with replacement characters."""
    result = np.empty(len(column), object)
    result[:] = [raw.decode("ascii", "replace") if ascii_only else text_of(raw) for raw in column.tolist()]
    return result


def _equal(ours: Any, theirs: Any) -> NDArray[np.bool_]:
    """Element-wise; NaN equals NaN, the last digit may differ (we multiply by 0.01 where pymavlink divides by 100)."""
    if ours.dtype == object or theirs.dtype == object or ours.ndim > 1:
        return np.array([spelled(a) == spelled(b) for a, b in zip(ours, theirs, strict=True)], bool)
    if ours.dtype.kind in "iub" and theirs.dtype.kind in "iub":
        return np.asarray(ours == theirs)
    a, b = ours.astype(np.float64), theirs.astype(np.float64)
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    near = np.isfinite(a) & np.isfinite(b)
    same[near] |= np.abs(a[near] - b[near]) <= np.spacing(np.abs(b[near]))
    return same


def spelled(value: Any) -> str:
    """A value as text that is equal where the values are."""
    if isinstance(value, str | bytes):
        return text_of(value) if isinstance(value, bytes) else value
    if np.ndim(value):
        return ",".join(map(spelled, value))
    return f"{value:.12g}" if isinstance(value, float | np.floating) else str(int(value))
