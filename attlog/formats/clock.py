"""Where a boot clock starts anew, from the times of the records in file order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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


def times_before(at: NDArray[np.int64], offsets: NDArray[np.int64], time_us: NDArray[np.int64]) -> list[int | None]:
    """For each byte offset the time of the last record before it, None if there is none."""
    k = np.searchsorted(offsets, at) - 1
    if len(time_us) == 0:
        return [None] * len(at)
    return [t if i >= 0 else None for i, t in zip(k.tolist(), time_us[k].tolist(), strict=True)]
