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
from attlog.health.check import Assessment, Check, HealthCase, Verdict, graded, not_judged, unknown
from attlog.health.imu import (
    BIAS_DPS,
    Blocks,
    SensorBias,
    axes_text,
    flight_spans,
    smoothed_gyro_bias,
    still_spans,
    stream_blocks,
    usable_imus,
)
from attlog.health.imu_pairs import difference_in_flight
from attlog.health.regression import BLOCK_S, RobustFit, interval_text, robust_fit
from attlog.reference.model import GyroJump, Reference
from attlog.segments import increments
from attlog.segments.model import Segments

GYRO_SCALE, GYRO_BIAS_STEP = "gyro scale", "gyro bias step"
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
SCALE_LIMIT = (
    f"ok within {100 * SCALE_OFF:.0f} % or {SCALE_SIGMAS:.0f} sigma of 1, fault beyond {100 * SCALE_FAR:.0f} %"
)
STEP_DPS, STEP_FAR_DPS = 0.5, 3.0
STEP_SIGMAS, STEP_FLOOR_DPS = 6.0, 0.03
STEP_BLOCKS = 3
"""Blocks of 5 s before and after a step at least."""
STEP_LIMIT = f"ok: no step above {STEP_DPS} deg/s and {STEP_SIGMAS:.0f} sigma; fault above {STEP_FAR_DPS:.0f} deg/s"


def turn_checks(
    log: FlightLog, segments: Segments, reference: Reference | None, smoother: Reference | None = None
) -> list[Check]:
    """Scale and steps of the bias in flight; nothing where nothing flew.

    ``reference`` is not made of this gyro alone; ``smoother`` may know of steps, where that is what it is.
    """
    imu = log.replay_imu
    flown = segments.spans("airborne")
    if imu is None or not flown:
        return []
    jumps = None if smoother is None else smoother.gyro_jumps
    found = _rate_checks(imu, segments, reference)
    return (
        found
        if jumps is None
        else [_smoother_step_check(imu, jumps) if check.name == GYRO_BIAS_STEP else check for check in found]
    )


def _rate_checks(imu: Imu, segments: Segments, reference: Reference | None) -> list[Check]:
    """Both by the rates of an attitude."""
    if reference is None or reference.kind not in ("truth", "onboard") or reference.gyro_fault:
        why = "No attitude that is not made of this gyro can be trusted."
        return [not_judged(GYRO_SCALE, why, SCALE_LIMIT), not_judged(GYRO_BIAS_STEP, why, STEP_LIMIT)]
    t, g, a = interval_rates(imu, reference)
    use = segments.mask(t, "airborne") & (t < reference.end)
    t, g, a = t[use], g[use], a[use]
    columns = np.concatenate([g, np.ones((len(g), 1))], axis=1)
    if len(t) < MIN_INTERVALS or len(t) * INTERVAL_S < MIN_FLIGHT_S:
        why = f"{len(t)} intervals of {INTERVAL_S} s in flight can be compared; {MIN_INTERVALS} and {MIN_FLIGHT_S:.0f} s are needed."
        return [not_judged(GYRO_SCALE, why, SCALE_LIMIT), not_judged(GYRO_BIAS_STEP, why, STEP_LIMIT)]
    found = [robust_fit(t, columns[:, None, :], a[:, k : k + 1]) for k in range(3)]
    return [_scale_check(imu, reference, t, g, found), _step_check(imu, reference, t, columns, a, found)]


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
    good &= (start >= reference.scoring_start) & summed.known(start, end) & (end > start)
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
            GYRO_BIAS_STEP, "ok", f"The smoother finds no step of the bias of {imu.gyro.source}.", threshold=STEP_LIMIT
        )
    jump = jumps[0]
    axis = int(np.argmax(np.abs(jump.size_dps)))
    size, sigma = jump.size_dps[axis], math.hypot(jump.sigma_dps[axis], STEP_FLOOR_DPS)
    verdict = graded(abs(size), STEP_DPS, STEP_FAR_DPS)
    text = f"The bias of {imu.gyro.source} steps by {size:+.2f} deg/s about {'xyz'[axis]} "
    text += f"({interval_text(size, sigma, 2)}, 95 %) at {jump.t:.0f} s by the smoother, which models it."
    ci95 = round(size - 1.96 * sigma, 2), round(size + 1.96 * sigma, 2)
    return Check(GYRO_BIAS_STEP, verdict, text, round(size, 2), "deg/s", STEP_LIMIT, t=round(jump.t, 1), ci95=ci95)


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
        return not_judged(GYRO_SCALE, why, SCALE_LIMIT)
    error, sigma, _ = max(told, key=lambda one: abs(one[0]) / one[1])
    off = [one for one in told if abs(one[0]) > max(SCALE_OFF, SCALE_SIGMAS * one[1])]
    seconds = len(t) * INTERVAL_S
    ci95 = round(100.0 * error - 196.0 * sigma, 2), round(100.0 * error + 196.0 * sigma, 2)
    made = partial(
        Check, GYRO_SCALE, unit="%", threshold=SCALE_LIMIT, ci95=ci95, samples=len(t), seconds=round(seconds, 1)
    )
    if not off:
        shown = ", ".join(f"{'xyz'[k]} {1.0 + e:.3f}" for e, _, k in told)
        text = f"{imu.gyro.source} against {reference.source} turns {shown} times as far in {seconds:.0f} s of flight."
        return made("ok", text, round(100.0 * error, 2))
    verdict = "fault" if max(abs(one[0]) for one in off) > SCALE_FAR else "warning"
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
        return not_judged(GYRO_BIAS_STEP, "The flight turns too little about one axis.", STEP_LIMIT)
    left = np.degrees(columns @ np.column_stack([one.x for one in solved]) - a)
    block = (t // BLOCK_S).astype(np.int64)
    numbers = np.unique(block)
    bias = np.array([np.median(left[block == n], axis=0) for n in numbers])
    if len(bias) < 2 * STEP_BLOCKS:
        return not_judged(
            GYRO_BIAS_STEP, f"{len(bias)} blocks of {BLOCK_S:.0f} s; {2 * STEP_BLOCKS} are needed.", STEP_LIMIT
        )
    size, sigma, axis, at = largest_step(bias if reference.kind == "truth" else bias[:, :2])
    when = _step_time(t, left[:, axis], float(numbers[at]) * BLOCK_S)
    if abs(size) <= max(STEP_DPS, STEP_SIGMAS * sigma):
        text = f"The bias of {imu.gyro.source} steps by less than {max(STEP_DPS, abs(size)):.1f} deg/s about "
        text += f"{'x, y and z' if reference.kind == 'truth' else 'x and y'} in flight."
        return Check(GYRO_BIAS_STEP, "ok", text, round(size, 2), "deg/s", STEP_LIMIT)
    verdict = "fault" if abs(size) > STEP_FAR_DPS else "warning"
    text = f"The bias of {imu.gyro.source} steps by {size:+.2f} deg/s about {'xyz'[axis]} "
    text += f"({interval_text(size, sigma, 2)}, 95 %) at {when:.0f} s against {reference.source}."
    ci95 = round(size - 1.96 * sigma, 2), round(size + 1.96 * sigma, 2)
    seconds = round(len(t) * INTERVAL_S, 1)
    told = partial(Check, GYRO_BIAS_STEP, verdict, text, round(size, 2), "deg/s", STEP_LIMIT, t=round(when, 1))
    return told(ci95=ci95, samples=len(t), seconds=seconds)


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


# Does the gyro turn as far as the vehicle does? The check of its scale as an assessment, with its interval.

SCALE_QUESTION = "gyro_scale"
SCALE_SOURCE = "slopes of sound flights are 0.99 to 1.01"
TURN_ADVICE = "Fly turns of 90 deg and quick steps of 15 deg about all axes."
KNOWN_VERDICTS: dict[str, Verdict] = {"ok": "ok", "warning": "warning", "fault": "fault"}
NO_SCALE_SETTING = "No parameter scales a gyro."


def gyro_scale(case: HealthCase) -> list[Assessment]:
    """Of the replayed gyro; ``unknown`` where the flight turns too little or no attitude can judge it."""
    imu = case.log.replay_imu
    if imu is None or imu not in usable_imus(case):
        return []
    check = next((c for c in case.checks if c.name == GYRO_SCALE), None)
    if check is None:
        why = "The vehicle does not fly in this log, so nothing shows how far it turns."
        check = Check(GYRO_SCALE, "unknown", why, threshold=SCALE_LIMIT)
    verdict = KNOWN_VERDICTS.get(check.verdict, "unknown")
    found = Assessment(
        imu.gyro.source, SCALE_QUESTION, verdict, check.text, threshold=check.threshold, source=SCALE_SOURCE
    )
    if isinstance(check.value, float | int) and verdict != "unknown":
        found.value, found.unit, found.ci95 = float(check.value), check.unit, check.ci95
        found.n, found.seconds = check.samples, check.seconds
    if verdict == "unknown":
        found.action = TURN_ADVICE
    elif verdict != "ok":
        found.why_no_setting, found.action = NO_SCALE_SETTING, case.log.remedies.get("gyro_scale", "")
    return [found]


# What does each gyro read while nothing turns: at rest, in flight, how far that moves, and does it step?
#
# Verdicts of the replayed unit are those of the checks ``gyro bias`` and ``gyro bias step``; what is added are
# intervals,
# the bias in flight, and the other units.

BIAS_QUESTION, STEP_QUESTION = "gyro_bias", "gyro_bias_step"
BIAS_FLOOR_DPS = 0.01
"""One step of the gyro's numbers in old logs."""
BIAS_LIMIT = f"ok up to {BIAS_DPS[0]:.0f} deg/s, fault above {BIAS_DPS[1]:.0f} deg/s; the same for its change"
BIAS_SOURCE = "what estimators learn within seconds; the check of the gyro's bias"
NO_BIAS_SETTING = "Gyro offsets are measured while the vehicle stands still, not in a log."
STAND_ADVICE = "Log 10 s standing still before take-off."


def gyro_bias(case: HealthCase) -> list[Assessment]:
    """One assessment for each gyro, one ``unknown`` where none can be judged; a step of the bias is another one."""
    units = usable_imus(case)
    if not units:
        return []
    found = [one for imu in units if (one := _bias_assessment(case, imu)) is not None]
    if not found:
        why = "The vehicle never stands still in this log, and no smoother estimates the bias in flight."
        found = [unknown(units[0].gyro.source, BIAS_QUESTION, why, BIAS_LIMIT, BIAS_SOURCE)]
        found[0].action = STAND_ADVICE
    return found + _step_assessment(case)


def _bias_assessment(case: HealthCase, imu: Imu) -> Assessment | None:
    """The bias of one unit at rest and in flight; None where neither is known."""
    if case.segments is None:
        return None
    spans, where = still_spans(case.segments)
    rest, air = stream_blocks(imu.gyro, spans), _bias_in_flight(case, imu)
    if rest is not None and 1.96 * float(np.degrees(rest.sigma(0.0).max())) > BIAS_DPS[0]:
        rest = None
    if rest is None and air is None:
        return None
    if rest is not None:
        mean, sigma = np.degrees(rest.middle), np.degrees(rest.sigma(np.radians(BIAS_FLOOR_DPS)))
        n, seconds = rest.samples, rest.seconds
    else:
        assert air is not None
        mean, sigma, n, seconds, where = air.mean, air.sigma, air.n, air.seconds, "in flight"
    worst = int(np.argmax(np.abs(mean)))
    size, unsure = float(mean[worst]), float(sigma[worst])
    verdict = _bias_verdict(case, imu, mean, _bias_change_dps(rest, air))
    text = f"{imu.gyro.source} reads {axes_text(mean)} deg/s {where} (± {1.96 * float(sigma.max()):.2f}, 95 %)."
    evidence = []
    if rest is not None and air is not None:
        evidence = [f"In flight it reads {axes_text(air.mean)} deg/s by {air.by} (± {1.96 * air.sigma.max():.2f})."]
    off = verdict != "ok"
    return Assessment(
        imu.gyro.source,
        BIAS_QUESTION,
        verdict,
        text,
        value=round(size, 3),
        unit="deg/s",
        ci95=(round(size - 1.96 * unsure, 3), round(size + 1.96 * unsure, 3)),
        vector=[round(float(v), 3) for v in mean],
        vector_ci95=[round(1.96 * float(v), 3) for v in sigma],
        n=n,
        seconds=round(seconds, 1),
        threshold=BIAS_LIMIT,
        source=BIAS_SOURCE,
        why_no_setting=NO_BIAS_SETTING if off else "",
        action=case.log.remedies.get("gyro_bias", "") if off else "",
        evidence=evidence,
    )


def _bias_in_flight(case: HealthCase, imu: Imu) -> SensorBias | None:
    """The bias in flight: the smoother's of the replayed unit, and what another one reads more."""
    found, replayed = smoothed_gyro_bias(case), case.log.replay_imu
    if found is None or replayed is None or case.segments is None or not flight_spans(case.segments):
        return None
    if imu is replayed:
        return found if found.sure else None
    more = difference_in_flight(case, "gyro", replayed, imu)
    if more is None:
        return None
    sigma = np.hypot(found.sigma, np.degrees(more.sigma(0.0)))
    if not found.sure or 1.96 * float(sigma.max()) > BIAS_DPS[0]:
        return None
    return SensorBias(found.mean + np.degrees(more.middle), sigma, found.known, found.n, found.seconds, found.by)


def _bias_change_dps(rest: Blocks | None, air: SensorBias | None) -> float:
    """By how much the bias surely changes from rest to flight about its worst axis, deg/s; 0 where one is unknown."""
    if rest is None or air is None:
        return 0.0
    change = np.abs(air.mean - np.degrees(rest.middle))
    unsure = np.hypot(air.sigma, np.degrees(rest.sigma(0.0)))
    return float(np.max(np.where(change > 4.0 * unsure, change, 0.0)))


def _bias_verdict(case: HealthCase, imu: Imu, mean: Array, moved: float) -> Verdict:
    """The check's where there is one of this unit, else by the same limits; a change in flight counts as well."""
    check = _check_named(case, "gyro bias") if imu is case.log.replay_imu else None
    told = KNOWN_VERDICTS.get("" if check is None else check.verdict)
    by_size = graded(max(float(np.abs(mean).max()), moved), *BIAS_DPS)
    if told is None:
        return by_size
    return max(told, graded(moved, *BIAS_DPS), key=list(KNOWN_VERDICTS).index)


def _step_assessment(case: HealthCase) -> list[Assessment]:
    """The step of the replayed gyro's bias that the check found, with its time; nothing where it found none."""
    check, imu = _check_named(case, GYRO_BIAS_STEP), case.log.replay_imu
    if check is None or imu is None or check.verdict not in ("warning", "fault"):
        return []
    found = Assessment(
        imu.gyro.source, STEP_QUESTION, KNOWN_VERDICTS[check.verdict], check.text, unit=check.unit, t=check.t
    )
    found.value = float(check.value) if isinstance(check.value, float | int) else None
    found.ci95, found.n, found.seconds = check.ci95, check.samples, check.seconds
    found.threshold, found.source = check.threshold, "steps that a sound gyro does not make"
    found.why_no_setting, found.action = NO_BIAS_SETTING, case.log.remedies.get("bus", "")
    return [found]


def _check_named(case: HealthCase, name: str) -> Check | None:
    return next((c for c in case.checks if c.name == name), None)
