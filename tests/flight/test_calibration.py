"""ArduPilot's calibration: by the slot of the device, whole by whole, against the firmware's own formula."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.flight import calibration
from attlog.flight.calibration import CalibrationUnknownError, Correction, mounting_matrix
from tests.flight.calibrated_logs import GAUSS, MG, OLD, amperes, ardupilot_field, raw_field


@pytest.mark.parametrize("scale", [1.1, 0.0, 3.0])
def test_the_ardupilot_correction_is_that_of_the_firmware(scale: float) -> None:
    """COMPASS_SCALE counts between 1/1.5 and 1.5 only; motors are added after the matrix."""
    values = OLD | {"COMPASS_SCALE": scale, "COMPASS_MOTCT": 2.0, "COMPASS_MOT_Y": -4.0}
    raw, power = raw_field(), amperes()
    found = calibration.ardupilot_compass(values, 0)
    assert found.motor_power == "current"
    expected = ardupilot_field(raw, values, power=power)
    np.testing.assert_allclose(found.correction.body(raw, power[:, None]), expected, atol=1e-12)


def test_the_slot_is_that_of_the_device_and_another_order_is_refused() -> None:
    assert calibration.ardupilot_compass(OLD, 1).offsets == ("COMPASS_OFS2_X", "COMPASS_OFS2_Y", "COMPASS_OFS2_Z")
    assert calibration.compass_device(OLD, 1) == "131874"
    older = {name: v for name, v in OLD.items() if "PRIO" not in name}
    assert calibration.ardupilot_compass(older, 1).offsets[0] == "COMPASS_OFS2_X"
    assert calibration.compass_device(older, 1) == "131874"
    swapped = OLD | {"COMPASS_PRIO1_ID": 131874.0, "COMPASS_PRIO2_ID": 97539.0}
    for index in (0, 1):
        with pytest.raises(CalibrationUnknownError, match="swaps the slots"):
            calibration.ardupilot_compass(swapped, index)
    with pytest.raises(CalibrationUnknownError, match="No COMPASS_DEV_ID"):
        calibration.ardupilot_compass(OLD | {"COMPASS_PRIO1_ID": 5.0}, 0)
    with pytest.raises(CalibrationUnknownError, match="does not hold COMPASS_OFS3_X"):
        calibration.ardupilot_compass(older, 2)


def test_the_ardupilot_compensation_type_is_set_only_alone() -> None:
    def refused(values: dict[str, float], index: int = 0) -> str:
        with pytest.raises(CalibrationUnknownError) as why:
            calibration.ardupilot_motor_type(OLD | values, index, "current")
        return str(why.value)

    assert calibration.ardupilot_motor_type(OLD, 0, "current") == {"COMPASS_MOTCT": 2.0}
    assert calibration.ardupilot_motor_type(OLD, 0, "throttle") == {"COMPASS_MOTCT": 1.0}
    assert calibration.ardupilot_motor_type(OLD | {"COMPASS_MOTCT": 2.0, "COMPASS_MOT2_X": 1.0}, 0, "current") == {}
    assert calibration.ardupilot_motor_type(OLD | {"COMPASS_MOT_X": 7.0}, 0, "current") == {"COMPASS_MOTCT": 2.0}
    assert "COMPASS_MOT2 " in refused({"COMPASS_MOT2_X": 1.0})
    assert "COMPASS_MOT " in refused({"COMPASS_MOTCT": 1.0, "COMPASS_MOT_X": 1.0})
    assert "COMPASS_PMOT_EN" in refused({"COMPASS_PMOT_EN": 1.0})


@pytest.mark.parametrize(("index", "name"), [(0, "INS_ACC"), (1, "INS_ACC2"), (2, "INS_ACC3"), (3, "INS4_ACC")])
def test_an_ardupilot_accelerometer_is_offset_scaled_and_turned(index: int, name: str) -> None:
    values = {"AHRS_ORIENTATION": 6.0} | {f"{name}OFFS_{a}": v for a, v in zip("XYZ", (0.3, -0.2, 0.1), strict=True)}
    values |= {f"{name}SCAL_{a}": v for a, v in zip("XYZ", (1.01, 0.98, 1.02), strict=True)}
    found = calibration.ardupilot_accelerometer(values, index, "Copter 4.5.7")
    turn = mounting_matrix(6.0)
    assert turn is not None
    raw = np.random.default_rng(1).normal(size=(20, 3))
    expected = ((raw - [0.3, -0.2, 0.1]) * [1.01, 0.98, 1.02]) @ turn.T
    np.testing.assert_allclose(found.correction.body(raw), expected, atol=1e-12)
    assert found.offsets[0] == f"{name}OFFS_X"


def test_other_axes_of_an_accelerometer_are_refused() -> None:
    values = {f"INS_ACCOFFS_{a}": 0.0 for a in "XYZ"}
    with pytest.raises(CalibrationUnknownError, match=r"version 3\.3"):
        calibration.ardupilot_accelerometer(values, 0, "Copter 3.2.1")
    with pytest.raises(CalibrationUnknownError, match="custom"):
        calibration.ardupilot_accelerometer(values | {"AHRS_ORIENTATION": 101.0}, 0, "Copter 4.5.7")
    with pytest.raises(CalibrationUnknownError, match="does not hold INS_ACC2OFFS_X"):
        calibration.ardupilot_accelerometer(values, 1, "Copter 4.5.7")
    assert calibration.ardupilot_compass(OLD, 0).correction.offset[0] == pytest.approx(12.4 * MG)


def test_before_version_4_the_motors_field_goes_through_the_matrix_as_well() -> None:
    """Copter 3.6, AP_Compass_Backend.cpp: offsets, motors, then DIA and ODI; 4.0 has SCALE and adds motors last."""
    values = OLD | {"COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": 3.0, "COMPASS_MOT_Y": -4.0}
    del values["COMPASS_SCALE"]
    x, y, z = 3.0 * MG, -4.0 * MG, 0.0
    expected = [1.04 * x + 0.03 * y - 0.02 * z, 0.03 * x + 0.97 * y + 0.05 * z, -0.02 * x + 0.05 * y + 1.01 * z]
    np.testing.assert_allclose(calibration.ardupilot_compass(values, 0).correction.motor, expected, rtol=1e-12)
    newer = calibration.ardupilot_compass(values | {"COMPASS_SCALE": 1.0}, 0)
    np.testing.assert_allclose(newer.correction.motor, [x, y, z], rtol=1e-12)


# The correction of every firmware as one formula, and its inverses.

RANDOM = np.random.default_rng(3)
MATRIX = np.eye(3) + 0.1 * RANDOM.normal(size=(3, 3))
CORRECTION = Correction(MATRIX, np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.2, -0.3]))


def test_raw_values_come_back_from_those_in_body_axes() -> None:
    raw, power = RANDOM.normal(size=(50, 3)), RANDOM.uniform(0, 30, (50, 1))
    offset, motor = np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.2, -0.3])
    by_hand = np.array([MATRIX @ (x + offset) + p * motor for x, p in zip(raw, power, strict=True)])
    np.testing.assert_allclose(CORRECTION.body(raw, power), by_hand, atol=1e-12)
    np.testing.assert_allclose(CORRECTION.raw(by_hand, power), raw, atol=1e-12)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1.0, 0.0]), np.full((3, 3), np.nan)])
def test_a_matrix_that_folds_the_axes_is_refused(matrix) -> None:
    with pytest.raises(CalibrationUnknownError, match="no rotation"):
        Correction(matrix, np.zeros(3), np.zeros(3))


# PX4's calibration: by the slot of the device, its rotation, and the formula of its own library.

VALUES = {
    "CAL_MAG0_ID": 41.0, "CAL_MAG1_ID": 42.0, "CAL_MAG1_ROT": 8.0, "SENS_BOARD_X_OFF": 2.0, "SENS_BOARD_ROT": 4.0,
    "CAL_MAG1_XOFF": 0.1, "CAL_MAG1_YOFF": -0.2, "CAL_MAG1_ZOFF": 0.05,
    "CAL_MAG1_XSCALE": 1.1, "CAL_MAG1_YSCALE": 0.95, "CAL_MAG1_ZSCALE": 1.0,
    "CAL_MAG1_XODIAG": 0.02, "CAL_MAG1_YODIAG": -0.03, "CAL_MAG1_ZODIAG": 0.04,
    "CAL_MAG1_XCOMP": 1.5, "CAL_MAG1_YCOMP": -0.5, "CAL_MAG1_ZCOMP": 2.0, "CAL_MAG_COMP_TYP": 2.0,
}  # fmt: skip
SYMMETRIC = np.array([[1.1, 0.02, -0.03], [0.02, 0.95, 0.04], [-0.03, 0.04, 1.0]])
LEVEL = Rotation.from_euler("x", 2.0, degrees=True)


def test_the_px4_correction_is_that_of_the_firmware() -> None:
    """Magnetometer.hpp: rotation * (scale * ((data + power * compensation) - offset)), power in kA; level last."""
    raw, current = raw_field(), amperes()
    found = calibration.px4_compass(VALUES, 42)
    turn = (LEVEL * Rotation.from_euler("x", 180.0, degrees=True)).as_matrix()
    gauss = raw / GAUSS + (current / 1000.0)[:, None] * [1.5, -0.5, 2.0] - [0.1, -0.2, 0.05]
    expected = GAUSS * gauss @ SYMMETRIC.T @ turn.T
    np.testing.assert_allclose(found.correction.body(raw, current[:, None]), expected, atol=1e-12)


def test_a_device_without_a_slot_is_refused() -> None:
    with pytest.raises(CalibrationUnknownError, match="device 43"):
        calibration.px4_compass(VALUES, 43)
    with pytest.raises(CalibrationUnknownError, match="CAL_MAG0_XOFF"):
        calibration.px4_compass(VALUES, 41)


def test_the_px4_compensation_type_is_set_only_alone() -> None:
    free = VALUES | {f"CAL_MAG1_{a}COMP": 0.0 for a in "XYZ"} | {"CAL_MAG_COMP_TYP": 0.0}
    assert calibration.px4_motor_type(free, 42, "current") == {"CAL_MAG_COMP_TYP": 2.0}
    assert calibration.px4_motor_type(free, 42, "throttle") == {"CAL_MAG_COMP_TYP": 1.0}
    for beside in ({"CAL_MAG0_XCOMP": 1.0}, {"CAL_MAG_COMP_TYP": 2.0, "CAL_MAG1_XCOMP": 1.0}):
        with pytest.raises(CalibrationUnknownError, match="compensates for motors already"):
            calibration.px4_motor_type(free | beside, 42, "current")


def test_an_px4_accelerometer_is_offset_scaled_and_turned() -> None:
    values = {"CAL_ACC2_ID": 7.0, "SENS_BOARD_ROT": 2.0} | {f"CAL_ACC2_{a}OFF": 0.1 for a in "XYZ"}
    values |= {"CAL_ACC2_XSCALE": 1.02, "CAL_ACC2_YSCALE": 0.99, "CAL_ACC2_ZSCALE": 1.0}
    raw = np.random.default_rng(1).normal(size=(20, 3))
    turn = Rotation.from_euler("z", 90.0, degrees=True)
    np.testing.assert_allclose(
        calibration.px4_accelerometer(values, 7).correction.body(raw),
        turn.apply((raw - 0.1) * [1.02, 0.99, 1.0]),
        atol=1e-12,
    )


@pytest.mark.parametrize(("angle", "axis"), [("ROLL", "x"), ("PITCH", "y"), ("YAW", "z")])
def test_custom_angles_that_are_not_in_the_log_are_zero(angle: str, axis: str) -> None:
    values = {"CAL_MAG0_ID": 41.0, "CAL_MAG0_ROT": 100.0, f"CAL_MAG0_{angle}": 34.0}
    values |= {f"CAL_MAG0_{each}OFF": 0.1 for each in "XYZ"}
    found = calibration.px4_compass(values, 41)
    turn = Rotation.from_euler(axis, 34.0, degrees=True).as_matrix()
    np.testing.assert_allclose(found.correction.matrix, turn, atol=1e-12)
