"""Detect gaps, clock restarts and false time stamps in a log.

Stamps are int64 microseconds of the autopilot's boot clock until the zero of the log is known: float seconds of a
Unix clock would lose the microseconds.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.limits import LAST_TIME_US, MAX_BOOTS, MAX_TIME_JUMP_S
from attlog.core.sorting import median

Stamps = NDArray[np.int64]
Offsets = NDArray[np.signedinteger[Any]]
Timeline = tuple[Offsets, Stamps]  # byte offsets of records that carry their time, ascending, and the times (us)
IsolationTest = Callable[[Stamps], NDArray[np.bool_]]  # True where no other message has a record near the time

# A gap is longer than five median intervals and than 50 ms, for streams, filters and metrics (docs/metrics.md).
GAP_MEDIANS, MIN_GAP_S = 5.0, 0.05
# Filters integrate across gaps up to this length and restart behind longer ones.
MAX_BRIDGED_GAP_S = 0.5

MAX_JUMP_US = int(MAX_TIME_JUMP_S * 1e6)

# A clock that falls further was restarted; tasks log each other's times out of order by under 0.1 s.
MIN_RESTART_US = 1_000_000
# A time is false if it is further than this from the records before and after it, which agree with each other.
# Deviations in undamaged logs stay below 0.1 s.
MAX_DEVIATION_US = 5_000_000
# Longest run of records with false times (damaged sector, torn write). A longer run is another clock or boot.
MAX_FALSE_RECORDS = 64
# Longest run of records that a task may write late.
MAX_LATE_RECORDS = 256
# Limit of adjacent runs with different false times.
MAX_FALSE_RUNS = 8
# Fewer records than this at either end of the file can be false although a neighbour on one side is missing.
MIN_END_RECORDS = 3
# With a larger share of steps among all times the clock is too irregular to identify false times.
MAX_STEP_SHARE = 0.25
_CHUNK = 1 << 14  # stays in the processor's cache
_NEIGHBOURS = 20  # records on either side whose medians must agree that the clock fell

# Gap (10 s) that separates isolated records from the rest of their message.
ISOLATED_US = 10_000_000
# A repeated value is kept once per second.
MAX_REPEAT_US = 1_000_000
# Number of zero stamps from which they count as unset.
MIN_UNSET = 3


# Gaps.


def gap_limit(usual_s: float) -> float:
    """Return the longest interval in s that is no gap."""
    return max(GAP_MEDIANS * usual_s, MIN_GAP_S)


def gap_limit_of_times(t: NDArray[np.float64]) -> float:
    """Return the gap limit for times (n,), by their median interval.

    MIN_GAP_S without positive intervals.
    """
    dt = np.diff(t)
    dt = dt[np.isfinite(dt) & (dt > 0)]
    return gap_limit(float(median(dt))) if len(dt) else MIN_GAP_S


def gap_indices(t: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the indices of the samples behind a gap."""
    return np.flatnonzero(np.diff(t) > gap_limit_of_times(t)) + 1 if len(t) > 2 else np.zeros(0, np.int64)


# Plausible records of one message.


def longest_rising(t: NDArray[Any]) -> NDArray[np.int64]:
    """Return the indices of the longest strictly rising subsequence.

    Patience sorting, n log n.
    """
    if len(t) < 2 or bool(np.all(np.diff(t) > 0)):
        return np.arange(len(t))
    tails: list[float] = []  # smallest last value of a rising subsequence of each length
    at: list[int] = []
    before: list[int] = []
    for i, value in enumerate(t.tolist()):
        k = len(tails) if not tails or value > tails[-1] else bisect_left(tails, value)
        before.append(at[k - 1] if k else -1)
        if k == len(tails):
            tails.append(value)
            at.append(i)
        else:
            tails[k], at[k] = value, i
    chain = np.empty(len(at), np.int64)
    i = at[-1]
    for k in range(len(at) - 1, -1, -1):
        chain[k] = i
        i = before[i]
    return chain


@dataclass(frozen=True, slots=True)
class ValidRecords:
    """Records with plausible stamps, and counts of the others by cause."""

    index: NDArray[np.int64]
    duplicates: int = 0
    backward: int = 0
    false: int = 0
    unset: int = 0

    @property
    def dropped(self) -> int:
        """Number of records left out."""
        return self.duplicates + self.backward + self.false + self.unset


def plausible_records(t_us: Stamps, alone: IsolationTest | None = None, whole: Stamps | None = None) -> ValidRecords:
    """Select the records (n,) with strictly rising and plausible stamps.

    Duplicates repeat an earlier stamp (two tasks log one message). Several zero stamps are unset. Backward steps are
    resolved by the longest rising subsequence, so one false late time does not remove the good records behind it.
    Records half a day from the largest group are false. So are short groups between gaps of ISOLATED_US, if ``alone``
    is True at their ends. ``whole``: stamps of the message including records rejected earlier for their values.
    """
    t = np.asarray(t_us, np.int64)
    if len(t) == 0:
        return ValidRecords(np.zeros(0, np.int64))
    unset = int(np.count_nonzero(t == 0))
    if unset < MIN_UNSET:
        unset = 0
    index = np.flatnonzero((t >= (1 if unset else 0)) & (t <= LAST_TIME_US))
    index = index[_within_half_a_day(t[index])]
    false = len(t) - len(index) - unset
    duplicates = backward = 0
    steps = np.diff(t[index])
    if (steps <= 0).any():
        keep = np.concatenate([[True], steps != 0])
        duplicates += int((~keep).sum())
        index = index[keep]
        if (np.diff(t[index]) <= 0).any():
            chain = longest_rising(t[index])
            lost = np.delete(index, chain)
            index = index[chain]
            # equal to a kept stamp: duplicate
            near = index[np.minimum(np.searchsorted(t[index], t[lost]), len(index) - 1)]
            again = int((t[near] == t[lost]).sum())
            duplicates += again
            backward += len(lost) - again
    lone = np.zeros(0, np.int64) if alone is None else _isolated(t[index], alone, t if whole is None else whole)
    return ValidRecords(np.delete(index, lone), duplicates, backward, false + len(lone), unset)


def _within_half_a_day(t: Stamps) -> NDArray[np.int64]:
    """Return the indices of the largest group of times without a gap of half a day."""
    if len(t) == 0 or int(t.max()) - int(t.min()) <= MAX_JUMP_US:
        return np.arange(len(t))
    order = np.argsort(t, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(t[order]) > MAX_JUMP_US) + 1)
    return np.sort(max(groups, key=len))


def _isolated(t: Stamps, alone: IsolationTest, whole: Stamps) -> NDArray[np.int64]:
    """Return the indices of short groups between gaps while no other message is logged."""
    cuts = np.flatnonzero(np.diff(t) > ISOLATED_US) + 1
    edges = np.concatenate([[0], cuts, [len(t)]])
    sizes = np.diff(edges)
    few = np.flatnonzero(sizes <= min(MAX_FALSE_RECORDS, int(sizes.max()) - 1))
    if len(few) == 0 or sizes.max() < 3:  # no gap, or a slow message
        return np.zeros(0, np.int64)
    first, last = t[edges[few]], t[edges[few + 1] - 1]
    # records of this message that were rejected for their values also close a gap
    every = np.sort(whole)
    beside = np.searchsorted(every, last + ISOLATED_US, side="right") - np.searchsorted(every, first - ISOLATED_US)
    false = few[(beside <= sizes[few]) & alone(first) & alone(last)]
    return np.concatenate([np.zeros(0, np.int64), *(np.arange(edges[k], edges[k + 1]) for k in false)])


def changed_records(x: NDArray[np.float64], t_us: Stamps) -> NDArray[np.bool_]:
    """Select records (n,) with a new measurement of a slow sensor.

    ``x`` (n,) or (n, k). An equal value may be a new measurement, so one repetition per second is kept.
    """
    new = np.ones(len(t_us), bool)
    if len(t_us) > 1:
        t = np.asarray(t_us, np.int64)
        changed = np.diff(np.asarray(x).reshape(len(t), -1), axis=0) != 0
        new[1:] = changed.any(axis=1)
        since = t - t[np.maximum.accumulate(np.where(new, np.arange(len(t)), 0))]
        new[1:] |= since[1:] // MAX_REPEAT_US > since[:-1] // MAX_REPEAT_US
    return new


# Plausible times of formats without checksums.


def is_near(t_us: int | None, recent: Iterable[int | None]) -> bool:
    """Return whether a time is within half a day of a recent one, True if either is unknown."""
    before = [t for t in recent if t is not None]
    return t_us is None or not before or min(abs(t_us - t) for t in before) < MAX_JUMP_US


def rise_nearby(t_us: NDArray[Any]) -> bool:
    """Return whether times (n,) never fall and span less than half a day."""
    t = t_us.astype(np.float64)
    return bool((np.diff(t) >= 0).all() and t[-1] - t[0] < MAX_JUMP_US)


def far_from_median(t_us: NDArray[Any]) -> NDArray[np.bool_]:
    """Select the times (n,) more than half a day from the median."""
    t = t_us.astype(np.float64)
    far: NDArray[np.bool_] = np.abs(t - median(t)) > MAX_JUMP_US
    return far


# A whole log: the times of all records in file order.


def restarts(time_us: Stamps) -> list[int]:
    """Return the indices of the first records after a restart.

    Returns at most MAX_BOOTS - 1. The medians of the neighbours on both sides are compared, so one false time is no
    restart. Neither is a block of records that a task wrote late: behind it the clock returns to its earlier value.
    """
    found: list[int] = []
    for k in _step_indices(time_us, -MIN_RESTART_US, np.iinfo(np.int64).max).tolist():
        boot = found[-1] if found else 0
        before = sorted(time_us[max(boot, k - _NEIGHBOURS) : k].tolist())
        after = sorted(time_us[k : k + _NEIGHBOURS].tolist())
        half = len(after) // 2
        median = after[half] if len(after) % 2 else (after[half - 1] + after[half]) / 2
        # lower median, so that one false time among few is no fall
        fell = median < before[(len(before) - 1) // 2] - MIN_RESTART_US
        if fell and not _written_late(time_us, boot, k):
            found.append(k)
            if len(found) == MAX_BOOTS - 1:
                break
    return found


def _written_late(time_us: Stamps, begin: int, k: int) -> bool:
    """Return whether the records from ``k`` on were written late within their boot.

    Behind late records the clock returns to its value before the fall; after a restart it continues from its new start.
    """
    if int(time_us[k]) < int(time_us[begin]) + MAX_DEVIATION_US:
        return False
    before = int(median(time_us[max(begin, k - _NEIGHBOURS) : k]))
    some = time_us[k : k + MAX_LATE_RECORDS + _NEIGHBOURS]
    jumps = (np.diff(some[: MAX_LATE_RECORDS + 1]) > MIN_RESTART_US).nonzero()[0] + 1
    return any(abs(float(median(some[j : j + _NEIGHBOURS])) - before) <= MAX_DEVIATION_US for j in jumps.tolist())


def false_times(time_us: Stamps) -> NDArray[np.int64]:
    """Return the indices of impossible times and of times that their neighbours contradict.

    A run of up to MAX_FALSE_RECORDS is false if it is further than MAX_DEVIATION_US from the records before and behind
    it, and these agree. A clock that jumps and continues from there is a pause or a restart. Fewer than
    MIN_END_RECORDS at either end of the file are false if they are more than half a day from their only neighbour.
    """
    if len(time_us) == 0:
        return np.zeros(0, np.int64)
    impossible, possible = np.zeros(0, np.int64), None
    if int(time_us.min()) < 0 or int(time_us.max()) > LAST_TIME_US:
        impossible = ((time_us < 0) | (time_us > LAST_TIME_US)).nonzero()[0]
        possible = np.delete(np.arange(len(time_us)), impossible)
        time_us = time_us[possible]
    edges = _step_indices(time_us, -MAX_DEVIATION_US, MAX_DEVIATION_US)
    if not 0 < len(edges) <= len(time_us) * MAX_STEP_SHARE:
        return impossible
    starts, ends = [0, *edges.tolist()], [*edges.tolist(), len(time_us)]
    false = _contradicted_runs(starts, time_us[starts].tolist(), time_us[np.array(ends) - 1].tolist(), len(time_us))
    found = np.concatenate([np.zeros(0, np.int64), *(np.arange(starts[k], ends[k]) for k in false)])
    return np.sort(np.concatenate([impossible, found if possible is None else possible[found]]))


def _step_indices(time_us: Stamps, least: int, most: int) -> NDArray[np.int64]:
    """Return indices of times with a change outside the limits."""
    found = [np.zeros(0, np.int64)]
    for begin in range(0, len(time_us) - 1, _CHUNK):
        some = time_us[begin : begin + _CHUNK + 1]
        change = some[1:] - some[:-1]
        if int(change.min()) < least or int(change.max()) > most:
            found.append(((change < least) | (change > most)).nonzero()[0] + (begin + 1))
    return np.concatenate(found)


def _contradicted_runs(starts: list[int], first: list[int], last: list[int], size: int) -> list[int]:
    """Return the indices of false runs; runs are separated by steps of the clock."""
    n = len(starts)
    false = [0] if starts[1] < MIN_END_RECORDS and abs(first[1] - last[0]) > MAX_JUMP_US else []
    k = len(false) + 1
    before = last[k - 1]
    while k < n:
        # search for the run at which the clock returns to its earlier value
        back = k
        while back < n and starts[back] - starts[k] <= MAX_FALSE_RECORDS and back - k <= MAX_FALSE_RUNS:
            if abs(first[back] - before) <= MAX_DEVIATION_US:
                break
            back += 1
        else:
            back = k
        false.extend(range(k, back))
        before, k = last[back], back + 1
    if size - starts[-1] < MIN_END_RECORDS and n - 1 not in false[-1:] and abs(first[-1] - last[-2]) > MAX_JUMP_US:
        false.append(n - 1)
    return false


def merge_timelines(timelines: Iterable[Timeline]) -> Timeline:
    """Merge timelines in file order."""
    at, time = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for offsets, times in timelines:
        at.append(offsets)
        time.append(times)
    joined = np.concatenate(at)
    order = np.argsort(joined, kind="stable")
    return joined[order], np.concatenate(time)[order]


def times_before(at: Offsets, timeline: Timeline) -> list[int | None]:
    """Return the last time before each byte offset, None without one."""
    offsets, time_us = timeline
    if len(time_us) == 0:
        return [None] * len(at)
    k = np.searchsorted(offsets, at) - 1
    return [t if i >= 0 else None for i, t in zip(k.tolist(), time_us[k].tolist(), strict=True)]
