"""How an attitude answers a movement: when it settles, how far it overshoots, how soon it rises, where it spikes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def settling_s(t: Array, error: Array, since: float, within: float) -> float:
    """Seconds from ``since`` until |error| (n,) stays ``within`` for good; NaN if it never does."""
    late = t >= since
    beyond = np.flatnonzero(late & ~(np.abs(error) <= within))
    if not late.any() or (len(beyond) and beyond[-1] == len(t) - 1):
        return float("nan")
    return float(t[beyond[-1] + 1] - since) if len(beyond) else 0.0


def overshoot(t: Array, y: Array, since: float, begin: float, end: float) -> float:
    """How far ``y`` (n,) goes beyond ``end`` after ``since``, coming from ``begin``, in the unit of ``y``."""
    beyond = (y[t >= since] - end) * np.sign(end - begin)
    return max(0.0, float(np.nanmax(beyond))) if len(beyond) else float("nan")


def crossing_s(t: Array, y: Array, since: float, begin: float, end: float, share: float) -> float:
    """When ``y`` (n,) first has gone ``share`` of the way from ``begin`` to ``end`` after ``since``; NaN if never."""
    gone = (y - begin) / (end - begin)
    hit = np.flatnonzero((t >= since) & (gone >= share))
    if not len(hit):
        return float("nan")
    k = int(hit[0])
    if k == 0 or not gone[k] > gone[k - 1]:
        return float(t[k])
    return float(t[k] - (t[k] - t[k - 1]) * min(1.0, (gone[k] - share) / (gone[k] - gone[k - 1])))


def rise_s(t: Array, y: Array, since: float, begin: float, end: float) -> float:
    """Seconds from 10 to 90 % of the way from ``begin`` to ``end``; NaN if it does not get there."""
    return crossing_s(t, y, since, begin, end, 0.9) - crossing_s(t, y, since, begin, end, 0.1)


def excursions(t: Array, error: Array, within_s: float = 2.0, step_s: float = 0.04) -> tuple[Array, Array]:
    """What is quick in an error (n, k): its distance from its own running median over ``within_s``, every ``step_s``.

    Times (m,) and distances (m, k); half a window at both ends is left out.
    """
    every = max(1, round(step_s * (len(t) - 1) / float(t[-1] - t[0])))
    t, error = t[::every], error[::every]
    half = max(1, round(0.5 * within_s / float(np.median(np.diff(t)))))
    windows = np.lib.stride_tricks.sliding_window_view(error, 2 * half + 1, axis=0)
    return t[half : len(t) - half], error[half : len(t) - half] - np.median(windows, axis=-1)


def spikes(t: Array, error: Array, threshold: float, apart_s: float = 0.5) -> tuple[int, float]:
    """How many times |error| (n,) rises beyond a threshold, and its peak.

    Excursions less than ``apart_s`` after one another count once.
    """
    over = np.flatnonzero(np.abs(error) > threshold)
    count = 0 if not len(over) else 1 + int(np.sum(np.diff(t[over]) > apart_s))
    return count, float(np.nanmax(np.abs(error)))


def spread(t: Array, y: Array) -> float:
    """The standard deviation of ``y`` (n,) about its straight line."""
    line = np.polynomial.Polynomial.fit(t, y, 1)
    return float(np.std(y - line(t), ddof=2))
