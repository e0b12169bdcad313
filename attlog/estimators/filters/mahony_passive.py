"""Mahony's passive complementary filter: follows an attitude rebuilt from gravity and field.

    R_y  = argmin  l1 |e_z - R v|^2 + l2 |v_m* - R v_m|^2        (7)  Wahba's problem, v = -f/|f|
    w    = vex(Pa(R^T R_y)),  Pa(A) = (A - A^T)/2                (10)
    w   += (mag_gain - 1) (w.d) d,  d = R^T e_z                  mag_gain 1 is the papers'
    b'   = -ki w                                                 (9)
    R'   = R [Omega - b + kp w]x                                 (8)

Source: Huang 7-10 (preset ``huang``: kp 0.3, ki 0.01); Mahony2008,
equations 13 (passive filter). Wahba's problem with two vectors has a closed solution
(Markley2002, equations 13 and 22):

    R_y = r_3 b_3^T + sum over i = 1, 2 of  a_i / lambda (r_i b_i^T + (r_i x r_3)(b_i x b_3)^T)
    lambda^2 = a_1^2 + a_2^2 + 2 a_1 a_2 ((b_1.b_2)(r_1.r_2) + |b_1 x b_2| |r_1 x r_2|)

with b_i measured in the body, r_i expected in the earth, b_3, r_3 the unit cross products.
With l1 >> l2 it is TRIAD: gravity gives the tilt, the field only heading.

Departures. Huang (4) has v_a ~ -R^T e_z and yet (7) compares e_z with R v_a: one sign is
wrong; v here points down. v_m* is the field turned to the earth by the estimate with its
east part removed, so no dip need be known. Where the field is missing (or points along
gravity) w = v x d, gravity alone.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from attlog.estimators.interface import INTEGRATOR, MAG_GAIN, Parameter
from attlog.estimators.vectors import matrix_from_quaternion, quaternion_from_matrix, turn_matrix

SOURCE = "Huang 7-10; Mahony2008 13; Markley2002 13 and 22"
NEEDS = {"gyro", "acc", "mag"}
STATE = {"q": 4, "bias": 3, "_matrix": 9}
PARAMETERS = (
    Parameter(
        "kp",
        0.2,
        "1/s",
        0,
        100,
        "gain of the error: large follows accelerometer and magnetometer, small the gyro",
        "attlog; below Huang's 0.3 (tables 2 and 3): it follows directions, in which accelerations do not average out",
    ),
    Parameter(
        "ki",
        0.003,
        "1/s^2",
        0,
        10,
        "gain of the gyro bias estimate; 0 estimates none",
        "attlog; below Huang's 0.01 (tables 2 and 3), which turns accelerations of half a minute into bias",
    ),
    Parameter("l1", 1.0, "1", 1e-6, 1e6, "weight of gravity in the rebuilt attitude", "attlog; only l1 / l2 counts"),
    Parameter(
        "l2",
        0.01,
        "1",
        1e-6,
        1e6,
        "weight of the field: small keeps a disturbed field out of roll and pitch",
        "attlog; Huang gives no value",
    ),
    replace(
        MAG_GAIN,
        default=0.5,
        source="attlog; as mahony",
        meaning="weight of the error about the vertical, which the field alone tells; 1 as in the papers, 0 leaves "
        "heading to the gyro",
    ),
    INTEGRATOR,
)
PRESETS = {"huang": {"kp": 0.3, "ki": 0.01, "mag_gain": 1.0, "integrator": "first_order"}}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude as quaternion and matrix, and no bias yet."""
    state = np.zeros(16)
    state[0:4] = q0
    matrix_from_quaternion(state, 7)
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """One update: rebuilt attitude, error, bias, rate, matrix, and the quaternion that follows it."""
    kp = params[0]
    ki = params[1]
    ex, ey, ez = rebuilt_error(state, params[2], params[3], acc, mag)
    # The part along d is heading; gravity has none there.
    more = (params[4] - 1.0) * (ex * state[13] + ey * state[14] + ez * state[15])
    ex += more * state[13]
    ey += more * state[14]
    ez += more * state[15]
    state[4] -= ki * ex * dt
    state[5] -= ki * ey * dt
    state[6] -= ki * ez * dt
    wx = gyr[0] - state[4] + kp * ex
    wy = gyr[1] - state[5] + kp * ey
    wz = gyr[2] - state[6] + kp * ez
    turn_matrix(state, 7, wx, wy, wz, dt, params[5])
    quaternion_from_matrix(state, 7)


def rebuilt_error(state: Any, l1: float, l2: float, acc: Any, mag: Any) -> tuple[float, float, float]:
    """w = vex(Pa(R^T R_y)) (10): the body rotation [rad, sine of the angle] from the estimate to the rebuilt attitude.

    With ``c_i = R^T r_i``, the expected vectors in estimated body axes, R^T R_y is the sum of
    products ``c b^T`` and the vector of each is ``vex(Pa(c b^T)) = (b x c)/2``.
    """
    dx = state[13]
    dy = state[14]
    dz = state[15]
    vx, vy, vz = unit(-acc[0], -acc[1], -acc[2])
    mx, my, mz = unit(mag[0], mag[1], mag[2])
    # v_m* in body axes: the measured field with its east part turned into north.
    hx = state[7] * mx + state[8] * my + state[9] * mz
    hy = state[10] * mx + state[11] * my + state[12] * mz
    hz = dx * mx + dy * my + dz * mz
    level = math.sqrt(hx * hx + hy * hy)
    fx = level * state[7] + hz * dx
    fy = level * state[8] + hz * dy
    fz = level * state[9] + hz * dz
    # Third axis of both pairs: gravity x field.
    px, py, pz, measured = unit_cross(vx, vy, vz, mx, my, mz)
    rx, ry, rz, expected = unit_cross(dx, dy, dz, fx, fy, fz)
    cosines = (vx * mx + vy * my + vz * mz) * (dx * fx + dy * fy + dz * fz)
    scale = math.sqrt(l1 * l1 + l2 * l2 + 2.0 * l1 * l2 * (cosines + measured * expected))
    a1 = l1 / scale if scale > 0.0 else 0.0
    a2 = l2 / scale if scale > 0.0 else 0.0
    ax, ay, az = pair_error(vx, vy, vz, px, py, pz, dx, dy, dz, rx, ry, rz)
    bx, by, bz = pair_error(mx, my, mz, px, py, pz, fx, fy, fz, rx, ry, rz)
    ex = a1 * ax + a2 * bx + 0.5 * (py * rz - pz * ry)
    ey = a1 * ay + a2 * by + 0.5 * (pz * rx - px * rz)
    ez = a1 * az + a2 * bz + 0.5 * (px * ry - py * rx)
    both = measured > 0.0 and expected > 0.0
    gx = vy * dz - vz * dy
    gy = vz * dx - vx * dz
    gz = vx * dy - vy * dx
    return ex if both else gx, ey if both else gy, ez if both else gz


def unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """The unit vector; a zero vector stays zero."""
    norm = math.sqrt(x * x + y * y + z * z)
    inv = 1.0 / norm if norm > 0.0 else 0.0
    return x * inv, y * inv, z * inv


def unit_cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float, float]:
    """The direction of a x b and its length; zero vectors and parallel ones give zero."""
    x = ay * bz - az * by
    y = az * bx - ax * bz
    z = ax * by - ay * bx
    norm = math.sqrt(x * x + y * y + z * z)
    inv = 1.0 / norm if norm > 1e-9 else 0.0
    return x * inv, y * inv, z * inv, norm if norm > 1e-9 else 0.0


def pair_error(
    bx: float,
    by: float,
    bz: float,
    px: float,
    py: float,
    pz: float,
    cx: float,
    cy: float,
    cz: float,
    rx: float,
    ry: float,
    rz: float,
) -> tuple[float, float, float]:
    """(b x c)/2 + ((b x p) x (c x r))/2: the share of one vector pair in (10); p and r are the third axes."""
    ux = by * pz - bz * py
    uy = bz * px - bx * pz
    uz = bx * py - by * px
    sx = cy * rz - cz * ry
    sy = cz * rx - cx * rz
    sz = cx * ry - cy * rx
    return (
        0.5 * (by * cz - bz * cy + uy * sz - uz * sy),
        0.5 * (bz * cx - bx * cz + uz * sx - ux * sz),
        0.5 * (bx * cy - by * cx + ux * sy - uy * sx),
    )
