"""The filter: nominal motion at every sample, covariance and updates at nodes. One function for the compiler.

Error-state Kalman filter with the earth-frame attitude error ``q_true = exp(phi) q``; scalar updates in sequence with
one linearisation per event. Gates: up to 2.5 sigma an event is taken, beyond its noise is multiplied by c / 2.5^2
(a foot stays in the door), beyond 30 sigma it is skipped; many skips in a row open the covariance. A field that does
not fit for a while opens the hard iron: the gyro carries the heading while the new offset is learnt. Openings are
additive noise, so the backward pass needs no special case.
"""

from __future__ import annotations

import math
from typing import Any

from attlog.core.jit.kernel import kernel_of
from attlog.estimators.filters.navigation.model import (
    BA,
    BARO,
    BARO_BIAS,
    BG,
    FROZEN,
    GRAVITY_AT,
    HARD,
    HARD_GATE,
    KICKED,
    LIKELIHOOD,
    MAG,
    MAG_MEAN,
    OPENED,
    PHI,
    POS,
    POSITION,
    Q_ACC,
    Q_ACC_REST,
    Q_BA,
    Q_BARO,
    Q_BG,
    Q_GYRO,
    Q_HARD,
    Q_WANDER,
    RESTING,
    ROW,
    SCALE,
    SEEN,
    SINCE_KICK,
    SKIPS,
    SOFT_GATE,
    SOFTENED,
    SUM_A,
    SUM_D,
    SUM_T,
    SUM_W,
    SUMS,
    VELOCITY,
    WANDER,
    WANDER_TAU,
    WIDE,
    N,
    V,
    between,
    field_rows,
    group_of,
    predict,
    rows,
    to_matrix3,
    turn_body,
    turn_earth,
)
from attlog.estimators.interface import KERNEL_SOURCES

MOST_SKIPS, MOST_SKIPS_MAG = 25.0, 100.0
OPEN_PHI = 0.05
OPEN_HARD_G, KICK_G = 0.010, 0.020
KICK_MEAN, KICK_AFTER, KICK_EVERY_S, KICK_CLIP, KICK_WEIGHT = 12.0, 4.0, 0.5, 60.0, 0.15
FAR_RAD = 0.1
"""Beyond this from the trajectory of linearisation the filter takes its own."""


TYPES = {
    "first": "i8",
    "last": "i8",
    "dt": "f8[::1]",
    "gyr": "f8[:, ::1]",
    "acc": "f8[:, ::1]",
    "rest": "i1[::1]",
    "node_at": "i8[::1]",
    "node_event": "i8[::1]",
    "kind": "i8[::1]",
    "offset": "f8[::1]",
    "z": "f8[:, ::1]",
    "f_mean": "f8[:, ::1]",
    "w_mean": "f8[:, ::1]",
    "sigma": "f8[:, ::1]",
    "jump": "f8[::1]",
    "par": "f8[::1]",
    "along": "f8[:, ::1]",
    "use_along": "b1",
    "x0": "f8[::1]",
    "q": "f8[::1]",
    "x": "f8[::1]",
    "P": "f8[::1]",
    "memory": "f8[::1]",
    "q_all": "f8[:, ::1]",
    "bias": "f8[:, ::1]",
    "variance": "f8[:, ::1]",
    "ratio": "f8[:, ::1]",
    "keep": "b1",
    "P_rows": "f8[::1]",
    "sums": "f8[:, ::1]",
    "update_of": "i8[::1]",
    "K": "f8[::1]",
    "H": "f8[:, ::1]",
    "H_at": "i1[:, ::1]",
    "wide_of": "i1[::1]",
    "s_of": "f8[::1]",
    "nu_of": "f8[::1]",
    "r_of": "f8[::1]",
    "group": "i1[::1]",
    "soft": "i1[::1]",
}
"""Types of the arguments by name."""
SCRATCH = {
    "R": ("f8", (3, 3)),
    "J": ("f8", (3, 3)),
    "L": ("f8", (3, 3)),
    "M": ("f8", (5, 3, 3)),
    "own": ("f8", (SUMS,)),
    "hi": ("i8", (3, WIDE)),
    "hv": ("f8", (3, WIDE)),
    "r": ("f8", (3,)),
    "ph": ("f8", (3 * ROW,)),
    "u": ("f8", (3 * ROW,)),
    "dx": ("f8", (ROW,)),
    "work": ("f8", (4, 3)),
    "w": ("f8", (3,)),
}
"""Kind and shape of what the function works with, by the argument's name."""


def open_covariance(P: Any, kind: int, r: Any) -> None:
    """Additive noise where an aid was refused for long; P (39 * ROW,) flat, ``r`` (3,) its residual."""
    for i in range(3):
        if kind == VELOCITY:
            P[(ROW + 1) * (V + i)] += r[i] * r[i]
            P[(ROW + 1) * (PHI + i)] += OPEN_PHI * OPEN_PHI
        elif kind == POSITION:
            P[(ROW + 1) * (POS + i)] += r[i] * r[i]
        elif kind == MAG:
            P[(ROW + 1) * (HARD + i)] += OPEN_HARD_G * OPEN_HARD_G
    if kind == BARO:
        P[(ROW + 1) * BARO_BIAS] += r[0] * r[0]


def project(P: Any, count: int, wide: int, hi: Any, hv: Any, ph: Any) -> None:
    """ph = P h of each row h of an event, one after the other in a flat array; four entries at a time."""
    for i in range(count):
        out = ph[i * ROW : (i + 1) * ROW]
        for m in range(ROW):
            out[m] = 0.0
        k = 0
        while k + 4 <= wide:
            a, b, c, d = hv[i, k], hv[i, k + 1], hv[i, k + 2], hv[i, k + 3]
            p, q, r, s = P[hi[i, k] * ROW :], P[hi[i, k + 1] * ROW :], P[hi[i, k + 2] * ROW :], P[hi[i, k + 3] * ROW :]
            for m in range(ROW):
                out[m] = (((out[m] + a * p[m]) + b * q[m]) + c * r[m]) + d * s[m]
            k += 4
        while k < wide:
            a, p = hv[i, k], P[hi[i, k] * ROW :]
            for m in range(ROW):
                out[m] += a * p[m]
            k += 1


def along_row(i: int, wide: int, hi: Any, hv: Any, x: Any, at: int) -> float:
    """Row i of an event, whose ``wide`` entries ``hv`` stand at states ``hi`` (3, WIDE), times x from ``at`` on."""
    total = 0.0
    for k in range(wide):
        total += hv[i, k] * x[at + hi[i, k]]
    return total


def largest_innovation(r: Any, count: int, wide: int, hi: Any, hv: Any, sigma: Any, ph: Any) -> float:
    """Largest marginal normalised innovation r^2 / s of an event's rows that are told; ``ph`` is their P h."""
    c = 0.0
    for i in range(count):
        if sigma[i] > 0.0:
            c = max(c, r[i] * r[i] / (sigma[i] * sigma[i] + along_row(i, wide, hi, hv, ph, i * ROW)))
    return c


def apply_gain(P: Any, count: int, u: Any) -> None:
    """P -= u u^T of one row or of three at once; what is symmetric stays so to the bit."""
    for i in range(N):
        a, b, c = u[i], u[ROW + i], u[2 * ROW + i]
        if count == 1:
            for m in range(ROW):
                P[i * ROW + m] -= a * u[m]
        else:
            for m in range(ROW):
                P[i * ROW + m] -= (a * u[m] + b * u[ROW + m]) + c * u[2 * ROW + m]


def add_process_noise(P: Any, T: float, par: Any, rest: int) -> None:
    """Process noise of an interval of ``T`` s into P (39 * ROW,); ``par`` see layout."""
    qg = 1e-12 if rest == 1 else par[Q_GYRO] * par[Q_GYRO]
    qa = par[Q_ACC_REST] * par[Q_ACC_REST] if rest == 1 else par[Q_ACC] * par[Q_ACC]
    for i in range(3):
        P[(ROW + 1) * (PHI + i)] += T * qg
        P[(ROW + 1) * (V + i)] += T * qa
        P[(ROW + 1) * (POS + i)] += qa * T * T * T / 3.0
        P[ROW * (POS + i) + V + i] += 0.5 * qa * T * T
        P[ROW * (V + i) + POS + i] += 0.5 * qa * T * T
        P[(ROW + 1) * (BG + i)] += T * par[Q_BG] * par[Q_BG]
        P[(ROW + 1) * (BA + i)] += T * par[Q_BA] * par[Q_BA]
        P[(ROW + 1) * (HARD + i)] += T * par[Q_HARD] * par[Q_HARD]
        P[(ROW + 1) * (WANDER + i)] += T * par[Q_WANDER] * par[Q_WANDER]
    P[(ROW + 1) * BARO_BIAS] += T * par[Q_BARO] * par[Q_BARO]


def propagate(
    dt: Any, gyr: Any, acc: Any, rest: Any, a: int, b: int, g: float, q: Any, x: Any, R: Any, out: Any, sums: Any
) -> None:
    """The nominal state over samples a to b, the attitude of each to ``out`` (n, 4), the sums of the interval."""
    for i in range(SUMS):
        sums[i] = 0.0
    for k in range(a, b + 1):
        h = dt[k]
        moving = 0.0 if rest[k] == 1 else 1.0
        wx = moving * (gyr[k, 0] - x[BG]) * (1.0 - x[SCALE])
        wy = moving * (gyr[k, 1] - x[BG + 1]) * (1.0 - x[SCALE + 1])
        wz = moving * (gyr[k, 2] - x[BG + 2]) * (1.0 - x[SCALE + 2])
        fx, fy, fz = acc[k, 0] - x[BA], acc[k, 1] - x[BA + 1], acc[k, 2] - x[BA + 2]
        turn_body(q, 0.5 * h * wx, 0.5 * h * wy, 0.5 * h * wz)
        to_matrix3(q, R)
        sums[SUM_T] += h
        for i in range(3):
            f = R[i, 0] * fx + R[i, 1] * fy + R[i, 2] * fz
            a_i = f + g if i == 2 else f
            x[POS + i] += h * (x[V + i] + 0.5 * h * a_i)
            x[V + i] += h * a_i
            sums[SUM_A + i] += h * f
            sums[SUM_D + 3 * i] += h * R[i, 0]
            sums[SUM_D + 3 * i + 1] += h * R[i, 1]
            sums[SUM_D + 3 * i + 2] += h * R[i, 2]
            sums[SUM_W + 3 * i] += h * R[i, 0] * wx
            sums[SUM_W + 3 * i + 1] += h * R[i, 1] * wy
            sums[SUM_W + 3 * i + 2] += h * R[i, 2] * wz
        turn_body(q, 0.5 * h * wx, 0.5 * h * wy, 0.5 * h * wz)
        for i in range(4):
            out[k, i] = q[i]


def turned_sums(R: Any, L: Any, sums: Any, work: Any) -> None:
    """The sums (SUMS,) as they would be along the attitude L (3, 3) instead of R: turned by L R^T."""
    for block in range(7):
        at = SUM_A if block == 0 else SUM_D + (block - 1) % 3 + (9 if block > 3 else 0)
        step = 1 if block == 0 else 3
        for i in range(3):
            work[0, i] = R[0, i] * sums[at] + R[1, i] * sums[at + step] + R[2, i] * sums[at + 2 * step]
        for i in range(3):
            sums[at + i * step] = L[i, 0] * work[0, 0] + L[i, 1] * work[0, 1] + L[i, 2] * work[0, 2]


def opened_hard_iron(c: float, memory: Any, P: Any) -> bool:
    """Whether a field that did not fit for a while has just opened the hard iron; ``c`` as of :func:`worst`."""
    memory[MAG_MEAN] += KICK_WEIGHT * (min(c, KICK_CLIP) - memory[MAG_MEAN])
    if memory[MAG_MEAN] <= KICK_MEAN or memory[SINCE_KICK] < KICK_EVERY_S:
        return False
    for i in range(3):
        P[(ROW + 1) * (HARD + i)] += KICK_G * KICK_G
    memory[MAG_MEAN] = KICK_AFTER
    memory[SINCE_KICK] = 0.0
    memory[KICKED] += 1.0
    return True


def refused(kind: int, c: float, r: Any, par: Any, memory: Any, P: Any) -> int:
    """1 for an event beyond the hard gate, 0 for one within, 2 where so many were refused that P was opened for it."""
    if c <= par[HARD_GATE] * par[HARD_GATE]:
        memory[SKIPS + kind] = max(memory[SKIPS + kind] - 2.0, 0.0)
        return 0
    memory[SKIPS + kind] += 1.0
    if memory[SKIPS + kind] <= (MOST_SKIPS_MAG if kind == MAG else MOST_SKIPS):
        return 1
    open_covariance(P, kind, r)
    memory[SKIPS + kind] = 0.0
    memory[OPENED] += 1.0
    return 2


def gated(
    P: Any,
    kind: int,
    count: int,
    wide: int,
    hi: Any,
    hv: Any,
    sigma: Any,
    r: Any,
    ph: Any,
    par: Any,
    memory: Any,
    ratio: Any,
) -> float:
    """The worst normalised innovation of an event, below 0 where it is refused; ``ph`` = P h, as of :func:`project`.

    Looked at anew where the hard iron and where the covariance was opened. ``ratio`` (4,) of the node.
    """
    c = 0.0
    for look in range(3):
        if look == 1 and not (kind == MAG and opened_hard_iron(c, memory, P)):
            continue
        if look == 2:
            verdict = refused(kind, c, r, par, memory, P)
            if verdict < 2:
                return c if verdict == 0 else -1.0
        project(P, count, wide, hi, hv, ph)
        c = largest_innovation(r, count, wide, hi, hv, sigma, ph)
        if look == 0 and kind <= MAG:
            ratio[kind] = c / (par[SOFT_GATE] * par[SOFT_GATE])
    return c


def gains(
    row: int, wide: int, hi: Any, hv: Any, r: Any, noise: float, ph: Any, u: Any, dx: Any, memory: Any, told: Any
) -> None:
    """One row of an event after those before it: P itself is changed once for all of them, by :func:`shrink`.

    ``ph`` is made P h as the rows before leave it, ``u`` (3 * ROW,) and ``dx`` (ROW,) are carried on; ``told`` (3,):
    variance of the innovation, innovation, gain.
    """
    at = row * ROW
    for k in range(row):
        share = along_row(row, wide, hi, hv, u, k * ROW)
        for m in range(ROW):
            ph[at + m] -= share * u[k * ROW + m]
    s = noise + max(along_row(row, wide, hi, hv, ph, at), 0.0)
    nu = r[row] - along_row(row, wide, hi, hv, dx, 0)
    gain = 1.0 / s
    root, step = math.sqrt(gain), gain * nu
    for m in range(ROW):
        u[at + m] = ph[at + m] * root
        dx[m] += ph[at + m] * step
    memory[LIKELIHOOD] -= 0.5 * (nu * nu * gain + math.log(s))
    told[0], told[1], told[2] = s, nu, gain


def forward(
    first: int,
    last: int,
    dt: Any,
    gyr: Any,
    acc: Any,
    rest: Any,
    node_at: Any,
    node_event: Any,
    kind: Any,
    offset: Any,
    z: Any,
    f_mean: Any,
    w_mean: Any,
    sigma: Any,
    jump: Any,
    par: Any,
    along: Any,
    use_along: bool,
    x0: Any,
    q: Any,
    x: Any,
    P: Any,
    memory: Any,
    q_all: Any,
    bias: Any,
    variance: Any,
    ratio: Any,
    keep: bool,
    P_rows: Any,
    sums: Any,
    update_of: Any,
    K: Any,
    H: Any,
    H_at: Any,
    wide_of: Any,
    s_of: Any,
    nu_of: Any,
    r_of: Any,
    group: Any,
    soft: Any,
    R: Any,
    J: Any,
    L: Any,
    M: Any,
    own: Any,
    hi: Any,
    hv: Any,
    r: Any,
    ph: Any,
    u: Any,
    dx: Any,
    work: Any,
    w: Any,
) -> int:
    """Nodes ``first`` to ``last`` (exclusive) of a run; state, covariance and memory are carried on in place.

    Samples: ``dt`` (n,), ``gyr``, ``acc`` (n, 3), ``rest`` (n,). Nodes: ``node_at`` (m,) sample, ``node_event`` (m
    + 1,) first event. Events: ``kind``, ``offset`` (e,) s, values ``z``, centred means ``f_mean``, ``w_mean``,
    noise ``sigma`` (e, 3), 0 where a component is not told. ``par`` see layout; ``jump`` (m,) rad/s by which the
    gyro bias may jump at nodes; ``along`` (m, 4) the trajectory of linearisation where ``use_along``; ``P`` (39 *
    ROW,) flat; ``x0`` (39,) the state at the start of the pass. Written always: ``q_all`` (n, 4), ``bias`` and
    ``variance`` of the attitude (m, 3), ``ratio`` (m, 4) test ratios; where ``keep`` also what the backward pass
    needs, counted from ``first``; the rest is scratch. Returns how many updates were kept.
    """
    used = 0
    for node in range(first, last):
        b = node_at[node]
        resting = rest[b]
        if resting == 1 and memory[RESTING] == 0.0:
            for i in range(4):
                memory[FROZEN + i] = q[i]
        memory[RESTING] = float(resting)
        if node == 0:
            for i in range(4):
                q_all[0, i] = q[i]
        # Before the first node nothing moves: an empty span leaves sums of zero.
        propagate(
            dt, gyr, acc, rest, node_at[node - 1] + 1 if node > 0 else b + 1, b, par[GRAVITY_AT], q, x, R, q_all, own
        )
        to_matrix3(q, R)
        follow = False
        if use_along:
            to_matrix3(along[node], L)
            follow = between(R, L, work[3]) < FAR_RAD
        if node > 0:
            if follow:
                turned_sums(R, L, own, work)
            fade = math.exp(-own[SUM_T] / par[WANDER_TAU])
            for i in range(3):
                x[WANDER + i] *= fade
            predict(P, own, resting, par[WANDER_TAU], M)
            add_process_noise(P, own[SUM_T], par, resting)
            for i in range(3):
                P[(ROW + 1) * (BG + i)] += jump[node] * jump[node]
            memory[SINCE_KICK] += own[SUM_T]
        if keep:
            for i in range(SUMS):
                sums[node - first, i] = own[i]
            update_of[node - first] = used
        for e in range(node_event[node], node_event[node + 1]):
            what = kind[e]
            count = 1 if what == BARO else 3
            for i in range(3):
                w[i] = w_mean[e, i] - x[BG + i]
            to_matrix3(q, R)
            if what == MAG:
                if follow:
                    to_matrix3(along[node], J)
                elif resting == 1:
                    to_matrix3(memory[FROZEN : FROZEN + 4], J)
                else:
                    to_matrix3(q, J)
                wide = field_rows(x, x0, R, J, offset[e], w, z[e], follow, work, r, hi, hv)
            else:
                wide = rows(what, x, R, offset[e], f_mean[e], w, z[e], par, work, r, hi, hv)
            if what == VELOCITY:
                memory[SEEN] += 1.0
            c = gated(P, what, count, wide, hi, hv, sigma[e], r, ph, par, memory, ratio[node])
            if c < 0.0:
                continue
            grown = max(c / (par[SOFT_GATE] * par[SOFT_GATE]), 1.0)
            if grown > 1.0 and what == VELOCITY:
                memory[SOFTENED] += 1.0
            for i in range(ROW):
                dx[i] = 0.0
            for i in range(count):
                if not sigma[e, i] > 0.0:
                    for m in range(ROW):
                        u[i * ROW + m] = 0.0
                    continue
                noise = grown * sigma[e, i] * sigma[e, i]
                gains(i, wide, hi, hv, r, noise, ph, u, dx, memory, work[0])
                if keep:
                    for m in range(ROW):
                        K[used * ROW + m] = ph[i * ROW + m] * work[0, 2]
                    for k in range(wide):
                        H[used, k], H_at[used, k] = hv[i, k], hi[i, k]
                    wide_of[used], s_of[used], nu_of[used], r_of[used] = wide, work[0, 0], work[0, 1], noise
                    group[used] = group_of(what, i)
                    soft[used] = 1 if grown > 1.0 else 0
                    used += 1
            apply_gain(P, count, u)
            turn_earth(q, dx[PHI], dx[PHI + 1], dx[PHI + 2])
            for i in range(V, N):
                x[i] += dx[i]
        keep_node(node, node - first, b, q, x, P, q_all, bias, variance, keep, P_rows)
    if keep:
        update_of[last - first] = used
    total: int = used
    return total


def keep_node(
    node: int, own: int, b: int, q: Any, x: Any, P: Any, q_all: Any, bias: Any, variance: Any, keep: bool, P_rows: Any
) -> None:
    """What a node leaves behind: attitude, bias, variance; for the way back the rows of P of attitude and bias."""
    for i in range(4):
        q_all[b, i] = q[i]
    for i in range(3):
        bias[node, i] = x[BG + i]
        variance[node, i] = P[(ROW + 1) * (PHI + i)]
    if keep:
        for i in range(3):
            at = (6 * own + i) * ROW
            for m in range(ROW):
                P_rows[at + m] = P[(PHI + i) * ROW + m]
                P_rows[at + 3 * ROW + m] = P[(BG + i) * ROW + m]


FORWARD_KERNEL = kernel_of(
    forward,
    f"i8({', '.join(TYPES.values())})",
    "navigation",
    "the navigation filter, forward",
    KERNEL_SOURCES,
    tuple(SCRATCH.values()),
)
