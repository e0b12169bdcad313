"""The boot clock of DataFlash records: which column it is, and which records it shows to be false."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from attlog.base.limits import LAST_TIME_US
from attlog.formats.base import Messages, Offsets
from attlog.formats.clock import Timeline, false_times, in_file_order
from attlog.formats.dataflash.index import HEADER_LENGTH, MessageFormat, RecordIndex
from attlog.formats.mapping import gather


def time_column(fmt: MessageFormat) -> tuple[str, int] | None:
    """Column of a format's boot clock and microseconds per count, None if it has none."""
    return _time_column(fmt.columns, fmt.letters)


@lru_cache(1 << 10)
def _time_column(columns: tuple[str, ...], kinds: str) -> tuple[str, int] | None:
    letters = dict(zip(columns, kinds, strict=False))
    if letters.get("TimeUS") in ("Q", "q"):
        return "TimeUS", 1
    # in GPS records of 3.1 and 3.2, TimeMS is the time of the GPS week and T the boot clock
    column = "T" if "Week" in letters or "GWk" in letters else "TimeMS"
    return (column, 1000) if letters.get(column) in ("I", "i") else None


def timeline(data: NDArray[np.uint8], index: RecordIndex) -> tuple[Offsets, NDArray[np.int64]]:
    """Offset and boot time (us) of every record that carries its time, in file order; uses up ``index.stamps``."""
    stamps, index.stamps = index.stamps, np.zeros(0, np.int64)
    columns = [time_column(fmt) if fmt.readable else None for fmt in index.layouts]
    timed = np.array([column is not None for column in columns])[index.layout]
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


def timeline_of_tables(messages: Messages, formats: Mapping[str, MessageFormat]) -> Timeline:
    """The same from the tables of a text log, whose ``formats`` stand by message name."""
    found = []
    for (name, _), table in messages.items():
        if column := time_column(formats[name]):
            with suppress(KeyError):  # a column that could not be decoded is told among the remarks
                found.append((table.offsets, _microseconds(table[column[0]], column[1])))
    at, time = in_file_order(found)
    possible = (time >= 0) & (time <= LAST_TIME_US)
    return at[possible], time[possible]


def _microseconds(counts: NDArray[np.int64], factor: int) -> NDArray[np.int64]:
    """Counts of a clock as microseconds; -1 where they are beyond any clock."""
    return np.where((counts >= 0) & (counts <= LAST_TIME_US // factor), counts, -1) * factor


def drop_false_times(index: RecordIndex, at: Offsets, time: NDArray[np.int64]) -> tuple[Offsets, NDArray[np.int64]]:
    """The timeline without records whose time those around them contradict; they leave the index as damage.

    DataFlash has no checksum, so this is the one sign of a record whose bytes were changed.
    """
    far = false_times(time)
    if len(far) == 0:
        return at, time
    records = index.offsets.searchsorted(at[far])
    impossible = (time[far] < 0) | (time[far] > LAST_TIME_US)
    false = np.zeros(len(index.offsets), np.bool_)
    false[records[impossible]] = True
    flagged = np.bincount(index.layout[records], minlength=len(index.layouts))
    every = np.bincount(index.layout, minlength=len(index.layouts))
    # a message that is mostly far has another clock, it is not damaged
    damaged = (flagged < 3) | (flagged < 0.1 * every)
    false[records[damaged[index.layout[records]]]] = True
    kept = np.ones(len(at), np.bool_)
    kept[at.searchsorted(index.offsets[false])] = False
    for offset, layout in zip(index.offsets[false].tolist(), index.layout[false].tolist(), strict=True):
        fmt = index.layouts[layout]
        lost = f"a {fmt.name} record whose time is far from that of its neighbours"
        index.losses.add(offset, fmt.length, lost, f"next record at {offset + fmt.length}")
    index.offsets, index.layout = index.offsets[~false], index.layout[~false]
    return at[kept], time[kept]
