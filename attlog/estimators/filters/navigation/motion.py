"""How errors grow from node to node: the transition as a list of row operations, and its transpose.

With ``T, A, D, W`` the sums over the samples in between (time, R f dt, R dt, R diag(w) dt), in this order and with
old values on the right:

    p   += T v - T/2 (A x phi + D ba)
    v   += -A x phi - D ba + 1/2 A x D bg + 1/2 A x W sg
    phi += -D bg - W sg
    pb  *= exp(-T / tau)

At rest the gyro is not integrated: no ``D bg`` and no ``W``. A covariance takes the list, is transposed and takes it
again: some 5 N^2 multiplications instead of 2 N^3. Plain functions for the kernels.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from attlog.estimators.filters.navigation.layout import (
    BA,
    BG,
    PHI,
    POS,
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


def forward_ops(sums: Any, rest: int, tau: float, M: Any, oi: Any, oj: Any, oc: Any) -> int:
    """Fill in target row, source row and factor of every operation of Phi; returns how many. ``M`` is (5, 3, 3)."""
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    matrices(sums, rest, A, D, W, AD, AW)
    T = sums[SUM_T]
    n = 0
    for i in range(3):
        oi[n], oj[n], oc[n] = POS + i, V + i, T
        n += 1
        for j in range(3):
            if i != j:
                oi[n], oj[n], oc[n] = POS + i, PHI + j, -0.5 * T * A[i, j]
                n += 1
            oi[n], oj[n], oc[n] = POS + i, BA + j, -0.5 * T * D[i, j]
            n += 1
    for i in range(3):
        for j in range(3):
            if i != j:
                oi[n], oj[n], oc[n] = V + i, PHI + j, -A[i, j]
                n += 1
            oi[n], oj[n], oc[n] = V + i, BA + j, -D[i, j]
            n += 1
            if rest == 0:
                oi[n], oj[n], oc[n] = V + i, BG + j, AD[i, j]
                n += 1
                oi[n], oj[n], oc[n] = V + i, SCALE + j, AW[i, j]
                n += 1
    if rest == 0:
        for i in range(3):
            for j in range(3):
                oi[n], oj[n], oc[n] = PHI + i, BG + j, -D[i, j]
                n += 1
                oi[n], oj[n], oc[n] = PHI + i, SCALE + j, -W[i, j]
                n += 1
    fade = math.exp(-T / tau) - 1.0
    for i in range(3):
        oi[n], oj[n], oc[n] = WANDER + i, WANDER + i, fade
        n += 1
    return n


def backward_ops(sums: Any, rest: int, tau: float, M: Any, oi: Any, oj: Any, oc: Any) -> int:
    """The operations of Phi transposed, in an order that keeps old values on the right."""
    A, D, W, AD, AW = M[0], M[1], M[2], M[3], M[4]
    matrices(sums, rest, A, D, W, AD, AW)
    T = sums[SUM_T]
    n = 0
    if rest == 0:
        for i in range(3):
            for j in range(3):
                oi[n], oj[n], oc[n] = BG + i, V + j, AD[j, i]
                n += 1
                oi[n], oj[n], oc[n] = BG + i, PHI + j, -D[j, i]
                n += 1
                oi[n], oj[n], oc[n] = SCALE + i, V + j, AW[j, i]
                n += 1
                oi[n], oj[n], oc[n] = SCALE + i, PHI + j, -W[j, i]
                n += 1
    for i in range(3):
        for j in range(3):
            if i != j:
                oi[n], oj[n], oc[n] = PHI + i, POS + j, -0.5 * T * A[j, i]
                n += 1
                oi[n], oj[n], oc[n] = PHI + i, V + j, -A[j, i]
                n += 1
            oi[n], oj[n], oc[n] = BA + i, POS + j, -0.5 * T * D[j, i]
            n += 1
            oi[n], oj[n], oc[n] = BA + i, V + j, -D[j, i]
            n += 1
    for i in range(3):
        oi[n], oj[n], oc[n] = V + i, POS + i, T
        n += 1
    fade = math.exp(-T / tau) - 1.0
    for i in range(3):
        oi[n], oj[n], oc[n] = WANDER + i, WANDER + i, fade
        n += 1
    return n


def take(P: Any, n: int, oi: Any, oj: Any, oc: Any) -> None:
    """Add rows of P to rows of P, operation by operation."""
    for k in range(n):
        i, j, c = oi[k], oj[k], oc[k]
        for m in range(N):
            P[i, m] += c * P[j, m]


def take_vector(x: Any, n: int, oi: Any, oj: Any, oc: Any) -> None:
    """The same operations on a vector."""
    for k in range(n):
        x[oi[k]] += oc[k] * x[oj[k]]


def flip(P: Any) -> None:
    """Transpose in place."""
    for i in range(N):
        for j in range(i):
            P[i, j], P[j, i] = P[j, i], P[i, j]


def even(P: Any) -> None:
    """Make symmetric in place."""
    for i in range(N):
        for j in range(i):
            mean = 0.5 * (P[i, j] + P[j, i])
            P[i, j] = mean
            P[j, i] = mean


def transition_matrix(sums: Any, rest: int, tau: float) -> Any:
    """The dense Phi (39, 39) that the operations stand for."""
    M, Phi = np.zeros((5, 3, 3)), np.eye(N)
    oi, oj, oc = np.zeros(84, np.int64), np.zeros(84, np.int64), np.zeros(84)
    take(Phi, forward_ops(sums, rest, tau, M, oi, oj, oc), oi, oj, oc)
    return Phi
