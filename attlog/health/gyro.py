"""The gyro in flight against the attitude that did not come from it: its scale, and a bias that steps.

Over intervals of SPAN_S the attitude turned by ``a = S g + b`` where the gyro turned by ``g``. Off-diagonal elements of
S are the mounting, the diagonal is one over the gyro's scale, -b its bias. A smoother is made of this very gyro and
cannot judge its scale: truth or the onboard attitude does, whose aids keep it from turning as far as a wrong scale.
Whether the bias steps a smoother with GNSS knows best, by likelihood: where it is the reference its word is taken.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.flight.model import Array, FlightLog, Imu
from attlog.health.check import Check, HealthCase, Verdict, graded, measured, unknown
from attlog.health.flown import before_crashes
from attlog.health.imu import (
    Blocks,
    SensorBias,
    axes_text,
    dead_reason,
    flight_spans,
    smoothed_gyro_bias,
    still_spans,
    stream_blocks,
    usable_imus,
)
from attlog.health.imu_pairs import difference_in_flight
from attlog.health.regression import BLOCK_S, RobustFit, interval_text, robust_fit
from attlog.health.timing import frozen_gyro_reason
from attlog.reference.model import GyroJump, Reference
from attlog.segments import increments
from attlog.segments.model import Segments

INTERVAL_S = 0.3
"""Long enough that noise, vibration and a delay of some milliseconds do not lower the slope (0.98 at 0.1 s, 1.00 here,
on flights whose scale is right), short enough for turns."""
MIN_TURN_DPS = 8.0
"""An axis that turns less (standard deviation) does not tell its scale to a percent."""
MIN_INTERVALS, MIN_BLOCKS, MIN_FLIGHT_S = 60, 6, 20.0
MAX_INTERVAL_RAD = 1.0
SCALE_OFF, SCALE_FAR = 0.02, 0.1
SCALE_SIGMAS, SCALE_FLOOR = 4.0, 0.006
"""Told above four times sqrt((1.5 standard errors)^2 + 0.006^2): slopes of sound flights are 0.99 to 1.01."""
TURN_ADVICE = "Fly turns of 90 deg and quick steps of 15 deg about all axes."
NO_SCALE_SETTING = "No parameter scales a gyro."
SCALE_LIMIT = (
    f"ok within {100 * SCALE_OFF:.0f} % or {SCALE_SIGMAS:.0f} sigma of 1, fault beyond {100 * SCALE_FAR:.0f} %"
)
STEP_DPS, STEP_FAR_DPS = 0.5, 3.0
STEP_SIGMAS, STEP_FLOOR_DPS = 6.0, 0.03
STEP_BLOCKS = 3
"""Blocks of 5 s before and after a step at least."""
STEP_LIMIT = f"ok: no step above {STEP_DPS} deg/s and {STEP_SIGMAS:.0f} sigma; fault above {STEP_FAR_DPS:.0f} deg/s"


def turn_checks(case: HealthCase) -> list[Check]:
    """Check scale and steps of the bias of the replayed gyro in flight.

    Steps are those of a smoother as reference, else of the rates of an attitude that is not made of this gyro.
    """
    imu = case.log.replay_imu
    if imu is None or not case.segments.spans("airborne"):
        return []
    scale, step = _rate_checks(imu, case.segments, case.rates)
    if case.reference is not None and case.reference.gyro_jumps is not None:
        step = _smoother_step_check(imu, case.reference.gyro_jumps)
    for check in (scale, step):
        check.sensor = imu.gyro.source
        if check.is_trouble:
            check.why_no_setting = NO_SCALE_SETTING if check is scale else NO_BIAS_SETTING
            check.action = case.log.remedy("gyro_scale" if check is scale else "bus")
    if scale.verdict == "unknown":
        scale.action = TURN_ADVICE
    return [scale, step]


def _rate_checks(imu: Imu, segments: Segments, reference: Reference | None) -> tuple[Check, Check]:
    """Return scale and bias step by the rates of an attitude."""
    if reference is None or reference.kind not in ("truth", "onboard") or reference.faults.gyro:
        why = "No attitude that is not made of this gyro can be trusted."
        return unknown("gyro_scale", why, SCALE_LIMIT), unknown("gyro_bias_step", why, STEP_LIMIT)
    t, g, a = interval_rates(imu, reference)
    use = segments.mask(t, "airborne") & (t < reference.scoring.end)
    t, g, a = t[use], g[use], a[use]
    columns = np.concatenate([g, np.ones((len(g), 1))], axis=1)
    if len(t) < MIN_INTERVALS or len(t) * INTERVAL_S < MIN_FLIGHT_S:
        why = f"{len(t)} intervals of {INTERVAL_S} s in flight can be compared; "
        why += f"{MIN_INTERVALS} and {MIN_FLIGHT_S:.0f} s are needed."
        return unknown("gyro_scale", why, SCALE_LIMIT), unknown("gyro_bias_step", why, STEP_LIMIT)
    found = [robust_fit(t, columns[:, None, :], a[:, k : k + 1]) for k in range(3)]
    return _scale_check(imu, reference, t, g, found), _step_check(imu, reference, t, columns, a, found)


def interval_rates(imu: Imu, reference: Reference) -> tuple[Array, Array, Array]:
    """Begin (n,) s, and mean rates (n, 3) rad/s by gyro and attitude over SPAN_S; not across gaps and resets."""
    t, q = reference.t, reference.q
    summed = increments.gyro_increments(imu)
    if len(t) < 3 or len(summed.t) < 3 or reference.rate <= 0:
        return np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
    step = max(1, round(INTERVAL_S * reference.rate))
    first = np.arange(0, len(t) - step, step)
    start, end = t[first], t[first + step]
    good = (end - start < 2.0 * INTERVAL_S + 0.1) & (reference.segment[first] == reference.segment[first + step])
    good &= (start >= reference.scoring.start) & summed.known(start, end) & (end > start)
    by_attitude, by_gyro = rotation.relative_rotvecs(q[first], q[first + step]), summed.between(start, end)
    good &= (
        rotation.finite_rows(by_attitude)
        & rotation.finite_rows(by_gyro)
        & (rotation.length(by_gyro) < MAX_INTERVAL_RAD)
    )
    dt = (end - start)[good, None]
    return start[good], by_gyro[good] / dt, by_attitude[good] / dt


def _smoother_step_check(imu: Imu, jumps: tuple[GyroJump, ...]) -> Check:
    """The step of the bias that a smoother found by likelihood."""
    if not jumps:
        return Check(
            "gyro_bias_step",
            "ok",
            f"The smoother finds no step of the bias of {imu.gyro.source}.",
            threshold=STEP_LIMIT,
        )
    jump = jumps[0]
    axis = int(np.argmax(np.abs(jump.size_dps)))
    size, sigma = jump.size_dps[axis], math.hypot(jump.sigma_dps[axis], STEP_FLOOR_DPS)
    verdict = graded(abs(size), STEP_DPS, STEP_FAR_DPS)
    text = f"The bias of {imu.gyro.source} steps by {size:+.2f} deg/s about {'xyz'[axis]} "
    text += f"({interval_text(size, sigma, 2)}, 95 %) at {jump.t:.0f} s by the smoother, which models it."
    ci95 = round(size - 1.96 * sigma, 2), round(size + 1.96 * sigma, 2)
    return Check("gyro_bias_step", verdict, text, round(size, 2), "deg/s", STEP_LIMIT, t=round(jump.t, 1), ci95=ci95)


def _scale_check(imu: Imu, reference: Reference, t: Array, g: Array, found: list[RobustFit | None]) -> Check:
    moving = np.degrees(g.std(axis=0))
    told: list[tuple[float, float, int]] = []
    for k, one in enumerate(found):
        if one is not None and moving[k] >= MIN_TURN_DPS and one.blocks >= MIN_BLOCKS and one.x[k] > 0.1:
            sigma = math.hypot(1.5 * float(one.sigma[k]), SCALE_FLOOR)
            told.append((1.0 / float(one.x[k]) - 1.0, sigma / float(one.x[k]) ** 2, k))
    if not told:
        shown = ", ".join(f"{v:.0f}" for v in moving)
        why = f"In flight x, y, z turn by {shown} deg/s (standard deviation); {MIN_TURN_DPS:.0f} are needed."
        return unknown("gyro_scale", why, SCALE_LIMIT)
    error, sigma, _ = max(told, key=lambda one: abs(one[0]) / one[1])
    off = [one for one in told if abs(one[0]) > max(SCALE_OFF, SCALE_SIGMAS * one[1])]
    seconds = len(t) * INTERVAL_S
    ci95 = round(100.0 * error - 196.0 * sigma, 2), round(100.0 * error + 196.0 * sigma, 2)
    made = partial(Check, "gyro_scale", unit="%", threshold=SCALE_LIMIT, ci95=ci95, n=len(t), seconds=round(seconds, 1))
    if not off:
        shown = ", ".join(f"{'xyz'[k]} {1.0 + e:.3f}" for e, _, k in told)
        text = f"{imu.gyro.source} against {reference.source} turns {shown} times as far in {seconds:.0f} s of flight."
        return made("ok", text, round(100.0 * error, 2))
    verdict: Verdict = "fault" if max(abs(one[0]) for one in off) > SCALE_FAR else "warning"
    which = ", ".join("xyz"[k] for _, _, k in off)
    text = f"{imu.gyro.source} reads {100 * abs(error):.1f} % too {'much' if error > 0 else 'little'} about {which} "
    text += f"({interval_text(100 * abs(error), 100 * sigma, 1)}, 95 %) against {reference.source}, "
    text += f"{len(t)} intervals in {seconds:.0f} s of flight."
    return made(verdict, text, round(100.0 * error, 2))


def _step_check(
    imu: Imu, reference: Reference, t: Array, columns: Array, a: Array, found: list[RobustFit | None]
) -> Check:
    """The clearest step of the bias between two parts of the flight.

    About z truth alone tells: a compass drags an onboard heading by degrees per second, as a bias would.
    """
    solved = [one for one in found if one is not None]
    if len(solved) < 3:
        return unknown("gyro_bias_step", "The flight turns too little about one axis.", STEP_LIMIT)
    left = np.degrees(columns @ np.column_stack([one.x for one in solved]) - a)
    block = (t // BLOCK_S).astype(np.int64)
    numbers = np.unique(block)
    bias = np.array([np.median(left[block == n], axis=0) for n in numbers])
    if len(bias) < 2 * STEP_BLOCKS:
        return unknown(
            "gyro_bias_step", f"{len(bias)} blocks of {BLOCK_S:.0f} s; {2 * STEP_BLOCKS} are needed.", STEP_LIMIT
        )
    size, sigma, axis, at = largest_step(bias if reference.kind == "truth" else bias[:, :2])
    when = _step_time(t, left[:, axis], float(numbers[at]) * BLOCK_S)
    if abs(size) <= max(STEP_DPS, STEP_SIGMAS * sigma):
        text = f"The bias of {imu.gyro.source} steps by less than {max(STEP_DPS, abs(size)):.1f} deg/s about "
        text += f"{'x, y and z' if reference.kind == 'truth' else 'x and y'} in flight."
        return Check("gyro_bias_step", "ok", text, round(size, 2), "deg/s", STEP_LIMIT)
    verdict: Verdict = "fault" if abs(size) > STEP_FAR_DPS else "warning"
    text = f"The bias of {imu.gyro.source} steps by {size:+.2f} deg/s about {'xyz'[axis]} "
    text += f"({interval_text(size, sigma, 2)}, 95 %) at {when:.0f} s against {reference.source}."
    ci95 = round(size - 1.96 * sigma, 2), round(size + 1.96 * sigma, 2)
    seconds = round(len(t) * INTERVAL_S, 1)
    told = partial(Check, "gyro_bias_step", verdict, text, round(size, 2), "deg/s", STEP_LIMIT, t=round(when, 1))
    return told(ci95=ci95, n=len(t), seconds=seconds)


def largest_step(bias: Array) -> tuple[float, float, int, int]:
    """Size and standard error of the clearest step of block means (n, axes), its axis, and the first block after it.

    Medians before and after; the scatter of a block from the differences of neighbours, which one step hardly widens.
    """
    scatter = 1.4826 * np.median(np.abs(np.diff(bias, axis=0)), axis=0) / math.sqrt(2.0)
    found = [_step_at(bias[:, axis], float(scatter[axis])) for axis in range(bias.shape[1])]
    axis = int(np.argmax([abs(size) / sigma for size, sigma, _ in found]))
    size, sigma, at = found[axis]
    return size, sigma, axis, at


def _step_at(bias: Array, scatter: float) -> tuple[float, float, int]:
    """Size and standard error of a step of one axis (n,), where the squares left by two means are the least."""
    parts = range(STEP_BLOCKS, len(bias) - STEP_BLOCKS + 1)
    at = min(parts, key=lambda k: float(np.var(bias[:k]) * k + np.var(bias[k:]) * (len(bias) - k)))
    size = float(np.median(bias[at:]) - np.median(bias[:at]))
    sigma = 1.25 * scatter * math.sqrt(1.0 / at + 1.0 / (len(bias) - at))
    return size, math.hypot(sigma, STEP_FLOOR_DPS), at


def _step_time(t: Array, left: Array, near: float) -> float:
    """The time within a block either way of ``near`` at which the residual's mean changes most."""
    around: NDArray[np.int64] = np.flatnonzero(np.abs(t - near) <= 2.0 * BLOCK_S)
    if len(around) < 8:
        return near
    x = left[around] - left[around].mean()
    k = int(np.argmax(np.abs(np.cumsum(x)[2:-3]))) + 2
    return float(t[around[k + 1]])


# Bias at rest and in flight, saturation, dead sensors.

BIAS_DPS = (1.0, 3.0)
# From here on no filter can be judged: results show how it copes with a broken gyro.
UNUSABLE_DPS = 10.0
# Resolution of the gyro in old logs.
BIAS_FLOOR_DPS = 0.01
BIAS_LIMIT = f"ok up to {BIAS_DPS[0]:.0f} deg/s, fault above {BIAS_DPS[1]:.0f} deg/s; the same for its change"
BIAS_SOURCE = "what estimators learn within seconds"
NO_BIAS_SETTING = "Gyro offsets are measured while the vehicle stands still, not in a log."
STAND_ADVICE = "Log 10 s standing still before take-off."
# Ranges of autopilot gyros; 2000 deg/s is the usual one.
RANGES_DPS = (125.0, 250.0, 500.0, 1000.0, 2000.0)
# Share of the range within which a sample lies at its end.
AT_LIMIT = 0.0005
# Samples in a row at the end of a smaller range that are no chance.
FLAT_SAMPLES = 3


def gyro_checks(case: HealthCase) -> list[Check]:
    """Check whether the gyro in use is dead, else its saturation."""
    log = case.log
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    if why := dead_reason(imu.gyro.x, imu.gyro.source, "gyro"):
        return [Check("gyro_dead", "fault", why, threshold="every axis must change", sensor=imu.gyro.source)]
    whole = before_crashes(case.segments, imu.gyro.t)
    flown = imu.gyro.x[whole] if whole.any() else imu.gyro.x  # a wreck turns as it will
    peak = float(np.degrees(np.abs(flown).max()))
    limit = "warning from 1999 deg/s, or where it stays at 125, 250, 500 or 1000 deg/s: the range of the sensor"
    clipped = count_at_limit(np.degrees(np.abs(flown).max(axis=1)))
    samples = "1 sample is" if clipped == 1 else f"{clipped} samples are"
    text = f"Largest rate {peak:.0f} deg/s" + (f"; {samples} at the sensor's limit." if clipped else ".")
    verdict: Verdict = "warning" if clipped else "ok"
    return [Check("gyro_range", verdict, text, round(peak, 1), "deg/s", limit, sensor=imu.gyro.source)]


def count_at_limit(rate: Array) -> int:
    """Count the rates (n,) deg/s at the end of the sensor's range: flat at a known range, or beyond all."""
    peak = float(rate.max(initial=0.0))
    if peak >= RANGES_DPS[-1] * (1.0 - AT_LIMIT):
        return int((rate >= RANGES_DPS[-1] * (1.0 - AT_LIMIT)).sum())
    for full in RANGES_DPS[:-1]:
        if abs(peak / full - 1.0) <= AT_LIMIT:
            there = rate >= full * (1.0 - AT_LIMIT)
            in_a_row = np.convolve(there, np.ones(FLAT_SAMPLES, int), "valid").max(initial=0) >= FLAT_SAMPLES
            return int(there.sum()) if in_a_row else 0
    return 0


def gyro_bias_checks(case: HealthCase) -> list[Check]:
    """Check the bias of each gyro at rest and in flight; the gyro in use by short rests too."""
    units = usable_imus(case)
    found = [one for imu in units if (one := _bias_check(case, imu)) is not None]
    imu = case.log.imus[case.log.imu or 0] if case.log.imus else None
    if imu is None or dead_reason(imu.gyro.x, "", "") or imu.gyro.source in {check.sensor for check in found}:
        return found
    short = _rest_bias(imu, case.segments)
    if short is None:
        why = "The vehicle never stands still in this log, and no smoother estimates the bias in flight."
        short = unknown("gyro_bias", why, BIAS_LIMIT)
        short.action = STAND_ADVICE
    short.sensor, short.source = imu.gyro.source, BIAS_SOURCE
    return [short, *found]


def unusable_gyro(log: FlightLog, segments: Segments, reference: Reference) -> str:
    """Return why no filter can be judged with this gyro: contradicted, far from zero at rest, frozen; else empty."""
    imu = log.replay_imu
    if reference.faults.gyro:
        return f"{reference.faults.gyro[0].lower()}{reference.faults.gyro[1:].rstrip('.')}"
    rest = None if imu is None else _rest_bias(imu, segments)
    if rest is not None and rest.value is not None and abs(rest.value) >= UNUSABLE_DPS:
        return f"the gyro reads {rest.value:.0f} deg/s while the vehicle stands still"
    return frozen_gyro_reason(log)


def _rest_bias(imu: Imu, segments: Segments) -> Check | None:
    """Return the median rate at rest, else on the ground with motors on, and how far it moved between rests."""
    for kind, where in (("rest", "Standing still"), ("idle", "On the ground with motors on")):
        mask = segments.mask(imu.gyro.t, kind) & rotation.finite_rows(imu.gyro.x)
        if mask.sum() < 10:
            continue
        x, y, z = (float(v) for v in np.degrees(np.median(imu.gyro.x[mask], axis=0)))
        worst = max(x, y, z, key=abs)
        text = f"{where} the gyro reads {x:.2f}, {y:.2f}, {z:.2f} deg/s about x, y, z."
        verdict = graded(abs(worst), *BIAS_DPS)
        moved = _moved_bias(imu, segments) if kind == "rest" and verdict != "fault" else None
        return moved or Check("gyro_bias", verdict, text, round(worst, 3), "deg/s", BIAS_LIMIT)
    return None


def _moved_bias(imu: Imu, segments: Segments) -> Check | None:
    """Return the check of two rests that disagree by more than BIAS_DPS, which their common median hides."""
    t = imu.gyro.t
    good = rotation.finite_rows(imu.gyro.x)
    rests = [(a, b, imu.gyro.x[good & (t >= a) & (t <= b)]) for a, b in segments.spans("rest")]
    known = [(a, b, np.degrees(np.median(x, axis=0))) for a, b, x in rests if len(x) >= 10]
    if len(known) < 2:
        return None
    readings = np.array([x for _, _, x in known])
    axis = int(np.argmax(np.ptp(readings, axis=0)))
    low, high = sorted((int(np.argmin(readings[:, axis])), int(np.argmax(readings[:, axis]))))
    change = float(np.ptp(readings[:, axis]))
    if change <= BIAS_DPS[0]:
        return None
    before, after = (", ".join(f"{v:.2f}" for v in readings[k]) for k in (low, high))
    text = (
        f"Standing still the gyro reads {before} deg/s about x, y, z until {known[low][1]:.0f} s, and {after} from "
        f"{known[high][0]:.0f} s on: its bias moved by {change:.2f} deg/s about {'xyz'[axis]}."
    )
    worst = float(readings.ravel()[np.argmax(np.abs(readings))])
    verdict = graded(max(change, abs(worst)), *BIAS_DPS)
    return Check("gyro_bias", verdict, text, round(worst, 3), "deg/s", BIAS_LIMIT, t=known[high][0])


def _bias_check(case: HealthCase, imu: Imu) -> Check | None:
    """Return the bias of one unit by blocks at rest, else in flight; None where neither is known."""
    spans, where = still_spans(case.segments)
    rest, air = stream_blocks(imu.gyro, spans), _bias_in_flight(case, imu)
    if rest is not None and 1.96 * float(np.degrees(rest.sigma(0.0).max())) > BIAS_DPS[0]:
        rest = None
    if rest is not None:
        mean, sigma = np.degrees(rest.middle), np.degrees(rest.sigma(np.radians(BIAS_FLOOR_DPS)))
        n, seconds = rest.samples, rest.seconds
    elif air is not None:
        mean, sigma, n, seconds, where = air.mean, air.sigma, air.n, air.seconds, "in flight"
    else:
        return None
    worst = int(np.argmax(np.abs(mean)))
    change = _bias_change_dps(rest, air)
    verdict = graded(max(float(np.abs(mean).max()), change), *BIAS_DPS)
    text = f"{imu.gyro.source} reads {axes_text(mean)} deg/s {where} (± {1.96 * float(sigma.max()):.2f}, 95 %)."
    found = Check(
        "gyro_bias",
        verdict,
        text,
        unit="deg/s",
        threshold=BIAS_LIMIT,
        sensor=imu.gyro.source,
        **measured(float(mean[worst]), float(sigma[worst]), 3),
        vector=[round(float(v), 3) for v in mean],
        vector_ci95=[round(1.96 * float(v), 3) for v in sigma],
        n=n,
        seconds=round(seconds, 1),
        source=BIAS_SOURCE,
    )
    if rest is not None and air is not None:
        found.evidence = [
            f"In flight it reads {axes_text(air.mean)} deg/s by {air.by} (± {1.96 * air.sigma.max():.2f})."
        ]
    if imu is case.log.replay_imu and (short := _rest_bias(imu, case.segments)) is not None:
        found.verdict = max(short.verdict, graded(change, *BIAS_DPS), key=("ok", "warning", "fault").index)
        if short.t is not None:
            found.text, found.t, found.evidence = short.text, short.t, [text, *found.evidence]
    if found.is_trouble:
        found.why_no_setting, found.action = NO_BIAS_SETTING, case.log.remedy("gyro_bias")
    return found


def _bias_in_flight(case: HealthCase, imu: Imu) -> SensorBias | None:
    """Return the bias in flight by the smoother; of another unit with the mean difference from the replayed one."""
    found, replayed = smoothed_gyro_bias(case), case.log.replay_imu
    if found is None or not found.sure or replayed is None or not flight_spans(case.segments):
        return None
    if imu is replayed:
        return found
    more = difference_in_flight(case, "gyro", replayed, imu)
    if more is None:
        return None
    sigma = np.hypot(found.sigma, np.degrees(more.sigma(0.0)))
    if 1.96 * float(sigma.max()) > BIAS_DPS[0]:
        return None
    return SensorBias(found.mean + np.degrees(more.middle), sigma, found.known, found.n, found.seconds, found.by)


def _bias_change_dps(rest: Blocks | None, air: SensorBias | None) -> float:
    """Return the significant change of the bias from rest to flight about its worst axis; 0 where one is unknown."""
    if rest is None or air is None:
        return 0.0
    change = np.abs(air.mean - np.degrees(rest.middle))
    sigma = np.hypot(air.sigma, np.degrees(rest.sigma(0.0)))
    return float(np.max(np.where(change > 4.0 * sigma, change, 0.0)))
