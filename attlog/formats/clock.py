"""Boot clocks, from the times of the records in file order: where one starts anew, what time it was at a byte."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Boot
from attlog.formats.mapping import Offsets

Timeline = tuple[Offsets, NDArray[np.int64]]
"""Byte offsets of records that carry their time, ascending, and the times (us)."""

STEP_US = 1_000_000
"""A clock that falls further was restarted; tasks log each other's times out of order by under 0.1 s."""

_NEIGHBOURS = 20  # records on either side whose medians must agree that the clock fell


def restarts(time_us: NDArray[np.int64]) -> list[int]:
    """The indices of the first records after a restart of the clock.

    A single record with a false time is no restart: the medians of the
    neighbours on both sides decide.
    """
    found: list[int] = []
    for k in (np.flatnonzero(np.diff(time_us) < -STEP_US) + 1).tolist():
        before = time_us[max(found[-1] if found else 0, k - _NEIGHBOURS) : k]
        after = time_us[k : k + _NEIGHBOURS]
        # the lower median: one false time among few must not look like a fall
        if np.median(after) < np.sort(before)[(len(before) - 1) // 2] - STEP_US:
            found.append(k)
    return found


def in_file_order(timelines: Iterable[tuple[NDArray[np.int64], NDArray[np.int64]]]) -> Timeline:
    """Offsets and times of several messages as one timeline."""
    at, time = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for offsets, times in timelines:
        at.append(offsets)
        time.append(times)
    offsets = np.concatenate(at)
    order = np.argsort(offsets, kind="stable")
    return offsets[order], np.concatenate(time)[order]


def boots_between(edges: Iterable[int], size: int) -> list[Boot]:
    """The power-ups of a file of ``size`` bytes in which others than the first begin at ``edges``, ascending."""
    return [Boot(a, b) for a, b in pairwise([0, *edges, size])]


def boots(timeline: Timeline, size: int) -> list[Boot]:
    """The power-ups of a file, each from the first record after a restart of the clock."""
    at, time = timeline
    return boots_between(at[restarts(time)].tolist(), size)


def times_before(at: NDArray[np.int64], timeline: Timeline) -> list[int | None]:
    """For each byte offset the time of the last record before it, None if there is none."""
    offsets, time_us = timeline
    k = np.searchsorted(offsets, at) - 1
    if len(time_us) == 0:
        return [None] * len(at)
    return [t if i >= 0 else None for i, t in zip(k.tolist(), time_us[k].tolist(), strict=True)]
