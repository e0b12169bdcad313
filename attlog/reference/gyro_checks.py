"""Checks of the logged gyro against attitude, magnetic field and itself.

Every replay integrates the logged gyro. With wrong units or axes, clipping or another clock it gives wrong attitudes
with a small sigma. Where its rates contradict those of the onboard attitude or truth, the direction of the magnetic
field decides which of the two is right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.kinematics import body_rates
from attlog.core.sorting import is_in, median
from attlog.flight.model import Array, Attitude, Imu, Mag
from attlog.reference.model import GyroJump
from attlog.segments import Segments, model
from attlog.segments.increments import gyro_increments
from attlog.segments.model import interpolate_attitudes

# Standard deviation below which an axis shows no scale.
MIN_RATE_STD_DPS = 3.0
# Standard deviation below which it shows no sign either. A slow axis may be yaw in a hover.
MIN_SIGN_STD_DPS = 0.5
MIN_RATE_INTERVALS = 30  # fewer determine no scale
# Shortest interval of compared rates. Over single samples gyro noise and vibration lower the slope (to 0.92 on a flight
# with equal scales).
SPAN_S = 0.06
# RMS rate above which the gyro turned: a bias alone varies less.
MIN_TURN_STD_DPS = 5.0
# Slower attitudes smear fast motion, so that low slopes do not prove a fault of the sensor.
MIN_ATTITUDE_HZ = 20.0
MIN_CORRELATION = 0.8  # of corresponding axes
# Slopes of attitude rate on gyro rate. Outside the first range the units may differ, outside the second they do.
SLOPES, FAR_SLOPES = (0.8, 1.25), (0.6, 1.6)
# Delays of the attitude in s that are tried where its rates differ.
DELAYS_S = tuple(0.005 * k for k in range(9))
# Longer intervals and larger turns are not compared.
MAX_INTERVAL_S, MAX_TURN_RAD = 1.0, 1.0
BLIND_RATE_RATIO = 1.0 / 3.0  # gyro rate over attitude rate, below which one of both is wrong
MAX_MOUNTING_DEG = 45.0  # larger rotations are swapped axes, no misalignment
# Interval of a field change: longer than noise and delay of the field, short enough for a single turn.
FIELD_STEP_S = 0.3
# Ratio of squared field residuals that decides between two hypotheses.
MIN_MISFIT_RATIO = 3.0
# Smaller RMS residuals of the field's direction are noise.
MIN_FIELD_CHANGE_DEG = 1.5


class GyroMismatch(NamedTuple):
    """Disagreement of gyro and attitude: the wrong one (``of``) and why."""

    of: Literal["gyro", "attitude", ""] = ""
    why: str = ""


def gyro_consistency(imu: Imu, attitude: Attitude, jumps: NDArray[np.int64], mag: Mag | None) -> GyroMismatch:
    """Return which of gyro and attitude is wrong, by their rates.

    ``jumps`` (k,): indices of the attitude's samples after resets. Where the magnetic field does not decide, the gyro
    is rejected if the rates correlate with another scale, axis or sign, as all replays integrate the gyro.
    """
    if len(attitude.t) < 3:
        return GyroMismatch()
    by_gyro, by_attitude = mean_rates(imu, attitude, jumps)
    turning = float(np.degrees(rotation.length(by_gyro.std(axis=0)))) if len(by_gyro) else 0.0
    if turning > MIN_TURN_STD_DPS and np.ptp(attitude.q, axis=0).max() < 1e-9:
        why = f"{attitude.source} never changes while the gyro turns by {turning:.0f} deg/s rms: it holds no attitude"
        return GyroMismatch("attitude", why)
    wrong = rate_mismatch(by_gyro, by_attitude)
    if wrong:
        by_gyro, by_attitude = rates_without_delay(imu, attitude, jumps)
        wrong = rate_mismatch(by_gyro, by_attitude)
    if not wrong:
        return GyroMismatch()
    said = f"the logged gyro ({imu.gyro.source}) and {attitude.source} turn differently: {wrong}"
    right = field_follows(imu, attitude, jumps, mag)
    if right:
        return GyroMismatch(
            "attitude" if right == "gyro" else "gyro", f"{said}; the magnetic field turns as the {right} does"
        )
    if (
        attitude.rate < MIN_ATTITUDE_HZ
        or not rates_correlate(by_gyro, by_attitude)
        or not rate_mismatch(by_gyro, by_attitude, FAR_SLOPES)
    ):
        return GyroMismatch()
    return GyroMismatch("gyro", f"{said}; which is right cannot be determined")


def mean_rates(imu: Imu, attitude: Attitude, jumps: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return mean body rates (n, 3) in rad/s of gyro and attitude.

    Over SPAN_S, or one sample of a slow attitude. Gaps, large turns and samples around ``jumps`` (indices after resets)
    are left out.
    """
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    step = max(1, math.ceil(min(SPAN_S * attitude.rate, len(t) / MIN_RATE_INTERVALS) - 0.01))
    reset = np.zeros(len(t), np.int64)
    reset[np.concatenate([jumps - 1, jumps, jumps + 1]).clip(0, len(t) - 1)] = 1
    rates = body_rates(t, attitude.q, np.cumsum(reset), step, step, MAX_INTERVAL_S)
    gyro = gyro_increments(imu).mean_rates(rates.start, rates.end)
    turned = rates.rate * (rates.end - rates.start)[:, None]
    good = rotation.finite_rows(gyro) & (np.einsum("ni,ni->n", turned, turned) < MAX_TURN_RAD**2)
    return gyro[good], rates.rate[good]


def rates_without_delay(imu: Imu, attitude: Attitude, jumps: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return mean body rates (n, 3) in rad/s of gyro and attitude at the delay where they correlate best.

    A delay d lowers the slope of an oscillation at f Hz to cos(2 pi f d), which is no scale: 15 ms at 10 Hz give 0.6.
    """
    best, score = mean_rates(imu, attitude, jumps), -1.0
    for delay in DELAYS_S:
        sampled = None if attitude.t_sample is None else attitude.t_sample - delay
        by_gyro, by_attitude = mean_rates(imu, replace(attitude, t=attitude.t - delay, t_sample=sampled), jumps)
        if len(by_gyro) < MIN_RATE_INTERVALS:
            continue
        g, a = center_rates(by_gyro), center_rates(by_attitude)
        size = np.sqrt(max(float(np.sum(a * a)) * float(np.sum(g * g)), 1e-30))
        found = float(np.linalg.norm(a.T @ g)) / size
        if found > score:
            best, score = (by_gyro, by_attitude), found
    return best


def rate_mismatch(by_gyro: Array, by_attitude: Array, allowed: tuple[float, float] = SLOPES) -> str:
    """Return how attitude rates differ from gyro rates; empty if consistent.

    Both (n, 3) in rad/s. ``allowed``: range of the slope of attitude on gyro.
    """
    if len(by_gyro) < MIN_RATE_INTERVALS:
        return ""
    g, a = center_rates(by_gyro), center_rates(by_attitude)
    by_the_gyro, by_the_attitude = (np.degrees(x.std(axis=0)) for x in (g, a))
    moving = by_the_gyro >= MIN_RATE_STD_DPS
    axes = (swapped_axes(g, a, moving) if moving.any() else "") or reversed_slowly(g, a, moving)
    if axes:
        return axes.rstrip(".")
    blind = ~moving & (by_the_attitude >= MIN_RATE_STD_DPS) & (by_the_gyro < BLIND_RATE_RATIO * by_the_attitude)
    if blind.any():
        axis = int(np.argmax(np.where(blind, by_the_attitude, 0.0)))
        turns = f"{by_the_attitude[axis]:.1f} deg/s about {'xyz'[axis]} (standard deviation)"
        return f"the attitude turns by {turns}, the gyro by {by_the_gyro[axis]:.1f}"
    g = g @ mounting_rotation(g, a).T
    slopes = np.sum(g * a, axis=0) / np.maximum(np.sum(g * g, axis=0), 1e-30)
    outside = moving & ~((slopes >= allowed[0]) & (slopes <= allowed[1]))
    shown = ", ".join(f"{'xyz'[k]} {slopes[k]:.2f}" for k in np.flatnonzero(outside))
    return f"the attitude turns {shown} times as far" if shown else ""


def center_rates(rates: Array) -> Array:
    """Return rates (n, 3) without their mean."""
    return np.asarray(rates - rates.mean(axis=0))


def mounting_rotation(g: Array, a: Array) -> Array:
    """Return the rotation (3, 3) from gyro to attitude rates (Kabsch1976).

    Identity if it exceeds MAX_MOUNTING_DEG. A misaligned gyro measures the full turn; gravity shows its misalignment.
    """
    turn = rotation.nearest_rotation(a.T @ g)
    near = np.degrees(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))) < MAX_MOUNTING_DEG
    return turn if near else np.eye(3)


def rates_correlate(by_gyro: Array, by_attitude: Array) -> bool:
    """Return whether any attitude axis correlates with any gyro axis.

    Rates (n, 3) over the same intervals, body axes; scale and sign are free.
    """
    g, a = center_rates(by_gyro), center_rates(by_attitude)
    size = np.sqrt(np.outer(np.sum(a * a, axis=0), np.sum(g * g, axis=0)))
    match = np.abs(np.divide(a.T @ g, size, out=np.zeros((3, 3)), where=size > 0))
    return bool(match.max() > MIN_CORRELATION)


def field_follows(
    imu: Imu, attitude: Attitude, jumps: NDArray[np.int64], mag: Mag | None
) -> Literal["gyro", "attitude", ""]:
    """Return which of gyro and attitude the magnetic field confirms, if any.

    By the change of the field's direction over FIELD_STEP_S that remains after derotation. ``jumps`` (k,): indices of
    the attitude after resets.
    """
    if mag is None:
        return ""
    start, end, field, changed = field_changes(mag)
    turning = gyro_increments(imu)
    own = attitude.t if attitude.t_sample is None else attitude.t_sample
    segment = model.merge_numbers(model.number_segments(own), np.cumsum(is_in(np.arange(len(own)), jumps)))
    (before, first), (after, last) = (interpolate_attitudes(own, attitude.q, segment, t) for t in (start, end))
    both = (first >= 0) & (first == last) & turning.known(start, end)
    if np.count_nonzero(both) < MIN_RATE_INTERVALS:
        return ""
    before, after, field, changed = before[both], after[both], field[both], changed[both]
    by_gyro = rotation.from_rotvec(turning.between(start[both], end[both]))
    by_attitude = rotation.multiply(rotation.conjugate(before), after)
    left = [
        float(np.mean(np.sum((rotation.rotate_inverse(turn, field) - changed) ** 2, axis=1)))
        for turn in (by_gyro, by_attitude)
    ]
    if np.degrees(np.sqrt(max(left))) < MIN_FIELD_CHANGE_DEG:
        return ""
    return (
        "attitude" if left[0] > MIN_MISFIT_RATIO * left[1] else "gyro" if left[1] > MIN_MISFIT_RATIO * left[0] else ""
    )


def field_changes(mag: Mag) -> tuple[Array, Array, Array, Array]:
    """Return pairs of times (n,) s and field directions (n, 3).

    Start, end, direction at start, direction at end; about FIELD_STEP_S apart.
    """
    good = rotation.finite_rows(mag.field.x)
    t, field = mag.field.t_best[good], mag.field.x[good]
    size = np.sqrt(np.sum(field**2, axis=1, keepdims=True))
    if len(t) < MIN_RATE_INTERVALS or not (size > 0).all():
        return np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
    field = field / size
    end = np.searchsorted(t, t + FIELD_STEP_S)
    start = np.flatnonzero((end < len(t)) & (np.diff(t, append=t[-1]) < FIELD_STEP_S))
    end = end[start]
    near = t[end] - t[start] < 2.0 * FIELD_STEP_S
    start, end = start[near], end[near]
    return t[start], t[end], field[start], field[end]


def reversed_slowly(g: Array, a: Array, moving: NDArray[np.bool_]) -> str:
    """Return the reversed axes among the slowly turning ones, or empty.

    Rates ``g`` of the gyro and ``a`` of the attitude (n, 3). Without the share of the other two axes (misalignment)
    both are then the same turn of opposite sign, in each half of the log. On 198 attitudes of real and simulated logs
    no axis had a correlation below -0.3.
    """
    found = []
    for k in np.flatnonzero(~moving & (np.degrees(g.std(axis=0)) >= MIN_SIGN_STD_DPS)).tolist():
        others = np.delete(g, k, axis=1)
        x, y = (v - others @ np.linalg.lstsq(others, v, rcond=None)[0] for v in (g[:, k], a[:, k]))
        slope = float(x @ y) / max(float(x @ x), 1e-30)
        halves = (slice(None, len(x) // 2), slice(len(x) // 2, None))
        if (
            SLOPES[0] <= -slope <= SLOPES[1]
            and _correlation(x, y) < -MIN_CORRELATION
            and all(_correlation(x[half], y[half]) < -0.5 for half in halves)
        ):
            found.append("xyz"[k])
    return f"reversed sign about {', '.join(found)}." if found else ""


def _correlation(x: Array, y: Array) -> float:
    return float(x @ y) / max(math.sqrt(float(x @ x) * float(y @ y)), 1e-30)


def swapped_axes(g: Array, a: Array, moving: NDArray[np.bool_]) -> str:
    """Return which axes are swapped or reversed, empty for none.

    Rates ``g`` of the gyro and ``a`` of the attitude (n, 3) in rad/s, body axes; ``moving`` (3,): axes that turned.
    """
    size = np.sqrt(np.outer(np.sum(a * a, axis=0), np.sum(g * g, axis=0)))
    match = np.divide(a.T @ g, size, out=np.zeros((3, 3)), where=size > 0)
    axes = [k for k in range(3) if moving[k]]
    if max(abs(match[k]).max() for k in axes) < MIN_CORRELATION:
        return ""
    best = max(permutations(range(3)), key=lambda p: sum(abs(match[p[k], k]) for k in axes))
    swapped = [k for k in axes if best[k] != k and abs(match[best[k], k]) > MIN_CORRELATION > abs(match[k, k])]
    reversed_ = [k for k in axes if match[best[k], k] < -MIN_CORRELATION]
    parts = []
    if swapped:
        parts.append("the gyro's " + ", ".join(f"{'xyz'[k]} is the attitude's {'xyz'[best[k]]}" for k in swapped))
    if reversed_:
        parts.append("reversed sign about " + ", ".join("xyz"[k] for k in reversed_))
    return "; ".join(parts) + ("." if parts else "")


# Steps of the gyro bias that a smoother finds, against the gyro at rest: an accelerometer that steps feigns them.

# Shortest rest; share of the largest step by which the bias at rest may differ from the sum of the steps.
MIN_REST_S, MAX_STEP_SHARE = 2.0, 0.5


def contradicted_at_rest(imu: Imu, segments: Segments, jumps: Sequence[GyroJump]) -> str:
    """Return why steps of the gyro bias are none by the rests before and after them; empty if nothing shows it."""
    rests = [s for s in segments.of("rest") if s.seconds >= MIN_REST_S]
    before, after = [s for s in rests if jumps and s.t1 <= jumps[0].t], [s for s in rests if s.t0 >= jumps[-1].t]
    if not before or not after:
        return ""
    gyro = gyro_increments(imu)
    spans = np.array([(s.t0, s.t1) for s in (before[-1], after[0])]).clip(gyro.t[0], gyro.t[-1])
    first, last = np.degrees(gyro.mean_rates(*spans.T))
    apart = float(rotation.length(np.sum([jump.size_dps for jump in jumps], axis=0) - (last - first)))
    largest = max(float(np.linalg.norm(jump.size_dps)) for jump in jumps)
    if not apart > MAX_STEP_SHARE * largest:  # NaN across a gap
        return ""
    change = float(rotation.length(last - first))
    return (
        f"its step of the gyro bias by {largest:.1f} deg/s is missing at rest, where the bias changed by "
        f"{change:.2f}: the accelerometer stepped"
    )


# Gyro spikes: single samples far from both neighbours, which no vehicle motion causes.

# Smallest distance of a spike from its neighbours' mean: in medians of all samples, and in deg/s.
MIN_SPIKE_RATIO, MIN_SPIKE_DPS = 20.0, 100.0
# Smallest ratio of that distance to the neighbours' difference; below, the vehicle turned.
MIN_ISOLATION_RATIO = 3.0
# Fewer spikes are not reported: an impact makes one or two.
MIN_SPIKES = 5
# Specific force of an impact, and the time around it in which gyro peaks are real.
IMPACT_M_S2, IMPACT_S = 30.0, 0.02
# Summed turn of spikes above the bias of a calibrated gyro (0.3 deg/s).
MAX_SPIKE_DEG_PER_MIN = 20.0


@dataclass(frozen=True, slots=True)
class GyroSpikes:
    """Single-sample spikes of a gyro.

    ``deg_per_min``: their summed turn; ``t``: time of the first, s; ``why``: the fault, or empty.
    """

    count: int = 0
    deg_per_min: float = 0.0
    t: float | None = None
    why: str = ""

    @property
    def misleads(self) -> bool:
        """True if the spikes turn more than a bias estimate can absorb."""
        return self.deg_per_min > MAX_SPIKE_DEG_PER_MIN


def find_spikes(imu: Imu) -> GyroSpikes:
    """Return the spikes of a gyro, where it is sampled regularly."""
    t, rate = model.select_rising(imu.gyro.t_best, imu.gyro.x)
    if len(t) < 100:
        return GyroSpikes()
    dt = np.diff(t)
    usual = float(median(dt))
    off = rate[1:-1] - 0.5 * (rate[:-2] + rate[2:])
    size = rotation.length(off)
    change = rotation.length(rate[2:] - rate[:-2])
    regular = (np.maximum(dt[:-1], dt[1:]) < 1.5 * usual) & np.isfinite(size)
    if not regular.any():
        return GyroSpikes()
    least = max(MIN_SPIKE_RATIO * float(median(size[regular])), np.radians(MIN_SPIKE_DPS))
    found = np.flatnonzero(regular & (size > least) & (size > MIN_ISOLATION_RATIO * change))
    found = found[~_near_impact(imu, t[found + 1])]
    if len(found) < MIN_SPIKES:
        return GyroSpikes(len(found))
    turned = float(np.degrees(np.sum(size[found]) * usual)) * 60.0 / (usual * len(t))
    why = (
        f"{imu.gyro.source} jumps {len(found)} times for a single sample, by up to "
        f"{np.degrees(size[found].max()):.0f} deg/s; together they turn a filter by {turned:.0f} deg in a minute"
    )
    return GyroSpikes(len(found), turned, float(t[found[0] + 1]), why)


def _near_impact(imu: Imu, t: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which times (n,) are within IMPACT_S of an accelerometer peak."""
    stamps = imu.acc.t_best
    impacts = np.sort(stamps[(rotation.length(imu.acc.x) > IMPACT_M_S2) & np.isfinite(stamps)])
    if not len(impacts):
        return np.zeros(len(t), bool)
    k = np.searchsorted(impacts, t)
    before, after = impacts[np.maximum(k - 1, 0)], impacts[np.minimum(k, len(impacts) - 1)]
    near: NDArray[np.bool_] = np.minimum(np.abs(t - before), np.abs(t - after)) < IMPACT_S
    return near
