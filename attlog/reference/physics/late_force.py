"""Is the accelerometer on the clock of the attitude? Turned to earth its force changes the velocity as GNSS sees it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Array, FlightLog
from attlog.segments import gaps

STEP_S = 0.1
"""Forces are averaged over so long, and shifted in such steps."""
RANGE_S, GNSS_LATE_S = 10.0, 0.6
"""Delays that are looked for, either way; and how late a receiver may be itself."""
LEAST_S = 0.3
"""A smaller one may be a receiver's."""
OVER_S = 1.0
"""Velocities change over so long: less is their noise."""
LEAST_M_S2, FEWEST, LONGEST_S = 0.5, 60, 300.0
"""Weaker acceleration (RMS) tells nothing, nor do fewer pairs; of long flights the first minutes are looked at."""
CLEARLY, ALIKE = 9.0, 0.8
"""The shift leaves so many times less (squared), and then both are alike (correlation)."""
COARSE, WORTH_A_LOOK = 4, 2.0
"""Steps of a first look, and how many times less one of them leaves (squared) to be looked at closely."""
FITS = 0.95
"""Forces that fit so well (correlation) are not late."""
FIX_3D = 3


def seconds(log: FlightLog) -> float | None:
    """How late the accelerometer is, s; None where it is on time, or nothing tells."""
    imu, attitude, gnss = log.replay_imu, log.onboard_attitude, next(iter(log.gnss), None)
    if imu is None or attitude is None or gnss is None:
        return None
    grid, force = _mean_force(*gaps.rising(imu.acc.t_best, imu.acc.x))
    good = rotation.finite(gnss.vel_ned[:, :2]) & (gnss.fix >= FIX_3D)
    t, velocity = gnss.t[good], gnss.vel_ned[good, :2]
    if len(grid) < FEWEST:
        return None
    first, last = _pairs(t, grid)
    if len(first) < FEWEST:
        return None
    change = (velocity[last] - velocity[first]) / (t[last] - t[first])[:, None]
    change = change - np.median(change, axis=0)
    if np.sqrt(np.mean(np.sum(change**2, axis=1))) < LEAST_M_S2:
        return None
    q, _ = rotation.interpolated(attitude.t, attitude.q, None, grid)
    spans = t[first] - grid[0], t[last] - grid[0]
    receivers = np.arange(0.0, GNSS_LATE_S, STEP_S).tolist()

    def fit(shift: int, receiver_s: float) -> tuple[float, float]:
        return _fit(q, force, shift, receiver_s, spans, change)

    left, alike = min(fit(0, receiver_s) for receiver_s in receivers)
    if alike > FITS:
        return None
    steps = round(RANGE_S / STEP_S)
    rough, near = min((fit(k, receivers[1]), k) for k in range(-steps, steps + 1, COARSE))
    if rough[0] * WORTH_A_LOOK > left:
        return None
    (best, then), shift = min((fit(k, r), k) for k in range(near - COARSE, near + COARSE + 1) for r in receivers)
    late = shift * STEP_S
    return late if abs(late) >= LEAST_S - 1e-9 and best * CLEARLY < left and then > ALIKE else None


def _mean_force(t: Array, force: Array) -> tuple[Array, Array]:
    """Means (n, 3) of the specific force over STEP_S and their middles; NaN where there is none."""
    known = rotation.finite(force)
    t, force = t[known], force[known]
    if len(t) < 2:
        return np.zeros(0), np.zeros((0, 3))
    index = ((t - t[0]) / STEP_S).astype(np.int64)
    kept = index < round(LONGEST_S / STEP_S)
    index, force = index[kept], force[kept]
    count = np.bincount(index)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.column_stack([np.bincount(index, force[:, k]) for k in range(3)]) / count[:, None]
    return t[0] + STEP_S * (np.arange(len(count)) + 0.5), mean


def _pairs(t: Array, grid: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of fixes that are OVER_S apart, within the forces."""
    last = np.searchsorted(t, t + OVER_S)
    first = np.flatnonzero(last < len(t))
    last = last[first]
    near = (t[last] - t[first] < 1.6 * OVER_S) & (t[first] > grid[0] + 1.0) & (t[last] < grid[-1] - 1.0)
    return first[near], last[near]


def _fit(
    q: Array, force: Array, shift: int, receiver_s: float, spans: tuple[Array, Array], change: Array
) -> tuple[float, float]:
    """What a force that is ``shift`` steps late leaves (mean square) of the changes (n, 2), and their correlation."""
    moved = np.full_like(force, np.nan)
    if shift >= 0:
        moved[: len(force) - shift] = force[shift:]
    else:
        moved[-shift:] = force[:shift]
    earth = rotation.rotate(q, moved)[:, :2]
    known: NDArray[np.bool_] = np.asarray(rotation.finite(earth))
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(np.where(known[:, None], earth, 0.0) * STEP_S, axis=0)])
    missing = np.concatenate([[0], np.cumsum(~known)])
    place = [np.clip((s - receiver_s) / STEP_S + 0.5, 0.0, len(force)) for s in spans]
    whole = np.arange(len(force) + 1)
    a, b = (np.column_stack([np.interp(p, whole, sums[:, k]) for k in range(2)]) for p in place)
    inside = missing[np.ceil(place[1]).astype(int)] == missing[np.floor(place[0]).astype(int)]
    if np.count_nonzero(inside) < max(FEWEST, len(inside) // 2):
        return np.inf, 0.0
    by_force = ((b - a) / ((place[1] - place[0]) * STEP_S)[:, None])[inside]
    by_force, own = by_force - np.median(by_force, axis=0), change[inside]
    alike = float(np.sum(by_force * own) / np.sqrt(np.sum(by_force**2) * np.sum(own**2) + 1e-30))
    return float(np.mean(np.sum((by_force - own) ** 2, axis=1))), alike
