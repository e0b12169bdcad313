"""The boot clock of DataFlash records: which column it is, and which records it shows to be false."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Damage, Messages
from attlog.formats.clock import Timeline, in_file_order
from attlog.formats.dataflash.index import HEADER_LENGTH, Format, Index
from attlog.formats.mapping import Offsets, gather
from attlog.limits import MAX_DAMAGE, MAX_TIME_JUMP_S

FALSE_TIME_US = 5_000_000
"""A single record further than this from two neighbours that agree is false; no undamaged log has one beyond 0.1 s."""

LAST_TIME_US = 1 << 56
"""Boot clocks and even Unix clocks stay below; random bytes hardly ever do."""


def time_column(fmt: Format) -> tuple[str, int] | None:
    """Column of a format's boot clock and microseconds per count, None if it has none."""
    letters = dict(zip(fmt.columns, fmt.letters, strict=False))
    if letters.get("TimeUS") in ("Q", "q"):
        return "TimeUS", 1
    # in GPS records of 3.1 and 3.2, TimeMS is the time of the GPS week and T the boot clock
    column = "T" if "Week" in letters or "GWk" in letters else "TimeMS"
    return (column, 1000) if letters.get(column) in ("I", "i") else None


def timeline(data: NDArray[np.uint8], index: Index) -> tuple[Offsets, NDArray[np.int64]]:
    """Offset and boot time (us) of every record that carries its time, in file order; uses up ``index.stamps``."""
    stamps, index.stamps = index.stamps, np.zeros(0, np.int64)
    columns = [time_column(fmt) if fmt.readable else None for fmt in index.layouts]
    timed = np.array([column is not None for column in columns])[index.layout].nonzero()[0]
    at, time = index.offsets[timed], stamps[timed]
    elsewhere = {}
    for k, (fmt, column) in enumerate(zip(index.layouts, columns, strict=True)):
        if column is not None:
            place, factor = fmt.place(fmt.columns.index(column[0])), column[1]
            if (place, factor) != (HEADER_LENGTH, 1):
                elsewhere[k] = place, factor
    if elsewhere:
        kinds = index.layout[timed]
        for k, (place, factor) in elsewhere.items():
            mine = (kinds == k).nonzero()[0]
            dtype = np.dtype("<i8" if factor == 1 else "<u4")
            time[mine] = gather(data, at[mine] + np.int64(place), dtype).astype(np.int64) * factor
    return at, time


def timeline_of_tables(messages: Messages, formats: Mapping[str, Format]) -> Timeline:
    """The same from the tables of a text log, whose ``formats`` stand by message name."""
    timed = [(table, column) for (name, _), table in messages.items() if (column := time_column(formats[name]))]
    return in_file_order((table.offsets, table[column].astype(np.int64) * factor) for table, (column, factor) in timed)


def drop_false_times(index: Index, at: Offsets, time: NDArray[np.int64]) -> tuple[Offsets, NDArray[np.int64]]:
    """The timeline without single records whose time is far from both neighbours; they leave the index as damage.

    DataFlash has no checksum, so this is the one sign of a record whose bytes were changed.
    """
    if len(time) < 3:
        return at, time
    far = _far(time)
    impossible = (time.view(np.uint64) > LAST_TIME_US).nonzero()[0]  # a negative time is a very large one
    if not (len(far) or len(impossible)):
        return at, time
    records = index.offsets.searchsorted(at[far])
    kinds = index.layout[records]
    false = np.zeros(len(index.offsets), np.bool_)
    false[index.offsets.searchsorted(at[impossible])] = True
    for kind in set(kinds.tolist()):
        flagged = records[kinds == kind]
        # a message that is mostly far has another clock, it is not damaged
        if len(flagged) < 3 or len(flagged) < 0.1 * np.count_nonzero(index.layout == kind):
            false[flagged] = True
    kept = np.ones(len(at), np.bool_)
    kept[at.searchsorted(index.offsets[false])] = False
    for offset, layout in zip(index.offsets[false].tolist(), index.layout[false].tolist(), strict=True):
        fmt = index.layouts[layout]
        index.damage_bytes += fmt.length
        if len(index.damage) < MAX_DAMAGE:
            lost = f"a {fmt.name} record whose time is far from that of its neighbours"
            index.damage.append(Damage(offset, fmt.length, lost, f"next record at {offset + fmt.length}"))
    index.damage.sort(key=lambda d: d.offset)
    index.offsets, index.layout = index.offsets[~false], index.layout[~false]
    return at[kept], time[kept]


def _far(time: NDArray[np.int64]) -> NDArray[np.int64]:
    """The single records (their indices) that are far from both neighbours, while those agree."""
    change = np.diff(time)
    np.abs(change, out=change)
    steps = (change > FALSE_TIME_US).nonzero()[0]
    if len(steps) == 0:
        return steps
    far = steps[1:][np.diff(steps) == 1]  # a step to the record and another one away from it
    far = far[np.abs(time[far + 1] - time[far - 1]) <= FALSE_TIME_US]
    # beside the first or last record a hole may stand, so only more than a hole counts
    lone = change > MAX_TIME_JUMP_S * 1e6
    first = [0] if lone[0] and change[1] <= FALSE_TIME_US else []
    last = [len(time) - 1] if lone[-1] and change[-2] <= FALSE_TIME_US else []
    return np.concatenate([first, far, last]).astype(np.int64)
