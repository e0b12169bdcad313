"""The IMU in windows of half a second: what stillness, idling and hover are judged by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.segments import gaps

Array = NDArray[np.float64]

SECONDS = 0.5
MIN_SAMPLES = 5
"""A standard deviation needs a few samples: slow logs get longer windows."""

BLOCK = 2048
"""Windows per pass: temporaries of long logs stay small."""


@dataclass(slots=True)
class Windows:
    """Statistics of the IMU in windows [t0, t1], (m,) and (m, 3); ``segment`` numbers continuous segments.

    ``rate`` is the mean body rate, ``rate_std`` the standard deviation of the gyro
    (rms of the three axes), ``rate_rms`` the rms of the rate's length, all in deg/s;
    ``force`` and ``force_std`` are mean and standard deviation of the specific force's length in m/s^2.
    """

    t0: Array
    t1: Array
    segment: NDArray[np.int64]
    rate: Array
    rate_std: Array
    rate_rms: Array
    force: Array
    force_std: Array
    seconds: float

    @property
    def middle(self) -> Array:
        """The middles of the windows (m,) in s."""
        return 0.5 * (self.t0 + self.t1)


def build(t: Array, gyro: Array, acc: Array) -> Windows:
    """Windows over good samples (n,), (n, 3) rad/s, (n, 3) m/s^2; windows with under 3 samples are left out."""
    dt = np.diff(t)
    usual = float(np.median(dt[dt > 0])) if np.any(dt > 0) else SECONDS
    seconds = max(SECONDS, MIN_SAMPLES * usual)
    segment = gaps.number(t)
    segment_start = t[np.searchsorted(segment, segment)]
    number = np.floor((t - segment_start) / seconds).astype(np.int64)
    key = np.flatnonzero(np.concatenate([[True], (np.diff(segment) != 0) | (np.diff(number) != 0)]))
    count = np.diff(np.append(key, len(t)))
    blocks = np.arange(0, len(key), BLOCK)
    values = np.concatenate(
        [_statistics(gyro, acc, key[a : a + BLOCK], count[a : a + BLOCK]) for a in blocks.tolist()], axis=0
    )
    start = segment_start[key] + number[key] * seconds
    end = np.minimum(start + seconds, t[key + count - 1] + usual)
    keep = count >= 3
    values = values[keep]
    return Windows(
        start[keep],
        end[keep],
        segment[key][keep],
        rate=values[:, 0:3],
        rate_std=values[:, 3],
        rate_rms=values[:, 4],
        force=values[:, 5],
        force_std=values[:, 6],
        seconds=seconds,
    )


def _statistics(gyro: Array, acc: Array, key: NDArray[np.int64], count: NDArray[np.int64]) -> Array:
    """Columns (m, 7) of the windows that begin at samples ``key``: rate, rate_std, rate_rms, force, force_std."""
    samples = slice(int(key[0]), int(key[-1] + count[-1]))
    rate = np.degrees(gyro[samples])
    force = rotation.length(acc[samples])
    first = key - key[0]

    def mean(x: Array) -> Array:
        return (np.add.reduceat(x, first, axis=0).T / count).T

    rate_mean, force_mean = mean(rate), mean(force)
    spread = rate - np.repeat(rate_mean, count, axis=0)
    return np.column_stack(
        [
            rate_mean,
            np.sqrt(mean(np.einsum("ni,ni->n", spread, spread) / 3.0)),
            np.sqrt(mean(np.einsum("ni,ni->n", rate, rate))),
            force_mean,
            np.sqrt(mean((force - np.repeat(force_mean, count)) ** 2)),
        ]
    )


def join(windows: Windows, passed: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Segments (t0, t1) in s of neighbouring windows of one continuous segment that all passed."""
    i = np.flatnonzero(passed)
    if len(i) == 0:
        return []
    new = (windows.t0[i[1:]] - windows.t1[i[:-1]] > 0.1 * windows.seconds) | (
        windows.segment[i[1:]] != windows.segment[i[:-1]]
    )
    first = np.concatenate([[0], np.flatnonzero(new) + 1])
    last = np.append(first[1:], len(i)) - 1
    return [(float(windows.t0[i[a]]), float(windows.t1[i[b]])) for a, b in zip(first, last, strict=True)]
