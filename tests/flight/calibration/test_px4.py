"""PX4's calibration: by the slot of the device, its rotation, and the formula of its own library."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.flight.calibration import px4
from attlog.flight.calibration.correction import CalibrationUnknownError
from tests.flight.calibration.made import GAUSS, amperes, raw_field

VALUES = {
    "CAL_MAG0_ID": 41.0, "CAL_MAG1_ID": 42.0, "CAL_MAG1_ROT": 8.0, "SENS_BOARD_X_OFF": 2.0, "SENS_BOARD_ROT": 4.0,
    "CAL_MAG1_XOFF": 0.1, "CAL_MAG1_YOFF": -0.2, "CAL_MAG1_ZOFF": 0.05,
    "CAL_MAG1_XSCALE": 1.1, "CAL_MAG1_YSCALE": 0.95, "CAL_MAG1_ZSCALE": 1.0,
    "CAL_MAG1_XODIAG": 0.02, "CAL_MAG1_YODIAG": -0.03, "CAL_MAG1_ZODIAG": 0.04,
    "CAL_MAG1_XCOMP": 1.5, "CAL_MAG1_YCOMP": -0.5, "CAL_MAG1_ZCOMP": 2.0, "CAL_MAG_COMP_TYP": 2.0,
}  # fmt: skip
SYMMETRIC = np.array([[1.1, 0.02, -0.03], [0.02, 0.95, 0.04], [-0.03, 0.04, 1.0]])
LEVEL = Rotation.from_euler("x", 2.0, degrees=True)


def test_the_correction_is_that_of_the_firmware() -> None:
    """Magnetometer.hpp: rotation * (scale * ((data + power * compensation) - offset)), power in kA; level last."""
    raw, current = raw_field(), amperes()
    found = px4.compass(VALUES, 42)
    turn = (LEVEL * Rotation.from_euler("x", 180.0, degrees=True)).as_matrix()
    gauss = raw / GAUSS + (current / 1000.0)[:, None] * [1.5, -0.5, 2.0] - [0.1, -0.2, 0.05]
    expected = GAUSS * gauss @ SYMMETRIC.T @ turn.T
    np.testing.assert_allclose(found.correction.body(raw, current[:, None]), expected, atol=1e-12)


def test_throttle_is_not_divided_and_a_compass_on_the_board_turns_with_it() -> None:
    found = px4.compass(VALUES | {"CAL_MAG_COMP_TYP": 1.0, "CAL_MAG1_ROT": -1.0}, 42)
    turn = (LEVEL * Rotation.from_euler("z", 180.0, degrees=True)).as_matrix()
    np.testing.assert_allclose(found.correction.motor, GAUSS * turn @ SYMMETRIC @ [1.5, -0.5, 2.0], atol=1e-12)
    assert found.motor_power == "throttle"
    assert not px4.compass(VALUES | {"CAL_MAG_COMP_TYP": 0.0}, 42).correction.motor.any()


def test_a_device_without_a_slot_is_refused() -> None:
    with pytest.raises(CalibrationUnknownError, match="device 43"):
        px4.compass(VALUES, 43)
    with pytest.raises(CalibrationUnknownError, match="CAL_MAG0_XOFF"):
        px4.compass(VALUES, 41)


def test_the_type_of_compensation_is_set_only_where_nothing_else_comes_into_effect() -> None:
    free = VALUES | {f"CAL_MAG1_{a}COMP": 0.0 for a in "XYZ"} | {"CAL_MAG_COMP_TYP": 0.0}
    assert px4.compass_motor_type(free, 42, "current") == {"CAL_MAG_COMP_TYP": 2.0}
    assert px4.compass_motor_type(free, 42, "throttle") == {"CAL_MAG_COMP_TYP": 1.0}
    for beside in ({"CAL_MAG0_XCOMP": 1.0}, {"CAL_MAG_COMP_TYP": 2.0, "CAL_MAG1_XCOMP": 1.0}):
        with pytest.raises(CalibrationUnknownError, match="compensates for motors already"):
            px4.compass_motor_type(free | beside, 42, "current")


def test_an_accelerometer_is_offset_scaled_and_turned() -> None:
    values = {"CAL_ACC2_ID": 7.0, "SENS_BOARD_ROT": 2.0} | {f"CAL_ACC2_{a}OFF": 0.1 for a in "XYZ"}
    values |= {"CAL_ACC2_XSCALE": 1.02, "CAL_ACC2_YSCALE": 0.99, "CAL_ACC2_ZSCALE": 1.0}
    raw = np.random.default_rng(1).normal(size=(20, 3))
    turn = Rotation.from_euler("z", 90.0, degrees=True)
    np.testing.assert_allclose(
        px4.accelerometer(values, 7).correction.body(raw), turn.apply((raw - 0.1) * [1.02, 0.99, 1.0]), atol=1e-12
    )


@pytest.mark.parametrize(("angle", "axis"), [("ROLL", "x"), ("PITCH", "y"), ("YAW", "z")])
def test_custom_angles_that_are_not_in_the_log_are_zero(angle: str, axis: str) -> None:
    values = {"CAL_MAG0_ID": 41.0, "CAL_MAG0_ROT": 100.0, f"CAL_MAG0_{angle}": 34.0}
    values |= {f"CAL_MAG0_{each}OFF": 0.1 for each in "XYZ"}
    found = px4.compass(values, 41)
    turn = Rotation.from_euler(axis, 34.0, degrees=True).as_matrix()
    np.testing.assert_allclose(found.correction.matrix, turn, atol=1e-12)
