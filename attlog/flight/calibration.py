"""Calibration of compasses and accelerometers by firmware: formulas, parameter names, mounting.

Every firmware's correction is ``y = matrix (x + offset) + motor p``: x raw, y in body axes as logged, p the power of
the motors (current in A, or throttle 0 to 1).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import rotation
from attlog.core.earth import TESLA_PER_GAUSS, TESLA_PER_MILLIGAUSS
from attlog.flight.vehicle import version_number

Array = NDArray[np.float64]

# --- mounting ----------------------------------------------------------------------------------------------------
#
# Numbers of MAV_SENSOR_ORIENTATION, shared by PX4 and ArduPilot: MAVLink common.xml, PX4 src/lib/conversion/rotation.h.

# Roll, pitch, yaw in deg of the sensor or board in the vehicle, by number.
MOUNTING_EULER_DEG = tuple(
    tuple(map(int, angles.split(",")))
    for angles in (
        "0,0,0 0,0,45 0,0,90 0,0,135 0,0,180 0,0,225 0,0,270 0,0,315 "
        "180,0,0 180,0,45 180,0,90 180,0,135 0,180,0 180,0,225 180,0,270 180,0,315 "
        "90,0,0 90,0,45 90,0,90 90,0,135 270,0,0 270,0,45 270,0,90 270,0,135 "
        "0,90,0 0,270,0 0,180,90 0,180,270 90,90,0 180,90,0 270,90,0 90,180,0 "
        "270,180,0 90,270,0 180,270,0 270,270,0 90,180,90 90,0,270 90,68,293 0,315,0 "
        "90,315,0 270,0,180 270,0,270 0,90,180 0,9,180 0,45,0 270,0,225 270,0,315"
    ).split()
)


def mounting_matrix(number: float | None) -> Array | None:
    """Return the rotation matrix (3, 3) from sensor to body vectors, None for an unknown number."""
    if number is None or not 0 <= number < len(MOUNTING_EULER_DEG):
        return None
    return euler_matrix(*MOUNTING_EULER_DEG[int(number)])


def mounting_matrices() -> Array:
    """Return the rotation matrices (n, 3, 3) of all mountings, from sensor to body vectors."""
    return euler_matrix(*np.transpose(MOUNTING_EULER_DEG))


def euler_matrix(roll_deg: ArrayLike, pitch_deg: ArrayLike, yaw_deg: ArrayLike) -> Array:
    """Return the rotation matrix (..., 3, 3) of Euler angles (...) in degrees, z-y-x."""
    return rotation.to_matrix(rotation.from_euler(*np.radians(np.array([roll_deg, pitch_deg, yaw_deg], np.float64))))


# --- corrections -------------------------------------------------------------------------------------------------

# Least determinant of a calibration matrix; below, the axes are nearly coplanar.
MIN_DETERMINANT = 1e-3


class CalibrationUnknownError(Exception):
    """Unknown calibration parameters of a sensor; the message gives the reason."""


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of a sensor: ``matrix`` (3, 3), ``offset`` (3,) in its SI unit, ``motor`` (3,) per unit of power."""

    matrix: Array
    offset: Array
    motor: Array

    def __post_init__(self) -> None:
        known = all(np.isfinite(part).all() for part in (self.matrix, self.offset, self.motor))
        if not known or abs(float(np.linalg.det(self.matrix))) < MIN_DETERMINANT:
            raise CalibrationUnknownError("The calibration in the parameters is no rotation with scales.")

    def body(self, raw: Array, power: Array | float = 0.0) -> Array:
        """Correct raw values (n, 3) at ``power`` (n, 1); the result is in body axes."""
        return (raw + self.offset) @ self.matrix.T + power * self.motor

    def raw(self, body: Array, power: Array | float = 0.0) -> Array:
        """Invert :meth:`body`."""
        return (body - power * self.motor) @ np.linalg.inv(self.matrix).T - self.offset

    def offset_without(self, error: Array) -> Array:
        """Return the offset (3,) that lowers corrected values by ``error`` (3,) in body axes."""
        return self.offset - np.linalg.solve(self.matrix, error)


class Calibration(NamedTuple):
    """Correction of a sensor and the parameters it follows from.

    ``offsets``: names of three parameters; the correction's offset is ``offset_unit`` times their values, negative if
    the firmware subtracts them. ``motors``: names of three parameters; the correction's motor is ``motor_matrix``
    (3, 3) times their values, per unit of ``motor_power`` ("current", "throttle" or ""). ``names``: all parameters of
    the correction. ``fixed``: parameters of mounting or sensor order. ``units`` by name. ``digits``: decimals to which
    parameters are rounded.
    """

    correction: Correction
    offsets: tuple[str, ...]
    offset_unit: float
    names: tuple[str, ...]
    fixed: tuple[str, ...]
    units: dict[str, str]
    digits: int
    motors: tuple[str, ...] = ()
    motor_matrix: Array | None = None
    motor_power: str = ""

    def offset_values(self, offset: Array) -> dict[str, float]:
        """Return the rounded parameters of an ``offset`` (3,) as in :class:`Correction`."""
        return self._rounded(self.offsets, offset / self.offset_unit)

    def motor_values(self, motor: Array) -> dict[str, float]:
        """Return the rounded parameters of ``motor`` (3,) per unit of power in body axes."""
        if self.motor_matrix is None:
            return {}
        return self._rounded(self.motors, np.linalg.solve(self.motor_matrix, motor))

    def _rounded(self, names: tuple[str, ...], values: Iterable[float]) -> dict[str, float]:
        return {name: round(float(value), self.digits) for name, value in zip(names, values, strict=True)}


# --- ArduPilot ---------------------------------------------------------------------------------------------------
#
# Compass (AP_Compass_Backend.cpp, correct_field): ``(raw + OFS) * SCALE``, times the symmetric matrix of DIA and ODI,
# plus MOT times current or throttle. Before COMPASS_SCALE (4.0) MOT was added before the matrix. Since 4.1 a compass is
# logged by its priority, and its parameters are in the slot with its device id; at boot the firmware swaps whole slots
# until both are the same. Accelerometer (AP_InertialSensor_Backend.cpp, _rotate_and_correct_accel): ``(raw - OFFS) *
# SCAL``, then turned by AHRS_ORIENTATION.

Values = Mapping[str, float]
ARDUPILOT_SLOTS = 3
# Range in which ArduPilot applies COMPASS_SCALE (COMPASS_MIN_SCALE_FACTOR, COMPASS_MAX_SCALE_FACTOR); 0 is "not set".
SCALE_RANGE = (1.0 / 1.5, 1.5)
# Values of COMPASS_MOTCT.
ARDUPILOT_MOTOR_POWERS = {0: "", 1: "throttle", 2: "current"}
# Decimals of parameters in mG or mG/A, in m/s^2, and in rad/s.
ARDUPILOT_DIGITS, ACC_DIGITS, GYRO_DIGITS = 2, 4, 6
# Since this version accelerometer offsets are in sensor axes, before in vehicle axes.
SENSOR_AXES_VERSION = (3, 3)


def slot_suffix(slot: int) -> str:
    """Return the suffix of a slot's parameters, empty for the first."""
    return "" if slot == 1 else str(slot)


def axis_names(name: str) -> tuple[str, str, str]:
    """Return the names of a parameter's three axes."""
    return f"{name}_X", f"{name}_Y", f"{name}_Z"


def parameter_vector(values: Values, names: tuple[str, ...], default: float = 0.0) -> Array:
    """Return values (3,) by name."""
    return np.array([values.get(name, default) for name in names])


def compass_device(values: Values, index: int) -> str | None:
    """Return the device id of a logged compass, None where it is unknown."""
    by_priority = values.get(f"COMPASS_PRIO{index + 1}_ID")
    found = values.get(f"COMPASS_DEV_ID{slot_suffix(index + 1)}") if by_priority is None else by_priority
    return str(int(found)) if found else None


def compass_slot(values: Values, index: int) -> int:
    """Return the slot 1 to 3 with the parameters of a logged compass."""
    wanted = values.get(f"COMPASS_PRIO{index + 1}_ID")
    if wanted is None:
        return index + 1
    slots = [
        n for n in range(1, ARDUPILOT_SLOTS + 1) if wanted and values.get(f"COMPASS_DEV_ID{slot_suffix(n)}") == wanted
    ]
    if not slots:
        raise CalibrationUnknownError(f"No COMPASS_DEV_ID is that of COMPASS_PRIO{index + 1}_ID.")
    if slots[0] != index + 1:
        raise CalibrationUnknownError(
            f"COMPASS_PRIO{index + 1}_ID names the compass of slot {slots[0]}: the next boot swaps the slots. Reboot "
            "and fly once."
        )
    return slots[0]


def ardupilot_compass(values: Values, index: int) -> Calibration:
    """Return the calibration of a logged compass. CalibrationUnknownError gives the reason why it is unknown."""
    slot = compass_slot(values, index)
    end = slot_suffix(slot)
    offsets, motors = axis_names(f"COMPASS_OFS{end}"), axis_names(f"COMPASS_MOT{end}")
    diagonal, others, scale = axis_names(f"COMPASS_DIA{end}"), axis_names(f"COMPASS_ODI{end}"), f"COMPASS_SCALE{end}"
    if not all(name in values for name in offsets):
        raise CalibrationUnknownError(f"The log does not hold {offsets[0]}.")
    dia, (xy, xz, yz) = parameter_vector(values, diagonal), parameter_vector(values, others)
    dia = dia if dia.any() else np.ones(3)
    matrix = np.diag(dia) + np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    own_scale = values.get(scale, 0.0)
    if SCALE_RANGE[0] <= own_scale <= SCALE_RANGE[1]:
        matrix = own_scale * matrix
    power = ARDUPILOT_MOTOR_POWERS.get(int(values.get("COMPASS_MOTCT", 0)), "")
    if index == 0 and values.get("COMPASS_PMOT_EN"):
        power = ""  # per-motor compensation replaces COMPASS_MOT
    motor_matrix = TESLA_PER_MILLIGAUSS * (np.eye(3) if scale in values else matrix)
    motor = motor_matrix @ parameter_vector(values, motors) if power else np.zeros(3)
    correction = Correction(matrix, TESLA_PER_MILLIGAUSS * parameter_vector(values, offsets), motor)
    every = [
        f"COMPASS_{kind}{slot_suffix(n)}"
        for n in range(1, ARDUPILOT_SLOTS + 1)
        for kind in ("DEV_ID", "ORIENT", "EXTERN")
    ]
    fixed = (
        *every,
        *(f"COMPASS_PRIO{n}_ID" for n in range(1, ARDUPILOT_SLOTS + 1)),
        "COMPASS_EXTERNAL",
        "AHRS_ORIENTATION",
    )
    names = (*offsets, *diagonal, *others, scale, *motors, "COMPASS_MOTCT")
    units = dict.fromkeys(offsets, "mG") | dict.fromkeys(motors, "mG/A" if power == "current" else "mG")
    return Calibration(
        correction, offsets, TESLA_PER_MILLIGAUSS, names, fixed, units, ARDUPILOT_DIGITS, motors, motor_matrix, power
    )


class Mounting(NamedTuple):
    """Mounting of a compass by ``parameter``, "" where it has none of its own: ``number``, None where it is custom.

    ``internal``: set as a sensor on the board.
    """

    parameter: str = ""
    number: float | None = None
    internal: bool = False


def ardupilot_mounting(values: Values, index: int) -> Mounting:
    """Return the mounting of a logged compass; an internal one turns with the board."""
    slot = compass_slot(values, index)
    name = f"COMPASS_ORIENT{slot_suffix(slot)}"
    external = values.get("COMPASS_EXTERNAL" if slot == 1 else f"COMPASS_EXTERN{slot}")
    if external is None or external < 1:
        return Mounting(internal=external is not None)
    return Mounting(name, values[name]) if name in values else Mounting()


# First compass of NavEKF2, even if disabled (``InitialiseVariablesMag``); since 4.1 it is the first enabled one.
FIRST_COMPASS = "COMPASS_PRIMARY"


def compass_switches(values: Values, other: int, used: int) -> dict[str, float]:
    """Return ArduPilot's parameters that replace the compass ``used`` by ``other``, empty if none is logged.

    Before 3.3 COMPASS_PRIMARY alone selects one.
    """
    names = [f"COMPASS_USE{slot_suffix(index + 1)}" for index in (other, used)]
    first = {FIRST_COMPASS: float(other)} if FIRST_COMPASS in values else {}
    if not all(name in values for name in names):
        return first
    return dict(zip(names, (1.0, 0.0), strict=True)) | first


def ardupilot_motor_type(values: Values, index: int, power: str) -> dict[str, float]:
    """Return the change of COMPASS_MOTCT that selects ``power``, empty if set already.

    CalibrationUnknownError if COMPASS_MOT would change its meaning for any compass.
    """
    slot = compass_slot(values, index)
    if values.get("COMPASS_PMOT_EN"):
        raise CalibrationUnknownError("COMPASS_PMOT_EN compensates each motor by itself.")
    symmetric = parameter_vector(values, axis_names(f"COMPASS_ODI{slot_suffix(slot)}"))
    dia = parameter_vector(values, axis_names(f"COMPASS_DIA{slot_suffix(slot)}"))
    if f"COMPASS_SCALE{slot_suffix(slot)}" not in values and (symmetric.any() or (dia.any() and (dia != 1.0).any())):
        raise CalibrationUnknownError("Before version 4.0 COMPASS_MOT is added before the scales COMPASS_DIA.")
    wanted = next(number for number, name in ARDUPILOT_MOTOR_POWERS.items() if name == power)
    now = int(values.get("COMPASS_MOTCT", 0))
    if now == wanted:
        return {}
    beside = [n for n in range(1, ARDUPILOT_SLOTS + 1) if now or n != slot]
    for n in beside:
        if parameter_vector(values, axis_names(f"COMPASS_MOT{slot_suffix(n)}")).any():
            raise CalibrationUnknownError(
                f"COMPASS_MOT{slot_suffix(n)} holds values of another kind of compensation (COMPASS_MOTCT {now})."
            )
    return {"COMPASS_MOTCT": float(wanted)}


def ardupilot_accelerometer(values: Values, index: int, version: str) -> Calibration:
    """Return the calibration of an accelerometer. CalibrationUnknownError gives the reason why it is unknown."""
    if (0, 0) < version_number(version) < SENSOR_AXES_VERSION:
        raise CalibrationUnknownError("Before version 3.3 accelerometer offsets had other axes.")
    name = "INS_ACC" if index == 0 else f"INS_ACC{index + 1}" if index < ARDUPILOT_SLOTS else f"INS{index + 1}_ACC"
    offsets, scales = axis_names(f"{name}OFFS"), axis_names(f"{name}SCAL")
    if not all(n in values for n in offsets):
        raise CalibrationUnknownError(f"The log does not hold {offsets[0]}.")
    turn = mounting_matrix(values.get("AHRS_ORIENTATION", 0.0))
    if turn is None:
        raise CalibrationUnknownError("AHRS_ORIENTATION is one of custom angles.")
    scale = parameter_vector(values, scales, 1.0)
    scale = scale if scale.any() else np.ones(3)
    correction = Correction(turn * scale, -parameter_vector(values, offsets), np.zeros(3))
    units, fixed = dict.fromkeys(offsets, "m/s^2"), ("AHRS_ORIENTATION",)
    return Calibration(correction, offsets, -1.0, (*offsets, *scales), fixed, units, ACC_DIGITS)


def ardupilot_gyro(values: Values, index: int, version: str) -> Calibration:
    """Return the calibration of a gyro in rad/s. CalibrationUnknownError gives the reason why it is unknown."""
    if (0, 0) < version_number(version) < SENSOR_AXES_VERSION:
        raise CalibrationUnknownError("Before version 3.3 gyro offsets had other axes.")
    name = "INS_GYR" if index == 0 else f"INS_GYR{index + 1}" if index < ARDUPILOT_SLOTS else f"INS{index + 1}_GYR"
    offsets = axis_names(f"{name}OFFS")
    if values.get("INS_GYR_CAL", 1.0) != 0.0:
        raise CalibrationUnknownError("The gyro is calibrated anew at each boot (INS_GYR_CAL): offsets do not last.")
    turn = mounting_matrix(values.get("AHRS_ORIENTATION", 0.0))
    if turn is None or not all(n in values for n in offsets):
        raise CalibrationUnknownError(f"The log does not hold {offsets[0]}, or AHRS_ORIENTATION is one of angles.")
    correction = Correction(turn, -parameter_vector(values, offsets), np.zeros(3))
    return Calibration(
        correction, offsets, -1.0, offsets, ("AHRS_ORIENTATION",), dict.fromkeys(offsets, "rad/s"), GYRO_DIGITS
    )


# --- PX4 ---------------------------------------------------------------------------------------------------------
#
# ``y = R (S (x - b))`` for accelerometer (S diagonal) and magnetometer (S symmetric; x + power times COMP in place of
# x), ``y = R (x - b)`` for gyros. R is the sensor's rotation, or the board's (``SENS_BOARD_ROT``) for a sensor on the
# board, and after it the board's fine offsets. Slots are found by device id, never by instance number (PX4
# src/lib/sensor_calibration). Since 1.13 the firmware also subtracts from a compass what it learned before arming.

# CAL_MAGn_*COMP is gauss per kA of current, or gauss at full throttle.
KILOAMPERE = 1e3
# Values of CAL_MAG_COMP_TYP; 3, the current of a second battery, is treated as current.
PX4_MOTOR_POWERS = {0: "", 1: "throttle", 2: "current"}
# Number of slots; decimals of parameters in G, G/kA and m/s^2.
PX4_SLOTS, PX4_DIGITS = 8, 4
# Value of CAL_MAGn_ROT for custom angles CAL_MAGn_ROLL, _PITCH, _YAW in degrees.
CUSTOM_ROTATION = 100
BOARD_PARAMETERS = ("SENS_BOARD_ROT", "SENS_BOARD_X_OFF", "SENS_BOARD_Y_OFF", "SENS_BOARD_Z_OFF")


def px4_slot(kind: str, values: Values, device_id: int) -> int | None:
    """Return the slot n of ``CAL_<kind>n_*`` of a device, None where it was never calibrated."""
    if device_id == 0:
        return None
    return next((n for n in range(PX4_SLOTS) if values.get(f"CAL_{kind}{n}_ID") == device_id), None)


def px4_slot_in_use(values: Values, device: str | None) -> int | None:
    """Return the slot of a compass by its device id, without one the only enabled slot."""
    if device is not None and device.isdigit():
        return px4_slot("MAG", values, int(device))
    slots = [n for n in range(PX4_SLOTS) if values.get(f"CAL_MAG{n}_ID")]
    slots = [n for n in slots if values.get(f"CAL_MAG{n}_EN", 1.0) != 0 and values.get(f"CAL_MAG{n}_PRIO", 1.0) != 0]
    return slots[0] if len(slots) == 1 else None


def px4_calibrate(kind: str, values: Values, device_id: int, x: Array) -> tuple[Array, bool]:
    """Return raw values (n, 3) calibrated and in body axes, and whether a calibration exists.

    Without one only the board's rotation is applied. ``kind``: GYRO, ACC or MAG. ``CAL_MAGn_*COMP`` is not applied.
    """
    n = px4_slot(kind, values, device_id)
    if n is None:
        return x @ board_rotation(values).T, False
    offset, gain = _px4_offset(kind, values, n), _px4_gain(kind, values, n)
    return (x - offset) @ gain.T @ _px4_rotation(kind, values, n).T, bool(offset.any() or (gain != np.eye(3)).any())


def px4_axis_names(kind: str, n: int, what: str) -> tuple[str, str, str]:
    """Return the names of a calibration's three axes."""
    return f"CAL_{kind}{n}_X{what}", f"CAL_{kind}{n}_Y{what}", f"CAL_{kind}{n}_Z{what}"


def _px4_offset(kind: str, values: Values, n: int) -> Array:
    return parameter_vector(values, px4_axis_names(kind, n, "OFF"))


def _px4_gain(kind: str, values: Values, n: int) -> Array:
    """Return the scale factors as matrix (3, 3), for a compass with off-diagonal elements."""
    gain = np.eye(3)
    if kind != "GYRO":
        np.fill_diagonal(gain, parameter_vector(values, px4_axis_names(kind, n, "SCALE"), 1.0))
    if kind == "MAG":
        xy, xz, yz = parameter_vector(values, px4_axis_names(kind, n, "ODIAG"))
        gain += np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    return gain


def _px4_rotation(kind: str, values: Values, n: int) -> Array:
    """Return the rotation (3, 3) from sensor to vehicle: its own mounting if set, else the board's."""
    own = values.get(f"CAL_{kind}{n}_ROT", -1.0)
    turn = mounting_matrix(own) if own >= 0 else None
    if own == CUSTOM_ROTATION:
        turn = euler_matrix(*(values.get(f"CAL_{kind}{n}_{angle}", 0.0) for angle in ("ROLL", "PITCH", "YAW")))
    return board_rotation(values) if turn is None else _board_fine_rotation(values) @ turn


def board_rotation(values: Values) -> Array:
    """Return the rotation matrix of the board in the vehicle: SENS_BOARD_ROT, then the fine offsets in degrees."""
    turn = mounting_matrix(values.get("SENS_BOARD_ROT", 0.0))
    return _board_fine_rotation(values) if turn is None else _board_fine_rotation(values) @ turn


def _board_fine_rotation(values: Values) -> Array:
    return euler_matrix(*(values.get(f"SENS_BOARD_{axis}_OFF", 0.0) for axis in "XYZ"))


def compass_priority(values: Values, device_id: int) -> float | None:
    """Return ``CAL_MAGn_PRIO`` of a compass (0: disabled), None where it is unknown."""
    n = px4_slot("MAG", values, device_id)
    return None if n is None else values.get(f"CAL_MAG{n}_PRIO")


def px4_compass(values: Values, device_id: int) -> Calibration:
    """Return the calibration of a compass. CalibrationUnknownError gives the reason why it is unknown."""
    n = _px4_known_slot("MAG", values, device_id)
    matrix = _px4_rotation("MAG", values, n) @ _px4_gain("MAG", values, n)
    motors = px4_axis_names("MAG", n, "COMP")
    power = PX4_MOTOR_POWERS.get(int(values.get("CAL_MAG_COMP_TYP", 0)), "current")
    per = KILOAMPERE if power == "current" else 1.0
    motor = matrix @ parameter_vector(values, motors) * TESLA_PER_GAUSS / per if power else np.zeros(3)
    correction = Correction(matrix, -TESLA_PER_GAUSS * _px4_offset("MAG", values, n), motor)
    named = [name for kind in ("OFF", "SCALE", "ODIAG", "COMP") for name in px4_axis_names("MAG", n, kind)]
    return Calibration(
        correction,
        px4_axis_names("MAG", n, "OFF"),
        -TESLA_PER_GAUSS,
        (*named, f"CAL_MAG{n}_ROT", "CAL_MAG_COMP_TYP"),
        (*(f"CAL_MAG{k}_ID" for k in range(PX4_SLOTS)), *BOARD_PARAMETERS),
        dict.fromkeys(px4_axis_names("MAG", n, "OFF"), "G")
        | dict.fromkeys(motors, "G/kA" if power == "current" else "G"),
        PX4_DIGITS,
        motors,
        TESLA_PER_GAUSS / per * matrix,
        power,
    )


def px4_mounting(values: Values, device_id: int) -> Mounting:
    """Return the mounting of a compass; an internal one turns with the board."""
    name = f"CAL_MAG{px4_slot('MAG', values, device_id)}_ROT"
    number = values.get(name)
    if number is None or number < 0:
        return Mounting(internal=number is not None)
    return Mounting(name, number)


def px4_motor_type(values: Values, device_id: int, power: str) -> dict[str, float]:
    """Return the change of CAL_MAG_COMP_TYP that selects ``power``, empty if set already.

    CalibrationUnknownError if existing CAL_MAGn_*COMP would change their meaning.
    """
    _px4_known_slot("MAG", values, device_id)
    now = int(values.get("CAL_MAG_COMP_TYP", 0))
    wanted = next(number for number, name in PX4_MOTOR_POWERS.items() if name == power)
    own = px4_slot("MAG", values, device_id)
    for n in range(PX4_SLOTS):
        if (now or n != own) and parameter_vector(values, px4_axis_names("MAG", n, "COMP")).any():
            raise CalibrationUnknownError(f"CAL_MAG{n}_XCOMP compensates for motors already (CAL_MAG_COMP_TYP {now}).")
    return {} if now == wanted else {"CAL_MAG_COMP_TYP": float(wanted)}


def px4_accelerometer(values: Values, device_id: int) -> Calibration:
    """Return the calibration of an accelerometer. CalibrationUnknownError gives the reason why it is unknown."""
    n = _px4_known_slot("ACC", values, device_id)
    correction = Correction(
        _px4_rotation("ACC", values, n) @ _px4_gain("ACC", values, n), -_px4_offset("ACC", values, n), np.zeros(3)
    )
    names = (*px4_axis_names("ACC", n, "OFF"), *px4_axis_names("ACC", n, "SCALE"))
    fixed = (*(f"CAL_ACC{k}_ID" for k in range(PX4_SLOTS)), f"CAL_ACC{n}_ROT", *BOARD_PARAMETERS)
    units = dict.fromkeys(px4_axis_names("ACC", n, "OFF"), "m/s^2")
    return Calibration(correction, px4_axis_names("ACC", n, "OFF"), -1.0, names, fixed, units, PX4_DIGITS)


def px4_gyro(values: Values, device_id: int) -> Calibration:
    """Return the calibration of a gyro in rad/s. CalibrationUnknownError gives the reason why it is unknown."""
    n = _px4_known_slot("GYRO", values, device_id)
    offsets = px4_axis_names("GYRO", n, "OFF")
    correction = Correction(_px4_rotation("GYRO", values, n), -_px4_offset("GYRO", values, n), np.zeros(3))
    fixed = (*(f"CAL_GYRO{k}_ID" for k in range(PX4_SLOTS)), f"CAL_GYRO{n}_ROT", *BOARD_PARAMETERS)
    return Calibration(correction, offsets, -1.0, offsets, fixed, dict.fromkeys(offsets, "rad/s"), GYRO_DIGITS)


def _px4_known_slot(kind: str, values: Values, device_id: int) -> int:
    """Return the slot of a device; CalibrationUnknownError if its offsets are not logged."""
    n = px4_slot(kind, values, device_id)
    if n is None:
        raise CalibrationUnknownError(f"No CAL_{kind}n_ID is that of device {device_id}.")
    if not all(name in values for name in px4_axis_names(kind, n, "OFF")):
        raise CalibrationUnknownError(f"The log does not hold {px4_axis_names(kind, n, 'OFF')[0]}.")
    return n
