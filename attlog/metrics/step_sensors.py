"""Rates that aiding of gain 1 by accelerometer and magnetometer would add to a row in steps.

In a multirotor the accelerometer reads thrust, so a filter aided by gravity turns back towards "level" during every
step. The fit of the lag takes these rates out: without them the turning back is read as an early estimate of another
shape. They follow from the row's own attitude and the samples that the filter saw:

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

from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, I1, Out1, Out2
from attlog.core.sorting import median
from attlog.estimators.samples import place
from attlog.estimators.vectors import GRAVITY
from attlog.flight.model import Imu
from attlog.metrics.metric import Case, per_object
from attlog.metrics.step_turning import EventIndex, SummedTurning, event_places
from attlog.metrics.windows import imu_of
from attlog.reference.model import Track
from attlog.segments import model

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Three = tuple[float, float, float]


NAMES = ("E", "D", "N", "EE", "M", "V")
# Prior sigma of the gains, larger ones need much evidence: 1/s, 1/s, deg/s, 1/s^2, 1/s, 1/s.
RIDGE = (3.0, 3.0, 10.0, 1.0, 3.0, 3.0)
FIXED_STEP_DEG = 0.3  # smaller corrections fade
DEG = math.degrees(1.0)


def rotated(w: float, x: float, y: float, z: float, vx: float, vy: float, vz: float) -> Three:
    """Return a vector in body axes in earth axes."""
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return vx + w * tx + (y * tz - z * ty), vy + w * ty + (z * tx - x * tz), vz + w * tz + (x * ty - y * tx)


def rates(
    w: float,
    x: float,
    y: float,
    z: float,
    fx: float,
    fy: float,
    fz: float,
    mx: float,
    my: float,
    mz: float,
    ux: float,
    uy: float,
    uz: float,
) -> tuple[float, float, float, float, float]:
    """Return the rates of E, D, N, M, V in deg/s about a body axis, for one attitude, force and field.

    The axis is turned into the earth, not each correction into the body: one number instead of three.
    """
    dx, dy, dz = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    cx, cy, cz = fy * dz - fz * dy, fz * dx - fx * dz, fx * dy - fy * dx
    norm = math.sqrt(fx * fx + fy * fy + fz * fz)
    scale = GRAVITY / max(norm, 1e-9) if norm > 0.0 else 0.0
    vector = -DEG / GRAVITY * (cx * ux + cy * uy + cz * uz)
    direction = vector * scale
    size = DEG / GRAVITY * scale * math.sqrt(cx * cx + cy * cy + cz * cz)
    fixed = direction / max(size, FIXED_STEP_DEG)
    heading, field = 0.0, 0.0
    if mx != 0.0 or my != 0.0 or mz != 0.0:
        hx, hy, hz = rotated(w, x, y, z, mx, my, mz)
        ex, ey, ez = rotated(w, x, y, z, ux, uy, uz)
        level = math.sqrt(hx * hx + hy * hy)
        sine = hy / max(level, 1e-9) if level > 0.0 else 0.0
        heading = -DEG * sine * (dx * ux + dy * uy + dz * uz)
        field = DEG * (hy * hz * ex + hz * (level - hx) * ey - hy * level * ez)
    return vector, direction, fixed, heading, field


@jit.loop("the aiding in steps")
def summed_aiding(
    out: Out2, axes: F2, begin: I1, first: I1, t: F1, q: F2, f: F2, m: F2, cosine: float, sine: float, trapezoid: int
) -> None:
    """Fill ``out[:, 1:]`` (n, 7) with the turning in deg of E, D, N, EE, M, V since each event's first, about its axis.

    Event e has ``axes[e]`` and the samples ``first[e]`` to ``first[e + 1]`` of ``out``, ``f`` and ``m`` (n, 3), which
    are those from ``begin[e]`` on of ``t`` and ``q``. An attitude's heading is turned by the half angle of ``cosine``
    and ``sine``. What acts over an interval is taken with the attitude at its begin, if ``trapezoid`` at both ends.
    """
    for e in range(len(begin)):
        ux, uy, uz = axes[e, 0], axes[e, 1], axes[e, 2]
        to_k = begin[e] - first[e]
        s0, s1, s2, s3, s4, s5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(first[e], first[e + 1]):
            if i > first[e]:
                k = i + to_k
                h = t[k] - t[k - 1]
                r0, r1, r2, r4, r5 = 0.0, 0.0, 0.0, 0.0, 0.0
                for j in range(k - 1, k + trapezoid):
                    w, z = cosine * q[j, 0] - sine * q[j, 3], cosine * q[j, 3] + sine * q[j, 0]
                    x, y = cosine * q[j, 1] - sine * q[j, 2], cosine * q[j, 2] + sine * q[j, 1]
                    a0, a1, a2, a4, a5 = rates(
                        w, x, y, z, f[i, 0], f[i, 1], f[i, 2], m[i, 0], m[i, 1], m[i, 2], ux, uy, uz
                    )
                    r0, r1, r2, r4, r5 = r0 + a0, r1 + a1, r2 + a2, r4 + a4, r5 + a5
                if trapezoid == 1:
                    h *= 0.5
                s0, s1, s2, s4, s5 = s0 + r0 * h, s1 + r1 * h, s2 + r2 * h, s4 + r4 * h, s5 + r5 * h
                s3 += s0 * (t[k] - t[k - 1])
            out[i, 1], out[i, 2], out[i, 3], out[i, 4], out[i, 5], out[i, 6] = s0, s1, s2, s3, s4, s5


@dataclass(slots=True)
class Vectors:
    """Accelerometer and magnetometer of a row around its events.

    ``f`` (n, 3) m/s^2 and ``m`` (n, 3) (unit length, zero where there is none) act over the interval that ends at each
    sample; they are those of its beginning, where they are compared with the attitude.
    """

    f: Array
    m: Array
    # The row is slower than the IMU: ``f`` is the mean over the interval, for the attitudes at both its ends.
    trapezoid: bool
    # Where the row sees magnetic north on average, rad: its heading is turned back by it.
    north: float = 0.0


def add_turned(out: Array, track: SummedTurning, stack: EventIndex, seen: Vectors, axes: Array) -> None:
    """Fill ``out[:, 1:]`` (n, 7) with the turning in deg that each kind of aiding at gain 1 adds.

    Since an event's first sample, about ``axes`` (events, 3), an axis of the body for each event.
    """
    half = -0.5 * seen.north
    summed_aiding(
        out,
        np.ascontiguousarray(axes),
        *event_places(stack),
        track.t,
        track.q,
        seen.f,
        seen.m,
        math.cos(half),
        math.sin(half),
        int(seen.trapezoid),
    )


# What did a row's filter see of accelerometer and magnetometer around its steps?

# A magnetometer sample is held this long, as in the filters' own loop.
HOLD_PERIODS = 1.5


@jit.loop("the field between its samples")
def held_field(m: Out2, age: Out1, t: F1, rate: F2, new: I1, limit: float) -> None:
    """Turn the field ``m`` (n, 3), known at the samples ``new`` (k,), on with the gyro's ``rate`` (n, 3) rad/s.

    From sample to sample at ``t`` (n,), ``age`` (n,) s since it was measured, until it is older than ``limit`` s.
    """
    for k in range(len(new)):
        source = new[k]
        end = new[k + 1] if k + 1 < len(new) else len(t)
        for i in range(source + 1, end):
            if not t[i] - t[source] <= limit:
                break
            h = t[i] - t[i - 1]
            x, y, z = -rate[i, 0] * h, -rate[i, 1] * h, -rate[i, 2] * h
            half = 0.5 * math.sqrt(x * x + y * y + z * z)
            factor = 0.5 * math.sin(half) / half if half > 1e-9 else 0.5
            m[i, 0], m[i, 1], m[i, 2] = rotated(
                math.cos(half), factor * x, factor * y, factor * z, m[i - 1, 0], m[i - 1, 1], m[i - 1, 2]
            )
            age[i] = t[i] - t[source]


@jit.loop("the sensors in steps")
def seen_at(
    f: Out2,
    m: Out2,
    begin: I1,
    first: I1,
    t: F1,
    seen_t: F1,
    seen_f: F2,
    seen_m: F2,
    age: F1,
    bias: F2,
    trim: F1,
    slow: int,
) -> None:
    """Fill force and field ``f``, ``m`` (n, 3) of the intervals that end at the samples of each event.

    Event e has the samples ``first[e]`` to ``first[e + 1]``, which are those from ``begin[e]`` on of ``t``. The nearest
    sample seen before counts, of ``slow`` rows that at the interval's end, whose force is there already. ``seen_m`` is
    turned by the row's ``bias`` (n, 3) rad/s for its ``age`` s, both by the quaternion ``trim``; not by empty ones.
    """
    last = len(seen_t) - 1
    for e in range(len(begin)):
        to_k = begin[e] - first[e]
        left, right = 0, last + 1
        while left < right:
            middle = (left + right) // 2
            if seen_t[middle] < t[begin[e]] - 1e-6:
                left = middle + 1
            else:
                right = middle
        at = left
        for i in range(first[e], first[e + 1]):
            k = i + to_k
            while at <= last and seen_t[at] < t[k] - 1e-6:
                at += 1
            near = min(max(at if slow == 1 else at - 1, 0), last)
            if slow == 0:
                f[i, 0], f[i, 1], f[i, 2] = seen_f[near, 0], seen_f[near, 1], seen_f[near, 2]
            mx, my, mz = 0.0, 0.0, 0.0
            if len(seen_m) > 0:
                mx, my, mz = seen_m[near, 0], seen_m[near, 1], seen_m[near, 2]
                if len(bias) > 0 and age[near] != 0.0:
                    x, y, z = bias[i, 0] * age[near], bias[i, 1] * age[near], bias[i, 2] * age[near]
                    half = 0.5 * math.sqrt(x * x + y * y + z * z)
                    factor = 0.5 * math.sin(half) / half if half > 1e-9 else 0.5
                    w = math.cos(half)
                    mx, my, mz = rotated(w, factor * x, factor * y, factor * z, mx, my, mz)
            if len(trim) > 0:
                w, x, y, z = trim[0], trim[1], trim[2], trim[3]
                mx, my, mz = rotated(w, x, y, z, mx, my, mz)
                f[i, 0], f[i, 1], f[i, 2] = rotated(w, x, y, z, f[i, 0], f[i, 1], f[i, 2])
            m[i, 0], m[i, 1], m[i, 2] = mx, my, mz


@dataclass(slots=True)
class SensorSamples:
    """An IMU and its magnetometer as the filters' loop takes them, at ``t`` (n,).

    ``f`` (n, 3) specific force; ``m`` (n, 3) the last field direction, turned on with the gyro for 1.5 periods of the
    magnetometer, then zero; ``age`` (n,) s since it was measured, ``new`` (k,) where it was.
    """

    t: Array
    f: Array
    m: Array
    age: Array
    step: float
    new: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


def seen_by(case: Case, row: Track) -> SensorSamples | None:
    """Return the samples of a row's filter; None without a unit and for fewer than two good samples."""
    imu = imu_of(case, row)
    return None if imu is None else samples_of(case, imu, row.uses_mag)


@per_object
def samples_of(case: Case, unit: Imu, with_field: bool) -> SensorSamples | None:
    """Return the samples of a unit; None for fewer than two good ones.

    Without field for filters that use none: to hold it costs more than all the rest.
    """
    t = unit.gyro.t_best if case.reference.alignment.clock == "sample" else unit.gyro.t
    good = np.isfinite(t) & rotation.finite_rows(unit.gyro.x) & rotation.finite_rows(unit.acc.x)
    good[1:] &= t[1:] > np.maximum.accumulate(np.where(good, t, -np.inf))[:-1]
    if good.sum() < 2:
        return None
    t, w, f = (np.ascontiguousarray(x, np.float64) for x in model.select_good(good, t, unit.gyro.x, unit.acc.x))
    found = SensorSamples(t, f, np.zeros((0, 3)), np.zeros(0), float(median(np.diff(t))))
    if with_field and case.log.mag is not None:
        found.m, found.age = np.zeros((len(t), 3)), np.zeros(len(t))
        measured = case.log.mags[case.log.mag].field
        mean = np.concatenate([w[:1], w[1:] if unit.gyro.sampling == "interval" else 0.5 * (w[1:] + w[:-1])])
        _hold(found, mean, place(t, measured.t_best, measured.x))
    return found


def _hold(found: SensorSamples, rate: Array, measured: Array) -> None:
    """Fill in the field, ``measured`` (n, 3) or NaN, turned back by the gyro until it is too old or replaced."""
    size = np.sqrt(np.sum(measured * measured, axis=1))
    new = np.flatnonzero(np.isfinite(size) & (size > 0))
    if len(new) < 2:
        return
    found.new, found.m[new] = new, measured[new] / size[new, None]
    limit = HOLD_PERIODS * float(median(np.diff(found.t[new])))
    held_field(found.m, found.age, found.t, np.ascontiguousarray(rate), new, limit)


class RowSensors:
    """Vectors that the filter of a row saw around its events."""

    def __init__(self, case: Case, row: Track, track: SummedTurning, seen: SensorSamples) -> None:
        self.track, self.seen = track, seen
        self.slow = track.step > 1.5 * seen.step
        trim = case.reference.alignment.trim if row.kind == "replay" else None
        self.back = np.zeros(0) if trim is None else rotation.from_rotvec(trim)
        self.uses_mag = row.uses_mag and len(seen.new) > 0
        self.bias = None if row.bias is None else model.select_good(rotation.finite_rows(row.q), row.bias)[0]
        self.north = self._north() if self.uses_mag else 0.0
        self.impulse = _impulse(seen) if self.slow else None

    def _north(self) -> float:
        """Return where the row sees magnetic north on average, rad."""
        new = self.seen.new
        at = np.searchsorted(self.track.t, self.seen.t[new])
        inside = at < len(self.track.t)
        mean = np.sum(rotation.rotate(self.track.q[at[inside]], self.seen.m[new[inside]]), axis=0)
        return math.atan2(mean[1], mean[0])

    def around(self, stack: EventIndex) -> Vectors:
        """Return force and field over the intervals that end at the stack's samples."""
        f = np.empty((len(stack.index), 3)) if self.impulse is None else self._mean_force(stack, self.impulse)
        m, none = np.empty((len(stack.index), 3)), np.zeros((0, 3))
        field = self.seen.m if self.uses_mag else none
        bias = none if self.bias is None or not self.uses_mag else self.bias[stack.index]
        seen_at(
            f,
            m,
            *event_places(stack),
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

    def _mean_force(self, stack: EventIndex, impulse: Array) -> Array:
        before, now = (self.track.t[np.maximum(k, 0)] for k in (stack.index - 1, stack.index))
        i, j = np.searchsorted(self.seen.t, [before.min(), now.max()])
        near = slice(max(int(i) - 1, 0), int(j) + 1)  # alone: interp would look at the whole flight
        t, area = self.seen.t[near], impulse[near].T
        ends = [np.column_stack([np.interp(at, t, x) for x in area]) for at in (before, now)]
        return np.asarray((ends[1] - ends[0]) / np.maximum(now - before, 1e-9)[:, None])


def _impulse(seen: SensorSamples) -> Array:
    """Return the running integral (n, 3) of the specific force."""
    area = 0.5 * (seen.f[1:] + seen.f[:-1]) * np.diff(seen.t)[:, None]
    return np.concatenate([np.zeros((1, 3)), np.cumsum(area, axis=0)])
