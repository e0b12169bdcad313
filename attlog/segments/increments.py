"""How far the gyro turned between given instants: the yardstick for jumps and delays of an attitude."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def turned(t: Array, rate: Array, at: Array, sampling: Literal["interval", "instant"] = "instant") -> Array:
    """Rotation vectors (m - 1, 3) in rad by which the gyro turned between the instants ``at`` (m,).

    ``t`` (n,) s and ``rate`` (n, 3) rad/s. Sum of the angle increments with the
    second-order coning term ``1/2 sum alpha x d alpha`` (Savage 1998, equation 17),
    exact enough for intervals that turn below some 30 deg. By prefix sums: the cost
    is linear. Instants outside ``t`` see the gyro stand still.
    """
    dt = np.diff(t)
    mean = rate[1:] if sampling == "interval" else 0.5 * (rate[:-1] + rate[1:])
    step = mean * dt[:, None]
    angle = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    coning = np.concatenate([np.zeros((1, 3)), np.cumsum(np.cross(angle[:-1], step), axis=0)])
    a = np.stack([np.interp(at, t, angle[:, k]) for k in range(3)], axis=-1)
    c = np.stack([np.interp(at, t, coning[:, k]) for k in range(3)], axis=-1)
    whole = np.diff(a, axis=0)
    return whole + 0.5 * (np.diff(c, axis=0) - np.cross(a[:-1], whole))
