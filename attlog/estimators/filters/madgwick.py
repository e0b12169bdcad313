"""Madgwick's gradient descent filter: a step of fixed length down the slope of gravity and field error.

    f    = ( R(q)^T e_z - v ,  R(q)^T b - m )            v = -f/|f|, m = field / |field|      (25, 29)
    b    = field_scale (sqrt(h_x^2 + h_y^2), 0, h_z),  h = R(q) m                             (45, 46)
    s    = J(q)^T f / |J(q)^T f|                         slope                                (20, 34, 44)
    b_w' = zeta 2 (q* (x) s)_vector                      gyro bias                            (47, 48)
    q'   = q (x) (0, w - b_w)/2 - beta s                                                      (42, 43, 49)

Source: Madgwick2010 (presets ``imu``: beta 0.033, ``marg``: beta 0.041); the gradient descent
that Xu cites as reference 2.

Departures. Signs are those of NED: gravity points to +z. ``code2011`` (beta 0.12,
field_scale 0.5) is the widely copied C code of 2011 (Madgwick2011), whose field reference is half of what
(46) needs; it exists to compare with numbers published for that code. ``integrator = exact``
turns by the gyro with the exponential map and then takes the step down the slope; the report
adds both in one first-order step. Without magnetometer f is its gravity half (6-axis form).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from attlog.estimators.interface import ACC_FORM, AS_PRINTED, INTEGRATOR, Parameter
from attlog.estimators.vectors import GRAVITY, matrix, places, quaternion, turn

SOURCE = "Madgwick2010 20-49"
NEEDS = {"gyro", "acc"}
USES = {"mag"}
STATE = {"q": 4, "bias": 3}
NEAR = "attlog; below Madgwick2010's 0.033 (IMU) and 0.041 (MARG): zeta takes the bias"
PARAMETERS = (
    Parameter("beta", 0.03, "1/s", 0, 100, "step down the slope: corrects at most 2 beta rad/s", NEAR),
    # Half a minute for 2 deg/s; Madgwick2010 49 gives no value.
    Parameter("zeta", 0.0006, "1/s", 0, 10, "step of the gyro bias, at most 2 zeta rad/s^2; 0: none", "attlog"),
    Parameter("field_scale", 1.0, "1", 0.1, 2, "factor on the field reference; code of 2011: 0.5", "Madgwick2010 46"),
    ACC_FORM,
    INTEGRATOR,
)
K = places({p.name: 1 for p in PARAMETERS})
PRESETS = {
    "imu": {"beta": 0.033, "zeta": 0.0, **AS_PRINTED},
    "marg": {"beta": 0.041, "zeta": 0.0, **AS_PRINTED},
    "code2011": {"beta": 0.12, "zeta": 0.0, "field_scale": 0.5, **AS_PRINTED},
}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state: attitude, and no bias yet."""
    state = np.zeros(7)
    state[0:4] = q0
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """Take one update: slope, bias, rate, step down the slope."""
    q0, q1, q2, q3 = quaternion(state, 0)
    s0, s1, s2, s3 = slope(state, acc, mag, params[K.field_scale], params[K.acc_form])
    twice = 2.0 * params[K.zeta] * dt
    state[4] += twice * (q0 * s1 - q1 * s0 - q2 * s3 + q3 * s2)
    state[5] += twice * (q0 * s2 + q1 * s3 - q2 * s0 - q3 * s1)
    state[6] += twice * (q0 * s3 - q1 * s2 + q2 * s1 - q3 * s0)
    wx, wy, wz = gyr[0] - state[4], gyr[1] - state[5], gyr[2] - state[6]
    down = params[K.beta] * dt
    # First order adds both changes before the length is restored, exact turns first.
    h = 0.5 * dt
    p0 = q0 - h * (q1 * wx + q2 * wy + q3 * wz)
    p1 = q1 + h * (q0 * wx + q2 * wz - q3 * wy)
    p2 = q2 + h * (q0 * wy - q1 * wz + q3 * wx)
    p3 = q3 + h * (q0 * wz + q1 * wy - q2 * wx)
    turn(state, wx, wy, wz, dt, 0.0)
    first = params[K.integrator] > 0.5
    p0 = (p0 if first else state[0]) - down * s0
    p1 = (p1 if first else state[1]) - down * s1
    p2 = (p2 if first else state[2]) - down * s2
    p3 = (p3 if first else state[3]) - down * s3
    inv = 1.0 / math.sqrt(p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
    state[0], state[1], state[2], state[3] = p0 * inv, p1 * inv, p2 * inv, p3 * inv


def slope(state: Any, acc: Any, mag: Any, field_scale: float, by_vector: float) -> tuple[float, float, float, float]:
    """Return J^T f / |J^T f| (20, 34), the unit direction of the steepest error; zero without an error."""
    q0, q1, q2, q3 = quaternion(state, 0)
    # Gravity: f_g = R^T e_z - v (25), J_g (26).
    norm = math.sqrt(acc[0] * acc[0] + acc[1] * acc[1] + acc[2] * acc[2])
    use = 1.0 if norm > 0.0 else 0.0
    norm = GRAVITY if by_vector > 0.5 else norm
    inv = -1.0 / norm if norm > 0.0 else 0.0
    f1 = use * (2.0 * (q1 * q3 - q0 * q2) - acc[0] * inv)
    f2 = use * (2.0 * (q0 * q1 + q2 * q3) - acc[1] * inv)
    f3 = use * (1.0 - 2.0 * (q1 * q1 + q2 * q2) - acc[2] * inv)
    s0 = -2.0 * q2 * f1 + 2.0 * q1 * f2
    s1 = 2.0 * q3 * f1 + 2.0 * q0 * f2 - 4.0 * q1 * f3
    s2 = -2.0 * q0 * f1 + 2.0 * q3 * f2 - 4.0 * q2 * f3
    s3 = 2.0 * q1 * f1 + 2.0 * q2 * f2
    # Field: f_b = R^T b - m (29), J_b (30), b from (45, 46).
    norm = math.sqrt(mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2])
    use = 1.0 if norm > 0.0 else 0.0
    inv = 1.0 / norm if norm > 0.0 else 0.0
    mx, my, mz = mag[0] * inv, mag[1] * inv, mag[2] * inv
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = matrix(state, 0)
    hx = mx * r00 + my * r01 + mz * r02
    hy = mx * r10 + my * r11 + mz * r12
    hz = mx * r20 + my * r21 + mz * r22
    bx = field_scale * math.sqrt(hx * hx + hy * hy)
    bz = field_scale * hz
    f1 = use * (bx * r00 + bz * r20 - mx)
    f2 = use * (bx * r01 + bz * r21 - my)
    f3 = use * (bx * r02 + bz * r22 - mz)
    s0 += -2.0 * bz * q2 * f1 + (-2.0 * bx * q3 + 2.0 * bz * q1) * f2 + 2.0 * bx * q2 * f3
    s1 += 2.0 * bz * q3 * f1 + (2.0 * bx * q2 + 2.0 * bz * q0) * f2 + (2.0 * bx * q3 - 4.0 * bz * q1) * f3
    s2 += (
        (-4.0 * bx * q2 - 2.0 * bz * q0) * f1
        + (2.0 * bx * q1 + 2.0 * bz * q3) * f2
        + (2.0 * bx * q0 - 4.0 * bz * q2) * f3
    )
    s3 += (-4.0 * bx * q3 + 2.0 * bz * q1) * f1 + (-2.0 * bx * q0 + 2.0 * bz * q2) * f2 + 2.0 * bx * q1 * f3
    norm = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2 + s3 * s3)
    inv = 1.0 / norm if norm > 0.0 else 0.0
    return s0 * inv, s1 * inv, s2 * inv, s3 * inv
