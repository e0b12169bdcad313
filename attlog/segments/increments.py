"""Rotation of the gyro between given instants, and resets: jumps of an attitude that it does not explain."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, Out2, last_before
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median
from attlog.flight.model import Attitude, FlightLog, Imu
from attlog.segments import model
from attlog.segments.model import Segments

Array = NDArray[np.float64]

# Samples per pass: temporaries of long logs stay small.
CHUNK = 1 << 18


class GyroIncrements:
    """Prefix sums of the gyro's rotation, so that any interval costs the same.

    ``t`` (n,) s rising and ``rate`` (n, 3) rad/s. Sum of the angle increments with the second-order coning term ``1/2
    sum alpha x d alpha`` (Savage 1998, equation 17), exact enough for intervals that turn below some 30 deg.
    """

    def __init__(self, t: Array, rate: Array, sampling: Literal["interval", "instant"] = "instant") -> None:
        self.t = np.ascontiguousarray(t, np.float64)
        self._sums = np.empty((len(t), 6))
        """Angle and coning, side by side: what is looked up lies together in memory."""
        rate = np.ascontiguousarray(rate, np.float64)
        sum_gyro(self._sums, self.t, rate, int(sampling == "interval"))

    @cached_property
    def segment(self) -> NDArray[np.int64]:
        """Segment number (n,) of each sample between gaps."""
        return model.number_segments(self.t)

    def known(self, start: Array, end: Array) -> NDArray[np.bool_]:
        """Mark intervals (m,) from ``start`` to ``end`` between samples of one segment.

        The rotation across a gap is unknown, also where both ends lie in it.
        """
        if len(self.t) == 0:
            return np.zeros(len(start), bool)
        first = np.searchsorted(self.t, start, side="right") - 1
        last = np.searchsorted(self.t, end, side="left")
        end_of_log = len(self.t) - 1
        same = self.segment[np.maximum(first, 0)] == self.segment[np.minimum(last, end_of_log)]
        return np.asarray((first >= 0) & (last <= end_of_log) & same)

    def between(self, start: Array, end: Array) -> Array:
        """Return rotation vectors (m, 3) in rad from ``start`` (m,) to ``end`` (m,); none outside ``t``."""
        if len(self.t) < 2:
            return np.zeros((len(start), 3))
        out, (start, end) = np.empty((len(start), 3)), (np.ascontiguousarray(x, np.float64) for x in (start, end))
        rotation_between(out, self.t, self._sums, start, end)
        return out

    def mean_rates(self, start: Array, end: Array) -> Array:
        """Return mean rates (m, 3) in rad/s over intervals of ``start`` to ``end`` (m,) s; NaN across gaps."""
        rates = self.between(start, end) / (end - start)[:, None]
        rates[~self.known(start, end)] = np.nan
        return rates


@cached_per_log
def gyro_increments(imu: Imu) -> GyroIncrements:
    """Return the rotation of a unit's gyro by its good samples."""
    return GyroIncrements(*model.select_rising(imu.gyro.t_best, imu.gyro.x), imu.gyro.sampling)


@jit.loop("the sums of a gyro")
def sum_gyro(out: Out2, t: F1, rate: F2, interval: int) -> None:
    """Fill ``out`` (n, 6) with sums of the angle increments of ``rate`` (n, 3) at ``t`` (n,) and of their coning term.

    Sample k acts since the one before, without ``interval`` its mean with that one.
    """
    ax, ay, az, cx, cy, cz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(t)):
        if i > 0:
            h = t[i] - t[i - 1]
            x, y, z = rate[i, 0], rate[i, 1], rate[i, 2]
            if interval == 0:
                x, y, z = 0.5 * (rate[i - 1, 0] + x), 0.5 * (rate[i - 1, 1] + y), 0.5 * (rate[i - 1, 2] + z)
            x, y, z = x * h, y * h, z * h
            cx, cy, cz = cx + ay * z - az * y, cy + az * x - ax * z, cz + ax * y - ay * x
            ax, ay, az = ax + x, ay + y, az + z
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4], out[i, 5] = ax, ay, az, cx, cy, cz


def sum_at(sums: Array, column: int, i: int, share: float) -> float:
    """Return a sum of (n, 6) at a ``share`` of the interval after sample i."""
    return float(sums[i, column] + share * (sums[i + 1, column] - sums[i, column]))


@jit.loop("the rotation between two times")
def rotation_between(out: Out2, t: F1, sums: F2, start: F1, end: F1) -> None:
    """Fill ``out`` (m, 3) with rotation vectors from ``start`` (m,) to ``end`` (m,) by ``sums`` (n, 6) at ``t`` (n,).

    Linear between samples, two at least; outside the gyro stands still. Times that ascend are found by walking on.
    """
    i, j, last_but_one, first, last = 0, 0, len(t) - 2, t[0], t[len(t) - 1]
    for k in range(len(start)):
        a, b = start[k], end[k]
        a = first if a < first else last if a > last else a
        b = first if b < first else last if b > last else b
        i, j = last_before(t, a, i, last_but_one), last_before(t, b, j, last_but_one)
        p, r = (a - t[i]) / (t[i + 1] - t[i]), (b - t[j]) / (t[j + 1] - t[j])
        ax, ay, az = sum_at(sums, 0, i, p), sum_at(sums, 1, i, p), sum_at(sums, 2, i, p)
        x, y, z = sum_at(sums, 0, j, r) - ax, sum_at(sums, 1, j, r) - ay, sum_at(sums, 2, j, r) - az
        cx = sum_at(sums, 3, j, r) - sum_at(sums, 3, i, p) - (ay * z - az * y)
        cy = sum_at(sums, 4, j, r) - sum_at(sums, 4, i, p) - (az * x - ax * z)
        cz = sum_at(sums, 5, j, r) - sum_at(sums, 5, i, p) - (ax * y - ay * x)
        out[k, 0], out[k, 1], out[k, 2] = x + 0.5 * cx, y + 0.5 * cy, z + 0.5 * cz


# Find resets: jumps of an attitude without a matching gyro rotation.

Index = NDArray[np.int64]

# Limit of an unexplained rotation: max(SMALLEST_DEG, SIGMAS x robust sigma) + SHARE of the interval's rotation.
SMALLEST_DEG, SIGMAS, SHARE = 1.0, 6.0, 0.1
# Intervals on each side, and the minimum ratio to their 90th percentile. On simulated flights all logged resets are
# found; agile flights show 0 to 1 false ones.
NEIGHBOURS, NEIGHBOUR_FACTOR = 10, 4.0
# Intervals per pass, to limit memory on long logs.
MAX_INTERVALS = 50_000


def find_resets(attitude: Attitude, imu: Imu | None) -> tuple[Index, list[str]]:
    """Return indices i (k,) of resets between samples i-1 and i, with reasons.

    Resets are those of the log's counters and events, and rotation that the gyro does not explain: above ``max(1 deg, 6
    sigma) + 10 %`` of the interval's rotation, and above 4 times the 90th percentile of the unexplained rotation in the
    10 intervals on each side without the direct neighbours (docs/metrics.md). Gaps are excluded.
    """
    counted = {int(i): "reset counter or event of the autopilot" for i in attitude.resets if 0 < i < len(attitude.t)}
    unexplained = unexplained_deg(attitude, imu)
    found = dict(counted)
    if unexplained is not None:
        jump, rotated = unexplained
        for i in _jump_indices(jump, rotated) + 1:
            if not {int(i) - 1, int(i), int(i) + 1} & counted.keys():
                found[int(i)] = f"jump of {jump[i - 1]:.1f} deg that the gyro does not explain"
            elif int(i) in counted:
                found[int(i)] = f"{counted[int(i)]}, {jump[i - 1]:.1f} deg"
    order = sorted(found)
    return np.array(order, np.int64), [found[i] for i in order]


def known_resets(log: FlightLog, name: str, segments: Segments) -> tuple[Index, list[str]]:
    """Return resets as :func:`find_resets`, for the onboard attitude from its segments."""
    attitude = log.attitudes[name]
    if name != log.onboard:
        return find_resets(attitude, log.replay_imu)
    there = segments.of("reset")
    return np.searchsorted(attitude.t, [s.t1 for s in there]).astype(np.int64), [s.why for s in there]


@cached_per_log
def unexplained_deg(attitude: Attitude, imu: Imu | None) -> tuple[Array, Array] | None:
    """Return rotation (n-1,) in deg per interval: unexplained by the gyro, and by the gyro.

    The unexplained one is NaN for intervals in or across a gap of attitude or gyro. None without a gyro.
    """
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    if imu is None or len(t) < 3 or len(imu.gyro.t) < 3:
        return None
    turning = gyro_increments(imu)
    gyro_t, segment = turning.t, turning.segment
    if len(gyro_t) < 3:
        return None
    jump, rotated = np.empty(len(t) - 1), np.empty(len(t) - 1)
    for a in range(0, len(t) - 1, MAX_INTERVALS):
        b = min(a + MAX_INTERVALS, len(t) - 1)
        by_gyro = turning.between(t[a:b], t[a + 1 : b + 1])
        expected = rotation.multiply(attitude.q[a:b], rotation.from_rotvec(by_gyro))
        jump[a:b] = np.degrees(rotation.length(rotation.relative_rotvecs(expected, attitude.q[a + 1 : b + 1])))
        rotated[a:b] = np.degrees(rotation.length(by_gyro))
    where = np.clip(np.searchsorted(gyro_t, t), 0, len(gyro_t) - 1)
    whole = segment[where[:-1]] == segment[where[1:]]
    whole &= np.diff(model.number_segments(t)) == 0
    whole &= (t[:-1] >= gyro_t[0]) & (t[1:] <= gyro_t[-1]) & (np.diff(t) > 0)
    jump[~whole] = np.nan
    return jump, rotated


def _jump_indices(jump: Array, rotated: Array) -> Index:
    """Return indices of intervals whose unexplained rotation exceeds both limits."""
    known = np.isfinite(jump)
    if not known.any():
        return np.zeros(0, np.int64)
    sigma = 1.4826 * float(median(jump[known]))
    limit = max(SMALLEST_DEG, SIGMAS * sigma) + SHARE * rotated
    candidates = np.flatnonzero(known & (np.where(known, jump, 0.0) > limit))
    offsets = np.concatenate([np.arange(-NEIGHBOURS - 1, -1), np.arange(2, NEIGHBOURS + 2)])
    padded = np.concatenate([np.full(NEIGHBOURS + 1, np.nan), jump, np.full(NEIGHBOURS + 1, np.nan)])
    kept = []
    for a in range(0, len(candidates), MAX_INTERVALS):
        rows = candidates[a : a + MAX_INTERVALS]
        around = padded[rows[:, None] + offsets + NEIGHBOURS + 1]
        usual = _percentile_90(around)
        kept.append(rows[jump[rows] > NEIGHBOUR_FACTOR * usual])
    return np.concatenate(kept) if kept else np.zeros(0, np.int64)


def _percentile_90(rows: Array) -> Array:
    """Return the 90th percentile (n,) of the finite values of each row (n, k), 0 without any."""
    ordered = np.sort(rows, axis=1)
    count = np.sum(np.isfinite(rows), axis=1)
    place = 0.9 * np.maximum(count - 1, 0)
    low = np.floor(place).astype(np.int64)
    high = np.minimum(low + 1, np.maximum(count - 1, 0))
    row = np.arange(len(rows))
    value = ordered[row, low] + (place - low) * (ordered[row, high] - ordered[row, low])
    return np.where(count > 0, value, 0.0)
