"""The vector maths of filter steps: plain floats in, tuples out, compiled with numba.

A filter's attitude is ``state[0:4]``, body FRD to earth NED, scalar first. A zero vector means "no sample" and gives a
zero correction. What runs in every step has no call to sin, cos or atan2.
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Mapping
from itertools import accumulate
from typing import Any

__all__ = ["GRAVITY", "down", "field_error", "gravity_error", "half_angle", "turn", "turn_vector_back", "turned_back"]


GRAVITY = 9.80665

# (-1)^n / (2n)! and (-1)^n / (2n + 1)!: as constants, because a division by a constant stays a division.
C1, C2, C3, C4 = -1 / 2, 1 / 24, -1 / 720, 1 / 40320
K1, K2, K3, K4 = -1 / 6, 1 / 120, -1 / 5040, 1 / 362880


def places(sizes: Mapping[str, int]) -> Any:
    """Return where each named part of an array begins: ``S = places(STATE)``, then ``state[S.bias]``."""
    names = [name.lstrip("_") for name in sizes]
    made: Any = namedtuple("Places", names)  # type: ignore[misc]
    return made(*accumulate(list(sizes.values())[:-1], initial=0))


def quaternion(state: Any, at: int) -> tuple[float, float, float, float]:
    """Return the four numbers from ``at`` on."""
    return state[at], state[at + 1], state[at + 2], state[at + 3]


def multiplied(
    p0: float, p1: float, p2: float, p3: float, q0: float, q1: float, q2: float, q3: float
) -> tuple[float, float, float, float]:
    """Return the Hamilton product p (x) q."""
    return (
        p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
        p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
        p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
        p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
    )


def matrix(state: Any, at: int) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return R of the unit quaternion at ``at``, row by row: its rows are the earth axes in body axes."""
    q0, q1, q2, q3 = quaternion(state, at)
    return (
        1.0 - 2.0 * (q2 * q2 + q3 * q3),
        2.0 * (q1 * q2 - q0 * q3),
        2.0 * (q1 * q3 + q0 * q2),
        2.0 * (q1 * q2 + q0 * q3),
        1.0 - 2.0 * (q1 * q1 + q3 * q3),
        2.0 * (q2 * q3 - q0 * q1),
        2.0 * (q1 * q3 - q0 * q2),
        2.0 * (q2 * q3 + q0 * q1),
        1.0 - 2.0 * (q1 * q1 + q2 * q2),
    )


def rotated(q0: float, q1: float, q2: float, q3: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the vector x, y, z turned by the unit quaternion q, body to earth."""
    tx = 2.0 * (q2 * z - q3 * y)
    ty = 2.0 * (q3 * x - q1 * z)
    tz = 2.0 * (q1 * y - q2 * x)
    return x + q0 * tx + q2 * tz - q3 * ty, y + q0 * ty + q3 * tx - q1 * tz, z + q0 * tz + q1 * ty - q2 * tx


def exponential(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the unit quaternion of a rotation vector [rad]."""
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    s = 0.5 * math.sin(half) / half if half > 1e-9 else 0.5
    return math.cos(half), s * x, s * y, s * z


def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float]:
    """Return a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def is_present(v: Any) -> bool:
    """Return whether a vector (3,) holds a sample."""
    return bool(v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0)


def half_angle(s: float) -> tuple[float, float]:
    """Return cos(x) and sin(x)/x of x = sqrt(s) <= 1 by Taylor series, error of the second below s^5/11!.

    That is 1e-16 for 20 deg a step and 2e-11 for 1 rad, the most that the shared loop allows the gyro.
    """
    s2 = s * s
    s4 = s2 * s2
    c = (1.0 + C1 * s) + s2 * (C2 + C3 * s) + C4 * s4
    k = (1.0 + K1 * s) + s2 * (K2 + K3 * s) + K4 * s4
    return c, k


def turn(state: Any, wx: float, wy: float, wz: float, dt: float, first_order: float) -> None:
    """Turn ``state[0:4]`` by the body rate w [rad/s] over dt [s] and renormalise.

    Exact: ``q <- q (x) exp(w dt)``. With ``first_order`` > 0.5 the papers' form
    ``q <- q + dt/2 q (x) (0, w)`` (Lyu 8-10, Fan 3, Xu 6-10). The turn of a step is kept
    below 2 rad: more can only come from absurd gains.
    """
    h = 0.5 * dt
    x, y, z = wx * h, wy * h, wz * h
    s = x * x + y * y + z * z
    if s > 1.0:
        shorter = 2.0 / (1.0 + s)
        x, y, z = x * shorter, y * shorter, z * shorter
        s = s * shorter * shorter
    q0, q1, q2, q3 = quaternion(state, 0)
    square = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3
    if first_order > 0.5:
        # abs() proves to the compiler that this root cannot fail, so that it stays an instruction.
        c = 1.0 / math.sqrt(abs(square * (1.0 + s)))
        k = c
    else:
        # exp() keeps the length, so what rounding left of the last step's is taken out: that is
        # known before the rate is. The series of 1/sqrt(1 + d) does, d is 1e-7 at most.
        d = square - 1.0
        inv = 1.0 - d * (0.5 - 0.375 * d)
        c, k = half_angle(s)
        c = c * inv
        k = k * inv
    x, y, z = x * k, y * k, z * k
    state[0] = q0 * c - q1 * x - q2 * y - q3 * z
    state[1] = q1 * c + q0 * x + q2 * z - q3 * y
    state[2] = q2 * c + q0 * y + q3 * x - q1 * z
    state[3] = q3 * c + q0 * z + q1 * y - q2 * x


def turn_heading(state: Any, c: float, s: float) -> None:
    """Turn the attitude about the earth's down axis by the angle whose half has cosine ``c`` and sine ``s``."""
    q0, q1, q2, q3 = quaternion(state, 0)
    state[0], state[1], state[2], state[3] = c * q0 - s * q3, c * q1 - s * q2, c * q2 + s * q1, c * q3 + s * q0


def down(state: Any) -> tuple[float, float, float]:
    """Return d = R^T e_z, the earth's down axis in body axes as the attitude predicts it."""
    q0, q1, q2, q3 = quaternion(state, 0)
    return 2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), 1.0 - 2.0 * (q1 * q1 + q2 * q2)


def gravity_error(state: Any, acc: Any, by_vector: float) -> tuple[float, float, float]:
    """Return e_g = v x d, the body rotation [rad, sine of the angle] that turns d towards measured gravity.

    ``v = -f/|f|``, or with ``by_vector`` > 0.5 ``v = -f/g``: then a short acceleration
    weighs as much as its opposite later, and both cancel.
    """
    fx, fy, fz = acc[0], acc[1], acc[2]
    norm = math.sqrt(fx * fx + fy * fy + fz * fz)
    norm = GRAVITY if by_vector > 0.5 else norm
    inv = -1.0 / norm if norm > 0.0 else 0.0
    dx, dy, dz = down(state)
    return cross(fx * inv, fy * inv, fz * inv, dx, dy, dz)


def field_error(state: Any, mag: Any, by_vector: float) -> tuple[float, float, float]:
    """Return e_m, the body rotation [rad, sine of the angle] that turns the estimate towards magnetic north.

    Heading form: ``h = R m``, ``e_m = R^T (0, 0, -h_y / |h_xy|)``, so tilt is never touched.
    Vector form (``by_vector`` > 0.5): ``e_m = m/|m| x R^T b/|b|`` with ``b = (|h_xy|, 0, h_z)``.
    """
    mx, my, mz = mag[0], mag[1], mag[2]
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = matrix(state, 0)
    hx = r00 * mx + r01 * my + r02 * mz
    hy = r10 * mx + r11 * my + r12 * mz
    level = math.sqrt(hx * hx + hy * hy)
    if by_vector > 0.5:
        hz = r20 * mx + r21 * my + r22 * mz
        square = mx * mx + my * my + mz * mz
        inv = 1.0 / square if square > 0.0 else 0.0
        bx = (r00 * level + r20 * hz) * inv
        by = (r01 * level + r21 * hz) * inv
        bz = (r02 * level + r22 * hz) * inv
        return cross(mx, my, mz, bx, by, bz)
    sine = -hy / level if level > 0.0 else 0.0
    return sine * r20, sine * r21, sine * r22


def turn_vector_back(v: Any, wx: float, wy: float, wz: float, dt: float) -> None:
    """Turn the earth-fixed vector ``v`` (3,) in body axes on, in place, while the body turns at w over dt."""
    v[0], v[1], v[2] = turned_back(v[0], v[1], v[2], wx, wy, wz, dt)


def turned_back(x: float, y: float, z: float, wx: float, wy: float, wz: float, dt: float) -> tuple[float, float, float]:
    """Return the earth-fixed vector x, y, z in body axes after the body has turned at w over dt."""
    h = -0.5 * dt
    ax, ay, az = wx * h, wy * h, wz * h
    c, k = half_angle(ax * ax + ay * ay + az * az)
    ax, ay, az = ax * k, ay * k, az * k
    tx = 2.0 * (ay * z - az * y)
    ty = 2.0 * (az * x - ax * z)
    tz = 2.0 * (ax * y - ay * x)
    return x + c * tx + ay * tz - az * ty, y + c * ty + az * tx - ax * tz, z + c * tz + ax * ty - ay * tx


# Filters whose state is the rotation matrix itself: it is kept row by row in nine entries of the state from ``at`` on,
# and the quaternion ``state[0:4]`` follows it.


def matrix_from_quaternion(state: Any, at: int) -> None:
    """Write R(q) of ``state[0:4]`` to ``state[at:at+9]``."""
    entries = matrix(state, 0)
    for i in range(9):
        state[at + i] = entries[i]


def quaternion_from_matrix(state: Any, at: int) -> None:
    """Write the quaternion of ``state[at:at+9]`` to ``state[0:4]``, with the sign of the one before.

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
    q0, q1, q2, q3 = quaternion(state, 0)
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
    """Turn the matrix, R <- R exp([w]x dt), or with ``first_order`` > 0.5 R <- R (I + [w]x dt); then orthonormal again.

    Exact is ``R (I + sin(a)/a [w dt]x + (1 - cos(a))/a^2 [w dt]x^2)`` (Rodrigues), a = |w| dt.
    """
    x, y, z = wx * dt, wy * dt, wz * dt
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
    ax, ay, az = state[at], state[at + 1], state[at + 2]
    bx, by, bz = state[at + 3], state[at + 4], state[at + 5]
    half = 0.5 * (ax * bx + ay * by + az * bz)
    ux = ax - half * bx
    uy = ay - half * by
    uz = az - half * bz
    vx = bx - half * ax
    vy = by - half * ay
    vz = bz - half * az
    f = 0.5 * (3.0 - (ux * ux + uy * uy + uz * uz))
    ux, uy, uz = f * ux, f * uy, f * uz
    f = 0.5 * (3.0 - (vx * vx + vy * vy + vz * vz))
    vx, vy, vz = f * vx, f * vy, f * vz
    state[at], state[at + 1], state[at + 2] = ux, uy, uz
    state[at + 3], state[at + 4], state[at + 5] = vx, vy, vz
    state[at + 6], state[at + 7], state[at + 8] = cross(ux, uy, uz, vx, vy, vz)
