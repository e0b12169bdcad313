"""The model of ``mekf`` with a backward pass: the smoother of recordings without GNSS.

    forward   the filter, four times: the magnetometer's delay and the size of the accelerometer bias that one run finds
              are known to the next
    backward  delta = x^s_k [-] x^-_k,   C = P^+_{k-1} F^T (P^-_k)^-1,   x^s_{k-1} = x^+_{k-1} [+] C delta        (1)
              P^s_{k-1} = P^+_{k-1} + C (P^s_k - P^-_k) C^T                                                     (2)

Source: Rauch1965 for (1) and (2).

Inside a block the correction runs from that of its begin to that of its end. Before the first block (the alignment, and
what comes before the first field) the attitude is the gyro's, backwards, with the smoothed bias and gyro matrix.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, IOut1, Out1, Out2, aligned_zeros
from attlog.estimators.aids import FULL_AIRSPEED, Measurements
from attlog.estimators.filters import mekf
from attlog.estimators.filters.inertial.compass import EXCESS_TIME
from attlog.estimators.filters.inertial.model import ALIGNING, MOVING_RATE, E, K, N, S
from attlog.estimators.filters.inertial.start import align, look_for_rest
from attlog.estimators.filters.mekf import correct, finish, predict, sample, take_force
from attlog.estimators.filters.navigation.start import chained
from attlog.estimators.interface import Array, Estimate
from attlog.estimators.vectors import exponential, multiplied

PRESET = "smoother"
ROUNDS = 3
# Longer recordings get longer blocks: what has to be kept of one is 7.5 kB.
MAX_BLOCKS = 20_000
MIN_TILT_SIGMA = np.deg2rad(0.3)
# What the model does not know of a smoothed tilt: the accelerometer's scale (0.5 % of g), and the time of a sample.
LATE_S = 0.002
SUM_COLUMNS = 41
# After the sums of a block: excess and heading doubt, then D (3 N) before and after what was measured.
BEFORE, AFTER = SUM_COLUMNS + 2, SUM_COLUMNS + 2 + 3 * N
RECORDED = SUM_COLUMNS + 2 + 6 * N
# Blocks whose gains are found at once.
BLOCKS_PER_CHUNK = 500


class RecordedSamples(NamedTuple):
    """The samples (n,) of a run: time since the one before, rate, force, field, airspeed (NaN where there is none)."""

    dt: F1
    gyr: F2
    acc: F2
    mag: F2
    air: F1


class BlockEnds(NamedTuple):
    """Written at the end of each block (m); block 0 is the end of the alignment. Matrices are flat, row by row.

    ``end`` (m,) sample numbers, ``nominal`` (m, N - 3) the error's states but attitude, ``sums`` (m, RECORDED) of the
    block, its excess and D, ``before`` and ``after`` (m, N * N) the covariance, ``error`` (m, N) what was corrected.
    """

    end: IOut1
    nominal: Out2
    sums: Out2
    before: Out2
    after: Out2
    error: Out2


@dataclass(slots=True)
class ForwardRecord:
    """A forward run: ``q`` (n, 4) before the correction at a block's end, its blocks, and the state at the end."""

    q: Array
    blocks: BlockEnds
    state: Array


class Blocks(NamedTuple):
    """Blocks (m) for the way back: gains C from each to the one before, covariance before it and after the one before.

    ``error`` (m, N) what was corrected, ``nominal`` (m, N - 3) the states after it; ``reach_before`` (m, 3 N) D of the
    block, ``reach_after`` of the one before it.
    """

    gains: F2
    before: F2
    after: F2
    error: F2
    nominal: F2
    reach_before: F2
    reach_after: F2


class Corrections(NamedTuple):
    """Smoothed blocks (m): attitude corrections at begin and end (m, 3), states (m, N - 3) and variances at the end.

    Variances, and ``considered``, the squares of D, are those of tilt and heading.
    """

    at_begin: Out2
    at_end: Out2
    states: Out2
    variance: Out2
    considered: Out2


@jit.loop("the inertial smoother, forward")
def record(state: Out1, params: F1, data: RecordedSamples, keep: bool, q: Out2, out: BlockEnds) -> int:
    """Run the filter and record each block; return how many. Without ``keep`` each overwrites the one before."""
    count = 0
    row = 0
    for k in range(len(data.dt)):
        h = data.dt[k]
        ends = False
        at = S.attitude
        if h > 0.0:
            look_for_rest(state, params, h, data.gyr[k], data.acc[k])
            take_force(state, h, data.gyr[k], data.acc[k], data.air[k])
            force = state[S.force :]
            if state[S.stage] == ALIGNING:
                align(state, params, h, data.gyr[k], force, data.mag[k])
                ends = state[S.stage] != ALIGNING
                at = 0
            else:
                sample(state, h, data.gyr[k], force, data.mag[k])
                ends = state[S.seconds] >= params[K.block] - 0.25 * h
        for j in range(4):
            q[k, j] = state[at + j]
        if ends:
            if count > 0:
                for j in range(SUM_COLUMNS):
                    out.sums[row, j] = state[S.seconds + j]
                predict(state, params)
                for j in range(3 * N):
                    out.sums[row, BEFORE + j] = state[S.reach + j]
                for j in range(N * N):
                    out.before[row, j] = state[S.P + j]
                correct(state, params)
                for j in range(N):
                    out.error[row, j] = state[S.x + j]
                finish(state, params)
            out.sums[row, SUM_COLUMNS] = state[S.excess]
            out.sums[row, SUM_COLUMNS + 1] = state[S.heading_doubt]
            for j in range(3 * N):
                out.sums[row, AFTER + j] = state[S.reach + j]
            for j in range(N * N):
                out.after[row, j] = state[S.P + j]
            for j in range(3):
                out.nominal[row, j] = state[S.bias + j]
            for j in range(N - 6):
                out.nominal[row, 3 + j] = state[S.M + j]
            out.end[row] = k
            count += 1
            row = count if keep else 0
    return count


def composed(a: Any, b: Any, out: Any) -> None:
    """Write the rotation vector of exp(a) exp(b) to ``out`` (3,)."""
    a0, a1, a2, a3 = exponential(a[0], a[1], a[2])
    b0, b1, b2, b3 = exponential(b[0], b[1], b[2])
    w, x, y, z = multiplied(a0, a1, a2, a3, b0, b1, b2, b3)
    s = math.sqrt(x * x + y * y + z * z)
    k = 2.0 * math.atan2(s, abs(w)) / s if s > 1e-12 else 2.0
    k = -k if w < 0.0 else k
    out[0], out[1], out[2] = k * x, k * y, k * z


def add_row(out: Any, i: int, factor: float, x: Any, j: int) -> None:
    """Add ``factor`` times row ``j`` of ``x`` to row ``i`` of ``out``, matrices (N * N,) row by row."""
    for m in range(N):
        out[i * N + m] += factor * x[j * N + m]


def transform(G: Any, D: Any, add: Any, half: Any, turned: Any) -> None:
    """Compute ``D`` <- add + G D G^T, all (N * N,) row by row; ``half`` and ``turned`` are scratch."""
    for i in range(N):
        for k in range(N):
            turned[k * N + i] = G[i * N + k]
            half[i * N + k] = 0.0
    for i in range(N):
        for k in range(N):
            add_row(half, i, G[i * N + k], D, k)
    for i in range(N * N):
        D[i] = add[i]
    for i in range(N):
        for k in range(N):
            add_row(D, i, half[i * N + k], turned, k)


@jit.loop("the inertial smoother, backward")
def recursion(
    blocks: Blocks,
    out: Corrections,
    dx: Out1,
    covariance: Out1,
    reach: Out1,
    half: Out1,
    turned: Out1,
    delta: Out1,
    gap: Out1,
) -> None:
    """Go back through the blocks: ``dx`` (N,), ``covariance`` (N * N,) and ``reach`` (3 * N,) are carried on in place.

    D is carried back like an error. Scratch: ``half``, ``turned`` (N * N,), ``delta``, ``gap`` (N,).
    """
    for k in range(len(blocks.gains) - 1, -1, -1):
        for i in range(N - 3):
            out.states[k, i] = blocks.nominal[k, i] + dx[3 + i]
        out.variance[k, 0] = covariance[0] + covariance[N + 1]
        out.variance[k, 1] = covariance[2 * N + 2]
        composed(dx, blocks.error[k], delta)
        for i in range(3, N):
            delta[i] = dx[i] + blocks.error[k, i]
        for i in range(3):
            out.at_end[k, i] = delta[i]
        for i in range(N):
            total = 0.0
            for j in range(N):
                total += blocks.gains[k, i * N + j] * delta[j]
            dx[i] = total
        for i in range(3):
            out.at_begin[k, i] = dx[i]
        for i in range(N * N):
            covariance[i] -= blocks.before[k, i]
        transform(blocks.gains[k], covariance, blocks.after[k], half, turned)
        out.considered[k, 0] = 0.0
        out.considered[k, 1] = 0.0
        for c in range(3):
            at = c * N
            out.considered[k, 0] += reach[at] * reach[at] + reach[at + 1] * reach[at + 1]
            out.considered[k, 1] += reach[at + 2] * reach[at + 2]
            for i in range(N):
                gap[i] = reach[at + i] - blocks.reach_before[k, at + i]
            for i in range(N):
                total = blocks.reach_after[k, at + i]
                for j in range(N):
                    total += blocks.gains[k, i * N + j] * gap[j]
                reach[at + i] = total


def smooth(
    t: Array,
    gyr: Array,
    acc: Array,
    mag: Array | None = None,
    params: Mapping[str, float | str] | None = None,
    airspeed: Measurements | None = None,
) -> Estimate:
    """Smooth the attitude (body FRD to earth NED, magnetic north) at ``t`` (n,) s of one segment without gaps.

    ``gyr`` (n, 3) rad/s over the time since the sample before, ``acc`` (n, 3) m/s^2 specific force, ``mag`` (n, 3)
    any unit, NaN or zero rows where there is no sample; true ``airspeed`` in m/s. ``params`` override
    ``mekf@smoother``. ``bias`` (n, 3) [rad/s]; ``aux["sigma_tilt"]``, ``aux["sigma_heading"]`` (n,) [rad];
    ``quality`` names the aids and what was found of the magnetometer. Without magnetometer heading begins at 0, and
    its sigma is that of the gyro's drift since then.
    """
    clock = time.thread_time()
    mag = np.zeros_like(gyr) if mag is None else np.where(np.isfinite(mag).all(axis=1, keepdims=True), mag, 0.0)
    dt = np.diff(t, prepend=t[:1])
    fields = np.flatnonzero(mag.any(axis=1))
    # The backward pass wants one frame: it begins where the first field arrives.
    begin = max(int(fields[0]) - 1, 0) if len(fields) else 0
    values = mekf_values(params or {}, float(t[-1] - t[begin]) if len(t) else 0.0)
    air = at_samples(t, airspeed)
    data = [np.ascontiguousarray(x[begin:], np.float64) for x in (dt, gyr, acc, mag, air)]
    data[0][:1] = 0.0
    run = forward(data, values, None, keep=False)
    if len(run.blocks.end) == 0:
        return short(t, run, begin, clock)
    expected = values[K.acc_bias_sigma]
    for later in range(ROUNDS):
        values[K.acc_bias_sigma] = acc_bias_spread(run, expected)
        run = forward(data, values, run.state, keep=later == ROUNDS - 1)
    back = backward(run, values)
    q, bias = between(run, back, dt, gyr, begin)
    block = np.clip(np.searchsorted(begin + run.blocks.end, np.arange(len(t))), 0, len(run.blocks.end) - 1)
    late = LATE_S**2 * np.sum(gyr**2, axis=1)
    tilt, heading = own_sigmas(run, back, values)
    tilt = np.sqrt(tilt[block] ** 2 + MIN_TILT_SIGMA**2 + late)
    heading = heading if len(fields) else np.sqrt(np.abs(heading**2 - heading[0] ** 2))
    heading = np.sqrt(heading[block] ** 2 + late)
    if len(fields) == 0:
        q = rotation.turn_about_down(q, -rotation.to_euler(q[0])[2])
    aids = [*["mag"] * (len(fields) > 0), *["airspeed"] * bool(np.any(air >= FULL_AIRSPEED)), "rest"]
    return Estimate(
        t=t,
        q=q,
        bias=bias,
        aux={"sigma_tilt": tilt, "sigma_heading": heading},
        quality=quality(run, aids, tilt, heading),
        ns_per_update=1e9 * (time.thread_time() - clock) / max(len(t), 1),
        causal=False,
    )


def at_samples(t: Array, airspeed: Measurements | None) -> Array:
    """Return airspeed (n,) m/s at the first sample from its own time on, NaN between."""
    placed = np.full(len(t), np.nan)
    if airspeed is not None:
        at = np.searchsorted(t, airspeed.t)
        inside = at < len(t)
        placed[at[inside]] = airspeed.x[inside]
    return placed


def mekf_values(params: Mapping[str, float | str], seconds: float) -> Array:
    """Return the filter's parameters for a recording of that length, without ``lead``."""
    known = {p.name: p for p in mekf.PARAMETERS}
    given = {k: v for k, v in params.items() if k in known}
    chosen = {k: p.default for k, p in known.items()} | dict(mekf.PRESETS[PRESET]) | given
    values = np.array([known[k].code(v) for k, v in chosen.items()])
    values[K.block] = max(values[K.block], seconds / MAX_BLOCKS)
    values[K.lead] = 0.0
    return values


def acc_bias_spread(run: ForwardRecord, expected: float) -> float:
    """Return the prior sigma [m/s^2] that explains the accelerometer bias found.

    The expected one counts as one more axis.

    sigma^2 = (sum of ba_i^2 + P_ii over the axes + expected^2) / 4: a step of expectation maximisation. A calibrated
    sensor keeps a tight prior, a raw one (EuRoC: 0.1 m/s^2) gets the room it needs.
    """
    found = run.state[S.ba : S.ba + 3] ** 2 + np.diag(run.blocks.after[-1].reshape(N, N))[E.ba : E.v]
    return min(float(np.sqrt((found.sum() + expected**2) / 4.0)), max(mekf.MAX_ACC_BIAS_SIGMA, expected))


def forward(data: list[Array], values: Array, known: Array | None, keep: bool = True) -> ForwardRecord:
    """Run the filter over samples (dt, gyr, acc, mag, airspeed); ``known`` is the last state of an earlier run.

    Without ``keep`` there is a record of the last block alone.
    """
    dt = data[0]
    n, blocks = len(dt), int(np.sum(dt) / (0.75 * values[K.block])) + 3
    blocks = min(blocks, n + 1) if keep else 1
    state = mekf.start(values, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    # The rounds look for the prior of the accelerometer bias; within a run it is fixed.
    state[S.expect_time] = -np.inf
    if known is not None and known[S.unit] > 0.0:
        state[S.cal : S.cal + 3] = known[S.cal : S.cal + 3]
        state[S.cal + 6] = known[S.cal + 6]
        state[S.unit] = known[S.unit]
        p = state[S.cal_P : S.unit].reshape(7, 7)
        p[range(6), range(6)] = np.repeat([0.01, values[K.offset_sigma] ** 2], 3)
        p[6, 6] = known[S.unit - 1]
    q, end = np.empty((n, 4)), np.zeros(blocks, np.int64)
    shapes = (N - 3, RECORDED, N * N, N * N, N)
    kept = [np.zeros((blocks, k)) for k in shapes]
    count = record(state, values, RecordedSamples(*data), keep, q, BlockEnds(end, *kept)) if n else 0
    count = count if keep else min(count, 1)
    return ForwardRecord(q, BlockEnds(end[:count], *(x[:count] for x in kept)), state)


def transitions(sums: Array, values: Array) -> Array:
    """Return F (m, N, N) of blocks with these sums."""
    f = np.tile(np.eye(N), (len(sums), 1, 1))
    duration, a, turned = sums[:, 0], sums[:, 1:10].reshape(-1, 3, 3), sums[:, 40]
    f[:, 0:3, E.bias : E.bias + 3] -= a
    f[:, 0:3, E.M : E.M + 9] += sums[:, 10:37].reshape(-1, 3, 9)
    f[:, E.v, 1] += sums[:, 39]
    f[:, E.v + 1, 0] -= sums[:, 39]
    f[:, E.v : E.d, E.M + 9 : E.M + 12] -= a[:, :2]
    with np.errstate(invalid="ignore", divide="ignore"):
        moving = np.minimum(1.0, np.sqrt(turned / duration) / MOVING_RATE)
    f[:, E.d, E.d] = np.exp(-duration * moving / values[K.field_time])
    return f


def gains(run: ForwardRecord, values: Array, a: int, b: int) -> Array:
    """Return C of (1) for the steps from blocks a..b-1 back to a-1..b-2; states that are known exactly stay."""
    f = transitions(run.blocks.sums[a:b], values)
    p, after = (x.reshape(-1, N, N) for x in (run.blocks.before[a:b], run.blocks.after[a - 1 : b - 1]))
    size = np.sqrt(np.einsum("kii->ki", p))
    none = size == 0.0
    inverse = np.where(none, 0.0, 1.0 / np.where(none, 1.0, size))
    scaled = p * inverse[:, :, None] * inverse[:, None, :]
    scaled[:, range(N), range(N)] += 1e-10 + none
    right = inverse[:, :, None] * (f @ after)
    return np.ascontiguousarray(np.swapaxes(inverse[:, :, None] * np.linalg.solve(scaled, right), 1, 2))


def backward(run: ForwardRecord, values: Array) -> Corrections:
    """Go back from the last block to the first (1, 2)."""
    ends = run.blocks
    m = len(ends.end)
    out = Corrections(np.zeros((m, 3)), np.zeros((m, 3)), np.empty((m, N - 3)), np.empty((m, 2)), np.empty((m, 2)))
    dx, covariance = np.zeros(N), ends.after[-1].copy()
    reach_before, reach_after = (np.ascontiguousarray(ends.sums[:, k : k + 3 * N]) for k in (BEFORE, AFTER))
    reach = reach_after[-1].copy()
    scratch = aligned_zeros(N * N), aligned_zeros(N * N), aligned_zeros(N), aligned_zeros(N)
    for b in range(m, 1, -BLOCKS_PER_CHUNK):
        a = max(b - BLOCKS_PER_CHUNK, 1)
        own, earlier = slice(a, b), slice(a - 1, b - 1)
        found = gains(run, values, a, b).reshape(-1, N * N)
        blocks = Blocks(
            found,
            ends.before[own],
            ends.after[earlier],
            ends.error[own],
            ends.nominal[own],
            reach_before[own],
            reach_after[earlier],
        )
        recursion(blocks, Corrections(*(x[own] for x in out)), dx, covariance, reach, *scratch)
    out.states[0] = ends.nominal[0] + dx[3:]
    out.variance[0] = covariance[0] + covariance[N + 1], covariance[2 * N + 2]
    out.considered[0] = np.sum(reach.reshape(3, N)[:, :2] ** 2), np.sum(reach.reshape(3, N)[:, 2] ** 2)
    out.at_end[0] = out.at_begin[0] = dx[:3]
    return out


def own_sigmas(run: ForwardRecord, back: Corrections, values: Array) -> tuple[Array, Array]:
    """Return the sigmas (m,) of tilt and heading in rad at the blocks' ends, excess and doubt included."""
    sums = run.blocks.sums
    # A running mean of that length is that much late.
    centred = np.minimum(np.arange(len(sums)) + int(EXCESS_TIME / values[K.block]), len(sums) - 1)
    excess = np.maximum(sums[centred, SUM_COLUMNS], 1.0)
    bias = values[K.acc_bias_considered] ** 2 * back.considered
    # Smoothed, every field counts at every time.
    doubt = float(np.mean(sums[:, SUM_COLUMNS + 1]))
    tilt, heading = np.sqrt(np.maximum(back.variance, 0.0)).T
    return np.sqrt(excess * tilt**2 + bias[:, 0]), np.sqrt(heading**2 + bias[:, 1] + doubt)


def between(run: ForwardRecord, back: Corrections, dt: Array, gyr: Array, begin: int) -> tuple[Array, Array]:
    """Return attitude (n, 4) and gyro bias (n, 3) at every sample; ``begin``: the sample where the run began."""
    end = begin + run.blocks.end
    n, m = len(gyr), len(end)
    at = np.arange(begin, n)
    block = np.searchsorted(end, at)
    inside = np.minimum(block, m - 1)
    since = np.cumsum(dt)
    ends = since[end]
    previous = np.maximum(inside - 1, 0)
    length = np.where(inside > 0, ends[inside] - ends[previous], 1.0)
    share = np.clip((since[at] - ends[previous]) / length, 0.0, 1.0)[:, None]
    turn = (1.0 - share) * back.at_begin[inside] + share * back.at_end[inside]
    # After the last block's end the filter's own state goes on, already corrected there.
    turn[block >= m] = 0.0
    q = np.empty((n, 4))
    q[begin:] = rotation.multiply(rotation.from_rotvec(turn), run.q)
    bias = back.states[np.clip(np.searchsorted(end, np.arange(n)), 0, m - 1), :3]
    first = int(end[0])
    matrix = np.eye(3) + back.states[0, 3:12].reshape(3, 3)
    turns = -dt[first::-1, None] * ((gyr[first::-1] - back.states[0, :3]) @ matrix.T)
    q[:first] = rotation.multiply(q[first], chained(np.roll(turns, 1, axis=0)))[:0:-1]
    return q, bias


def quality(run: ForwardRecord, aids: list[str], tilt: Array, heading: Array) -> dict[str, float | str]:
    """Return quality numbers of a run with its ``aids``; ``tilt``, ``heading`` (n,) are its own sigmas in rad."""
    found: dict[str, float | str] = {
        "aided_by": " ".join(aids),
        "sigma_tilt_deg": float(np.degrees(np.sqrt(np.mean(tilt**2)))),
        "sigma_heading_deg": float(np.degrees(np.sqrt(np.mean(heading**2)))),
    }
    if "mag" in aids:
        found["mag_delay_ms"] = float(1e3 * run.state[S.cal + 6])
        found["mag_offset_pct"] = float(100.0 * np.linalg.norm(run.state[S.cal + 3 : S.cal + 6]))
    return found


def short(t: Array, run: ForwardRecord, begin: int, clock: float) -> Estimate:
    """Return the running solution of a recording that ends within the alignment, held before sample ``begin``."""
    q = np.vstack([np.tile(run.q[:1], (begin, 1)), run.q]) if len(run.q) else np.empty((0, 4))
    tilt, heading = (np.full(len(t), sigma) for sigma in run.state[S.sigma_tilt : S.attitude])
    return Estimate(
        t=t,
        q=q,
        bias=np.zeros((len(t), 3)),
        aux={"sigma_tilt": tilt, "sigma_heading": heading},
        quality=quality(run, ["rest"], tilt, heading) if len(t) else {},
        ns_per_update=1e9 * (time.thread_time() - clock) / max(len(t), 1),
        causal=False,
    )
