"""How ``mekf`` starts, and when it takes the body to be at rest."""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.filters.inertial.compass import first_heading
from attlog.estimators.filters.inertial.model import (
    ALIGNING,
    NO_FIELD,
    RAD,
    RUNNING,
    E,
    K,
    N,
    S,
    multiply_left,
    square,
    turn_earth,
)
from attlog.estimators.vectors import GRAVITY, matrix, multiplied, quaternion, rotated, turn

# Time constants of the low-passes whose difference shows motion [s], and limits of that difference at rest.
FAST_S, SLOW_S = 0.04, 0.5
REST_GYRO, REST_FORCE_M_S2 = 0.7 * RAD, 0.2
# Sigma [rad] of the first rest's field heading before it is seen: far above any heading's.
UNKNOWN_HOME = 10.0


def look_for_rest(state: Any, params: Any, dt: float, gyr: Any, acc: Any) -> None:
    """Count how long gyro and accelerometer are quiet: their fast low-pass stays near their slow one."""
    fast = 1.0 - math.exp(-dt / FAST_S)
    slow = 1.0 - math.exp(-dt / SLOW_S)
    off_g = 0.0
    off_a = 0.0
    turning = 0.0
    for i in range(3):
        if state[S.age] == 0.0:
            state[S.fast_gyro + i] = state[S.slow_gyro + i] = gyr[i]
            state[S.fast_acc + i] = state[S.slow_acc + i] = acc[i]
        state[S.fast_gyro + i] += fast * (gyr[i] - state[S.fast_gyro + i])
        state[S.slow_gyro + i] += slow * (gyr[i] - state[S.slow_gyro + i])
        state[S.fast_acc + i] += fast * (acc[i] - state[S.fast_acc + i])
        state[S.slow_acc + i] += slow * (acc[i] - state[S.slow_acc + i])
        off_g += square(state[S.fast_gyro + i] - state[S.slow_gyro + i])
        off_a += square(state[S.fast_acc + i] - state[S.slow_acc + i])
        sigma = math.sqrt(max(state[S.P + (N + 1) * (E.bias + i)], 0.0))
        sigma = RAD * params[K.bias_sigma] if state[S.stage] == ALIGNING else sigma
        turning = max(turning, abs(state[S.slow_gyro + i] - state[S.bias + i]) - 3.0 * sigma)
    state[S.age] += dt
    quiet = off_g < square(REST_GYRO) and off_a < square(REST_FORCE_M_S2) and turning < RAD
    state[S.quiet] = state[S.quiet] + dt if quiet else 0.0


def align(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """Sum vectors in a frame turned by the gyro: they show the attitude of that frame."""
    turn(
        state[S.attitude : S.M], gyr[0] - state[S.bias], gyr[1] - state[S.bias + 1], gyr[2] - state[S.bias + 2], dt, 0.0
    )
    state[S.seconds] += dt
    add_turned(state, acc, dt, S.start_acc)
    for i in range(3):
        state[S.swing + i] += dt * state[S.seconds] * state[S.start_acc + i]
        state[S.swing + 3] += dt * square(state[S.start_acc + i])
    state[S.swing + 4] += dt * square(state[S.seconds])
    add_turned(state, mag, 1.0, S.start_mag)
    floating = quaternion(state, S.attitude)
    fx, fy, fz = state[S.start_acc], state[S.start_acc + 1], state[S.start_acc + 2]
    size = math.sqrt(fx * fx + fy * fy + fz * fz)
    if size > 0.0:
        # The shortest turn that brings the sum of specific force up.
        multiply_left(state, max(1.0 - fz / size, 1e-12), -fy / size, fx / size, 0.0)
    # What that turn makes of the field.
    q0, q1, q2, q3 = quaternion(state, S.attitude)
    p0, p1, p2, p3 = multiplied(q0, q1, q2, q3, floating[0], -floating[1], -floating[2], -floating[3])
    hx, hy, hz = rotated(p0, p1, p2, p3, state[S.start_mag], state[S.start_mag + 1], state[S.start_mag + 2])
    seen = hx != 0.0 or hy != 0.0
    if seen:
        turn_earth(state, 0.0, 0.0, -math.atan2(hy, hx))
    for i in range(4):
        state[i] = state[S.attitude + i]
    if state[S.seconds] < params[K.align_time] or size == 0.0:
        for i in range(4):
            state[S.attitude + i] = floating[i]
        return
    begin(state, params)
    state[S.seconds] = 0.0
    state[S.stage] = RUNNING if seen else NO_FIELD
    if seen:
        first_heading(state, params, math.sqrt(hx * hx + hy * hy), hz)


def add_turned(state: Any, v: Any, factor: float, at: int) -> None:
    """Add R v times the factor to the three entries at ``at``."""
    q0, q1, q2, q3 = quaternion(state, S.attitude)
    x, y, z = rotated(q0, q1, q2, q3, v[0], v[1], v[2])
    state[at] += factor * x
    state[at + 1] += factor * y
    state[at + 2] += factor * z


def begin(state: Any, params: Any) -> None:
    """Set covariance and priors at the end of the alignment."""
    for i in range(3):
        state[S.P + (N + 1) * i] = square(first_tilt(state, params) if i < 2 else RAD * params[K.heading_sigma])
        state[S.P + (N + 1) * (E.bias + i)] = square(RAD * params[K.bias_sigma])
        state[S.P + (N + 1) * (E.ba + i)] = square(params[K.acc_bias_sigma])
    start_reach(state)
    for i in range(9):
        state[S.P + (N + 1) * (E.M + i)] = square(params[K.scale_sigma] if i % 4 == 0 else params[K.misalignment_sigma])
    for i in range(E.v, E.d):
        state[S.P + (N + 1) * i] = 1.0
    if params[K.home_noise] > 0.0:
        state[S.P + (N + 1) * E.home] = square(UNKNOWN_HOME)
    state[S.excess] = 1.0
    state[S.expected] = square(params[K.acc_bias_sigma])
    state[S.v_mean] = max(square(params[K.velocity_sigma]), 0.5 * square_swing(state))


def square_swing(state: Any) -> float:
    """Return the mean square [m^2/s^2] of velocity in the alignment beside an even acceleration: <|F - <f> t|^2>.

    F is the sum of specific force f; ``S.swing`` holds the sums of t F (3), |F|^2 and t^2.
    """
    time: float = state[S.seconds]
    if time <= 0.0:
        return 0.0
    total: float = state[S.swing + 3]
    for i in range(3):
        mean = state[S.start_acc + i] / time
        total += mean * (mean * state[S.swing + 4] - 2.0 * state[S.swing + i])
    return max(total / time, 0.0)


def first_tilt(state: Any, params: Any) -> float:
    """Return the sigma in rad, per axis, of the tilt after the alignment."""
    tilt: float = RAD * params[K.tilt_sigma]
    return tilt if state[S.quiet] >= 1.0 else max(tilt, RAD * params[K.moving_sigma])


def start_reach(state: Any) -> None:
    """Set D at the end of the alignment, which takes an accelerometer bias for a tilt."""
    R = matrix(state, S.attitude)
    for i in range(3):
        state[S.reach + N * i + E.ba + i] = 1.0
        state[S.reach + N * i] = R[3 + i] / GRAVITY
        state[S.reach + N * i + 1] = -R[i] / GRAVITY
