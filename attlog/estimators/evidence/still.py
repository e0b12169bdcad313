"""Gravity where the body is still, motors off or idling: no filter decides where it is, none can argue with it.

A motor's vibration turns the direction of single samples by degrees, never one way: a window is judged by the means of
its eighths. A blow or a turn shows in their spread.

    still   the angle by the gyro, its mean rate taken out, stays within 0.3 deg
            standard deviation of the eight mean forces < 0.05 m/s^2, their directions within 0.5 deg
            mean force within 0.6 m/s^2 of 9.8

A calm hover passes too, and errs by 0.5 deg at most. Raw scatter is not limited.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation

Array = NDArray[np.float64]

PARTS, PART_S, EVERY = 8, 0.25, 2
"""A window is 8 parts of 0.25 s; one begins with every second part."""
EXCURSION_DEG, SPREAD_M_S2, DIRECTION_DEG = 0.3, 0.05, 0.5
G_M_S2, NEAR_M_S2 = 9.8, 0.6
WINDOW_S = PARTS * PART_S


def still_windows(t: Array, gyr: Array, acc: Array, near_m_s2: float = NEAR_M_S2) -> Array:
    """Begin and end (k, 2) s of the windows in which the body was still; they overlap.

    ``t`` (n,) s ascending, gyro rad/s and specific force m/s^2 (n, 3) in body axes; the mean force lies within
    ``near_m_s2`` of gravity. Samples that are no numbers are
    left out; a part without a sample breaks every window that holds it.
    """
    good = np.isfinite(t) & rotation.finite(gyr) & rotation.finite(acc)
    if not good.all():
        t, gyr, acc = t[good], gyr[good], acc[good]
    if len(t) < PARTS:
        return np.zeros((0, 2))
    number = np.floor((t - t[0]) / PART_S).astype(np.int64)
    first = np.flatnonzero(np.concatenate([[True], np.diff(number) != 0]))
    count = np.diff(np.append(first, len(t)))[:, None]
    part, rate, force = number[first], _sums(gyr, first) / count, _sums(acc, first) / count
    begin = np.arange(len(part) - PARTS + 1)
    begin = begin[(part[begin] % EVERY == 0) & (part[begin + PARTS - 1] - part[begin] == PARTS - 1)]
    if not len(begin):
        return np.zeros((0, 2))
    eighths = begin[:, None] + np.arange(PARTS)
    still = _steady_force(force[eighths], near_m_s2) & (_excursion_deg(rate[eighths]) < EXCURSION_DEG)
    start = t[0] + PART_S * part[begin[still]]
    return np.column_stack([start, start + WINDOW_S])


def tilt_residual(windows: Array, t: Array, acc: Array, q: Array) -> Array:
    """Angle (k,) in deg between the mean force over each window (k, 2) and the mean up of an attitude; NaN without it.

    ``acc`` (n, 3) m/s^2 at ``t`` (n,) s ascending; ``q`` (n, 4) is the body's attitude to earth (north, east, down) at
    these times, NaN where unknown.
    """
    force, up = mean_directions(windows, t, acc, q)
    cross = rotation.length(np.cross(force, up))
    angle: Array = np.degrees(np.arctan2(cross, np.sum(force * up, axis=1)))
    return angle


def mean_directions(windows: Array, t: Array, acc: Array, q: Array) -> tuple[Array, Array]:
    """Mean force (k, 3) in m/s^2 and mean up (k, 3), a unit vector, in body axes over windows; NaN without either."""
    if not len(windows):
        return np.zeros((0, 3)), np.zeros((0, 3))
    inside = within(windows, t) & rotation.finite(acc) & rotation.finite(q)
    t, acc = t[inside], acc[inside]
    up = rotation.rotate_inverse(q[inside], np.array([0.0, 0.0, -1.0]))
    low, high = np.searchsorted(t, windows[:, 0]), np.searchsorted(t, windows[:, 1])
    total = np.concatenate([np.zeros((1, 6)), np.cumsum(np.column_stack([acc, up]), axis=0)])
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (total[high] - total[low]) / (high - low)[:, None]
        return mean[:, :3], mean[:, 3:] / rotation.length(mean[:, 3:])[:, None]


def within(windows: Array, t: Array) -> NDArray[np.bool_]:
    """Which times (n,), ascending, lie in any of the windows (k, 2), which may overlap and follow each other."""
    edges = np.zeros(len(t) + 1, np.int64)
    np.add.at(edges, np.searchsorted(t, windows[:, 0]), 1)
    np.add.at(edges, np.searchsorted(t, windows[:, 1]), -1)
    inside: NDArray[np.bool_] = np.cumsum(edges[:-1]) > 0
    return inside


def _sums(x: Array, first: NDArray[np.int64]) -> Array:
    """Sums (m, 3) of samples (n, 3) over the parts that begin at ``first`` (m,)."""
    return np.asarray(np.add.reduceat(x, first, axis=0))


def _steady_force(force: Array, near_m_s2: float) -> NDArray[np.bool_]:
    """Which windows' mean forces (k, 8, 3) are steady, point one way and are as large as gravity."""
    mean = force.mean(axis=1)
    size = rotation.length(mean)
    spread = np.sqrt(np.sum(force.var(axis=1), axis=1))
    steady: NDArray[np.bool_] = (spread < SPREAD_M_S2) & (np.abs(size - G_M_S2) < near_m_s2)
    whole = np.repeat(mean[steady, None], PARTS, axis=1)
    across = rotation.length(np.cross(force[steady], whole))
    angle = np.degrees(np.arctan2(across, np.sum(force[steady] * whole, axis=2)))
    steady[steady] = angle.max(axis=1, initial=0.0) < DIRECTION_DEG
    return steady


def _excursion_deg(rate: Array) -> Array:
    """How far (k,) deg the angle by mean rates (k, 8, 3) leaves that of the window's mean rate (the gyro's bias)."""
    turned = np.cumsum((rate - rate.mean(axis=1, keepdims=True)) * PART_S, axis=1)
    excursion: Array = np.degrees(rotation.length(turned).max(axis=1))
    return excursion
