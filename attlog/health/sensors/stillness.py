"""The mean force, and an attitude's up, over windows of a phase in which the vehicle stands still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.evidence.still import mean_directions, still_windows
from attlog.flight.model import Array, Imu
from attlog.segments import gaps


def still_directions(imu: Imu, use: NDArray[np.bool_], q: Array) -> tuple[Array, Array]:
    """Mean force (k, 3) in m/s^2 and up (k, 3), a unit vector, in body axes over still windows of samples ``use`` (n,).

    ``q`` (n, 4) is the attitude of the unit at the accelerometer's times, NaN where unknown. The force may have any
    size: an accelerometer with a wrong scale still shows a direction.
    """
    n = min(len(imu.acc.t_best), len(imu.gyro.x))
    t, x = gaps.rising(np.where(use, imu.acc.t_best, np.nan)[:n], np.column_stack([imu.gyro.x, imu.acc.x, q])[:n])
    windows = still_windows(t, x[:, :3], x[:, 3:6], near_m_s2=np.inf)
    force, up = mean_directions(windows, t, x[:, 3:6], x[:, 6:])
    known = np.isfinite(force[:, 0]) & np.isfinite(up[:, 0])
    return force[known], up[known]


def degrees_between(a: Array, b: Array) -> Array:
    """Angles (n,) in deg between vectors (n, 3)."""
    angle: Array = np.arctan2(np.sqrt(np.sum(np.cross(a, b) ** 2, axis=1)), np.sum(a * b, axis=1))
    return np.degrees(angle)
