"""Which calibration flew: parameters at arming, agreed with the log, and what was learnt beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.flight import flight_in, read, recalibration
from attlog.flight.calibration import CalibrationUnknownError
from attlog.flight.model import Firmware, FlightLog, TimeLine
from attlog.flight.px4 import reader as px4_reader
from attlog.flight.px4.sensors import RAW_RECORDS
from attlog.flight.recalibration import recorrect, recorrected_units
from tests.flight.calibrated_logs import GAUSS, OLD, T, amperes, ardupilot, ardupilot_field, px4, raw_field
from tests.flight.fake import gravity, messages, micros

CAL = {"CAL_MAG0_ID": 42.0} | {f"CAL_MAG0_{a}OFF": v for a, v in zip("XYZ", (0.1, -0.2, 0.05), strict=True)}


def why(log) -> str:
    with pytest.raises(CalibrationUnknownError) as refused:
        recalibration.learned_compass_bias(log, log.mags[0], recalibration.flown_compass(log, log.mags[0]))
    return str(refused.value)


def test_the_parameters_are_those_of_the_first_arming() -> None:
    log = ardupilot(OLD)
    log.parameters.lines["COMPASS_OFS_X"] = TimeLine(np.array([0.0, 5.0, 55.0]), [300.0, 12.4, 99.0], "PARM")
    log.parameters.lines["COMPASS_MOT3_X"], log.parameters.filled = (
        TimeLine(np.zeros(1), [1.0], ""),
        frozenset({"COMPASS_MOT3_X"}),
    )
    found = recalibration.flown_parameters(log)
    assert found["COMPASS_OFS_X"] == 12.4
    assert "COMPASS_MOT3_X" not in found
    assert recalibration.flown_compass(log, log.mags[0]).correction.offset[0] == pytest.approx(12.4e-7)


def test_a_change_in_flight_is_refused_and_one_at_disarming_is_not() -> None:
    log = ardupilot(OLD)
    log.parameters.lines["COMPASS_OFS_X"] = TimeLine(np.array([0.0, 30.0]), [12.4, 99.0], "PARM")
    assert why(log) == "COMPASS_OFS_X was changed during the flight."
    log.parameters.lines["COMPASS_OFS_X"] = TimeLine(np.array([0.0, 50.1]), [12.4, 99.0], "PARM")
    assert recalibration.flown_compass(log, log.mags[0]).offsets[0] == "COMPASS_OFS_X"
    log.parameters.lines["COMPASS_PRIO1_ID"] = TimeLine(np.array([0.0, 55.0]), [97539.0, 131874.0], "PARM")
    assert recalibration.changed_sensor_order(log, recalibration.flown_compass(log, log.mags[0])) == [
        "COMPASS_PRIO1_ID"
    ]


def test_offsets_that_are_not_those_of_the_parameters_are_of_another_boot() -> None:
    log = ardupilot(OLD)
    log.mags[0].offsets.x[0, 1] = -81e-7  # logged whole: -80.6 is cut to -80
    assert "flew with offsets 12, -81, 33 mG" in why(log)
    log = ardupilot(OLD)
    log.mags[0].offsets.t = np.array([0.0, 30.0])
    log.mags[0].offsets.x = np.array([[0.0, 0.0, 0.0], log.mags[0].offsets.x[0]])
    assert "changed during the flight" in why(log)
    log.mags[0].offsets = None
    assert "does not hold the offsets" in why(log)


def test_what_was_learnt_before_arming_is_what_raw_values_do_not_explain() -> None:
    raw, learnt = raw_field(), np.array([9e-6, -3e-6, 4e-6])
    field = raw - GAUSS * np.array([0.1, -0.2, 0.05]) + np.where(T[:, None] > 5, learnt, 0.0)
    log = px4(CAL, field, raw)
    mag = log.mags[0]
    np.testing.assert_allclose(
        recalibration.learned_compass_bias(log, mag, recalibration.flown_compass(log, mag)), learnt, atol=1e-9
    )
    log.firmware = Firmware("PX4", "1.12.3")
    assert not recalibration.learned_compass_bias(log, mag, recalibration.flown_compass(log, mag)).any()
    log.firmware = Firmware("PX4", "1.11.2")
    assert "1.12" in why(log)


def test_a_log_of_telemetry_or_of_another_firmware_is_refused() -> None:
    log = ardupilot(OLD)
    log.format = "tlog"
    assert "the autopilot's own log" in why(log)
    log = ardupilot(OLD)
    log.firmware = Firmware("Other")
    assert "is not known" in why(log)
    log = px4(CAL, raw_field(), raw_field())
    log.mags[0].device = None
    assert "device id" in why(log)


def test_power_is_the_current_or_the_throttle_and_without_one_it_says_so() -> None:
    log = ardupilot(OLD)
    assert recalibration.motor_power(log, "current", np.array([5.0]))[0, 0] == 0.5
    log.power.battery.x[:, 1] = np.nan
    for kind in ("current", "throttle"):
        with pytest.raises(CalibrationUnknownError, match=f"no {kind}"):
            recalibration.motor_power(log, kind, T)


def test_a_log_that_never_tells_of_arming_counts_as_a_whole() -> None:
    log = ardupilot(OLD)
    log.state.armed = None
    assert recalibration.armed_span(log) == (1.0, log.seconds)
    log.parameters.lines = {}
    assert recalibration.flown_parameters(log) == {}
    assert "does not hold COMPASS_OFS_X" in why(log)


# What the readers tell of a compass beside its field, and of an accelerometer: ids, raw values, applied offsets.

N = 2000


def test_an_ardupilot_log_tells_device_and_offsets(samples: Path) -> None:
    log = read(samples / "copter_yaw_turns.bin")
    mag, table = log.mags[0], formats.open(samples / "copter_yaw_turns.bin")["MAG", 0]
    assert mag.device == "97539"
    assert mag.offsets is not None
    assert mag.offsets.x.shape == (1, 3)
    np.testing.assert_allclose(mag.offsets.x[0] * 1e7, [float(table[c][0]) for c in ("OfsX", "OfsY", "OfsZ")])


def px4_log(selected: list[int], published_by: tuple[int, ...] = (42,)):
    t = micros(N, 200)
    combined = {"timestamp": t, "gyro_rad": np.full((N, 3), 0.01, np.float32), "accelerometer_m_s2": gravity(N)}
    combined |= {
        "gyro_integral_dt": np.full(N, 5000, np.uint32),
        "accelerometer_integral_dt": np.full(N, 5000, np.uint32),
    }
    published = {"timestamp": t, "device_id": np.resize(np.array(published_by, np.uint32), N)}
    published |= {"magnetometer_ga": np.random.default_rng(1).normal(0.3, 0.01, (N, 3)).astype(np.float32)}
    raw = {"timestamp": t, "device_id": np.full(N, 42, np.uint32)}
    raw |= {a: (0.1 * k + np.linspace(0.1, 0.2, N)).astype(np.float32) for k, a in enumerate("xyz")}
    other = raw | {"device_id": np.full(N, 43, np.uint32), "x": raw["x"] + 5}
    voted = {"timestamp": t[: len(selected)], "accel_device_id": np.array(selected, np.uint32)}
    voted |= {"gyro_device_id": np.full(len(selected), 3, np.uint32)}
    tables = {("sensor_combined", 0): combined, ("vehicle_magnetometer", 0): published, ("sensor_selection", 0): voted}
    return px4_reader.read(messages("ulog", tables | {("sensor_mag", 0): other, ("sensor_mag", 1): raw}))


def test_a_px4_log_tells_some_raw_values_of_the_same_device() -> None:
    log = px4_log([7, 7])
    raw = log.mags[0].raw
    assert raw is not None
    assert raw.source == "sensor_mag:1"
    assert len(raw.t) <= RAW_RECORDS
    assert raw.t[-1] == pytest.approx((N - 1) / 200.0, abs=1e-3)
    np.testing.assert_allclose(raw.x[[0, -1], 0] * 1e4, [0.1, 0.2], atol=1e-6)


def test_two_compasses_that_take_turns_have_no_raw_values() -> None:
    assert px4_log([7, 7], (42, 42, 43)).mags[0].raw is None


def test_the_voted_accelerometer_has_an_id_where_it_stayed_the_same() -> None:
    assert px4_log([7, 7]).imus[0].acc_device == "7"
    assert px4_log([7, 8]).imus[0].acc_device is None


# What sensors would have shown with a file's calibration: the firmware's own correction with the new values.

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


@pytest.mark.parametrize("given", [{"COMPASS_ORIENT": 6.0}, NEW | {"COMPASS_ORIENT": 6.0, "COMPASS_ORIENT2": 4.0}])
def test_another_mounting_turns_what_was_measured_before_its_offsets(given: dict[str, float]) -> None:
    flew = OLD | {"COMPASS_ORIENT": 0.0, "COMPASS_ORIENT2": 0.0, "COMPASS_EXTERNAL": 1.0}
    log = ardupilot(flew)
    assert recorrect(log, "new.param", given) >= {"COMPASS_ORIENT"}
    x, y, z = raw_field().T  # the firmware turns by yaw 270: what points right is forward
    expected = ardupilot_field(np.column_stack([y, -x, z]), flew | given, power=amperes())
    np.testing.assert_allclose(log.mags[0].field.x, expected, atol=1e-12)
    inside = ardupilot(flew | {"COMPASS_EXTERNAL": 0.0})
    before = inside.mags[0].field.x.copy()
    recorrect(inside, "new.param", {"COMPASS_ORIENT": 6.0})
    np.testing.assert_array_equal(inside.mags[0].field.x, before)


def test_the_motor_values_that_flew_are_taken_off_first() -> None:
    flew = OLD | {"COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": -3.0}
    log = ardupilot(flew)
    recorrect(log, "new.param", {"COMPASS_MOT_X": 1.0})
    expected = ardupilot_field(raw_field(), flew | {"COMPASS_MOT_X": 1.0}, power=amperes())
    np.testing.assert_allclose(log.mags[0].field.x, expected, atol=1e-12)


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
    log.power.battery = None
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
    other_imu, other = recorrected_units(log, "new.param", NEW, imu, mag)
    assert other is not None
    np.testing.assert_allclose(other.field.x, ardupilot_field(raw_field(), OLD | NEW, power=amperes()), atol=1e-12)
    np.testing.assert_array_equal(log.mags[0].field.x, before)
    assert (other_imu.acc.x == imu.acc.x).all()
    assert log.problems == []
    assert recorrected_units(log, "new.param", {"AHRS_RP_P": 0.1}, imu, None) == (imu, None)


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
