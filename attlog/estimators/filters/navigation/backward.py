"""The smoother's way back: modified Bryson-Frazier. One function for the compiler.

Equal to Rauch-Tung-Striebel in exact arithmetic, without an inverse and without stored predictions (Bierman1973).
With ``lam``, ``Lam`` zero at the end, per node from the last:

    smoothed error  d = -P lam,   covariance  P - P Lam P          (P after all updates of the node)
    each scalar update, last first:  u = nu / s + K.lam,   D = 1 / s + K^T Lam K
        lam -= H^T u,   Lam <- Lam - H^T (Lam K)^T - (Lam K) H + H^T H D
    lam <- Phi^T lam,   Lam <- Phi^T Lam Phi

``u^2 / D`` has mean one where the noise of an update is right, and so has ``lam_i^2 / Lam_ii`` for the process noise:
the scores by which :mod:`noise` calibrates (DeJongPenzer1998).
"""

from __future__ import annotations

from typing import Any

from attlog.estimators.filters.navigation.layout import MOST_OPS, SUM_T, WANDER_TAU, N
from attlog.estimators.filters.navigation.motion import backward_ops, even, flip, take, take_vector

CLIP = 9.0
"""A disturbance counts as at most three sigma: faults must not calibrate."""


SCRATCH = {
    "M": ("f8", (5, 3, 3)), "oi": ("i8", (MOST_OPS,)), "oj": ("i8", (MOST_OPS,)), "oc": ("f8", (MOST_OPS,)),
    "Lk": ("f8", (N,)),
}  # fmt: skip
"""Kind and shape of what the function works with, by the argument's name."""


def backward(
    nodes: int, rest_of: Any, par: Any, P_rows: Any, sums: Any, update_of: Any, K: Any, H: Any, H_at: Any, wide_of:
    Any, s_of: Any, nu_of: Any, lam: Any, Lam: Any, d: Any, spread: Any, score: Any, scores: Any, gone: bool,
    M: Any, oi: Any, oj: Any, oc: Any, Lk: Any,
) -> None:  # fmt: skip
    """The nodes of a stored part of a run, last first; ``lam`` (39,) and ``Lam`` (39, 39) are carried on in place.

    Written: ``d`` (m, 6) smoothed error of attitude and gyro bias, ``spread`` (m, 3) smoothed variance of the attitude,
    ``score`` (u,) u^2 / D of every update, ``scores`` (2, 39) sums of T min(lam^2, 9 Lam) and T Lam while moving.
    ``gone`` tells whether node 0 is the first of the run, before which nothing moves. The last arguments are scratch.
    """
    for node in range(nodes - 1, -1, -1):
        for i in range(6):
            sum_ = 0.0
            for m in range(N):
                sum_ += P_rows[node, i, m] * lam[m]
            d[node, i] = -sum_
        for i in range(3):
            sum_ = 0.0
            for m in range(N):
                row = 0.0
                for j in range(N):
                    row += Lam[m, j] * P_rows[node, i, j]
                sum_ += P_rows[node, i, m] * row
            spread[node, i] = P_rows[node, i, i] - sum_
        back_through_updates(
            update_of[node], update_of[node + 1], K, H, H_at, wide_of, s_of, nu_of, lam, Lam, Lk, score
        )
        if gone and node == 0:
            break
        T = sums[node, SUM_T]
        if rest_of[node] == 0:
            for i in range(N):
                scores[0, i] += T * min(lam[i] * lam[i], CLIP * Lam[i, i])
                scores[1, i] += T * Lam[i, i]
        n = backward_ops(sums[node], rest_of[node], par[WANDER_TAU], M, oi, oj, oc)
        take_vector(lam, n, oi, oj, oc)
        take(Lam, n, oi, oj, oc)
        flip(Lam)
        take(Lam, n, oi, oj, oc)
        even(Lam)


def back_through_updates(
    a: int,
    b: int,
    K: Any,
    H: Any,
    H_at: Any,
    wide_of: Any,
    s_of: Any,
    nu_of: Any,
    lam: Any,
    Lam: Any,
    Lk: Any,
    score: Any,
) -> None:
    """Scalar updates b - 1 down to a undone."""
    for k in range(b - 1, a - 1, -1):
        u, D = nu_of[k] / s_of[k], 1.0 / s_of[k]
        for i in range(N):
            u += K[k, i] * lam[i]
            sum_ = 0.0
            for j in range(N):
                sum_ += Lam[i, j] * K[k, j]
            Lk[i] = sum_
            D += K[k, i] * sum_
        score[k] = u * u / D
        for n in range(wide_of[k]):
            at, h = H_at[k, n], H[k, n]
            lam[at] -= h * u
            for j in range(N):
                Lam[at, j] -= h * Lk[j]
                Lam[j, at] -= h * Lk[j]
            for m in range(wide_of[k]):
                Lam[at, H_at[k, m]] += h * H[k, m] * D
