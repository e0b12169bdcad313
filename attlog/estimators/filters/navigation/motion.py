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


def undo(lam: Any, Lam: Any, sums: Any, rest: int, tau: float, M: Any) -> None:
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
