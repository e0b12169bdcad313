"""Rotation of the gyro between given instants, to check jumps and delays of an attitude."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.jit import F1, F2, Out2, last_before
from attlog.core.log_cache import cached_per_log
from attlog.flight.model import Imu
from attlog.segments import model

Array = NDArray[np.float64]

# Samples per pass: temporaries of long logs stay small.
CHUNK = 1 << 18

# Intervals per pass: what they need stays in the processor's cache.
LOOKED_UP = 1 << 12


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
