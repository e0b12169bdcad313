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

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, IOut1, Out1, Out2, aligned_zeros
from attlog.estimators.aids import SURE, Measurements
from attlog.estimators.filters import mekf
from attlog.estimators.filters.inertial.compass import EXCESS_TIME
from attlog.estimators.filters.inertial.recursion import (
    ACC_BIAS_CONSIDERED,
    ACC_BIAS_SIGMA,
    ALIGNING,
    BA,
    BIAS,
    BLOCK,
    CAL,
    CAL_P,
    DB,
    DBA,
    DD,
    DM,
    DV,
    END,
    EXCESS,
    EXPECT_TIME,
    FIELD_TIME,
    HEADING_DOUBT,
    LEAD,
    MOVING_RATE,
    OFFSET_SIGMA,
    REACH,
    SIGMA,
    STAGE,
    UNIT,
    Blocks,
    Corrections,
    F,
    M,
    N,
    P,
    Q,
    T,
    X,
    recursion,
)
from attlog.estimators.filters.inertial.start import align, look_for_rest
from attlog.estimators.filters.mekf import correct, finish, predict, sample, take_force
from attlog.estimators.filters.navigation.start import chained
from attlog.estimators.interface import Array, Estimate

PRESET = "smoother"
ROUNDS = 3
# Longer recordings get longer blocks: what has to be kept of one is 7.5 kB.
MOST_BLOCKS = 20_000
LEAST_TILT = np.deg2rad(0.3)
# What the model does not know of a smoothed tilt: the accelerometer's scale (0.5 % of g), and the time of a sample.
LATE_S = 0.002
SUMS = 41
# After the sums of a block: excess and doubt of doubt.py, then its D (3 N) before and after what was measured.
BEFORE, AFTER = SUMS + 2, SUMS + 2 + 3 * N
RECORDED = SUMS + 2 + 6 * N
CHUNK = 500


class RecordedSamples(NamedTuple):
    """The samples (n,) of a run: time since the one before, rate, force, field, airspeed (NaN where there is none)."""

    dt: F1
    gyr: F2
    acc: F2
    mag: F2
    air: F1


class BlockEnds(NamedTuple):
    """Written at the end of each block (m): see :class:`ForwardRecord`; matrices row by row."""

    end: IOut1
    nominal: Out2
    sums: Out2
    before: Out2
    after: Out2
    error: Out2


@jit.loop("the inertial smoother, forward")
def record(state: Out1, params: F1, data: RecordedSamples, keep: bool, q: Out2, out: BlockEnds) -> int:
    """Run the filter and record each block; return how many. Without ``keep`` each overwrites the one before."""
    count = 0
    row = 0
    for k in range(len(data.dt)):
        h = data.dt[k]
        ends = False
        at = Q
        if h > 0.0:
            look_for_rest(state, params, h, data.gyr[k], data.acc[k])
            take_force(state, h, data.gyr[k], data.acc[k], data.air[k])
            force = state[F:END]
            if state[STAGE] == ALIGNING:
                align(state, params, h, data.gyr[k], force, data.mag[k])
                ends = state[STAGE] != ALIGNING
                at = 0
            else:
                sample(state, h, data.gyr[k], force, data.mag[k])
                ends = state[T] >= params[BLOCK] - 0.25 * h
        for j in range(4):
            q[k, j] = state[at + j]
        if ends:
            if count > 0:
                for j in range(SUMS):
                    out.sums[row, j] = state[T + j]
                predict(state, params)
                for j in range(3 * N):
                    out.sums[row, BEFORE + j] = state[REACH + j]
                for j in range(N * N):
                    out.before[row, j] = state[P + j]
                correct(state, params)
                for j in range(N):
                    out.error[row, j] = state[X + j]
                finish(state, params)
            out.sums[row, SUMS] = state[EXCESS]
            out.sums[row, SUMS + 1] = state[HEADING_DOUBT]
            for j in range(3 * N):
                out.sums[row, AFTER + j] = state[REACH + j]
            for j in range(N * N):
                out.after[row, j] = state[P + j]
            for j in range(3):
                out.nominal[row, j] = state[BIAS + j]
            for j in range(N - 6):
                out.nominal[row, 3 + j] = state[M + j]
            out.end[row] = k
            count += 1
            row = count if keep else 0
    return count


@dataclass(slots=True)
class ForwardRecord:
    """What the forward run leaves, per sample (n) and per block end (m); block 0 is the end of the alignment.

    ``q`` (n, 4) before the correction at a block's end, ``end`` (m,) sample numbers, ``nominal`` (m, N - 3) the error's
    other states after it, ``sums`` (m, RECORDED) of the block, its excess and D, ``before`` and ``after`` (m, N, N)
    the covariance, ``error`` (m, N) what was corrected, ``state`` at the end.
    """

    q: Array
    end: NDArray[np.int64]
    nominal: Array
    sums: Array
    before: Array
    after: Array
    error: Array
    state: Array


@dataclass(slots=True)
class BackwardPass:
    """Per block end (m): ``at_begin`` and ``at_end`` (m, 3) attitude corrections of the block, ``states`` (m, N - 3)
    smoothed, ``tilt`` and ``heading`` (m,) sigma in rad of the model, ``considered`` (m, 2) squares of D for both."""

    at_begin: Array
    at_end: Array
    states: Array
    tilt: Array
    heading: Array
    considered: Array


def smooth(
    t: Array,
    gyr: Array,
    acc: Array,
    mag: Array | None = None,
    params: Mapping[str, float | str] | None = None,
    airspeed: Measurements | None = None,
) -> Estimate:
    """Smoothed attitude (body FRD to earth NED, magnetic north) at ``t`` (n,) s of one segment without gaps.

    ``gyr`` (n, 3) rad/s over the time since the sample before, ``acc`` (n, 3) m/s^2 specific force, ``mag`` (n, 3)
    any unit, NaN or zero rows where there is no sample; true ``airspeed`` in m/s. ``params`` override
    ``mekf@smoother``. ``bias`` (n, 3) [rad/s]; ``aux["sigma_tilt"]``, ``aux["sigma_heading"]`` (n,) [rad];
    ``quality`` says what it was aided by and what it found of the magnetometer. Without magnetometer heading begins
    at 0, and its sigma is that of the gyro's drift since then.
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
    if len(run.end) == 0:
        return short(t, run, begin, clock)
    expected = values[ACC_BIAS_SIGMA]
    for later in range(ROUNDS):
        values[ACC_BIAS_SIGMA] = acc_bias_spread(run, expected)
        run = forward(data, values, run.state, keep=later == ROUNDS - 1)
    back = backward(run, values)
    q, bias = between(run, back, dt, gyr, begin)
    block = np.clip(np.searchsorted(begin + run.end, np.arange(len(t))), 0, len(run.end) - 1)
    late = LATE_S**2 * np.sum(gyr**2, axis=1)
    tilt, heading = own_sigmas(run, back, values)
    tilt = np.sqrt(tilt[block] ** 2 + LEAST_TILT**2 + late)
    heading = heading if len(fields) else np.sqrt(np.abs(heading**2 - heading[0] ** 2))
    heading = np.sqrt(heading[block] ** 2 + late)
    if len(fields) == 0:
        q = rotation.turn_about_down(q, -rotation.to_euler(q[0])[2])
    aids = [*["mag"] * (len(fields) > 0), *["airspeed"] * bool(np.any(air >= SURE)), "rest"]
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
    """Airspeed (n,) m/s at the first sample from its own time on, NaN where nothing new came."""
    placed = np.full(len(t), np.nan)
    if airspeed is not None:
        at = np.searchsorted(t, airspeed.t)
        inside = at < len(t)
        placed[at[inside]] = airspeed.x[inside]
    return placed


def mekf_values(params: Mapping[str, float | str], seconds: float) -> Array:
    """The filter's parameters for a recording of that length; nothing is turned on in time."""
    known = {p.name: p for p in mekf.PARAMETERS}
    given = {k: v for k, v in params.items() if k in known}
    chosen = {k: p.default for k, p in known.items()} | dict(mekf.PRESETS[PRESET]) | given
    values = np.array([known[k].code(v) for k, v in chosen.items()])
    values[BLOCK] = max(values[BLOCK], seconds / MOST_BLOCKS)
    values[LEAD] = 0.0
    return values


def acc_bias_spread(run: ForwardRecord, expected: float) -> float:
    """The prior sigma [m/s^2] that explains the accelerometer bias found, the expected one counting as one more axis.

    sigma^2 = (sum of ba_i^2 + P_ii over the axes + expected^2) / 4: a step of expectation maximisation. A calibrated
    sensor keeps a tight prior, a raw one (EuRoC: 0.1 m/s^2) gets the room it needs.
    """
    found = run.state[BA : BA + 3] ** 2 + np.diag(run.after[-1])[DBA:DV]
    return min(float(np.sqrt((found.sum() + expected**2) / 4.0)), max(mekf.WIDEST_BIAS, expected))


def forward(data: list[Array], values: Array, known: Array | None, keep: bool = True) -> ForwardRecord:
    """The filter over samples (dt, gyr, acc, mag, airspeed), recorded; ``known`` is the last state of an earlier run.

    Without ``keep`` there is a record of the last block alone.
    """
    dt = data[0]
    n, blocks = len(dt), int(np.sum(dt) / (0.75 * values[BLOCK])) + 3
    blocks = min(blocks, n + 1) if keep else 1
    state = mekf.start(values, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    # The rounds look for the prior of the accelerometer bias; within a run it stands.
    state[EXPECT_TIME] = -np.inf
    if known is not None and known[UNIT] > 0.0:
        state[CAL : CAL + 3] = known[CAL : CAL + 3]
        state[CAL + 6] = known[CAL + 6]
        state[UNIT] = known[UNIT]
        p = state[CAL_P:UNIT].reshape(7, 7)
        p[range(6), range(6)] = np.repeat([0.01, values[OFFSET_SIGMA] ** 2], 3)
        p[6, 6] = known[UNIT - 1]
    q, end = np.empty((n, 4)), np.zeros(blocks, np.int64)
    shapes = (N - 3, RECORDED, N * N, N * N, N)
    kept = [np.zeros((blocks, k)) for k in shapes]
    count = record(state, values, RecordedSamples(*data), keep, q, BlockEnds(end, *kept)) if n else 0
    count = count if keep else min(count, 1)
    nominal, sums, before, after, error = (x[:count] for x in kept)
    return ForwardRecord(q, end[:count], nominal, sums, before.reshape(-1, N, N), after.reshape(-1, N, N), error, state)


def transitions(sums: Array, values: Array) -> Array:
    """F (m, N, N) of blocks with these sums."""
    f = np.tile(np.eye(N), (len(sums), 1, 1))
    duration, a, turned = sums[:, 0], sums[:, 1:10].reshape(-1, 3, 3), sums[:, 40]
    f[:, 0:3, DB : DB + 3] -= a
    f[:, 0:3, DM : DM + 9] += sums[:, 10:37].reshape(-1, 3, 9)
    f[:, DV, 1] += sums[:, 39]
    f[:, DV + 1, 0] -= sums[:, 39]
    f[:, DV:DD, DM + 9 : DM + 12] -= a[:, :2]
    with np.errstate(invalid="ignore", divide="ignore"):
        moving = np.minimum(1.0, np.sqrt(turned / duration) / MOVING_RATE)
    f[:, DD, DD] = np.exp(-duration * moving / values[FIELD_TIME])
    return f


def gains(run: ForwardRecord, values: Array, a: int, b: int) -> Array:
    """C of (1) for the steps from blocks a..b-1 back to a-1..b-2; states that are known exactly stay."""
    f = transitions(run.sums[a:b], values)
    p, after = run.before[a:b], run.after[a - 1 : b - 1]
    size = np.sqrt(np.einsum("kii->ki", p))
    none = size == 0.0
    inverse = np.where(none, 0.0, 1.0 / np.where(none, 1.0, size))
    scaled = p * inverse[:, :, None] * inverse[:, None, :]
    scaled[:, range(N), range(N)] += 1e-10 + none
    right = inverse[:, :, None] * (f @ after)
    return np.ascontiguousarray(np.swapaxes(inverse[:, :, None] * np.linalg.solve(scaled, right), 1, 2))


def backward(run: ForwardRecord, values: Array) -> BackwardPass:
    """The pass from the last block to the first (1, 2)."""
    m = len(run.end)
    at_begin, at_end = np.zeros((m, 3)), np.zeros((m, 3))
    states, variance = np.empty((m, N - 3)), np.empty((m, 2))
    dx, covariance = np.zeros(N), run.after[-1].ravel().copy()
    reach_before, reach_after = (np.ascontiguousarray(run.sums[:, k : k + 3 * N]) for k in (BEFORE, AFTER))
    reach, considered = reach_after[-1].copy(), np.empty((m, 2))
    before, after = run.before.reshape(m, N * N), run.after.reshape(m, N * N)
    scratch = aligned_zeros(N * N), aligned_zeros(N * N), aligned_zeros(N), aligned_zeros(N)
    for b in range(m, 1, -CHUNK):
        a = max(b - CHUNK, 1)
        own = slice(a, b)
        found = gains(run, values, a, b).reshape(-1, N * N)
        blocks = Blocks(found, before[own], after[a - 1 : b - 1], run.error[own], run.nominal[own])
        written = Corrections(at_begin[own], at_end[own], states[own], variance[own], considered[own])
        recursion(blocks, written, dx, covariance, reach_before[own], reach_after[a - 1 : b - 1], reach, *scratch)
    states[0] = run.nominal[0] + dx[3:]
    variance[0] = covariance[0] + covariance[N + 1], covariance[2 * N + 2]
    considered[0] = np.sum(reach.reshape(3, N)[:, :2] ** 2), np.sum(reach.reshape(3, N)[:, 2] ** 2)
    at_end[0] = at_begin[0] = dx[:3]
    tilt, heading = np.sqrt(np.maximum(variance, 0.0)).T
    return BackwardPass(at_begin, at_end, states, tilt, heading, considered)


def own_sigmas(run: ForwardRecord, back: BackwardPass, values: Array) -> tuple[Array, Array]:
    """Sigmas (m,) of tilt and heading in rad at the blocks' ends, with what ``doubt.py`` adds."""
    # A running mean of that length is that much late.
    m = len(run.end)
    centred = np.minimum(np.arange(m) + int(EXCESS_TIME / values[BLOCK]), m - 1)
    excess = np.maximum(run.sums[centred, SUMS], 1.0)
    bias = values[ACC_BIAS_CONSIDERED] ** 2 * back.considered
    # Smoothed, every field has its say at every time.
    doubt = float(np.mean(run.sums[:, SUMS + 1]))
    return np.sqrt(excess * back.tilt**2 + bias[:, 0]), np.sqrt(back.heading**2 + bias[:, 1] + doubt)


def between(run: ForwardRecord, back: BackwardPass, dt: Array, gyr: Array, begin: int) -> tuple[Array, Array]:
    """Attitude (n, 4) and gyro bias (n, 3) at every sample; ``begin``: the sample where the run began."""
    n, m = len(gyr), len(run.end)
    at = np.arange(begin, n)
    block = np.searchsorted(begin + run.end, at)
    inside = np.minimum(block, m - 1)
    since = np.cumsum(dt)
    ends = since[begin + run.end]
    previous = np.maximum(inside - 1, 0)
    length = np.where(inside > 0, ends[inside] - ends[previous], 1.0)
    share = np.clip((since[at] - ends[previous]) / length, 0.0, 1.0)[:, None]
    turn = (1.0 - share) * back.at_begin[inside] + share * back.at_end[inside]
    # After the last block's end the filter's own state goes on, already corrected there.
    turn[block >= m] = 0.0
    q = np.empty((n, 4))
    q[begin:] = rotation.multiply(rotation.from_rotvec(turn), run.q)
    bias = back.states[np.clip(np.searchsorted(begin + run.end, np.arange(n)), 0, m - 1), :3]
    first = begin + int(run.end[0])
    matrix = np.eye(3) + back.states[0, 3:12].reshape(3, 3)
    turns = -dt[first::-1, None] * ((gyr[first::-1] - back.states[0, :3]) @ matrix.T)
    q[:first] = rotation.multiply(q[first], chained(np.roll(turns, 1, axis=0)))[:0:-1]
    return q, bias


def quality(run: ForwardRecord, aids: list[str], tilt: Array, heading: Array) -> dict[str, float | str]:
    """What the run says of itself and its ``aids``; ``tilt``, ``heading`` (n,) its own sigmas in rad."""
    told: dict[str, float | str] = {
        "aided_by": " ".join(aids),
        "sigma_tilt_deg": float(np.degrees(np.sqrt(np.mean(tilt**2)))),
        "sigma_heading_deg": float(np.degrees(np.sqrt(np.mean(heading**2)))),
    }
    if "mag" in aids:
        told["mag_delay_ms"] = float(1e3 * run.state[CAL + 6])
        told["mag_offset_pct"] = float(100.0 * np.linalg.norm(run.state[CAL + 3 : CAL + 6]))
    return told


def short(t: Array, run: ForwardRecord, begin: int, clock: float) -> Estimate:
    """A recording (``t`` (n,) s) that ends within the alignment: its running solution, held before sample ``begin``."""
    q = np.vstack([np.tile(run.q[:1], (begin, 1)), run.q]) if len(run.q) else np.empty((0, 4))
    tilt, heading = (np.full(len(t), sigma) for sigma in run.state[SIGMA : SIGMA + 2])
    return Estimate(
        t=t,
        q=q,
        bias=np.zeros((len(t), 3)),
        aux={"sigma_tilt": tilt, "sigma_heading": heading},
        quality=quality(run, ["rest"], tilt, heading) if len(t) else {},
        ns_per_update=1e9 * (time.thread_time() - clock) / max(len(t), 1),
        causal=False,
    )
