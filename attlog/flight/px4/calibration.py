"""PX4's own sensor calibration, for topics that hold raw values.

``y = R (S (x - b))`` for accelerometer (S diagonal) and magnetometer (S symmetric),
``y = R (x - b)`` for gyros; R is the sensor's rotation, or the board's
(``SENS_BOARD_ROT``) for a sensor on the board. Slots are found by device id, never
by instance number (PX4 src/lib/sensor_calibration).
"""

from __future__ import annotations

import numpy as np

from attlog.flight.model import Array
from attlog.flight.orientation import euler_matrix, mounting

SLOTS = 8
CUSTOM_ROTATION = 100
"""CAL_MAGn_ROT that points to CAL_MAGn_ROLL, _PITCH, _YAW in degrees."""


def slot_of(kind: str, values: dict[str, float], device_id: int) -> int | None:
    """The calibration slot n of ``CAL_<kind>n_*`` for a device, None where it was never calibrated."""
    if device_id == 0:
        return None
    return next((n for n in range(SLOTS) if values.get(f"CAL_{kind}{n}_ID") == device_id), None)


def calibrate(kind: str, values: dict[str, float], device_id: int, x: Array) -> tuple[Array, bool]:
    """Body-frame values (n, 3) of raw ones, and whether they were ever calibrated; else only the board is turned.

    ``kind`` is GYRO, ACC or MAG as in the parameter names. The gain for motor
    current (``CAL_MAGn_*COMP``) needs the current at every sample and is left out.
    """
    n = slot_of(kind, values, device_id)
    if n is None:
        return x @ board(values).T, False
    name = f"CAL_{kind}{n}_"
    offset = np.array([values.get(f"{name}{axis}OFF", 0.0) for axis in "XYZ"])
    gain = np.eye(3)
    if kind != "GYRO":
        np.fill_diagonal(gain, [values.get(f"{name}{axis}SCALE", 1.0) for axis in "XYZ"])
    if kind == "MAG":
        xy, xz, yz = (values.get(f"{name}{axis}ODIAG", 0.0) for axis in "XYZ")
        gain += np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    own = values.get(f"{name}ROT", -1.0)
    turn = mounting(own) if own >= 0 else board(values)
    if own == CUSTOM_ROTATION:
        turn = euler_matrix(*(values.get(f"{name}{angle}", 0.0) for angle in ("ROLL", "PITCH", "YAW")))
    return (x - offset) @ gain.T @ (board(values) if turn is None else turn).T, bool(
        offset.any() or (gain != np.eye(3)).any()
    )


def board(values: dict[str, float]) -> Array:
    """The rotation matrix of the board in the vehicle: SENS_BOARD_ROT, then the fine offsets in degrees."""
    turn = mounting(values.get("SENS_BOARD_ROT", 0.0))
    fine = euler_matrix(*(values.get(f"SENS_BOARD_{axis}_OFF", 0.0) for axis in "XYZ"))
    return fine if turn is None else fine @ turn


def priority(values: dict[str, float], device_id: int) -> float | None:
    """``CAL_MAGn_PRIO`` of a compass (0: disabled), None where the log does not tell."""
    n = slot_of("MAG", values, device_id)
    return None if n is None else values.get(f"CAL_MAG{n}_PRIO")
