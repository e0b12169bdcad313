"""How strongly an accelerometer vibrates, second by second."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Imu
from attlog.segments import gaps
from attlog.segments.spans import Span, inside

Array = NDArray[np.float64]

SMOOTH_S, WINDOW_S = 0.2, 1.0
"""What is faster than a mean over 0.2 s is vibration; its standard deviation is taken over 1 s."""


def levels(imu: Imu, within: list[Span]) -> tuple[Array, Array]:
    """Starts (m,) in s of windows of 1 s inside spans, and the standard deviation (m, 3) of fast force in them."""
    t, acc = imu.acc.t_best, imu.acc.x
    good = np.isfinite(t) & rotation.finite(acc) & inside(t, within)
    t, acc = t[good], acc[good]
    if len(t) < 10:
        return np.zeros(0), np.zeros((0, 3))
    starts, found = [], []
    for part in gaps.slices(np.ones(len(t), bool), gaps.number(t)):
        n = max(3, round(SMOOTH_S * (part.stop - part.start - 1) / max(t[part.stop - 1] - t[part.start], 1e-9)))
        if part.stop - part.start < 3 * n:
            continue
        fast = acc[part] - smooth(acc[part], n)
        window = np.floor((t[part] - t[part.start]) / WINDOW_S).astype(np.int64)
        first = np.flatnonzero(np.diff(window, prepend=-1))
        count = np.diff(np.append(first, len(window)))
        mean = np.add.reduceat(fast**2, first, axis=0) / count[:, None]
        full = count >= 0.8 * np.median(count)
        starts.append(t[part][first][full])
        found.append(np.sqrt(mean[full]))
    return (np.concatenate(starts), np.concatenate(found)) if starts else (np.zeros(0), np.zeros((0, 3)))


def smooth(x: Array, n: int) -> Array:
    """Centred mean (m, k) over ``n`` samples, over fewer at the ends."""
    total = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])
    i = np.arange(len(x))
    low, high = np.maximum(i - n // 2, 0), np.minimum(i + (n - n // 2), len(x))
    mean: Array = (total[high] - total[low]) / (high - low)[:, None]
    return mean
