"""Compass: dead, size and direction of its field, declination, offset, motors, soft iron, and the better one."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from attlog.core import rotation
from attlog.core.sorting import median, quantile
from attlog.core.spans import Span, inside
from attlog.flight import compass
from attlog.flight.calibration import FIRST_COMPASS, compass_switches, px4_slot_in_use
from attlog.flight.model import Array, Attitude, FlightLog, Mag
from attlog.flight.parameters import looks_up_declination
from attlog.health import settings as parameters
from attlog.health import timing
from attlog.health.check import Check, HealthCase, Setting, Verdict, graded, unknown
from attlog.health.compass_mounting import without_explained
from attlog.health.compass_offset import (
    HUBER,
    MAX_HEADING_ERROR_DEG,
    MAX_UNCERTAINTY_UT,
    OFFSET_LIMIT,
    OFFSET_SIGMAS,
    OFFSET_SOURCE,
    CompassStudy,
    HeadingProof,
    axes_with_interval,
    compass_studies,
    heading_error,
    offset_check,
    reason_unsound,
    rms_deg,
)
from attlog.health.compass_power import MOVE_ADVICE, interference_check
from attlog.health.compass_turn import STANDARD_ERRORS, turn_checks
from attlog.health.flown import flight_before_crash, samples_in_use
from attlog.health.gravity import imu_attitude
from attlog.health.regression import robust_fit
from attlog.reference import alignment, scoring
from attlog.segments import increments
from attlog.segments.model import Segments

# Plausible field strength: 22 to 67 uT on earth, with margin for iron in the vehicle.
STRENGTH_UT = (15.0, 90.0)
STRENGTH_LIMIT = "ok within 20 % of the model and varying up to 10 %; fault outside 15 to 90 uT"
# Maximum deviation from the model, and maximum spread, as residuals of calibration, iron and currents.
MODEL_SHARE, VARYING_SHARE = 0.2, 0.1
# Minimum samples and time for a spread.
MIN_STRENGTH_SAMPLES, MIN_STRENGTH_S = 10, 8.0
# Time excluded after the start of the attitude, whose heading is not yet aligned: sound compasses spread by 20 to 92
# deg there.
ALIGNED_S = 5.0
# Standard deviations between the 5th and the 95th percentile of a normal distribution.
MIDDLE_SIGMAS = 3.29
# Maximum turn rate: above it a compass delay of 50 ms is 3 deg.
FAST_DPS = 60.0
# Streams slower than SLOW_HZ are used only at turn rates below SLOW_DPS, because times of field and attitude differ.
SLOW_HZ, SLOW_DPS = 8.0, 15.0
# Limits of the spread of the field's direction in earth axes.
STEADY_DEG, UNSTEADY_DEG = 5.0, 20.0
# Limits of the difference between measured and model declination, doubled below SLOW_HZ.
NORTH_OFF_DEG, NORTH_FAR_DEG = 4.0, 15.0


def field_checks(case: HealthCase) -> list[Check]:
    """Check for dead compasses; check size, steadiness and declination of the one in use."""
    log, segments = case.log, case.segments
    if not log.mags:
        return [unknown("field", "There is no magnetometer data in this log.", "15 to 90 uT")]
    # A compass may share an IMU's record (MAVLink RAW_IMU).
    shared = {imu.gyro.source for imu in log.imus}
    names = [f"The compass of {s}" if s in shared else s for s in (mag.field.source for mag in log.mags)]
    offsets = {problem.source for problem in log.problems if problem.code == "mag_only_offsets"}  # reported already
    dead = [
        Check("compass_dead", "fault", f"{name}: {reason}.", threshold="must follow the field")
        for m, name in zip(log.mags, names, strict=True)
        if m.field.source not in offsets and (reason := compass.dead_reason(m, log.replay_imu))
    ]
    if log.mag is None:
        return [*dead, unknown("field", "No usable magnetometer in this log.", "15 to 90 uT")]
    frozen = timing.frozen_compass(log)
    if frozen:
        why = f"The compass stops at {frozen[0][0]:.1f} s: its field says nothing from there on."
        direction = [unknown(name, why) for name in ("field_against_attitude", "declination")]
    else:
        direction = field_direction(log, segments)
    return without_explained(case, [*dead, field_strength(log, segments), *direction])


def field_strength(log: FlightLog, segments: Segments) -> Check:
    """Check field strength of the compass in use against the world magnetic model."""
    mag = log.mags[log.mag or 0]
    norm = np.sqrt(np.nansum(mag.field.x**2, axis=1)) * 1e6
    used = (norm > 0) & samples_in_use(log, segments, mag.field.t_best)
    t = mag.field.t_best[used]
    if len(t) < MIN_STRENGTH_SAMPLES or (len(t) - 1) * float(median(np.diff(t))) < MIN_STRENGTH_S:
        return unknown("field", f"{mag.field.source} measured for less than {MIN_STRENGTH_S:.0f} s in use.")
    norm = norm[used]
    value, spread = float(median(norm)), float(np.std(norm) / median(norm))
    model = alignment.earth_field(log)
    text = f"{mag.field.source} reads {value:.1f} uT, varying by {100 * spread:.0f} %"
    outside = not STRENGTH_UT[0] <= value <= STRENGTH_UT[1]
    off = spread > VARYING_SHARE or not mag.calibrated
    if model is not None:
        expected = model.strength_t * 1e6
        text += f"; the earth has {expected:.1f} uT there"
        off = off or abs(value / expected - 1) > MODEL_SHARE
    elif outside:
        text += "; the earth has 22 to 67 uT anywhere"
    if not mag.calibrated:
        text += "; uncalibrated"
    verdict: Verdict = "fault" if outside else "warning" if off else "ok"
    return Check("field", verdict, text + ".", round(value, 2), "uT", STRENGTH_LIMIT)


def field_direction(log: FlightLog, segments: Segments) -> list[Check]:
    """Check steadiness and declination of the horizontal field in earth axes.

    The field is rotated by truth or the onboard attitude. Samples count in flight, after the attitude's alignment, in
    turns slow enough for both sample rates.
    """
    limit = f"ok up to {STEADY_DEG:.0f} deg, twice that below {SLOW_HZ:.0f} Hz, fault above {UNSTEADY_DEG:.0f} deg"
    truth = log.truth_with_north
    name, attitude = ("truth", truth) if truth is not None else (log.onboard, log.onboard_attitude)
    if attitude is None:
        return [unknown("field_against_attitude", "There is no attitude to rotate the field by.", limit)]
    q = attitude.q if name == "truth" else imu_attitude(log, attitude)
    field = log.mags[log.mag or 0].field
    turned = rotation.slerp(attitude.t, q, field.t_best)
    good = rotation.finite_rows(turned) & rotation.finite_rows(field.x) & samples_in_use(log, segments, field.t_best)
    good &= field.t_best >= alignment_time(log, attitude, segments)
    slow = min(field.rate, attitude.rate) < SLOW_HZ
    good &= turning_dps(attitude.t, q, field.t_best) < (SLOW_DPS if slow else FAST_DPS)
    if good.sum() < MIN_STRENGTH_SAMPLES:
        why = f"{name} covers {good.sum()} magnetometer samples only, at slow turns."
        return [unknown("field_against_attitude", why, limit)]
    north = rotation.rotate(turned[good], field.x[good])
    azimuth, spread = circular_mean(np.arctan2(north[:, 1], north[:, 0]))
    model = alignment.earth_field(log)
    off = azimuth if model is None else float(np.degrees(rotation.wrap(np.radians(azimuth - model.declination_deg))))
    whose = "the true" if name == "truth" else f"{name}'s"
    less = "" if model is None else f", less the declination of {model.declination_deg:.1f} deg,"
    text = f"The field's north lies {off:.1f} deg from {whose} north{less} and varies by {spread:.1f} deg (1 sigma)."
    verdict = graded(spread, STEADY_DEG * (2.0 if slow else 1.0), UNSTEADY_DEG)
    found = [Check("field_against_attitude", verdict, text, round(spread, 2), "deg", limit)]
    within = NORTH_OFF_DEG * (2.0 if slow else 1.0)
    limit = f"ok within {within:.0f} deg of the model, fault above {NORTH_FAR_DEG:.0f} deg"
    if model is None:
        return [*found, unknown("declination", "There is no GNSS position, so no declination to compare with.", limit)]
    if max(UNSTEADY_DEG, abs(off)) < spread:
        return [*found, unknown("declination", "The field varies too much to determine a declination.", limit)]
    text = f"The field's north lies {azimuth:.1f} deg from {whose} north; "
    text += f"the model says {model.declination_deg:.1f} deg."
    found.append(Check("declination", graded(abs(off), within, NORTH_FAR_DEG), text, round(azimuth, 2), "deg", limit))
    return found


def alignment_time(log: FlightLog, attitude: Attitude, segments: Segments) -> float:
    """Return the alignment time in s: last jump before flight, at least ALIGNED_S."""
    if attitude is log.truth:
        return -np.inf
    index, _ = increments.known_resets(log, log.onboard or "", segments)
    jumped = scoring.aligned_at(attitude, index, segments)
    began = float(attitude.t[0]) + ALIGNED_S
    return began if jumped is None else max(jumped, began)


def turning_dps(t: Array, q: Array, at: Array) -> Array:
    """Return turn rates (n,) in deg/s of an attitude at times ``at``; infinite outside it."""
    if len(t) < 2:
        return np.full(len(at), np.inf)
    rate = np.degrees(rotation.length(rotation.increments(q))) / np.maximum(np.diff(t), 1e-6)
    k = np.searchsorted(t, at) - 1
    around = [rate[np.clip(k + j, 0, len(rate) - 1)] for j in (-1, 0, 1)]
    return np.where((at >= t[0]) & (at <= t[-1]), np.maximum.reduce(around), np.inf)


def circular_mean(angle: Array) -> tuple[float, float]:
    """Return circular mean and standard deviation in deg of angles (n,) in rad.

    The deviation is from the middle 90 %: the tails come from turns, through the compass delay.
    """
    mean = float(np.angle(np.mean(np.exp(1j * angle))))
    low, high = quantile(np.degrees(rotation.wrap(angle - mean)), [0.05, 0.95])
    return float(np.degrees(mean)), float(high - low) / MIDDLE_SIGMAS


def declination_checks(case: HealthCase) -> list[Check]:
    """Check the declination parameter against the world magnetic model."""
    log = case.log
    given, model = log.parameters.declination, alignment.earth_field(log)
    if given is None or model is None or looks_up_declination(log):
        return []
    off = abs(float(np.degrees(rotation.wrap(np.radians(given - model.declination_deg)))))
    text = f"{log.parameters.declination_source} says {given:.1f} deg; the model says {model.declination_deg:.1f} deg."
    limit = f"ok within {NORTH_OFF_DEG:.0f} deg of the model, fault above {NORTH_FAR_DEG:.0f} deg"
    verdict = graded(off, NORTH_OFF_DEG, NORTH_FAR_DEG)
    return [Check("declination_set", verdict, text, round(given, 2), "deg", limit)]


# Field of the motors from two points, ground and air: regression on power in flight was too uncertain on 64 real logs.
# Local disturbances on the ground (steel, a car) have the same effect, so the fields before take-off and after landing
# must agree, and the heading in flight must improve.

# Maximum motor field as a share of the earth's horizontal field (ardupilot.org, "Magnetic Interference").
MOTORS_FAR_SHARE = 0.3
MOTORS_LIMIT = "ok where ground and air agree within 4 sigma or 2 uT, fault above 30 % of the horizontal field"
MOTORS_SOURCE = "ground against air, two points; 30 %: ardupilot.org, Magnetic Interference"


def motor_check(case: HealthCase, study: CompassStudy) -> Check:
    """Check the field that the motors add to one compass, and offer its compensation."""
    samples, ground, found = study.samples, study.ground, study.motors
    made = partial(Check, "compass_motors", sensor=samples.source, threshold=MOTORS_LIMIT, source=MOTORS_SOURCE)
    if ground is None:
        why = "No field on the ground with motors off is logged, so their own field is unknown."
        return made("unknown", f"{why} {case.log.advice('rest')}".strip())
    added, sigma = study.air.offset - ground.offset, np.hypot(study.air.sigma, ground.sigma)
    size = float(np.linalg.norm(added))
    level = float(np.hypot(added[0], added[1])) / max(float(np.hypot(samples.earth[0], samples.earth[1])), 1e-9)
    verdict: Verdict = "fault" if level > MOTORS_FAR_SHARE else "warning"
    if not study.ground_differs:
        verdict = "unknown" if OFFSET_SIGMAS * float(sigma.max()) > MAX_UNCERTAINTY_UT else "ok"
    text = f"In flight {samples.source} reads {axes_with_interval(added, sigma)} uT more in x, y, z than on the ground"
    check = made(verdict, f"{text}{_at_power(study)}.", unit="uT", evidence=_motor_evidence(study))
    check.n, check.seconds = study.air.n + ground.n, round(samples.seconds, 1)
    size_sigma = float(np.linalg.norm(sigma * added)) / max(size, 1e-9)
    check.measure(size, size_sigma, 1, least=0.0).measure_axes(added, sigma, 2)
    if study.ground_differs:
        check.why_no_setting = motors_refusal(study)
        # A horizontal field turns the heading, unless its removal makes it worse.
        proof = study.motor_proof
        turns = study.ground_differs_along[:2].any() and (proof is None or proof.after < proof.before)
        if not reason_unsound(study) and turns:
            check.action = MOVE_ADVICE
        if found is not None and not check.why_no_setting:
            offer = parameters.compass_proposal(
                case.log, samples.mag, 1e-6 * found.offset, 1e-6 * found.per_unit, samples.power_kind
            )
            check.settings, check.why_no_setting = offer.settings, offer.refused
            if offer.refused and study.motor_proof is not None:
                promised = _promised_error(samples.source, study.motor_proof)
                check.action = f"{offer.refused} Run attlog health again: {promised}"
    return check


def _promised_error(source: str, proof: HeadingProof) -> str:
    return f"compensated for the motors, {source} would err by {proof.after:.0f} deg instead of {proof.before:.0f}."


def motor_advice(checks: Sequence[Check], studies: Sequence[CompassStudy]) -> list[Check]:
    """Return the motor checks; those without compensation advise the best compensated compass."""
    proven = [(c, s) for c, s in zip(checks, studies, strict=True) if c.action and s.motors and not motors_refusal(s)]
    if not proven:
        return list(checks)
    best, study = min(proven, key=lambda pair: pair[1].motor_proof.after if pair[1].motor_proof else np.inf)
    if study.motor_proof is None or study.motor_proof.after >= min(s.proof.before for s in studies):
        return list(checks)
    first = best.action
    if best.settings:
        first = f"Set the values of {best.sensor}: {_promised_error(best.sensor, study.motor_proof)}"
    return [
        replace(c, action=f"{first} Then use {best.sensor}.", other_compass=best.sensor)
        if c.action and motors_refusal(s)
        else c
        for c, s in zip(checks, studies, strict=True)
    ]


def motors_refusal(study: CompassStudy) -> str:
    """Return why no motor compensation is offered; empty where it is."""
    if why := reason_unsound(study):
        return why
    if study.motors is None:
        return "The log holds no current and no throttle that the field could follow."
    if study.before is None or study.after is None:
        missing = "before take-off" if study.before is None else "after landing"
        return f"The ground {missing} is not logged: motors or the place bend the field. Stay there 20 s, logging."
    if not study.ground_repeats:
        return "The ground before take-off and after landing differ: it is the field of the motors or of the place."
    if not study.follows_motors:
        return "A compensation does not improve the heading enough in the half that it was not fitted to."
    return ""


def _at_power(study: CompassStudy) -> str:
    if study.motors is None:
        return ""
    power = study.motors.power
    return f", at {power:.3g} A" if study.samples.power_kind == "current" else f", at {100 * power:.0f} % of throttle"


def _motor_evidence(study: CompassStudy) -> list[str]:
    found, evidence = study.motors, []
    if found is not None and study.ground_differs:
        unit = "uT per ampere" if study.samples.power_kind == "current" else "uT at full throttle"
        shown = ", ".join(f"{x:.3g}" for x in found.per_unit)
        evidence.append(f"That is {shown} {unit} in x, y, z.")
    if study.motor_proof is not None and study.ground_differs:
        evidence.append(study.motor_proof.sentence)
    if study.before is not None and study.after is not None:
        apart = float(np.linalg.norm(study.before.offset - study.after.offset))
        evidence.append(f"Before take-off and after landing the ground differs by {apart:.1f} uT.")
    return evidence


# Soft iron is only reported: a flight determines it too roughly for parameters. Horizontal model
# ``m = (1 + s) u + a (u_x, -u_y) + b (u_y, u_x) + w (u_y, -u_x) + o`` with scale s, rotation w and offset o. a and b
# describe the soft-iron ellipse; their heading error is up to hypot(a, b) rad, with two periods in a full turn.

# Limit of the ellipse (0.1 is a heading error of 6 deg), and its significance.
SOFT_IRON_OFF, SOFT_IRON_SIGMAS = 0.1, 4.0
# Error from the attitude, added to that of the fit: without it 22 of 39 sound compasses fail.
SOFT_IRON_FLOOR = 0.015
# Minimum range of field directions in body axes, 5th to 95th percentile.
MIN_FIELD_TURN_DEG = 60.0
SOFT_IRON_LIMIT = f"ok up to {100 * SOFT_IRON_OFF:.0f} % or {SOFT_IRON_SIGMAS:.0f} sigma"
SOFT_IRON_ADVICE = (
    "A flight shows soft iron too roughly to set it: calibrate the compass on the ground, in all directions."
)


def soft_iron_check(study: CompassStudy) -> Check:
    """Check the ellipse of the horizontal field in the axes of one compass."""
    samples = study.samples
    made = partial(Check, "soft_iron", sensor=samples.source, threshold=SOFT_IRON_LIMIT)
    t, u, m = samples.t[samples.air], samples.expected[samples.air], samples.measured[samples.air]
    x, y = u[:, 0], u[:, 1]
    angle = np.arctan2(y, x)
    middle = np.angle(np.mean(np.exp(1j * angle)))
    low, high = quantile((angle - middle + np.pi) % (2.0 * np.pi), [0.05, 0.95])
    turned = float(np.degrees(high - low))
    if turned < MIN_FIELD_TURN_DEG:
        return made("unknown", f"The flight turns by {turned:.0f} deg: soft iron needs {MIN_FIELD_TURN_DEG:.0f} deg.")
    one, none = np.ones(len(t)), np.zeros(len(t))
    columns = np.stack([np.column_stack([x, x, y, y, one, none]), np.column_stack([y, -y, x, -x, none, one])], axis=1)
    found = robust_fit(t, columns, m[:, :2] - u[:, :2], huber=HUBER)
    if found is None:
        return made("unknown", f"The flight does not show the soft iron of {samples.source}.")
    size = math.hypot(found.x[1], found.x[2])
    sigma = math.hypot(STANDARD_ERRORS * float(found.sigma[1:3].max()), SOFT_IRON_FLOOR)
    if SOFT_IRON_SIGMAS * sigma > 2.0 * SOFT_IRON_OFF and size <= SOFT_IRON_SIGMAS * sigma:
        why = f"Soft iron of {samples.source} is known to {196 * sigma:.0f} % only: the flight turns too little."
        return made("unknown", why)
    off = size > max(SOFT_IRON_OFF, SOFT_IRON_SIGMAS * sigma)
    text = f"Soft iron stretches the field of {samples.source} by {100 * size:.1f} ± {196 * sigma:.1f} %."
    check = made("warning" if off else "ok", text, unit="%", n=len(t), seconds=round(samples.seconds, 1))
    check.why_no_setting = SOFT_IRON_ADVICE if off else ""
    check.evidence = [f"The heading swings by {math.degrees(size):.1f} deg, twice in each turn."]
    return check.measure(100.0 * size, 100.0 * sigma, 1, least=0.0)


# Comparison of compasses by heading error, else by field strength.

# Field strength of a sound compass: within CLOSE_SHARE of the earth's with a variation below STEADY_SHARE; an unsound
# one is off by more than OFF_SHARE.
CLOSE_SHARE, STEADY_SHARE, OFF_SHARE = 0.1, 0.1, 0.2
# A better compass has at most half the heading error, and 5 deg less, which exceeds attitude errors.
BETTER_SHARE, BETTER_DEG = 0.5, 5.0
CHOICE_LIMIT = (
    f"ok unless another is {BETTER_DEG:.0f} deg better and off by half as much, else by the field's size within 10 %"
)


def choice_checks(case: HealthCase, studies: Sequence[CompassStudy]) -> list[Check]:
    """Check whether another compass is better; nothing with fewer than two live ones."""
    log = case.log
    mags = [mag for mag in log.mags if not compass.dead_reason(mag, log.replay_imu)]
    flown = flight_before_crash(case.segments)
    if len(mags) < 2 or log.mag is None or not flown:
        return []
    used = log.mags[log.mag]
    own = next((s for s in studies if s.samples.mag is used), None)
    others = [s for s in studies if s.samples.mag is not used]
    if own is not None and others:
        return [_choice_by_heading(log, own, others)]
    return _choice_by_size(log, flown, used, [mag for mag in mags if mag is not used])


def _choice_by_heading(log: FlightLog, own: CompassStudy, others: Sequence[CompassStudy]) -> Check:
    errors = {id(study): _heading_errors(study) for study in (own, *others)}
    best = min(others, key=lambda study: errors[id(study)][0])
    now, then = errors[id(own)][0], errors[id(best)][0]
    better = then <= BETTER_SHARE * now and now - then >= BETTER_DEG
    one, two = best.samples.source, own.samples.source
    text = f"{two}, in use, is off by {now:.1f} deg in heading, {one} by {then:.1f} deg."
    shown = [_heading_line(study, *errors[id(study)]) for study in (own, *others)]
    check = Check("compass_choice", "warning" if better else "ok", text, round(then - now, 1), "deg", CHOICE_LIMIT)
    check.sensor, check.n, check.seconds, check.evidence = two, own.air.n, round(own.samples.seconds, 1), shown
    if better and then > MAX_HEADING_ERROR_DEG:
        check.why_no_setting = f"{one} is better, but off too: calibrate both."
    elif better:
        _offer_switch(log, check, best.samples.mag, own.samples.mag)
    return check


def _heading_errors(study: CompassStudy) -> tuple[float, float]:
    """Return the RMS heading error in deg as logged, and after removal of the fitted offset."""
    samples = study.samples
    q, field = samples.q[samples.air], samples.measured[samples.air]
    logged, fitted = (heading_error(q, field - o, samples.earth) for o in (np.zeros(3), study.air.offset))
    return rms_deg(logged), rms_deg(fitted)


def _heading_line(study: CompassStudy, logged: float, fitted: float) -> str:
    samples = study.samples
    size = float(median(np.linalg.norm(samples.measured[samples.air] - study.air.offset, axis=1)))
    earth = float(np.linalg.norm(samples.earth))
    return (
        f"{samples.source}: heading error {logged:.1f} deg, {fitted:.1f} deg without its offset of "
        f"{study.air.size:.1f} uT; then {size:.1f} of {earth:.1f} uT, residual {study.air.left_ut:.1f} uT."
    )


def _choice_by_size(log: FlightLog, flown: list[Span], used: Mag, others: Sequence[Mag]) -> list[Check]:
    """Compare field strengths with the earth's; needs no attitude."""
    model = alignment.earth_field(log)
    own_size, own_spread = _field_size(used, flown)
    if model is None or not np.isfinite(own_size):
        return []
    earth = 1e6 * model.strength_t
    seen = [(mag, *_field_size(mag, flown)) for mag in others]
    sound = [(m, size) for m, size, s in seen if abs(size / earth - 1.0) <= CLOSE_SHARE and s <= STEADY_SHARE]
    better = bool(sound) and abs(own_size / earth - 1.0) > OFF_SHARE
    other, size = sound[0] if sound else seen[0][:2]
    text = f"{used.field.source}, in use, reads {own_size:.1f} uT of {earth:.1f}, {other.field.source} {size:.1f} uT."
    check = Check("compass_choice", "warning" if better else "ok", text, threshold=CHOICE_LIMIT)
    check.sensor = used.field.source
    check.evidence = [
        f"{m.field.source} reads {s:.1f} uT, varying by {100 * v:.0f} %; the earth has {earth:.1f} uT."
        for m, s, v in ((used, own_size, own_spread), *seen)
    ]
    if better:
        _offer_switch(log, check, other, used)
    return [check]


def _field_size(mag: Mag, spans: list[Span]) -> tuple[float, float]:
    """Return the median field strength in uT and its relative standard deviation."""
    norm: Array = 1e6 * np.linalg.norm(mag.field.x[inside(mag.field.t_best, spans)], axis=1)
    norm = norm[np.isfinite(norm)]
    if not len(norm):
        return math.nan, math.nan
    size = float(median(norm))
    return size, float(np.std(norm)) / max(size, 1e-9)


def _offer_switch(log: FlightLog, check: Check, other: Mag, used: Mag) -> None:
    """Add the parameters that switch compasses to a check, else advice in words."""
    name, flown = _compass_name(log, other), _compass_name(log, used)
    # The firmware refuses to arm with a compass whose offsets are zero.
    if not other.calibrated or (other.offsets is not None and len(other.offsets.x) and not other.offsets.x.any()):
        check.why_no_setting = f"{name} was never calibrated: calibrate it first."
        check.action = f"Calibrate {name} and use it instead of {flown}."
        return
    if why := _switched_already(log, other):
        check.verdict, check.why_no_setting = "ok", f"{why}: nothing to set."
        return
    check.other_compass = other.field.source
    wanted = compass_switches(log.settings.values, other.index, used.index)
    check.settings = [Setting(n, log.param(n), value) for n, value in wanted.items() if log.param(n) != value]
    how = " and ".join(f"{setting.name} {setting.new:.0f}" for setting in check.settings)
    if not check.settings:
        how = _priority_words(log, other, used)
        check.why_no_setting = "No single parameter of this log switches a compass."
    check.action = f"Use {name} instead of {flown}: set {how}."


def _compass_name(log: FlightLog, mag: Mag) -> str:
    """Return the name of a compass for actions: in telemetry its number too, because a message is no compass."""
    source = mag.field.source
    return f"compass {mag.index + 1} ({source})" if log.format in ("tlog", "mavlink") else source


# Text of ArduPilot's EKF at a change of its compass.
SWITCH_TEXT = re.compile(r"switching to compass (\d)", re.IGNORECASE)


def _switched_already(log: FlightLog, other: Mag) -> str:
    """Return how the log itself changes to another compass, or empty."""
    switched = [(t, int(found[1])) for t, _, text in log.texts if (found := SWITCH_TEXT.search(text))]
    if switched and switched[-1][1] == other.index:
        return f"The EKF changed to {other.field.source} at {switched[-1][0]:.0f} s"
    line = log.parameters.lines.get(FIRST_COMPASS)
    if line is not None and len(line.value) > 1 and line.value[-1] == other.index:
        return f"{FIRST_COMPASS} was set to {other.index} at {line.t[-1]:.0f} s"
    return ""


def _priority_words(log: FlightLog, other: Mag, used: Mag) -> str:
    """Return the parameters that give a compass priority over another, in words where slots are unknown."""
    slots = [px4_slot_in_use(log.settings.values, mag.device) for mag in (other, used)]
    if log.firmware.name == "PX4" and None not in slots and slots[0] != slots[1]:
        return f"CAL_MAG{slots[0]}_PRIO 100 and CAL_MAG{slots[1]}_PRIO 50"
    if log.firmware.name == "ArduPilot":
        return f"compass {other.index + 1} first in the ground station's list of compasses"
    return "the priority of that compass higher"


def compass_checks(case: HealthCase) -> list[Check]:
    """Check offset, motor field and soft iron of each compass, and which is best.

    The attitude is from motion alone. For the compass in use the fallbacks are the reference's heading (offset) and the
    field strength (motors).
    """
    log = case.log
    if not log.mags:
        return []
    used = log.mags[log.mag or 0].field.source
    studies, why = compass_studies(case)
    # An unused compass has no effect; if it is the better one, the comparison reports its numbers.
    enabled = [study for study in studies if study.samples.mag.enabled] or studies
    checks = [offset_check(case, study) for study in enabled]
    checks += motor_advice([motor_check(case, study) for study in enabled], enabled)
    checks += [soft_iron_check(study) for study in enabled]
    if not studies:
        checks = [unknown("compass_offset", why, OFFSET_LIMIT, sensor=used, source=OFFSET_SOURCE)]
    for check in checks:
        if check.verdict == "fault" and check.sensor != used:
            check.verdict = "warning"
    checks = without_repeats(checks)
    coarse = turn_checks(case)
    if log.mag is not None:
        coarse.append(interference_check(log, case.segments, log.mags[log.mag]))
    for check in coarse:
        own = [c for c in checks if c.question == check.question and c.sensor == used]
        if not own:
            checks.append(check)
        elif own[0].verdict == "unknown" and check.verdict != "unknown":
            checks[checks.index(own[0])] = check
    return without_explained(case, [*checks, *choice_checks(case, studies)])


def without_repeats(checks: list[Check]) -> list[Check]:
    """Drop unknown checks that repeat the reason of another compass."""
    seen: set[str] = set()
    kept = []
    for check in checks:
        if check.verdict != "unknown" or check.text not in seen:
            kept.append(check)
        if check.verdict == "unknown":
            seen.add(check.text)
    return kept
