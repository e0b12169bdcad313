"""Judge time stamps: gaps, restarts of a clock, and times that the records around them contradict.

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
# A time further than this from both sides, which agree, is false; no undamaged log has one beyond 0.1 s.
MAX_DEVIATION_US = 5_000_000
# Records in a row that can be false: a damaged sector or a torn write. More are another clock or boot.
MAX_FALSE_RECORDS = 64
# Records in a row that a task may write late.
MAX_LATE_RECORDS = 256
# Adjacent runs with different false times that are searched through.
MAX_FALSE_RUNS = 8
# Fewer records than this at an end of the file may be false without a neighbour on the other side.
MIN_END_RECORDS = 3
# Above this share of steps among all times no clock is left that could contradict one.
MAX_STEP_SHARE = 0.25
_CHUNK = 1 << 14  # stays in the processor's cache
_NEIGHBOURS = 20  # records on either side whose medians must agree that the clock fell

# A gap that isolates records from the others of their message.
ISOLATED_US = 10_000_000
# A repeated value is kept once in this time.
MAX_REPEAT_US = 1_000_000
# From this number on stamps of 0 were never set and carry neither order nor duration.
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
    return gap_limit(float(np.median(dt))) if len(dt) else MIN_GAP_S


def gap_indices(t: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the indices of the samples behind a gap."""
    return np.flatnonzero(np.diff(t) > gap_limit_of_times(t)) + 1 if len(t) > 2 else np.zeros(0, np.int64)


# One message: which of its records have a plausible time.


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
    """Select the records (n,) whose stamps rise strictly and are not contradicted.

    Later records with an equal stamp are duplicates (two tasks log one message); several of 0 are unset. Of stamps that
    go back the longest rising subsequence stays, so that one false late time does not remove the good records behind
    it. Records half a day from most others are false. So are a few behind a gap where ``alone`` is True; after a pause
    of the whole log they stay. ``whole``: the stamps of the message including records that are already left out.
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
            # equal to a kept one: the same record twice
            near = index[np.minimum(np.searchsorted(t[index], t[lost]), len(index) - 1)]
            again = int((t[near] == t[lost]).sum())
            duplicates += again
            backward += len(lost) - again
    lone = np.zeros(0, np.int64) if alone is None else _isolated(t[index], alone, t if whole is None else whole)
    return ValidRecords(np.delete(index, lone), duplicates, backward, false + len(lone), unset)


def _within_half_a_day(t: Stamps) -> NDArray[np.int64]:
    """Return the largest group of times without half a day between."""
    if len(t) == 0 or int(t.max()) - int(t.min()) <= MAX_JUMP_US:
        return np.arange(len(t))
    order = np.argsort(t, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(t[order]) > MAX_JUMP_US) + 1)
    return np.sort(max(groups, key=len))


def _isolated(t: Stamps, alone: IsolationTest, whole: Stamps) -> NDArray[np.int64]:
    """Return positions of few times behind a gap without company."""
    cuts = np.flatnonzero(np.diff(t) > ISOLATED_US) + 1
    edges = np.concatenate([[0], cuts, [len(t)]])
    sizes = np.diff(edges)
    few = np.flatnonzero(sizes <= min(MAX_FALSE_RECORDS, int(sizes.max()) - 1))
    if len(few) == 0 or sizes.max() < 3:  # no gap, or a slow message
        return np.zeros(0, np.int64)
    first, last = t[edges[few]], t[edges[few + 1] - 1]
    # records of the same message beside them that were left out for their values: no gap
    every = np.sort(whole)
    beside = np.searchsorted(every, last + ISOLATED_US, side="right") - np.searchsorted(every, first - ISOLATED_US)
    false = few[(beside <= sizes[few]) & alone(first) & alone(last)]
    return np.concatenate([np.zeros(0, np.int64), *(np.arange(edges[k], edges[k + 1]) for k in false)])


def changed_records(x: NDArray[np.float64], t_us: Stamps) -> NDArray[np.bool_]:
    """Select records (n,) with a new measurement of a slow sensor.

    ``x`` (n,) or (n, k). An unchanged value may be measured anew, so one record of each second stays.
    """
    new = np.ones(len(t_us), bool)
    if len(t_us) > 1:
        t = np.asarray(t_us, np.int64)
        changed = np.diff(np.asarray(x).reshape(len(t), -1), axis=0) != 0
        new[1:] = changed.any(axis=1)
        since = t - t[np.maximum.accumulate(np.where(new, np.arange(len(t)), 0))]
        new[1:] |= since[1:] // MAX_REPEAT_US > since[:-1] // MAX_REPEAT_US
    return new


# A message without checksums: are its times near each other?


def is_near(t_us: int | None, recent: Iterable[int | None]) -> bool:
    """Return whether a time is within half a day of a recent one.

    Also where no time is known.
    """
    before = [t for t in recent if t is not None]
    return t_us is None or not before or min(abs(t_us - t) for t in before) < MAX_JUMP_US


def rise_nearby(t_us: NDArray[Any]) -> bool:
    """Return whether times (n,) never fall and span less than half a day."""
    t = t_us.astype(np.float64)
    return bool((np.diff(t) >= 0).all() and t[-1] - t[0] < MAX_JUMP_US)


def far_from_median(t_us: NDArray[Any]) -> NDArray[np.bool_]:
    """Select the times (n,) more than half a day from the median."""
    t = t_us.astype(np.float64)
    far: NDArray[np.bool_] = np.abs(t - np.median(t)) > MAX_JUMP_US
    return far


# A whole log: the times of all records in file order.


def restarts(time_us: Stamps) -> list[int]:
    """Return the indices of the first records after a restart.

    At most MAX_BOOTS - 1. One false time is no restart: the medians of the neighbours on both sides decide. Nor are
    records that a task wrote late with the times at which it should have: the clock comes back behind them.
    """
    found: list[int] = []
    for k in _step_indices(time_us, -MIN_RESTART_US, np.iinfo(np.int64).max).tolist():
        boot = found[-1] if found else 0
        before = sorted(time_us[max(boot, k - _NEIGHBOURS) : k].tolist())
        after = sorted(time_us[k : k + _NEIGHBOURS].tolist())
        half = len(after) // 2
        median = after[half] if len(after) % 2 else (after[half - 1] + after[half]) / 2
        # the lower median: one false time among few must not look like a fall
        fell = median < before[(len(before) - 1) // 2] - MIN_RESTART_US
        if fell and not _written_late(time_us, boot, k):
            found.append(k)
            if len(found) == MAX_BOOTS - 1:
                break
    return found


def _written_late(time_us: Stamps, begin: int, k: int) -> bool:
    """Return whether times from ``k`` on are old ones of their boot.

    The clock then jumps back to where it was before the fall. A new boot counts on from its own start, when no record
    of the old one was late.
    """
    if int(time_us[k]) < int(time_us[begin]) + MAX_DEVIATION_US:
        return False
    before = int(np.median(time_us[max(begin, k - _NEIGHBOURS) : k]))
    some = time_us[k : k + MAX_LATE_RECORDS + _NEIGHBOURS]
    jumps = (np.diff(some[: MAX_LATE_RECORDS + 1]) > MIN_RESTART_US).nonzero()[0] + 1
    return any(abs(float(np.median(some[j : j + _NEIGHBOURS])) - before) <= MAX_DEVIATION_US for j in jumps.tolist())


def false_times(time_us: Stamps) -> NDArray[np.int64]:
    """Return the indices of impossible and contradicted times.

    Contradicted are up to MAX_FALSE_RECORDS in a row further than MAX_DEVIATION_US from the record before and the one
    behind, which agree. A clock that jumps and goes on from there is a pause or a restart. At the ends of the file,
    where one neighbour is missing, a few times are false that are further from the rest than any pause.
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
    """Return the false runs among runs of times without steps."""
    n = len(starts)
    false = [0] if starts[1] < MIN_END_RECORDS and abs(first[1] - last[0]) > MAX_JUMP_US else []
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
    if size - starts[-1] < MIN_END_RECORDS and n - 1 not in false[-1:] and abs(first[-1] - last[-2]) > MAX_JUMP_US:
        false.append(n - 1)
    return false


def merge_timelines(timelines: Iterable[Timeline]) -> Timeline:
    """Return several timelines as one in file order."""
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
