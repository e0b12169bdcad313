"""PX4's own sensor calibration: its formula, its names by slot, and raw values that it corrects.

``y = R (S (x - b))`` for accelerometer (S diagonal) and magnetometer (S symmetric; x + power times COMP in place of
x), ``y = R (x - b)`` for gyros; R is the sensor's rotation, or the board's (``SENS_BOARD_ROT``) for a sensor on the
board, and after it the board's fine offsets. Slots are found by device id, never by instance number
(PX4 src/lib/sensor_calibration). Since 1.13 the firmware subtracts from a compass what it learnt before arming, too.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from attlog.flight.calibration.correction import Calibration, CalibrationUnknownError, Correction
from attlog.flight.model import Array
from attlog.flight.orientation import euler_matrix, mounting

Values = Mapping[str, float]
GAUSS = 1e-4
"""Tesla per gauss, the unit of CAL_MAGn_*OFF."""
KILOAMPERE = 1e3
"""CAL_MAGn_*COMP is gauss per kA of current, or gauss at full throttle."""
POWERS = {0: "", 1: "throttle", 2: "current"}
"""CAL_MAG_COMP_TYP; 3 is the current of a second battery, which no log names."""
SLOTS, DIGITS = 8, 4
"""So many slots; decimals of gauss, of G/kA and of m/s^2 in a parameter."""
CUSTOM_ROTATION = 100
"""CAL_MAGn_ROT that points to CAL_MAGn_ROLL, _PITCH, _YAW in degrees."""
BOARD = ("SENS_BOARD_ROT", "SENS_BOARD_X_OFF", "SENS_BOARD_Y_OFF", "SENS_BOARD_Z_OFF")


def slot_of(kind: str, values: Values, device_id: int) -> int | None:
    """The calibration slot n of ``CAL_<kind>n_*`` for a device, None where it was never calibrated."""
    if device_id == 0:
        return None
    return next((n for n in range(SLOTS) if values.get(f"CAL_{kind}{n}_ID") == device_id), None)


def calibrate(kind: str, values: Values, device_id: int, x: Array) -> tuple[Array, bool]:
    """Body-frame values (n, 3) of raw ones, and whether they were ever calibrated; else only the board is turned.

    ``kind`` is GYRO, ACC or MAG as in the parameter names. The gain for motor
    current (``CAL_MAGn_*COMP``) needs the current at every sample and is left out.
    """
    n = slot_of(kind, values, device_id)
    if n is None:
        return x @ board(values).T, False
    offset, gain = _offset(kind, values, n), _gain(kind, values, n)
    return (x - offset) @ gain.T @ _turn(kind, values, n).T, bool(offset.any() or (gain != np.eye(3)).any())


def axes(kind: str, n: int, what: str) -> tuple[str, str, str]:
    """The names of a calibration's three axes."""
    return f"CAL_{kind}{n}_X{what}", f"CAL_{kind}{n}_Y{what}", f"CAL_{kind}{n}_Z{what}"


def vector(values: Values, names: tuple[str, ...], default: float = 0.0) -> Array:
    """Their values (3,)."""
    return np.array([values.get(name, default) for name in names])


def _offset(kind: str, values: Values, n: int) -> Array:
    return vector(values, axes(kind, n, "OFF"))


def _gain(kind: str, values: Values, n: int) -> Array:
    """Scale factors as a matrix (3, 3); compasses have elements beside the diagonal."""
    gain = np.eye(3)
    if kind != "GYRO":
        np.fill_diagonal(gain, vector(values, axes(kind, n, "SCALE"), 1.0))
    if kind == "MAG":
        xy, xz, yz = vector(values, axes(kind, n, "ODIAG"))
        gain += np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    return gain


def _turn(kind: str, values: Values, n: int) -> Array:
    """The rotation (3, 3) from the sensor to the vehicle: its own where it has one, else the board's."""
    own = values.get(f"CAL_{kind}{n}_ROT", -1.0)
    turn = mounting(own) if own >= 0 else None
    if own == CUSTOM_ROTATION:
        turn = euler_matrix(*(values.get(f"CAL_{kind}{n}_{angle}", 0.0) for angle in ("ROLL", "PITCH", "YAW")))
    return board(values) if turn is None else _fine(values) @ turn


def board(values: Values) -> Array:
    """The rotation matrix of the board in the vehicle: SENS_BOARD_ROT, then the fine offsets in degrees."""
    turn = mounting(values.get("SENS_BOARD_ROT", 0.0))
    return _fine(values) if turn is None else _fine(values) @ turn


def _fine(values: Values) -> Array:
    return euler_matrix(*(values.get(f"SENS_BOARD_{axis}_OFF", 0.0) for axis in "XYZ"))


def priority(values: Values, device_id: int) -> float | None:
    """``CAL_MAGn_PRIO`` of a compass (0: disabled), None where the log does not tell."""
    n = slot_of("MAG", values, device_id)
    return None if n is None else values.get(f"CAL_MAG{n}_PRIO")


def compass(values: Values, device_id: int) -> Calibration:
    """The calibration of a compass. CalibrationUnknownError says why there is none."""
    n = _slot("MAG", values, device_id)
    matrix = _turn("MAG", values, n) @ _gain("MAG", values, n)
    motors = axes("MAG", n, "COMP")
    power = POWERS.get(int(values.get("CAL_MAG_COMP_TYP", 0)), "current")
    per = KILOAMPERE if power == "current" else 1.0
    motor = matrix @ vector(values, motors) * GAUSS / per if power else np.zeros(3)
    correction = Correction(matrix, -GAUSS * _offset("MAG", values, n), motor)
    named = [name for kind in ("OFF", "SCALE", "ODIAG", "COMP") for name in axes("MAG", n, kind)]
    return Calibration(
        correction,
        axes("MAG", n, "OFF"),
        -GAUSS,
        (*named, f"CAL_MAG{n}_ROT", "CAL_MAG_COMP_TYP"),
        (*(f"CAL_MAG{k}_ID" for k in range(SLOTS)), *BOARD),
        dict.fromkeys(axes("MAG", n, "OFF"), "G") | dict.fromkeys(motors, "G/kA" if power == "current" else "G"),
        DIGITS,
        motors,
        GAUSS / per * matrix,
        power,
    )


def compass_motor_type(values: Values, device_id: int, power: str) -> dict[str, float]:
    """What to set beside COMP so that it is multiplied with ``power``. CalibrationUnknownError says why not."""
    _slot("MAG", values, device_id)
    now = int(values.get("CAL_MAG_COMP_TYP", 0))
    wanted = next(number for number, name in POWERS.items() if name == power)
    own = slot_of("MAG", values, device_id)
    for n in range(SLOTS):
        if (now or n != own) and vector(values, axes("MAG", n, "COMP")).any():
            raise CalibrationUnknownError(f"CAL_MAG{n}_XCOMP compensates for motors already (CAL_MAG_COMP_TYP {now}).")
    return {} if now == wanted else {"CAL_MAG_COMP_TYP": float(wanted)}


def accelerometer(values: Values, device_id: int) -> Calibration:
    """The calibration of an accelerometer. CalibrationUnknownError says why there is none."""
    n = _slot("ACC", values, device_id)
    correction = Correction(_turn("ACC", values, n) @ _gain("ACC", values, n), -_offset("ACC", values, n), np.zeros(3))
    names = (*axes("ACC", n, "OFF"), *axes("ACC", n, "SCALE"))
    fixed = (*(f"CAL_ACC{k}_ID" for k in range(SLOTS)), f"CAL_ACC{n}_ROT", *BOARD)
    units = dict.fromkeys(axes("ACC", n, "OFF"), "m/s^2")
    return Calibration(correction, axes("ACC", n, "OFF"), -1.0, names, fixed, units, DIGITS)


def _slot(kind: str, values: Values, device_id: int) -> int:
    """The slot of a device, whose offsets are in the log."""
    n = slot_of(kind, values, device_id)
    if n is None:
        raise CalibrationUnknownError(f"No CAL_{kind}n_ID is that of device {device_id}.")
    if not all(name in values for name in axes(kind, n, "OFF")):
        raise CalibrationUnknownError(f"The log does not hold {axes(kind, n, 'OFF')[0]}.")
    return n
