"""ArduPilot's calibration of compasses and accelerometers: formulas, names by slot, what must not be mapped.

Compass (AP_Compass_Backend.cpp, correct_field): ``(raw + OFS) * SCALE``, times the symmetric matrix of DIA and ODI,
plus MOT times current or throttle. Before COMPASS_SCALE (4.0) MOT was added before the matrix. Since 4.1 a compass is
logged by its priority, and its parameters stand in the slot with its device id; at boot the firmware swaps whole slots
until both are the same. Accelerometer (AP_InertialSensor_Backend.cpp, _rotate_and_correct_accel):
``(raw - OFFS) * SCAL``, then turned by AHRS_ORIENTATION.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from attlog.flight.advice import version_number
from attlog.flight.calibration.correction import Calibration, CalibrationUnknownError, Correction
from attlog.flight.model import Array
from attlog.flight.orientation import mounting

Values = Mapping[str, float]
MILLIGAUSS = 1e-7
"""Tesla per milligauss, the unit of COMPASS_OFS and COMPASS_MOT."""
SLOTS = 3
SCALES = (1.0 / 1.5, 1.5)
"""COMPASS_SCALE counts within these (COMPASS_MIN_SCALE_FACTOR, COMPASS_MAX_SCALE_FACTOR); 0 is "not set"."""
POWERS = {0: "", 1: "throttle", 2: "current"}
"""COMPASS_MOTCT."""
DIGITS, ACC_DIGITS = 2, 4
"""Decimals of milligauss, of mG/A and of m/s^2."""
SENSOR_AXES = (3, 3)
"""Before this version accelerometer offsets were those of the vehicle's axes."""


def suffix(slot: int) -> str:
    """What stands behind the name of a slot's parameter: nothing for the first."""
    return "" if slot == 1 else str(slot)


def triple(name: str) -> tuple[str, str, str]:
    """The names of a parameter's three axes."""
    return f"{name}_X", f"{name}_Y", f"{name}_Z"


def vector(values: Values, names: tuple[str, ...], default: float = 0.0) -> Array:
    """Their values (3,)."""
    return np.array([values.get(name, default) for name in names])


def compass_device(values: Values, index: int) -> str | None:
    """Device id of the compass that is logged with a number from 0; None where the log does not tell."""
    by_priority = values.get(f"COMPASS_PRIO{index + 1}_ID")
    found = values.get(f"COMPASS_DEV_ID{suffix(index + 1)}") if by_priority is None else by_priority
    return str(int(found)) if found else None


def compass_slot(values: Values, index: int) -> int:
    """The slot 1 to 3 that holds the parameters of the compass that is logged with a number from 0."""
    wanted = values.get(f"COMPASS_PRIO{index + 1}_ID")
    if wanted is None:
        return index + 1
    slots = [n for n in range(1, SLOTS + 1) if wanted and values.get(f"COMPASS_DEV_ID{suffix(n)}") == wanted]
    if not slots:
        raise CalibrationUnknownError(f"No COMPASS_DEV_ID is that of COMPASS_PRIO{index + 1}_ID.")
    if slots[0] != index + 1:
        raise CalibrationUnknownError(
            f"COMPASS_PRIO{index + 1}_ID names the compass of slot {slots[0]}: the next boot swaps the slots. Reboot "
            "and fly once."
        )
    return slots[0]


def compass(values: Values, index: int) -> Calibration:
    """The calibration of the compass that is logged with a number from 0. CalibrationUnknownError says why not."""
    slot = compass_slot(values, index)
    end = suffix(slot)
    offsets, motors = triple(f"COMPASS_OFS{end}"), triple(f"COMPASS_MOT{end}")
    diagonal, others, scale = triple(f"COMPASS_DIA{end}"), triple(f"COMPASS_ODI{end}"), f"COMPASS_SCALE{end}"
    if not all(name in values for name in offsets):
        raise CalibrationUnknownError(f"The log does not hold {offsets[0]}.")
    dia, (xy, xz, yz) = vector(values, diagonal), vector(values, others)
    dia = dia if dia.any() else np.ones(3)
    matrix = np.diag(dia) + np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    own_scale = values.get(scale, 0.0)
    if SCALES[0] <= own_scale <= SCALES[1]:
        matrix = own_scale * matrix
    power = POWERS.get(int(values.get("COMPASS_MOTCT", 0)), "")
    if index == 0 and values.get("COMPASS_PMOT_EN"):
        power = ""  # each motor has its own values, and these do not count
    motor_matrix = MILLIGAUSS * (np.eye(3) if scale in values else matrix)
    motor = motor_matrix @ vector(values, motors) if power else np.zeros(3)
    correction = Correction(matrix, MILLIGAUSS * vector(values, offsets), motor)
    every = [f"COMPASS_{kind}{suffix(n)}" for n in range(1, SLOTS + 1) for kind in ("DEV_ID", "ORIENT", "EXTERN")]
    fixed = (*every, *(f"COMPASS_PRIO{n}_ID" for n in range(1, SLOTS + 1)), "COMPASS_EXTERNAL", "AHRS_ORIENTATION")
    names = (*offsets, *diagonal, *others, scale, *motors, "COMPASS_MOTCT")
    units = dict.fromkeys(offsets, "mG") | dict.fromkeys(motors, "mG/A" if power == "current" else "mG")
    return Calibration(correction, offsets, MILLIGAUSS, names, fixed, units, DIGITS, motors, motor_matrix, power)


def compass_motor_type(values: Values, index: int, power: str) -> dict[str, float]:
    """What to set beside COMPASS_MOT so that it is multiplied with ``power``. CalibrationUnknownError says why not."""
    slot = compass_slot(values, index)
    if values.get("COMPASS_PMOT_EN"):
        raise CalibrationUnknownError("COMPASS_PMOT_EN compensates each motor by itself.")
    symmetric = vector(values, triple(f"COMPASS_ODI{suffix(slot)}"))
    dia = vector(values, triple(f"COMPASS_DIA{suffix(slot)}"))
    if f"COMPASS_SCALE{suffix(slot)}" not in values and (symmetric.any() or (dia.any() and (dia != 1.0).any())):
        raise CalibrationUnknownError("Before version 4.0 COMPASS_MOT is added before the scales COMPASS_DIA.")
    wanted = next(number for number, name in POWERS.items() if name == power)
    now = int(values.get("COMPASS_MOTCT", 0))
    if now == wanted:
        return {}
    beside = [n for n in range(1, SLOTS + 1) if now or n != slot]
    for n in beside:
        if vector(values, triple(f"COMPASS_MOT{suffix(n)}")).any():
            raise CalibrationUnknownError(
                f"COMPASS_MOT{suffix(n)} holds values of another kind of compensation (COMPASS_MOTCT {now})."
            )
    return {"COMPASS_MOTCT": float(wanted)}


def accelerometer(values: Values, index: int, version: str) -> Calibration:
    """The calibration of the accelerometer with a number from 0. CalibrationUnknownError says why there is none."""
    if (0, 0) < version_number(version) < SENSOR_AXES:
        raise CalibrationUnknownError("Before version 3.3 accelerometer offsets had other axes.")
    name = "INS_ACC" if index == 0 else f"INS_ACC{index + 1}" if index < SLOTS else f"INS{index + 1}_ACC"
    offsets, scales = triple(f"{name}OFFS"), triple(f"{name}SCAL")
    if not all(n in values for n in offsets):
        raise CalibrationUnknownError(f"The log does not hold {offsets[0]}.")
    turn = mounting(values.get("AHRS_ORIENTATION", 0.0))
    if turn is None:
        raise CalibrationUnknownError("AHRS_ORIENTATION is one of custom angles.")
    scale = vector(values, scales, 1.0)
    scale = scale if scale.any() else np.ones(3)
    correction = Correction(turn * scale, -vector(values, offsets), np.zeros(3))
    units, fixed = dict.fromkeys(offsets, "m/s^2"), ("AHRS_ORIENTATION",)
    return Calibration(correction, offsets, -1.0, (*offsets, *scales), fixed, units, ACC_DIGITS)
