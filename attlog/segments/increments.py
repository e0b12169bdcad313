"""How far the gyro turned between given instants: the yardstick for jumps and delays of an attitude."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import Imu
from attlog.kernels.loops import function_of
from attlog.segments import gaps
from attlog.segments.increments_loop import BETWEEN, SUMMED, gyro_between, summed_gyro
from attlog.segments.once import asked_once

Array = NDArray[np.float64]

CHUNK = 1 << 18
"""Samples per pass: temporaries of long logs stay small."""

LOOKED_UP = 1 << 12
"""Intervals per pass: what they need stays in the processor's cache."""


class GyroIncrements:
    """The gyro's rotation as prefix sums, so that any interval costs the same.

    ``t`` (n,) s rising and ``rate`` (n, 3) rad/s. Sum of the angle increments with the
    second-order coning term ``1/2 sum alpha x d alpha`` (Savage 1998, equation 17),
    exact enough for intervals that turn below some 30 deg.
    """

    def __init__(self, t: Array, rate: Array, sampling: Literal["interval", "instant"] = "instant") -> None:
        self.t = np.ascontiguousarray(t, np.float64)
        self._sums = np.empty((len(t), 6))
        """Angle and coning, side by side: what is looked up lies together in memory."""
        rate = np.ascontiguousarray(rate, np.float64)
        function_of(SUMMED, summed_gyro, summed_at_once)(self._sums, self.t, rate, int(sampling == "interval"))

    @cached_property
    def segment(self) -> NDArray[np.int64]:
        """The number (n,) of the segment between gaps that each sample belongs to."""
        return gaps.number(self.t)

    def known(self, start: Array, end: Array) -> NDArray[np.bool_]:
        """Which intervals (m,) from ``start`` to ``end`` lie between samples of one segment.

        How far the gyro turned in a gap nobody knows, also where both ends lie in it.
        """
        if len(self.t) == 0:
            return np.zeros(len(start), bool)
        before = np.searchsorted(self.t, start, side="right") - 1
        after = np.searchsorted(self.t, end, side="left")
        last = len(self.t) - 1
        same = self.segment[np.maximum(before, 0)] == self.segment[np.minimum(after, last)]
        return np.asarray((before >= 0) & (after <= last) & same)

    def between(self, start: Array, end: Array) -> Array:
        """Rotation vectors (m, 3) in rad from ``start`` (m,) to ``end`` (m,); outside ``t`` the gyro stands still."""
        if len(self.t) < 2:
            return np.zeros((len(start), 3))
        out, (start, end) = np.empty((len(start), 3)), (np.ascontiguousarray(x, np.float64) for x in (start, end))
        function_of(BETWEEN, gyro_between, between_at_once)(out, self.t, self._sums, start, end)
        return out


@asked_once
def of(imu: Imu) -> GyroIncrements:
    """How far the gyro of a unit turned, by its good samples."""
    return GyroIncrements(*gaps.rising(imu.gyro.t_best, imu.gyro.x), imu.gyro.sampling)


def summed_at_once(out: Array, t: Array, rate: Array, interval: int) -> None:
    """:func:`summed_gyro` in numpy."""
    out[:1] = 0.0
    angle, coning = out[:, :3], out[:, 3:]
    for a in range(0, len(t) - 1, CHUNK):
        b = min(a + CHUNK, len(t) - 1)
        mean = rate[a + 1 : b + 1] if interval else 0.5 * (rate[a:b] + rate[a + 1 : b + 1])
        step = mean * np.diff(t[a : b + 1])[:, None]
        angle[a + 1 : b + 1] = angle[a] + np.cumsum(step, axis=0)
        coning[a + 1 : b + 1] = coning[a] + np.cumsum(_cross(angle[a:b], step), axis=0)


def between_at_once(out: Array, t: Array, sums: Array, start: Array, end: Array) -> None:
    """:func:`gyro_between` in numpy."""
    for i in range(0, len(start), LOOKED_UP):
        a, b = (_at(t, sums, x[i : i + LOOKED_UP]) for x in (start, end))
        whole = b[:, :3] - a[:, :3]
        out[i : i + LOOKED_UP] = whole + 0.5 * (b[:, 3:] - a[:, 3:] - _cross(a[:, :3], whole))


def _at(t: Array, sums: Array, at: Array) -> Array:
    """The sums (m, 6) at times, linear between samples."""
    at = np.clip(at, t[0], t[-1])
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    before, since, found = sums.take(i, axis=0), t.take(i), sums.take(i + 1, axis=0)
    found -= before
    found /= (t.take(i + 1) - since)[:, None]
    found *= (at - since)[:, None]
    found += before
    return found


def _cross(a: Array, b: Array) -> Array:
    """a x b of (n, 3), several times as fast as numpy's general one."""
    out = np.empty_like(a)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        out[:, k] = a[:, i] * b[:, j] - a[:, j] * b[:, i]
    return out
