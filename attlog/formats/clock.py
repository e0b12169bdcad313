"""Boot clocks, from the times of the records in file order: where one starts anew, what time it was at a byte."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.core.limits import LAST_TIME_US, MAX_BOOTS, MAX_TIME_JUMP_S
from attlog.formats.table import Boot, Offsets

Timeline = tuple[Offsets, NDArray[np.int64]]
"""Byte offsets of records that carry their time, ascending, and the times (us)."""

MIN_RESTART_US = 1_000_000
"""A clock that falls further was restarted; tasks log each other's times out of order by under 0.1 s."""

MAX_DEVIATION_US = 5_000_000
"""Times further than this from those on both sides, which agree, are false; no undamaged log has one beyond 0.1 s."""

MAX_FALSE_RECORDS = 64
"""Records in a row that can be false: what a damaged sector or a torn write changes; more is another clock or boot."""

MAX_LATE_RECORDS = 256
"""Records in a row that a task may write late."""

MAX_FALSE_RUNS = 8
"""Runs with different false times beside each other that are looked over."""

MIN_END_RECORDS = 3
"""So few records at an end of the file may be false alone."""

MAX_STEP_SHARE = 0.25
"""Of all times, this part may be steps; where there are more, no clock can be told that contradicts them."""

_CHUNK = 1 << 14
_NEIGHBOURS = 20  # records on either side whose medians must agree that the clock fell


def restarts(time_us: NDArray[np.int64]) -> list[int]:
    """The indices of the first records after a restart of the clock, at most :data:`MAX_BOOTS`.

    A single record with a false time is no restart: the medians of the neighbours on both sides decide. Nor are
    records that a task wrote late, with the times at which it should have: the clock comes back behind them.
    """
    found: list[int] = []
    for k in _step_indices(time_us, -MIN_RESTART_US, np.iinfo(np.int64).max).tolist():
        before = sorted(time_us[max(found[-1] if found else 0, k - _NEIGHBOURS) : k].tolist())
        after = sorted(time_us[k : k + _NEIGHBOURS].tolist())
        half = len(after) // 2
        median = after[half] if len(after) % 2 else (after[half - 1] + after[half]) / 2
        # the lower median: one false time among few must not look like a fall
        if median < before[(len(before) - 1) // 2] - MIN_RESTART_US and not _written_late(
            time_us, found[-1] if found else 0, k
        ):
            found.append(k)
            if len(found) == MAX_BOOTS - 1:
                break
    return found


def _written_late(time_us: NDArray[np.int64], begin: int, k: int) -> bool:
    """Whether the times from ``k`` on are old ones, in a boot that begins at ``begin``, and the clock goes on behind.

    It then jumps to where it was before the fall. A new boot counts on from its own start, where no record of the
    old one was late.
    """
    if int(time_us[k]) < int(time_us[begin]) + MAX_DEVIATION_US:
        return False
    before = int(np.median(time_us[max(begin, k - _NEIGHBOURS) : k]))
    some = time_us[k : k + MAX_LATE_RECORDS + _NEIGHBOURS]
    jumps = (np.diff(some[: MAX_LATE_RECORDS + 1]) > MIN_RESTART_US).nonzero()[0] + 1
    return any(abs(float(np.median(some[j : j + _NEIGHBOURS])) - before) <= MAX_DEVIATION_US for j in jumps.tolist())


def false_times(time_us: NDArray[np.int64]) -> NDArray[np.int64]:
    """The indices of the times in file order that those around them contradict.

    Impossible ones (negative, beyond :data:`LAST_TIME_US`); and up to :data:`LONGEST_FALSE` in a row that are further
    than :data:`FALSE_TIME_US` from the record before and the one behind, while these two agree. A clock that jumps
    and goes on from there is no contradiction: a pause, or a restart. Beside the beginning and the end stand no two
    neighbours; there a few times are false that are further from the rest than any pause.
    """
    if len(time_us) == 0:
        return np.zeros(0, np.int64)
    impossible, possible = np.zeros(0, np.int64), None
    if int(time_us.min()) < 0 or int(time_us.max()) > LAST_TIME_US:
        impossible = ((time_us < 0) | (time_us > LAST_TIME_US)).nonzero()[0]
    if len(impossible):
        possible = np.delete(np.arange(len(time_us)), impossible)
        time_us = time_us[possible]
    edges = _step_indices(time_us, -MAX_DEVIATION_US, MAX_DEVIATION_US)
    if not 0 < len(edges) <= len(time_us) * MAX_STEP_SHARE:
        return impossible
    starts, ends = [0, *edges.tolist()], [*edges.tolist(), len(time_us)]
    false = _contradicted_runs(starts, time_us[starts].tolist(), time_us[np.array(ends) - 1].tolist(), len(time_us))
    found = np.concatenate([np.zeros(0, np.int64), *(np.arange(starts[k], ends[k]) for k in false)])
    return np.sort(np.concatenate([impossible, found if possible is None else possible[found]]))


def _step_indices(time_us: NDArray[np.int64], least: int, most: int) -> NDArray[np.int64]:
    """The indices of times that differ from the one before by less than ``least`` or more than ``most``."""
    found = [np.zeros(0, np.int64)]
    for begin in range(0, len(time_us) - 1, _CHUNK):
        some = time_us[begin : begin + _CHUNK + 1]
        change = some[1:] - some[:-1]  # stays in the processor's cache
        if int(change.min()) < least or int(change.max()) > most:
            found.append(((change < least) | (change > most)).nonzero()[0] + (begin + 1))
    return np.concatenate(found)


def _contradicted_runs(starts: list[int], first: list[int], last: list[int], size: int) -> list[int]:
    """Which runs of times without steps are false, by their beginnings and their first and last times."""
    beyond_pauses, n = int(MAX_TIME_JUMP_S * 1e6), len(starts)
    false = [0] if starts[1] < MIN_END_RECORDS and abs(first[1] - last[0]) > beyond_pauses else []
    k = len(false) + 1
    before = last[k - 1]
    while k < n:
        # does the clock come back to where it was, within a few records?
        back = k
        while back < n and starts[back] - starts[k] <= MAX_FALSE_RECORDS and back - k <= MAX_FALSE_RUNS:
            if abs(first[back] - before) <= MAX_DEVIATION_US:
                break
            back += 1
        else:
            back = k
        false.extend(range(k, back))
        before, k = last[back], back + 1
    if size - starts[-1] < MIN_END_RECORDS and n - 1 not in false[-1:] and abs(first[-1] - last[-2]) > beyond_pauses:
        false.append(n - 1)
    return false


def merge_timelines(timelines: Iterable[tuple[NDArray[np.int64], NDArray[np.int64]]]) -> Timeline:
    """Offsets and times of several messages as one timeline."""
    at, time = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for offsets, times in timelines:
        at.append(offsets)
        time.append(times)
    offsets = np.concatenate(at)
    order = np.argsort(offsets, kind="stable")
    return offsets[order], np.concatenate(time)[order]


def boots_at(edges: Iterable[int], size: int) -> list[Boot]:
    """The power-ups of a file of ``size`` bytes in which others than the first begin at ``edges``, ascending."""
    return [Boot(a, b) for a, b in pairwise([0, *edges, size])]


def boots_of_timeline(timeline: Timeline, size: int) -> list[Boot]:
    """The power-ups of a file, each from the first record after a restart of the clock."""
    at, time = timeline
    return boots_at(at[restarts(time)].tolist(), size)


def times_before(at: NDArray[np.int64], timeline: Timeline) -> list[int | None]:
    """For each byte offset the time of the last record before it, None if there is none."""
    offsets, time_us = timeline
    k = np.searchsorted(offsets, at) - 1
    if len(time_us) == 0:
        return [None] * len(at)
    return [t if i >= 0 else None for i, t in zip(k.tolist(), time_us[k].tolist(), strict=True)]
