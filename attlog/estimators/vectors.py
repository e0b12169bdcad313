"""The vector maths that filter steps are built from: plain floats in, tuples out.

All functions work on ``q = state[0:4]`` (body FRD to earth NED, scalar first) and
compile with numba. They contain no call to sin, cos or atan2 and no early exit:
that is what lets the compiler run many parameter sets side by side in vector
registers (:mod:`attlog.estimators.lanes`). A zero vector means "no sample" and
gives a zero correction.
"""

from __future__ import annotations

import math
from typing import Any

GRAVITY = 9.80665


def half_angle(s: float) -> tuple[float, float]:
    """cos(x) and sin(x)/x of x = sqrt(s), for x <= 1: Taylor series, error below 2e-16.

    The shared loop splits steps that turn by more than 1 rad, so x stays below 0.5
    for any rate; corrections of the largest gains stay below 1.
    """
    c = 1.0 + s * (
        -1.0 / 2.0
        + s
        * (
            1.0 / 24.0
            + s
            * (
                -1.0 / 720.0
                + s
                * (
                    1.0 / 40320.0
                    + s
                    * (-1.0 / 3628800.0 + s * (1.0 / 479001600.0 + s * (-1.0 / 87178291200.0 + s / 20922789888000.0)))
                )
            )
        )
    )
    k = 1.0 + s * (
        -1.0 / 6.0
        + s
        * (
            1.0 / 120.0
            + s
            * (
                -1.0 / 5040.0
                + s
                * (
                    1.0 / 362880.0
                    + s
                    * (
                        -1.0 / 39916800.0
                        + s * (1.0 / 6227020800.0 + s * (-1.0 / 1307674368000.0 + s / 355687428096000.0))
                    )
                )
            )
        )
    )
    return c, k


def turn(state: Any, wx: float, wy: float, wz: float, dt: float, first_order: float) -> None:
    """Turn ``state[0:4]`` by the body rate w [rad/s] over dt [s] and renormalise.

    Exact: ``q <- q (x) exp(w dt)``. With ``first_order`` > 0.5 the papers' form
    ``q <- q + dt/2 q (x) (0, w)`` (Lyu 8-10, Fan 3, Xu 6-10).
    """
    h = 0.5 * dt
    x = wx * h
    y = wy * h
    z = wz * h
    c, k = half_angle(x * x + y * y + z * z)
    c = 1.0 if first_order > 0.5 else c
    k = 1.0 if first_order > 0.5 else k
    x = x * k
    y = y * k
    z = z * k
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    p0 = q0 * c - q1 * x - q2 * y - q3 * z
    p1 = q1 * c + q0 * x + q2 * z - q3 * y
    p2 = q2 * c + q0 * y + q3 * x - q1 * z
    p3 = q3 * c + q0 * z + q1 * y - q2 * x
    inv = 1.0 / math.sqrt(p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
    state[0] = p0 * inv
    state[1] = p1 * inv
    state[2] = p2 * inv
    state[3] = p3 * inv


def down(state: Any) -> tuple[float, float, float]:
    """d = R^T e_z: the earth's down axis in body axes, as the attitude predicts it."""
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    return 2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), 1.0 - 2.0 * (q1 * q1 + q2 * q2)


def gravity_error(state: Any, acc: Any, by_vector: float) -> tuple[float, float, float]:
    """e_g = v x d: the body rotation [rad, sine of the angle] that turns d towards measured gravity.

    ``v = -f/|f|``, or with ``by_vector`` > 0.5 ``v = -f/g``: then a short acceleration
    weighs as much as its opposite later, and both cancel.
    """
    fx = acc[0]
    fy = acc[1]
    fz = acc[2]
    norm = math.sqrt(fx * fx + fy * fy + fz * fz)
    norm = GRAVITY if by_vector > 0.5 else norm
    inv = -1.0 / norm if norm > 0.0 else 0.0
    vx = fx * inv
    vy = fy * inv
    vz = fz * inv
    dx, dy, dz = down(state)
    return vy * dz - vz * dy, vz * dx - vx * dz, vx * dy - vy * dx


def field_error(state: Any, mag: Any, by_vector: float) -> tuple[float, float, float]:
    """e_m: the body rotation [rad, sine of the angle] that turns the estimate towards magnetic north.

    Heading form: ``h = R m``, ``e_m = R^T (0, 0, -h_y / |h_xy|)``, so tilt is never touched.
    Vector form (``by_vector`` > 0.5): ``e_m = m/|m| x R^T b/|b|`` with ``b = (|h_xy|, 0, h_z)``.
    """
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    norm = math.sqrt(mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2])
    inv = 1.0 / norm if norm > 0.0 else 0.0
    mx = mag[0] * inv
    my = mag[1] * inv
    mz = mag[2] * inv
    r00 = 1.0 - 2.0 * (q2 * q2 + q3 * q3)
    r01 = 2.0 * (q1 * q2 - q0 * q3)
    r02 = 2.0 * (q1 * q3 + q0 * q2)
    r10 = 2.0 * (q1 * q2 + q0 * q3)
    r11 = 1.0 - 2.0 * (q1 * q1 + q3 * q3)
    r12 = 2.0 * (q2 * q3 - q0 * q1)
    r20 = 2.0 * (q1 * q3 - q0 * q2)
    r21 = 2.0 * (q2 * q3 + q0 * q1)
    r22 = 1.0 - 2.0 * (q1 * q1 + q2 * q2)
    hx = r00 * mx + r01 * my + r02 * mz
    hy = r10 * mx + r11 * my + r12 * mz
    hz = r20 * mx + r21 * my + r22 * mz
    level = math.sqrt(hx * hx + hy * hy)
    sine = -hy / level if level > 0.0 else 0.0
    bx = r00 * level + r20 * hz
    by = r01 * level + r21 * hz
    bz = r02 * level + r22 * hz
    ex = my * bz - mz * by if by_vector > 0.5 else sine * r20
    ey = mz * bx - mx * bz if by_vector > 0.5 else sine * r21
    ez = mx * by - my * bx if by_vector > 0.5 else sine * r22
    return ex, ey, ez


def turn_vector_back(v: Any, wx: float, wy: float, wz: float, dt: float) -> None:
    """Turn the earth-fixed vector ``v`` (3,) in body axes on, in place, while the body turns at w over dt."""
    h = -0.5 * dt
    x = wx * h
    y = wy * h
    z = wz * h
    c, k = half_angle(x * x + y * y + z * z)
    x = x * k
    y = y * k
    z = z * k
    tx = 2.0 * (y * v[2] - z * v[1])
    ty = 2.0 * (z * v[0] - x * v[2])
    tz = 2.0 * (x * v[1] - y * v[0])
    ux = v[0] + c * tx + y * tz - z * ty
    uy = v[1] + c * ty + z * tx - x * tz
    uz = v[2] + c * tz + x * ty - y * tx
    v[0] = ux
    v[1] = uy
    v[2] = uz
