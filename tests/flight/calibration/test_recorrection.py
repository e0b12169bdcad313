"""What sensors would have shown with a file's calibration: the firmware's own correction with the new values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.flight import flight_in, read
from attlog.flight.calibration.recorrection import recorrect, units_with
from attlog.flight.model import FlightLog
from tests.flight.calibration.made import GAUSS, OLD, T, amperes, ardupilot, ardupilot_field, px4, raw_field

NEW = {"COMPASS_OFS_X": -140.0, "COMPASS_DIA_Y": 1.05, "COMPASS_MOT_Z": 2.0, "COMPASS_MOTCT": 2.0}


def notes(log: FlightLog) -> dict[str, str]:
    return {p.code: p.text for p in log.problems}


def test_a_compass_is_corrected_as_the_firmware_would_have() -> None:
    log = ardupilot(OLD)
    assert recorrect(log, "new.param", OLD | NEW | {"AHRS_RP_P": 0.1}) == set(NEW)
    expected = ardupilot_field(raw_field(), OLD | NEW, power=amperes())
    np.testing.assert_allclose(log.mags[0].field.x, expected, atol=1e-12)
    text = "MAG:0 is corrected by COMPASS_OFS_X -140 (was 12.4), "
    assert notes(log)["calibration_applied"].startswith(text)
    assert "of new.param" in notes(log)["calibration_applied"]


def test_the_motor_values_that_flew_are_taken_off_first() -> None:
    flew = OLD | {"COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": -3.0}
    log = ardupilot(flew)
    recorrect(log, "new.param", {"COMPASS_MOT_X": 1.0})
    expected = ardupilot_field(raw_field(), flew | {"COMPASS_MOT_X": 1.0}, power=amperes())
    np.testing.assert_allclose(log.mags[0].field.x, expected, atol=1e-12)


def test_the_values_that_flew_change_nothing() -> None:
    log = ardupilot(OLD)
    before = log.mags[0].field.x.copy()
    assert recorrect(log, "new.param", dict(OLD)) == set()
    assert recorrect(log, "new.param", {"COMPASS_OFS2_X": 50.0}) == set()
    np.testing.assert_array_equal(log.mags[0].field.x, before)
    assert log.problems == []


def test_what_cannot_be_mapped_is_said_and_left_alone() -> None:
    log = ardupilot(OLD)
    before = log.mags[0].field.x.copy()
    assert recorrect(log, "new.param", NEW | {"COMPASS_ORIENT": 0.0}) != set()
    for given, why in (
        (NEW | {"COMPASS_PRIO1_ID": 131874.0}, "COMPASS_PRIO1_ID differs too"),
        ({"COMPASS_DIA_X": 0.0, "COMPASS_DIA_Y": -0.0, "COMPASS_DIA_Z": 1e-9}, "no rotation with scales"),
    ):
        log = ardupilot(OLD)
        assert recorrect(log, "new.param", given) == set()
        np.testing.assert_array_equal(log.mags[0].field.x, before)
        assert why in notes(log)["calibration_not_applied"]
    log = ardupilot(OLD)
    log.battery = None
    recorrect(log, "new.param", NEW)
    assert "no current of the motors" in notes(log)["calibration_not_applied"]


def test_what_px4_learnt_before_arming_goes_with_the_old_offsets() -> None:
    flew = {"CAL_MAG0_ID": 42.0} | {f"CAL_MAG0_{a}OFF": 0.1 for a in "XYZ"}
    raw, learnt = raw_field(), np.array([9e-6, -3e-6, 4e-6])
    log = px4(flew, raw - 0.1 * GAUSS + learnt, raw)
    assert recorrect(log, "new.params", {f"CAL_MAG0_{a}OFF": -0.2 for a in "XYZ"})
    np.testing.assert_allclose(log.mags[0].field.x, raw + 0.2 * GAUSS, atol=1e-9)
    log = px4(flew, raw - 0.1 * GAUSS + learnt, None)
    assert recorrect(log, "new.params", {f"CAL_MAG0_{a}OFF": -0.2 for a in "XYZ"}) == set()
    assert "bit 6 of SDLOG_PROFILE" in notes(log)["calibration_not_applied"]


@pytest.mark.parametrize("values", [{f"INS_ACCOFFS_{a}": 0.1 for a in "XYZ"}, {f"CAL_ACC1_{a}OFF": 0.1 for a in "XYZ"}])
def test_an_accelerometer_is_corrected_too(values: dict[str, float]) -> None:
    own = next(iter(values)).startswith("INS")
    log = ardupilot(values | OLD) if own else px4(values | {"CAL_ACC1_ID": 7.0}, raw_field(), None)
    assert recorrect(log, "new.param", {name: 0.3 for name in values}) == set(values)
    np.testing.assert_allclose(log.imus[0].acc.x, np.tile([0.1, -0.4, -10.0], (len(T), 1)), atol=1e-12)


def test_units_for_one_configuration_leave_the_log_as_it_is() -> None:
    log = ardupilot(OLD)
    before, imu, mag = log.mags[0].field.x.copy(), log.imus[0], log.mags[0]
    other_imu, other = units_with(log, "new.param", NEW, imu, mag)
    assert other is not None
    np.testing.assert_allclose(other.field.x, ardupilot_field(raw_field(), OLD | NEW, power=amperes()), atol=1e-12)
    np.testing.assert_array_equal(log.mags[0].field.x, before)
    assert (other_imu.acc.x == imu.acc.x).all()
    assert log.problems == []
    assert units_with(log, "new.param", {"AHRS_RP_P": 0.1}, imu, None) == (imu, None)


def shifted(path: Path, milligauss: tuple[int, int, int], params: Path | None) -> FlightLog:
    """A log whose compass read so much more than it did, as with a wrong calibration."""
    messages = formats.open(path)
    table = messages["MAG", 0]
    for column, more in zip(("MagX", "MagY", "MagZ"), milligauss, strict=True):
        table._columns[column] = table[column] + more
    return flight_in(messages, params=params)


def test_a_file_heals_a_compass_whose_offsets_were_wrong(samples: Path, tmp_path: Path) -> None:
    """Planted: 145, -123, 60 mG too much; the file takes it out by the sign of the firmware, x + OFS."""
    path = tmp_path / "new.param"
    flew = (5.0, 13.0, -18.0)
    planted = (145, -123, 60)
    names = [f"COMPASS_OFS_{a}" for a in "XYZ"]
    path.write_text("".join(f"{n},{f - p}\n" for n, f, p in zip(names, flew, planted, strict=True)))
    sound = read(samples / "copter_yaw_turns.bin")
    wrong, healed = (shifted(samples / "copter_yaw_turns.bin", planted, p) for p in (None, path))
    assert np.abs(wrong.mags[0].field.x - sound.mags[0].field.x).max() > 1e-5
    np.testing.assert_allclose(healed.mags[0].field.x, sound.mags[0].field.x, atol=2e-9)
    assert {"calibration_applied"} <= {p.code for p in healed.problems}
    assert "params_differ" not in {p.code for p in healed.problems}


def test_a_new_calibration_does_not_reach_a_log_of_telemetry(samples: Path, tmp_path: Path) -> None:
    path = tmp_path / "new.param"
    path.write_text("COMPASS_OFS_X,100\n")
    log = read(samples / "copter_steps_stabilize.tlog", params=path)
    plain = read(samples / "copter_steps_stabilize.tlog")
    np.testing.assert_array_equal(log.mags[0].field.x, plain.mags[0].field.x)
