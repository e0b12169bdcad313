"""Proposed parameters: from sensor errors to firmware parameters and files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from attlog import __version__
from attlog.flight import limits as ranges
from attlog.flight import recalibration
from attlog.flight.calibration import Calibration, CalibrationUnknownError
from attlog.flight.model import Array, FlightLog, Imu, Mag
from attlog.health.check import Setting

# Relative tolerance for equal parameters, which are 32-bit floats.
PARAMETER_TOLERANCE = 1e-5

# Smallest bias learned by the firmware that matters: 5 mG.
LEARNED_T = 5e-7


def range_refusal(log: FlightLog, settings: Sequence[Setting]) -> str:
    """Return why one of the settings is not possible, as a sentence; empty if all are.

    A parameter exists in the firmware only if the log's own table has it, not if a separate file has.
    """
    for setting in settings:
        limits = ranges.documented_range(setting.name)
        if setting.name not in log.parameters.lines or setting.name in log.parameters.filled:
            return f"The log does not hold the parameter {setting.name}."
        if limits is None:
            return f"No range of {setting.name} is documented."
        if not (math.isfinite(setting.new) and limits[0] <= setting.new <= limits[1]):
            return f"{setting.name} would be {setting.new:.4g}, outside its range of {limits[0]:g} to {limits[1]:g}."
    return ""


def changing(log: FlightLog, settings: Sequence[Setting]) -> list[Setting]:
    """Return the settings that change a value; none if any is not possible."""
    return [] if range_refusal(log, settings) else [setting for setting in settings if not is_set(log, setting)]


def is_set(log: FlightLog, setting: Setting) -> bool:
    """Return whether a parameter has the new value at the end of the log."""
    line = log.parameters.lines.get(setting.name)
    last = None if line is None or not line.value else float(line.value[-1])
    return last is not None and math.isclose(
        last, setting.new, rel_tol=PARAMETER_TOLERANCE, abs_tol=PARAMETER_TOLERANCE
    )


@dataclass(frozen=True, slots=True)
class Proposal:
    """Settings valid only together, or the reason for none (``refused``, a sentence)."""

    settings: list[Setting] = field(default_factory=list)
    refused: str = ""


def make_proposal(log: FlightLog, values: Mapping[str, float], units: Mapping[str, str], digits: int) -> Proposal:
    """Return the changed settings of ``values`` (by name, in ``units``), or the reason for none.

    A value equal to the flown one when rounded to ``digits`` is unchanged.
    """
    old = recalibration.flown_parameters(log)
    new = {name: old[name] if name in old and round(old[name], digits) == v else v for name, v in values.items()}
    wanted = [Setting(name, old.get(name), value, units.get(name, "")) for name, value in new.items()]
    why = range_refusal(log, wanted)
    return Proposal(refused=why) if why else Proposal(changing(log, wanted))


def accelerometer_proposal(log: FlightLog, imu: Imu, bias: Array) -> Proposal:
    """Return parameters that remove an accelerometer offset (3,) m/s^2 in body axes."""
    try:
        found = recalibration.flown_accelerometer(log, imu)
        check_sensor_order(log, found)
    except CalibrationUnknownError as why:
        return Proposal(refused=str(why))
    values = found.offset_values(found.correction.offset_without(np.asarray(bias, float)))
    return make_proposal(log, values, found.units, found.digits)


def compass_proposal(
    log: FlightLog,
    mag: Mag,
    offset_t: Array,
    motor_t: Array | None = None,
    power: Literal["current", "throttle"] = "current",
) -> Proposal:
    """Return parameters that remove a compass offset and the motor field.

    ``offset_t`` (3,) and ``motor_t`` (3,) (per ampere or unit of throttle, 0 to 1): errors of the logged field in
    tesla, body axes. Both are set together, because each is valid only with the other. The parameters are those of the
    device, whatever its slot; :mod:`attlog.flight.calibration` describes the firmware's correction of logged values.
    """
    try:
        found = recalibration.flown_compass(log, mag)
        check_sensor_order(log, found)
        error = np.asarray(offset_t, float) - recalibration.learned_compass_bias(log, mag, found)
        values, units = found.offset_values(found.correction.offset_without(error)), found.units
        if motor_t is not None:
            typed = recalibration.flown_motor_type(log, mag, power)
            kind = recalibration.flown_compass(log, mag, {**recalibration.flown_parameters(log), **typed})
            values |= kind.motor_values(found.correction.motor - np.asarray(motor_t, float)) | typed
            units = kind.units
    except CalibrationUnknownError as why:
        return Proposal(refused=str(why))
    return make_proposal(log, values, units, found.digits)


def mounting_proposal(
    log: FlightLog, mag: Mag, name: str, number: int, turn: Array, offset_ut: Array | None
) -> Proposal:
    """Return the parameters of a compass's mounting ``number``, with the offsets that belong to it.

    ``turn`` (3, 3) rotates logged fields into the true axes, where ``offset_ut`` (3,) is left; None if unknown.
    """
    try:
        found = recalibration.flown_compass(log, mag)
        check_sensor_order(log, found)
        values, units = {name: float(number)}, found.units
        if log.firmware.name == "ArduPilot":  # offsets act after the rotation
            scale = float(found.correction.matrix[0, 0])
            if np.abs(found.correction.matrix - scale * np.eye(3)).max() > PARAMETER_TOLERANCE:
                raise CalibrationUnknownError(f"The soft iron of this compass belongs to its present {name}.")
            if offset_ut is None:
                raise CalibrationUnknownError(f"The flight does not show the offsets that belong to {name} {number}.")
            values |= found.offset_values(turn @ found.correction.offset - 1e-6 * offset_ut / scale)
            if found.correction.motor.any():
                values |= found.motor_values(turn @ found.correction.motor)
        elif np.abs(recalibration.learned_compass_bias(log, mag, found)).max() > LEARNED_T:
            raise CalibrationUnknownError(
                "The firmware learned a bias with the wrong mounting; it is void with another."
            )
    except CalibrationUnknownError as why:
        return Proposal(refused=str(why))
    return make_proposal(log, values, units, found.digits)


def check_sensor_order(log: FlightLog, found: Calibration) -> None:
    """Raise CalibrationUnknownError where a parameter that orders sensors was set after take-off."""
    if moved := recalibration.changed_sensor_order(log, found):
        raise CalibrationUnknownError(f"{moved[0]} was set after take-off. Reboot and fly once.")


# Parameter file for ground stations, with the flown value of each parameter.

FILE_WARNING = (
    "These values hold only for this log's vehicle, while its parameters are those named below.",
    "Check each old value before loading the file, and the headings on the ground before flying.",
)
LEARNED_OFFSETS_NOTE = "PX4 may have moved compass offsets at disarming: old values are those that flew."
# PX4's own MAVLink id, which QGroundControl compares with the connected vehicle.
MAVLINK_ID_PARAMETER = "MAV_SYS_ID"
# MAV_PARAM_TYPE_INT32, MAV_PARAM_TYPE_REAL32 and MAV_COMP_ID_AUTOPILOT1.
INT32, FLOAT, AUTOPILOT = 6, 9, 1
# Prefixes of parameters that swap compass slots at the next boot, and of parameters of a slot.
COMPASS_ORDER_PREFIX = "COMPASS_PRIO"
COMPASS_SLOT_PREFIXES = ("COMPASS_ORIENT", "COMPASS_OFS", "COMPASS_MOT", "COMPASS_DIA", "COMPASS_ODI", "COMPASS_SCALE")


def param_file(log: Mapping[str, Any], settings: Sequence[Setting]) -> str:
    """Return the text of a parameter file, empty without settings; the first of duplicates counts.

    ``log``: description of the log in a result. QGroundControl reads lines of vehicle, component, name, value and type
    (PX4), Mission Planner ``NAME,VALUE`` (ArduPilot); it skips a line that holds more, so comments have lines of their
    own. COMPASS_PRIO is omitted if the file also calibrates compasses, because a new order swaps all slots.
    """
    first: dict[str, Setting] = {}
    for setting in settings:
        first.setdefault(setting.name, setting)
    if not first:
        return ""
    firmware = str((log.get("firmware") or {}).get("name") or "")
    vehicle = int((log.get("params") or {}).get(MAVLINK_ID_PARAMETER) or 1)
    name = " ".join(str(log.get("name") or "log").split())
    lines = [f"attlog {__version__}: what to set, found in {name} ({firmware or 'unknown firmware'})", *FILE_WARNING]
    lines += [f"log sha256: {log['sha256']}"] if log.get("sha256") else []
    if firmware == "PX4":
        lines += [LEARNED_OFFSETS_NOTE, "Vehicle-Id\tComponent-Id\tName\tValue\tType"]
    lines = [f"# {line}" for line in lines]
    calibrates = any(name.startswith(COMPASS_SLOT_PREFIXES) for name in first)
    for name, setting in first.items():
        if calibrates and name.startswith(COMPASS_ORDER_PREFIX):
            text = f"# left out: {name} {setting.new:.0f} swaps the compasses at a boot. Set it alone, reboot, fly."
            lines.append(text)
            continue
        whole = ranges.is_integer(name)
        number = f"{setting.new:.0f}" if whole else f"{setting.new:.9g}"
        own = f"{vehicle}\t{AUTOPILOT}\t{name}\t{number}\t{INT32 if whole else FLOAT}"
        lines += [f"# {_before(setting)}", own if firmware == "PX4" else f"{name},{number}"]
    return "\n".join(lines) + "\n"


def _before(setting: Setting) -> str:
    """Format the flown value of a parameter."""
    if setting.old is None:
        return f"{setting.name}: its value is not in the log"
    unit = f" {setting.unit}" if setting.unit else ""
    return f"{setting.name} was {setting.old:.6g}{unit} when the log was flown"
