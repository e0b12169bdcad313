"""Which records of a message have a plausible time.

Stamps stay int64 microseconds of the autopilot's boot clock until the zero of the
log is known: float seconds of a Unix-epoch clock would lose the microseconds.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import gap
from attlog.base.limits import MAX_TIME_JUMP_S
from attlog.flight import physics
from attlog.formats.base import Table

Stamps = NDArray[np.int64]
LATEST_US = int(physics.CLOCK_US.high)

ISOLATED_US = 10_000_000
"""A gap that sets records apart from the others of their message."""
ISOLATED_MOST = 64
"""Records in a row that may be false: what a torn write or a damaged sector changes."""
HELD_US = 1_000_000
"""A repeated value is kept once in this time."""
UNSET = 3
"""So many stamps of 0 were never set: they tell no order and no duration."""


def stamps_of(table: Table, column: str, us: int = 1) -> Stamps:
    """A column of times in units of ``us`` microseconds as stamps (n,); what is no time is negative.

    ValueError where the log's own definitions make text, or several numbers per record, of it.
    """
    told = table[column]
    if told.ndim != 1 or told.dtype.kind not in "iuf":
        raise ValueError(f"{table.name}.{column} is no time")
    if told.dtype.kind == "f":  # no integer means "not a number", and what a cast makes of it differs by processor
        told = np.where((told >= 0) & (told <= LATEST_US), told, -1)
    stamps: Stamps = told.astype(np.int64)
    if us != 1:
        stamps = np.where((stamps >= 0) & (stamps <= LATEST_US // us), stamps * us, -1)
    return stamps


def on_a_clock(t_us: int) -> int:
    """A stamp in us, 0 where it is none."""
    return int(t_us) if 0 <= t_us <= LATEST_US else 0


Alone = Callable[[Stamps], NDArray[np.bool_]]
"""For each time whether nothing else in the log has a record near it."""


@dataclass(frozen=True, slots=True)
class ValidRecords:
    """``index`` (k,) of the records with strictly rising, plausible stamps, and why the others went."""

    index: NDArray[np.int64]
    duplicates: int = 0
    backward: int = 0
    false: int = 0
    unset: int = 0

    @property
    def dropped(self) -> int:
        """All records left out."""
        return self.duplicates + self.backward + self.false + self.unset


def plausible(t_us: Stamps, alone: Alone | None = None, whole: Stamps | None = None) -> ValidRecords:
    """The records (n,) whose stamps rise strictly and are contradicted by nothing.

    Later records with an equal stamp are duplicates (two tasks log one message), several of 0 are unset.
    Of stamps that go back, the longest rising subsequence stays, so that one record
    with a false late time does not take the good ones after it with it. Records half a
    day from most others are false. So are a few behind a gap at whose times, says
    ``alone``, nothing else was logged; after a pause of the whole log they stay.
    ``whole``: the stamps of the message with those records that are left out already.
    """
    t = np.asarray(t_us, np.int64)
    if len(t) == 0:
        return ValidRecords(np.zeros(0, np.int64))
    unset = int(np.count_nonzero(t == 0))
    if unset < UNSET:
        unset = 0
    index = np.flatnonzero((t >= (1 if unset else 0)) & (t <= LATEST_US))
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
    lone = np.zeros(0, np.int64) if alone is None else _contradicted(t[index], alone, t if whole is None else whole)
    return ValidRecords(np.delete(index, lone), duplicates, backward, false + len(lone), unset)


def _within_half_a_day(t: Stamps) -> NDArray[np.int64]:
    """The positions of the largest group of times in which none is further than that from the next."""
    jump = int(MAX_TIME_JUMP_S * 1e6)
    if len(t) == 0 or int(t.max()) - int(t.min()) <= jump:
        return np.arange(len(t))
    order = np.argsort(t, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(t[order]) > jump) + 1)
    return np.sort(max(groups, key=len))


def longest_rising(t: Stamps) -> NDArray[np.int64]:
    """Indices of the longest strictly rising subsequence (patience sorting, n log n)."""
    tails: list[int] = []  # smallest last value of a rising subsequence of each length
    at: list[int] = []
    before: list[int] = []
    highest = -1
    for i, value in enumerate(t.tolist()):
        if value > highest or not tails:  # nearly always: the next value continues the longest one
            before.append(at[-1] if at else -1)
            tails.append(value)
            at.append(i)
            highest = value
            continue
        k = bisect_left(tails, value)
        before.append(at[k - 1] if k else -1)
        tails[k] = value
        at[k] = i
        highest = tails[-1]
    chain = np.empty(len(at), np.int64)
    i = at[-1]
    for k in range(len(at) - 1, -1, -1):
        chain[k] = i
        i = before[i]
    return chain


def _contradicted(t: Stamps, alone: Alone, whole: Stamps) -> NDArray[np.int64]:
    """The positions among rising times (n,) of the few that a gap sets apart and that have nothing else beside it."""
    cuts = np.flatnonzero(np.diff(t) > ISOLATED_US) + 1
    edges = np.concatenate([[0], cuts, [len(t)]])
    sizes = np.diff(edges)
    few = np.flatnonzero(sizes <= min(ISOLATED_MOST, int(sizes.max()) - 1))
    if len(few) == 0 or sizes.max() < 3:  # no gap, or a slow message
        return np.zeros(0, np.int64)
    first, last = t[edges[few]], t[edges[few + 1] - 1]
    # records of the same message beside them that were left out for their values: no gap in truth
    every = np.sort(whole)
    beside = np.searchsorted(every, last + ISOLATED_US, side="right") - np.searchsorted(every, first - ISOLATED_US)
    false = few[(beside <= sizes[few]) & alone(first) & alone(last)]
    return np.concatenate([np.zeros(0, np.int64), *(np.arange(edges[k], edges[k + 1]) for k in false)])


def only_new(x: NDArray[np.float64], t_us: Stamps) -> NDArray[np.bool_]:
    """Which records (n,) hold a new measurement where a slow sensor is repeated at a faster rate.

    ``x`` (n,) or (n, k). A value that does not change may be measured anew: one record
    of each second stays, so that a sensor that stands still is not taken for absent.
    """
    new = np.ones(len(t_us), bool)
    if len(t_us) > 1:
        t = np.asarray(t_us, np.int64)
        changed = np.diff(np.asarray(x).reshape(len(t), -1), axis=0) != 0
        new[1:] = changed.any(axis=1)
        since = t - t[np.maximum.accumulate(np.where(new, np.arange(len(t)), 0))]
        new[1:] |= since[1:] // HELD_US > since[:-1] // HELD_US
    return new


def gaps(t: NDArray[np.float64]) -> NDArray[np.int64]:
    """Indices i where sample i comes after a gap."""
    return np.flatnonzero(np.diff(t) > gap.limit_of(t)) + 1 if len(t) > 2 else np.zeros(0, np.int64)
