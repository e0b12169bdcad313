"""Onboard attitude: coverage, rates against the gyro, trim, heading, errors by truth or smoother, jumps, crash."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median, nanmedian
from attlog.flight.model import Array, Attitude, FlightLog, Imu
from attlog.health.check import Check, HealthCase, as_sentence, graded, unknown
from attlog.health.flown import before_crashes
from attlog.health.heading import HEADING_BY_GNSS, left_by_estimator
from attlog.health.sources import REFERENCE_NAMES
from attlog.reference import onboard_check
from attlog.reference.gyro_checks import (
    MIN_ATTITUDE_HZ,
    MIN_RATE_INTERVALS,
    MIN_RATE_STD_DPS,
    center_rates,
    mean_rates,
    rate_mismatch,
    rates_without_delay,
    reversed_slowly,
    swapped_axes,
)
from attlog.reference.model import Reference
from attlog.reference.onboard_check import OnboardComparison, OnboardError
from attlog.reference.smoother import differences_deg
from attlog.segments import increments
from attlog.segments.impacts import shows_impacts
from attlog.segments.model import Segments, interpolate_attitudes
from attlog.story.causes import SWITCH_S
from attlog.story.headlines import WrongAngle

# Coverage of the IMU's time: warning below the first, fault below the second.
MIN_COVERED_PCT, FEW_COVERED_PCT = 95.0, 50.0
COVERAGE_LIMIT = "ok from 95 %, fault below 50 %"
# Limits of |log slope|: slopes of sound flights are 0.95 to 1.05; outside 0.8 to 1.25 the gyro has another unit or
# range.
SLOPE_OFF, SLOPE_FAR = np.log(1.055), np.log(1.25)
GYRO_LIMIT = "ok: slopes 0.95 to 1.05; fault: swapped or reversed axes, or slopes outside 0.8 to 1.25"
# Maximum trim; larger ones come from a level calibration on a slope.
MAX_TRIM_DEG = 3.0


def attitude_checks(case: HealthCase) -> list[Check]:
    """Check coverage, rates against the gyro, and trim of the onboard attitude."""
    log = case.log
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    onboard = log.onboard_attitude
    if onboard is None or len(onboard.t) < 2:
        return [unknown("coverage", "There is no onboard attitude in this log.", "ok from 95 %")]
    against = gyro_against_attitude(log, imu, onboard, case.segments)
    if case.rates is not None and case.rates.faults.gyro:
        why = as_sentence(case.rates.faults.gyro)
        against = Check("gyro_against_attitude", "fault", why, threshold=against.threshold)
    share = round(100.0 * float(np.mean(onboard.covers(imu.gyro.t))), 1)
    text = f"{log.onboard} at {onboard.rate:.1f} Hz covers {share:.1f} % of the inertial data."
    verdict = graded(-share, -MIN_COVERED_PCT, -FEW_COVERED_PCT)
    return [Check("coverage", verdict, text, share, "%", COVERAGE_LIMIT), against, *trim_check(log, onboard)]


def gyro_against_attitude(log: FlightLog, imu: Imu, onboard: Attitude, segments: Segments) -> Check:
    """Check regression slopes of attitude rates on gyro rates, and order and sign of axes."""
    made = partial(Check, "gyro_against_attitude", threshold=GYRO_LIMIT)
    name = log.onboard or ""
    jumps, _ = (
        increments.known_resets(log, name, segments) if imu is log.replay_imu else increments.find_resets(onboard, imu)
    )
    by_gyro, by_attitude = mean_rates(imu, onboard, jumps)
    if imu.gyro.rate < MIN_ATTITUDE_HZ:
        return made("unknown", f"At {imu.gyro.rate:.0f} Hz {imu.gyro.source} misses turns.")
    if len(by_gyro) < MIN_RATE_INTERVALS:
        return made("unknown", f"{name} has too few intervals with inertial data.")
    g, a = center_rates(by_gyro), center_rates(by_attitude)
    spread = np.degrees(g.std(axis=0))
    moving = spread >= MIN_RATE_STD_DPS
    slowly = reversed_slowly(g, a, moving)
    if not moving.any() and not slowly:
        turns = ", ".join(f"{s:.1f}" for s in spread)
        return made("unknown", f"The vehicle hardly turns: {turns} deg/s about x, y, z.")
    wrong = (swapped_axes(g, a, moving) if moving.any() else "") or slowly
    if wrong:
        return made("fault", f"{imu.gyro.source} against {name}: {wrong}")
    slopes = np.sum(g * a, axis=0) / np.sum(g * g, axis=0)
    if rate_mismatch(by_gyro, by_attitude):
        g, a = (center_rates(rates) for rates in rates_without_delay(imu, onboard, jumps))
        slopes = np.sum(g * a, axis=0) / np.sum(g * g, axis=0)
    shown = ", ".join(f"{s:.3f} ({axis})" for axis, s, m in zip("xyz", slopes, moving, strict=True) if m)
    verdict = graded(float(np.abs(np.log(np.maximum(slopes[moving], 1e-3))).max()), SLOPE_OFF, SLOPE_FAR)
    text = f"By {name} the vehicle turns {shown} times as far as by the gyro."
    if onboard.rate < MIN_ATTITUDE_HZ and verdict == "fault":
        verdict, text = "warning", text + f" At {onboard.rate:.0f} Hz the attitude smears fast motion."
    check = made(verdict, text, value=round(float(slopes[moving][np.argmax(np.abs(slopes[moving] - 1))]), 4))
    if verdict == "warning":
        # The onboard attitude is made of this gyro, filtered and logged slower: no judge of scale or mounting.
        check.cause = "Low rates, filters or a delay of the attitude; it is no evidence against the gyro."
        check.action = "Turn by 360 deg and back at 30 deg/s: the compass then shows the gyro's scale."
    return check


def trim_check(log: FlightLog, onboard: Attitude) -> list[Check]:
    """Check the vehicle's trim: a constant angle between the IMU and the attitude."""
    if not onboard.has_trim:
        return []
    limit = f"warning above {MAX_TRIM_DEG:.0f} deg"
    vector = log.parameters.trim
    if vector is None:
        return [unknown("trim", "The log holds no parameters of the trim.", limit)]
    roll, pitch = np.degrees(vector[:2])
    size = float(np.hypot(roll, pitch))
    text = f"The vehicle's trim turns roll by {roll:.2f} and pitch by {pitch:.2f} deg."
    return [Check("trim", "ok" if size <= MAX_TRIM_DEG else "warning", text, round(size, 3), "deg", limit)]


# Onboard attitude against truth or smoother (:mod:`attlog.reference.onboard_check`). A smoother whose sensors failed a
# check is not used, unless gravity and GNSS acceleration also contradict the onboard attitude.

AGAINST_SMOOTHER, AGAINST_TRUTH = "onboard_against_smoother", "onboard_against_truth"
# Check by kind of reference.
AGAINST = {"smoother": AGAINST_SMOOTHER, "truth": AGAINST_TRUTH}
# Maximum share of a tilt error left after a constant rotation that counts as a mounting error.
MAX_MOUNTING_LEFT = 0.3
ONBOARD_LIMIT = "ok up to 3 deg of tilt and 8 deg of heading"
ONBOARD_LIMITS = {"smoother": f"{ONBOARD_LIMIT}, or 3 joint sigmas", "truth": ONBOARD_LIMIT}
# Accelerometer checks that must pass before gravity and GNSS acceleration count as evidence.
FORCE_CHECKS = ("accelerometer_axes", "accelerometer_delay", "force_axes", "frozen_sensors", "gravity_kept")
# Checks of the sensors that every smoother uses.
INERTIAL_CHECKS = (
    *FORCE_CHECKS,
    *("gyro_dead", "gyro_range", "gyro_bias", "frozen_gyro", "gyro_spikes", "gyro_bias_step", "gyro_scale"),
    *("accelerometer_dead", "accelerometer_rest", "accelerometer_offset", "vibration_level", "vertical_force"),
)
# Checks of the compass, for a smoother with heading from it.
COMPASS_CHECKS = ("compass_orientation", "compass_offset", "compass_turn", "field", "compass_motors")


def smoother_checks(case: HealthCase) -> list[Check]:
    """Check tilt and heading of the onboard attitude against truth or smoother."""
    log, segments, reference = case.log, case.segments, case.reference
    found = None if reference is None else onboard_check.compare_onboard(log, segments, reference)
    if reference is None or found is None:
        return []
    name, limit = AGAINST[reference.kind], ONBOARD_LIMITS[reference.kind]
    whom = REFERENCE_NAMES[reference.kind]
    if not found.errors:
        return [Check(name, "ok", _agreement_text(log, found, whom), threshold=limit)]
    # A smoother corrects a small constant gyro bias.
    misleading = [c for c in case.trouble() if c.verdict == "fault" or c.question != "gyro_bias" or c.t is not None]
    failed = {check.question for check in misleading}
    failures = {error.angle: _failed_sensors(error, reference, failed) for error in found.errors}
    errors = [error for error in found.errors if not failures[error.angle]]
    if not errors:
        error = found.errors[0]
        why = f"{log.onboard} differs from {whom}: {error.text}. Who is wrong is open: {failures[error.angle]} failed."
        return [unknown(name, why, limit)]
    shown = [error for error in errors if error.wrong] or errors
    lead, *rest = shown
    wrong = lead.wrong
    text = "The onboard attitude was wrong" if wrong else "The onboard attitude is in error"
    own, _ = interpolate_attitudes(reference.t, reference.q, reference.gap_segment, found.t[found.counted])
    if lead.angle == "tilt" and is_mounted_turned(found.q[found.counted], own):
        wrong, text = False, "The sensor is mounted otherwise than set, or the onboard attitude is wrong throughout"
    text += f": {lead.text}."
    if lead.evidence:
        text += f" It is {lead.evidence.replace('the reference', whom)}."
    check = Check(name, "fault" if wrong else "warning", text, round(lead.size, 1), "deg", limit, about=lead.angle)
    check.t, check.t_end = lead.longest
    check.evidence = [f"Its {error.text}." for error in rest]
    return [check]


def _agreement_text(log: FlightLog, found: OnboardComparison, whom: str) -> str:
    """Return the sentence for an onboard attitude without error."""
    if found.supported == ["tilt"]:
        return f"{log.onboard} agrees with gravity where it stands, better than {whom}."
    if found.supported:
        return f"{log.onboard} agrees with gravity and GNSS acceleration, better than {whom}."
    usual = []
    for angle, sizes in found.sizes.items():
        size, sigma = sizes[found.counted], found.sigmas[angle][found.counted]
        text = f"{angle} {float(np.sqrt(np.mean(size**2))):.1f} deg"
        usual.append(f"{text} ({np.sqrt(np.mean((size / sigma) ** 2)):.1f} sigma)" if sigma.all() else text)
    return f"{log.onboard} differs from {whom} by {', '.join(usual)}."


def _failed_sensors(error: OnboardError, reference: Reference, failed: set[str]) -> str:
    """Return failed checks of the reference's sensors that make its evidence doubtful."""
    if reference.kind == "truth":
        return ""
    relevant: tuple[str, ...] = FORCE_CHECKS if error.confirmed else INERTIAL_CHECKS
    by_compass = reference.quality.get("heading_from") not in ("motion", "external")
    if not error.confirmed and error.angle == "heading" and by_compass:
        relevant = (*relevant, *COMPASS_CHECKS)
    found = [f"`{name.replace('_', ' ')}`" for name in relevant if name in failed]
    if not error.confirmed and reference.gyro_jumps:
        found.append("the gyro's bias, which jumps,")
    return " and ".join(found)


def is_mounted_turned(onboard: Array, own: Array) -> bool:
    """Return whether a constant rotation explains the tilt difference of attitudes (n, 4)."""
    down = np.array([0.0, 0.0, 1.0])
    a, b = (rotation.rotate_inverse(q, down) for q in (own, onboard))
    turn = rotation.nearest_rotation(b.T @ a)
    left, whole = (float(median(np.sum((b - x) ** 2, axis=1))) for x in (a @ turn.T, a))
    return left < MAX_MOUNTING_LEFT**2 * whole


# Angle of the onboard attitude that is wrong in flight.

# Checks that prove a wrong angle, in order of increasing assumptions.
PROOFS = (HEADING_BY_GNSS, AGAINST_TRUTH, AGAINST_SMOOTHER)


def wrong_angle(checks: Iterable[Check]) -> WrongAngle | None:
    """Return the wrong angle with size and time; None where no check proves one."""
    checks = list(checks)
    faults = {check.question: check for check in checks if check.question in PROOFS and check.verdict == "fault"}
    for name in PROOFS:
        check = faults.get(name)
        if check is not None and check.value is not None and check.t is not None:
            angle = "heading" if name == HEADING_BY_GNSS else check.about
            why = _heading_cause(checks) if angle == "heading" else ""
            return WrongAngle(angle, float(check.value), check.t, check.t if check.t_end is None else check.t_end, why)
    return None


def _heading_cause(checks: Sequence[Check]) -> str:
    """Return what made the heading wrong as a phrase: the estimator, or the mounting of the compass in use."""
    if left_by_estimator(checks):
        return "the estimator diverged from its compass"
    turned = any(c.question == "compass_orientation" and c.verdict == "fault" and c.in_use for c in checks)
    return "wrong compass orientation" if turned else ""


# Jumps of the onboard attitude: yaw realignments, resets and lane switches, with their size.

# Smaller jumps are normal; from 15 deg a flight in position hold goes astray.
MIN_JUMP_DEG, LARGE_JUMP_DEG = 3.0, 15.0
JUMP_LIMIT = f"ok up to {MIN_JUMP_DEG:.0f} deg, fault above {LARGE_JUMP_DEG:.0f} deg in flight"
# Without logged arming, steps within this time of the first attitude are its alignment.
ALIGNMENT_S = 15.0
# Maximum number of jumps listed in a sentence.
MAX_SHOWN_JUMPS = 4
# Minimum share about the vertical for a heading jump.
YAW_SHARE = 0.9
# Time compared with truth or smoother before and after a jump. One side is right if its error is at most 40 % of the
# other's, and the other's is at least half of the jump.
AROUND_JUMP_S, MAX_ERROR_LEFT, MIN_ERROR_SHARE = 3.0, 0.4, 0.5
# Time by which a record of the switch, at 10 Hz, may come later than the jump.
SWITCH_LATE_S = 0.11
SWITCH_ADVICE = "Compare the IMU that was left with the others: vibration, bias and temperature."


def jump_checks(case: HealthCase) -> list[Check]:
    """Check resets of the onboard attitude while armed or in the air.

    Truth or smoother show on which side of the largest jump the attitude was right.
    """
    log, segments, reference = case.log, case.segments, case.reference
    attitude, imu = log.onboard_attitude, log.replay_imu
    if attitude is None or imu is None:
        return []
    made = partial(Check, "attitude_jumps", unit="deg", threshold=JUMP_LIMIT)
    index, _ = increments.known_resets(log, log.onboard or "", segments)
    stamps = attitude.t[index]
    index = index[jumps_in_use(stamps, float(attitude.t[0]), segments) & before_crashes(segments, stamps)]
    sizes = increments.unexplained_deg(attitude, imu) if len(index) else None
    if sizes is None:
        return [made("ok", f"{log.onboard} never jumps while in use.", value=0.0)]
    size = sizes[0][index - 1]
    large = np.isfinite(size) & (size > MIN_JUMP_DEG)
    if not large.any():
        largest = float(np.nanmax(size)) if np.isfinite(size).any() else 0.0
        return [made("ok", f"{log.onboard} jumps by {largest:.1f} deg at most.", value=round(largest, 1))]
    t, size, index = attitude.t[index[large]], size[large], index[large]
    order = np.argsort(-size, kind="stable")
    shown = ", ".join(f"{size[k]:.1f} deg at {t[k]:.1f} s" for k in sorted(order[:MAX_SHOWN_JUMPS].tolist()))
    more = f" and {len(t) - MAX_SHOWN_JUMPS} smaller ones" if len(t) > MAX_SHOWN_JUMPS else ""
    step = rotation.to_rotvec(rotation.multiply(attitude.q[index], rotation.conjugate(attitude.q[index - 1])))
    heading = bool((np.abs(step[:, 2]) > YAW_SHARE * rotation.length(step)).all())
    times = "once" if len(t) == 1 else f"{len(t)} times"
    text = f"The onboard {'heading' if heading else 'attitude'} jumped {times}: {shown}{more}."
    serious = bool((size[segments.mask(t, "airborne")] > LARGE_JUMP_DEG).any())
    check = made("fault" if serious else "warning", text, value=round(float(size.max()), 1), t=float(t[0]))
    check.t_end, check.count = float(t[-1]) if len(t) > 1 else None, len(t)
    switches = [switch_before(log, float(at)) for at in t]
    check.about = "heading" if heading else "tilt"
    if all(switches):
        check.about, check.cause, check.action = "", switches[0], SWITCH_ADVICE
    side = right_side(log, reference, int(index[order[0]]), heading, float(size[order[0]]))
    check.evidence = [side] if side else []
    return [check]


def switch_before(log: FlightLog, t: float) -> str:
    """Return a sentence on the switch of IMU or lane that explains a jump at ``t``, empty without one."""
    for what, line in (("IMU", log.imu_that_flew), ("lane", log.estimator.lane)):
        if line is None:
            continue
        for k in np.flatnonzero((t - SWITCH_S <= line.t) & (line.t <= t + SWITCH_LATE_S)).tolist():
            if k and line.value[k] != line.value[k - 1]:
                return (
                    f"The estimator switched from {what} {line.value[k - 1]} to {line.value[k]} at {line.t[k]:.1f} s."
                )
    return ""


def right_side(log: FlightLog, reference: Reference | None, k: int, heading: bool, size: float) -> str:
    """Return a sentence on the error before and after the jump to sample ``k``.

    Empty where the reference does not clearly favour one side.
    """
    attitude = log.onboard_attitude
    if reference is None or attitude is None or reference.kind not in ("truth", "smoother"):
        return ""
    if heading and reference.heading.by != "own":
        return ""
    errors = []
    for a, b in ((attitude.t[k] - AROUND_JUMP_S, attitude.t[k - 1]), (attitude.t[k], attitude.t[k] + AROUND_JUMP_S)):
        i, j = np.searchsorted(attitude.t, [a, b], side="left")
        tilt, turned = differences_deg(reference, attitude.t[i : j + 1], attitude.q[i : j + 1])
        off = np.abs(turned if heading else tilt)
        errors.append(float(nanmedian(off)) if np.isfinite(off).any() else np.nan)
    before, after = errors
    whom = REFERENCE_NAMES[reference.kind]
    if not np.isfinite(before + after) or max(before, after) < MIN_ERROR_SHARE * size:
        return ""
    if after < MAX_ERROR_LEFT * before:
        return f"Before the jump at {attitude.t[k]:.1f} s it was {before:.0f} deg off {whom}, then {after:.0f} deg."
    if before < MAX_ERROR_LEFT * after:
        return f"The jump at {attitude.t[k]:.1f} s set it wrong: {before:.0f} deg off {whom} before, then {after:.0f}."
    return ""


def jumps_in_use(t: Array, start: float, segments: Segments) -> NDArray[np.bool_]:
    """Mark times (k,) armed or airborne; without arming, 15 s after the first attitude."""
    if "armed" in segments.unknown:
        later: NDArray[np.bool_] = t > start + ALIGNMENT_S
        return later | segments.mask(t, "airborne")
    used: NDArray[np.bool_] = segments.mask(t, "armed") | segments.mask(t, "airborne")
    return used


# Loss of control and impact.

CRASH_LIMIT = "ok: no tilt beyond 90 deg that ends on the ground, no impact above 4 g after which it lies or tumbles"


def crash_checks(case: HealthCase) -> list[Check]:
    """Check for crashes and loss of control; unknown where the IMU is too slow."""
    log, segments = case.log, case.segments
    if not log.imus:
        return []
    lost, impacts = segments.of("loss_of_control"), segments.of("impact")
    if not lost and not impacts:
        return [_no_crash(log, segments)]
    before = [x for x in lost if not impacts or x.t0 <= impacts[0].t0]  # a wreck that rolls over is no loss of control
    first, what = (before[0], "Control was lost") if before else (impacts[0], _crash_text(segments, impacts[0].t0))
    times = f" {len(before)} times" if len(before) > 1 else ""
    text = f"{what}{times}{', first' if times else ''} at {first.t0:.1f} s: {first.why}."
    if not impacts:
        after = "It flew again: what follows is compared too."
    elif before and impacts[0].t0 > before[-1].t1:
        after = f"It flew again until an impact at {impacts[0].t0:.1f} s, after which nothing is compared."
    else:
        after = f"Nothing is compared after {impacts[0].t0:.1f} s."
    count = max(len(before), 1)
    return [Check("crash", "fault", text, float(count), "", CRASH_LIMIT, t=first.t0, count=count, evidence=[after])]


def _crash_text(segments: Segments, t: float) -> str:
    """Return how the crash at ``t`` s began, ``An impact`` where unknown."""
    first = next((e for e in segments.crash_events if e.is_crash and abs(e.t - t) < 1.0), None)
    kinds = {"impact": "An impact", "overturn": "It turned over", "tumble": "It tumbled"}
    return "An impact" if first is None else kinds.get(first.kind, "An impact")


def _no_crash(log: FlightLog, segments: Segments) -> Check:
    """Return the check without a crash: ok, or unknown where the IMU is too slow or the rules were not applied."""
    if not log.kind.flies:
        return unknown("crash", f"Only flights are searched for crashes; a {log.vehicle} does not fly.", CRASH_LIMIT)
    if "airborne" in segments.unknown or (segments.air is not None and not segments.air.known):
        return unknown("crash", "No sensor in the log shows whether it flew.", CRASH_LIMIT)
    driven = segments.of("airborne") or segments.of("armed")
    if not driven or shows_impacts(log):
        return Check("crash", "ok", "No loss of control and no impact.", 0.0, "", CRASH_LIMIT)
    rate = max((imu.acc.rate for imu in log.imus), default=0.0)
    if not rate:
        return unknown("crash", "No IMU is logged: an impact would not show.", CRASH_LIMIT)
    blind = f"an impact shorter than {1000.0 / rate:.0f} ms would not show"
    return unknown("crash", f"IMU at {rate:.0f} Hz: nothing turned it over; {blind}.", CRASH_LIMIT)
