"""The navigation filter's state, and what its aids and its motion do to it.

Error state, 39 numbers: attitude (a rotation vector in earth axes, ``q_true = exp(phi) q``), velocity, position,
gyro bias, accelerometer bias, wandering position error, barometer bias, GNSS delay, lever arm of the antenna, gyro
scale; then what only a compass needs: earth field, hard iron, soft iron (xx yy zz xy xz yz), magnetometer delay. The
nominal state ``x`` has the same places; its first three are unused, the attitude is the quaternion beside it.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.jit import B1, F1, F2, I1, Cells, IOut1, Out1, Out2, aligned_zeros
from attlog.estimators.vectors import cross, matrix, multiplied, places, quaternion

ERROR_SIZES = {
    "phi": 3,
    "v": 3,
    "pos": 3,
    "bg": 3,
    "ba": 3,
    "wander": 3,
    "baro": 1,
    "gnss_delay": 1,
    "arm": 3,
    "scale": 3,
    "earth": 3,
    "hard": 3,
    "soft": 6,
    "mag_delay": 1,
}
E, N = places(ERROR_SIZES), sum(ERROR_SIZES.values())
# Entries of the symmetric soft iron, row by row.
SYMMETRIC = ((0, 3, 4), (3, 1, 5), (4, 5, 2))

# Kinds of events: GNSS velocity and position, height, field, rest as zero velocity and as zero rate.
VELOCITY, POSITION, BARO, MAG, STILL, NO_RATE = 0, 1, 2, 3, 4, 5

# Groups of scalar updates that share a noise level: velocity level, vertical, position level, vertical, height, field,
# zero rate, zero velocity.
GROUPS = 8

# What the filter remembers beside its state: counters of its gates, attitude kept during rest, likelihood.
MEMORIES = {
    "skips": 6,
    "mag_mean": 1,
    "since_kick": 1,
    "resting": 1,
    "frozen": 4,
    "opened": 1,
    "kicked": 1,
    "softened": 1,
    "seen": 1,
    "likelihood": 1,
}
MEM, MEMORY = places(MEMORIES), sum(MEMORIES.values())

# Sums over the samples between two nodes: time, R f dt (3), R dt (9), R diag(w) dt (9).
SUM, SUMS = places({"t": 1, "A": 3, "D": 9, "W": 9}), 22

# Numbers from one row of a covariance to the next: rows end with a zero and fill whole vector registers.
ROW = 40
# Without a compass the loops run with the 26 states before the earth field and an unused one, for 27 is a multiple of
# three and the row of 28 one of four: half the work.
WITHOUT_COMPASS = {"N": 27, "ROW": 28}

# Most entries of a measurement's row that are not zero.
WIDE = 12


IOut1B = Annotated[NDArray[np.int8], Cells("i1", 1, True)]
IOut2B = Annotated[NDArray[np.int8], Cells("i1", 2, True)]


class Settings(NamedTuple):
    """Gravity, noise of gyro and accelerometer, random walks, time constant of the wandering position, gates."""

    gravity: float
    q_gyro: float
    q_acc: float
    q_acc_rest: float
    q_bg: float
    q_ba: float
    q_hard: float
    q_wander: float
    q_baro: float
    wander_tau: float
    soft_gate: float
    hard_gate: float


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
    """What the filter carries on in place: attitude (4,), nominal state (39,), covariance (N * ROW,), memory."""

    q: Out1
    x: Out1
    P: Out1
    memory: Out1

    def copy(self) -> State:
        """Return a state of its own."""
        P = aligned_zeros(len(self.P))
        P[:] = self.P
        return State(self.q.copy(), self.x.copy(), P, self.memory.copy())


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
# ``e`` is the time from the sample to which the event was moved; ``a`` the earth acceleration from a centred 0.1 s mean
# of the accelerometer, ``w`` a centred 60 ms mean of the gyro: single samples would bias the delays.


def to_matrix3(q: Any, R: Any) -> None:
    """Write R (3, 3) from body to earth of a unit quaternion."""
    entries = matrix(q, 0)
    for i in range(9):
        R[i // 3, i % 3] = entries[i]


def half_exponential(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the unit quaternion of a rotation vector, with the series of a small one."""
    angle = math.sqrt(x * x + y * y + z * z)
    s = 0.5 if angle < 1e-12 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), s * x, s * y, s * z


def turn_body(q: Any, x: float, y: float, z: float) -> None:
    """Turn q about body axes, q <- q exp(v / 2) for a rotation vector v, unit length kept."""
    a, b, c, d = quaternion(q, 0)
    e, f, g, h = half_exponential(x, y, z)
    store_unit(q, multiplied(a, b, c, d, e, f, g, h))


def turn_earth(q: Any, x: float, y: float, z: float) -> None:
    """Turn q about earth axes, q <- exp(v / 2) q for a rotation vector v, unit length kept."""
    a, b, c, d = quaternion(q, 0)
    e, f, g, h = half_exponential(x, y, z)
    store_unit(q, multiplied(e, f, g, h, a, b, c, d))


def store_unit(q: Any, n: Any) -> None:
    """Write four numbers to q, of unit length."""
    norm = 1.0 / math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] + n[3] * n[3])
    for i in range(4):
        q[i] = n[i] * norm


def between(R: Any, L: Any, out: Any) -> float:
    """Write log(R L^T), a small rotation vector in earth axes; return its angle in rad (1 where it is not small)."""
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
    for i in range(3):
        m[i] = J[0, i] * x0[E.earth] + J[1, i] * x0[E.earth + 1] + J[2, i] * x0[E.earth + 2]
    c[0], c[1], c[2] = cross(m[0], m[1], m[2], w[0], w[1], w[2])
    for n in range(3):
        s0, s1, s2 = soft_row(x0, n)
        # Row n of I + S.
        s0, s1, s2 = s0 + (1.0 if n == 0 else 0.0), s1 + (1.0 if n == 1 else 0.0), s2 + (1.0 if n == 2 else 0.0)
        for k in range(3):
            d[k] = s0 * J[k, 0] + s1 * J[k, 1] + s2 * J[k, 2]
        hv[n, 0], hv[n, 1], hv[n, 2] = cross(d[0], d[1], d[2], x0[E.earth], x0[E.earth + 1], x0[E.earth + 2])
        for k in range(3):
            hi[n, k] = E.phi + k
            hi[n, 3 + k], hv[n, 3 + k] = E.earth + k, d[k]
            hi[n, 7 + k], hv[n, 7 + k] = E.soft + SYMMETRIC[n][k], m[k]
        hi[n, 6], hv[n, 6] = E.hard + n, 1.0
        hi[n, 10], hv[n, 10] = E.mag_delay, -(s0 * c[0] + s1 * c[1] + s2 * c[2])
    if linear:
        between(R, J, phi)
        for n in range(3):
            h = x0[E.hard + n] + m[n] + c[n] * (e - x0[E.mag_delay])
            h += soft_times(x0, n, m, c, e - x0[E.mag_delay])
            for k in range(3):
                h += hv[n, k] * phi[k]
            for k in range(3, 11):
                h += hv[n, k] * (x[hi[n, k]] - x0[hi[n, k]])
            r[n] = z[n] - h
        return 11
    for i in range(3):
        m[i] = R[0, i] * x[E.earth] + R[1, i] * x[E.earth + 1] + R[2, i] * x[E.earth + 2]
    c[0], c[1], c[2] = cross(m[0], m[1], m[2], w[0], w[1], w[2])
    lead = e - x[E.mag_delay]
    for n in range(3):
        r[n] = z[n] - x[E.hard + n] - m[n] - c[n] * lead - soft_times(x, n, m, c, lead)
    return 11


def soft_row(x: Any, n: int) -> tuple[float, float, float]:
    """Return row n of the soft iron S."""
    i, j, k = SYMMETRIC[n]
    return x[E.soft + i], x[E.soft + j], x[E.soft + k]


def soft_times(x: Any, n: int, m: Any, c: Any, lead: float) -> float:
    """Return component n of S (m + c lead)."""
    s0, s1, s2 = soft_row(x, n)
    total: float = s0 * (m[0] + c[0] * lead) + s1 * (m[1] + c[1] * lead) + s2 * (m[2] + c[2] * lead)
    return total


def rows(kind: int, x: Any, R: Any, e: float, f: Any, w: Any, z: Any, par: Any, work: Any, row: Any) -> int:
    """Write residual and rows of an event that is no field sample; return entries per row."""
    r, hi, hv = row.r, row.hi, row.hv
    if kind == VELOCITY:
        a, u = work[0], work[1]
        for i in range(3):
            a[i] = R[i, 0] * (f[0] - x[E.ba]) + R[i, 1] * (f[1] - x[E.ba + 1]) + R[i, 2] * (f[2] - x[E.ba + 2])
        a[2] += par.gravity
        u[0], u[1], u[2] = cross(w[0], w[1], w[2], x[E.arm], x[E.arm + 1], x[E.arm + 2])
        for i in range(3):
            arm = R[i, 0] * u[0] + R[i, 1] * u[1] + R[i, 2] * u[2]
            r[i] = z[i] - x[E.v + i] - a[i] * (e - x[E.gnss_delay]) - arm
            hi[i, 0], hv[i, 0] = E.v + i, 1.0
            hi[i, 1], hv[i, 1] = E.gnss_delay, -a[i]
            hi[i, 2], hv[i, 2] = E.arm, R[i, 1] * w[2] - R[i, 2] * w[1]
            hi[i, 3], hv[i, 3] = E.arm + 1, R[i, 2] * w[0] - R[i, 0] * w[2]
            hi[i, 4], hv[i, 4] = E.arm + 2, R[i, 0] * w[1] - R[i, 1] * w[0]
        return 5
    if kind == POSITION:
        for i in range(3):
            arm = R[i, 0] * x[E.arm] + R[i, 1] * x[E.arm + 1] + R[i, 2] * x[E.arm + 2]
            lead = e - x[E.gnss_delay]
            r[i] = z[i] - x[E.pos + i] - x[E.v + i] * lead - arm - x[E.wander + i]
            hi[i, 0], hv[i, 0] = E.pos + i, 1.0
            hi[i, 1], hv[i, 1] = E.v + i, lead
            hi[i, 2], hv[i, 2] = E.wander + i, 1.0
            hi[i, 3], hv[i, 3] = E.gnss_delay, -x[E.v + i]
            for k in range(3):
                hi[i, 4 + k], hv[i, 4 + k] = E.arm + k, R[i, k]
        return 7
    if kind == BARO:
        r[0] = z[0] + x[E.pos + 2] + x[E.v + 2] * e - x[E.baro]
        hi[0, 0], hv[0, 0] = E.pos + 2, -1.0
        hi[0, 1], hv[0, 1] = E.v + 2, -e
        hi[0, 2], hv[0, 2] = E.baro, 1.0
        return 3
    first = E.v if kind == STILL else E.bg
    for i in range(3):
        r[i] = z[i] - x[first + i]
        hi[i, 0], hv[i, 0] = first + i, 1.0
    return 1


def group_of(kind: int, row: int) -> int:
    """Return the noise group of a scalar update."""
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
# At rest the gyro is not integrated: no ``D bg`` and no ``W``. A covariance is one flat array, row by row of ROW
# numbers, exactly symmetric. Only 12 of 39 states move: their rows are multiplied from the left, the part where they
# meet from the right as well, and the rest is copied across the diagonal: some N^2 multiplications instead of 2 N^3.
# Plain functions for the kernels. No sum is reordered by the compiler, so every processor gives the same bits.


def cross_times(a: Any, m: Any, out: Any) -> None:
    """Compute out = [a] m for a vector (3,) and matrices (3, 3)."""
    for j in range(3):
        out[0, j] = a[1] * m[2, j] - a[2] * m[1, j]
        out[1, j] = a[2] * m[0, j] - a[0] * m[2, j]
        out[2, j] = a[0] * m[1, j] - a[1] * m[0, j]


def matrices(sums: Any, rest: int, A: Any, D: Any, W: Any, AD: Any, AW: Any) -> None:
    """Unpack the ``sums`` (SUMS,) to [A], D, W, 1/2 [A] D, 1/2 [A] W, (3, 3) each; at rest those of the gyro are 0."""
    a = sums[SUM.A : SUM.A + 3]
    A[0, 0], A[0, 1], A[0, 2] = 0.0, -a[2], a[1]
    A[1, 0], A[1, 1], A[1, 2] = a[2], 0.0, -a[0]
    A[2, 0], A[2, 1], A[2, 2] = -a[1], a[0], 0.0
    for i in range(3):
        for j in range(3):
            D[i, j] = sums[SUM.D + 3 * i + j]
            W[i, j] = 0.0 if rest == 1 else sums[SUM.W + 3 * i + j]
    cross_times(a, D, AD)
    cross_times(a, W, AW)
    for i in range(3):
        for j in range(3):
            AD[i, j] = 0.0 if rest == 1 else 0.5 * AD[i, j]
            AW[i, j] *= 0.5


def dot(a: Any, i: int, b: Any, j: int) -> float:
    """Return the product of two rows that begin at ``i`` and ``j``; four sums, since one waits for itself."""
    s0 = s1 = s2 = s3 = 0.0
    for m in range(0, ROW, 4):
        s0 += a[i + m] * b[j + m]
        s1 += a[i + m + 1] * b[j + m + 1]
        s2 += a[i + m + 2] * b[j + m + 2]
        s3 += a[i + m + 3] * b[j + m + 3]
    return (s0 + s1) + (s2 + s3)


def three(P: Any, at: int, a: float, b: float, c: float) -> float:
    """Return a, b, c times the three numbers from ``at`` on."""
    value: float = (a * P[at] + b * P[at + 1]) + c * P[at + 2]
    return value


def add_product(P: Any, to: int, at: int, by: float, A: Any) -> None:
    """Add ``by`` A times the rows ``at`` to ``at + 2`` of P to its rows ``to`` to ``to + 2``.

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
    """Add ``share`` times the rows ``at`` to ``at + 2`` of P to its rows ``to`` to ``to + 2``."""
    for m in range(3 * ROW):
        P[to * ROW + m] += share * P[at * ROW + m]


def forward_rows(P: Any, T: float, M: Any, rest: int) -> None:
    """Compute P <- Phi P, but for the wandering position error; P (N * ROW,) flat.

    ``M`` (5, 3, 3): A, D, W, AD, AW, see :func:`matrices`; ``T`` s; ``rest`` 1 or 0.
    """
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    add_share(P, E.pos, E.v, T)
    add_product(P, E.pos, E.phi, -0.5 * T, A)
    add_product(P, E.pos, E.ba, -0.5 * T, D)
    add_product(P, E.v, E.phi, -1.0, A)
    add_product(P, E.v, E.ba, -1.0, D)
    if rest == 0:
        add_product(P, E.v, E.bg, 1.0, AD)
        add_product(P, E.v, E.scale, 1.0, AW)
        add_product(P, E.phi, E.bg, -1.0, D)
        add_product(P, E.phi, E.scale, -1.0, W)


def forward_columns(P: Any, row: int, T: float, M: Any, rest: int) -> None:
    """Multiply one row of attitude, velocity or position by Phi^T from the right, up to its diagonal."""
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    o, h = row * ROW, -0.5 * T
    if row >= E.pos:
        for i in range(3):
            P[o + E.pos + i] += (
                T * P[o + E.v + i]
                + three(P, o + E.phi, h * A[i, 0], h * A[i, 1], h * A[i, 2])
                + three(P, o + E.ba, h * D[i, 0], h * D[i, 1], h * D[i, 2])
            )
    if row >= E.v:
        for i in range(3):
            add = three(P, o + E.phi, -A[i, 0], -A[i, 1], -A[i, 2]) + three(P, o + E.ba, -D[i, 0], -D[i, 1], -D[i, 2])
            if rest == 0:
                add += three(P, o + E.bg, AD[i, 0], AD[i, 1], AD[i, 2])
                add += three(P, o + E.scale, AW[i, 0], AW[i, 1], AW[i, 2])
            P[o + E.v + i] += add
    if rest == 0:
        for i in range(3):
            P[o + E.phi + i] += three(P, o + E.bg, -D[i, 0], -D[i, 1], -D[i, 2]) + three(
                P, o + E.scale, -W[i, 0], -W[i, 1], -W[i, 2]
            )


def predict(P: Any, sums: Any, rest: int, tau: float, M: Any) -> None:
    """Predict P <- Phi P Phi^T over an interval.

    P (N * ROW,) flat, ``sums`` (SUMS,), ``tau`` s of wandering, M scratch.
    """
    matrices(sums, rest, M[0], M[1], M[2], M[3], M[4])
    T = sums[SUM.t]
    fade(P, math.exp(-T / tau))
    forward_rows(P, T, M, rest)
    for row in range(E.phi, E.pos + 3):
        forward_columns(P, row, T, M, rest)
    for row in range(E.phi, E.pos + 3):
        for c in range(row):
            P[c * ROW + row] = P[row * ROW + c]
        for c in range(E.pos + 3, N):
            P[c * ROW + row] = P[row * ROW + c]


def fade(P: Any, share: float) -> None:
    """Let the wandering position error decay, in its rows and columns."""
    for i in range(E.wander, E.wander + 3):
        for m in range(ROW):
            P[i * ROW + m] *= share
    for m in range(N):
        for i in range(E.wander, E.wander + 3):
            P[m * ROW + i] *= share


def backward_rows(L: Any, T: float, M: Any, rest: int) -> None:
    """Compute L <- Phi^T L, but for the wandering position error."""
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    if rest == 0:
        add_product(L, E.bg, E.v, 1.0, AD.T)
        add_product(L, E.bg, E.phi, -1.0, D.T)
        add_product(L, E.scale, E.v, 1.0, AW.T)
        add_product(L, E.scale, E.phi, -1.0, W.T)
    add_product(L, E.phi, E.pos, -0.5 * T, A.T)
    add_product(L, E.phi, E.v, -1.0, A.T)
    add_product(L, E.ba, E.pos, -0.5 * T, D.T)
    add_product(L, E.ba, E.v, -1.0, D.T)
    add_share(L, E.v, E.pos, T)


def backward_columns(L: Any, o: int, last: int, T: float, M: Any, rest: int) -> None:
    """Multiply the row that begins at ``o``, or a vector, by Phi from the right, up to the state ``last``."""
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    h = -0.5 * T
    if rest == 0 and last >= E.bg:
        for i in range(3):
            L[o + E.bg + i] += three(L, o + E.v, AD[0, i], AD[1, i], AD[2, i]) + three(
                L, o + E.phi, -D[0, i], -D[1, i], -D[2, i]
            )
    if rest == 0 and last >= E.scale:
        for i in range(3):
            L[o + E.scale + i] += three(L, o + E.v, AW[0, i], AW[1, i], AW[2, i]) + three(
                L, o + E.phi, -W[0, i], -W[1, i], -W[2, i]
            )
    for i in range(3):
        L[o + E.phi + i] += three(L, o + E.pos, h * A[0, i], h * A[1, i], h * A[2, i]) + three(
            L, o + E.v, -A[0, i], -A[1, i], -A[2, i]
        )
    if last >= E.ba:
        for i in range(3):
            L[o + E.ba + i] += three(L, o + E.pos, h * D[0, i], h * D[1, i], h * D[2, i]) + three(
                L, o + E.v, -D[0, i], -D[1, i], -D[2, i]
            )
    if last >= E.v:
        for i in range(3):
            L[o + E.v + i] += T * L[o + E.pos + i]


def adjoint_predict(lam: Any, Lam: Any, sums: Any, rest: int, tau: float, M: Any) -> None:
    """Carry back lam <- Phi^T lam, Lam <- Phi^T Lam Phi.

    ``lam`` (ROW,), ``Lam`` (N * ROW,) flat; else as :func:`predict`.
    """
    matrices(sums, rest, M[0], M[1], M[2], M[3], M[4])
    T = sums[SUM.t]
    share = math.exp(-T / tau)
    for i in range(E.wander, E.wander + 3):
        lam[i] *= share
    backward_columns(lam, 0, N, T, M, rest)
    fade(Lam, share)
    backward_rows(Lam, T, M, rest)
    for row in range(E.phi, E.pos):
        backward_columns(Lam, row * ROW, row, T, M, rest)
    for row in range(E.bg, E.ba + 3):
        backward_columns(Lam, row * ROW, row, T, M, rest)
    for row in range(E.scale, E.scale + 3):
        backward_columns(Lam, row * ROW, row, T, M, rest)
    # Positions and what else stays: their columns are the rows of what moves.
    for row in range(E.phi, E.pos):
        across(Lam, row, 0, row)
        across(Lam, row, E.pos, E.pos + 3)
        across(Lam, row, E.ba + 3, E.scale)
        across(Lam, row, E.scale + 3, N)
    for row in range(E.bg, E.ba + 3):
        across(Lam, row, 0, row)
        across(Lam, row, E.ba + 3, E.scale)
        across(Lam, row, E.scale + 3, N)
    for row in range(E.scale, E.scale + 3):
        across(Lam, row, 0, row)
        across(Lam, row, E.scale + 3, N)


def across(P: Any, row: int, first: int, last: int) -> None:
    """Copy part of a row across the diagonal."""
    for c in range(first, last):
        P[c * ROW + row] = P[row * ROW + c]


def padded(P: NDArray[np.float64], states: int = N) -> NDArray[np.float64]:
    """Return the first ``states`` of a covariance (39, 39) as loops take it, flat with a zero after each row."""
    out = aligned_zeros(states, states + 1)
    out[:, :states] = P[:states, :states]
    return out.ravel()


def square(P: NDArray[np.float64], states: int = N) -> NDArray[np.float64]:
    """Return a covariance of loops with so many ``states`` as (39, 39), zero beyond them."""
    out = np.zeros((N, N))
    out[:states, :states] = P.reshape(states, states + 1)[:, :states]
    return out
