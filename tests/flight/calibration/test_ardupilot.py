"""ArduPilot's calibration: by the slot of the device, whole by whole, against the firmware's own formula."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.calibration import ardupilot
from attlog.flight.calibration.correction import CalibrationUnknownError
from attlog.flight.orientation import mounting
from tests.flight.calibration.made import MG, OLD, amperes, ardupilot_field, raw_field


@pytest.mark.parametrize("scale", [1.1, 0.0, 3.0])
def test_the_correction_is_that_of_the_firmware(scale: float) -> None:
    """COMPASS_SCALE counts between 1/1.5 and 1.5 only; motors are added after the matrix."""
    values = OLD | {"COMPASS_SCALE": scale, "COMPASS_MOTCT": 2.0, "COMPASS_MOT_Y": -4.0}
    raw, power = raw_field(), amperes()
    found = ardupilot.compass(values, 0)
    assert found.motor_power == "current"
    expected = ardupilot_field(raw, values, power=power)
    np.testing.assert_allclose(found.correction.body(raw, power[:, None]), expected, atol=1e-12)


def test_a_matrix_of_zeros_is_none_and_motor_values_count_only_with_their_type() -> None:
    values = OLD | dict.fromkeys([f"COMPASS_{k}_{a}" for k in ("DIA", "ODI") for a in "XYZ"], 0.0)
    found = ardupilot.compass(values | {"COMPASS_SCALE": 0.0, "COMPASS_MOT_X": 9.0}, 0)
    np.testing.assert_array_equal(found.correction.matrix, np.eye(3))
    assert not found.correction.motor.any()
    assert not ardupilot.compass(
        values | {"COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": 9.0, "COMPASS_PMOT_EN": 1.0}, 0
    ).motor_power


def test_the_slot_is_that_of_the_device_and_another_order_is_refused() -> None:
    assert ardupilot.compass(OLD, 1).offsets == ("COMPASS_OFS2_X", "COMPASS_OFS2_Y", "COMPASS_OFS2_Z")
    assert ardupilot.compass_device(OLD, 1) == "131874"
    older = {name: v for name, v in OLD.items() if "PRIO" not in name}
    assert ardupilot.compass(older, 1).offsets[0] == "COMPASS_OFS2_X"
    assert ardupilot.compass_device(older, 1) == "131874"
    swapped = OLD | {"COMPASS_PRIO1_ID": 131874.0, "COMPASS_PRIO2_ID": 97539.0}
    for index in (0, 1):
        with pytest.raises(CalibrationUnknownError, match="swaps the slots"):
            ardupilot.compass(swapped, index)
    with pytest.raises(CalibrationUnknownError, match="No COMPASS_DEV_ID"):
        ardupilot.compass(OLD | {"COMPASS_PRIO1_ID": 5.0}, 0)
    with pytest.raises(CalibrationUnknownError, match="does not hold COMPASS_OFS3_X"):
        ardupilot.compass(older, 2)


def test_the_type_of_compensation_is_set_only_where_nothing_else_comes_into_effect() -> None:
    def refused(values: dict[str, float], index: int = 0) -> str:
        with pytest.raises(CalibrationUnknownError) as why:
            ardupilot.compass_motor_type(OLD | values, index, "current")
        return str(why.value)

    assert ardupilot.compass_motor_type(OLD, 0, "current") == {"COMPASS_MOTCT": 2.0}
    assert ardupilot.compass_motor_type(OLD, 0, "throttle") == {"COMPASS_MOTCT": 1.0}
    assert ardupilot.compass_motor_type(OLD | {"COMPASS_MOTCT": 2.0, "COMPASS_MOT2_X": 1.0}, 0, "current") == {}
    assert ardupilot.compass_motor_type(OLD | {"COMPASS_MOT_X": 7.0}, 0, "current") == {"COMPASS_MOTCT": 2.0}
    assert "COMPASS_MOT2 " in refused({"COMPASS_MOT2_X": 1.0})
    assert "COMPASS_MOT " in refused({"COMPASS_MOTCT": 1.0, "COMPASS_MOT_X": 1.0})
    assert "COMPASS_PMOT_EN" in refused({"COMPASS_PMOT_EN": 1.0})


def test_a_version_that_adds_motors_before_a_scale_is_refused() -> None:
    """Before COMPASS_SCALE: refused where DIA or ODI do anything, not where they are unset or one."""
    older = {name: v for name, v in OLD.items() if name != "COMPASS_SCALE"}
    with pytest.raises(CalibrationUnknownError, match="before the scales"):
        ardupilot.compass_motor_type(older, 0, "current")
    plain = {name: v for name, v in older.items() if "ODI" not in name}
    for one in (0.0, 1.0):
        values = plain | {f"COMPASS_DIA_{a}": one for a in "XYZ"}
        assert ardupilot.compass_motor_type(values, 0, "current") == {"COMPASS_MOTCT": 2.0}


@pytest.mark.parametrize(("index", "name"), [(0, "INS_ACC"), (1, "INS_ACC2"), (2, "INS_ACC3"), (3, "INS4_ACC")])
def test_an_accelerometer_is_offset_scaled_and_turned(index: int, name: str) -> None:
    values = {"AHRS_ORIENTATION": 6.0} | {f"{name}OFFS_{a}": v for a, v in zip("XYZ", (0.3, -0.2, 0.1), strict=True)}
    values |= {f"{name}SCAL_{a}": v for a, v in zip("XYZ", (1.01, 0.98, 1.02), strict=True)}
    found = ardupilot.accelerometer(values, index, "Copter 4.5.7")
    turn = mounting(6.0)
    assert turn is not None
    raw = np.random.default_rng(1).normal(size=(20, 3))
    expected = ((raw - [0.3, -0.2, 0.1]) * [1.01, 0.98, 1.02]) @ turn.T
    np.testing.assert_allclose(found.correction.body(raw), expected, atol=1e-12)
    assert found.offsets[0] == f"{name}OFFS_X"


def test_other_axes_of_an_accelerometer_are_refused() -> None:
    values = {f"INS_ACCOFFS_{a}": 0.0 for a in "XYZ"}
    with pytest.raises(CalibrationUnknownError, match=r"version 3\.3"):
        ardupilot.accelerometer(values, 0, "Copter 3.2.1")
    with pytest.raises(CalibrationUnknownError, match="custom"):
        ardupilot.accelerometer(values | {"AHRS_ORIENTATION": 101.0}, 0, "Copter 4.5.7")
    with pytest.raises(CalibrationUnknownError, match="does not hold INS_ACC2OFFS_X"):
        ardupilot.accelerometer(values, 1, "Copter 4.5.7")
    assert ardupilot.compass(OLD, 0).correction.offset[0] == pytest.approx(12.4 * MG)


def test_before_version_4_the_motors_field_goes_through_the_matrix_as_well() -> None:
    """Copter 3.6, AP_Compass_Backend.cpp: offsets, motors, then DIA and ODI; 4.0 has SCALE and adds motors last."""
    values = OLD | {"COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": 3.0, "COMPASS_MOT_Y": -4.0}
    del values["COMPASS_SCALE"]
    x, y, z = 3.0 * MG, -4.0 * MG, 0.0
    expected = [1.04 * x + 0.03 * y - 0.02 * z, 0.03 * x + 0.97 * y + 0.05 * z, -0.02 * x + 0.05 * y + 1.01 * z]
    np.testing.assert_allclose(ardupilot.compass(values, 0).correction.motor, expected, rtol=1e-12)
    newer = ardupilot.compass(values | {"COMPASS_SCALE": 1.0}, 0)
    np.testing.assert_allclose(newer.correction.motor, [x, y, z], rtol=1e-12)
