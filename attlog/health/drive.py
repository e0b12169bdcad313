"""Checks of motors, propellers, speed controllers and thrust of a multirotor in flight."""

from __future__ import annotations

import numpy as np

from attlog.flight.vehicle import VehicleKind
from attlog.health.check import Check, HealthCase, unknown
from attlog.story.control_faults import QUESTIONS as CONTROL
from attlog.story.control_faults import study_control
from attlog.story.motor_faults import MARGIN_S, QUESTIONS, DriveFault, DriveStudy, first_loss, flown_spans, study_motors
from attlog.story.motor_speeds import hottest_excess, match_motors, motor_loads

LIMITS = {
    "motor_thrust": "fault: tips towards a motor at its ceiling with the opposite at its floor, for 0.2 s",
    "motor_outputs": "fault: off for 0.3 s or unmoved for 0.8 s in flight while others drive",
    "thrust_reserve": "fault: sinks 2 m and more at full throttle",
    "yaw_response": "fault: turns against the yaw torque by 15 deg/s for 3 s",
    "esc_load": "note: 50 % more or less current at equal speed, or 20 K hotter, than the others",
    "rate_tracking": "fault: correlation below 0.65, gain outside 0.4 to 1.6, or lag from 0.2 s",
    "oscillation": "fault: one frequency from 4.5 to 20 Hz above 8 deg/s for 10 s",
}
SOUND = {
    "motor_thrust": "No motor at its ceiling lacked thrust.",
    "motor_outputs": "No motor output was off or frozen in flight.",
    "thrust_reserve": "It never sank at full throttle.",
    "yaw_response": "It never turned against a strong yaw command.",
}
ACTIONS = {
    "motor_no_thrust": "Check this motor, its propeller, ESC and connectors before the next flight.",
    "motor_off": "Check the output's function and the ESC's protocol.",
    "motor_frozen": "Check the output's function and the ESC's protocol.",
    "motors_off": "Find what stopped the motors before the next flight.",
    "no_thrust_left": "Fly lighter, or with stronger motors, propellers and battery.",
    "rate_tracking": "Tune the rate controller; check propellers, control surfaces and filters.",
    "oscillation": "Lower the rate gains of this axis; check for loose parts and slow filters.",
    "yaw_backwards": "Check propellers, spin directions and motor order against the frame type.",
}
WEAK_MOTOR_ACTION = "Check this motor and its propeller, and the balance of the load."
SOURCE = "attlog, tried on logs with known faults"


def motor_checks(case: HealthCase) -> list[Check]:
    """Check thrust of each motor, outputs, thrust reserve and yaw response; nothing without a flight."""
    study = study_motors(case.log, case.segments)
    return [check for question in QUESTIONS for check in fault_checks(study, question)]


# What one speed controller measures beside the median of the others: current at equal speed, and temperature in K.
# Sound ones scatter by 6 % and 3 K (32 controllers of 7 flights): these are six times as much and more.
MAX_LOAD, MAX_HOTTER_K = 1.5, 20.0
HEAVY_CAUSE = "A dragging bearing, a bent shaft or an unlike propeller."
LIGHT_CAUSE = "A worn, broken or slipping propeller."
HOT_CAUSE = "A failing ESC or motor, poor cooling, or more load than the others."
LOAD_ACTION = "Compare this motor, its propeller, bearing and ESC with the others."


def esc_checks(case: HealthCase) -> list[Check]:
    """Check current at equal speed and temperature of each speed controller beside the others.

    Nothing without telemetry of three controllers in the flight of a multirotor.
    """
    log, escs = case.log, case.log.power.escs
    spans = flown_spans(case.segments, MARGIN_S) if "airborne" not in case.segments.unknown else []
    if log.kind is not VehicleKind.MULTIROTOR or not spans:
        return []
    loads, excess = motor_loads(escs, spans), hottest_excess(escs, spans)
    if not np.isfinite(loads).any() and not np.isfinite(excess).any():
        return []
    outputs, loss = log.power.outputs, first_loss(case.segments)
    flown = [(a, min(b, loss)) for a, b in spans if a < loss]
    matched = [None] * len(escs) if outputs is None else match_motors(escs, outputs, flown)
    names = [
        esc.name if motor is None or outputs is None else outputs.title(motor).capitalize()
        for esc, motor in zip(escs, matched, strict=True)
    ]
    apart = np.nan_to_num(np.abs(np.log(loads)))
    k, hot = int(np.argmax(apart)), int(np.argmax(np.nan_to_num(excess, nan=-np.inf)))
    if apart[k] >= np.log(MAX_LOAD):
        more = loads[k] > 1.0
        size = 100.0 * abs(loads[k] - 1.0)
        text = f"{names[k]} draws {size:.0f} % {'more' if more else 'less'} current than the others at equal speed."
        check = Check("esc_load", "warning", text, round(100.0 * (loads[k] - 1.0), 1), "%", LIMITS["esc_load"])
        check.cause, check.action = HEAVY_CAUSE if more else LIGHT_CAUSE, LOAD_ACTION
    elif np.nan_to_num(excess[hot]) >= MAX_HOTTER_K:
        text = f"{names[hot]}: its ESC became {excess[hot]:.0f} K hotter than the median of the others."
        check = Check("esc_load", "warning", text, round(float(excess[hot]), 1), "K", LIMITS["esc_load"])
        check.cause, check.action = HOT_CAUSE, LOAD_ACTION
    else:
        apart_percent, by_load = 100.0 * float(np.expm1(apart[k])), bool(np.isfinite(loads).any())
        words = [f"current at equal speed within {apart_percent:.0f} %"] if by_load else []
        words += [f"the hottest {excess[hot]:.0f} K above the others"] if np.isfinite(excess).any() else []
        text = f"The ESCs agree: {', '.join(words)}."
        value, unit = (apart_percent, "%") if by_load else (float(excess[hot]), "K")
        check = Check("esc_load", "ok", text, round(value, 1), unit, LIMITS["esc_load"])
    check.source, check.n = SOURCE, len(escs)
    return [check]


def control_checks(case: HealthCase) -> list[Check]:
    """Check how rates follow their set-point and whether an axis oscillates; nothing without a flight."""
    study = study_control(case.log, case.segments)
    return [check for question in CONTROL for check in fault_checks(study, question)]


def fault_checks(study: DriveStudy, question: str) -> list[Check]:
    """Return the faults of a question as checks, or one that it is sound or unknown."""
    if question in study.missing:
        return [unknown(question, study.missing[question], LIMITS[question], source=SOURCE)]
    if question not in study.faults:
        return []
    faults = study.faults[question]
    if not faults:
        sound = study.numbers.get(question) or SOUND[question]
        return [Check(question, "ok", sound, threshold=LIMITS[question], source=SOURCE)]
    return [fault_check(question, faults)]


def fault_check(question: str, faults: list[DriveFault]) -> Check:
    """Convert the faults of a question to a check of the first, with the others as evidence."""
    first, *others = faults
    count = 1 if question in CONTROL else len(faults)  # the axes of one controller are no repeats
    check = Check(question, "fault", first.text, first.value, first.unit, LIMITS[question], first.t, count)
    weak = first.kind == "no_thrust_left" and first.motor is not None
    check.t_end, check.cause, check.source = first.t_end, first.cause, SOURCE
    check.action = first.action or (WEAK_MOTOR_ACTION if weak else ACTIONS[first.kind])
    check.evidence = [*first.evidence, *(f"Also: {fault.text}" for fault in others[:3])]
    return check
