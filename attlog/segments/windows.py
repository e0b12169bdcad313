"""IMU statistics in short windows for rest, idling and hover, and vibration per second."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.spans import Span, inside
from attlog.flight.model import Imu
from attlog.segments import model

Array = NDArray[np.float64]

MIN_WINDOW_S = 0.5  # short against rests, long against samples
# Minimum samples for a standard deviation: slow logs get longer windows.
MIN_WINDOW_SAMPLES = 5

# Windows per pass, to limit memory on long logs.
WINDOWS_PER_PASS = 2048


@dataclass(slots=True)
class ImuWindows:
    """Statistics of the IMU in windows [t0, t1], (m,) and (m, 3); ``segment`` numbers continuous segments.

    ``rate``: mean body rate. ``rate_std``: standard deviation of the gyro (rms of three axes). ``rate_rms``: rms of the
    rate's length, all in deg/s. ``force`` and ``force_std``: mean and standard deviation of the specific force's length
    in m/s^2.
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
        """Middles of the windows (m,) in s."""
        return 0.5 * (self.t0 + self.t1)


def build_windows(t: Array, gyro: Array, acc: Array) -> ImuWindows:
    """Return window statistics of good samples: gyro in rad/s, accelerometer in m/s^2.

    Windows of fewer than 3 samples are dropped.
    """
    dt = np.diff(t)
    usual = float(np.median(dt[dt > 0])) if np.any(dt > 0) else MIN_WINDOW_S
    seconds = max(MIN_WINDOW_S, MIN_WINDOW_SAMPLES * usual)
    segment = model.number_segments(t)
    segment_start = t[np.searchsorted(segment, segment)]
    number = np.floor((t - segment_start) / seconds).astype(np.int64)
    key = np.flatnonzero(np.concatenate([[True], (np.diff(segment) != 0) | (np.diff(number) != 0)]))
    count = np.diff(np.append(key, len(t)))
    blocks = np.arange(0, len(key), WINDOWS_PER_PASS)
    values = np.concatenate(
        [
            _statistics(gyro, acc, key[a : a + WINDOWS_PER_PASS], count[a : a + WINDOWS_PER_PASS])
            for a in blocks.tolist()
        ],
        axis=0,
    )
    start = segment_start[key] + number[key] * seconds
    end = np.minimum(start + seconds, t[key + count - 1] + usual)
    keep = count >= 3
    values = values[keep]
    return ImuWindows(
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
    """Return columns (m, 7) of the windows at samples ``key``: rate, rate_std, rate_rms, force, force_std."""
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


def join_windows(windows: ImuWindows, passed: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return spans (t0, t1) in s of consecutive windows in one segment that all passed."""
    i = np.flatnonzero(passed)
    if len(i) == 0:
        return []
    new = (windows.t0[i[1:]] - windows.t1[i[:-1]] > 0.1 * windows.seconds) | (
        windows.segment[i[1:]] != windows.segment[i[:-1]]
    )
    first = np.concatenate([[0], np.flatnonzero(new) + 1])
    last = np.append(first[1:], len(i)) - 1
    return [(float(windows.t0[i[a]]), float(windows.t1[i[b]])) for a, b in zip(first, last, strict=True)]


# --- vibration ---------------------------------------------------------------------------------------------------

# Vibration is the force minus its moving mean over 0.2 s; its RMS is taken over 1 s.
VIBRATION_MEAN_S, VIBRATION_WINDOW_S = 0.2, 1.0


def vibration_levels(imu: Imu, within: list[Span]) -> tuple[Array, Array]:
    """Return starts (m,) in s of 1 s windows within spans and their vibration RMS (m, 3)."""
    t, acc = imu.acc.t_best, imu.acc.x
    good = np.isfinite(t) & rotation.finite_rows(acc) & inside(t, within)
    t, acc = t[good], acc[good]
    if len(t) < 10:
        return np.zeros(0), np.zeros((0, 3))
    starts, found = [], []
    for part in model.segment_slices(np.ones(len(t), bool), model.number_segments(t)):
        n = max(3, round(VIBRATION_MEAN_S * (part.stop - part.start - 1) / max(t[part.stop - 1] - t[part.start], 1e-9)))
        if part.stop - part.start < 3 * n:
            continue
        fast = acc[part] - centred_mean(acc[part], n)
        window = np.floor((t[part] - t[part.start]) / VIBRATION_WINDOW_S).astype(np.int64)
        first = np.flatnonzero(np.diff(window, prepend=-1))
        count = np.diff(np.append(first, len(window)))
        mean = np.add.reduceat(fast**2, first, axis=0) / count[:, None]
        full = count >= 0.8 * np.median(count)
        starts.append(t[part][first][full])
        found.append(np.sqrt(mean[full]))
    return (np.concatenate(starts), np.concatenate(found)) if starts else (np.zeros(0), np.zeros((0, 3)))


def centred_mean(x: Array, n: int) -> Array:
    """Return the centred moving mean (m, k) over ``n`` samples, over fewer at the ends."""
    total = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])
    i = np.arange(len(x))
    low, high = np.maximum(i - n // 2, 0), np.minimum(i + (n - n // 2), len(x))
    mean: Array = (total[high] - total[low]) / (high - low)[:, None]
    return mean
