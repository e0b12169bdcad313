"""MEKF: error-state Kalman filter that expects a body not to fly away, not that it does not accelerate.

    q, b (gyro bias), M (3x3 gyro matrix), ba (accelerometer bias), v_N, v_E, d and home (headings of the field)
    w    = (I + M)(gyro - b)       q <- q (x) exp(w dt)                                             (1)
    a    = R (f - ba - V')         v <- v + (a_N, a_E) dt,  V' by airspeed: ``aids.py``       (2)
    error x = [theta (earth axes), db, dM, dba, dv, dd, dhome],  R_true = (I + [theta]x) R                 (3)
    theta <- theta - A db + B dM,  A = int R dt,  B = int R dw/dM dt                                (4)
    v_N  <- v_N + S_z theta_y - (A dba)_N,   v_E <- v_E - S_z theta_x - (A dba)_E,   S = int a dt   (5)
    velocity is 0 +- sigma_v:      z = -v,       R = (sv^2 + kv <v^2>) 0.5 s / T,  at rest svr^2    (6)
    at rest the rate is 0:         z = gyro - b                                                     (7)
    magnetometer, heading only:    z = d - psi,  psi = atan2(h_E, h_N),  h = R m,  R = sm^2 / T     (8)

Source: Markley2003 for the multiplicative error; velocity in place of gravity, gyro matrix and the magnetometer's
calibration are attlog's; the tests of norm and dip of the field follow Laidig2023.

Accelerations of a body that does not fly away average to zero as vectors in the earth frame. A direction of gravity
takes every one of them for a tilt; (2) integrates them to a velocity that is small. In (5) the terms that tie velocity
to heading are left out: the true velocity is unknown, so an acceleration shows no heading. The magnetometer corrects
heading, gyro (bias, scale, axes) and d only; the tilt's part in psi enters the covariance, not the gain (Schmidt).
Delay and body-fixed offset of the magnetometer are found beside the filter (``inertial/compass.py``). d, the local
field's direction relative to magnetic north, changes while the body moves about; by default it is 0. home is the
field's heading at the first rest, which the smoother measures again at later rests in the same field. How large an
accelerometer bias may be is estimated on the way: calibrated sensors keep a tight prior, raw ones get room.

Of a plane with airspeed, v is the velocity beside airspeed along the nose: sideslip, angle of
attack, gusts. It walks at random while the plane flies.

The first ``align_time`` seconds vectors are averaged in axes that the gyro holds still, so that a start in the middle
of a motion does no harm; tilt and velocity are less certain there. Of a start attitude that is given only the heading
counts, and only without magnetometer. The covariance moves in blocks of ``block`` seconds, the attitude at every
sample.

``sigma_tilt`` is that of the angle between true and estimated vertical (two axes together), ``sigma_heading`` that of
the heading, both in rad: of the covariance, and of what it leaves out (``inertial/compass.py``).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from attlog.estimators.aids import AIRSPEED, AIRSPEED_AGE, NEVER, TRUE_AIRSPEED, update_airspeed, without_acceleration
from attlog.estimators.filters.inertial.compass import (
    add_slow_variance,
    correct_reach,
    fade_slow,
    field,
    residual_sigmas,
    weigh_slow,
)
from attlog.estimators.filters.inertial.model import (
    ALIGNING,
    MOVING_RATE,
    PARAMETERS,
    RAD,
    STATE,
    E,
    K,
    N,
    S,
    product,
    square,
    turn_earth,
)
from attlog.estimators.filters.inertial.start import align, look_for_rest
from attlog.estimators.vectors import is_present, matrix, turn

__all__ = ["PARAMETERS", "PRESETS", "STATE", "start", "step"]

SOURCE = "Markley2003; Laidig2023"
NEEDS = {"gyro", "acc"}
USES = {"mag", "airspeed"}
HOLD_MAG = False
VECTORS_AT = "end"
PRESETS: dict[str, dict[str, float | str]] = {
    "smoother": {
        "rate_noise": 0.0004,
        "gyro_noise": 0.02,
        "bias_sigma": 1.5,
        "velocity_sigma": 0.3,
        "velocity_factor": 4.0,
        "acc_bias_sigma": 0.02,
        "misalignment_sigma": 0.0018,
        "mag_noise": 8.0,
        "field_sigma": 4.5,
        "home_noise": 1.2,
        "acc_bias_considered": 0.1,
        "moving_sigma": 2.0,
    }
}
# How often the size of accelerometer bias is asked for [s].
EXPECT_EVERY = 5.0
# Widest prior of an accelerometer bias [m/s^2]; wider ones took what a hand or an alias did for 1.4 m/s^2 (9 deg).
# EuRoC's raw 0.1 m/s^2 is found all the same.
MAX_ACC_BIAS_SIGMA = 0.05
# Random walk of the air about a plane [m/s/sqrt(s)]: gusts of 1 m/s that last for 10 s.
WIND_WALK = 0.4
# At rest: sigma of velocity [m/s], noise density of the rate [rad/s*sqrt(s)].
REST_VELOCITY, REST_RATE = 0.02, 0.06 * RAD


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state before the first sample; the alignment finds all but the attitude."""
    state = np.zeros(sum(STATE.values()))
    state[S.air + AIRSPEED_AGE] = NEVER
    state[0:4] = q0
    state[S.attitude : S.M] = q0
    state[S.sigma_tilt] = math.sqrt(2.0) * RAD * params[K.tilt_sigma]
    state[S.sigma_heading] = RAD * params[K.heading_sigma]
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any, aid: Any) -> None:
    """Take one sample: attitude at its end, sums of the block, and the filter where a block ends."""
    look_for_rest(state, params, dt, gyr, acc)
    take_force(state, dt, gyr, acc, aid[AIRSPEED])
    if state[S.stage] == ALIGNING:
        align(state, params, dt, gyr, state[S.force :], mag)
        return
    sample(state, dt, gyr, state[S.force :], mag)
    if state[S.seconds] >= params[K.block] - 0.25 * dt:
        predict(state, params)
        correct(state, params)
        finish(state, params)
    report(state, params, gyr)


def take_force(state: Any, dt: float, gyr: Any, acc: Any, airspeed: float) -> None:
    """Write the specific force to the state, less the acceleration by ``airspeed`` [m/s, NaN: nothing new]."""
    update_airspeed(state, S.air, dt, airspeed, state[S.quiet] >= min(0.2, state[S.age]))
    _, wy, wz = rate(state, gyr)
    state[S.force], state[S.force + 1], state[S.force + 2] = without_acceleration(state, S.air, acc, wy, wz)


def report(state: Any, params: Any, gyr: Any) -> None:
    """Write the output attitude: the filter's, turned on by ``lead``."""
    for i in range(4):
        state[i] = state[S.attitude + i]
    lead = 0.001 * params[K.lead]
    if lead != 0.0:
        wx, wy, wz = rate(state, gyr)
        turn(state, wx, wy, wz, lead, 0.0)


def rate(state: Any, gyr: Any) -> tuple[float, float, float]:
    """Return the rate w = (I + M)(gyro - b) of (1)."""
    x, y, z = gyr[0] - state[S.bias], gyr[1] - state[S.bias + 1], gyr[2] - state[S.bias + 2]
    return (
        x + state[S.M] * x + state[S.M + 1] * y + state[S.M + 2] * z,
        y + state[S.M + 3] * x + state[S.M + 4] * y + state[S.M + 5] * z,
        z + state[S.M + 6] * x + state[S.M + 7] * y + state[S.M + 8] * z,
    )


def sample(state: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """Carry attitude and velocity over one sample (1, 2), add to the sums A, B, S of the block (4, 5)."""
    ux, uy, uz = gyr[0] - state[S.bias], gyr[1] - state[S.bias + 1], gyr[2] - state[S.bias + 2]
    wx, wy, wz = rate(state, gyr)
    turn(state[S.attitude : S.M], wx, wy, wz, dt, 0.0)
    state[S.seconds] += dt
    state[S.turned] += dt * (wx * wx + wy * wy + wz * wz)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = matrix(state, S.attitude)
    sum_column(state, 0, dt * r00, dt * r10, dt * r20, ux, uy, uz)
    sum_column(state, 1, dt * r01, dt * r11, dt * r21, ux, uy, uz)
    sum_column(state, 2, dt * r02, dt * r12, dt * r22, ux, uy, uz)
    for i in range(3):
        state[S.gyro + i] += dt * gyr[i]
    if is_present(acc):
        fx, fy, fz = acc[0] - state[S.ba], acc[1] - state[S.ba + 1], acc[2] - state[S.ba + 2]
        north = dt * (r00 * fx + r01 * fy + r02 * fz)
        east = dt * (r10 * fx + r11 * fy + r12 * fz)
        state[S.v] += north
        state[S.v + 1] += east
        state[S.impulse] += north
        state[S.impulse + 1] += east
        state[S.impulse + 2] += dt * (r20 * fx + r21 * fy + r22 * fz)
    if is_present(mag):
        state[S.field_sum] += r00 * mag[0] + r01 * mag[1] + r02 * mag[2]
        state[S.field_sum + 1] += r10 * mag[0] + r11 * mag[1] + r12 * mag[2]
        state[S.field_sum + 2] += r20 * mag[0] + r21 * mag[1] + r22 * mag[2]
        state[S.field_count] += 1.0


def sum_column(state: Any, i: int, x: float, y: float, z: float, ux: float, uy: float, uz: float) -> None:
    """Add to A and B of (4): column i of R dt, and that times gyro - b."""
    state[S.A + i] += x
    state[S.A + 3 + i] += y
    state[S.A + 6 + i] += z
    u = (ux, uy, uz)
    for j in range(3):
        state[S.B + 3 * i + j] += x * u[j]
        state[S.B + 9 + 3 * i + j] += y * u[j]
        state[S.B + 18 + 3 * i + j] += z * u[j]


def predict(state: Any, params: Any) -> None:
    """Predict P <- F P F^T + Q and D <- F D over the block (4, 5).

    Five rows of F are more than the identity; d decays.
    """
    time = state[S.seconds]
    moving = min(1.0, math.sqrt(state[S.turned] / time) / MOVING_RATE)
    keep = math.exp(-time * moving / params[K.field_time])
    for j in range(N):
        carry(state, S.P + j, N, keep)
    for i in range(N):
        carry(state, S.P + N * i, 1, keep)
    for i in range(3):
        carry(state, S.reach + N * i, 1, keep)
    for i in range(1, N):
        for j in range(i):
            state[S.P + N * j + i] = state[S.P + N * i + j]
    noise = square(RAD * params[K.gyro_noise]) * time + square(params[K.rate_noise]) * state[S.turned]
    walk = square(RAD * params[K.bias_noise]) * time
    for i in range(3):
        state[S.P + (N + 1) * i] += noise
        state[S.P + (N + 1) * (E.bias + i)] += walk
    gusts = WIND_WALK if state[S.air + TRUE_AIRSPEED] > 0.0 else 0.0
    for i in range(E.v, E.d):
        state[S.P + (N + 1) * i] += (square(params[K.velocity_noise]) + square(gusts)) * time
    state[S.P + (N + 1) * E.d] += square(RAD * params[K.field_sigma]) * (1.0 - keep * keep)


def carry(state: Any, at: int, by: int, keep: float) -> None:
    """Carry an error over the block: its theta, v and d, of the entries at ``at``, ``at + by``, ..."""
    bx, by_, bz = product(state, S.A, state[at + 3 * by], state[at + 4 * by], state[at + 5 * by])
    ax, ay, _ = product(state, S.A, state[at + 15 * by], state[at + 16 * by], state[at + 17 * by])
    tx, ty, tz = state[at], state[at + by], state[at + 2 * by]
    state[at + 18 * by] = state[at + 18 * by] + state[S.impulse + 2] * ty - ax
    state[at + 19 * by] = state[at + 19 * by] - state[S.impulse + 2] * tx - ay
    tx -= bx
    ty -= by_
    tz -= bz
    for m in range(9):
        e = state[at + (6 + m) * by]
        tx += state[S.B + m] * e
        ty += state[S.B + 9 + m] * e
        tz += state[S.B + 18 + m] * e
    state[at], state[at + by], state[at + 2 * by] = tx, ty, tz
    state[at + 20 * by] *= keep


def correct(state: Any, params: Any) -> None:
    """Fuse the measurements of a block one by one into the error x: (6), (7), (8)."""
    time = state[S.seconds]
    for i in range(N):
        state[S.x + i] = 0.0
    expect(state, params)
    rest = state[S.quiet] >= 1.0
    square_speed = min(0.5 * (square(state[S.v]) + square(state[S.v + 1])), 400.0)
    state[S.v_mean] += (1.0 - math.exp(-time / params[K.velocity_time])) * (square_speed - state[S.v_mean])
    spread = (square(params[K.velocity_sigma]) + params[K.velocity_factor] * state[S.v_mean]) * 0.5 / time
    spread = square(REST_VELOCITY) if rest else spread
    fade_slow(state)
    for i in range(2):
        add_slow_variance(state, E.v + i, spread)
        update(state, E.v + i, -state[S.v + i], spread)
    weigh_slow(state)
    if rest:
        spread = square(REST_RATE) / time
        for i in range(3):
            update(state, E.bias + i, state[S.gyro + i] / time - state[S.bias + i], spread)
    state[S.field_since] += time
    if state[S.field_count] > 0.0:
        field(state, params)
        state[S.field_since] = 0.0


def expect(state: Any, params: Any) -> None:
    """Fit the prior of the accelerometer bias every few seconds of motion.

    sigma^2 = (sum of ba_i^2 + P_ii over the axes + what was expected^2) / 4, a step of expectation maximisation. ba is
    constant, so another prior is one more measurement of 0 with variance 1/(1/new - 1/old), negative for a wider one.
    Of a bias b it sees -ba, not b - ba: its part in D is one less.
    """
    state[S.expect_time] += state[S.seconds]
    if state[S.expect_time] < EXPECT_EVERY or params[K.acc_bias_sigma] <= 0.0 or state[S.quiet] > 0.2:
        return
    state[S.expect_time] = 0.0
    old = state[S.expected]
    new = square(params[K.acc_bias_sigma])
    for i in range(3):
        new += square(state[S.ba + i]) + state[S.P + (N + 1) * (E.ba + i)]
    new = min(0.25 * new, max(square(MAX_ACC_BIAS_SIGMA), square(params[K.acc_bias_sigma])))
    if abs(new - old) < 0.01 * old:
        return
    spread = 1.0 / (1.0 / new - 1.0 / old)
    for i in range(3):
        state[S.reach + N * i + E.ba + i] -= 1.0
        update(state, E.ba + i, -state[S.ba + i], spread)
        state[S.reach + N * i + E.ba + i] += 1.0
    state[S.expected] = new


def update(state: Any, k: int, value: float, r: float) -> None:
    """Update with entry k of the error measured as ``value``, variance ``r``."""
    s = 1.0 / (state[S.P + (N + 1) * k] + r)
    z = s * (value - state[S.x + k])
    for j in range(N):
        state[S.column + j] = state[S.P + N * k + j]
    for j in range(N):
        state[S.x + j] += z * state[S.column + j]
    for i in range(N):
        c = s * state[S.column + i]
        for j in range(N):
            state[S.P + N * i + j] -= c * state[S.column + j]
    correct_reach(state, k, s)


def finish(state: Any, params: Any) -> None:
    """Move the error x into the state and clear the sums of the block."""
    inject_error(state)
    for i in range(S.seconds, S.field_count + 1):
        state[i] = 0.0
    residual_sigmas(state, params)


def inject_error(state: Any) -> None:
    """Correct the state: q <- exp(theta) (x) q, everything else is added."""
    turn_earth(state, state[S.x], state[S.x + 1], state[S.x + 2])
    for i in range(3):
        state[S.bias + i] += state[S.x + E.bias + i]
    for i in range(E.home - E.M + 1):
        state[S.M + i] += state[S.x + E.M + i]
