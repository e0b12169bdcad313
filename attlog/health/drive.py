"""Checks of motors, propellers and thrust of a multirotor in flight."""

from __future__ import annotations

from attlog.health.check import Check, HealthCase, unknown
from attlog.story.control_faults import QUESTIONS as CONTROL
from attlog.story.control_faults import study_control
from attlog.story.motor_faults import QUESTIONS, DriveFault, DriveStudy, study_motors

LIMITS = {
    "motor_thrust": "fault: tips towards a motor at its ceiling with the opposite at its floor, for 0.2 s",
    "motor_outputs": "fault: off for 0.3 s or unmoved for 0.8 s in flight while others drive",
    "thrust_reserve": "fault: sinks 2 m and more at full throttle",
    "yaw_response": "fault: turns against the yaw torque by 15 deg/s for 3 s",
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
