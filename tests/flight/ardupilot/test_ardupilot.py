"""ArduPilot logs of eras and settings: the best source, the unit that flew, trim, events, units."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import DFReader

import attlog
from attlog import flight, formats
from attlog.flight.ardupilot import reader
from attlog.flight.ardupilot.imu import RecordClock, interpolate_stamps
from attlog.flight.model import FlightLog
from attlog.flight.timestamps import gps_time_us
from attlog.formats.table import ParamChange, Text
from tests.flight.fake import gravity, messages, micros

N, RATE = 1000, 50.0
RATE_XYZ = (0.1, -0.2, 0.3)
BANNER = Text("ArduCopter V4.6.2 (1ebd4d99)", 6, 9_000_000)


def imu(n: int = N, rate: float = RATE, rates: tuple[float, ...] = RATE_XYZ, **extra: Any) -> dict[str, Any]:
    acc = gravity(n)
    return {
        "TimeUS": micros(n, rate),
        **{f"Gyr{a}": np.full(n, r, np.float32) for a, r in zip("XYZ", rates, strict=True)},
        **{f"Acc{a}": acc[:, k] for k, a in enumerate("XYZ")},
        **extra,
    }


def att(n: int = 200, rate: float = 10.0, **angles: float) -> dict[str, Any]:
    return {"TimeUS": micros(n, rate)} | {
        c: np.full(n, angles.get(c, 0.0), np.float32) for c in ("DesRoll", "Roll", "DesPitch", "Pitch", "DesYaw", "Yaw")
    }


def read(tables: dict[tuple[str, int], Any], params: Any = (), texts: Any = (BANNER,), **asked: Any) -> FlightLog:
    return reader.read(messages("dataflash", tables, params, texts), **asked)


def test_imu_is_instantaneous_and_late_by_its_low_pass_at_that_time() -> None:
    params = [
        ParamChange("INS_GYRO_FILTER", 20.0, 1),
        ParamChange("INS_GYRO_FILTER", 80.0, 9_000_000),
        ParamChange("INS_GYRO_FILTER", 5.0, 12_000_000),
        ParamChange("INS_ACCEL_FILTER", 10.0, 1),
    ]
    log = read({("IMU", 0): imu()}, params)
    gyro = log.imus[log.imu].gyro
    assert gyro.sampling == "instant"
    assert gyro.delay == pytest.approx(math.sqrt(2) / (2 * math.pi * 80))
    assert log.imus[log.imu].acc.delay == pytest.approx(math.sqrt(2) / (2 * math.pi * 10))
    assert log.param("INS_GYRO_FILTER") == 80
    assert log.param("INS_GYRO_FILTER", 5.0) == 5
    assert str(log.firmware) == "ArduPilot Copter 4.6.2"


def test_imu_records_without_an_axis_are_not_called_unlogged() -> None:
    records = imu()
    del records["GyrY"]
    log = read({("IMU", 0): records}, [ParamChange("LOG_BITMASK", 2.0**18 + 2.0**7, 1)])
    assert log.imu is None
    told = next(p.text for p in log.problems if p.code == "no_imu")
    assert "hold no GyrY" in told
    assert "LOG_BITMASK" not in told


def test_the_unit_of_the_primary_core_by_the_mask_is_replayed() -> None:
    core = {"TimeUS": micros(100, 5), "PI": np.where(np.arange(100) < 10, 0, 1).astype(np.int8)}
    tables = {("IMU", 0): imu(), ("IMU", 1): imu(), ("IMU", 2): imu(rates=(0.5, 0, 0)), ("XKF4", 0): core}
    log = read(tables, {"EK3_IMU_MASK": 6})
    assert log.imus[log.imu].index == 2
    assert log.imu_that_flew.value == [1, 2]
    assert "lane_switch" in {p.code for p in log.problems}
    assert "XKF4.PI" in log.choices["imu"]
    assert read(tables, {"EK3_IMU_MASK": 6}, imu=0).imus[0].index == 0


def test_old_names_are_units_of_their_own() -> None:
    log = read({("IMU", 0): imu(), ("IMU2", 0): imu(rates=(1.0, 0, 0))})
    assert [(i.index, i.gyro.source) for i in log.imus] == [(0, "IMU"), (1, "IMU2")]


def test_increments_of_log_replay_come_first_with_the_time_of_their_frame() -> None:
    n, dt = 500, 0.0025
    frames = {"TimeUS": micros(n, 400)}
    risi = {
        c: np.full(n, v, np.float32)
        for c, v in (
            ("DVX", 0.0),
            ("DVY", 0.0),
            ("DVZ", -9.81 * dt),
            ("DAX", 0.1 * dt),
            ("DAY", -0.2 * dt),
            ("DAZ", 0.3 * dt),
            ("DVDT", dt),
            ("DADT", dt),
        )
    }
    made = messages("dataflash", {("RFRH", 0): frames, ("RISI", 0): risi, ("IMU", 0): imu()}, (), [BANNER])
    made.tables["RISI", 0].offsets[:] = made.tables["RFRH", 0].offsets + 50  # each behind its own frame
    log = reader.read(made)
    unit = log.imus[log.imu]
    assert (unit.gyro.source, unit.gyro.sampling) == ("RISI:0", "interval")
    assert unit.gyro.rate == pytest.approx(400, rel=0.01)
    np.testing.assert_allclose(unit.gyro.x[5], RATE_XYZ, rtol=1e-5)
    np.testing.assert_allclose(unit.acc.x[5], [0, 0, -9.81], rtol=1e-5)


def test_compass_and_receiver_of_log_replay_stand_in_for_missing_records() -> None:
    n = 200
    frames = {"TimeUS": micros(n, 50, 5_000_000_000)}
    compass = {"LU": (frames["TimeUS"] // 100_000 * 100_000 % 2**32).astype(np.uint32), "UFY": np.ones(n, np.uint8)}
    compass |= {c: np.full(n, v, np.float32) for c, v in (("FX", 200.0), ("FY", 0.0), ("FZ", 400.0))}
    place = {
        "TS": (frames["TimeUS"] // 200_000 * 200).astype(np.uint32),
        "Lat": np.full(n, 473_977_000, np.int32),
        "Lon": np.full(n, 85_456_000, np.int32),
        "Alt": np.full(n, 48_800, np.int32),
    }
    place |= {c: np.full(n, 0.5, np.float32) for c in ("VX", "VY", "VZ", "HA", "VA", "SA")}
    tables = {("RFRH", 0): frames, ("RMGI", 0): compass, ("RGPJ", 0): place}
    made = messages(
        "dataflash", tables | {("IMU", 0): imu() | {"TimeUS": micros(N, RATE, 5_000_000_000)}}, (), [BANNER]
    )
    for name in ("RMGI", "RGPJ"):
        made.tables[name, 0].offsets[:] = made.tables["RFRH", 0].offsets + 50
    log = reader.read(made)
    mag = log.mags[log.mag].field
    assert mag.rate == pytest.approx(10, rel=0.05), "only new values count"
    np.testing.assert_allclose(mag.x[0], [2e-5, 0, 4e-5], rtol=1e-6)
    assert abs(mag.t[0]) < 0.2, "the 32-bit clock has wrapped"
    np.testing.assert_allclose([log.gnss[0].lat[0], log.gnss[0].lon[0], log.gnss[0].alt[0]], [47.3977, 8.5456, 488])


def test_imt_increments_are_preferred_from_100_hz_and_raw_samples_from_400_hz() -> None:
    def imt(rate: float) -> dict[str, Any]:
        n, dt = 500, 1 / rate
        columns = {
            "TimeUS": micros(n, rate),
            "DelT": dt,
            "DelvT": dt,
            "DelaT": dt,
            "DelAX": 0.1 * dt,
            "DelAY": 0.0,
            "DelAZ": 0.0,
            "DelVX": 0.0,
            "DelVY": 0.0,
            "DelVZ": -9.81 * dt,
        }
        return {c: v if isinstance(v, np.ndarray) else np.full(n, v, np.float32) for c, v in columns.items()}

    def sensor(name: str, rate: float, values: tuple[float, ...]) -> dict[str, Any]:
        n = 1200
        t = micros(n, rate)
        return {"TimeUS": t + np.uint64(900), "SampleUS": t} | {
            f"{name}{a}": np.full(n, v, np.float32) for a, v in zip("XYZ", values, strict=True)
        }

    assert read({("IMU", 0): imu(), ("IMT", 0): imt(200.0)}).imus[0].gyro.source == "IMT"
    assert read({("IMU", 0): imu(), ("IMT", 0): imt(50.0)}).imus[0].gyro.source == "IMU"
    fast = {
        ("IMU", 0): imu(),
        ("GYR", 0): sensor("Gyr", 1000, (0.2, 0, 0)),
        ("ACC", 0): sensor("Acc", 1000, (0, 0, -9.8)),
    }
    unit = read(fast, {"INS_GYRO_FILTER": 20.0}).imus[0]
    assert (unit.gyro.source, unit.filtered, unit.gyro.delay) == ("GYR:0", "none", 0.0)
    assert unit.gyro.t[0] == pytest.approx(0.0)
    filtered = read(fast, {"INS_GYRO_FILTER": 20.0, "INS_RAW_LOG_OPT": 5}).imus[0]
    assert filtered.gyro.delay > 0.011
    slow = {
        ("IMU", 0): imu(),
        ("GYR", 0): sensor("Gyr", 100, (0.2, 0, 0)),
        ("ACC", 0): sensor("Acc", 100, (0, 0, -9.8)),
    }
    assert read(slow).imus[0].gyro.source == "IMU"


def test_quaternions_of_the_cores_hold_no_trim_and_euler_records_do() -> None:
    quaternion = {"TimeUS": micros(50, 10), **{f"Q{k + 1}": np.full(50, float(k == 0), np.float32) for k in range(4)}}
    euler = {k: v for k, v in att().items() if not k.startswith("Des")}
    tables = {
        ("IMU", 0): imu(),
        ("ATT", 0): att(),
        ("XKQ", 0): quaternion,
        ("XKF1", 0): euler,
        ("XKF1", 1): euler,
        ("AHR2", 0): euler,
    }
    log = read(tables)
    assert {n: a.has_trim for n, a in log.attitudes.items()} == {
        "ATT": True,
        "AHR2": True,
        "XKQ.0": False,
        "XKF1.1": True,  # XKF1.0 is the same attitude as XKQ.0
    }
    assert log.onboard == "ATT"


def test_a_fast_attitude_record_with_holes_is_not_the_one_that_flew() -> None:
    """A VTOL writes ANG in its hover modes only: more samples than ATT, a third of the time."""
    hover = {c: np.concatenate([x[:1600], x[-1600:]]) for c, x in att(16_000, 400.0).items()}
    log = read({("IMU", 0): imu(2000), ("ATT", 0): att(400), ("ANG", 0): hover})
    assert len(log.attitudes["ANG"].t) > len(log.attitudes["ATT"].t)
    assert log.onboard == "ATT"
    assert log.setpoints.attitude.source == "ATT.Des"
    covered = log.attitudes["ANG"].covers(np.array([1.0, 20.0, 39.0]))
    assert covered.tolist() == [True, False, True]


def test_battery_of_an_old_log_is_what_pymavlink_reads(corpus: Path) -> None:
    path = corpus / "logs" / "bin_copter_3.2.1_quad_cut.BIN"
    theirs, raw = DFReader.DFReader_binary(str(path)), []
    while (record := theirs.recv_match(type="CURR")) is not None:
        raw.append((record.Volt, record.Curr))
    ours = flight.read(path).power.battery.x
    np.testing.assert_allclose(ours, np.array(raw)[: len(ours)] / 100.0)
    assert 14.0 < np.median(ours[:, 0]) < 17.0, "a battery of four cells"


def test_angles_in_hundredths_tell_their_step() -> None:
    coarse = att() | {"Roll": np.round(np.random.default_rng(1).normal(0, 5, 200), 2)}
    fine = att() | {"Roll": np.random.default_rng(1).normal(0, 5, 200)}
    assert read({("IMU", 0): imu(), ("ATT", 0): coarse}).attitudes["ATT"].step_deg == 0.01
    assert read({("IMU", 0): imu(), ("ATT", 0): fine}).attitudes["ATT"].step_deg == 0.0


def test_resets_stand_where_yaw_was_reset_and_where_another_estimator_took_over() -> None:
    yaw = np.where(np.arange(200) < 50, 10.0, np.where(np.arange(200) < 120, 20.0, 30.0))
    columns = att() | {"Yaw": yaw, "AEKF": np.where(np.arange(200) < 50, 0, 3).astype(np.uint8)}
    events = {"TimeUS": np.array([10_000_000 + 11_950_000], np.uint64), "Id": np.array([62], np.uint8)}
    log = read({("IMU", 0): imu(), ("ATT", 0): columns, ("EV", 0): events})
    assert log.attitudes["ATT"].resets.tolist() == [50, 120]


def test_the_attitude_steps_at_the_first_record_of_another_estimator() -> None:
    """A larger step two records before: a time one record early would put the reset there."""
    yaw = 10.0 * np.arange(200) / 200
    yaw[48:] += 8.0
    yaw[50:] += 5.0
    columns = att() | {"Yaw": yaw, "AEKF": np.where(np.arange(200) < 50, 0, 3).astype(np.uint8)}
    assert read({("IMU", 0): imu(), ("ATT", 0): columns}).attitudes["ATT"].resets.tolist() == [50]


def test_armed_and_landed_follow_the_events_and_begin_on_the_ground() -> None:
    events = {"TimeUS": np.array([15, 17, 25, 28], np.uint64) * 1_000_000, "Id": np.array([10, 28, 18, 11], np.uint8)}
    log = read({("IMU", 0): imu(), ("EV", 0): events})
    assert [log.state.armed.at(t) for t in (0, 6, 19)] == [False, True, False]
    assert [log.state.landed.at(t) for t in (0, 8, 16)] == [True, False, True]


@pytest.mark.parametrize(
    ("banner", "reasons"),
    [
        ("ArduCopter V3.5.7 (1ebd4d99)", ["", "EKF failsafe", ""]),
        ("ArduPlane V4.5.7 (1ebd4d99)", ["", "EKF failsafe", ""]),
        ("ArduRover V3.5.0 (1ebd4d99)", None),  # its numbers meant something else until 4.0
    ],
)
def test_the_failsafe_that_set_a_mode_is_its_reason(banner: str, reasons: list[str] | None) -> None:
    modes = {
        "TimeUS": np.array([11, 13, 15], np.uint64) * 1_000_000,
        "Mode": np.array([5, 9, 2], np.uint8),
        "Rsn": np.array([1, 6, 1], np.uint8),
    }
    log = read({("IMU", 0): imu(), ("MODE", 0): modes}, texts=[Text(banner, 6, 9_000_000)])
    line = log.state.mode_reason
    assert (line and line.value) == reasons


def test_gps_week_time_is_not_taken_for_the_boot_clock() -> None:
    n = 50
    columns = {
        "Status": np.full(n, 3, np.uint8),
        "TimeMS": 7_959_200 + 200 * np.arange(n),
        "Week": np.full(n, 1815, np.uint16),
        "Lat": np.full(n, 30.15),
        "Lng": np.full(n, -97.95),
        "Alt": np.full(n, 283.0),
        "Spd": np.full(n, 2.0),
        "GCrs": np.full(n, 90.0),
        "VZ": np.full(n, 0.5),
        "T": 10_000 + 200 * np.arange(n),
    }
    old = imu()
    old["TimeMS"] = (old.pop("TimeUS") // 1000).astype(np.uint32)
    log = read({("IMU", 0): old, ("GPS", 0): columns}, texts=())
    assert log.gnss[0].t[0] == pytest.approx(0.0)
    np.testing.assert_allclose(log.gnss[0].vel_ned[0], [0, 2, 0.5], atol=1e-12)
    assert log.utc_offset == pytest.approx(315_964_800 + 1815 * 604_800 + 7959.2 - 16)


def test_accuracies_belong_to_their_fix_and_a_heading_of_zero_is_none() -> None:
    """GPA comes with each GPS record until it stops after 5 s; a receiver without two antennas writes a yaw of 0."""
    n, t = 50, micros(50, 5.0)
    one = np.ones(n)
    fixes = {
        "TimeUS": t,
        "Status": np.full(n, 3, np.uint8),
        "Lat": 47 * one,
        "Lng": 8 * one,
        "Alt": 400 * one,
        "Spd": 2 * one,
        "GCrs": 90 * one,
        "VZ": 0 * one,
        "Yaw": 270.0 * (np.arange(n) >= 10),
    }
    told = {"TimeUS": t[:25]} | {c: np.full(25, v) for c, v in (("HAcc", 0.8), ("VAcc", 1.2), ("SAcc", 0.3))}
    gnss = read({("IMU", 0): imu(), ("GPS", 0): fixes, ("GPA", 0): told}).gnss[0]
    assert np.flatnonzero(np.isfinite(gnss.h_acc)).tolist() == list(range(27))  # two more within 0.5 s
    assert (gnss.h_acc[0], gnss.v_acc[0], gnss.s_acc[0]) == (0.8, 1.2, 0.3)
    assert np.isnan(gnss.yaw[:10]).all()
    np.testing.assert_allclose(gnss.yaw[10:], np.radians(-90.0))


def test_a_fix_came_when_gpa_says_and_not_when_it_was_written() -> None:
    """SMS is 30 ms before TimeUS; where it is later, or a second before, it is not believed."""
    n, t = 50, micros(50, 5.0)
    one = np.ones(n)
    fixes = {"TimeUS": t, "Status": np.full(n, 3, np.uint8), "Lat": 47 * one, "Lng": 8 * one, "Alt": 400 * one}
    fixes |= {"Spd": 2 * one, "GCrs": 90 * one, "NSats": np.full(n, 17, np.uint8), "HDop": np.full(n, 99.99)}
    before = np.where(np.arange(n) < 40, 30, np.where(np.arange(n) < 45, -20, 1500))
    told = {"TimeUS": t, "SMS": (t.astype(np.int64) // 1000 - before).astype(np.uint32)}
    gnss = read({("IMU", 0): imu(), ("GPS", 0): fixes, ("GPA", 0): told}).gnss[0]
    assert gnss.received is not None
    np.testing.assert_allclose(gnss.t - gnss.received, np.where(np.arange(n) < 40, 0.03, 0.0), atol=1e-3)
    assert gnss.reception is not None
    assert gnss.reception.satellites.tolist() == [17.0] * n
    assert np.isnan(gnss.reception.hdop).all()


def test_gps_week_and_leap_seconds_give_the_calendar() -> None:
    # 2016-12-31 23:59:59 and 2017-01-01 00:00:00 UTC lie two GPS seconds apart: a leap second between them
    week, before, after = np.array([1930]), np.array([17_000]), np.array([18_000])
    assert gps_time_us(week, after)[0] == 1_483_228_800 * 10**6
    assert gps_time_us(np.array([0]), before)[0] == 0


def test_a_receiver_whose_week_counter_turned_over_tells_no_date() -> None:
    n = 20
    place = {
        "Lat": np.full(n, 47.0),
        "Lng": np.full(n, 8.0),
        "Alt": np.full(n, 500.0),
        "Spd": np.zeros(n),
        "GCrs": np.zeros(n),
        "VZ": np.zeros(n),
        "Status": np.full(n, 3),
        "GMS": 1000 * np.arange(n),
    }
    for week, code in ((2300, set()), (2300 - 1024, {"values_out_of_range"}), (2300 - 2048, {"values_out_of_range"})):
        gps = {"TimeUS": micros(n, 5.0), "GWk": np.full(n, week, np.uint16), **place}
        log = read({("IMU", 0): imu(), ("GPS", 0): gps})
        assert (log.utc_offset is None) == bool(code), week
        assert {p.code for p in log.problems} - {"no_mag"} == code, week


def test_a_gyro_of_one_unit_and_an_accelerometer_of_another_are_no_pair() -> None:
    whole = imu(2000, 1000.0)
    gyr = {c: whole[c] for c in ("TimeUS", "GyrX", "GyrY", "GyrZ")}
    acc = {c: whole[c] for c in ("TimeUS", "AccX", "AccY", "AccZ")}
    log = read({("GYR", 0): gyr, ("ACC", 1): acc})
    assert log.imu is None
    told = [p.text for p in log.problems if p.code == "no_imu"]
    assert "of one unit" in told[0], "the log does hold a gyro and an accelerometer"


def test_rate_setpoints_in_hundredths_of_a_degree_are_recognised_by_the_gyro() -> None:
    rng = np.random.default_rng(3)
    truth = rng.normal(0, 0.5, (N, 3))
    tables: dict[tuple[str, int], Any] = {("IMU", 0): imu() | {f"Gyr{a}": truth[:, k] for k, a in enumerate("XYZ")}}
    for factor in (1.0, 100.0):
        measured = np.degrees(truth) * factor
        rate = {"TimeUS": micros(N, RATE)}
        for k, (des, act) in enumerate((("RDes", "R"), ("PDes", "P"), ("YDes", "Y"))):
            rate |= {des: measured[:, k], act: measured[:, k]}
        log = read(tables | {("RATE", 0): rate})
        np.testing.assert_allclose(log.setpoints.rates.x, truth, rtol=1e-9)


def test_a_compass_that_shows_only_its_offsets_is_dead() -> None:
    n = 100
    offsets = {"OfsX": -36, "OfsY": 1, "OfsZ": -56}
    columns = {"TimeUS": micros(n, 10)} | {c: np.full(n, v, np.int16) for c, v in offsets.items()}
    columns |= {f"Mag{a}": columns[f"Ofs{a}"] for a in "XYZ"}
    log = read({("IMU", 0): imu(), ("MAG", 0): columns})
    assert log.mag is None
    assert "mag_only_offsets" in {p.code for p in log.problems}


def test_a_compass_that_never_changes_while_the_vehicle_turns_is_dead() -> None:
    n = 100
    columns = {"TimeUS": micros(n, 10)} | {f"Mag{a}": np.full(n, 200, np.int16) for a in "XYZ"}
    swinging = imu() | {"GyrZ": np.sin(np.arange(N) / 20).astype(np.float32)}
    assert read({("IMU", 0): swinging, ("MAG", 0): columns}).mag is None
    assert read({("IMU", 0): imu(), ("MAG", 0): columns}).mag == 0, "at rest a constant field is possible"


def test_a_log_without_any_time_says_so() -> None:
    columns = imu()
    del columns["TimeUS"]
    log = read({("IMU", 0): columns}, texts=())
    assert log.imu is None
    assert {"no_clock", "no_imu"} <= {p.code for p in log.problems}


@pytest.mark.parametrize(
    ("text", "firmware", "vehicle"),
    [
        ("AntennaTracker V4.5.0 (abcdef12)", "ArduPilot Tracker 4.5.0", "tracker"),
        ("Blimp V4.6.0-dev (abcdef12)", "ArduPilot Blimp 4.6.0-dev", "blimp"),
        ("APM:Copter V3.5.4 (284349c3)", "ArduPilot Copter 3.5.4", "multirotor"),
    ],
)
def test_every_firmware_says_who_it_is(text: str, firmware: str, vehicle: str) -> None:
    log = read({("IMU", 0): imu()}, texts=(Text(text, 6, 9_000_000),))
    assert (str(log.firmware), log.vehicle) == (firmware, vehicle)


@pytest.mark.parametrize("value", [-1e30, 1e30, math.nan, math.inf])
def test_an_impossible_cutoff_is_unknown(value: float) -> None:
    unit = read({("IMU", 0): imu()}, [ParamChange("INS_GYRO_FILTER", value, 1)]).imus[0]
    assert (unit.filtered, unit.gyro.delay) == ("unknown", 0.0)


@pytest.mark.parametrize(
    ("banner", "column", "stored"),
    [
        ("ArduCopter V4.6.2 (1ebd4d99)", "ThO", 0.5),
        ("ArduCopter V3.2.1 (36b405fb)", "ThrOut", 500.0),
        ("ArduPlane V4.5.0 (1ebd4d99)", "ThO", 50.0),
        ("ArduRover V4.5.0 (1ebd4d99)", "ThO", 50.0),
    ],
)
def test_half_throttle_is_a_half_in_every_vehicle(banner: str, column: str, stored: float) -> None:
    control = {"TimeUS": micros(20, 5), column: np.full(20, stored, np.float32)}
    log = read({("IMU", 0): imu(), ("CTUN", 0): control}, texts=(Text(banner, 6, 9_000_000),))
    assert log.power.throttle is not None
    np.testing.assert_allclose(log.power.throttle.x, 0.5, rtol=1e-6)


# Times of records that carry none: from their place in the file between GPS records.


def test_places_between_gps_records_are_times_between_theirs_and_go_on_at_the_mean_pace():
    stamps = interpolate_stamps(
        np.array([0, 100, 150, 300, 400]), np.array([100, 200, 300]), np.array([1000, 3000, 5000])
    )
    np.testing.assert_array_equal(stamps, [-1000 + 1000, 1000, 2000, 5000, 7000])


def test_attitudes_of_arducopter_3_1_are_placed_as_pymavlink_places_them(corpus):
    """Only its GPS records carry a time; pymavlink counts messages between them."""
    path = corpus / "logs" / "log_copter_3.1_noimu.log"
    theirs = DFReader.DFReader_text(str(path))
    stamps, first = [], None
    while (m := theirs.recv_match(type=["ATT", "GPS"])) is not None:
        if m.get_type() == "GPS" and first is None:
            first = m._timestamp - 1e-3 * m.T
        elif m.get_type() == "ATT" and first is not None:
            stamps.append(m._timestamp - first)
    messages = formats.open(path)
    ours = 1e-6 * RecordClock(messages).of_samples(messages.first("ATT"))[-len(stamps) :]
    assert np.median(np.abs(ours - stamps)) < 0.2
    assert np.abs(ours - stamps).max() < 1.0


def test_the_crash_of_a_log_without_an_imu_is_told(corpus):
    """ATT turns to 113 deg at 105 s, and the crash check stops the motors 5 s later (ERR 12/1)."""
    result = attlog.analyze(corpus / "logs" / "log_copter_3.1_noimu.log")
    (crash,) = [e for e in result.events if e.severity == "serious"]
    assert (crash.kind, crash.t) == ("overturn", pytest.approx(104.9, abs=0.5))
    assert any("ERR 12/1" in x for x in crash.evidence)
    assert any(e.kind == "liftoff" and e.evidence == ["CTUN.BarAlt"] for e in result.events)
