"""Where things stand in the arrays of the navigation filter.

Error state, 39 numbers: attitude (a rotation vector in earth axes, ``q_true = exp(phi) q``), velocity, position,
gyro bias, accelerometer bias, earth field, hard iron, soft iron (xx yy zz xy xz yz), wandering position error,
barometer bias, GNSS delay, magnetometer delay, lever arm of the antenna, gyro scale. The nominal state ``x`` has
the same places; its first three are unused, the attitude is the quaternion beside it.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.jit import B1, F1, F2, I1, Cells, IOut1, Out1, Out2

N = 39
PHI, V, POS, BG, BA, EARTH, HARD, SOFT, WANDER = 0, 3, 6, 9, 12, 15, 18, 21, 27
BARO_BIAS, GNSS_DELAY, MAG_DELAY, ARM, SCALE = 30, 31, 32, 33, 36

# Kinds of events: GNSS velocity and position, height, field, rest as zero velocity and as zero rate.
VELOCITY, POSITION, BARO, MAG, STILL, NO_RATE = 0, 1, 2, 3, 4, 5
KINDS = 6

# Groups of scalar updates that share a noise level: velocity level, vertical, position level, vertical, height, field,
# zero rate, zero velocity.
GROUPS = 8

GRAVITY_AT, Q_GYRO, Q_ACC, Q_BG, Q_BA, Q_HARD, Q_WANDER, Q_BARO, WANDER_TAU, Q_ACC_REST, SOFT_GATE, HARD_GATE = range(
    12
)
# Places of the numbers that a run of the filter is given.
SETTINGS = 12

SKIPS, MAG_MEAN, SINCE_KICK, RESTING, FROZEN, OPENED, KICKED, SOFTENED, SEEN, LIKELIHOOD = (
    0,
    6,
    7,
    8,
    9,
    13,
    14,
    15,
    16,
    17,
)
# What the filter remembers beside its state: counters of its gates, attitude kept during rest, likelihood.
MEMORY = 18

SUM_T, SUM_A, SUM_D, SUM_W = 0, 1, 4, 13
# Sums over the samples between two nodes: time, R f dt (3), R dt (9), R diag(w) dt (9).
SUMS = 22

# Numbers from one row of a covariance to the next: rows end with a zero and fill whole vector registers.
ROW = 40

# Most entries of a measurement's row that are not zero.
WIDE = 12


IOut1B = Annotated[NDArray[np.int8], Cells("i1", 1, True)]
IOut2B = Annotated[NDArray[np.int8], Cells("i1", 2, True)]


class Motion(NamedTuple):
    """The samples (n,): time since the one before, gyro, accelerometer, 1 at rest."""

    dt: F1
    gyr: F2
    acc: F2
    rest: B1


class Nodes(NamedTuple):
    """The nodes (m,): sample, first event (m + 1,), by how many rad/s the gyro bias may jump (1 sigma).

    ``along`` (m, 4): the trajectory of linearisation, of one row where there is none.
    """

    at: I1
    event: I1
    jump: F1
    along: F2


class Events(NamedTuple):
    """The events (e,): kind, time after their sample in s, values, centred means of force and rate, noise (e, 3).

    The noise is 0 where a component is missing.
    """

    kind: I1
    offset: F1
    z: F2
    force: F2
    rate: F2
    sigma: F2


class State(NamedTuple):
    """What the filter carries on in place: attitude (4,), nominal state (39,), covariance (39 * ROW,), memory."""

    q: Out1
    x: Out1
    P: Out1
    memory: Out1

    def copy(self) -> State:
        """Return a state of its own."""
        return State(*(x.copy() for x in self))


class Filtered(NamedTuple):
    """Attitude (n, 4) at the samples; bias and variance of the attitude (m, 3), test ratios (m, 4) at the nodes."""

    q: Out2
    bias: Out2
    variance: Out2
    ratio: Out2


class Kept(NamedTuple):
    """What the way back needs of some nodes and of their updates, counted from the first; ``sums`` (nodes, SUMS).

    ``P_rows``: six rows of P of each node; ``update_of`` (nodes + 1,) first update. Of each update: gain ``K``, entries
    ``H`` at the states ``H_at``, how many, variance of the innovation, innovation, noise, group, 1 if softly gated.
    """

    P_rows: Out1
    sums: Out2
    update_of: IOut1
    K: Out1
    H: Out2
    H_at: IOut2B
    wide_of: IOut1B
    s_of: Out1
    nu_of: Out1
    r_of: Out1
    group: IOut1B
    soft: IOut1B


# What each aid says of the state: residual, non-zero entries of its rows, and noise. Plain functions for the kernels.
#
# | aid | predicted |
# | --- | --- |
# | GNSS velocity, valid at its stamp less the delay | v + a e + R (w x l) - a tg |
# | GNSS position | p + v e + R l + pb - v tg |
# | height | -p_d - v_d e + bb |
# | field | (I + S) m + bm with m = R^T M + (R^T M x w)(e - tm) |
# | rest | v = 0; the gyro shows its bias |
#
# ``e`` is the time from the sample to which the event was moved; ``a`` the earth acceleration from a centred 0.1 s
# mean
# of the accelerometer, ``w`` a centred 60 ms mean of the gyro: single samples would bias the delays.


def to_matrix3(q: Any, R: Any) -> None:
    """R (3, 3) from body to earth of a unit quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)


def turn_body(q: Any, x: float, y: float, z: float) -> None:
    """q <- q exp(v / 2) for a rotation vector in body axes, unit length kept."""
    turn(q, x, y, z, 1.0)


def turn_earth(q: Any, x: float, y: float, z: float) -> None:
    """q <- exp(v / 2) q for a rotation vector in earth axes, unit length kept."""
    turn(q, x, y, z, -1.0)


def turn(q: Any, x: float, y: float, z: float, side: float) -> None:
    """Multiply by exp(v / 2) from the right (side 1) or the left (side -1)."""
    angle = math.sqrt(x * x + y * y + z * z)
    c = math.cos(0.5 * angle)
    s = 0.5 if angle < 1e-12 else math.sin(0.5 * angle) / angle
    x, y, z = s * x, s * y, s * z
    a, b, d, e = q[0], q[1], q[2], q[3]
    n0 = a * c - b * x - d * y - e * z
    n1 = a * x + b * c + side * (d * z - e * y)
    n2 = a * y + d * c + side * (e * x - b * z)
    n3 = a * z + e * c + side * (b * y - d * x)
    norm = 1.0 / math.sqrt(n0 * n0 + n1 * n1 + n2 * n2 + n3 * n3)
    q[0], q[1], q[2], q[3] = n0 * norm, n1 * norm, n2 * norm, n3 * norm


def between(R: Any, L: Any, out: Any) -> float:
    """out = log(R L^T), a small rotation vector in earth axes; returns its angle in rad (1 where it is not small)."""
    x = y = z = trace = 0.0
    for k in range(3):
        x += R[2, k] * L[1, k] - R[1, k] * L[2, k]
        y += R[0, k] * L[2, k] - R[2, k] * L[0, k]
        z += R[1, k] * L[0, k] - R[0, k] * L[1, k]
        trace += R[0, k] * L[0, k] + R[1, k] * L[1, k] + R[2, k] * L[2, k]
    s = 0.5 * math.sqrt(x * x + y * y + z * z)
    if s > 0.5 or trace < 1.0:
        return 1.0
    scale = 0.5 if s < 1e-9 else 0.5 * math.asin(s) / s
    out[0], out[1], out[2] = scale * x, scale * y, scale * z
    return 2.0 * scale * s


def field_rows(x: Any, x0: Any, R: Any, J: Any, e: float, w: Any, z: Any, linear: bool, work: Any, row: Any) -> int:
    """Write residual and rows of a field sample; return entries per row.

    ``J`` is the attitude (3, 3) of the Jacobian, ``x0`` (39,) the state that gives its field and soft iron: running
    estimates would let every sample at a slightly different attitude invent heading. ``linear``: the residual is
    linear about (J, x0) as well. ``work`` (4, 3).
    """
    r, hi, hv = row.r, row.hi, row.hv
    m, c, d, phi = work[0], work[1], work[2], work[3]
    S = SOFT
    for i in range(3):
        m[i] = J[0, i] * x0[EARTH] + J[1, i] * x0[EARTH + 1] + J[2, i] * x0[EARTH + 2]
    c[0], c[1], c[2] = m[1] * w[2] - m[2] * w[1], m[2] * w[0] - m[0] * w[2], m[0] * w[1] - m[1] * w[0]
    for n in range(3):
        s0 = x0[S] if n == 0 else x0[S + 3] if n == 1 else x0[S + 4]
        s1 = x0[S + 3] if n == 0 else x0[S + 1] if n == 1 else x0[S + 5]
        s2 = x0[S + 4] if n == 0 else x0[S + 5] if n == 1 else x0[S + 2]
        s0 += 1.0 if n == 0 else 0.0
        s1 += 1.0 if n == 1 else 0.0
        s2 += 1.0 if n == 2 else 0.0
        for k in range(3):
            d[k] = s0 * J[k, 0] + s1 * J[k, 1] + s2 * J[k, 2]
        hi[n, 0], hi[n, 1], hi[n, 2] = PHI, PHI + 1, PHI + 2
        hv[n, 0] = d[1] * x0[EARTH + 2] - d[2] * x0[EARTH + 1]
        hv[n, 1] = d[2] * x0[EARTH] - d[0] * x0[EARTH + 2]
        hv[n, 2] = d[0] * x0[EARTH + 1] - d[1] * x0[EARTH]
        for k in range(3):
            hi[n, 3 + k], hv[n, 3 + k] = EARTH + k, d[k]
        hi[n, 6], hv[n, 6] = HARD + n, 1.0
        hi[n, 7], hi[n, 8], hi[n, 9] = S + n, S, S
        hv[n, 7] = m[n]
        if n == 0:
            hi[n, 8], hv[n, 8], hi[n, 9], hv[n, 9] = S + 3, m[1], S + 4, m[2]
        elif n == 1:
            hi[n, 8], hv[n, 8], hi[n, 9], hv[n, 9] = S + 3, m[0], S + 5, m[2]
        else:
            hi[n, 8], hv[n, 8], hi[n, 9], hv[n, 9] = S + 4, m[0], S + 5, m[1]
        hi[n, 10], hv[n, 10] = MAG_DELAY, -(s0 * c[0] + s1 * c[1] + s2 * c[2])
    if linear:
        between(R, J, phi)
        for n in range(3):
            h = x0[HARD + n] + m[n] + c[n] * (e - x0[MAG_DELAY])
            h += soft_times(x0, n, m, c, e - x0[MAG_DELAY])
            for k in range(3):
                h += hv[n, k] * phi[k]
            for k in range(3, 11):
                h += hv[n, k] * (x[hi[n, k]] - x0[hi[n, k]])
            r[n] = z[n] - h
        return 11
    for i in range(3):
        m[i] = R[0, i] * x[EARTH] + R[1, i] * x[EARTH + 1] + R[2, i] * x[EARTH + 2]
    c[0], c[1], c[2] = m[1] * w[2] - m[2] * w[1], m[2] * w[0] - m[0] * w[2], m[0] * w[1] - m[1] * w[0]
    lead = e - x[MAG_DELAY]
    for n in range(3):
        r[n] = z[n] - x[HARD + n] - m[n] - c[n] * lead - soft_times(x, n, m, c, lead)
    return 11


def soft_times(x: Any, row: int, m: Any, c: Any, lead: float) -> float:
    """One component of S (m + c lead)."""
    S = SOFT
    a, b, d = m[0] + c[0] * lead, m[1] + c[1] * lead, m[2] + c[2] * lead
    if row == 0:
        total: float = x[S] * a + x[S + 3] * b + x[S + 4] * d
    elif row == 1:
        total = x[S + 3] * a + x[S + 1] * b + x[S + 5] * d
    else:
        total = x[S + 4] * a + x[S + 5] * b + x[S + 2] * d
    return total


def rows(kind: int, x: Any, R: Any, e: float, f: Any, w: Any, z: Any, par: Any, work: Any, row: Any) -> int:
    """Write residual and rows of an event that is no field sample; return entries per row."""
    r, hi, hv = row.r, row.hi, row.hv
    if kind == VELOCITY:
        a, u = work[0], work[1]
        for i in range(3):
            a[i] = R[i, 0] * (f[0] - x[BA]) + R[i, 1] * (f[1] - x[BA + 1]) + R[i, 2] * (f[2] - x[BA + 2])
        a[2] += par[GRAVITY_AT]
        u[0] = w[1] * x[ARM + 2] - w[2] * x[ARM + 1]
        u[1] = w[2] * x[ARM] - w[0] * x[ARM + 2]
        u[2] = w[0] * x[ARM + 1] - w[1] * x[ARM]
        for i in range(3):
            arm = R[i, 0] * u[0] + R[i, 1] * u[1] + R[i, 2] * u[2]
            r[i] = z[i] - x[V + i] - a[i] * (e - x[GNSS_DELAY]) - arm
            hi[i, 0], hv[i, 0] = V + i, 1.0
            hi[i, 1], hv[i, 1] = GNSS_DELAY, -a[i]
            hi[i, 2], hv[i, 2] = ARM, R[i, 1] * w[2] - R[i, 2] * w[1]
            hi[i, 3], hv[i, 3] = ARM + 1, R[i, 2] * w[0] - R[i, 0] * w[2]
            hi[i, 4], hv[i, 4] = ARM + 2, R[i, 0] * w[1] - R[i, 1] * w[0]
        return 5
    if kind == POSITION:
        for i in range(3):
            arm = R[i, 0] * x[ARM] + R[i, 1] * x[ARM + 1] + R[i, 2] * x[ARM + 2]
            lead = e - x[GNSS_DELAY]
            r[i] = z[i] - x[POS + i] - x[V + i] * lead - arm - x[WANDER + i]
            hi[i, 0], hv[i, 0] = POS + i, 1.0
            hi[i, 1], hv[i, 1] = V + i, lead
            hi[i, 2], hv[i, 2] = WANDER + i, 1.0
            hi[i, 3], hv[i, 3] = GNSS_DELAY, -x[V + i]
            for k in range(3):
                hi[i, 4 + k], hv[i, 4 + k] = ARM + k, R[i, k]
        return 7
    if kind == BARO:
        r[0] = z[0] + x[POS + 2] + x[V + 2] * e - x[BARO_BIAS]
        hi[0, 0], hv[0, 0] = POS + 2, -1.0
        hi[0, 1], hv[0, 1] = V + 2, -e
        hi[0, 2], hv[0, 2] = BARO_BIAS, 1.0
        return 3
    first = V if kind == STILL else BG
    for i in range(3):
        r[i] = z[i] - x[first + i]
        hi[i, 0], hv[i, 0] = first + i, 1.0
    return 1


def group_of(kind: int, row: int) -> int:
    """Which noise level a scalar update belongs to."""
    if kind == VELOCITY:
        return 1 if row == 2 else 0
    if kind == POSITION:
        return 3 if row == 2 else 2
    if kind == BARO:
        return 4
    if kind == MAG:
        return 5
    return 7 if kind == STILL else 6


# How errors grow from node to node: the transition, its transpose, and what they make of a covariance.
#
# With ``T, A, D, W`` the sums over the samples in between (time, R f dt, R dt, R diag(w) dt), in this order and with
# old values on the right:
#
#     p   += T v - T/2 (A x phi + D ba)
#     v   += -A x phi - D ba + 1/2 A x D bg + 1/2 A x W sg
#     phi += -D bg - W sg
#     pb  *= exp(-T / tau)
#
# At rest the gyro is not integrated: no ``D bg`` and no ``W``. A covariance stands row by row, :data:`ROW` numbers
# each,
# in one flat array, exactly symmetric. Only 12 of 39 states move: their rows are multiplied from the left, the part
# where
# they meet from the right as well, and the rest is copied across the diagonal: some N^2 multiplications instead of 2
# N^3.
# Plain functions for the kernels. No sum is reordered by the compiler, so every processor gives the same bits.


def cross_times(a: Any, m: Any, out: Any) -> None:
    """out = [a] m for a vector (3,) and matrices (3, 3)."""
    for j in range(3):
        out[0, j] = a[1] * m[2, j] - a[2] * m[1, j]
        out[1, j] = a[2] * m[0, j] - a[0] * m[2, j]
        out[2, j] = a[0] * m[1, j] - a[1] * m[0, j]


def matrices(sums: Any, rest: int, A: Any, D: Any, W: Any, AD: Any, AW: Any) -> None:
    """Unpack the ``sums`` (SUMS,) to [A], D, W, 1/2 [A] D, 1/2 [A] W, (3, 3) each; at rest those of the gyro are 0."""
    a = sums[SUM_A : SUM_A + 3]
    A[0, 0], A[0, 1], A[0, 2] = 0.0, -a[2], a[1]
    A[1, 0], A[1, 1], A[1, 2] = a[2], 0.0, -a[0]
    A[2, 0], A[2, 1], A[2, 2] = -a[1], a[0], 0.0
    for i in range(3):
        for j in range(3):
            D[i, j] = sums[SUM_D + 3 * i + j]
            W[i, j] = 0.0 if rest == 1 else sums[SUM_W + 3 * i + j]
    cross_times(a, D, AD)
    cross_times(a, W, AW)
    for i in range(3):
        for j in range(3):
            AD[i, j] = 0.0 if rest == 1 else 0.5 * AD[i, j]
            AW[i, j] *= 0.5


def dot(a: Any, i: int, b: Any, j: int) -> float:
    """The product of two rows that begin at ``i`` and ``j``; four sums, since one waits for itself."""
    s0 = s1 = s2 = s3 = 0.0
    for m in range(0, ROW, 4):
        s0 += a[i + m] * b[j + m]
        s1 += a[i + m + 1] * b[j + m + 1]
        s2 += a[i + m + 2] * b[j + m + 2]
        s3 += a[i + m + 3] * b[j + m + 3]
    return (s0 + s1) + (s2 + s3)


def three(P: Any, at: int, a: float, b: float, c: float) -> float:
    """a, b, c times the three numbers from ``at`` on."""
    value: float = (a * P[at] + b * P[at + 1]) + c * P[at + 2]
    return value


def add_product(P: Any, to: int, at: int, by: float, A: Any) -> None:
    """Rows ``to`` to ``to + 2`` of P gain ``by`` A times its rows ``at`` to ``at + 2``.

    One loop over the columns, its factors at hand: what is read and written then lies a known number of rows apart, and
    a compiler takes several columns at once.
    """
    a, b, c = by * A[0, 0], by * A[0, 1], by * A[0, 2]
    d, e, f = by * A[1, 0], by * A[1, 1], by * A[1, 2]
    g, h, i = by * A[2, 0], by * A[2, 1], by * A[2, 2]
    for m in range(ROW):
        x, y, z = P[at * ROW + m], P[(at + 1) * ROW + m], P[(at + 2) * ROW + m]
        P[to * ROW + m] += a * x + b * y + c * z
        P[(to + 1) * ROW + m] += d * x + e * y + f * z
        P[(to + 2) * ROW + m] += g * x + h * y + i * z


def add_share(P: Any, to: int, at: int, share: float) -> None:
    """Rows ``to`` to ``to + 2`` of P gain ``share`` times its rows ``at`` to ``at + 2``."""
    for m in range(3 * ROW):
        P[to * ROW + m] += share * P[at * ROW + m]


def forward_rows(P: Any, T: float, M: Any, rest: int) -> None:
    """P <- Phi P, but for the wandering position error; P (39 * ROW,) flat.

    ``M`` (5, 3, 3): A, D, W, AD, AW, see :func:`matrices`; ``T`` s; ``rest`` 1 or 0.
    """
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    add_share(P, POS, V, T)
    add_product(P, POS, PHI, -0.5 * T, A)
    add_product(P, POS, BA, -0.5 * T, D)
    add_product(P, V, PHI, -1.0, A)
    add_product(P, V, BA, -1.0, D)
    if rest == 0:
        add_product(P, V, BG, 1.0, AD)
        add_product(P, V, SCALE, 1.0, AW)
        add_product(P, PHI, BG, -1.0, D)
        add_product(P, PHI, SCALE, -1.0, W)


def forward_columns(P: Any, row: int, T: float, M: Any, rest: int) -> None:
    """The same from the right, for one row of attitude, velocity or position up to its diagonal."""
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    o, h = row * ROW, -0.5 * T
    if row >= POS:
        for i in range(3):
            P[o + POS + i] += (
                T * P[o + V + i]
                + three(P, o + PHI, h * A[i, 0], h * A[i, 1], h * A[i, 2])
                + three(P, o + BA, h * D[i, 0], h * D[i, 1], h * D[i, 2])
            )
    if row >= V:
        for i in range(3):
            add = three(P, o + PHI, -A[i, 0], -A[i, 1], -A[i, 2]) + three(P, o + BA, -D[i, 0], -D[i, 1], -D[i, 2])
            if rest == 0:
                add += three(P, o + BG, AD[i, 0], AD[i, 1], AD[i, 2])
                add += three(P, o + SCALE, AW[i, 0], AW[i, 1], AW[i, 2])
            P[o + V + i] += add
    if rest == 0:
        for i in range(3):
            P[o + PHI + i] += three(P, o + BG, -D[i, 0], -D[i, 1], -D[i, 2]) + three(
                P, o + SCALE, -W[i, 0], -W[i, 1], -W[i, 2]
            )


def predict(P: Any, sums: Any, rest: int, tau: float, M: Any) -> None:
    """P <- Phi P Phi^T over an interval: P (39 * ROW,) flat, ``sums`` (SUMS,), ``tau`` s of wandering, M scratch."""
    matrices(sums, rest, M[0], M[1], M[2], M[3], M[4])
    T = sums[SUM_T]
    fade(P, math.exp(-T / tau))
    forward_rows(P, T, M, rest)
    for row in range(PHI, POS + 3):
        forward_columns(P, row, T, M, rest)
    for row in range(PHI, POS + 3):
        for c in range(row):
            P[c * ROW + row] = P[row * ROW + c]
        for c in range(POS + 3, N):
            P[c * ROW + row] = P[row * ROW + c]


def fade(P: Any, share: float) -> None:
    """The wandering position error decays: its rows and columns."""
    for i in range(WANDER, WANDER + 3):
        for m in range(ROW):
            P[i * ROW + m] *= share
    for m in range(N):
        for i in range(WANDER, WANDER + 3):
            P[m * ROW + i] *= share


def backward_rows(L: Any, T: float, M: Any, rest: int) -> None:
    """L <- Phi^T L, but for the wandering position error."""
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    if rest == 0:
        add_product(L, BG, V, 1.0, AD.T)
        add_product(L, BG, PHI, -1.0, D.T)
        add_product(L, SCALE, V, 1.0, AW.T)
        add_product(L, SCALE, PHI, -1.0, W.T)
    add_product(L, PHI, POS, -0.5 * T, A.T)
    add_product(L, PHI, V, -1.0, A.T)
    add_product(L, BA, POS, -0.5 * T, D.T)
    add_product(L, BA, V, -1.0, D.T)
    add_share(L, V, POS, T)


def backward_columns(L: Any, o: int, last: int, T: float, M: Any, rest: int) -> None:
    """The same from the right, for the row that begins at ``o``, up to the state ``last``; or for a vector."""
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    h = -0.5 * T
    if rest == 0 and last >= BG:
        for i in range(3):
            L[o + BG + i] += three(L, o + V, AD[0, i], AD[1, i], AD[2, i]) + three(
                L, o + PHI, -D[0, i], -D[1, i], -D[2, i]
            )
    if rest == 0 and last >= SCALE:
        for i in range(3):
            L[o + SCALE + i] += three(L, o + V, AW[0, i], AW[1, i], AW[2, i]) + three(
                L, o + PHI, -W[0, i], -W[1, i], -W[2, i]
            )
    for i in range(3):
        L[o + PHI + i] += three(L, o + POS, h * A[0, i], h * A[1, i], h * A[2, i]) + three(
            L, o + V, -A[0, i], -A[1, i], -A[2, i]
        )
    if last >= BA:
        for i in range(3):
            L[o + BA + i] += three(L, o + POS, h * D[0, i], h * D[1, i], h * D[2, i]) + three(
                L, o + V, -D[0, i], -D[1, i], -D[2, i]
            )
    if last >= V:
        for i in range(3):
            L[o + V + i] += T * L[o + POS + i]


def adjoint_predict(lam: Any, Lam: Any, sums: Any, rest: int, tau: float, M: Any) -> None:
    """lam <- Phi^T lam, Lam <- Phi^T Lam Phi: ``lam`` (ROW,), ``Lam`` (39 * ROW,) flat; else as :func:`predict`."""
    matrices(sums, rest, M[0], M[1], M[2], M[3], M[4])
    T = sums[SUM_T]
    share = math.exp(-T / tau)
    for i in range(WANDER, WANDER + 3):
        lam[i] *= share
    backward_columns(lam, 0, N, T, M, rest)
    fade(Lam, share)
    backward_rows(Lam, T, M, rest)
    for row in range(PHI, POS):
        backward_columns(Lam, row * ROW, row, T, M, rest)
    for row in range(BG, BA + 3):
        backward_columns(Lam, row * ROW, row, T, M, rest)
    for row in range(SCALE, SCALE + 3):
        backward_columns(Lam, row * ROW, row, T, M, rest)
    # Positions, the field and what follows stay: their columns are the rows of what moves.
    for row in range(PHI, POS):
        across(Lam, row, 0, row)
        across(Lam, row, POS, POS + 3)
        across(Lam, row, BA + 3, SCALE)
    for row in range(BG, BA + 3):
        across(Lam, row, 0, row)
        across(Lam, row, BA + 3, SCALE)
    for row in range(SCALE, SCALE + 3):
        across(Lam, row, 0, row)


def across(P: Any, row: int, first: int, last: int) -> None:
    """Copy part of a row across the diagonal."""
    for c in range(first, last):
        P[c * ROW + row] = P[row * ROW + c]


def padded(P: NDArray[np.float64]) -> NDArray[np.float64]:
    """A covariance (39, 39) as the kernels take it, flat."""
    out = np.zeros((N, ROW))
    out[:, :N] = P
    return out.ravel()


def square(P: NDArray[np.float64]) -> NDArray[np.float64]:
    """A covariance of the kernels as (39, 39)."""
    return P.reshape(N, ROW)[:, :N].copy()
