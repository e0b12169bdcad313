"""The onboard attitude: wrong, different from its sisters, set anew, turned against its sensors; its estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from attlog.flight.model import FlightLog
from attlog.health.findings.finding import Explanation, Finding
from attlog.health.onboard import against_smoother
from attlog.health.sensors.accelerometer import MEAN_GRAVITY
from attlog.reference.physics.sensor_faults import FRAME

KIND, RESET, MOUNTING, SIMULATOR, ESTIMATOR = "attitude", "reset", "mounting", "simulator", "estimator"
_WRONG = Explanation(
    KIND, as_fault="serious", cause="The onboard estimator was not aligned, or learned a wrong bias or a wrong field."
)
CHECKS = {
    against_smoother.TRUTH: _WRONG,
    against_smoother.NAME: _WRONG,
    "second source": Explanation(KIND),
    "gravity direction": Explanation(
        MOUNTING,
        as_fault="serious",
        cause="The sensor is mounted otherwise than set, or the onboard estimator failed.",
        fault="mounting",
    ),
    "gyro against attitude": Explanation(
        MOUNTING,
        as_warning="note",
        as_fault="serious",
        cause="A wrong scale, unit, orientation or clock of the logged gyro, or a slow or filtered attitude.",
        fault="mounting",
    ),
    "trim": Explanation(
        "trim",
        as_warning="note",
        cause="The level was calibrated on a slope, or the autopilot is mounted tilted.",
        fault="trim",
    ),
    "attitude jumps": Explanation(RESET),
    "coverage": Explanation("coverage", as_warning="note"),
    "rejected velocity": Explanation(ESTIMATOR, cause="Bad GNSS, vibration, or a wrong attitude."),
    "rejected position": Explanation(ESTIMATOR, cause="Bad GNSS, vibration, or a wrong attitude."),
    "rejected height": Explanation(ESTIMATOR, cause="A drifting barometer or vibration."),
    "rejected airspeed": Explanation(ESTIMATOR, cause="A blocked or badly calibrated airspeed sensor."),
}
REPORTS = {
    "reference_contradicted": KIND,
    "lane_switch": RESET,
    "estimator_instance_changed": RESET,
    "ekf_check": ESTIMATOR,
    "ekf_failsafe": ESTIMATOR,
    "ekf_fault": ESTIMATOR,
}
"""What readers and autopilot say of it, by code."""
BY_FORCE = ("gravity direction", MEAN_GRAVITY, "gravity in flight", "vertical force", "trim")
"""Checks of the attitude against the accelerometer."""
BY_ATTITUDE = ("gravity direction", MEAN_GRAVITY, "gravity in flight", "vertical force")
"""What only repeats that the attitude is wrong, where that is known."""
LEVEL = "The accelerometer was calibrated on a slope, or its offsets are wrong."
FRAMES = "The simulator gives sensors and attitude in different frames: no setting of a vehicle mends it."


SMALL_DEG = 10.0
"""A smaller jump is what an estimator does every day."""
GYRO = ("gyro", "gyro_bias", "frozen_gyro")


def settled(signs: Sequence[Finding], log: FlightLog) -> list[Finding]:
    """The signs with one cause for what has one: a broken gyro, a wrong attitude or force, a simulator's frames."""
    signs = [_weighed(sign, log) for sign in signs]
    gyro = next((sign.kind for sign in signs if sign.kind in GYRO and sign.severity == "serious"), "")
    if gyro:
        return [_of(gyro, sign) if sign.kind in (KIND, MOUNTING) else sign for sign in signs]
    if any(sign.kind == KIND and sign.severity == "serious" for sign in signs):
        signs = [_of(KIND, s) if s.about in BY_ATTITUDE and s.kind != "vibration" else s for s in signs]
    if any(sign.kind == FRAME.replace(" ", "_") for sign in signs):
        signs = [sign for sign in signs if sign.about not in BY_FORCE]
    if log.simulated:
        signs = [replace(_of(SIMULATOR, s), cause=FRAMES) if s.kind == MOUNTING and s.is_trouble else s for s in signs]
    return signs


def _of(kind: str, sign: Finding) -> Finding:
    """A sign as one of another kind, whose cause and action it shares."""
    return replace(sign, kind=kind, cause="", action="")


def _weighed(sign: Finding, log: FlightLog) -> Finding:
    """A small jump as a note; a small angle to gravity as one of the accelerometer, for mountings turn by more."""
    if sign.kind == RESET and sign.value is not None and sign.value < SMALL_DEG:
        return replace(sign, severity="note")
    if sign.about == "gravity direction" and sign.severity == "warning":
        return replace(sign, kind="accelerometer", cause=LEVEL, action=log.remedies.get("accelerometer", ""))
    return sign
