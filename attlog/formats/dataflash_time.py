"""The boot clock of DataFlash records: which column it is, and which records it shows to be false."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Damage
from attlog.formats.dataflash_index import Format, Index
from attlog.formats.mapping import gather
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


def timeline(data: NDArray[np.uint8], index: Index) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Offset and boot time (us) of every record that carries its time, in file order."""
    columns = [time_column(fmt) if fmt.readable else None for fmt in index.layouts]
    at = []
    time = []
    for dtype, factor in ((np.dtype("<i8"), 1), (np.dtype("<u4"), 1000)):
        place = np.array(
            [
                fmt.place(fmt.columns.index(column[0])) if column and column[1] == factor else 0
                for fmt, column in zip(index.layouts, columns, strict=True)
            ],
            np.uint8,
        )
        if place.any():
            places = place[index.layout]
            timed = np.flatnonzero(places)
            at.append(index.offsets[timed])
            time.append(gather(data, at[-1] + places[timed], dtype).astype(np.int64) * factor)
    if not at:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    if len(at) == 1:
        return at[0], time[0]
    order = np.argsort(np.concatenate(at), kind="stable")
    return np.concatenate(at)[order], np.concatenate(time)[order]


def drop_false_times(
    index: Index, at: NDArray[np.int64], time: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The timeline without single records whose time is far from both neighbours; they leave the index as damage.

    DataFlash has no checksum, so this is the one sign of a record whose bytes were changed.
    """
    if len(time) < 3:
        return at, time
    step = np.abs(np.diff(time)) > FALSE_TIME_US
    far = np.concatenate([[step[0] and not step[1]], step[:-1] & step[1:], [step[-1] and not step[-2]]])
    far[1:-1] &= np.abs(time[2:] - time[:-2]) <= FALSE_TIME_US
    far[[0, -1]] &= np.abs(time[[0, -1]] - time[[1, -2]]) > MAX_TIME_JUMP_S * 1e6  # a hole may stand at the ends
    impossible = (time < 0) | (time > LAST_TIME_US)
    if not (far.any() or impossible.any()):
        return at, time
    false = np.isin(index.offsets, at[far])
    # a message that is mostly far has another clock, it is not damaged
    of_type = np.bincount(index.layout, minlength=len(index.layouts))
    flagged = np.bincount(index.layout[false], minlength=len(index.layouts))
    false &= ((flagged < 3) | (flagged < 0.1 * of_type))[index.layout]
    false |= np.isin(index.offsets, at[impossible])
    dropped = np.isin(at, index.offsets[false])
    for offset, layout in zip(index.offsets[false].tolist(), index.layout[false].tolist(), strict=True):
        fmt = index.layouts[layout]
        index.damage_bytes += fmt.length
        if len(index.damage) < MAX_DAMAGE:
            lost = f"a {fmt.name} record whose time is far from that of its neighbours"
            index.damage.append(Damage(offset, fmt.length, lost, f"next record at {offset + fmt.length}"))
    index.damage.sort(key=lambda d: d.offset)
    index.offsets, index.layout = index.offsets[~false], index.layout[~false]
    return at[~dropped], time[~dropped]
