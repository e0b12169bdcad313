"""What no sensor, clock or parameter can say is left out where it enters, counted and told; the rest stays."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from attlog.core.errors import UsageError
from attlog.flight import limits, read
from attlog.flight import limits as parameter_limits
from attlog.flight.ardupilot import reader as ardupilot
from attlog.flight.builder import LogBuilder
from attlog.flight.gnss import build_gnss
from attlog.flight.limits import documented_range, is_integer
from attlog.flight.model import FlightLog, Gnss, Problem
from attlog.flight.parameters import read_parameter_file
from attlog.flight.px4 import reader as px4
from attlog.formats.table import ParamChange
from tests.flight.fake import gravity, level, messages, micros

N = 400
Tables = dict[tuple[str, int], dict[str, Any]]


def told(problems: list[Problem], words: str) -> list[int]:
    return [p.count for p in problems if p.code == "values_out_of_range" and words in p.text]


def px4_tables() -> Tables:
    t = micros(N, 200.0)
    one = np.ones(N, np.float32)
    return {
        ("sensor_combined", 0): {
            "timestamp": t,
            "gyro_rad": np.full((N, 3), 0.01, np.float32),
            "accelerometer_m_s2": gravity(N),
            "gyro_integral_dt": np.full(N, 5000, np.uint32),
        },
        ("vehicle_magnetometer", 0): {
            "timestamp": t,
            "magnetometer_ga": np.tile(np.array([0.2, 0.0, 0.4], np.float32), (N, 1)),
        },
        ("sensor_gps", 0): {
            "timestamp": t,
            "latitude_deg": 47.0 * one.astype(float),
            "longitude_deg": 8.0 * one.astype(float),
            "altitude_msl_m": 400.0 * one.astype(float),
            "fix_type": np.full(N, 3, np.uint8),
            "time_utc_usec": 1_700_000_000_000_000 + t,
            "eph": one,
            "epv": one,
            "s_variance_m_s": one,
            "vel_n_m_s": one,
            "vel_e_m_s": one,
            "vel_d_m_s": one,
            "heading": one,
        },
        ("vehicle_air_data", 0): {"timestamp": t, "baro_alt_meter": 400.0 * one},
        ("airspeed_validated", 0): {"timestamp": t, "true_airspeed_m_s": 15.0 * one},
        ("battery_status", 0): {"timestamp": t, "voltage_v": 16.0 * one, "current_a": 9.0 * one},
        ("esc_status", 0): {"timestamp": t, "esc[0].esc_rpm": np.full(N, 6000, np.int64)},
        ("vehicle_rates_setpoint", 0): {"timestamp": t, "roll": one, "pitch": one, "yaw": one},
        ("vehicle_thrust_setpoint", 0): {"timestamp": t, "xyz": np.tile(np.float32([0, 0, -0.5]), (N, 1))},
        ("vehicle_attitude", 0): {"timestamp": t, "q": level(N)},
    }


def read_px4(tables: Tables) -> FlightLog:
    with np.errstate(all="ignore"):
        return px4.read(messages("ulog", tables, info={"sys_name": "PX4"}))


def numbers(log: FlightLog) -> dict[str, np.ndarray]:
    """Everything that the fields below end in, with the limit that holds there."""
    g, battery = log.gnss[0], log.power.battery
    assert battery is not None
    assert log.airspeed is not None
    assert log.power.rpm is not None
    assert log.setpoints.rates is not None
    assert log.power.throttle is not None
    return {
        "gyro_rad": log.imus[0].gyro.x,
        "accelerometer_m_s2": log.imus[0].acc.x,
        "magnetometer_ga": log.mags[0].field.x,
        "altitude_msl_m": g.alt,
        "vel_n_m_s": g.vel_ned[:, 0],
        "vel_d_m_s": g.vel_ned[:, 2],
        "eph": g.h_acc,
        "epv": g.v_acc,
        "s_variance_m_s": g.s_acc,
        "heading": g.yaw if g.yaw is not None else np.zeros(1),
        "baro_alt_meter": log.baro[0].x,
        "latitude_deg": g.lat,
        "longitude_deg": g.lon,
        "true_airspeed_m_s": log.airspeed.x,
        "voltage_v": battery.x[:, 0],
        "current_a": battery.x[:, 1],
        "esc[0].esc_rpm": log.power.rpm.x,
        "roll": log.setpoints.rates.x,
        "xyz": log.power.throttle.x,
        "q": log.attitudes["vehicle_attitude"].q,
    }


FIELDS = [
    (key, column)
    for key, columns in px4_tables().items()
    for column in columns
    if column not in ("timestamp", "gyro_integral_dt", "fix_type", "time_utc_usec", "vel_e_m_s", "pitch", "yaw")
]


@pytest.mark.parametrize(("key", "column"), FIELDS, ids=[c for _, c in FIELDS])
def test_impossible_values_of_every_field_are_left_out_and_counted(key: tuple[str, int], column: str) -> None:
    tables = px4_tables()
    kind = np.asarray(tables[key][column]).dtype.kind
    for value in (1e34, -1e34, math.inf) if kind == "f" else (2**40, -(2**40)):
        hostile = np.array(tables[key][column])
        hostile[50:57] = value
        log = read_px4({**tables, key: {**tables[key], column: hostile}})
        found = numbers(log)[column]
        assert np.nanmax(np.abs(found)) < 1e7, "nothing impossible stays"
        assert len(found) >= N - 7, "what is possible stays"
        refused = [p.count for p in log.problems if p.code == "values_out_of_range"]
        spikes = [p.count for p in log.problems if p.code == "mag_spikes"]
        assert refused + spikes == [7]


def test_a_field_that_is_impossible_throughout_is_no_magnetometer() -> None:
    tables = px4_tables()
    tables["vehicle_magnetometer", 0]["magnetometer_ga"] = np.full((N, 3), 1e30, np.float32)
    log = read_px4(tables)
    assert log.mags == []
    assert log.mag is None
    assert told(log.problems, "magnetometer") == [N]


def test_values_without_a_fix_are_unknown_and_not_impossible() -> None:
    tables = px4_tables()
    tables["sensor_gps", 0] |= {"fix_type": np.zeros(N, np.uint8), "eph": np.full(N, 4294967.5, np.float32)}
    tables["sensor_gps", 0]["altitude_msl_m"] = np.full(N, -17_000.0)
    log = read_px4(tables)
    assert told(log.problems, "") == []
    assert np.isnan(log.gnss[0].alt).all()
    assert np.isnan(log.gnss[0].h_acc).all()


def test_impossible_dates_are_counted_where_there_is_a_fix() -> None:
    tables = px4_tables()
    tables["sensor_gps", 0]["time_utc_usec"] = np.full(N, 2**61, np.uint64)
    log = read_px4(tables)
    assert told(log.problems, "dates") == [N]
    assert log.utc_offset is None
    assert log.gnss[0].utc_us is None
    tables["sensor_gps", 0]["fix_type"] = np.where(np.arange(N) < 5, 3, 2).astype(np.uint8)
    assert told(read_px4(tables).problems, "dates") == [5], "a receiver without height may not know the date yet"


@pytest.mark.parametrize("scale", [1e-3, 1e-6])
def test_stamps_of_another_unit_give_no_rate(scale: float) -> None:
    tables = px4_tables()
    for columns in tables.values():
        columns["timestamp"] = (columns["timestamp"] * scale).astype(np.uint64) + np.arange(N, dtype=np.uint64)
    log = read_px4(tables)
    assert log.imu is None
    assert log.imus == []
    assert not any(s is not None and s.rate > limits.FUSED_HZ for s in (*log.baro, log.power.battery, log.power.rpm))
    assert "rate_impossible" in [p.code for p in log.problems]


def test_a_fast_gyro_is_no_false_clock() -> None:
    t = micros(2000, 32_000.0)
    builder = LogBuilder(messages("ulog", {}))
    assert len(builder.select_records(t, "gyro", fastest_hz=limits.RAW_HZ)) == len(t)
    assert len(builder.select_records(t, "attitude")) == 0


def test_events_and_modes_a_day_away_belong_to_another_flight() -> None:
    tables = px4_tables()
    t = micros(5, 1.0)
    t[2] += np.uint64(30 * 86_400 * 10**6)
    tables["vehicle_status", 0] = {
        "timestamp": t,
        "arming_state": np.array([1, 2, 1, 2, 2], np.uint8),
        "failsafe": np.array([0, 0, 1, 0, 0]),
    }
    log = read_px4(tables)
    assert log.state.armed is not None
    assert log.state.armed.value == [False, True]
    assert [p.code for p in log.problems if p.code == "failsafe"] == []


def test_text_in_place_of_a_number_costs_its_message_only() -> None:
    tables = px4_tables()
    tables["vehicle_air_data", 0]["timestamp"] = np.array([b"x"] * N)
    tables["estimator_selector_status", 0] = {
        "timestamp": np.zeros((N, 3), np.uint64),
        "gyro_device_id": np.ones(N, np.uint32),
        "primary_instance": np.zeros(N, np.uint8),
    }
    log = read_px4(tables)
    assert log.imu is not None
    assert log.baro == []
    assert "unreadable_message" in [p.code for p in log.problems]


def ardupilot_log(change: Callable[[Tables], None]) -> FlightLog:
    t = micros(N, 200.0)
    g = gravity(N)
    zero, one = np.zeros(N, np.float32), np.ones(N, np.float32)
    tables: Tables = {
        ("IMU", 0): {
            "TimeUS": t,
            "GyrX": zero,
            "GyrY": zero,
            "GyrZ": zero + 0.01,
            "AccX": g[:, 0],
            "AccY": g[:, 1],
            "AccZ": g[:, 2],
            "T": 30 * one,
        },
        ("GPS", 0): {
            "TimeUS": t,
            "Status": np.full(N, 3, np.uint8),
            "Lat": 47 * one,
            "Lng": 8 * one,
            "Alt": 400 * one,
            "Spd": one,
            "GCrs": one,
            "VZ": zero,
            "GWk": np.full(N, 2300),
            "GMS": np.full(N, 1000),
        },
        ("BARO", 0): {"TimeUS": t, "Alt": one},
        ("BAT", 0): {"TimeUS": t, "Volt": 16 * one, "Curr": one},
    }
    change(tables)
    with np.errstate(all="ignore"):
        return ardupilot.read(messages("dataflash", tables))


def test_an_ardupilot_log_is_held_to_the_same_limits() -> None:
    for key, column, words in (
        (("GPS", 0), "Alt", "GNSS height"),
        (("GPS", 0), "Spd", "GNSS speed"),
        (("BARO", 0), "Alt", "barometric height"),
        (("BAT", 0), "Volt", "battery voltage"),
        (("IMU", 0), "T", "sensor temperature"),
        (("IMU", 0), "GyrX", "gyro"),
    ):

        def spoil(tables: Tables, key: tuple[str, int] = key, column: str = column) -> None:
            tables[key][column] = np.where(np.arange(N) < 9, 3e33, tables[key][column]).astype(np.float32)

        counts = told(ardupilot_log(spoil).problems, words)
        assert sum(counts) in (9, 18), words  # a speed is two components of the velocity
    assert told(ardupilot_log(lambda tables: None).problems, "") == []


def test_many_parameters_of_a_quantity_are_one_problem_with_their_number() -> None:
    """A damaged log refused 16 ends of radio channels in 16 sentences."""
    changes = [ParamChange(f"RC{k}_{end}", 1e9) for k in range(1, 9) for end in ("MIN", "MAX")]
    log = messages("ulog", {}, [*changes, ParamChange("RC1_MIN", 1000.0), ParamChange("CAL_GYRO0_ROT", 1e9)])
    told = parameter_limits.drop_impossible(log)
    assert [(p.code, p.count) for p in told] == [("values_out_of_range", 16), ("values_out_of_range", 1)]
    start = (
        "16 parameters (RC1_MIN, RC1_MAX, RC2_MIN, RC2_MAX and 12 more): left out 16 of 17 values, "
        "such as 1e+09: the pulse"
    )
    assert told[0].text.startswith(start)
    assert told[1].text.startswith("Parameter CAL_GYRO0_ROT: left out 1e+09: ")
    assert [change.value for change in log.params] == [1000.0]


# Each parameter that is computed with has the limits of its quantity, both ends of them.

GROUPS = [
    ("EKF2_MAG_DECL ATT_MAG_DECL", -180.0, 180.0),
    ("COMPASS_DEC", -math.pi, math.pi),
    ("INS_GYRO_FILTER INS_ACCEL_FILTER IMU_GYRO_CUTOFF IMU_ACCEL_CUTOFF", 1.0, 10_000.0),
    ("CAL_ACC0_XSCALE CAL_MAG0_ZSCALE CAL_MAG1_YODIAG", -20.0, 20.0),
    ("CAL_GYRO0_ROT CAL_ACC0_ROT CAL_MAG0_ROT SENS_BOARD_ROT", -1.0, 200.0),
    ("MOT_PWM_MIN MOT_PWM_MAX RC3_MIN RC16_MAX", 0.0, 10_000.0),
    ("FRAME_CLASS SYSID_SW_TYPE RCMAP_THROTTLE INS_RAW_LOG_OPT", -1.0, 65_535.0),
]


@pytest.mark.parametrize(("names", "low", "high"), GROUPS)
def test_a_parameter_has_the_limits_of_its_quantity(names: str, low: float, high: float) -> None:
    for name in names.split():
        found = limits.parameter_quantity(name)
        assert found is not None, name
        assert (found.low, found.high) == (low, high), name
        assert limits.broken_limits(name, low) is limits.broken_limits(name, high) is None
        beyond = high + 1e-6 * max(abs(high), 1.0)
        assert limits.broken_limits(name, beyond) is found
        below = low - 1e-6 * max(abs(low), 1.0)
        assert limits.broken_limits(name, below) is found
        assert limits.broken_limits(name, math.nan) is found


def test_a_filter_that_is_off_is_possible_and_one_below_a_hertz_is_not() -> None:
    for value, possible in ((0.0, True), (-1.0, True), (-0.5, True), (-1.01, False), (0.01, False), (0.99, False)):
        assert (limits.broken_limits("IMU_GYRO_CUTOFF", value) is None) is possible
    assert limits.broken_limits("SCHED_LOOP_RATE", -0.5) is not None


def test_limits_in_words_have_their_unit_and_a_true_minus() -> None:
    assert limits.HEIGHT.limits == "−1,000 to 100,000 m"
    assert limits.SATELLITES.limits == "0 to 100"


# Ranges of parameters as the firmwares' own lists give them (@Range of ArduPilot 4.5, @min and @max of PX4 1.14).


@pytest.mark.parametrize(
    ("names", "low", "high"),
    [
        ("COMPASS_OFS_X COMPASS_OFS2_Y COMPASS_OFS3_Z", -400.0, 400.0),
        ("COMPASS_MOTCT INS_TCAL2_ENABLE", 0.0, 2.0),
        ("COMPASS_USE COMPASS_USE3 INS_HNTCH_ENABLE INS_HNTC2_ENABLE INS_HNTCH_REF", 0.0, 1.0),
        ("INS_ACCOFFS_X INS_ACC2OFFS_Y INS_ACC3OFFS_Z INS4_ACCOFFS_X CAL_ACC0_XOFF CAL_ACC3_ZOFF", -3.5, 3.5),
        ("INS_HNTCH_FREQ INS_HNTC2_FREQ", 10.0, 400.0),
        ("GPS_DELAY_MS GPS_DELAY_MS2 GPS1_DELAY_MS GPS2_DELAY_MS EK3_HGT_DELAY", 0.0, 250.0),
        ("EK3_VELNE_M_NSE EK3_VELD_M_NSE EK2_VELNE_M_NSE", 0.05, 5.0),
        ("EK3_ALT_M_NSE", 0.1, 100.0),
        ("CAL_MAG0_PRIO CAL_MAG3_PRIO IMU_GYRO_NF0_BW", 0.0, 100.0),
        ("EKF2_GPS_DELAY EKF2_MAG_DELAY EKF2_BARO_DELAY SENS_GPS0_DELAY", 0.0, 300.0),
        ("EKF2_MAG_NOISE", 0.001, 1.0),
    ],
)
def test_a_parameter_has_the_range_of_its_firmware(names: str, low: float, high: float) -> None:
    assert {name: documented_range(name) for name in names.split()} == dict.fromkeys(names.split(), (low, high))


@pytest.mark.parametrize(
    "name", ["COMPASS_OFS4_X", "XCOMPASS_OFS_X", "COMPASS_OFS_X2", "EKF2_GPS_DELAYS", "ARMING_CHECK", ""]
)
def test_a_parameter_that_is_in_no_list_is_never_offered(name: str) -> None:
    assert documented_range(name) is None


def test_counts_switches_and_devices_are_whole_numbers() -> None:
    whole = ["COMPASS_USE2", "INS_HNTCH_OPTS", "CAL_MAG0_ROT", "GPS_DELAY_MS", "IMU_GYRO_DNF_HMC", "EK3_HGT_DELAY"]
    assert [name for name in whole if not is_integer(name)] == []
    assert not any(is_integer(name) for name in ("COMPASS_OFS_X", "INS_HNTCH_FREQ", "EKF2_GPS_DELAY", "CAL_MAG0_XOFF"))


# A ground station's parameter file fills in what a log does not tell.

SPELLINGS = {
    "mission_planner": "#NOTE: 2024\nAHRS_TRIM_X,0.01\nCOMPASS_DEC,-0.25\n",
    "mavproxy": "AHRS_TRIM_X      0.010000\nCOMPASS_DEC     -0.25 # east\n",
    "qgroundcontrol": "# Vehicle Component Name Value Type\n1\t1\tAHRS_TRIM_X\t0.01\t9\n1\t1\tCOMPASS_DEC\t-0.25\t9\n",
}


@pytest.mark.parametrize("text", SPELLINGS.values(), ids=SPELLINGS.keys())
def test_every_ground_station_is_understood(tmp_path, text):
    path = tmp_path / "p.param"
    path.write_text(text)
    assert read_parameter_file(path) == {"AHRS_TRIM_X": 0.01, "COMPASS_DEC": -0.25}


@pytest.mark.parametrize("line", ["ONLY_A_NAME", "A,b", "A,nan", "A,1,2"])
def test_a_line_that_is_no_parameter_is_told_with_its_number(tmp_path, line):
    path = tmp_path / "p.param"
    path.write_text(f"# first\n{line}\n")
    with pytest.raises(UsageError, match="line 2"):
        read_parameter_file(path)


def test_all_bad_lines_are_told_at_once(tmp_path):
    path = tmp_path / "p.param"
    path.write_text("A,1\nB\nC,x\n\nD,2\nA,1\nD,3\n")
    with pytest.raises(UsageError) as refused:
        read_parameter_file(path)
    lines = str(refused.value).splitlines()
    assert [line.split("line ")[1].split(":")[0] for line in lines] == ["2", "3", "7"]
    assert lines[2].endswith("D is 3, in line 5 it was 2")
    path.write_text("".join(f"N{i},x\n" for i in range(20)))
    with pytest.raises(UsageError, match="14 more lines"):
        read_parameter_file(path)


@pytest.mark.parametrize("text", ["", "# nothing\n\n"])
def test_a_file_without_parameters_is_refused(tmp_path, text):
    path = tmp_path / "p.param"
    path.write_text(text)
    with pytest.raises(UsageError, match="holds no parameter"):
        read_parameter_file(path)


def test_the_log_counts_where_it_holds_the_parameter_itself(tmp_path, samples):
    path = tmp_path / "p.param"
    path.write_text("AHRS_TRIM_X,0.5\nMY_OWN,7\n")
    log = samples / "copter_steps_stabilize.bin"
    plain, filled = read(log), read(log, params=path)
    assert plain.param("MY_OWN") is None
    assert filled.param("MY_OWN") == 7
    assert filled.parameters.lines["AHRS_TRIM_X"].value == plain.parameters.lines["AHRS_TRIM_X"].value
    assert 0.5 not in filled.parameters.lines["AHRS_TRIM_X"].value


def test_what_differs_and_what_the_log_does_not_know_is_said(tmp_path, samples):
    path = tmp_path / "new.param"
    path.write_text("AHRS_RP_P,0.1\nAHRS_YAW_P,0.2\nAHRS_GPS_GAINN,1\nMY_OWN,7\n")
    log = read(samples / "copter_steps_stabilize.bin", params=path)
    found = {p.code: p for p in log.problems}
    assert "AHRS_RP_P 0.2 -> 0.1" in found["params_differ"].text
    assert "AHRS_YAW_P" not in found["params_differ"].text
    assert "AHRS_GPS_GAINN (did you mean AHRS_GPS_GAIN?), MY_OWN" in found["params_unknown"].text
    assert found["params_unknown"].severity == "warning"
    assert log.parameters.filled == {"AHRS_GPS_GAINN", "MY_OWN"}
    assert log.parameters.given["AHRS_RP_P"] == 0.1
    assert log.param("AHRS_RP_P") == pytest.approx(0.2)
    path.write_text("MY_OWN,7\n")
    assert {p.code: p.severity for p in read(log.path, params=path).problems}["params_unknown"] == "note"
    plain = {p.code for p in read(log.path).problems}
    assert not plain & {"params_differ", "params_unknown"}


def receiver(lat: np.ndarray, lon: np.ndarray, utc_us: np.ndarray | None = None) -> tuple[LogBuilder, Gnss | None]:
    n = len(lat)
    builder = LogBuilder(messages("ulog", {}), t0_us=10_000_000)
    place, nothing = np.column_stack([lat, lon, np.full(n, 400.0)]), np.full(n, np.nan)
    found = build_gnss(
        builder,
        0,
        micros(n, 5.0).astype(np.int64),
        "gps",
        place=place,
        velocity=np.zeros((n, 3)),
        fix=np.full(n, 3),
        accuracy=(nothing, nothing, nothing),
        utc_us=utc_us,
    )
    return builder, found


def test_a_place_on_another_continent_for_one_fix_is_damage_and_one_that_stays_is_not() -> None:
    lat, lon = np.full(100, 47.0), np.full(100, 179.9999) + 4e-6 * np.arange(100)
    lon = (lon + 180.0) % 360.0 - 180.0  # the flight crosses the date line
    lat[40], lon[40] = -12.0, -77.0
    lat[60:62], lon[60:62] = 0.0, 0.0
    builder, found = receiver(lat, lon)
    assert found is not None
    assert (len(found.t), told(builder.problems, "over 100 km")) == (97, [3])
    lat, lon = np.full(100, 50.0), np.full(100, 30.0)
    lat[50:], lon[50:] = -12.0, -77.0  # as spoofing of receivers shows it
    builder, found = receiver(lat, lon)
    assert found is not None
    assert (len(found.t), builder.problems) == (100, [])


def test_a_date_1024_weeks_ahead_is_named_and_not_used() -> None:
    at = 1_780_000_000_000_000 + 200_000 * np.arange(100, dtype=np.int64)
    still = np.full(100, 47.0)
    builder, found = receiver(still, still, at + 1024 * 604_800 * 1_000_000)
    assert found is not None
    assert found.utc_us is None
    (problem,) = builder.problems
    assert problem.code == "false_date"
    assert "2046-01-11" in problem.text
    assert "2026-05-28" in problem.text
    builder, found = receiver(still, still, at)
    assert found is not None
    assert found.utc_us is not None
    assert builder.problems == []
