"""The magnetometer: alive, size of the field, and a field that stands still while the vehicle turns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from attlog.core import rotation
from attlog.core.spans import inside
from attlog.flight import compass
from attlog.flight.calibration import FIRST_COMPASS, compass_switches
from attlog.flight.model import Array, Attitude, FlightLog, Mag
from attlog.flight.parameters import looks_up_declination
from attlog.health import settings as parameters
from attlog.health import timing
from attlog.health.check import Check, HealthCase, Setting, Verdict, graded, unknown
from attlog.health.compass_fit import (
    COMPASS_HUBER,
    MIN_OFFSET_UT,
    MOVE_ADVICE,
    OFFSET_SIGMAS,
    STANDARD_ERRORS,
    CompassStudy,
    HeadingProof,
    compass_error_checks,
    compass_flight_spans,
    compass_studies,
    heading_error,
    interference_check,
    rms_deg,
)
from attlog.health.flown import samples_in_use
from attlog.health.gravity import imu_attitude
from attlog.health.regression import robust_fit
from attlog.reference import alignment, scoring
from attlog.segments import resets
from attlog.segments.model import Segments

STRENGTH_UT = (15.0, 90.0)
"""Outside this no place on earth lies: 22 to 67 uT with room for an iron vehicle."""

MIN_STRENGTH_SAMPLES, MIN_STRENGTH_S = 10, 8.0
"""Fewer samples, or seconds of them, tell no size."""
ALIGNED_S = 5.0
"""In its first seconds an onboard heading may lie anywhere: there sound compasses spread by 20 to 92 deg."""
MIDDLE_SIGMAS = 3.29
"""Standard deviations between the 5th and the 95th percentile of a normal distribution."""
FAST_DPS = 60.0
"""Faster turns are left out: 50 ms between a field and its stamp are 3 deg then, and no fault of the compass."""
SLOW_HZ, SLOW_DPS = 8.0, 15.0
"""Below this rate field and attitude are not of one moment, unless the vehicle turns slower than that."""
STEADY_DEG, UNSTEADY_DEG = 5.0, 20.0
"""How much the direction of the field may vary in earth axes; beyond the second a mean within it tells none."""

NORTH_OFF_DEG, NORTH_FAR_DEG = 4.0, 15.0
"""How far the field's north may lie from the model's, twice that below SLOW_HZ; beyond the second compass or heading is
wrong."""


def field_checks(case: HealthCase) -> list[Check]:
    """Field strength, steadiness in earth axes, declination."""
    log, segments = case.log, case.segments
    if not log.mags:
        return [unknown("field", "There is no magnetometer data in this log.", "15 to 90 uT")]
    found = [
        Check(
            "compass_dead",
            "fault",
            f"{_compass_name(log, m.field.source)}: {reason}.",
            threshold="must follow the field",
        )
        for m in log.mags
        if (reason := compass.dead_reason(m, log.replay_imu))
    ]
    if log.mag is None:
        return [*found, unknown("field", "No usable magnetometer in this log.", "15 to 90 uT")]
    held = timing.frozen_compass(log)
    if held:
        why = f"The compass stops at {held[0][0]:.1f} s: its field says nothing from there on."
        return [
            *found,
            field_strength(log, segments),
            *(unknown(name, why) for name in ("field_against_attitude", "declination")),
        ]
    return [*found, field_strength(log, segments), *field_direction(log, segments)]


def field_strength(log: FlightLog, segments: Segments) -> Check:
    """The size of the field against the world magnetic model, and how much it varies, while the vehicle is in use."""
    mag = log.mags[log.mag or 0]
    norm = np.sqrt(np.nansum(mag.field.x**2, axis=1)) * 1e6
    used = (norm > 0) & samples_in_use(log, segments, mag.field.t_best)
    t = mag.field.t_best[used]
    if len(t) < MIN_STRENGTH_SAMPLES or (len(t) - 1) * float(np.median(np.diff(t))) < MIN_STRENGTH_S:
        return unknown("field", f"{mag.field.source} measured for less than {MIN_STRENGTH_S:.0f} s in use.")
    norm = norm[used]
    value, spread = float(np.median(norm)), float(np.std(norm) / np.median(norm))
    model = alignment.earth_field(log)
    text = f"{mag.field.source} reads {value:.1f} uT, varying by {100 * spread:.0f} %"
    verdict: Verdict = "ok" if STRENGTH_UT[0] <= value <= STRENGTH_UT[1] else "fault"
    limit = "ok within 20 % of the model and varying up to 10 %; fault outside 15 to 90 uT"
    if model is not None:
        expected = model.strength_t * 1e6
        text += f"; the earth has {expected:.1f} uT there"
        if verdict == "ok" and abs(value / expected - 1) > 0.2:
            verdict = "warning"
    elif verdict == "fault":
        text += "; the earth has 22 to 67 uT anywhere"
    if verdict == "ok" and spread > 0.1:
        verdict = "warning"
    if not mag.calibrated:
        verdict = "warning" if verdict == "ok" else verdict
        text += "; uncalibrated"
    return Check("field", verdict, text + ".", round(value, 2), "uT", limit)


def _compass_name(log: FlightLog, source: str) -> str:
    """A compass by its record, and as a compass where an IMU stands in the same record (RAW_IMU of MAVLink)."""
    return f"The compass of {source}" if any(imu.gyro.source == source for imu in log.imus) else source


def field_direction(log: FlightLog, segments: Segments) -> list[Check]:
    """Direction of the horizontal field, rotated by truth or the onboard attitude: steady, and the declination.

    From the attitude's own alignment on, in use: no wreck, not upside down, not the ground where something flew. Where
    field or attitude are slow they are not of one moment: only slow turns count there, and less strictly.
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
        said = f"{name} covers {good.sum()} magnetometer samples only, at slow turns."
        return [unknown("field_against_attitude", said, limit)]
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
    expected = f"the model says {model.declination_deg:.1f} deg"
    text = f"The field's north lies {azimuth:.1f} deg from {whose} north; {expected}."
    found.append(Check("declination", graded(abs(off), within, NORTH_FAR_DEG), text, round(azimuth, 2), "deg", limit))
    return found


def alignment_time(log: FlightLog, attitude: Attitude, segments: Segments) -> float:
    """When the attitude had its own heading, s: after its last jump before the flight, and ALIGNED_S from its start."""
    if attitude is log.truth:
        return -np.inf
    index, _ = resets.known_resets(log, log.onboard or "", segments)
    jumped = scoring.aligned_at(attitude, index, segments)
    began = float(attitude.t[0]) + ALIGNED_S
    return began if jumped is None else max(jumped, began)


def turning_dps(t: Array, q: Array, at: Array) -> Array:
    """How fast (n,) in deg/s an attitude (m, 4) at ``t`` (m,) turns around times ``at`` (n,); infinite beyond it."""
    if len(t) < 2:
        return np.full(len(at), np.inf)
    rate = np.degrees(rotation.length(rotation.increments(q))) / np.maximum(np.diff(t), 1e-6)
    k = np.searchsorted(t, at) - 1
    around = [rate[np.clip(k + j, 0, len(rate) - 1)] for j in (-1, 0, 1)]
    return np.where((at >= t[0]) & (at <= t[-1]), np.maximum.reduce(around), np.inf)


def circular_mean(angle: Array) -> tuple[float, float]:
    """Circular mean and standard deviation in deg of angles (n,) in rad, this by the middle 90 % of them.

    A twentieth at either end does not count: turns that the field's clock is late in.
    """
    mean = float(np.angle(np.mean(np.exp(1j * angle))))
    low, high = np.quantile(np.degrees(rotation.wrap(angle - mean)), [0.05, 0.95])
    return float(np.degrees(mean)), float(high - low) / MIDDLE_SIGMAS


# Was the autopilot told the right declination?

DECLINATION_LIMIT = "ok within 4 deg of the model, fault above 15 deg"


def declination_checks(case: HealthCase) -> list[Check]:
    """The parameter against the world magnetic model; nothing where it is not set or not used, or no place is known."""
    log = case.log
    told, model = log.parameters.declination, alignment.earth_field(log)
    if told is None or model is None or looks_up_declination(log):
        return []
    off = abs(float(np.degrees(rotation.wrap(np.radians(told - model.declination_deg)))))
    text = f"{log.parameters.declination_source} says {told:.1f} deg; the model says {model.declination_deg:.1f} deg."
    return [Check("declination_set", graded(off, 4.0, 15.0), text, round(told, 2), "deg", DECLINATION_LIMIT)]


# Is a compass off, and may its offset be set? One that was fitted in the air holds the motors' field as well.
#
# Pasted, such an offset has turned the heading on the ground, where the estimator takes its yaw, by up to 180 deg. So
# it
# is offered only where the ground shows the same, and where it improves the heading of the half it was not fitted to.

OFFSET_FAR_UT = 15.0
"""150 mG: the heading swings by 45 deg where the horizontal field is 20 uT."""
MAX_UNCERTAINTY_UT = 10.0
"""Four sigmas beyond this: nothing found is no answer."""
OFFSET_LIMIT = (
    f"ok up to {OFFSET_SIGMAS:.0f} sigma or {MIN_OFFSET_UT} uT, fault above {OFFSET_FAR_UT:.0f} uT horizontally"
)
OFFSET_SOURCE = "measured on 39 simulated flights with truth and 98 compasses"


def offset_check(case: HealthCase, study: CompassStudy) -> Check:
    """The offset of one compass in flight, with its total error, and what to set."""
    found, samples = study.air, study.samples
    verdict = _offset_verdict(study)
    answer = Check(
        "compass_offset",
        verdict,
        f"{samples.source} is off by {axes_with_interval(found.offset, found.sigma)} uT in x, y, z in flight.",
        sensor=samples.source,
        value=round(found.size, 1),
        unit="uT",
        ci95=(round(found.size_ci95[0], 1), round(found.size_ci95[1], 1)),
        vector=[round(float(x), 2) for x in found.offset],
        vector_ci95=[round(1.96 * float(s), 2) for s in found.sigma],
        n=found.n,
        seconds=round(samples.seconds, 1),
        threshold=OFFSET_LIMIT,
        source=OFFSET_SOURCE,
        evidence=_offset_evidence(study),
    )
    if verdict == "unknown":
        why = unsound_reason(study)
        answer.why_no_setting = (
            why or "The flight turns too little or its heading is too unsure. Fly turns and hard stops."
        )
    elif verdict != "ok":
        answer.why_no_setting = offset_refusal(case, study)
        if not answer.why_no_setting:
            offer = parameters.compass_proposal(case.log, samples.mag, 1e-6 * found.offset)
            answer.settings, answer.why_no_setting = offer.settings, offer.refused
    return answer


def offset_refusal(case: HealthCase, study: CompassStudy) -> str:
    """Why the offset of the flight is not to be set; empty where it may be."""
    advice = case.log.advice("rest")
    if why := unsound_reason(study):
        return why
    if study.ground is None:
        why = "No sample on the ground separates this offset from the motors' field."
        return f"{why} {advice}" if advice else why
    if study.ground_differs:
        return (
            f"On the ground it is off by {axes_with_interval(study.ground.offset, study.ground.sigma)} uT. "
            "The motors or the place bend the field, and this offset would be wrong on the ground."
        )
    if not study.ground_agrees:
        ground = axes_with_interval(study.ground.offset, study.ground.sigma)
        return f"The ground does not confirm it: off by {ground} uT there."
    if study.cause == "turn":
        return "A compass mounted askew would read the same: compare its orientation with the parameters."
    if study.cause == "neither":
        return "No constant offset explains the field in flight: motors or soft iron bend it."
    if not study.proof.holds:
        return "The offset does not improve the heading of the half that it was not fitted to."
    return ""


def unsound_reason(study: CompassStudy) -> str:
    """Why the field of the flight is not that of a constant offset of a calibrated compass; empty where it is."""
    if not study.samples.mag.calibrated:
        return "This compass was never calibrated: calibrate it on the ground."
    if not study.steady:
        return "The first half of the flight shows another offset than the second: none is constant."
    return ""


def _offset_verdict(study: CompassStudy) -> Verdict:
    found = study.air
    if found.counts:
        return "fault" if float(np.hypot(found.offset[0], found.offset[1])) > OFFSET_FAR_UT else "warning"
    return "unknown" if OFFSET_SIGMAS * float(found.sigma.max()) > MAX_UNCERTAINTY_UT else "ok"


def _offset_evidence(study: CompassStudy) -> list[str]:
    said = []
    for when, fit in (("before take-off", study.before), ("after landing", study.after)):
        if fit is not None:
            said.append(
                f"On the ground {when} it is off by {axes_with_interval(fit.offset, fit.sigma)} uT ({fit.n} samples)."
            )
    said.append(study.proof.sentence)
    heading = float(np.degrees(np.sqrt(np.mean(study.samples.sigma_heading[study.samples.air] ** 2))))
    said.append(f"The heading by motion alone is known to {heading:.1f} deg (1 sigma), in {study.air.blocks} blocks.")
    return said


def axes_with_interval(value: Array, sigma: Array) -> str:
    """Three numbers in words, each with half its 95 % interval."""
    return ", ".join(f"{v:.1f} ± {1.96 * s:.1f}" for v, s in zip(value, sigma, strict=True))


# Do the motors bend a compass's field, and by how much per ampere? Two points tell: the ground and the air.
#
# A regression over the power in flight was never sure enough on 64 real logs. What the place adds (steel in the
# ground, a
# car) goes with the ground as well: so the ground before take-off and after landing must agree, and the heading in
# flight must improve.

MOTORS_FAR_SHARE = 0.3
"""Of the earth's horizontal field: ardupilot.org, "Magnetic Interference", calls 30 % the limit."""
MOTORS_LIMIT = "ok where ground and air agree within 4 sigma or 2 uT, fault above 30 % of the horizontal field"
MOTORS_SOURCE = "ground against air, two points; 30 %: ardupilot.org, Magnetic Interference"


def motor_check(case: HealthCase, study: CompassStudy) -> Check:
    """What the motors add to one compass, by the ground and the air."""
    samples, ground, found = study.samples, study.ground, study.motors
    advice = case.log.advice("rest")
    if ground is None:
        why = "No field on the ground with motors off is logged, so their own field is unknown."
        return unknown(
            "compass_motors", f"{why} {advice}".strip(), MOTORS_LIMIT, sensor=samples.source, source=MOTORS_SOURCE
        )
    added, sigma = study.air.offset - ground.offset, np.hypot(study.air.sigma, ground.sigma)
    size = float(np.linalg.norm(added))
    half = 1.96 * float(np.linalg.norm(sigma * added)) / max(size, 1e-9)
    level = float(np.hypot(added[0], added[1])) / max(float(np.hypot(samples.earth[0], samples.earth[1])), 1e-9)
    agrees = not study.ground_differs
    unsure = agrees and OFFSET_SIGMAS * float(sigma.max()) > MAX_UNCERTAINTY_UT
    answer = Check(
        "compass_motors",
        "unknown" if unsure else "ok" if agrees else "fault" if level > MOTORS_FAR_SHARE else "warning",
        f"In flight {samples.source} reads {axes_with_interval(added, sigma)} uT more in x, y, z "
        f"than on the ground{_at_power(study)}.",
        sensor=samples.source,
        value=round(size, 1),
        unit="uT",
        ci95=(round(max(size - half, 0.0), 1), round(size + half, 1)),
        vector=[round(float(x), 2) for x in added],
        vector_ci95=[round(1.96 * float(s), 2) for s in sigma],
        n=study.air.n + ground.n,
        seconds=round(samples.seconds, 1),
        threshold=MOTORS_LIMIT,
        source=MOTORS_SOURCE,
        evidence=_motor_evidence(study),
    )
    if not agrees:
        answer.why_no_setting = motors_refusal(study)
        if not unsound_reason(study) and turns_heading(study):
            answer.action = MOVE_ADVICE
        if found is not None and not answer.why_no_setting:
            offer = parameters.compass_proposal(
                case.log, samples.mag, 1e-6 * found.offset, 1e-6 * found.per_unit, samples.power_kind
            )
            answer.settings, answer.why_no_setting = offer.settings, offer.refused
            if offer.refused and study.motor_proof is not None:
                answer.action = (
                    f"{offer.refused} Run attlog health again: {_promised_error(samples.source, study.motor_proof)}"
                )
    return answer


def turns_heading(study: CompassStudy) -> bool:
    """Whether the motors may turn the heading: their field is not vertical only, and without it it is no worse."""
    proof = study.motor_proof
    return bool(study.ground_differs_along[:2].any()) and (proof is None or proof.after < proof.before)


def _promised_error(source: str, proof: HeadingProof) -> str:
    return f"compensated for the motors, {source} would err by {proof.after:.0f} deg instead of {proof.before:.0f}."


def motor_advice(answers: Sequence[Check], studies: Sequence[CompassStudy]) -> list[Check]:
    """The answers to the studies: of compasses that the motors bend, all say to use the one that power explains best.

    Another one whose own compensation does not mend its heading has no better advice.
    """
    proven = [(a, s) for a, s in zip(answers, studies, strict=True) if a.action and s.motors and not motors_refusal(s)]
    if not proven:
        return list(answers)
    best, study = min(proven, key=lambda pair: pair[1].motor_proof.after if pair[1].motor_proof else np.inf)
    if study.motor_proof is None or study.motor_proof.after >= min(s.proof.before for s in studies):
        return list(answers)
    first = f"Set the values of {best.sensor}: {_promised_error(best.sensor, study.motor_proof)}"
    first = first if best.settings else best.action
    return [
        replace(a, action=f"{first} Then use {best.sensor}.") if a.action and motors_refusal(s) else a
        for a, s in zip(answers, studies, strict=True)
    ]


def motors_refusal(study: CompassStudy) -> str:
    """Why no compensation for the motors is offered; empty where it may be."""
    if why := unsound_reason(study):
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
    found, samples = study.motors, study.samples
    said = []
    if found is not None and study.ground_differs:
        unit = "uT per ampere" if samples.power_kind == "current" else "uT at full throttle"
        shown = ", ".join(f"{x:.3g}" for x in found.per_unit)
        said.append(f"That is {shown} {unit} in x, y, z.")
    if study.motor_proof is not None and study.ground_differs:
        said.append(study.motor_proof.sentence)
    if study.before is not None and study.after is not None:
        apart = float(np.linalg.norm(study.before.offset - study.after.offset))
        said.append(f"Before take-off and after landing the ground differs by {apart:.1f} uT.")
    return said


# Does iron around a compass stretch the field? In words only: a flight shows it too roughly to be set.
#
# Horizontally ``m = (1 + s) u + a (u_x, -u_y) + b (u_y, u_x) + w (u_y, -u_x) + o``: s scale, w turn, o offset; a and
# b
# are the ellipse that soft iron makes of a circle. They swing the heading by hypot(a, b) rad, twice in a full turn.

SOFT_IRON_OFF, SOFT_IRON_SIGMAS = 0.1, 4.0
"""A tenth swings the heading by 6 deg."""
SOFT_IRON_FLOOR = 0.015
"""What attitude errors make of a sound compass; with errors of the fit alone 22 of 39 sound ones are accused."""
MIN_FIELD_TURN_DEG = 60.0
"""Directions of the field that the flight saw, from the 5th to the 95th percentile about their mean."""
SOFT_IRON_LIMIT = f"ok up to {100 * SOFT_IRON_OFF:.0f} % or {SOFT_IRON_SIGMAS:.0f} sigma"
SOFT_IRON_ADVICE = (
    "A flight shows soft iron too roughly to set it: calibrate the compass on the ground, in all directions."
)


def soft_iron_check(study: CompassStudy) -> Check:
    """The ellipse that the horizontal field draws in the axes of one compass."""
    samples = study.samples
    t, u, m = samples.t[samples.air], samples.expected[samples.air], samples.measured[samples.air]
    x, y = u[:, 0], u[:, 1]
    turned = _field_turn_deg(x, y)
    if turned < MIN_FIELD_TURN_DEG:
        why = f"The flight turns by {turned:.0f} deg: soft iron needs {MIN_FIELD_TURN_DEG:.0f} deg."
        return unknown("soft_iron", why, SOFT_IRON_LIMIT, sensor=samples.source)
    one, none = np.ones(len(t)), np.zeros(len(t))
    columns = np.stack([np.column_stack([x, x, y, y, one, none]), np.column_stack([y, -y, x, -x, none, one])], axis=1)
    found = robust_fit(t, columns, m[:, :2] - u[:, :2], huber=COMPASS_HUBER)
    if found is None:
        return unknown(
            "soft_iron",
            f"The flight does not show the soft iron of {samples.source}.",
            SOFT_IRON_LIMIT,
            sensor=samples.source,
        )
    size = math.hypot(found.x[1], found.x[2])
    sigma = math.hypot(STANDARD_ERRORS * float(found.sigma[1:3].max()), SOFT_IRON_FLOOR)
    if SOFT_IRON_SIGMAS * sigma > 2.0 * SOFT_IRON_OFF and size <= SOFT_IRON_SIGMAS * sigma:
        why = f"Soft iron of {samples.source} is known to {196 * sigma:.0f} % only: the flight turns too little."
        return unknown("soft_iron", why, SOFT_IRON_LIMIT, sensor=samples.source)
    off = size > max(SOFT_IRON_OFF, SOFT_IRON_SIGMAS * sigma)
    return Check(
        "soft_iron",
        "warning" if off else "ok",
        f"Soft iron stretches the field of {samples.source} by {100 * size:.1f} ± {196 * sigma:.1f} %.",
        sensor=samples.source,
        value=round(100.0 * size, 1),
        unit="%",
        ci95=(round(max(100.0 * size - 196.0 * sigma, 0.0), 1), round(100.0 * size + 196.0 * sigma, 1)),
        n=len(t),
        seconds=round(samples.seconds, 1),
        threshold=SOFT_IRON_LIMIT,
        why_no_setting=SOFT_IRON_ADVICE if off else "",
        evidence=[f"The heading swings by {math.degrees(size):.1f} deg, twice in each turn."],
    )


def _field_turn_deg(x: np.ndarray, y: np.ndarray) -> float:
    """How far the horizontal field (n,) turns in body axes, deg."""
    angle = np.arctan2(y, x)
    middle = np.angle(np.mean(np.exp(1j * angle)))
    low, high = np.quantile((angle - middle + np.pi) % (2.0 * np.pi), [0.05, 0.95])
    return float(np.degrees(high - low))


# Is another compass better than the one in use? Their headings side by side, else the size of their fields.

# A compass that reads the earth's field to the first share, varying by less than the second, is sound; one that is off
# by more than the third is not.
CLOSE_SHARE, STEADY_SHARE, OFF_SHARE = 0.1, 0.1, 0.2
BETTER_SHARE, BETTER_DEG = 0.5, 5.0
"""Another is better where its heading errs by half as much, and by 5 deg less: attitudes do not err by that."""
MAX_SOUND_DEG = 12.0
"""A compass that errs by more is not to be flown by, as an offset that leaves more is not to be set."""
CHOICE_LIMIT = (
    f"ok unless another errs by {BETTER_DEG:.0f} deg less and half as much, else by the field's size within 10 %"
)


def choice_checks(case: HealthCase, studies: Sequence[CompassStudy]) -> list[Check]:
    """Which compass to use; nothing where the log holds fewer than two that measure."""
    log = case.log
    mags = [mag for mag in log.mags if not compass.dead_reason(mag, log.replay_imu)]
    if len(mags) < 2 or log.mag is None or not compass_flight_spans(case.segments):
        return []
    used = log.mags[log.mag]
    own = next((s for s in studies if s.samples.mag is used), None)
    others = [s for s in studies if s.samples.mag is not used]
    if own is not None and others:
        return [_choice_by_heading(log, own, others)]
    return _choice_by_size(case, used, [mag for mag in mags if mag is not used])


def _choice_by_heading(log: FlightLog, own: CompassStudy, others: Sequence[CompassStudy]) -> Check:
    """The heading errors of every compass as it is logged, and what is left after its own offset."""
    errors = {id(study): _heading_errors(study) for study in (own, *others)}
    best = min(others, key=lambda study: errors[id(study)][0])
    now, then = errors[id(own)][0], errors[id(best)][0]
    better = then <= BETTER_SHARE * now and now - then >= BETTER_DEG
    one, two = best.samples.source, own.samples.source
    text = f"{two}, in use, errs by {now:.1f} deg in heading, {one} by {then:.1f} deg."
    answer = Check(
        "compass_choice",
        "warning" if better else "ok",
        text,
        sensor=two,
        value=round(then - now, 1),
        unit="deg",
        n=own.air.n,
        seconds=round(own.samples.seconds, 1),
        threshold=CHOICE_LIMIT,
        evidence=[_heading_line(study, *errors[id(study)]) for study in (own, *others)],
    )
    if better and then > MAX_SOUND_DEG:
        answer.why_no_setting = f"{one} is better, but errs too: calibrate both."
    elif better:
        _offer_switch(log, answer, best.samples.mag, own.samples.mag)
    return answer


def _heading_errors(study: CompassStudy) -> tuple[float, float]:
    """RMS of the heading error in deg as logged, and with the offset of the flight taken away."""
    samples = study.samples
    q, field = samples.q[samples.air], samples.measured[samples.air]
    logged, fitted = (heading_error(q, field - o, samples.earth) for o in (np.zeros(3), study.air.offset))
    return rms_deg(logged), rms_deg(fitted)


def _heading_line(study: CompassStudy, logged: float, fitted: float) -> str:
    samples = study.samples
    size = float(np.median(np.linalg.norm(samples.measured[samples.air] - study.air.offset, axis=1)))
    earth = float(np.linalg.norm(samples.earth))
    return (
        f"{samples.source}: heading error {logged:.1f} deg, {fitted:.1f} deg without its offset of "
        f"{study.air.size:.1f} uT; then {size:.1f} of {earth:.1f} uT, residual {study.air.left_ut:.1f} uT."
    )


def _choice_by_size(case: HealthCase, used: Mag, others: Sequence[Mag]) -> list[Check]:
    """The size of the fields against the earth's, which needs no attitude."""
    model = alignment.earth_field(case.log)
    if model is None:
        return []
    earth, spans = 1e6 * model.strength_t, compass_flight_spans(case.segments)
    own_size, own_spread = _field_size(used, spans)
    seen = [(mag, *_field_size(mag, spans)) for mag in others]
    sound = [(m, size) for m, size, s in seen if abs(size / earth - 1.0) <= CLOSE_SHARE and s <= STEADY_SHARE]
    if not np.isfinite(own_size):
        return []
    better = bool(sound) and abs(own_size / earth - 1.0) > OFF_SHARE
    other, size = sound[0] if sound else (seen[0][0], seen[0][1])
    text = f"{used.field.source}, in use, reads {own_size:.1f} uT of {earth:.1f}, {other.field.source} {size:.1f} uT."
    shown = [
        f"{m.field.source} reads {s:.1f} uT, varying by {100 * v:.0f} %; the earth has {earth:.1f} uT."
        for m, s, v in ((used, own_size, own_spread), *seen)
    ]
    source = used.field.source
    answer = Check(
        "compass_choice", "warning" if better else "ok", text, sensor=source, threshold=CHOICE_LIMIT, evidence=shown
    )
    if better:
        _offer_switch(case.log, answer, other, used)
    return [answer]


def _field_size(mag: Mag, spans: list[tuple[float, float]]) -> tuple[float, float]:
    """Median size of a field in the air, uT, and its standard deviation as a share of it."""
    norm: Array = 1e6 * np.linalg.norm(mag.field.x[inside(mag.field.t_best, spans)], axis=1)
    norm = norm[np.isfinite(norm)]
    if not len(norm):
        return float("nan"), float("nan")
    size = float(np.median(norm))
    return size, float(np.std(norm)) / max(size, 1e-9)


def was_calibrated(mag: Mag) -> bool:
    """Whether a compass ever was: a firmware that applies offsets of zero refuses to arm with it."""
    return mag.calibrated and (mag.offsets is None or len(mag.offsets.x) == 0 or bool(mag.offsets.x.any()))


def switch_parameters(log: FlightLog, other: Mag, used: Mag) -> dict[str, float]:
    """Return the parameters that change to use another compass, empty where the log lacks a switch."""
    wanted = compass_switches(log.settings.values, other.index, used.index)
    return {name: value for name, value in wanted.items() if log.param(name) != value}


def _offer_switch(log: FlightLog, answer: Check, other: Mag, used: Mag) -> None:
    """Adds the switches of both compasses where the log holds them, else words."""
    answer.action = f"Use {other.field.source} instead of {used.field.source}."
    if not was_calibrated(other):
        answer.why_no_setting = f"{other.field.source} was never calibrated: calibrate it first."
        answer.action = f"Calibrate {other.field.source} and use it instead of {used.field.source}."
        return
    answer.settings = [Setting(name, log.param(name), new) for name, new in switch_parameters(log, other, used).items()]
    if not answer.settings:
        first = FIRST_COMPASS in log.settings.values
        how = f"set {FIRST_COMPASS} to {other.index}" if first else "give that one a higher priority"
        answer.why_no_setting = f"The log holds no parameter that switches a compass: {how}."
        return
    changes = " and ".join(f"{setting.name} {setting.new:.0f}" for setting in answer.settings)
    answer.action = f"{answer.action[:-1]}: set {changes}."


# Can the compasses be trusted? Every one against the earth's field, by an attitude that no compass had part in.


def compass_checks(case: HealthCase) -> list[Check]:
    """Check offset, motors and soft iron of each compass by motion alone, and which compass is best.

    Of the compass in use offset and motors fall back on the reference's heading and on the size of the field.
    """
    log = case.log
    if not log.mags:
        return []
    used = log.mags[log.mag or 0].field.source
    studies, why = compass_studies(case)
    # One that is switched off misleads nothing; where it is the better one, the choice names its numbers.
    judged = [study for study in studies if study.samples.mag.enabled] or studies
    checks = [offset_check(case, study) for study in judged]
    checks += motor_advice([motor_check(case, study) for study in judged], judged)
    checks += [soft_iron_check(study) for study in judged]
    if not studies:
        checks = [unknown("compass_offset", why, OFFSET_LIMIT, sensor=used, source=OFFSET_SOURCE)]
    checks = without_repeats([check if check.sensor == used else not_in_use(check) for check in checks])
    coarse = compass_error_checks(case)
    if log.mag is not None:
        coarse.append(interference_check(log, case.segments, log.mags[log.mag]))
    for check in coarse:
        own = [c for c in checks if c.question == check.question and c.sensor == used]
        if not own:
            checks.append(check)
        elif own[0].verdict == "unknown" and check.verdict != "unknown":
            checks[checks.index(own[0])] = check
    return checks + choice_checks(case, studies)


def not_in_use(answer: Check) -> Check:
    """Of a compass that is not in use: no fault, because the vehicle did not fly by it."""
    return replace(answer, verdict="warning") if answer.verdict == "fault" else answer


def without_repeats(answers: list[Check]) -> list[Check]:
    """Without what is unknown of another compass for the same reason."""
    said: set[str] = set()
    kept = []
    for answer in answers:
        if answer.verdict != "unknown" or answer.text not in said:
            kept.append(answer)
        if answer.verdict == "unknown":
            said.add(answer.text)
    return kept
