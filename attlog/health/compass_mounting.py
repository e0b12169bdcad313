"""Mounting of each compass against its parameter, and the parameters that mend it.

A parameter of mounting is not set alone: offsets that were learned with another one are void.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from attlog.flight import compass, recalibration
from attlog.flight.calibration import MOUNTING_EULER_DEG, Mounting
from attlog.flight.compass import motor_drive, power_at
from attlog.flight.model import Array, FlightLog, Mag
from attlog.health import settings
from attlog.health.check import Check, HealthCase
from attlog.health.compass_turn import STANDARD_ERRORS
from attlog.health.heading import left_by_estimator
from attlog.health.regression import robust_fit
from attlog.reference.compass_orientation import (
    MAX_ASKEW_DEG,
    MIN_FAULT_RATIO,
    MIN_NEXT_RATIO,
    Orientation,
    compass_orientation,
    mirrored_axes,
    mounting_number,
)

QUESTION = "compass_orientation"
LIMIT = (
    f"ok: no other mounting fits the field {MIN_FAULT_RATIO} times better, or {MIN_NEXT_RATIO} times as well as this; "
    "dip within 15 deg"
)
SOURCE = "least squares over all mountings, tilt and gyro alone"
# Largest standard error of an offset to set beside a mounting: 30 mG.
MAX_OFFSET_SIGMA_UT = 3.0
# Checks of a compass that a wrong mounting explains.
BY_ATTITUDE = ("field_against_attitude", "declination")
EXPLAINED = ("compass_offset", "compass_turn", "compass_motors", "soft_iron", "field", *BY_ATTITUDE)


def orientation_checks(case: HealthCase) -> list[Check]:
    """Check the mounting of each live compass by tilt and gyro."""
    log = case.log
    live = [mag for mag in log.mags if not compass.dead_reason(mag, log.replay_imu)]
    return [_check(log, mag, compass_orientation(log, case.segments, mag)) for mag in live]


def without_explained(case: HealthCase, checks: Sequence[Check]) -> list[Check]:
    """Drop checks that a wrong mounting or a wrong onboard attitude explains.

    A better compass is not offered where the one in use is only set wrongly, or was left by the estimator.
    """
    used = case.log.mags[case.log.mag].field.source if case.log.mag is not None else ""
    wrong = {check.sensor for check in case.found if check.question == QUESTION and check.verdict == "fault"}
    left = left_by_estimator(case.found)

    def is_explained(check: Check) -> bool:
        if check.question == "compass_choice":
            return used in wrong or left
        mounted = check.question in EXPLAINED and (check.sensor or used) in wrong
        return mounted or (left and check.question in BY_ATTITUDE)

    return [check for check in checks if not is_explained(check)]


def _check(log: FlightLog, mag: Mag, found: Orientation) -> Check:
    source = mag.field.source
    check = Check(QUESTION, found.verdict, found.why, threshold=LIMIT, sensor=source, source=SOURCE)
    check.n, check.seconds = found.samples, round(found.seconds, 1)
    if found.verdict == "unknown":
        return check
    mounting = recalibration.flown_mounting(log, mag)
    set_so, named = (
        f"dip {dip:.0f} deg, residual {left:.1f} uT" for dip, left in zip(found.dip_deg, found.left_ut, strict=True)
    )
    check.evidence = [f"As set: {set_so}" + (f"; as named: {named}." if found.verdict == "fault" else ".")]
    if found.mirrored:
        check.text = f"{source} has mirrored axes: its field follows the gyro with {mirrored_axes(found.turn)}."
        check.action = "No mounting mirrors axes: check the driver of this compass."
        return check
    check.unit = "deg"
    check.measure(found.angle_deg, found.sigma_deg, 1, least=0.0)
    size = f"{found.angle_deg:.0f} ± {1.96 * found.sigma_deg:.0f} deg"
    if found.verdict == "ok":
        askew = found.angle_deg - 1.96 * found.sigma_deg > MAX_ASKEW_DEG
        check.text = (
            f"{source} is mounted as set; it deviates by {size}{', no other setting fits better' if askew else ''}."
        )
        return check
    check.text = f"{source} is mounted rotated by {size} from its setting."
    check.evidence.append(f"The next best mounting leaves {found.next_ratio:.1f} times the residual.")
    _offer(log, mag, found, mounting, check)
    return check


def _offer(log: FlightLog, mag: Mag, found: Orientation, mounting: Mounting, check: Check) -> None:
    """Add the parameters that mend a mounting to its check, else advice in words."""
    source = mag.field.source
    if not mounting.parameter and not mounting.internal:
        check.why_no_setting = f"The log does not hold the mounting of {source}."
        check.action = "Check the orientation of this compass and of the board, then calibrate it."
        return
    if not mounting.parameter:
        board = log.param("AHRS_ORIENTATION" if log.firmware.name == "ArduPilot" else "SENS_BOARD_ROT") or 0.0
        number = mounting_number(found.turn, board)
        check.why_no_setting = f"{source} is set as internal: its orientation is that of the board."
        external = (
            "" if number is None else f" If it is external, set it as external with orientation {_named(number)}."
        )
        check.action = f"Check the orientation of the board.{external}"
        return
    number = mounting_number(found.turn, mounting.number)
    if number is None:
        check.why_no_setting = f"No value of {mounting.parameter} describes this mounting."
        check.action = "Mount the compass as its orientation is set, then calibrate it."
        return
    check.text = f"{source} is mounted rotated by {found.angle_deg:.0f} ± {1.96 * found.sigma_deg:.0f} deg: "
    check.text += f"{mounting.parameter} should be {_named(number)}."
    offer = settings.mounting_proposal(log, mag, mounting.parameter, number, found.turn, residual_offset(log, found))
    check.settings, check.why_no_setting = offer.settings, offer.refused
    if not any(setting.name == mounting.parameter for setting in offer.settings):
        check.settings = []  # offsets of this mounting are unknown
        check.action = f"Set {mounting.parameter} {number}, and calibrate this compass before flying."


def residual_offset(log: FlightLog, found: Orientation) -> Array | None:
    """Return the offset (3,) uT left in true body axes, without the motors' field where it shows; None if unsure."""
    t, error = found.error_t, found.error
    if len(t) == 0:
        return None
    power = power_at(motor_drive(log)[1], t)
    own = np.broadcast_to(np.eye(3), (len(t), 3, 3))
    tries = [own]
    if np.isfinite(power).all() and np.ptp(power) > 0:
        tries.insert(0, np.concatenate([own, power[:, None, None] * own], axis=2))
    for columns in tries:
        fit = robust_fit(t, columns, error)
        if fit is not None and STANDARD_ERRORS * float(fit.sigma[:3].max()) <= MAX_OFFSET_SIGMA_UT:
            return np.asarray(fit.x[:3])
    return None


def _named(number: int) -> str:
    """Return a mounting as ``6 (yaw 270)``."""
    angles = zip(("roll", "pitch", "yaw"), MOUNTING_EULER_DEG[number], strict=True)
    words = ", ".join(f"{name} {angle}" for name, angle in angles if angle)
    return f"{number} ({words or 'forward'})"
