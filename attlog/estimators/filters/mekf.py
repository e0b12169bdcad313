"""MEKF: error-state Kalman filter that expects a body not to fly away, not that it does not accelerate.

    q, b (gyro bias), M (3x3 gyro scale and misalignment), ba (accelerometer bias), v_N, v_E, d (heading of the field)
    w    = (I + M)(gyro - b)       q <- q (x) exp(w dt)                                             (1)
    a    = R (f - ba)              v <- v + (a_N, a_E) dt                                           (2)
    error x = [theta (earth axes), db, dM, dba, dv, dd],  R_true = (I + [theta]x) R                 (3)
    theta <- theta - A db + B dM,  A = int R dt,  B = int R dw/dM dt                                (4)
    v_N  <- v_N + S_z theta_y - (A dba)_N,   v_E <- v_E - S_z theta_x - (A dba)_E,   S = int a dt   (5)
    velocity is 0 +- sigma_v:      z = -v,       R = (sv^2 + kv <v^2>) 0.5 s / T,  at rest svr^2    (6)
    at rest the rate is 0:         z = gyro - b                                                     (7)
    magnetometer, heading only:    z = d - psi,  psi = atan2(h_E, h_N),  h = R m,  R = sm^2 / T     (8)

Source: Markley2003 for the multiplicative error; velocity in place of gravity, gyro matrix and bookkeeping are attlog's;
the tests of norm and dip of the field follow Laidig2023.

Accelerations of a body that does not fly away average to zero as vectors in the earth frame. A direction of gravity takes
every one of them for a tilt; (2) integrates them to a velocity that is small. In (5) the terms that tie velocity to
heading are left out: nobody knows the true velocity, so an acceleration tells nothing about heading. The magnetometer
corrects heading, gyro bias and the field's own heading d only; the tilt's part in psi enters the covariance, not the
gain (Schmidt). d is the local field's direction relative to magnetic north, which changes while the body moves about:
a long rest in one place is one opinion on north, not thousands.

The first ``align_time`` seconds vectors are averaged in a frame turned by the gyro, so that a start in the middle of a
motion does no harm. The covariance moves in blocks of ``block`` seconds; the attitude at every sample.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from attlog.estimators.base import Parameter
from attlog.estimators.engine.vectors import turn

SOURCE = "attlog; Markley2003, Laidig2023"
NEEDS = {"gyro", "acc"}
USES = {"mag"}
HOLD_MAG = False
N = 21
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
}
BIAS, SIGMA, Q, M, BA, V, D, P, X, C = 4, 7, 9, 13, 22, 25, 27, 28, 469, 490
T, A, B, S, TURNED, G, H, H_COUNT, V_MEAN = 511, 512, 521, 548, 551, 552, 555, 558, 559
FAST_G, SLOW_G, FAST_A, SLOW_A, QUIET = 560, 563, 566, 569, 572
AGE, STAGE, SUM_F, SUM_M = 573, 574, 575, 578
HL, HC, NORM, DIP, H_TIME, H_SINCE, UNDISTURBED, REJECTED, CLOCK = 581, 584, 587, 588, 589, 590, 591, 592, 593
"""Where things stand in the state; the error x holds theta 0, db 3, dM 6, dba 15, dv 18, dd 20."""
TH, DB, DM, DBA, DV, DD = 0, 3, 6, 15, 18, 20
RAD = math.pi / 180.0
ALIGNING, NO_FIELD, RUNNING = 0.0, 1.0, 2.0

FIELD_SIGMA, FIELD_TIME, ALARM, LEAD = 27, 28, 29, 30
TUNED = "tuned on BROAD and EuRoC, originals and alterations"
PARAMETERS = (
    Parameter("block", 0.025, "s", 0.001, 0.5, "time between updates of the covariance", "attlog; 10 to 100 ms give the same"),
    Parameter("gyro_noise", 0.016, "deg/sqrt(s)", 1e-5, 10, "white noise of the gyro", TUNED),
    Parameter("rate_noise", 0.0004, "sqrt(s)", 0, 1, "attitude noise in proportion to the rate", TUNED),
    Parameter("bias_noise", 0.002, "deg/s/sqrt(s)", 0, 10, "random walk of the gyro bias", TUNED),
    Parameter("bias_sigma", 0.65, "deg/s", 1e-3, 100, "gyro bias expected at the start", TUNED),
    Parameter("scale_sigma", 0.004, "", 0, 1, "gyro scale errors expected", TUNED),
    Parameter("misalignment_sigma", 0.0025, "", 0, 1, "gyro misalignments expected", TUNED),
    Parameter("acc_bias_sigma", 0.025, "m/s^2", 0, 10, "accelerometer bias expected", TUNED),
    Parameter("velocity_noise", 0.02, "m/s/sqrt(s)", 1e-6, 10, "white noise of the accelerometer", TUNED),
    Parameter("velocity_sigma", 0.13, "m/s", 1e-4, 100, "velocity expected: floor", TUNED),
    Parameter("velocity_factor", 2.6, "", 0, 100, "velocity expected: factor on the running mean square", TUNED),
    Parameter("velocity_time", 8.0, "s", 0.1, 1000, "time constant of that mean square", TUNED),
    Parameter("rest_velocity", 0.02, "m/s", 1e-4, 10, "velocity at rest", TUNED),
    Parameter("rest_rate", 0.06, "deg/s*sqrt(s)", 1e-4, 10, "noise density of the rate at rest", TUNED),
    Parameter("align_time", 2.0, "s", 0.1, 30, "the start: how long vectors are averaged", TUNED),
    Parameter("tilt_sigma", 2.0, "deg", 0.01, 90, "tilt error after that", TUNED),
    Parameter("heading_sigma", 25.0, "deg", 0.01, 180, "heading error after that", TUNED),
    Parameter("mag_noise", 14.0, "deg*sqrt(s)", 0.01, 1000, "noise density of the heading that the field shows", TUNED),
    Parameter("mag_gate", 2.0, "", 0.1, 100, "sigmas beyond which a heading weighs less", TUNED),
    Parameter("norm_limit", 0.09, "", 0.001, 10, "deviation of the field's norm that is a disturbance", TUNED),
    Parameter("dip_limit", 3.2, "deg", 0.1, 90, "deviation of the field's dip that is a disturbance", TUNED),
    Parameter("undisturbed_time", 0.5, "s", 0, 60, "undisturbed time before the field is used", TUNED),
    Parameter("reference_start", 15.0, "s", 0, 1000, "time over which norm and dip are learnt at first", TUNED),
    Parameter("reference_time", 15.0, "s", 0.1, 1000, "time constant with which they follow", TUNED),
    Parameter("candidate_time", 15.0, "s", 0.1, 1000, "time constant of the candidate for a new reference", TUNED),
    Parameter("candidate_after", 10.0, "s", 0.1, 1000, "time in motion after which it is believed", TUNED),
    Parameter("candidate_size", 0.18, "", 0.001, 10, "part of the field by which it may differ from it", TUNED),
    Parameter("field_sigma", 0.0, "deg", 0, 90, "local deviation of the field's heading", TUNED),
    Parameter("field_time", 60.0, "s", 0.1, 10000, "time of motion after which it is another", TUNED),
    Parameter("alarm", 4.0, "", 0.1, 100, "sigmas at which a steady field opens the heading", TUNED),
    Parameter("lead", 0.0, "ms", -100, 100, "output turned on by this time: for an IMU that lags", "attlog; 0 adds nothing"),
)
PRESETS: dict[str, dict[str, float | str]] = {}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state before the first sample: everything but the attitude is found during the first ``align_time``."""
    state = np.zeros(595)
    state[0:4] = q0
    state[Q:M] = q0
    state[SIGMA] = math.sqrt(2.0) * RAD * params[15]
    state[SIGMA + 1] = RAD * params[16]
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """One sample: attitude at its end, sums for the block, and the filter where a block ends."""
    look_for_rest(state, params, dt, gyr, acc)
    if state[STAGE] == ALIGNING:
        align(state, params, dt, gyr, acc, mag)
        return
    sample(state, dt, gyr, acc, mag)
    if state[T] >= params[0] - 0.25 * dt:
        predict(state, params)
        correct(state, params)
        finish(state)
    report(state, params, gyr)


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
    """P <- F P F^T + Q over the block (4, 5): five rows of F are more than the identity, d decays."""
    time = state[T]
    keep = math.exp(-time / params[FIELD_TIME])
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
    for i in range(1, N):
        for j in range(i):
            state[P + N * j + i] = state[P + N * i + j]
    noise = square(RAD * params[1]) * time + square(params[2]) * state[TURNED]
    walk = square(RAD * params[3]) * time
    for i in range(3):
        state[P + (N + 1) * i] += noise
        state[P + (N + 1) * (DB + i)] += walk
    for i in range(DV, DD):
        state[P + (N + 1) * i] += square(params[8]) * time
    moving = min(1.0, math.sqrt(state[TURNED] / time) / 0.35)
    state[P + (N + 1) * DD] += square(RAD * params[FIELD_SIGMA]) * (1.0 - keep * keep) * moving


def square(x: float) -> float:
    """x^2."""
    return x * x


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
    rest = state[QUIET] >= 1.0
    square_speed = min(0.5 * (square(state[V]) + square(state[V + 1])), 400.0)
    state[V_MEAN] += (1.0 - math.exp(-time / params[11])) * (square_speed - state[V_MEAN])
    spread = (square(params[9]) + params[10] * state[V_MEAN]) * 0.5 / time
    spread = square(params[12]) if rest else spread
    update(state, 18, -state[V], spread)
    update(state, 19, -state[V + 1], spread)
    if rest:
        spread = square(RAD * params[13]) / time
        update(state, 3, state[G] / time - state[BIAS], spread)
        update(state, 4, state[G + 1] / time - state[BIAS + 1], spread)
        update(state, 5, state[G + 2] / time - state[BIAS + 2], spread)
    state[H_SINCE] += time
    if state[H_COUNT] > 0.0:
        field(state, params)
        state[H_SINCE] = 0.0


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


def field(state: Any, params: Any) -> None:
    """The block's mean field: is it the earth's, and if so what does it say about heading (8)."""
    inv = 1.0 / state[H_COUNT]
    x = inv * state[H]
    y = inv * state[H + 1]
    z = inv * state[H + 2]
    level = math.sqrt(x * x + y * y)
    if level <= 0.0:
        return
    if state[STAGE] == NO_FIELD:
        first_field(state, params, x, y, z)
        return
    weight = trust(state, params, x, y, z)
    if weight > 0.0:
        psi = math.atan2(y, x)
        heading(state, params, wrapped(state[D] - psi), x, y, z, weight)


def wrapped(angle: float) -> float:
    """The angle within +-pi."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def heading(state: Any, params: Any, value: float, x: float, y: float, z: float, weight: float) -> None:
    """Update (8) with the field (x, y, z); only heading, gyro bias and d are corrected."""
    square_level = x * x + y * y
    hx = -z * x / square_level
    hy = -z * y / square_level
    known = state[P + 2 * (N + 1)] + state[P + DD * (N + 1)] - 2.0 * state[P + 2 * N + DD]
    for j in range(N):
        state[C + j] = (
            state[P + 2 * N + j] + hx * state[P + j] + hy * state[P + N + j] - state[P + DD * N + j]
        )
    limit = params[18] * math.sqrt(max(known, 0.0) + square(3.0 * RAD))
    spread = square(RAD * params[17]) / (weight * min(state[H_SINCE], 1.0))
    if abs(value) > limit:
        spread *= square(value / limit)
    s = 1.0 / (state[C + 2] + hx * state[C] + hy * state[C + 1] - state[C + DD] + spread)
    value -= state[X + 2] + hx * state[X] + hy * state[X + 1] - state[X + DD]
    for i in range(2, DM):
        state[X + i] += s * value * state[C + i]
    state[X + DD] += s * value * state[C + DD]
    # Where neither row nor column is corrected, P stays.
    for i in range(N):
        c = s * state[C + i]
        if 2 <= i < DM or i == DD:
            for j in range(N):
                state[P + N * i + j] -= c * state[C + j]
        else:
            for j in range(2, DM):
                state[P + N * i + j] -= c * state[C + j]
            state[P + N * i + DD] -= c * state[C + DD]


def trust(state: Any, params: Any, x: float, y: float, z: float) -> float:
    """1 where norm and dip of the field are the earth's for some time, 1/16 after a minute of refusal, else 0."""
    time = state[H_SINCE]
    if state[H_TIME] == 0.0:
        for i in range(3):
            state[HL + i] = x * (i == 0) + y * (i == 1) + z * (i == 2)
            state[HC + i] = state[HL + i]
        state[UNDISTURBED] = params[21]
    follow = 1.0 - math.exp(-time / 0.05)
    state[HL] += follow * (x - state[HL])
    state[HL + 1] += follow * (y - state[HL + 1])
    state[HL + 2] += follow * (z - state[HL + 2])
    norm = math.sqrt(square(state[HL]) + square(state[HL + 1]) + square(state[HL + 2]))
    dip = math.atan2(state[HL + 2], math.sqrt(square(state[HL]) + square(state[HL + 1])))
    state[H_TIME] += time
    good = True
    if state[H_TIME] < params[22]:
        share = time / state[H_TIME]
        state[NORM] += share * (norm - state[NORM])
        state[DIP] += share * (dip - state[DIP])
    else:
        good = abs(norm - state[NORM]) < params[19] * state[NORM] and abs(dip - state[DIP]) < RAD * params[20]
    if good:
        state[UNDISTURBED] += time
        if state[UNDISTURBED] >= params[21]:
            follow = 1.0 - math.exp(-time / params[23])
            state[NORM] += follow * (norm - state[NORM])
            state[DIP] += follow * (dip - state[DIP])
    else:
        state[UNDISTURBED] = 0.0
    good = candidate(state, params, time, norm, dip, good)
    if good and state[UNDISTURBED] >= params[21]:
        state[REJECTED] = max(0.0, state[REJECTED] - 2.0 * time)
        return 1.0
    state[REJECTED] += time
    if state[REJECTED] >= 60.0:
        state[REJECTED] = 60.0
        return 1.0 / 16.0
    return 0.0


def candidate(state: Any, params: Any, time: float, norm: float, dip: float, good: bool) -> bool:
    """A field that stays put in earth axes while the body turns is the earth's: it becomes the reference.

    A magnet on the body cannot do that. The vector is tested, not norm and dip, so that a wrong heading recovers.
    """
    x = state[HL] - state[HC]
    y = state[HL + 1] - state[HC + 1]
    z = state[HL + 2] - state[HC + 2]
    size = square(state[HC]) + square(state[HC + 1]) + square(state[HC + 2])
    if x * x + y * y + z * z >= square(params[26]) * size:
        state[CLOCK] = 0.0
        copy_field(state)
        return good
    if state[TURNED] > square(20.0 * RAD) * state[T]:
        state[CLOCK] += time
    follow = 1.0 - math.exp(-time / params[24])
    state[HC] += follow * x
    state[HC + 1] += follow * y
    state[HC + 2] += follow * z
    if state[CLOCK] < params[25]:
        return good
    state[CLOCK] = 0.0
    level = math.sqrt(square(state[HC]) + square(state[HC + 1]))
    psi = wrapped(math.atan2(state[HC + 1], state[HC]) - state[D])
    if not good:
        state[NORM] = math.sqrt(square(level) + square(state[HC + 2]))
        state[DIP] = math.atan2(state[HC + 2], level)
        state[UNDISTURBED] = params[21]
    known = state[P + 2 * (N + 1)] + state[P + DD * (N + 1)] - 2.0 * state[P + 2 * N + DD]
    if abs(psi) > params[ALARM] * math.sqrt(max(known, 0.0) + square(4.0 * RAD)):
        state[P + 2 * (N + 1)] += psi * psi
        copy_field(state)
    return True


def copy_field(state: Any) -> None:
    """The candidate begins anew at the field as it is."""
    state[HC] = state[HL]
    state[HC + 1] = state[HL + 1]
    state[HC + 2] = state[HL + 2]


def finish(state: Any) -> None:
    """The error x goes into the state, the block's sums to zero."""
    inject(state)
    for i in range(T, H_COUNT + 1):
        state[i] = 0.0
    state[SIGMA] = math.sqrt(max(state[P] + state[P + N + 1], 0.0))
    state[SIGMA + 1] = math.sqrt(max(state[P + 2 * (N + 1)], 0.0))


def inject(state: Any) -> None:
    """q <- exp(theta) (x) q, everything else is added."""
    turn_earth(state, state[X], state[X + 1], state[X + 2])
    for i in range(3):
        state[BIAS + i] += state[X + DB + i]
    for i in range(15):
        state[M + i] += state[X + DM + i]


def turn_earth(state: Any, x: float, y: float, z: float) -> None:
    """q <- exp((x, y, z)) (x) q: a turn about earth axes."""
    angle = math.sqrt(x * x + y * y + z * z)
    k = 0.5 - angle * angle / 48.0 if angle < 1e-3 else math.sin(0.5 * angle) / angle
    c = math.cos(0.5 * angle)
    multiply_left(state, c, k * x, k * y, k * z)


def multiply_left(state: Any, p0: float, p1: float, p2: float, p3: float) -> None:
    """q <- p (x) q, of unit length."""
    q0 = state[Q]
    q1 = state[Q + 1]
    q2 = state[Q + 2]
    q3 = state[Q + 3]
    a = p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3
    b = p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2
    c = p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1
    d = p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0
    inv = 1.0 / math.sqrt(a * a + b * b + c * c + d * d)
    state[Q] = inv * a
    state[Q + 1] = inv * b
    state[Q + 2] = inv * c
    state[Q + 3] = inv * d


def look_for_rest(state: Any, params: Any, dt: float, gyr: Any, acc: Any) -> None:
    """How long gyro and accelerometer have been quiet: their fast low-pass stays near their slow one."""
    fast = 1.0 - math.exp(-dt / 0.04)
    slow = 1.0 - math.exp(-dt / 0.5)
    off_g = 0.0
    off_a = 0.0
    turning = 0.0
    for i in range(3):
        if state[AGE] == 0.0:
            state[FAST_G + i] = gyr[i]
            state[SLOW_G + i] = gyr[i]
            state[FAST_A + i] = acc[i]
            state[SLOW_A + i] = acc[i]
        state[FAST_G + i] += fast * (gyr[i] - state[FAST_G + i])
        state[SLOW_G + i] += slow * (gyr[i] - state[SLOW_G + i])
        state[FAST_A + i] += fast * (acc[i] - state[FAST_A + i])
        state[SLOW_A + i] += slow * (acc[i] - state[SLOW_A + i])
        off_g += square(state[FAST_G + i] - state[SLOW_G + i])
        off_a += square(state[FAST_A + i] - state[SLOW_A + i])
        sigma = math.sqrt(max(state[P + (N + 1) * (DB + i)], 0.0))
        sigma = RAD * params[4] if state[STAGE] == ALIGNING else sigma
        turning = max(turning, abs(state[SLOW_G + i] - state[BIAS + i]) - 3.0 * sigma)
    state[AGE] += dt
    quiet = off_g < square(0.7 * RAD) and off_a < square(0.2) and turning < RAD
    state[QUIET] = state[QUIET] + dt if quiet else 0.0


def align(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """The start: vectors summed in a frame turned by the gyro show that frame's attitude."""
    turn(state[Q:M], gyr[0], gyr[1], gyr[2], dt, 0.0)
    state[T] += dt
    add_turned(state, acc, dt, SUM_F)
    add_turned(state, mag, 1.0, SUM_M)
    f0 = state[Q]
    f1 = state[Q + 1]
    f2 = state[Q + 2]
    f3 = state[Q + 3]
    size = math.sqrt(square(state[SUM_F]) + square(state[SUM_F + 1]) + square(state[SUM_F + 2]))
    if size > 0.0:
        # The shortest turn that brings the sum of specific force up.
        w = max(1.0 - state[SUM_F + 2] / size, 1e-12)
        multiply_left(state, w, -state[SUM_F + 1] / size, state[SUM_F] / size, 0.0)
    # What that turn makes of the field.
    p0, p1, p2, p3 = quotient(state, f0, f1, f2, f3)
    mx = state[SUM_M]
    my = state[SUM_M + 1]
    mz = state[SUM_M + 2]
    tx = 2.0 * (p2 * mz - p3 * my)
    ty = 2.0 * (p3 * mx - p1 * mz)
    tz = 2.0 * (p1 * my - p2 * mx)
    hx = mx + p0 * tx + p2 * tz - p3 * ty
    hy = my + p0 * ty + p3 * tx - p1 * tz
    hz = mz + p0 * tz + p1 * ty - p2 * tx
    seen = hx != 0.0 or hy != 0.0
    if seen:
        turn_earth(state, 0.0, 0.0, -math.atan2(hy, hx))
    for i in range(4):
        state[i] = state[Q + i]
    if state[T] < params[14] or size == 0.0:
        state[Q] = f0
        state[Q + 1] = f1
        state[Q + 2] = f2
        state[Q + 3] = f3
        return
    state[T] = 0.0
    state[STAGE] = RUNNING if seen else NO_FIELD
    begin(state, params)
    if seen:
        first_heading(state, params, math.sqrt(hx * hx + hy * hy), 0.0, hz)


def quotient(state: Any, f0: float, f1: float, f2: float, f3: float) -> tuple[float, float, float, float]:
    """p with q = p (x) f."""
    q0 = state[Q]
    q1 = state[Q + 1]
    q2 = state[Q + 2]
    q3 = state[Q + 3]
    return (
        q0 * f0 + q1 * f1 + q2 * f2 + q3 * f3,
        -q0 * f1 + q1 * f0 - q2 * f3 + q3 * f2,
        -q0 * f2 + q2 * f0 - q3 * f1 + q1 * f3,
        -q0 * f3 + q3 * f0 - q1 * f2 + q2 * f1,
    )


def add_turned(state: Any, v: Any, factor: float, at: int) -> None:
    """Add R v times the factor to the three entries at ``at``."""
    q0 = state[Q]
    q1 = state[Q + 1]
    q2 = state[Q + 2]
    q3 = state[Q + 3]
    tx = 2.0 * (q2 * v[2] - q3 * v[1])
    ty = 2.0 * (q3 * v[0] - q1 * v[2])
    tz = 2.0 * (q1 * v[1] - q2 * v[0])
    state[at] += factor * (v[0] + q0 * tx + q2 * tz - q3 * ty)
    state[at + 1] += factor * (v[1] + q0 * ty + q3 * tx - q1 * tz)
    state[at + 2] += factor * (v[2] + q0 * tz + q1 * ty - q2 * tx)


def begin(state: Any, params: Any) -> None:
    """P at the end of the alignment."""
    for i in range(3):
        state[P + (N + 1) * i] = square(RAD * (params[15] if i < 2 else params[16]))
        state[P + (N + 1) * (DB + i)] = square(RAD * params[4])
        state[P + (N + 1) * (DBA + i)] = square(params[7])
    for i in range(9):
        state[P + (N + 1) * (DM + i)] = square(params[5] if i % 4 == 0 else params[6])
    for i in range(DV, DD):
        state[P + (N + 1) * i] = 1.0
    state[V_MEAN] = square(params[9])


def first_field(state: Any, params: Any, x: float, y: float, z: float) -> None:
    """A field that comes late: everything that is told in earth axes turns to the heading that it shows."""
    psi = math.atan2(y, x)
    s = -math.sin(psi)
    c = math.cos(psi)
    turn_earth(state, 0.0, 0.0, -psi)
    turn_pair(state, V, 1, c, s)
    turn_pair(state, X, 1, c, s)
    turn_pair(state, X + DV, 1, c, s)
    for j in range(N):
        turn_pair(state, P + j, N, c, s)
        turn_pair(state, P + DV * N + j, N, c, s)
    for i in range(N):
        turn_pair(state, P + N * i, 1, c, s)
        turn_pair(state, P + N * i + DV, 1, c, s)
    state[STAGE] = RUNNING
    first_heading(state, params, math.sqrt(x * x + y * y), 0.0, z)


def turn_pair(state: Any, at: int, by: int, c: float, s: float) -> None:
    """Turn the north and the east entry, which stand at ``at`` and ``at + by``."""
    north = state[at]
    east = state[at + by]
    state[at] = c * north - s * east
    state[at + by] = s * north + c * east


def first_heading(state: Any, params: Any, x: float, y: float, z: float) -> None:
    """Variance of a heading taken from the field: its own, the tilt's part, and that of d, which is the same error."""
    lean = min(max(z / x, -6.0), 6.0)
    offset = square(RAD * params[FIELD_SIGMA])
    for j in range(N):
        state[P + 2 * N + j] = lean * state[P + j]
    state[P + 2 * (N + 1)] = square(lean) * state[P] + square(RAD * params[16]) + offset
    for j in range(N):
        state[P + N * DD + j] = 0.0
    state[P + N * DD + 2] = offset
    state[P + N * DD + DD] = offset
    for j in range(N):
        state[P + N * j + 2] = state[P + N * 2 + j]
        state[P + N * j + DD] = state[P + N * DD + j]
    state[X + 2] = lean * state[X]
    state[X + DD] = 0.0
