"""How late are GNSS and compass against the inertial samples? By an attitude that both are compared with.

GNSS: with attitude R, force f and gravity g, the velocity is the integral of ``R f + g``. Between fixes 2 s apart it
changes by ``V(t_j - tau) - V(t_i - tau)``; linear in a change of tau, a turn of the attitude about the vertical and a
constant force. Compass: the field is ``R(t - tau)' h``, linear in tau, a turn, a scale and an offset. Gauss-Newton
with Huber weights; the standard errors are clustered by 5 s (:mod:`attlog.health.fits.regression`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Array, Gnss, Imu
from attlog.health.fits.regression import RobustFit, fit
from attlog.segments.spans import Span, inside

OVER_S, WITHIN_S = 2.0, 0.7
"""Velocities change over so long, give or take."""
BROKEN_S = 0.1
"""Force is not integrated across a longer hole between inertial samples."""
FIX_3D = 3
FEWEST, LONGEST_S = 30, 0.6
PASSES, DONE_S = 8, 5e-4
SLOPE_S = 0.02
"""Derivatives are differences over twice so long."""


@dataclass(frozen=True, slots=True)
class AttitudePath:
    """Attitudes ``q`` (n, 4) of the replayed IMU at ``t`` (n,) s; ``segment`` (n,) numbers what is between gaps."""

    t: Array
    q: Array
    segment: NDArray[np.int64] | None
    name: str


@dataclass(frozen=True, slots=True)
class DelayFit:
    """A delay and its standard error in s; ``halves`` are those of both halves of the flight.

    ``turn_deg`` is the turn of the attitude about the vertical that fits best. ``moving``: RMS of what shows the
    delay, m/s^2 or uT/s. ``n`` samples in ``seconds``.
    """

    delay: float
    sigma: float
    halves: tuple[float, float]
    turn_deg: float
    moving: float
    n: int
    seconds: float


Equations = Callable[[float], tuple[Array, Array, Array]]
"""At a delay in s: times (n,), columns (n, k, p), the first two those of delay and turn, and the rest (n, k)."""


def gnss(imu: Imu, receiver: Gnss, path: AttitudePath, flown: list[Span], guess: float) -> DelayFit | None:
    """How late the velocities of a receiver are against its own time of receipt; None where too little tells."""
    s, velocity, broken = _integral(imu, path, flown)
    t = receiver.t if receiver.received is None else receiver.received
    fixed = (receiver.fix >= FIX_3D) & np.isfinite(receiver.vel_ned[:, :2]).all(axis=1) & np.isfinite(t)
    t, v = t[fixed], receiver.vel_ned[fixed, :2]
    rising = np.flatnonzero(np.diff(t, prepend=-np.inf) > 0.0)
    t, v = t[rising], v[rising]
    if len(t) < FEWEST or len(s) < FEWEST:
        return None
    i = np.arange(len(t))
    j = np.searchsorted(t, t + OVER_S)
    i, j = i[j < len(t)], j[j < len(t)]
    use = (np.abs(t[j] - t[i] - OVER_S) < WITHIN_S) & inside(t[i], flown) & inside(t[j], flown)
    i, j = i[use], j[use]

    def at(when: Array) -> Array:
        return np.column_stack([np.interp(when, s, velocity[:, k]) for k in range(2)])

    def slope(when: Array) -> Array:
        return np.asarray((at(when + SLOPE_S) - at(when - SLOPE_S)) / (2.0 * SLOPE_S))

    def equations(tau: float) -> tuple[Array, Array, Array]:
        a, b = t[i] - tau, t[j] - tau
        whole: NDArray[np.bool_] = (a - SLOPE_S > s[0]) & (b + SLOPE_S < s[-1])
        first, last = np.searchsorted(s, a - SLOPE_S, side="right"), np.searchsorted(s, b + SLOPE_S)
        whole &= broken[np.minimum(last, len(s) - 1)] == broken[np.maximum(first - 1, 0)]
        a, b = a[whole], b[whole]
        change, apart = at(b) - at(a), (b - a)
        columns = np.zeros((len(a), 2, 4))
        columns[:, :, 0] = slope(a) - slope(b)
        columns[:, 0, 1], columns[:, 1, 1] = -change[:, 1], change[:, 0]
        columns[:, 0, 2], columns[:, 1, 3] = apart, apart
        return t[i][whole], columns, v[j][whole] - v[i][whole] - change

    return _solved(equations, guess)


def compass(t: Array, field: Array, earth: Array, path: AttitudePath) -> DelayFit | None:
    """How late a field (n, 3) uT at ``t`` (n,) s is against the attitude; ``earth`` (3,) uT north, east, down."""
    across = np.array([-earth[1], earth[0], 0.0])

    def expected(when: Array, what: Array) -> Array:
        q, _ = rotation.interpolated(path.t, path.q, path.segment, when)
        return rotation.rotate_inverse(q, np.broadcast_to(what, (len(when), 3)))

    def equations(tau: float) -> tuple[Array, Array, Array]:
        when = t - tau
        u = expected(when, earth)
        slope = (expected(when + SLOPE_S, earth) - expected(when - SLOPE_S, earth)) / (2.0 * SLOPE_S)
        columns = np.zeros((len(t), 3, 6))
        columns[:, :, 0], columns[:, :, 1], columns[:, :, 2] = -slope, expected(when, across), u
        columns[:, :, 3:] = np.eye(3)
        known = np.isfinite(u + slope + field).all(axis=1)
        return t[known], columns[known], (field - u)[known]

    return _solved(equations, 0.0)


def _integral(imu: Imu, path: AttitudePath, flown: list[Span]) -> tuple[Array, Array, Array]:
    """Times (n,) s when the force was felt, its integral (n, 2) m/s north and east, and the holes up to each."""
    begin, end = (flown[0][0] - 2.0, flown[-1][1] + 2.0) if flown else (0.0, -1.0)
    stamps = imu.acc.t_best
    use = np.flatnonzero((stamps >= begin) & (stamps <= end))
    s = stamps[use] - imu.acc.delay
    q, _ = rotation.interpolated(path.t, path.q, path.segment, s)
    force = rotation.rotate(q, imu.acc.x[use])[:, :2]
    known: NDArray[np.bool_] = rotation.finite(force)
    force = np.where(known[:, None], force, 0.0)
    dt = np.diff(s, prepend=s[:1])
    mean = force if imu.acc.sampling == "interval" else 0.5 * (force + np.vstack([force[:1], force[:-1]]))
    broken = ~known | (dt > BROKEN_S) | (dt < 0.0)
    return s, np.cumsum(mean * dt[:, None], axis=0), np.cumsum(broken).astype(np.float64)


def _solved(equations: Equations, guess: float) -> DelayFit | None:
    """The delay at which nothing is left to change."""
    before = guess
    for _ in range(PASSES):
        t, columns, rest = equations(before)
        solution = _fit(t, columns, rest)
        if solution is None:
            return None
        found: RobustFit = solution
        tau = before + float(found.x[0])
        if abs(tau) > LONGEST_S:
            return None
        if abs(tau - before) < DONE_S:
            break
        before = tau
    half = len(t) // 2
    parts = [_fit(t[k], columns[k], rest[k]) for k in (slice(None, half), slice(half, None))]
    one, two = (np.nan if part is None else before + float(part.x[0]) for part in parts)
    moving = float(np.sqrt(np.mean(np.sum(columns[:, :, 0] ** 2, axis=1))))
    turn = float(np.degrees(found.x[1]))
    seconds = float(np.minimum(np.diff(t), OVER_S).sum())
    return DelayFit(tau, float(found.sigma[0]), (one, two), turn, moving, len(t), seconds)


def _fit(t: Array, columns: Array, rest: Array) -> RobustFit | None:
    return fit(t, columns, rest) if len(t) >= FEWEST else None
