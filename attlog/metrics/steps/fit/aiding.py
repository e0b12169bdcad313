"""How fast do accelerometer and magnetometer turn a filter? The rates that aiding of gain 1 would add to a row.

In a multirotor the accelerometer reads thrust, so a filter aided by gravity turns back
towards "level" during every step. The fit of the lag takes these rates out:
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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.engine.vectors import GRAVITY
from attlog.kernels.loops import function_of, kernel_of
from attlog.metrics.steps.fit.turning import Stack, SummedTurning, places

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Three = tuple[float, float, float]


NAMES = ("E", "D", "N", "EE", "M", "V")
RIDGE = (3.0, 3.0, 10.0, 1.0, 3.0, 3.0)
"""Gains beyond these are not believed without much evidence: 1/s, 1/s, deg/s, 1/s^2, 1/s, 1/s."""
GRAVITY_AIDING = 4
"""The first of NAMES, which are gravity's."""
FIXED_STEP_DEG = 0.3
DEG = math.degrees(1.0)


SOURCES = ("metrics/steps/fit/aiding.py", "estimators/engine/vectors.py", "kernels")


SUMMED_SIGNATURE = (
    "void(f8[:, ::1], (f8[:, ::1]), (i8[::1]), (i8[::1]), (f8[::1]), (f8[:, ::1]), (f8[:, ::1]), (f8[:, ::1]), "
    "f8, f8, i8)"
)


def rotated(w: float, x: float, y: float, z: float, vx: float, vy: float, vz: float) -> Three:
    """A vector in body axes seen in earth axes."""
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
    """The rates of E, D, N, M, V in deg/s about an axis of the body, for one attitude, force and field.

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


def summed_aiding(
    out: Array,
    axes: Array,
    begin: Index,
    first: Index,
    t: Array,
    q: Array,
    f: Array,
    m: Array,
    cosine: float,
    sine: float,
    trapezoid: int,
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


SUMMED = kernel_of(summed_aiding, SUMMED_SIGNATURE, "metrics", "the aiding in steps", SOURCES)


@dataclass(slots=True)
class Vectors:
    """What the accelerometer and magnetometer showed a row around its events.

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


def add_turned(out: Array, track: SummedTurning, stack: Stack, seen: Vectors, axes: Array) -> None:
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
