"""The smoother's way back: modified Bryson-Frazier. One function for the compiler.

Equal to Rauch-Tung-Striebel in exact arithmetic, without an inverse and without stored predictions (Bierman1973).
With ``lam``, ``Lam`` zero at the end, per node from the last:

    smoothed error  d = -P lam,   covariance  P - P Lam P          (P after all updates of the node)
    each scalar update, last first:  u = nu / s + K.lam,   D = 1 / s + K^T Lam K
        lam -= H^T u,   Lam <- Lam - H^T (Lam K)^T - (Lam K) H + H^T H D
    lam <- Phi^T lam,   Lam <- Phi^T Lam Phi

``u^2 / D`` has mean one where the noise of an update is right, and so has ``lam_i^2 / Lam_ii`` for the process noise:
the scores by which :mod:`calibration` works (DeJongPenzer1998).
"""

from __future__ import annotations

from typing import Any

from attlog.core.jit.kernel import kernel_of
from attlog.estimators.filters.navigation.model import BG, ROW, SUM_T, WANDER_TAU, N, adjoint_predict, dot
from attlog.estimators.interface import KERNEL_SOURCES

CLIP = 9.0
"""A disturbance counts as at most three sigma: faults must not calibrate."""


TYPES = {
    "nodes": "i8",
    "rest_of": "i1[::1]",
    "par": "f8[::1]",
    "P_rows": "f8[::1]",
    "sums": "f8[:, ::1]",
    "update_of": "i8[::1]",
    "K": "f8[::1]",
    "H": "f8[:, ::1]",
    "H_at": "i1[:, ::1]",
    "wide_of": "i1[::1]",
    "s_of": "f8[::1]",
    "nu_of": "f8[::1]",
    "lam": "f8[::1]",
    "Lam": "f8[::1]",
    "d": "f8[:, ::1]",
    "spread": "f8[:, ::1]",
    "score": "f8[::1]",
    "scores": "f8[:, ::1]",
    "shocks": "f8[:, ::1]",
    "gone": "b1",
    "wanted": "b1",
}
"""Types of the arguments by name."""
SCRATCH = {"M": ("f8", (5, 3, 3)), "Lk": ("f8", (3 * ROW,)), "w": ("f8", (3 * ROW,)), "h": ("f8", (3 * ROW,))}
"""Kind and shape of what the function works with, by the argument's name."""


def backward(
    nodes: int,
    rest_of: Any,
    par: Any,
    P_rows: Any,
    sums: Any,
    update_of: Any,
    K: Any,
    H: Any,
    H_at: Any,
    wide_of: Any,
    s_of: Any,
    nu_of: Any,
    lam: Any,
    Lam: Any,
    d: Any,
    spread: Any,
    score: Any,
    scores: Any,
    shocks: Any,
    gone: bool,
    wanted: bool,
    M: Any,
    Lk: Any,
    w: Any,
    h: Any,
) -> None:
    """The nodes of a stored part of a run, last first; ``lam`` (ROW,), ``Lam`` (39 * ROW,) are carried on in place.

    Written: ``d`` (m, 6) smoothed error of attitude and gyro bias, where ``wanted`` ``spread`` (m, 3) smoothed variance
    of the attitude, ``score`` (u,) u^2 / D of every update, ``scores`` (2, 39) sums of T min(lam^2, 9 Lam) and T Lam
    while moving, ``shocks`` (m, 12) lam (3) and Lam (9) of the gyro bias as each node begins.
    ``gone`` tells whether node 0 is the first of the run, before which nothing moves. The last arguments are scratch.
    """
    for node in range(nodes - 1, -1, -1):
        own = 6 * node * ROW
        for i in range(6):
            d[node, i] = -dot(P_rows, own + i * ROW, lam, 0)
        if wanted:
            times_three(Lam, P_rows, own, 3, Lk)
            for i in range(3):
                spread[node, i] = P_rows[own + i * ROW + i] - dot(P_rows, own + i * ROW, Lk, i * ROW)
        back_through_updates(
            update_of[node], update_of[node + 1], K, H, H_at, wide_of, s_of, nu_of, lam, Lam, Lk, w, h, score
        )
        for i in range(3):
            shocks[node, i] = lam[BG + i]
            for j in range(3):
                shocks[node, 3 + 3 * i + j] = Lam[(BG + i) * ROW + BG + j]
        if gone and node == 0:
            break
        T = sums[node, SUM_T]
        if rest_of[node] == 0:
            for i in range(N):
                scores[0, i] += T * min(lam[i] * lam[i], CLIP * Lam[(ROW + 1) * i])
                scores[1, i] += T * Lam[(ROW + 1) * i]
        adjoint_predict(lam, Lam, sums[node], rest_of[node], par[WANDER_TAU], M)


def times_three(L: Any, x: Any, at: int, count: int, out: Any) -> None:
    """out = L x for up to three vectors x that stand one after the other from ``at`` on; L is symmetric."""
    for m in range(3 * ROW):
        out[m] = 0.0
    for j in range(0, N, 3):
        for c in range(count):
            a, b, d = x[at + c * ROW + j], x[at + c * ROW + j + 1], x[at + c * ROW + j + 2]
            for m in range(ROW):
                out[c * ROW + m] += (a * L[j * ROW + m] + b * L[(j + 1) * ROW + m]) + d * L[(j + 2) * ROW + m]


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
    w: Any,
    h: Any,
    score: Any,
) -> None:
    """Scalar updates b - 1 down to a undone, up to three at once.

    One changes Lam by ``h w^T + w h^T`` with ``w = -Lam K + D h / 2``; what the ones before it in a group change is
    added to its ``Lam K``, and Lam itself is changed once for all of them.
    """
    last = b
    while last > a:
        count = min(last - a, 3)
        first = last - count
        times_three(Lam, K, first * ROW, count, Lk)
        for c in range(count - 1, -1, -1):
            k = first + c
            at, own = k * ROW, c * ROW
            for p in range(count - 1, c, -1):
                by_w, by_h = dot(w, p * ROW, K, at), dot(h, p * ROW, K, at)
                for m in range(ROW):
                    Lk[own + m] += by_w * h[p * ROW + m] + by_h * w[p * ROW + m]
            u = nu_of[k] / s_of[k] + dot(K, at, lam, 0)
            D = 1.0 / s_of[k] + dot(K, at, Lk, own)
            score[k] = u * u / D
            for m in range(ROW):
                h[own + m] = 0.0
            for n in range(wide_of[k]):
                h[own + H_at[k, n]] += H[k, n]
            half = 0.5 * D
            for m in range(ROW):
                w[own + m] = half * h[own + m] - Lk[own + m]
                lam[m] -= u * h[own + m]
        for c in range(count, 3):
            for m in range(ROW):
                h[c * ROW + m] = 0.0
                w[c * ROW + m] = 0.0
        change(Lam, h, w)
        last = first


def change(L: Any, h: Any, w: Any) -> None:
    """L += h w^T + w h^T for three pairs at once; what is symmetric stays so to the bit."""
    for i in range(N):
        h0, h1, h2 = h[i], h[ROW + i], h[2 * ROW + i]
        w0, w1, w2 = w[i], w[ROW + i], w[2 * ROW + i]
        for m in range(ROW):
            L[i * ROW + m] += (
                (h0 * w[m] + w0 * h[m])
                + (h1 * w[ROW + m] + w1 * h[ROW + m])
                + (h2 * w[2 * ROW + m] + w2 * h[2 * ROW + m])
            )


BACKWARD_KERNEL = kernel_of(
    backward,
    f"void({', '.join(TYPES.values())})",
    "navigation",
    "the navigation filter, backward",
    KERNEL_SOURCES,
    tuple(SCRATCH.values()),
)
