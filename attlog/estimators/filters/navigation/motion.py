"""How errors grow from node to node: the transition, its transpose, and what they make of a covariance.

With ``T, A, D, W`` the sums over the samples in between (time, R f dt, R dt, R diag(w) dt), in this order and with
old values on the right:

    p   += T v - T/2 (A x phi + D ba)
    v   += -A x phi - D ba + 1/2 A x D bg + 1/2 A x W sg
    phi += -D bg - W sg
    pb  *= exp(-T / tau)

At rest the gyro is not integrated: no ``D bg`` and no ``W``. A covariance stands row by row, :data:`ROW` numbers each,
in one flat array, exactly symmetric. Only 12 of 39 states move: their rows are multiplied from the left, the part where
they meet from the right as well, and the rest is copied across the diagonal: some N^2 multiplications instead of 2 N^3.
Plain functions for the kernels. No sum is reordered by the compiler, so every processor gives the same bits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.filters.navigation.layout import (
    BA,
    BG,
    PHI,
    POS,
    ROW,
    SCALE,
    SUM_A,
    SUM_D,
    SUM_T,
    SUM_W,
    WANDER,
    N,
    V,
)


def cross_times(a: Any, m: Any, out: Any) -> None:
    """out = [a] m for a vector (3,) and matrices (3, 3)."""
    for j in range(3):
        out[0, j] = a[1] * m[2, j] - a[2] * m[1, j]
        out[1, j] = a[2] * m[0, j] - a[0] * m[2, j]
        out[2, j] = a[0] * m[1, j] - a[1] * m[0, j]


def matrices(sums: Any, rest: int, A: Any, D: Any, W: Any, AD: Any, AW: Any) -> None:
    """Unpack the sums of an interval: [A], D, W, 1/2 [A] D, 1/2 [A] W; what the gyro does is zero at rest."""
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


def forward_rows(P: Any, T: float, M: Any, rest: int) -> None:
    """P <- Phi P, but for the wandering position error. ``M``: A, D, W, AD, AW, see :func:`matrices`.

    One loop over the columns for each kind of row, its factors at hand: what is read and written then lies a known
    number of rows apart, and a compiler takes several columns at once.
    """
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    h = -0.5 * T
    ax, ay, az = A[2, 1], A[0, 2], A[1, 0]
    d0, d1, d2 = D[0, 0], D[0, 1], D[0, 2]
    d3, d4, d5 = D[1, 0], D[1, 1], D[1, 2]
    d6, d7, d8 = D[2, 0], D[2, 1], D[2, 2]
    hx, hy, hz = h * ax, h * ay, h * az
    e0, e1, e2, e3, e4, e5, e6, e7, e8 = h * d0, h * d1, h * d2, h * d3, h * d4, h * d5, h * d6, h * d7, h * d8
    for m in range(ROW):
        x, y, z = P[PHI * ROW + m], P[(PHI + 1) * ROW + m], P[(PHI + 2) * ROW + m]
        a, b, c = P[BA * ROW + m], P[(BA + 1) * ROW + m], P[(BA + 2) * ROW + m]
        u, v, w = P[V * ROW + m], P[(V + 1) * ROW + m], P[(V + 2) * ROW + m]
        P[POS * ROW + m] = P[POS * ROW + m] + T * u + (hy * z - hz * y) + (e0 * a + e1 * b + e2 * c)
        P[(POS + 1) * ROW + m] = P[(POS + 1) * ROW + m] + T * v + (hz * x - hx * z) + (e3 * a + e4 * b + e5 * c)
        P[(POS + 2) * ROW + m] = P[(POS + 2) * ROW + m] + T * w + (hx * y - hy * x) + (e6 * a + e7 * b + e8 * c)
        P[V * ROW + m] = u + (az * y - ay * z) - (d0 * a + d1 * b + d2 * c)
        P[(V + 1) * ROW + m] = v + (ax * z - az * x) - (d3 * a + d4 * b + d5 * c)
        P[(V + 2) * ROW + m] = w + (ay * x - ax * y) - (d6 * a + d7 * b + d8 * c)
    if rest == 1:
        return
    f0, f1, f2 = AD[0, 0], AD[0, 1], AD[0, 2]
    f3, f4, f5 = AD[1, 0], AD[1, 1], AD[1, 2]
    f6, f7, f8 = AD[2, 0], AD[2, 1], AD[2, 2]
    g0, g1, g2 = AW[0, 0], AW[0, 1], AW[0, 2]
    g3, g4, g5 = AW[1, 0], AW[1, 1], AW[1, 2]
    g6, g7, g8 = AW[2, 0], AW[2, 1], AW[2, 2]
    w0, w1, w2 = W[0, 0], W[0, 1], W[0, 2]
    w3, w4, w5 = W[1, 0], W[1, 1], W[1, 2]
    w6, w7, w8 = W[2, 0], W[2, 1], W[2, 2]
    for m in range(ROW):
        a, b, c = P[BG * ROW + m], P[(BG + 1) * ROW + m], P[(BG + 2) * ROW + m]
        x, y, z = P[SCALE * ROW + m], P[(SCALE + 1) * ROW + m], P[(SCALE + 2) * ROW + m]
        P[V * ROW + m] = P[V * ROW + m] + (f0 * a + f1 * b + f2 * c) + (g0 * x + g1 * y + g2 * z)
        P[(V + 1) * ROW + m] = P[(V + 1) * ROW + m] + (f3 * a + f4 * b + f5 * c) + (g3 * x + g4 * y + g5 * z)
        P[(V + 2) * ROW + m] = P[(V + 2) * ROW + m] + (f6 * a + f7 * b + f8 * c) + (g6 * x + g7 * y + g8 * z)
        P[PHI * ROW + m] = P[PHI * ROW + m] - (d0 * a + d1 * b + d2 * c) - (w0 * x + w1 * y + w2 * z)
        P[(PHI + 1) * ROW + m] = P[(PHI + 1) * ROW + m] - (d3 * a + d4 * b + d5 * c) - (w3 * x + w4 * y + w5 * z)
        P[(PHI + 2) * ROW + m] = P[(PHI + 2) * ROW + m] - (d6 * a + d7 * b + d8 * c) - (w6 * x + w7 * y + w8 * z)


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
    """P <- Phi P Phi^T."""
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
    """L <- Phi^T L, but for the wandering position error; loops as in :func:`forward_rows`."""
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    h = -0.5 * T
    ax, ay, az = A[2, 1], A[0, 2], A[1, 0]
    d0, d1, d2 = D[0, 0], D[0, 1], D[0, 2]
    d3, d4, d5 = D[1, 0], D[1, 1], D[1, 2]
    d6, d7, d8 = D[2, 0], D[2, 1], D[2, 2]
    if rest == 0:
        f0, f1, f2 = AD[0, 0], AD[0, 1], AD[0, 2]
        f3, f4, f5 = AD[1, 0], AD[1, 1], AD[1, 2]
        f6, f7, f8 = AD[2, 0], AD[2, 1], AD[2, 2]
        g0, g1, g2 = AW[0, 0], AW[0, 1], AW[0, 2]
        g3, g4, g5 = AW[1, 0], AW[1, 1], AW[1, 2]
        g6, g7, g8 = AW[2, 0], AW[2, 1], AW[2, 2]
        w0, w1, w2 = W[0, 0], W[0, 1], W[0, 2]
        w3, w4, w5 = W[1, 0], W[1, 1], W[1, 2]
        w6, w7, w8 = W[2, 0], W[2, 1], W[2, 2]
        for m in range(ROW):
            a, b, c = L[V * ROW + m], L[(V + 1) * ROW + m], L[(V + 2) * ROW + m]
            x, y, z = L[PHI * ROW + m], L[(PHI + 1) * ROW + m], L[(PHI + 2) * ROW + m]
            L[BG * ROW + m] = L[BG * ROW + m] + (f0 * a + f3 * b + f6 * c) - (d0 * x + d3 * y + d6 * z)
            L[(BG + 1) * ROW + m] = L[(BG + 1) * ROW + m] + (f1 * a + f4 * b + f7 * c) - (d1 * x + d4 * y + d7 * z)
            L[(BG + 2) * ROW + m] = L[(BG + 2) * ROW + m] + (f2 * a + f5 * b + f8 * c) - (d2 * x + d5 * y + d8 * z)
            L[SCALE * ROW + m] = L[SCALE * ROW + m] + (g0 * a + g3 * b + g6 * c) - (w0 * x + w3 * y + w6 * z)
            L[(SCALE + 1) * ROW + m] = (
                L[(SCALE + 1) * ROW + m] + (g1 * a + g4 * b + g7 * c) - (w1 * x + w4 * y + w7 * z)
            )
            L[(SCALE + 2) * ROW + m] = (
                L[(SCALE + 2) * ROW + m] + (g2 * a + g5 * b + g8 * c) - (w2 * x + w5 * y + w8 * z)
            )
    hx, hy, hz = h * ax, h * ay, h * az
    e0, e1, e2, e3, e4, e5, e6, e7, e8 = h * d0, h * d1, h * d2, h * d3, h * d4, h * d5, h * d6, h * d7, h * d8
    for m in range(ROW):
        x, y, z = L[POS * ROW + m], L[(POS + 1) * ROW + m], L[(POS + 2) * ROW + m]
        a, b, c = L[V * ROW + m], L[(V + 1) * ROW + m], L[(V + 2) * ROW + m]
        L[PHI * ROW + m] = L[PHI * ROW + m] + (hz * y - hy * z) + (ay * c - az * b)
        L[(PHI + 1) * ROW + m] = L[(PHI + 1) * ROW + m] + (hx * z - hz * x) + (az * a - ax * c)
        L[(PHI + 2) * ROW + m] = L[(PHI + 2) * ROW + m] + (hy * x - hx * y) + (ax * b - ay * a)
        L[BA * ROW + m] = L[BA * ROW + m] + (e0 * x + e3 * y + e6 * z) - (d0 * a + d3 * b + d6 * c)
        L[(BA + 1) * ROW + m] = L[(BA + 1) * ROW + m] + (e1 * x + e4 * y + e7 * z) - (d1 * a + d4 * b + d7 * c)
        L[(BA + 2) * ROW + m] = L[(BA + 2) * ROW + m] + (e2 * x + e5 * y + e8 * z) - (d2 * a + d5 * b + d8 * c)
        L[V * ROW + m], L[(V + 1) * ROW + m], L[(V + 2) * ROW + m] = a + T * x, b + T * y, c + T * z


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


def undo(lam: Any, Lam: Any, sums: Any, rest: int, tau: float, M: Any) -> None:
    """lam <- Phi^T lam, Lam <- Phi^T Lam Phi."""
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
