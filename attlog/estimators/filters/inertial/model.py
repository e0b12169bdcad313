"""State, errors and parameters of ``mekf`` by name, and the rotations that its parts share."""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.interface import Parameter
from attlog.estimators.vectors import multiplied, places, quaternion

# Errors that the covariance holds: attitude (earth axes), gyro bias, gyro matrix, accelerometer bias, velocity, and the
# headings of the field, here and at the first rest.
ERROR_SIZES = {"theta": 3, "bias": 3, "M": 9, "ba": 3, "v": 2, "d": 1, "home": 1}
N = sum(ERROR_SIZES.values())
STATE = {
    "q": 4,
    "bias": 3,
    "sigma_tilt": 1,
    "sigma_heading": 1,
    # The filter's attitude (``q`` is turned on by ``lead``), and what an error M, ba, v, d, home corrects, in order.
    "_attitude": 4,
    "_M": 9,
    "_ba": 3,
    "_v": 2,
    "_d": 1,
    "_home": 1,
    "_P": N * N,
    "_x": N,
    "_column": N,
    # Sums of the block: time, A, B, int a dt, square of the turn; then of the gyro and of the field in earth axes.
    "_seconds": 1,
    "_A": 9,
    "_B": 27,
    "_impulse": 3,
    "_turned": 1,
    "_gyro": 3,
    "_field_sum": 3,
    "_field_count": 1,
    "_v_mean": 1,
    # Low-passes that show rest, and for how long there was some.
    "_fast_gyro": 3,
    "_slow_gyro": 3,
    "_fast_acc": 3,
    "_slow_acc": 3,
    "_quiet": 1,
    "_age": 1,
    # The alignment: sums of force and field, and of t F, |F|^2 and t^2.
    "_stage": 1,
    "_start_acc": 3,
    "_start_mag": 3,
    "_swing": 5,
    # The field: low-passed, the candidate of a reference, norm and dip of the reference, times in s.
    "_field_now": 3,
    "_candidate_field": 3,
    "_norm": 1,
    "_dip": 1,
    "_field_time": 1,
    "_field_since": 1,
    "_undisturbed": 1,
    "_rejected": 1,
    "_candidate_time": 1,
    # The field at the first rest: norm, dip, seconds of it, and whether that rest is over.
    "_home_norm": 1,
    "_home_dip": 1,
    "_home_time": 1,
    "_home_left": 1,
    # Calibration of the magnetometer: earth field, offset and delay, in units of the first field's size.
    "_cal": 7,
    "_cal_P": 49,
    "_unit": 1,
    "_expected": 1,
    "_expect_time": 1,
    # What the covariance leaves out (:mod:`compass`).
    "_reach": 3 * N,
    "_slow": 2,
    "_slow_variance": 1,
    "_excess": 1,
    "_level": 1,
    "_level_spread": 1,
    "_down": 1,
    "_down_spread": 1,
    "_field_clock": 1,
    "_field_doubt": 1,
    "_heading_doubt": 1,
    "_field_off": 1,
    "_air": 5,
    "_force": 3,
}
RECORDED = "tuned on BROAD and EuRoC with altered copies"
PHYSICAL = "attlog; MEMS data sheets"
TRUTH = "attlog; flights with truth"
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
    Parameter("mag_noise", 14.0, "deg*sqrt(s)", 0.01, 1000, "noise density of the field's heading", RECORDED),
    Parameter("mag_gate", 2.0, "", 0.1, 100, "sigmas beyond which a heading weighs less", RECORDED),
    Parameter("delay_sigma", 15.0, "ms", 0, 1000, "delay of the magnetometer expected; it is estimated", PHYSICAL),
    Parameter("offset_sigma", 0.06, "", 0, 10, "body-fixed field expected, as part of the field", RECORDED),
    Parameter("field_sigma", 0.0, "deg", 0, 90, "deviation of the local field's heading", RECORDED),
    Parameter("field_time", 60.0, "s", 0.1, 10000, "time of motion after which it is another", RECORDED),
    Parameter(
        "home_noise", 0.0, "deg", 0, 90, "direction of the first rest's field when seen again, sigma; 0: off", PHYSICAL
    ),
    Parameter("lead", 0.0, "ms", -100, 100, "output turned on by this time: for an IMU that lags", "attlog"),
    # Half of the flights with truth have more; it moves no attitude.
    Parameter("acc_bias_considered", 0.12, "m/s^2", 0, 10, "accelerometer bias beyond that counted in sigmas", TRUTH),
    Parameter("moving_sigma", 4.0, "deg", 0.01, 90, "tilt error after a start in motion", TRUTH),
)
# Where each part of state, error and parameters begins.
S, E, K = places(STATE), places(ERROR_SIZES), places({p.name: 1 for p in PARAMETERS})

RAD = math.pi / 180.0
# Stages: the first seconds, no heading from a field yet, everything runs.
ALIGNING, NO_FIELD, RUNNING = 0.0, 1.0, 2.0
# Rate [rad/s] from which a body counts as moving about.
MOVING_RATE = 0.35


def square(x: float) -> float:
    """Return x^2."""
    return x * x


def turn_earth(state: Any, x: float, y: float, z: float) -> None:
    """Turn the attitude about earth axes: q <- exp((x, y, z)) (x) q."""
    angle = math.sqrt(x * x + y * y + z * z)
    k = 0.5 - angle * angle / 48.0 if angle < 1e-3 else math.sin(0.5 * angle) / angle
    multiply_left(state, math.cos(0.5 * angle), k * x, k * y, k * z)


def multiply_left(state: Any, p0: float, p1: float, p2: float, p3: float) -> None:
    """Multiply the attitude from the left, q <- p (x) q, and normalise it."""
    a, b, c, d = multiplied(p0, p1, p2, p3, *quaternion(state, S.attitude))
    inv = 1.0 / math.sqrt(a * a + b * b + c * c + d * d)
    state[S.attitude], state[S.attitude + 1] = inv * a, inv * b
    state[S.attitude + 2], state[S.attitude + 3] = inv * c, inv * d


def product(state: Any, at: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the 3 x 3 matrix at ``at``, row by row, times a vector."""
    return (
        state[at] * x + state[at + 1] * y + state[at + 2] * z,
        state[at + 3] * x + state[at + 4] * y + state[at + 5] * z,
        state[at + 6] * x + state[at + 7] * y + state[at + 8] * z,
    )
