"""Where things stand in the state of ``mekf`` and in its parameters, and what its parts share."""

from __future__ import annotations

import math
from typing import Any

N = 21
BIAS, SIGMA, Q, M, BA, V, D, P, X, C = 4, 7, 9, 13, 22, 25, 27, 28, 469, 490
T, A, B, S, TURNED, G, H, H_COUNT, V_MEAN = 511, 512, 521, 548, 551, 552, 555, 558, 559
FAST_G, SLOW_G, FAST_A, SLOW_A, QUIET = 560, 563, 566, 569, 572
AGE, STAGE, SUM_F, SUM_M = 573, 574, 575, 578
HL, HC, NORM, DIP, H_TIME, H_SINCE, UNDISTURBED, REJECTED, CLOCK = 581, 584, 587, 588, 589, 590, 591, 592, 593
CAL, CAL_P, UNIT, EXPECTED, EXPECT_TIME = 595, 602, 651, 652, 653
REACH, SLOW, SLOW_VARIANCE, EXCESS = 654, 717, 719, 720
LEVEL, LEVEL_SPREAD, DOWN, DOWN_SPREAD, FIELD_CLOCK, FIELD_DOUBT, HEADING_DOUBT, FIELD_OFF = (
    721,
    722,
    723,
    724,
    725,
    726,
    727,
    728,
)
AIR, F, END = 729, 734, 737
SWING = END
"""Where things stand in the state; the error x holds theta 0, db 3, dM 6, dba 15, dv 18, dd 20."""
TH, DB, DM, DBA, DV, DD = 0, 3, 6, 15, 18, 20
RAD = math.pi / 180.0
ALIGNING, NO_FIELD, RUNNING = 0.0, 1.0, 2.0
"""Stages: the first seconds, no heading from a field yet, everything runs."""
MOVING_RATE = 0.35
"""Rate [rad/s] from which a body counts as moving about."""

# Positions of the parameters.
(
    BLOCK,
    GYRO_NOISE,
    RATE_NOISE,
    BIAS_NOISE,
    BIAS_SIGMA,
    SCALE_SIGMA,
    MISALIGNMENT_SIGMA,
    ACC_BIAS_SIGMA,
    VELOCITY_NOISE,
    VELOCITY_SIGMA,
    VELOCITY_FACTOR,
) = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10
(
    VELOCITY_TIME,
    ALIGN_TIME,
    TILT_SIGMA,
    HEADING_SIGMA,
    MAG_NOISE,
    MAG_GATE,
    DELAY_SIGMA,
    OFFSET_SIGMA,
    FIELD_SIGMA,
    FIELD_TIME,
    LEAD,
    ACC_BIAS_CONSIDERED,
    MOVING_SIGMA,
) = 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23


def square(x: float) -> float:
    """x^2."""
    return x * x


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
