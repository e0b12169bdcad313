"""Where things stand in the state of ``mekf`` and in its parameters, and what its parts share."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from attlog.core import jit
from attlog.core.jit import F2, Out1, Out2

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
# Where things stand in the state; the error x holds theta 0, db 3, dM 6, dba 15, dv 18, dd 20.
SWING = END
TH, DB, DM, DBA, DV, DD = 0, 3, 6, 15, 18, 20
RAD = math.pi / 180.0
# Stages: the first seconds, no heading from a field yet, everything runs.
ALIGNING, NO_FIELD, RUNNING = 0.0, 1.0, 2.0
# Rate [rad/s] from which a body counts as moving about.
MOVING_RATE = 0.35

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


# Equations (1) and (2) of :mod:`backward`, block after block. One function for the compiler.


class Blocks(NamedTuple):
    """Blocks (m): gains C from each to the one before, covariance before it, and after the one before it (N * N).

    ``error`` (m, N) what was corrected, ``nominal`` (m, N - 3) the states after it.
    """

    gains: F2
    before: F2
    after: F2
    error: F2
    nominal: F2


class Corrections(NamedTuple):
    """Written for each block: attitude at its begin and end (m, 3), states (m, N - 3), variance (m, 2) at its end.

    Variances, and ``considered``, the squares of D, are those of tilt and heading.
    """

    at_begin: Out2
    at_end: Out2
    states: Out2
    variance: Out2
    considered: Out2


def composed(a: Any, b: Any, out: Any) -> None:
    """``out`` (3,) becomes the rotation vector of exp(a) exp(b)."""
    x = 0.5 * math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    y = 0.5 * math.sqrt(b[0] * b[0] + b[1] * b[1] + b[2] * b[2])
    u = 0.5 * math.sin(x) / x if x > 1e-9 else 0.5
    v = 0.5 * math.sin(y) / y if y > 1e-9 else 0.5
    a0, a1, a2, a3 = math.cos(x), u * a[0], u * a[1], u * a[2]
    b0, b1, b2, b3 = math.cos(y), v * b[0], v * b[1], v * b[2]
    w = a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3
    c1 = a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2
    c2 = a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1
    c3 = a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0
    s = math.sqrt(c1 * c1 + c2 * c2 + c3 * c3)
    k = 2.0 * math.atan2(s, abs(w)) / s if s > 1e-12 else 2.0
    k = -k if w < 0.0 else k
    out[0], out[1], out[2] = k * c1, k * c2, k * c3


def added(out: Any, i: int, factor: float, x: Any, j: int) -> None:
    """Row ``i`` of ``out`` += factor times row ``j`` of ``x``, matrices (N * N,) row by row."""
    for m in range(N):
        out[i * N + m] += factor * x[j * N + m]


def sandwiched(G: Any, D: Any, add: Any, half: Any, turned: Any) -> None:
    """``D`` <- add + G D G^T, all (N * N,) row by row; ``half`` and ``turned`` are scratch."""
    for i in range(N):
        for k in range(N):
            turned[k * N + i] = G[i * N + k]
            half[i * N + k] = 0.0
    for i in range(N):
        for k in range(N):
            added(half, i, G[i * N + k], D, k)
    for i in range(N * N):
        D[i] = add[i]
    for i in range(N):
        for k in range(N):
            added(D, i, half[i * N + k], turned, k)


@jit.loop("the inertial smoother, backward")
def recursion(
    blocks: Blocks,
    out: Corrections,
    dx: Out1,
    covariance: Out1,
    reach_before: F2,
    reach_after: F2,
    reach: Out1,
    half: Out1,
    turned: Out1,
    delta: Out1,
    gap: Out1,
) -> None:
    """Go back through the blocks: ``dx`` (N,) and ``covariance`` (N * N,) are carried on in place.

    D of the compass is an error like another: ``reach`` (3 * N,) is carried on, with ``reach_before`` of the block and
    ``reach_after`` (m, 3 * N) of the one before it. Scratch: ``half``, ``turned`` (N * N,), ``delta``, ``gap`` (N,).
    """
    for k in range(len(blocks.gains) - 1, -1, -1):
        for i in range(N - 3):
            out.states[k, i] = blocks.nominal[k, i] + dx[3 + i]
        out.variance[k, 0] = covariance[0] + covariance[N + 1]
        out.variance[k, 1] = covariance[2 * N + 2]
        composed(dx, blocks.error[k], delta)
        for i in range(3, N):
            delta[i] = dx[i] + blocks.error[k, i]
        for i in range(3):
            out.at_end[k, i] = delta[i]
        for i in range(N):
            total = 0.0
            for j in range(N):
                total += blocks.gains[k, i * N + j] * delta[j]
            dx[i] = total
        for i in range(3):
            out.at_begin[k, i] = dx[i]
        for i in range(N * N):
            covariance[i] -= blocks.before[k, i]
        sandwiched(blocks.gains[k], covariance, blocks.after[k], half, turned)
        out.considered[k, 0] = 0.0
        out.considered[k, 1] = 0.0
        for c in range(3):
            at = c * N
            out.considered[k, 0] += reach[at] * reach[at] + reach[at + 1] * reach[at + 1]
            out.considered[k, 1] += reach[at + 2] * reach[at + 2]
            for i in range(N):
                gap[i] = reach[at + i] - reach_before[k, at + i]
            for i in range(N):
                total = reach_after[k, at + i]
                for j in range(N):
                    total += blocks.gains[k, i * N + j] * gap[j]
                reach[at + i] = total
