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

from typing import Any, NamedTuple

from attlog.core import jit
from attlog.core.jit import B1, Out1, Out2, Out3, aligned_zeros
from attlog.estimators.filters.navigation.model import (
    ROW,
    SUM,
    WITHOUT_COMPASS,
    E,
    Kept,
    N,
    Settings,
    adjoint_predict,
    dot,
)

# A disturbance counts as at most three sigma: faults must not calibrate.
CLIP = 9.0


class Adjoint(NamedTuple):
    """Score and information carried back in place: ``lam`` (ROW,), ``Lam`` (N * ROW,)."""

    lam: Out1
    Lam: Out1


class Smoothed(NamedTuple):
    """Written for m nodes: smoothed error ``d`` (m, 6) of attitude and gyro bias, variance (m, 3) of the attitude.

    ``score`` (updates,) u^2 / D of each update; ``scores`` (2, 39) sums of T min(lam^2, 9 Lam) and T Lam while moving;
    ``shocks`` (m, 12) lam (3) and Lam (9) of the gyro bias as each node begins.
    """

    d: Out2
    variance: Out2
    score: Out1
    scores: Out2
    shocks: Out2


class Work(NamedTuple):
    """Scratch: matrices of a transition (5, 3, 3), three vectors each (3 * ROW,)."""

    M: Out3
    Lk: Out1
    w: Out1
    h: Out1


def new_work() -> Work:
    """Return scratch for a run."""
    return Work(aligned_zeros(5, 3, 3), aligned_zeros(3 * ROW), aligned_zeros(3 * ROW), aligned_zeros(3 * ROW))


@jit.loop("the navigation filter, backward")
def backward(
    begins: bool, wanted: bool, par: Settings, rest_of: B1, kept: Kept, adjoint: Adjoint, out: Smoothed, work: Work
) -> None:
    """Go back through the stored nodes, last first.

    ``rest_of`` (m,) of the interval before each; ``begins``: node 0 is the first of the run, before which nothing
    moves; ``wanted``: write the smoothed variance.
    """
    lam, Lam, M, Lk = adjoint.lam, adjoint.Lam, work.M, work.Lk
    for node in range(len(rest_of) - 1, -1, -1):
        own = 6 * node * ROW
        for i in range(6):
            out.d[node, i] = -dot(kept.P_rows, own + i * ROW, lam, 0)
        if wanted:
            times_three(Lam, kept.P_rows, own, 3, Lk)
            for i in range(3):
                at = own + i * ROW
                out.variance[node, i] = kept.P_rows[at + i] - dot(kept.P_rows, at, Lk, i * ROW)
        undo_updates(kept.update_of[node], kept.update_of[node + 1], kept, lam, Lam, out.score, work)
        for i in range(3):
            out.shocks[node, i] = lam[E.bg + i]
            for j in range(3):
                out.shocks[node, 3 + 3 * i + j] = Lam[(E.bg + i) * ROW + E.bg + j]
        if begins and node == 0:
            break
        T = kept.sums[node, SUM.t]
        if rest_of[node] == 0:
            for i in range(N):
                out.scores[0, i] += T * min(lam[i] * lam[i], CLIP * Lam[(ROW + 1) * i])
                out.scores[1, i] += T * Lam[(ROW + 1) * i]
        adjoint_predict(lam, Lam, kept.sums[node], rest_of[node], par.wander_tau, M)


def times_three(L: Any, x: Any, at: int, count: int, out: Any) -> None:
    """Compute out = L x for up to three vectors x, one after the other from ``at`` on; L is symmetric."""
    for m in range(3 * ROW):
        out[m] = 0.0
    for j in range(0, N, 3):
        for c in range(count):
            a, b, d = x[at + c * ROW + j], x[at + c * ROW + j + 1], x[at + c * ROW + j + 2]
            for m in range(ROW):
                out[c * ROW + m] += (a * L[j * ROW + m] + b * L[(j + 1) * ROW + m]) + d * L[(j + 2) * ROW + m]


def undo_updates(a: int, b: int, kept: Any, lam: Any, Lam: Any, score: Any, work: Any) -> None:
    """Undo the scalar updates b - 1 down to a, up to three at once.

    One changes Lam by ``h w^T + w h^T`` with ``w = -Lam K + D h / 2``; what the ones before it in a group change is
    added to its ``Lam K``, and Lam itself is changed once for all of them.
    """
    K, Lk, w, h = kept.K, work.Lk, work.w, work.h
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
            u = kept.nu_of[k] / kept.s_of[k] + dot(K, at, lam, 0)
            D = 1.0 / kept.s_of[k] + dot(K, at, Lk, own)
            score[k] = u * u / D
            for m in range(ROW):
                h[own + m] = 0.0
            for n in range(kept.wide_of[k]):
                h[own + kept.H_at[k, n]] += kept.H[k, n]
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
    """Add h w^T + w h^T to L for three pairs at once; what is symmetric stays so to the bit."""
    for i in range(N):
        h0, h1, h2 = h[i], h[ROW + i], h[2 * ROW + i]
        w0, w1, w2 = w[i], w[ROW + i], w[2 * ROW + i]
        for m in range(ROW):
            L[i * ROW + m] += (
                (h0 * w[m] + w0 * h[m])
                + (h1 * w[ROW + m] + w1 * h[ROW + m])
                + (h2 * w[2 * ROW + m] + w2 * h[2 * ROW + m])
            )


backward_without_compass = jit.Loop(
    jit.with_constants(backward.function, "backward_without_compass", WITHOUT_COMPASS),
    "the navigation filter without compass, backward",
)
