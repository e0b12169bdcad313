"""How far the gyro turned between given instants: the yardstick for jumps and delays of an attitude."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CHUNK = 1 << 18
"""Samples per pass: temporaries of long logs stay small."""

LOOKED_UP = 1 << 14
"""Intervals per pass."""


class Turning:
    """The gyro's rotation as prefix sums, so that any interval costs the same.

    ``t`` (n,) s rising and ``rate`` (n, 3) rad/s. Sum of the angle increments with the
    second-order coning term ``1/2 sum alpha x d alpha`` (Savage 1998, equation 17),
    exact enough for intervals that turn below some 30 deg.
    """

    def __init__(self, t: Array, rate: Array, sampling: Literal["interval", "instant"] = "instant") -> None:
        self._t = t
        self._sums = np.zeros((len(t), 6))
        """Angle and coning, side by side: what is looked up lies together in memory."""
        angle, coning = self._sums[:, :3], self._sums[:, 3:]
        for a in range(0, len(t) - 1, CHUNK):
            b = min(a + CHUNK, len(t) - 1)
            mean = rate[a + 1 : b + 1] if sampling == "interval" else 0.5 * (rate[a:b] + rate[a + 1 : b + 1])
            step = mean * np.diff(t[a : b + 1])[:, None]
            angle[a + 1 : b + 1] = angle[a] + np.cumsum(step, axis=0)
            coning[a + 1 : b + 1] = coning[a] + np.cumsum(_cross(angle[a:b], step), axis=0)

    def between(self, start: Array, end: Array) -> Array:
        """Rotation vectors (m, 3) in rad from ``start`` (m,) to ``end`` (m,); outside ``t`` the gyro stands still."""
        out = np.empty((len(start), 3))
        for i in range(0, len(start), LOOKED_UP):
            out[i : i + LOOKED_UP] = self._between(start[i : i + LOOKED_UP], end[i : i + LOOKED_UP])
        return out

    def _between(self, start: Array, end: Array) -> Array:
        a, b = self._at(start), self._at(end)
        whole = b[:, :3] - a[:, :3]
        return whole + 0.5 * (b[:, 3:] - a[:, 3:] - _cross(a[:, :3], whole))

    def _at(self, at: Array) -> Array:
        """The sums (m, 6) at times, linear between samples."""
        if len(self._t) < 2:
            return np.zeros((len(at), 6))
        at = np.clip(at, self._t[0], self._t[-1])
        i = np.clip(np.searchsorted(self._t, at, side="right") - 1, 0, len(self._t) - 2)
        before = self._sums[i]
        slope = (self._sums[i + 1] - before) / (self._t[i + 1] - self._t[i])[:, None]
        return np.asarray(slope * (at - self._t[i])[:, None] + before)


def _cross(a: Array, b: Array) -> Array:
    """a x b of (n, 3), several times as fast as numpy's general one."""
    out = np.empty_like(a)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        out[:, k] = a[:, i] * b[:, j] - a[:, j] * b[:, i]
    return out
