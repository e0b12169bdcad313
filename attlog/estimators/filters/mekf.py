"""MEKF: error-state Kalman filter that expects a body not to fly away, not that it does not accelerate.

    q, b (gyro bias), M (3x3 gyro scale and misalignment), ba (accelerometer bias), v_N, v_E, d (heading of the field)
    w    = (I + M)(gyro - b)       q <- q (x) exp(w dt)                                             (1)
    a    = R (f - ba - V')         v <- v + (a_N, a_E) dt,  V' by airspeed: ``airspeed.py``   (2)
    error x = [theta (earth axes), db, dM, dba, dv, dd],  R_true = (I + [theta]x) R                 (3)
    theta <- theta - A db + B dM,  A = int R dt,  B = int R dw/dM dt                                (4)
    v_N  <- v_N + S_z theta_y - (A dba)_N,   v_E <- v_E - S_z theta_x - (A dba)_E,   S = int a dt   (5)
    velocity is 0 +- sigma_v:      z = -v,       R = (sv^2 + kv <v^2>) 0.5 s / T,  at rest svr^2    (6)
    at rest the rate is 0:         z = gyro - b                                                     (7)
    magnetometer, heading only:    z = d - psi,  psi = atan2(h_E, h_N),  h = R m,  R = sm^2 / T     (8)

Source: Markley2003 for the multiplicative error; velocity in place of gravity, gyro matrix and the magnetometer's
calibration are attlog's; the tests of norm and dip of the field follow Laidig2023.

Accelerations of a body that does not fly away average to zero as vectors in the earth frame. A direction of gravity
takes every one of them for a tilt; (2) integrates them to a velocity that is small. In (5) the terms that tie velocity
to heading are left out: nobody knows the true velocity, so an acceleration tells nothing about heading. The
magnetometer corrects heading, gyro bias and d only; the tilt's part in psi enters the covariance, not the gain
(Schmidt). Delay and body-fixed offset of the magnetometer are found beside the filter (``inertial/compass.py``). d, the
local field's direction relative to magnetic north, changes while the body moves about; by default it is 0. How large an
accelerometer bias may be is learnt on the way: calibrated sensors keep a tight prior, raw ones get room.

Of a plane that tells its airspeed, v is what velocity there is beside airspeed along the nose: sideslip, angle of
attack, gusts. It walks at random while the plane flies.

The first ``align_time`` seconds vectors are averaged in axes that the gyro holds still, so that a start in the middle
of a motion does no harm; tilt and velocity are less certain there. Of a start attitude that is given only the heading
counts, and only without magnetometer. The covariance moves in blocks of ``block`` seconds, the attitude at every
sample.

``sigma_tilt`` is that of the angle between true and estimated vertical (two axes together), ``sigma_heading`` that of
the heading, both in rad: of the covariance, and of what it leaves out (``inertial/doubt.py``).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from attlog.estimators.aids import AIR_AGE, AIR_SPEED, AIRSPEED, NEVER, update_airspeed, without_acceleration
from attlog.estimators.filters.inertial.compass import (
    add_slow_variance,
    correct_reach,
    fade_slow,
    field,
    residual_sigmas,
    weigh_slow,
)
from attlog.estimators.filters.inertial.recursion import (
    ACC_BIAS_SIGMA,
    AGE,
    AIR,
    ALIGNING,
    BA,
    BIAS,
    BIAS_NOISE,
    BLOCK,
    DB,
    DBA,
    DD,
    DM,
    DV,
    END,
    EXPECT_TIME,
    EXPECTED,
    FIELD_SIGMA,
    FIELD_TIME,
    GYRO_NOISE,
    H_COUNT,
    H_SINCE,
    HEADING_SIGMA,
    LEAD,
    MOVING_RATE,
    QUIET,
    RAD,
    RATE_NOISE,
    REACH,
    SIGMA,
    STAGE,
    TILT_SIGMA,
    TURNED,
    V_MEAN,
    VELOCITY_FACTOR,
    VELOCITY_NOISE,
    VELOCITY_SIGMA,
    VELOCITY_TIME,
    A,
    B,
    C,
    F,
    G,
    H,
    M,
    N,
    P,
    Q,
    S,
    T,
    V,
    X,
    square,
    turn_earth,
)
from attlog.estimators.filters.inertial.start import align, look_for_rest
from attlog.estimators.interface import Parameter
from attlog.estimators.vectors import turn

SOURCE = "Markley2003; Laidig2023"
NEEDS = {"gyro", "acc"}
USES = {"mag", "airspeed"}
HOLD_MAG = False
VECTORS_AT = "end"
STATE = {
    "q": 4,
    "bias": 3,
    "sigma_tilt": 1,
    "sigma_heading": 1,
    "_q": 4,
    "_gyro_matrix": 9,
    "_acc_bias": 3,
    "_velocity": 2,
    "_field_heading": 1,
    "_covariance": N * N,
    "_error": N,
    "_column": N,
    "_block": 49,
    "_rest": 13,
    "_start": 8,
    "_field": 14,
    "_calibration": 57,
    "_expected": 2,
    "_reach": 63,
    "_slow": 4,
    "_field_doubt": 8,
    "_airspeed": 5,
    "_force": 3,
    "_swing": 5,
}
RECORDED = "tuned on BROAD and EuRoC with altered copies"
PHYSICAL = "attlog; MEMS data sheets"
PARAMETERS = (
    Parameter("block", 0.025, "s", 0.001, 0.5, "time between updates: 10 to 100 ms give the same", "attlog"),
    Parameter("gyro_noise", 0.016, "deg/sqrt(s)", 1e-5, 10, "white noise of the gyro", RECORDED),
    Parameter("rate_noise", 0.0006, "sqrt(s)", 0, 1, "attitude noise in proportion to the rate", RECORDED),
    Parameter("bias_noise", 0.002, "deg/s/sqrt(s)", 0, 10, "random walk of the gyro bias", RECORDED),
    Parameter("bias_sigma", 0.65, "deg/s", 1e-3, 100, "gyro bias expected at the start", RECORDED),
    Parameter("scale_sigma", 0.004, "", 0, 1, "gyro scale errors expected", PHYSICAL),
    Parameter("misalignment_sigma", 0.0025, "", 0, 1, "gyro misalignments expected", PHYSICAL),
    Parameter("acc_bias_sigma", 0.016, "m/s^2", 0, 10, "accelerometer bias expected; follows what is found", RECORDED),
    Parameter("velocity_noise", 0.02, "m/s/sqrt(s)", 1e-6, 10, "white noise of the accelerometer", RECORDED),
    Parameter("velocity_sigma", 0.13, "m/s", 1e-4, 100, "velocity expected, at least: small trusts gravity", RECORDED),
    Parameter("velocity_factor", 2.6, "", 0, 100, "velocity expected: factor on the running mean square", RECORDED),
    Parameter("velocity_time", 8.0, "s", 0.1, 1000, "time constant of that mean square", RECORDED),
    Parameter("align_time", 2.0, "s", 0.1, 30, "the start: how long vectors are averaged", RECORDED),
    Parameter("tilt_sigma", 2.0, "deg", 0.01, 90, "tilt error after that", RECORDED),
    Parameter("heading_sigma", 25.0, "deg", 0.01, 180, "heading error after that", RECORDED),
    Parameter(
        "mag_noise",
        14.0,
        "deg*sqrt(s)",
        0.01,
        1000,
        "noise density of the field's heading: large trusts the gyro",
        RECORDED,
    ),
    Parameter("mag_gate", 2.0, "", 0.1, 100, "sigmas beyond which a heading weighs less", RECORDED),
    Parameter("delay_sigma", 15.0, "ms", 0, 1000, "delay of the magnetometer expected; it is estimated", PHYSICAL),
    Parameter(
        "offset_sigma",
        0.06,
        "",
        0,
        10,
        "field fixed to the body expected, as part of the field; it is estimated",
        RECORDED,
    ),
    Parameter("field_sigma", 0.0, "deg", 0, 90, "deviation of the local field's heading", RECORDED),
    Parameter("field_time", 60.0, "s", 0.1, 10000, "time of motion after which it is another", RECORDED),
    Parameter("lead", 0.0, "ms", -100, 100, "output turned on by this time: for an IMU that lags", "attlog"),
    Parameter(
        "acc_bias_considered",
        0.12,
        "m/s^2",
        0,
        10,
        "accelerometer bias that sigmas count beyond the one expected; it moves no attitude",
        "attlog; half of the flights with truth",
    ),
    Parameter("moving_sigma", 4.0, "deg", 0.01, 90, "tilt error after a start in motion", "attlog; flights with truth"),
)
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
        "acc_bias_considered": 0.1,
        "moving_sigma": 2.0,
    }
}
# How often the size of accelerometer bias is asked for [s].
EXPECT_EVERY = 5.0
# Widest prior of an accelerometer bias [m/s^2]; wider ones took what a hand or an alias did for 1.4 m/s^2 (9 deg).
# EuRoC's raw 0.1 m/s^2 is found all the same.
WIDEST_BIAS = 0.05
# Random walk of the air about a plane [m/s/sqrt(s)]: gusts of 1 m/s that last for 10 s.
GUSTS = 0.4
# At rest: sigma of velocity [m/s], noise density of the rate [rad/s*sqrt(s)].
REST_VELOCITY, REST_RATE = 0.02, 0.06 * RAD


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state before the first sample: everything but the attitude is found during the first ``align_time``."""
    state = np.zeros(742)
    state[AIR + AIR_AGE] = NEVER
    state[0:4] = q0
    state[Q:M] = q0
    state[SIGMA] = math.sqrt(2.0) * RAD * params[TILT_SIGMA]
    state[SIGMA + 1] = RAD * params[HEADING_SIGMA]
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any, aid: Any) -> None:
    """One sample: attitude at its end, sums for the block, and the filter where a block ends."""
    look_for_rest(state, params, dt, gyr, acc)
    take_force(state, dt, gyr, acc, aid[AIRSPEED])
    if state[STAGE] == ALIGNING:
        align(state, params, dt, gyr, state[F:END], mag)
        return
    sample(state, dt, gyr, state[F:END], mag)
    if state[T] >= params[BLOCK] - 0.25 * dt:
        predict(state, params)
        correct(state, params)
        finish(state, params)
    report(state, params, gyr)


def take_force(state: Any, dt: float, gyr: Any, acc: Any, airspeed: float) -> None:
    """The specific force less what ``airspeed`` [m/s, NaN: nothing new] tells of the flight's acceleration, to F."""
    update_airspeed(state, AIR, dt, airspeed, state[QUIET] >= min(0.2, state[AGE]))
    _, wy, wz = rate(state, gyr)
    state[F], state[F + 1], state[F + 2] = without_acceleration(state, AIR, acc, wy, wz)


def report(state: Any, params: Any, gyr: Any) -> None:
    """The output attitude: the filter's, turned on by ``lead``."""
    state[0] = state[Q]
    state[1] = state[Q + 1]
    state[2] = state[Q + 2]
    state[3] = state[Q + 3]
    lead = 0.001 * params[LEAD]
    if lead != 0.0:
        wx, wy, wz = rate(state, gyr)
        turn(state, wx, wy, wz, lead, 0.0)


def rate(state: Any, gyr: Any) -> tuple[float, float, float]:
    """w = (I + M)(gyro - b) of (1)."""
    x = gyr[0] - state[BIAS]
    y = gyr[1] - state[BIAS + 1]
    z = gyr[2] - state[BIAS + 2]
    return (
        x + state[M] * x + state[M + 1] * y + state[M + 2] * z,
        y + state[M + 3] * x + state[M + 4] * y + state[M + 5] * z,
        z + state[M + 6] * x + state[M + 7] * y + state[M + 8] * z,
    )


def sample(state: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """Attitude and velocity over one sample (1, 2), and the sums A, B, S of the block (4, 5)."""
    ux = gyr[0] - state[BIAS]
    uy = gyr[1] - state[BIAS + 1]
    uz = gyr[2] - state[BIAS + 2]
    wx, wy, wz = rate(state, gyr)
    turn(state[Q:M], wx, wy, wz, dt, 0.0)
    state[T] += dt
    state[TURNED] += dt * (wx * wx + wy * wy + wz * wz)
    q0 = state[Q]
    q1 = state[Q + 1]
    q2 = state[Q + 2]
    q3 = state[Q + 3]
    r00 = 1.0 - 2.0 * (q2 * q2 + q3 * q3)
    r01 = 2.0 * (q1 * q2 - q0 * q3)
    r02 = 2.0 * (q1 * q3 + q0 * q2)
    r10 = 2.0 * (q1 * q2 + q0 * q3)
    r11 = 1.0 - 2.0 * (q1 * q1 + q3 * q3)
    r12 = 2.0 * (q2 * q3 - q0 * q1)
    r20 = 2.0 * (q1 * q3 - q0 * q2)
    r21 = 2.0 * (q2 * q3 + q0 * q1)
    r22 = 1.0 - 2.0 * (q1 * q1 + q2 * q2)
    sum_column(state, 0, dt * r00, dt * r10, dt * r20, ux, uy, uz)
    sum_column(state, 1, dt * r01, dt * r11, dt * r21, ux, uy, uz)
    sum_column(state, 2, dt * r02, dt * r12, dt * r22, ux, uy, uz)
    state[G] += dt * gyr[0]
    state[G + 1] += dt * gyr[1]
    state[G + 2] += dt * gyr[2]
    if acc[0] != 0.0 or acc[1] != 0.0 or acc[2] != 0.0:
        fx = acc[0] - state[BA]
        fy = acc[1] - state[BA + 1]
        fz = acc[2] - state[BA + 2]
        north = dt * (r00 * fx + r01 * fy + r02 * fz)
        east = dt * (r10 * fx + r11 * fy + r12 * fz)
        state[V] += north
        state[V + 1] += east
        state[S] += north
        state[S + 1] += east
        state[S + 2] += dt * (r20 * fx + r21 * fy + r22 * fz)
    if mag[0] != 0.0 or mag[1] != 0.0 or mag[2] != 0.0:
        state[H] += r00 * mag[0] + r01 * mag[1] + r02 * mag[2]
        state[H + 1] += r10 * mag[0] + r11 * mag[1] + r12 * mag[2]
        state[H + 2] += r20 * mag[0] + r21 * mag[1] + r22 * mag[2]
        state[H_COUNT] += 1.0


def sum_column(state: Any, i: int, x: float, y: float, z: float, ux: float, uy: float, uz: float) -> None:
    """A and B of (4): column i of R dt, and that times gyro - b."""
    state[A + i] += x
    state[A + 3 + i] += y
    state[A + 6 + i] += z
    k = B + 3 * i
    state[k] += x * ux
    state[k + 1] += x * uy
    state[k + 2] += x * uz
    state[k + 9] += y * ux
    state[k + 10] += y * uy
    state[k + 11] += y * uz
    state[k + 18] += z * ux
    state[k + 19] += z * uy
    state[k + 20] += z * uz


def predict(state: Any, params: Any) -> None:
    """P <- F P F^T + Q and D <- F D over the block (4, 5): five rows of F are more than the identity, d decays."""
    time = state[T]
    moving = min(1.0, math.sqrt(state[TURNED] / time) / MOVING_RATE)
    keep = math.exp(-time * moving / params[FIELD_TIME])
    for j in range(N):
        tx, ty, tz, vn, ve = moved(state, P + j, N)
        state[P + j] = tx
        state[P + N + j] = ty
        state[P + 2 * N + j] = tz
        state[P + 18 * N + j] = vn
        state[P + 19 * N + j] = ve
        state[P + 20 * N + j] *= keep
    for i in range(N):
        tx, ty, tz, vn, ve = moved(state, P + N * i, 1)
        state[P + N * i] = tx
        state[P + N * i + 1] = ty
        state[P + N * i + 2] = tz
        state[P + N * i + 18] = vn
        state[P + N * i + 19] = ve
        state[P + N * i + 20] *= keep
    for i in range(3):
        tx, ty, tz, vn, ve = moved(state, REACH + N * i, 1)
        state[REACH + N * i] = tx
        state[REACH + N * i + 1] = ty
        state[REACH + N * i + 2] = tz
        state[REACH + N * i + 18] = vn
        state[REACH + N * i + 19] = ve
        state[REACH + N * i + 20] *= keep
    for i in range(1, N):
        for j in range(i):
            state[P + N * j + i] = state[P + N * i + j]
    noise = square(RAD * params[GYRO_NOISE]) * time + square(params[RATE_NOISE]) * state[TURNED]
    walk = square(RAD * params[BIAS_NOISE]) * time
    for i in range(3):
        state[P + (N + 1) * i] += noise
        state[P + (N + 1) * (DB + i)] += walk
    gusts = GUSTS if state[AIR + AIR_SPEED] > 0.0 else 0.0
    for i in range(DV, DD):
        state[P + (N + 1) * i] += (square(params[VELOCITY_NOISE]) + square(gusts)) * time
    state[P + (N + 1) * DD] += square(RAD * params[FIELD_SIGMA]) * (1.0 - keep * keep)


def moved(state: Any, at: int, by: int) -> tuple[float, float, float, float, float]:
    """theta and v after the block, from the 21 entries of an error that stand at ``at``, ``at + by``, ..."""
    bx = state[at + 3 * by]
    by_ = state[at + 4 * by]
    bz = state[at + 5 * by]
    ax = state[at + 15 * by]
    ay = state[at + 16 * by]
    az = state[at + 17 * by]
    tx = state[at]
    ty = state[at + by]
    vn = state[at + 18 * by] + state[S + 2] * ty - (state[A] * ax + state[A + 1] * ay + state[A + 2] * az)
    ve = state[at + 19 * by] - state[S + 2] * tx - (state[A + 3] * ax + state[A + 4] * ay + state[A + 5] * az)
    tx -= state[A] * bx + state[A + 1] * by_ + state[A + 2] * bz
    ty -= state[A + 3] * bx + state[A + 4] * by_ + state[A + 5] * bz
    tz = state[at + 2 * by] - (state[A + 6] * bx + state[A + 7] * by_ + state[A + 8] * bz)
    for m in range(9):
        e = state[at + (6 + m) * by]
        tx += state[B + m] * e
        ty += state[B + 9 + m] * e
        tz += state[B + 18 + m] * e
    return tx, ty, tz, vn, ve


def correct(state: Any, params: Any) -> None:
    """The measurements of a block, one number after the other, into the error x: (6), (7), (8)."""
    time = state[T]
    for i in range(N):
        state[X + i] = 0.0
    expect(state, params)
    rest = state[QUIET] >= 1.0
    square_speed = min(0.5 * (square(state[V]) + square(state[V + 1])), 400.0)
    state[V_MEAN] += (1.0 - math.exp(-time / params[VELOCITY_TIME])) * (square_speed - state[V_MEAN])
    spread = (square(params[VELOCITY_SIGMA]) + params[VELOCITY_FACTOR] * state[V_MEAN]) * 0.5 / time
    spread = square(REST_VELOCITY) if rest else spread
    fade_slow(state)
    add_slow_variance(state, 18, spread)
    update(state, 18, -state[V], spread)
    add_slow_variance(state, 19, spread)
    update(state, 19, -state[V + 1], spread)
    weigh_slow(state)
    if rest:
        spread = square(REST_RATE) / time
        update(state, 3, state[G] / time - state[BIAS], spread)
        update(state, 4, state[G + 1] / time - state[BIAS + 1], spread)
        update(state, 5, state[G + 2] / time - state[BIAS + 2], spread)
    state[H_SINCE] += time
    if state[H_COUNT] > 0.0:
        field(state, params)
        state[H_SINCE] = 0.0


def expect(state: Any, params: Any) -> None:
    """Every few seconds of motion: the size of accelerometer bias that explains what was found becomes its prior.

    sigma^2 = (sum of ba_i^2 + P_ii over the axes + what was expected^2) / 4, a step of expectation maximisation. ba is
    constant, so another prior is one more measurement of 0 with variance 1/(1/new - 1/old), negative for a wider one.
    Of a bias b it sees -ba, not b - ba: its part in D is one less.
    """
    state[EXPECT_TIME] += state[T]
    if state[EXPECT_TIME] < EXPECT_EVERY or params[ACC_BIAS_SIGMA] <= 0.0 or state[QUIET] > 0.2:
        return
    state[EXPECT_TIME] = 0.0
    old = state[EXPECTED]
    new = square(params[ACC_BIAS_SIGMA])
    for i in range(3):
        new += square(state[BA + i]) + state[P + (N + 1) * (DBA + i)]
    new = min(0.25 * new, max(square(WIDEST_BIAS), square(params[ACC_BIAS_SIGMA])))
    if abs(new - old) < 0.01 * old:
        return
    spread = 1.0 / (1.0 / new - 1.0 / old)
    for i in range(3):
        state[REACH + N * i + DBA + i] -= 1.0
        update(state, DBA + i, -state[BA + i], spread)
        state[REACH + N * i + DBA + i] += 1.0
    state[EXPECTED] = new


def update(state: Any, k: int, value: float, r: float) -> None:
    """Kalman update with the error's entry k itself measured as ``value``, variance ``r``."""
    s = 1.0 / (state[P + (N + 1) * k] + r)
    z = s * (value - state[X + k])
    for j in range(N):
        state[C + j] = state[P + N * k + j]
    for j in range(N):
        state[X + j] += z * state[C + j]
    for i in range(N):
        c = s * state[C + i]
        for j in range(N):
            state[P + N * i + j] -= c * state[C + j]
    correct_reach(state, k, s, C)


def finish(state: Any, params: Any) -> None:
    """The error x goes into the state, the block's sums to zero."""
    inject_error(state)
    for i in range(T, H_COUNT + 1):
        state[i] = 0.0
    residual_sigmas(state, params)


def inject_error(state: Any) -> None:
    """q <- exp(theta) (x) q, everything else is added."""
    turn_earth(state, state[X], state[X + 1], state[X + 2])
    for i in range(3):
        state[BIAS + i] += state[X + DB + i]
    for i in range(15):
        state[M + i] += state[X + DM + i]
