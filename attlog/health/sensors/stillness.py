"""Gravity from the accelerometer while the vehicle stands still, motors on or off: means over windows, not samples.

A motor's vibration turns the direction of single samples by degrees, never one way; a blow or a turn shows in the
spread of a window's parts, and the window is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Array, Imu
from attlog.segments.spans import Span

WINDOW_S, PARTS = 2.0, 8
LEAST_PARTS = 3
STEADY_M_S2 = 0.3
"""The standard deviation of the parts' means, at most: a vehicle that stands shows 0.00 to 0.05."""
NEAR_M_S2, G = 0.6, 9.80665


def still_windows(imu: Imu, use: NDArray[np.bool_], q: Array) -> tuple[Array, Array]:
    """Mean force and up (k, 3) in body axes over still windows of the samples ``use`` (n,), by attitudes ``q`` (n, 4).

    q belongs to the vehicle at the accelerometer's times (NaN where unknown); up is a unit vector, force m/s^2.
    """
    t = imu.acc.t_best
    use = use & rotation.finite(q) & rotation.finite(imu.acc.x)
    up = np.full_like(imu.acc.x, np.nan)
    up[use] = rotation.rotate_inverse(q[use], np.array([0.0, 0.0, -1.0]))
    index = np.flatnonzero(use)
    number = np.floor((t[index] - t[0]) / WINDOW_S).astype(np.int64)
    forces, ups = [], []
    for window in np.split(index, np.flatnonzero(np.diff(number)) + 1):
        if len(window) < LEAST_PARTS or t[window[-1]] - t[window[0]] < 0.5 * WINDOW_S:
            continue
        parts = [p for p in np.array_split(window, min(PARTS, len(window))) if len(p)]
        means = np.array([imu.acc.x[p].mean(axis=0) for p in parts])
        if np.sqrt(np.sum(means.std(axis=0) ** 2)) <= STEADY_M_S2:
            forces.append(means.mean(axis=0))
            ups.append(up[window].mean(axis=0))
    if not forces:
        return np.zeros((0, 3)), np.zeros((0, 3))
    found = np.array(ups)
    return np.array(forces), found / rotation.length(found)[:, None]


def tilt_error(imu: Imu, span: Span, q: Array) -> float | None:
    """Median angle (deg) of attitudes ``q`` (n, 4) at the accelerometer's times to gravity while it stands within a
    span; None where it never does."""
    t = imu.acc.t_best
    force, up = still_windows(imu, (t >= span[0]) & (t <= span[1]), q)
    near = np.abs(rotation.length(force) - G) <= NEAR_M_S2
    if not near.any():
        return None
    return float(np.median(degrees_between(force[near], up[near])))


def degrees_between(a: Array, b: Array) -> Array:
    """Angles (n,) in deg between vectors (n, 3)."""
    angle: Array = np.arctan2(np.sqrt(np.sum(np.cross(a, b) ** 2, axis=1)), np.sum(a * b, axis=1))
    return np.degrees(angle)
