"""How fast do accelerometer and magnetometer turn a filter? The rates that aiding of gain 1 would add to a row.

In a multirotor the accelerometer reads thrust, so a filter aided by gravity turns back
towards "level" during every quick movement. The fit of the lag takes these rates out:
without them the turning back is read as an early estimate of another shape. They follow
from the row's own attitude and the samples that the filter saw:

    v = -f / g    d = R^T e_z    h = R m / |m|    L = |h_xy|
    E   v x d                          gravity, vector form (Mahony2008)
    D   -f/|f| x d                     gravity, direction form
    N   D / max(|D|, 0.3 deg) x 1 deg  steps of fixed size (Madgwick2010)
    EE  the running integral of E      second order, through a bias
    M   -(h_y / L) d                   heading only
    V   R^T (h_y h_z, h_z (L - h_x), -h_y L)   field, vector form
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.estimators.engine.samples import place
from attlog.flight.model import Imu
from attlog.kernels.loops import function_of
from attlog.metrics.base import Case, per_case, per_row
from attlog.metrics.evidence.aiding_loop import HELD, SEEN, SUMMED, held_field, seen_at, summed_aiding
from attlog.metrics.evidence.samples import imu_of, logged_unit
from attlog.metrics.steps.turning import Stack, Turning, places
from attlog.reference.model import Row
from attlog.segments import gaps

Array = NDArray[np.float64]

NAMES = ("E", "D", "N", "EE", "M", "V")
RIDGE = (3.0, 3.0, 10.0, 1.0, 3.0, 3.0)
"""Gains beyond these are not believed without much evidence: 1/s, 1/s, deg/s, 1/s^2, 1/s, 1/s."""
GRAVITY_AIDING = 4
"""The first of NAMES, which are gravity's."""
HOLD_PERIODS = 1.5
"""A magnetometer sample is held this long, as in the filters' own loop."""


@dataclass(slots=True)
class Vectors:
    """What the accelerometer and magnetometer told a row around its events.

    ``f`` (n, 3) m/s^2 and ``m`` (n, 3) (unit length, zero where there is none) act over the
    interval that ends at each sample of the stack; they are those of its beginning, where they
    are compared with the attitude.
    """

    f: Array
    m: Array
    trapezoid: bool
    """The row is slower than the IMU: ``f`` is the mean over the interval, for the attitudes at both its ends."""
    north: float = 0.0
    """Where the row sees magnetic north on average, rad: its heading is turned back by it."""


def add_turned(out: Array, track: Turning, stack: Stack, seen: Vectors, axes: Array) -> None:
    """Fill ``out[:, 1:]`` (n, 7) with the turning in deg that each kind of aiding at gain 1 adds.

    Since an event's first sample, about ``axes`` (events, 3), an axis of the body for each event.
    """
    half = -0.5 * seen.north
    function_of(SUMMED, summed_aiding)(
        out,
        np.ascontiguousarray(axes),
        *places(stack),
        track.t,
        track.q,
        seen.f,
        seen.m,
        math.cos(half),
        math.sin(half),
        int(seen.trapezoid),
    )


@dataclass(slots=True)
class Samples:
    """An IMU and its magnetometer as the filters' loop takes them, at ``t`` (n,).

    ``f`` (n, 3) specific force; ``m`` (n, 3) the last field direction, turned on with the
    gyro for 1.5 periods of the magnetometer, then zero; ``age`` (n,) s since it was measured,
    ``new`` (k,) where it was.
    """

    t: Array
    f: Array
    m: Array
    age: Array
    step: float
    new: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


def seen_by(case: Case, row: Row) -> Samples | None:
    """What a row's filter saw of its unit; None without one and for fewer than two good samples."""
    imu = imu_of(case, row)
    if imu is None:
        return None
    index = logged_unit(case, imu)
    return _of_own_samples(case, row) if index is None else samples_of(case, index, row.uses_mag)


@per_case
def samples_of(case: Case, imu: int, with_field: bool) -> Samples | None:
    """What the filters saw of one of the log's units; None for fewer than two good samples.

    Without field for filters that use none: to hold it costs more than all the rest.
    """
    return _samples(case, case.log.imus[imu], with_field)


@per_row
def _of_own_samples(case: Case, row: Row) -> Samples | None:
    return None if row.imu is None else _samples(case, row.imu, row.uses_mag)


def _samples(case: Case, unit: Imu, with_field: bool) -> Samples | None:
    t = unit.gyro.t_best if case.reference.clock == "sample" else unit.gyro.t
    good = np.isfinite(t) & rotation.finite(unit.gyro.x) & rotation.finite(unit.acc.x)
    good[1:] &= t[1:] > np.maximum.accumulate(np.where(good, t, -np.inf))[:-1]
    if good.sum() < 2:
        return None
    t, w, f = (np.ascontiguousarray(x, np.float64) for x in gaps.only(good, t, unit.gyro.x, unit.acc.x))
    found = Samples(t, f, np.zeros((0, 3)), np.zeros(0), float(np.median(np.diff(t))))
    if with_field and case.log.mag is not None:
        found.m, found.age = np.zeros((len(t), 3)), np.zeros(len(t))
        measured = case.log.mags[case.log.mag].field
        mean = np.concatenate([w[:1], w[1:] if unit.gyro.sampling == "interval" else 0.5 * (w[1:] + w[:-1])])
        _hold(found, mean, place(t, measured.t_best, measured.x))
    return found


def _hold(found: Samples, rate: Array, measured: Array) -> None:
    """Fill in the field, ``measured`` (n, 3) or NaN: each sample is turned back by the gyro, sample for sample, until
    it is too old or replaced."""
    size = np.sqrt(np.sum(measured * measured, axis=1))
    new = np.flatnonzero(np.isfinite(size) & (size > 0))
    if len(new) < 2:
        return
    found.new, found.m[new] = new, measured[new] / size[new, None]
    limit = HOLD_PERIODS * float(np.median(np.diff(found.t[new])))
    function_of(HELD, held_field)(found.m, found.age, found.t, np.ascontiguousarray(rate), new, limit)


class Sensors:
    """The vectors that the filter of a row saw, asked around its events."""

    def __init__(self, case: Case, row: Row, track: Turning, seen: Samples) -> None:
        self.track, self.seen = track, seen
        self.slow = track.step > 1.5 * seen.step
        trim = case.reference.trim if row.kind == "replay" else None
        self.back = np.zeros(0) if trim is None else rotation.from_rotvec(trim)
        self.uses_mag = row.uses_mag and len(seen.new) > 0
        self.bias = None if row.bias is None else gaps.only(rotation.finite(row.q), row.bias)[0]
        self.north = self._north() if self.uses_mag else 0.0
        self.impulse = _impulse(seen) if self.slow else None

    def _north(self) -> float:
        """Where the row sees magnetic north on average, rad."""
        new = self.seen.new
        at = np.searchsorted(self.track.t, self.seen.t[new])
        inside = at < len(self.track.t)
        mean = np.sum(rotation.rotate(self.track.q[at[inside]], self.seen.m[new[inside]]), axis=0)
        return math.atan2(mean[1], mean[0])

    def around(self, stack: Stack) -> Vectors:
        """Force and field over the intervals that end at the stack's samples."""
        f = np.empty((len(stack.index), 3)) if self.impulse is None else self._mean_force(stack, self.impulse)
        m, none = np.empty((len(stack.index), 3)), np.zeros((0, 3))
        field = self.seen.m if self.uses_mag else none
        bias = none if self.bias is None or not self.uses_mag else self.bias[stack.index]
        function_of(SEEN, seen_at)(
            f,
            m,
            *places(stack),
            self.track.t,
            self.seen.t,
            self.seen.f,
            field,
            self.seen.age,
            bias,
            self.back,
            int(self.slow),
        )
        return Vectors(f, m, self.slow, self.north)

    def _mean_force(self, stack: Stack, impulse: Array) -> Array:
        before, now = (self.track.t[np.maximum(k, 0)] for k in (stack.index - 1, stack.index))
        i, j = np.searchsorted(self.seen.t, [before.min(), now.max()])
        near = slice(max(int(i) - 1, 0), int(j) + 1)  # alone: interp would look at the whole flight
        t, area = self.seen.t[near], impulse[near].T
        ends = [np.column_stack([np.interp(at, t, x) for x in area]) for at in (before, now)]
        return np.asarray((ends[1] - ends[0]) / np.maximum(now - before, 1e-9)[:, None])


def _impulse(seen: Samples) -> Array:
    """The running integral (n, 3) of the specific force."""
    area = 0.5 * (seen.f[1:] + seen.f[:-1]) * np.diff(seen.t)[:, None]
    return np.concatenate([np.zeros((1, 3)), np.cumsum(area, axis=0)])
