"""The loops behind :mod:`attlog.metrics.evidence.aiding`.

What a filter saw, and aiding rates summed since an event's first.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.engine.vectors import GRAVITY
from attlog.kernels.loops import kernel_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Three = tuple[float, float, float]

FIXED_STEP_DEG = 0.3
DEG = math.degrees(1.0)
SOURCES = ("metrics/evidence/aiding_loop.py", "estimators/engine/vectors.py", "kernels")
HELD_SIGNATURE = "void(f8[:, ::1], f8[::1], (f8[::1]), (f8[:, ::1]), (i8[::1]), f8)"
SEEN_SIGNATURE = (
    "void(f8[:, ::1], f8[:, ::1], (i8[::1]), (i8[::1]), (f8[::1]), (f8[::1]), (f8[:, ::1]), (f8[:, ::1]), (f8[::1]), "
    "(f8[:, ::1]), (f8[::1]), i8)"
)
SUMMED_SIGNATURE = (
    "void(f8[:, ::1], (f8[:, ::1]), (i8[::1]), (i8[::1]), (f8[::1]), (f8[:, ::1]), (f8[:, ::1]), (f8[:, ::1]), "
    "f8, f8, i8)"
)


def rotated(w: float, x: float, y: float, z: float, vx: float, vy: float, vz: float) -> Three:
    """A vector in body axes seen in earth axes."""
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return vx + w * tx + (y * tz - z * ty), vy + w * ty + (z * tx - x * tz), vz + w * tz + (x * ty - y * tx)


def held_field(m: Array, age: Array, t: Array, rate: Array, new: Index, limit: float) -> None:
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


def seen_at(
    f: Array,
    m: Array,
    begin: Index,
    first: Index,
    t: Array,
    seen_t: Array,
    seen_f: Array,
    seen_m: Array,
    age: Array,
    bias: Array,
    trim: Array,
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


HELD = kernel_of(held_field, HELD_SIGNATURE, "metrics", "the field between its samples", SOURCES)
SEEN = kernel_of(seen_at, SEEN_SIGNATURE, "metrics", "the sensors in quick movements", SOURCES)
SUMMED = kernel_of(summed_aiding, SUMMED_SIGNATURE, "metrics", "the aiding of quick movements", SOURCES)
