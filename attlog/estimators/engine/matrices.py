"""Rotation matrices inside filter steps, for the filters whose state is the matrix itself.

A matrix stands row by row in nine entries of the state from index ``at`` on; its
columns are the body axes in earth axes, its rows the earth axes in body axes. The
quaternion ``state[0:4]`` follows it. As in :mod:`attlog.estimators.engine.vectors`: floats
only, no sin, cos or atan2, no early exit.
"""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.engine.vectors import half_angle


def matrix_from_quaternion(state: Any, at: int) -> None:
    """Write R(q) of ``state[0:4]`` to ``state[at:at+9]``."""
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    state[at] = 1.0 - 2.0 * (q2 * q2 + q3 * q3)
    state[at + 1] = 2.0 * (q1 * q2 - q0 * q3)
    state[at + 2] = 2.0 * (q1 * q3 + q0 * q2)
    state[at + 3] = 2.0 * (q1 * q2 + q0 * q3)
    state[at + 4] = 1.0 - 2.0 * (q1 * q1 + q3 * q3)
    state[at + 5] = 2.0 * (q2 * q3 - q0 * q1)
    state[at + 6] = 2.0 * (q1 * q3 - q0 * q2)
    state[at + 7] = 2.0 * (q2 * q3 + q0 * q1)
    state[at + 8] = 1.0 - 2.0 * (q1 * q1 + q2 * q2)


def quaternion_from_matrix(state: Any, at: int) -> None:
    """Write the quaternion of ``state[at:at+9]`` to ``state[0:4]``, with the sign of the one that stood there.

    The matrix gives all products ``q q^T``; times the last quaternion this is ``q`` up to
    its length. No case distinction, and accurate as long as a step turns by less than half a turn;
    after a larger jump the largest column of ``q q^T`` is taken instead.
    """
    a = state[at]
    b = state[at + 4]
    c = state[at + 8]
    x = state[at + 7] - state[at + 5]
    y = state[at + 2] - state[at + 6]
    z = state[at + 3] - state[at + 1]
    xy = state[at + 1] + state[at + 3]
    xz = state[at + 2] + state[at + 6]
    yz = state[at + 5] + state[at + 7]
    d0 = 1.0 + a + b + c
    d1 = 1.0 + a - b - c
    d2 = 1.0 - a + b - c
    d3 = 1.0 - a - b + c
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    overlap = d0 * q0 * q0 + d1 * q1 * q1 + d2 * q2 * q2 + d3 * q3 * q3
    overlap += 2.0 * (x * q0 * q1 + y * q0 * q2 + z * q0 * q3 + xy * q1 * q2 + xz * q1 * q3 + yz * q2 * q3)
    near = overlap > 0.04
    first = d0 >= d1 and d0 >= d2 and d0 >= d3
    second = d1 >= d2 and d1 >= d3
    third = d2 >= d3
    q0 = q0 if near else (1.0 if first else 0.0)
    q1 = q1 if near else (1.0 if second and not first else 0.0)
    q2 = q2 if near else (1.0 if third and not (first or second) else 0.0)
    q3 = q3 if near else (1.0 if not (first or second or third) else 0.0)
    p0 = d0 * q0 + x * q1 + y * q2 + z * q3
    p1 = x * q0 + d1 * q1 + xy * q2 + xz * q3
    p2 = y * q0 + xy * q1 + d2 * q2 + yz * q3
    p3 = z * q0 + xz * q1 + yz * q2 + d3 * q3
    inv = 1.0 / math.sqrt(p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
    state[0] = p0 * inv
    state[1] = p1 * inv
    state[2] = p2 * inv
    state[3] = p3 * inv


def turn_matrix(state: Any, at: int, wx: float, wy: float, wz: float, dt: float, first_order: float) -> None:
    """R <- R exp([w]x dt), or with ``first_order`` > 0.5 R <- R (I + [w]x dt); then orthonormal again.

    Exact is ``R (I + sin(a)/a [w dt]x + (1 - cos(a))/a^2 [w dt]x^2)`` (Rodrigues), a = |w| dt.
    """
    x = wx * dt
    y = wy * dt
    z = wz * dt
    c, k = half_angle(0.25 * (x * x + y * y + z * z))
    s1 = 1.0 if first_order > 0.5 else k * c
    s2 = 0.0 if first_order > 0.5 else 0.5 * k * k
    for row in range(at, at + 9, 3):
        a = state[row]
        b = state[row + 1]
        d = state[row + 2]
        u = b * z - d * y
        v = d * x - a * z
        w = a * y - b * x
        state[row] = a + s1 * u + s2 * (v * z - w * y)
        state[row + 1] = b + s1 * v + s2 * (w * x - u * z)
        state[row + 2] = d + s1 * w + s2 * (u * y - v * x)
    orthonormalize(state, at)


def orthonormalize(state: Any, at: int) -> None:
    """Make the nearly orthonormal ``state[at:at+9]`` orthonormal (Huang 2.3.1; Premerlani2009).

    The error ``r = r_x . r_y`` is shared by both rows: ``r_x -= r/2 r_y``, ``r_y -= r/2 r_x``;
    each length is brought to one by ``(3 - |r|^2)/2`` (first Taylor term of 1/|r|); ``r_z = r_x x r_y``.
    """
    ax = state[at]
    ay = state[at + 1]
    az = state[at + 2]
    bx = state[at + 3]
    by = state[at + 4]
    bz = state[at + 5]
    half = 0.5 * (ax * bx + ay * by + az * bz)
    ux = ax - half * bx
    uy = ay - half * by
    uz = az - half * bz
    vx = bx - half * ax
    vy = by - half * ay
    vz = bz - half * az
    f = 0.5 * (3.0 - (ux * ux + uy * uy + uz * uz))
    ux = f * ux
    uy = f * uy
    uz = f * uz
    f = 0.5 * (3.0 - (vx * vx + vy * vy + vz * vz))
    vx = f * vx
    vy = f * vy
    vz = f * vz
    state[at] = ux
    state[at + 1] = uy
    state[at + 2] = uz
    state[at + 3] = vx
    state[at + 4] = vy
    state[at + 5] = vz
    state[at + 6] = uy * vz - uz * vy
    state[at + 7] = uz * vx - ux * vz
    state[at + 8] = ux * vy - uy * vx
