"""How far the gyro turned between given instants: the yardstick for jumps and delays of an attitude."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Turning:
    """The gyro's rotation as prefix sums, so that any interval costs the same.

    ``t`` (n,) s rising and ``rate`` (n, 3) rad/s. Sum of the angle increments with the
    second-order coning term ``1/2 sum alpha x d alpha`` (Savage 1998, equation 17),
    exact enough for intervals that turn below some 30 deg.
    """

    def __init__(self, t: Array, rate: Array, sampling: Literal["interval", "instant"] = "instant") -> None:
        mean = rate[1:] if sampling == "interval" else 0.5 * (rate[:-1] + rate[1:])
        step = mean * np.diff(t)[:, None]
        zero = np.zeros((1, 3))
        self._t = t
        self._angle = np.concatenate([zero, np.cumsum(step, axis=0)])
        self._coning = np.concatenate([zero, np.cumsum(np.cross(self._angle[:-1], step), axis=0)])

    def between(self, start: Array, end: Array) -> Array:
        """Rotation vectors (m, 3) in rad from ``start`` (m,) to ``end`` (m,); outside ``t`` the gyro stands still."""
        a = self._at(start, self._angle)
        whole = self._at(end, self._angle) - a
        return whole + 0.5 * (self._at(end, self._coning) - self._at(start, self._coning) - np.cross(a, whole))

    def _at(self, at: Array, sums: Array) -> Array:
        return np.stack([np.interp(at, self._t, sums[:, k]) for k in range(3)], axis=-1)
