"""How ``mekf`` starts, and when it takes the body to be at rest."""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.filters.inertial.compass import first_heading
from attlog.estimators.filters.inertial.recursion import (
    ACC_BIAS_SIGMA,
    AGE,
    ALIGN_TIME,
    ALIGNING,
    BIAS,
    BIAS_SIGMA,
    DB,
    DBA,
    DD,
    DM,
    DV,
    EXCESS,
    EXPECTED,
    FAST_A,
    FAST_G,
    HEADING_SIGMA,
    MISALIGNMENT_SIGMA,
    MOVING_SIGMA,
    NO_FIELD,
    QUIET,
    RAD,
    REACH,
    RUNNING,
    SCALE_SIGMA,
    SLOW_A,
    SLOW_G,
    STAGE,
    SUM_F,
    SUM_M,
    SWING,
    TILT_SIGMA,
    V_MEAN,
    VELOCITY_SIGMA,
    M,
    N,
    P,
    Q,
    T,
    multiply_left,
    square,
    turn_earth,
)
from attlog.estimators.vectors import turn


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
        sigma = RAD * params[BIAS_SIGMA] if state[STAGE] == ALIGNING else sigma
        turning = max(turning, abs(state[SLOW_G + i] - state[BIAS + i]) - 3.0 * sigma)
    state[AGE] += dt
    quiet = off_g < square(0.7 * RAD) and off_a < square(0.2) and turning < RAD
    state[QUIET] = state[QUIET] + dt if quiet else 0.0


def align(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """The start: vectors summed in a frame turned by the gyro show that frame's attitude."""
    turn(state[Q:M], gyr[0] - state[BIAS], gyr[1] - state[BIAS + 1], gyr[2] - state[BIAS + 2], dt, 0.0)
    state[T] += dt
    add_turned(state, acc, dt, SUM_F)
    for i in range(3):
        state[SWING + i] += dt * state[T] * state[SUM_F + i]
        state[SWING + 3] += dt * square(state[SUM_F + i])
    state[SWING + 4] += dt * square(state[T])
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
    if state[T] < params[ALIGN_TIME] or size == 0.0:
        state[Q] = f0
        state[Q + 1] = f1
        state[Q + 2] = f2
        state[Q + 3] = f3
        return
    begin(state, params)
    state[T] = 0.0
    state[STAGE] = RUNNING if seen else NO_FIELD
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
        state[P + (N + 1) * i] = square(first_tilt(state, params) if i < 2 else RAD * params[HEADING_SIGMA])
        state[P + (N + 1) * (DB + i)] = square(RAD * params[BIAS_SIGMA])
        state[P + (N + 1) * (DBA + i)] = square(params[ACC_BIAS_SIGMA])
    start_reach(state)
    for i in range(9):
        state[P + (N + 1) * (DM + i)] = square(params[SCALE_SIGMA] if i % 4 == 0 else params[MISALIGNMENT_SIGMA])
    for i in range(DV, DD):
        state[P + (N + 1) * i] = 1.0
    state[EXCESS] = 1.0
    state[EXPECTED] = square(params[ACC_BIAS_SIGMA])
    state[V_MEAN] = max(square(params[VELOCITY_SIGMA]), 0.5 * square_swing(state))


def square_swing(state: Any) -> float:
    """Mean square [m^2/s^2] of the velocity during the alignment beside an even acceleration: <|F - <f> t|^2>.

    F is the sum of specific force f; ``SWING`` holds the sums of t F (3), |F|^2 and t^2.
    """
    time: float = state[T]
    if time <= 0.0:
        return 0.0
    total: float = state[SWING + 3]
    for i in range(3):
        mean = state[SUM_F + i] / time
        total += mean * (mean * state[SWING + 4] - 2.0 * state[SWING + i])
    return max(total / time, 0.0)


def first_tilt(state: Any, params: Any) -> float:
    """Sigma in rad, per axis, of the tilt after the alignment."""
    tilt: float = RAD * params[TILT_SIGMA]
    return tilt if state[QUIET] >= 1.0 else max(tilt, RAD * params[MOVING_SIGMA])


def start_reach(state: Any) -> None:
    """D of ``doubt.py`` at the end of the alignment, which takes an accelerometer bias for a tilt."""
    q0 = state[Q]
    q1 = state[Q + 1]
    q2 = state[Q + 2]
    q3 = state[Q + 3]
    g = 9.80665
    for i in range(3):
        state[REACH + N * i + DBA + i] = 1.0
    state[REACH] = 2.0 * (q1 * q2 + q0 * q3) / g
    state[REACH + 1] = -(1.0 - 2.0 * (q2 * q2 + q3 * q3)) / g
    state[REACH + N] = (1.0 - 2.0 * (q1 * q1 + q3 * q3)) / g
    state[REACH + N + 1] = -2.0 * (q1 * q2 - q0 * q3) / g
    state[REACH + 2 * N] = 2.0 * (q2 * q3 - q0 * q1) / g
    state[REACH + 2 * N + 1] = -2.0 * (q1 * q3 + q0 * q2) / g
