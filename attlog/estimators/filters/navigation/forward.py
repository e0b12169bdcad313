"""The filter: nominal motion at every sample, covariance and updates at nodes. One function for the compiler.

Error-state Kalman filter with the earth-frame attitude error ``q_true = exp(phi) q``; scalar updates in sequence with
one linearisation per event. Gates: up to 2.5 sigma an event is taken, beyond its noise is multiplied by c / 2.5^2
(a foot stays in the door), beyond 30 sigma it is skipped; many skips in a row open the covariance. A field that does
not fit for a while opens the hard iron: the gyro carries the heading while the new offset is learnt. Openings are
additive noise, so the backward pass needs no special case.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.jit import F1, Cells, Out1, Out2, Out3, aligned_zeros
from attlog.estimators.filters.navigation.model import (
    BARO,
    MAG,
    MEM,
    POSITION,
    ROW,
    SUM,
    SUMS,
    VELOCITY,
    WIDE,
    WITHOUT_COMPASS,
    E,
    Events,
    Filtered,
    Kept,
    Motion,
    N,
    Nodes,
    Settings,
    State,
    between,
    field_rows,
    group_of,
    predict,
    rows,
    to_matrix3,
    turn_body,
    turn_earth,
)

MAX_SKIPS, MAX_SKIPS_MAG = 25.0, 100.0
OPEN_PHI = 0.05
OPEN_HARD_G, KICK_G = 0.010, 0.020
KICK_MEAN, KICK_AFTER, KICK_EVERY_S, KICK_CLIP, KICK_WEIGHT = 12.0, 4.0, 0.5, 60.0, 0.15
# Beyond this from the trajectory of linearisation the filter takes its own.
FAR_RAD = 0.1


IOut2 = Annotated[NDArray[np.int64], Cells("i8", 2, True)]


class Row(NamedTuple):
    """Scratch: residual of an event (3,), entries ``hv`` of its rows at states ``hi`` (3, WIDE), P h (3 * ROW,).

    ``u`` (3 * ROW,) and ``dx`` (ROW,): square root of the reduction of P, and correction, of the rows so far;
    ``last`` (3,): variance of the innovation, innovation and gain of the last row.
    """

    r: Out1
    hi: IOut2
    hv: Out2
    ph: Out1
    u: Out1
    dx: Out1
    last: Out1


class Work(NamedTuple):
    """Scratch: rotation matrices, those of a transition (5, 3, 3), sums of an interval, small vectors."""

    R: Out2
    J: Out2
    L: Out2
    M: Out3
    sums: Out1
    vectors: Out2
    w: Out1


def new_row() -> Row:
    """Return scratch for the rows of an event."""
    wide = aligned_zeros(3, WIDE)
    block = aligned_zeros(3 * ROW), aligned_zeros(3 * ROW), aligned_zeros(ROW)
    return Row(aligned_zeros(3), aligned_zeros(3, WIDE, kind="i8"), wide, *block, aligned_zeros(3))


def new_work() -> Work:
    """Return scratch for a run."""
    matrices = aligned_zeros(3, 3), aligned_zeros(3, 3), aligned_zeros(3, 3), aligned_zeros(5, 3, 3)
    return Work(*matrices, aligned_zeros(SUMS), aligned_zeros(4, 3), aligned_zeros(3))


def open_covariance(P: Any, kind: int, r: Any) -> None:
    """Additive noise where an aid was refused for long; P (N * ROW,) flat, ``r`` (3,) its residual."""
    for i in range(3):
        if kind == VELOCITY:
            P[(ROW + 1) * (E.v + i)] += r[i] * r[i]
            P[(ROW + 1) * (E.phi + i)] += OPEN_PHI * OPEN_PHI
        elif kind == POSITION:
            P[(ROW + 1) * (E.pos + i)] += r[i] * r[i]
        elif kind == MAG:
            P[(ROW + 1) * (E.hard + i)] += OPEN_HARD_G * OPEN_HARD_G
    if kind == BARO:
        P[(ROW + 1) * E.baro] += r[0] * r[0]


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


def largest_innovation(row: Any, count: int, wide: int, sigma: Any) -> float:
    """Return the largest marginal normalised innovation r^2 / s of an event's rows that are measured."""
    c = 0.0
    for i in range(count):
        if sigma[i] > 0.0:
            s = sigma[i] * sigma[i] + along_row(i, wide, row.hi, row.hv, row.ph, i * ROW)
            c = max(c, row.r[i] * row.r[i] / s)
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
    """Process noise of an interval of ``T`` s into P (N * ROW,); ``par`` the noise."""
    qg = 1e-12 if rest == 1 else par.q_gyro * par.q_gyro
    qa = par.q_acc_rest * par.q_acc_rest if rest == 1 else par.q_acc * par.q_acc
    for i in range(3):
        P[(ROW + 1) * (E.phi + i)] += T * qg
        P[(ROW + 1) * (E.v + i)] += T * qa
        P[(ROW + 1) * (E.pos + i)] += qa * T * T * T / 3.0
        P[ROW * (E.pos + i) + E.v + i] += 0.5 * qa * T * T
        P[ROW * (E.v + i) + E.pos + i] += 0.5 * qa * T * T
        P[(ROW + 1) * (E.bg + i)] += T * par.q_bg * par.q_bg
        P[(ROW + 1) * (E.ba + i)] += T * par.q_ba * par.q_ba
        if N > E.hard:
            P[(ROW + 1) * (E.hard + i)] += T * par.q_hard * par.q_hard
        P[(ROW + 1) * (E.wander + i)] += T * par.q_wander * par.q_wander
    P[(ROW + 1) * E.baro] += T * par.q_baro * par.q_baro


def propagate(motion: Any, a: int, b: int, g: float, q: Any, x: Any, R: Any, out: Any, sums: Any) -> None:
    """Carry the nominal state over samples a to b; write each attitude to ``out`` (n, 4), the interval's sums."""
    dt, gyr, acc, rest = motion.dt, motion.gyr, motion.acc, motion.rest
    for i in range(SUMS):
        sums[i] = 0.0
    for k in range(a, b + 1):
        h = dt[k]
        moving = 0.0 if rest[k] == 1 else 1.0
        wx = moving * (gyr[k, 0] - x[E.bg]) * (1.0 - x[E.scale])
        wy = moving * (gyr[k, 1] - x[E.bg + 1]) * (1.0 - x[E.scale + 1])
        wz = moving * (gyr[k, 2] - x[E.bg + 2]) * (1.0 - x[E.scale + 2])
        fx, fy, fz = acc[k, 0] - x[E.ba], acc[k, 1] - x[E.ba + 1], acc[k, 2] - x[E.ba + 2]
        turn_body(q, 0.5 * h * wx, 0.5 * h * wy, 0.5 * h * wz)
        to_matrix3(q, R)
        sums[SUM.t] += h
        for i in range(3):
            f = R[i, 0] * fx + R[i, 1] * fy + R[i, 2] * fz
            a_i = f + g if i == 2 else f
            x[E.pos + i] += h * (x[E.v + i] + 0.5 * h * a_i)
            x[E.v + i] += h * a_i
            sums[SUM.A + i] += h * f
            sums[SUM.D + 3 * i] += h * R[i, 0]
            sums[SUM.D + 3 * i + 1] += h * R[i, 1]
            sums[SUM.D + 3 * i + 2] += h * R[i, 2]
            sums[SUM.W + 3 * i] += h * R[i, 0] * wx
            sums[SUM.W + 3 * i + 1] += h * R[i, 1] * wy
            sums[SUM.W + 3 * i + 2] += h * R[i, 2] * wz
        turn_body(q, 0.5 * h * wx, 0.5 * h * wy, 0.5 * h * wz)
        for i in range(4):
            out[k, i] = q[i]


def turned_sums(R: Any, L: Any, sums: Any, work: Any) -> None:
    """Turn the sums (SUMS,) by L R^T, to be along the attitude L (3, 3) instead of R."""
    for block in range(7):
        at = SUM.A if block == 0 else SUM.D + (block - 1) % 3 + (9 if block > 3 else 0)
        step = 1 if block == 0 else 3
        for i in range(3):
            work[0, i] = R[0, i] * sums[at] + R[1, i] * sums[at + step] + R[2, i] * sums[at + 2 * step]
        for i in range(3):
            sums[at + i * step] = L[i, 0] * work[0, 0] + L[i, 1] * work[0, 1] + L[i, 2] * work[0, 2]


def opened_hard_iron(c: float, memory: Any, P: Any) -> bool:
    """Open the hard iron where a field did not fit for a while; ``c`` as of :func:`largest_innovation`."""
    memory[MEM.mag_mean] += KICK_WEIGHT * (min(c, KICK_CLIP) - memory[MEM.mag_mean])
    if memory[MEM.mag_mean] <= KICK_MEAN or memory[MEM.since_kick] < KICK_EVERY_S:
        return False
    for i in range(3):
        P[(ROW + 1) * (E.hard + i)] += KICK_G * KICK_G
    memory[MEM.mag_mean] = KICK_AFTER
    memory[MEM.since_kick] = 0.0
    memory[MEM.kicked] += 1.0
    return True


def refused(kind: int, c: float, r: Any, par: Any, memory: Any, P: Any) -> int:
    """Return 1 for an event beyond the hard gate, 0 for one within, 2 where P was opened after many refusals."""
    if c <= par.hard_gate * par.hard_gate:
        memory[MEM.skips + kind] = max(memory[MEM.skips + kind] - 2.0, 0.0)
        return 0
    memory[MEM.skips + kind] += 1.0
    if memory[MEM.skips + kind] <= (MAX_SKIPS_MAG if kind == MAG else MAX_SKIPS):
        return 1
    open_covariance(P, kind, r)
    memory[MEM.skips + kind] = 0.0
    memory[MEM.opened] += 1.0
    return 2


def gated(state: Any, kind: int, count: int, wide: int, sigma: Any, row: Any, par: Any, ratio: Any) -> float:
    """Return the largest normalised innovation of an event, below 0 where it is refused.

    It is found anew where the hard iron or the covariance was opened. ``ratio`` (4,) of the node is written.
    """
    c = 0.0
    for look in range(3):
        if look == 1 and not (kind == MAG and opened_hard_iron(c, state.memory, state.P)):
            continue
        if look == 2:
            verdict = refused(kind, c, row.r, par, state.memory, state.P)
            if verdict < 2:
                return c if verdict == 0 else -1.0
        project(state.P, count, wide, row.hi, row.hv, row.ph)
        c = largest_innovation(row, count, wide, sigma)
        if look == 0 and kind <= MAG:
            ratio[kind] = c / (par.soft_gate * par.soft_gate)
    return c


def gains(i: int, wide: int, noise: float, row: Any, memory: Any) -> None:
    """Take row i of an event after those before it; P itself changes once for all of them, by :func:`apply_gain`.

    ``row.ph`` becomes P h as the rows before leave it; ``row.u`` and ``row.dx`` are carried on.
    """
    ph, u, dx = row.ph, row.u, row.dx
    at = i * ROW
    for k in range(i):
        share = along_row(i, wide, row.hi, row.hv, u, k * ROW)
        for m in range(ROW):
            ph[at + m] -= share * u[k * ROW + m]
    s = noise + max(along_row(i, wide, row.hi, row.hv, ph, at), 0.0)
    nu = row.r[i] - along_row(i, wide, row.hi, row.hv, dx, 0)
    gain = 1.0 / s
    root, step = math.sqrt(gain), gain * nu
    for m in range(ROW):
        u[at + m] = ph[at + m] * root
        dx[m] += ph[at + m] * step
    memory[MEM.likelihood] -= 0.5 * (nu * nu * gain + math.log(s))
    row.last[0], row.last[1], row.last[2] = s, nu, gain


@jit.loop("the navigation filter, forward")
def forward(
    first: int,
    last: int,
    origin: int,
    used: int,
    use_along: bool,
    par: Settings,
    x0: F1,
    motion: Motion,
    nodes: Nodes,
    events: Events,
    state: State,
    out: Filtered,
    kept: Kept,
    row: Row,
    work: Work,
) -> int:
    """Run the nodes ``first`` to ``last`` (exclusive); return how many updates are kept then.

    ``x0`` (39,) the state at the start of the pass. ``use_along``: linearise along ``nodes.along``. ``kept`` counts
    from the node ``origin`` and holds ``used`` updates already; nothing is kept with -1.
    """
    keep = origin >= 0
    q, x, P, memory = state.q, state.x, state.P, state.memory
    for node in range(first, last):
        b = nodes.at[node]
        resting = motion.rest[b]
        if resting == 1 and memory[MEM.resting] == 0.0:
            for i in range(4):
                memory[MEM.frozen + i] = q[i]
        memory[MEM.resting] = float(resting)
        if node == 0:
            for i in range(4):
                out.q[0, i] = q[i]
        # Before the first node nothing moves: an empty span leaves sums of zero.
        a = nodes.at[node - 1] + 1 if node > 0 else b + 1
        propagate(motion, a, b, par.gravity, q, x, work.R, out.q, work.sums)
        to_matrix3(q, work.R)
        follow = False
        if use_along:
            to_matrix3(nodes.along[node], work.L)
            follow = between(work.R, work.L, work.vectors[3]) < FAR_RAD
        if node > 0:
            if follow:
                turned_sums(work.R, work.L, work.sums, work.vectors)
            fade = math.exp(-work.sums[SUM.t] / par.wander_tau)
            for i in range(3):
                x[E.wander + i] *= fade
            predict(P, work.sums, resting, par.wander_tau, work.M)
            add_process_noise(P, work.sums[SUM.t], par, resting)
            for i in range(3):
                P[(ROW + 1) * (E.bg + i)] += nodes.jump[node] * nodes.jump[node]
            memory[MEM.since_kick] += work.sums[SUM.t]
        if keep:
            for i in range(SUMS):
                kept.sums[node - origin, i] = work.sums[i]
            kept.update_of[node - origin] = used
        for e in range(nodes.event[node], nodes.event[node + 1]):
            used = take_event(e, node, resting, follow, keep, used, par, x0, nodes, events, state, out, kept, row, work)
        keep_node(node, node - origin, b, state, out, keep, kept.P_rows)
    if keep:
        kept.update_of[last - origin] = used
    total: int = used
    return total


def take_event(
    e: int,
    node: int,
    resting: int,
    follow: bool,
    keep: bool,
    used: int,
    par: Any,
    x0: Any,
    nodes: Any,
    events: Any,
    state: Any,
    out: Any,
    kept: Any,
    row: Any,
    work: Any,
) -> int:
    """Correct the state by event ``e`` of a node; return how many updates are kept then."""
    q, x, P, memory = state.q, state.x, state.P, state.memory
    kind = events.kind[e]
    count = 1 if kind == BARO else 3
    for i in range(3):
        work.w[i] = events.rate[e, i] - x[E.bg + i]
    to_matrix3(q, work.R)
    if kind == MAG:
        if follow:
            to_matrix3(nodes.along[node], work.J)
        elif resting == 1:
            to_matrix3(memory[MEM.frozen : MEM.frozen + 4], work.J)
        else:
            to_matrix3(q, work.J)
        wide = field_rows(x, x0, work.R, work.J, events.offset[e], work.w, events.z[e], follow, work.vectors, row)
    else:
        force = events.force[e]
        wide = rows(kind, x, work.R, events.offset[e], force, work.w, events.z[e], par, work.vectors, row)
    if kind == VELOCITY:
        memory[MEM.seen] += 1.0
    c = gated(state, kind, count, wide, events.sigma[e], row, par, out.ratio[node])
    if c < 0.0:
        return used
    grown = max(c / (par.soft_gate * par.soft_gate), 1.0)
    if grown > 1.0 and kind == VELOCITY:
        memory[MEM.softened] += 1.0
    for i in range(ROW):
        row.dx[i] = 0.0
    for i in range(count):
        if not events.sigma[e, i] > 0.0:
            for m in range(ROW):
                row.u[i * ROW + m] = 0.0
            continue
        noise = grown * events.sigma[e, i] * events.sigma[e, i]
        gains(i, wide, noise, row, memory)
        if keep:
            for m in range(ROW):
                kept.K[used * ROW + m] = row.ph[i * ROW + m] * row.last[2]
            for k in range(wide):
                kept.H[used, k], kept.H_at[used, k] = row.hv[i, k], row.hi[i, k]
            kept.wide_of[used], kept.r_of[used] = wide, noise
            kept.s_of[used], kept.nu_of[used] = row.last[0], row.last[1]
            kept.group[used] = group_of(kind, i)
            kept.soft[used] = 1 if grown > 1.0 else 0
            used += 1
    apply_gain(P, count, row.u)
    turn_earth(q, row.dx[E.phi], row.dx[E.phi + 1], row.dx[E.phi + 2])
    for i in range(E.v, N):
        x[i] += row.dx[i]
    return used


def keep_node(node: int, own: int, b: int, state: Any, out: Any, keep: bool, P_rows: Any) -> None:
    """Write attitude, bias and variance of a node; for the way back the rows of P of attitude and bias."""
    P = state.P
    for i in range(4):
        out.q[b, i] = state.q[i]
    for i in range(3):
        out.bias[node, i] = state.x[E.bg + i]
        out.variance[node, i] = P[(ROW + 1) * (E.phi + i)]
    if keep:
        for i in range(3):
            at = (6 * own + i) * ROW
            for m in range(ROW):
                P_rows[at + m] = P[(E.phi + i) * ROW + m]
                P_rows[at + 3 * ROW + m] = P[(E.bg + i) * ROW + m]


forward_without_compass = jit.Loop(
    jit.with_constants(forward.function, "forward_without_compass", WITHOUT_COMPASS),
    "the navigation filter without compass, forward",
)
