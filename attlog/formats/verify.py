"""Does our reading of a log equal that of the official library, value by value?

The users' own log is read a second time with pyulog or pymavlink (see
:mod:`attlog.formats.oracle`). Where the readers differ on purpose
(``docs/formats.md``) the difference is listed as explained.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats import oracle
from attlog.formats.file_bytes import decode_text
from attlog.formats.table import Messages


@dataclass(slots=True)
class Verification:
    """What comparing two readings of one log gave.

    ``agrees`` is False where a difference is not ``explained``, None where nothing was compared, because the official
    library cannot read the log or (``late``) took more time than it was given. ``differences`` and
    ``explained`` are sentences with counts; ``text`` sums up. ``only_ours`` and ``only_theirs`` count records that one
    reader has and the other has not, ``unequal`` values, all without what damage explains.
    """

    oracle: str
    agrees: bool | None
    text: str
    messages: int = 0
    records: int = 0
    values: int = 0
    differences: list[str] = field(default_factory=list)
    explained: list[str] = field(default_factory=list)
    only_ours: int = 0
    only_theirs: int = 0
    unequal: int = 0
    late: bool = False


def verify(path: Path | str) -> Verification:
    """The comparison of every message, field and record with pyulog or pymavlink. Errors as ``formats.open``."""
    from attlog.formats import format_named
    from attlog.formats import open as open_log

    path = Path(path)
    log = open_log(path)
    official = format_named(log.format).load_oracle()
    try:
        theirs = oracle.read_by_oracle(path, log.format)
    except oracle.OracleFailed as error:
        late = isinstance(error, oracle.OracleLate)
        text = str(error) if late else f"it cannot read this log ({error})"
        return Verification(official.library, None, text, late=late)
    found = Verification(f"{official.library} {version(official.library)}", True, "")
    incomparable = official.why_not_comparable(log) or {}
    for key in dict.fromkeys([*official.keys(log), *theirs]):
        if key[0] in incomparable:
            found.explained.append(f"{key[0]}: {incomparable[key[0]]}")
        else:
            _compare(log, official, key, theirs.get(key), found)
    found.agrees = not found.differences
    found.text = f"{found.messages} messages, {found.records} records, {found.values} values compared"
    if log.damage_bytes:
        found.text += f"; the file is damaged, attlog left out {log.damage_bytes} bytes"
    if not found.agrees:
        found.text += _who_is_right(found)
    return found


def _who_is_right(found: Verification) -> str:
    """What the file itself says about a difference. Asked where attlog found no damage, or where values differ."""
    said = ""
    if found.only_ours:
        said += (
            f". {found.oracle} leaves out {found.only_ours} records that stand in the file: it is framed by its own "
            "definitions from the first byte to the last, without a gap, so they are there; whether their values are "
            f"right {found.oracle} cannot show"
        )
    if found.only_theirs:
        said += (
            f". attlog leaves out {found.only_theirs} records and found no damage: one of the two is wrong, please "
            "report this log"
        )
    if found.unequal:
        said += (
            f". Of {found.unequal} values both readers have a reading each, and the file does not show which is "
            "right; please report this log"
        )
    return said


def _compare(
    log: Messages, official: oracle.Oracle, key: oracle.Key, theirs: dict[str, Any] | None, found: Verification
) -> None:
    name = key[0] if key[1] is None else f"{key[0]}:{key[1]}"
    ours = official.ours(log, key)
    if ours is None or theirs is None:
        present = ours if ours is not None else theirs
        count = len(next(iter(present.values()))) if present else 0
        reader = "attlog" if ours is not None else found.oracle
        mine, other = (count, 0) if ours is not None else (0, count)
        _note(found, log, f"{name}: only {reader} reads it ({count} records)", mine, other)
        return
    found.messages += 1
    shared = [f for f in ours if f in theirs]
    for column in [f for f in theirs if f not in ours]:
        why = official.why_not_ours(column)
        if why is not None:
            found.explained.append(f"{name}.{column}: {why}, left out by attlog")
        elif column:
            found.differences.append(f"{name}.{column}: only {found.oracle} has this field")
    found.differences += [f"{name}.{f}: only attlog has this field" for f in ours if f not in theirs]
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
            found.unequal += unequal
            found.differences.append(f"{name}.{column}: {unequal} of {n} values differ")


def _compare_rows(log: Messages, name: str, ours: list[Any], theirs: list[Any], found: Verification) -> None:
    """Different numbers of records: which of them do both have?"""
    mine, other = (Counter(zip(*(map(value_text, c) for c in columns), strict=False)) for columns in (ours, theirs))
    more, less = (mine - other).total(), (other - mine).total()
    common = mine.total() - more
    found.records += common
    found.values += common * len(ours)
    sentence = f"{name}: {more} records only attlog reads, {less} only {found.oracle}, {common} equal in both"
    _note(found, log, sentence, more, less)


def _note(found: Verification, log: Messages, sentence: str, ours: int, theirs: int) -> None:
    """A difference in what is there at all: on a damaged file the readers may lose different records."""
    if log.damage or log.damage_bytes:
        found.explained.append(sentence)
        return
    found.differences.append(sentence)
    found.only_ours += ours
    found.only_theirs += theirs


def _equal(ours: Any, theirs: Any) -> NDArray[np.bool_]:
    """Element-wise; NaN equals NaN, the last digit may differ (we multiply by 0.01 where pymavlink divides by 100)."""
    if ours.dtype == object or theirs.dtype == object or ours.ndim > 1:
        return np.array([value_text(a) == value_text(b) for a, b in zip(ours, theirs, strict=True)], bool)
    if ours.dtype.kind in "iub" and theirs.dtype.kind in "iub":
        return np.asarray(ours == theirs)
    a, b = ours.astype(np.float64), theirs.astype(np.float64)
    same: NDArray[np.bool_] = (a == b) | (np.isnan(a) & np.isnan(b))
    near = np.isfinite(a) & np.isfinite(b)
    same[near] |= np.abs(a[near] - b[near]) <= np.spacing(np.abs(b[near]))
    return same


def value_text(value: Any) -> str:
    """A value as text that is equal where the values are."""
    if isinstance(value, str | bytes):
        return decode_text(value) if isinstance(value, bytes) else value
    if np.ndim(value):
        return ",".join(map(value_text, value))
    return f"{value:.12g}" if isinstance(value, float | np.floating) else str(int(value))
