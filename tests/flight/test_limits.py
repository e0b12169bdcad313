"""What no sensor, clock or parameter can say is left out where it enters, counted and told; the rest stays."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from attlog.flight import physics
from attlog.flight.ardupilot import reader as ardupilot
from attlog.flight.builder import LogBuilder
from attlog.flight.inertial import low_pass_delay
from attlog.flight.model import FlightLog, Problem
from attlog.flight.parameters import limits as parameter_limits
from attlog.flight.px4 import reader as px4
from attlog.formats.base import ParamChange
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
    g, battery = log.gnss[0], log.battery
    assert battery is not None
    assert log.airspeed is not None
    assert log.rpm is not None
    assert log.rate_setpoints is not None
    assert log.throttle is not None
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
        "esc[0].esc_rpm": log.rpm.x,
        "roll": log.rate_setpoints.x,
        "xyz": log.throttle.x,
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
    assert not any(s is not None and s.rate > physics.FUSED_HZ for s in (*log.baro, log.battery, log.rpm))
    assert "rate_impossible" in [p.code for p in log.problems]


def test_a_fast_gyro_is_no_false_clock() -> None:
    t = micros(2000, 32_000.0)
    builder = LogBuilder(messages("ulog", {}))
    assert len(builder.keep(t, "gyro", fastest_hz=physics.RAW_HZ)) == len(t)
    assert len(builder.keep(t, "attitude")) == 0


def test_a_boot_clock_beyond_2100_is_none() -> None:
    tables = px4_tables()
    for columns in tables.values():
        columns["timestamp"] = columns["timestamp"] + np.uint64(2**61)
    log = read_px4(tables)
    assert log.imu is None
    assert log.imus == []


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
    assert log.armed is not None
    assert log.armed.value == [False, True]
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


def test_parameters_that_are_computed_with_have_limits_and_others_have_none() -> None:
    wrong = {
        "IMU_GYRO_CUTOFF": 1e-38,
        "INS_GYRO_FILTER": 1e30,
        "EKF2_MAG_DECL": 1e39,
        "COMPASS_DEC": 12.0,
        "CAL_MAG0_XOFF": 1e9,
        "CAL_ACC1_ZSCALE": -3e8,
        "SENS_BOARD_ROT": 1e9,
        "AHRS_TRIM_X": 40.0,
    }
    right = {
        "IMU_GYRO_CUTOFF": 0.0,
        "INS_GYRO_FILTER": 20.0,
        "EKF2_MAG_DECL": -12.0,
        "COMPASS_DEC": 0.2,
        "CAL_MAG0_XOFF": 0.3,
        "CAL_ACC1_ZSCALE": 1.01,
        "SENS_BOARD_ROT": 4.0,
        "AHRS_TRIM_X": 0.02,
        "ANYTHING_ELSE": 1e30,
    }
    for name, value in wrong.items():
        log = messages("ulog", {}, [ParamChange(name, right[name]), ParamChange(name, value)])
        problems = parameter_limits.refuse(log)
        assert [(p.code, p.count) for p in problems] == [("values_out_of_range", 1)]
        assert f"{name}: left out 1 of 2" in problems[0].text
        assert [p.value for p in log.params] == [right[name]]
    assert parameter_limits.refuse(messages("ulog", {}, right)) == []
    assert parameter_limits.impossible("INS_GYRO_FILTER", -1.0) is None, "off"
    assert parameter_limits.impossible("INS_GYRO_FILTER", -5.0) is parameter_limits.CUTOFF
    slowest = low_pass_delay(parameter_limits.CUTOFF.low)
    assert slowest < 0.25, "no filter's delay is longer than this"


def test_many_parameters_of_a_quantity_are_one_problem_with_their_number() -> None:
    """A damaged log refused 16 ends of radio channels in 16 sentences."""
    changes = [ParamChange(f"RC{k}_{end}", 1e9) for k in range(1, 9) for end in ("MIN", "MAX")]
    log = messages("ulog", {}, [*changes, ParamChange("RC1_MIN", 1000.0), ParamChange("CAL_GYRO0_ROT", 1e9)])
    told = parameter_limits.refuse(log)
    assert [(p.code, p.count) for p in told] == [("values_out_of_range", 16), ("values_out_of_range", 1)]
    start = (
        "16 parameters (RC1_MIN, RC1_MAX, RC2_MIN, RC2_MAX and 12 more): left out 16 of 17 values, "
        "such as 1e+09: the pulse"
    )
    assert told[0].text.startswith(start)
    assert told[1].text.startswith("Parameter CAL_GYRO0_ROT: left out 1e+09: ")
    assert [change.value for change in log.params] == [1000.0]
