"""Values that real logs hold now and then and that mean nothing: impossible dates, sensors without one good record."""

from __future__ import annotations

import re
import time
from typing import Any

import numpy as np
import pytest

from attlog import flight
from attlog.base.limits import MAX_ATTITUDES
from attlog.flight.ardupilot import events
from attlog.flight.ardupilot.clock import Clock
from attlog.flight.builder import LogBuilder
from attlog.flight.clock.record_time import clock_of
from attlog.flight.mavlink.clock import unix_minus_boot
from attlog.flight.model import FlightLog
from attlog.flight.px4 import reader, sdlog2
from attlog.formats.base import Damage
from tests.flight.fake import gravity, level, messages, micros

N = 400


def combined() -> dict[str, Any]:
    return {
        "timestamp": micros(N, 200.0),
        "gyro_rad": np.zeros((N, 3), np.float32),
        "gyro_integral_dt": np.full(N, 5000, np.uint32),
        "accelerometer_m_s2": gravity(N),
    }


def receiver(utc_us: int) -> dict[str, Any]:
    n = 10
    names = ("eph", "epv", "s_variance_m_s", "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
    return {
        "timestamp": micros(n, 5.0),
        "latitude_deg": np.full(n, 47.0),
        "longitude_deg": np.full(n, 8.0),
        "altitude_msl_m": np.full(n, 400.0),
        "fix_type": np.full(n, 3, np.uint8),
        "time_utc_usec": np.full(n, utc_us, np.uint64),
    } | {name: np.ones(n, np.float32) for name in names}


def read(tables: dict[tuple[str, int], Any]) -> FlightLog:
    with np.errstate(invalid="ignore"):
        return reader.read(messages("ulog", tables, info={"sys_name": "PX4"}))


def test_a_receiver_that_tells_an_impossible_date_tells_none() -> None:
    for utc_us, known in ((1_700_000_000_000_000, True), (2**62, False), (2**63 + 5, False), (1000, False)):
        log = read({("sensor_combined", 0): combined(), ("sensor_gps", 0): receiver(utc_us)})
        assert (log.utc_offset is not None) is known
        assert log.gnss[0].lat[0] == 47.0


def test_an_autopilot_that_tells_an_impossible_date_tells_none() -> None:
    for unix_us, known in ((1_700_000_000_000_000, True), (2**62, False)):
        clock = {"time_unix_usec": np.full(5, unix_us, np.uint64), "time_boot_ms": np.arange(1, 6, dtype=np.uint32)}
        found = unix_minus_boot(messages("tlog", {("SYSTEM_TIME", 257): clock}), 257)
        assert (found is not None) is known


def test_a_sensor_without_one_good_record_is_not_called_unlogged() -> None:
    dead = combined() | {"gyro_rad": np.full((N, 3), np.nan, np.float32)}
    for tables, says in (
        ({("sensor_combined", 0): dead}, "can be used"),
        ({("vehicle_attitude", 0): {"timestamp": micros(N, 50.0), "q": level(N)}}, "SDLOG"),
    ):
        log = read(tables)
        assert log.imu is None
        assert [says in p.text for p in log.problems if p.code == "no_imu"] == [True]


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"gyro_rad": np.full((N, 3), np.nan, np.float32)}, "no sensor can give|missing or outside"),
        ({"timestamp": np.full(N, 7_000_000, np.uint64)}, "repeat a time stamp"),
        ({"timestamp": np.arange(N, 0, -1, dtype=np.uint64) * 5000}, "go back in time"),
        ({"timestamp": micros(N, 200.0) // 1000}, "Their stamps are false"),
        ({"gyro_rad": np.zeros(N, np.float32)}, "three axes"),
    ],
)
def test_where_the_fast_message_is_useless_the_reason_is_told_and_not_a_setting(wrong: Any, why: str) -> None:
    n = 30
    slow = {"timestamp": micros(n, 1.0), "delta_angle": np.zeros((n, 3), np.float32), "delta_velocity": gravity(n)}
    slow |= {f"{x}_dt": np.full(n, 5000, np.uint32) for x in ("delta_angle", "delta_velocity")}
    slow["gyro_device_id"] = np.ones(n, np.uint32)
    for tables in (
        {("sensor_combined", 0): combined() | wrong, ("vehicle_imu", 0): slow},
        {("sensor_combined", 0): combined() | wrong},
    ):
        log = read(tables)
        assert log.imu is None
        told = next(p.text for p in log.problems if p.severity == "error")
        assert re.search(why, told)
        assert "SDLOG" not in told


def test_a_log_that_is_mostly_damaged_is_not_told_what_to_log() -> None:
    made = messages("ulog", {("vehicle_attitude", 0): {"timestamp": micros(N, 50.0), "q": level(N)}})
    made.damage, made.damage_bytes = [Damage(77, made.size, "900 bytes that are no records", "")], made.size
    told = next(p.text for p in reader.read(made).problems if p.code == "no_imu")
    assert "900 bytes that are no records at byte 77" in told
    assert "SDLOG" not in told


def test_an_attitude_that_is_never_set_is_told() -> None:
    none = {"timestamp": micros(N, 50.0), "q": np.zeros((N, 4), np.float32)}
    log = read({("sensor_combined", 0): combined(), ("vehicle_attitude", 0): none})
    assert "vehicle_attitude" not in log.attitudes
    assert [p.count for p in log.problems if p.code == "attitude_unset"] == [N]


def test_of_more_attitudes_than_a_vehicle_has_those_with_most_records_are_kept() -> None:
    tables = {("sensor_combined", 0): combined()}
    tables |= {("estimator_attitude", k): {"timestamp": micros(20 + k, 50.0), "q": level(20 + k)} for k in range(255)}
    tables["vehicle_attitude", 0] = {"timestamp": micros(10, 50.0), "q": level(10)}
    with np.errstate(invalid="ignore"):
        log = flight.flight_in(messages("ulog", tables, info={"sys_name": "PX4"}))
    assert log.onboard in log.attitudes
    assert sorted(len(a.t) for a in log.attitudes.values()) == [10, *range(275 - MAX_ATTITUDES + 1, 275)]
    assert [p.count for p in log.problems if p.code == "log_limit"] == [256 - MAX_ATTITUDES]


def test_a_filter_whose_cutoff_is_unknown_is_not_called_0_hz() -> None:
    table = {"timestamp": micros(N, 100.0), "timestamp_sample": micros(N, 100.0)}
    log = read(
        {
            ("vehicle_angular_velocity", 0): table | {"xyz": np.zeros((N, 3), np.float32)},
            ("vehicle_acceleration", 0): table | {"xyz": gravity(N)},
        }
    )
    assert "0 Hz" not in log.imus[0].filtered


def test_a_unit_that_is_all_zero_is_none() -> None:
    log = read({("sensor_combined", 0): combined() | {"accelerometer_m_s2": np.zeros((N, 3), np.float32)}})
    assert log.imu is None
    assert [p.code for p in log.problems] == ["imu_all_zero", "no_imu", "no_mag"]


def test_one_of_a_thing_is_no_plural() -> None:
    stamps = micros(N, 200.0)
    stamps[7] = stamps[6]
    log = read({("sensor_combined", 0): combined() | {"timestamp": stamps}})
    told = [p.text for p in log.problems if p.code == "duplicate_times"]
    assert told == [f"sensor_combined: left out 1 of {N} records, which repeat a time stamp."]


def test_a_log_that_starts_beyond_all_clocks_starts_at_nothing() -> None:
    tables = {
        ("TIME", 0): {"StartTime": np.full(5, 2**64 - 1, np.uint64), "_t_us": np.full(5, -1, np.int64)},
        ("ATT", 0): {
            "_t_us": micros(N, 50.0).astype(np.int64),
            "Roll": np.zeros(N),
            "Pitch": np.zeros(N),
            "Yaw": np.zeros(N),
        },
    }
    log = sdlog2.read(messages("px4log", tables, params={"MAV_TYPE": 2.0}))
    assert log.t0_us == 0
    assert log.params["MAV_TYPE"].value == [2.0]


def test_a_time_of_another_kind_is_no_time_of_a_record() -> None:
    for wrong in (np.array([b"12"] * N), np.zeros((N, 3), np.uint64)):
        tables = {("sensor_combined", 0): combined(), ("vehicle_air_data", 0): {"timestamp": wrong}}
        log = messages("ulog", tables)
        of = clock_of(log)
        assert of(log["vehicle_air_data", 0]) is None
        assert of(log["sensor_combined", 0]) is not None


def test_the_unit_that_flew_is_told_by_one_number_per_record_or_not_at_all() -> None:
    odd = {"timestamp": np.zeros((N, 2), np.uint64), "gyro_device_id": np.ones(N, np.uint32)}
    imu = {"gyro_device_id": np.ones(N, np.uint32), "timestamp": micros(N, 100.0)}
    log = read({("sensor_combined", 0): combined(), ("sensor_selection", 0): odd, ("vehicle_imu_status", 0): imu})
    assert log.imu == 0
    assert "unreadable_message" in [p.code for p in log.problems]


def test_a_hundred_thousand_kinds_of_reports_take_no_time_and_are_not_all_told() -> None:
    n = 100_000
    errors = {
        "TimeUS": micros(n, 1000.0),
        "Subsys": np.arange(n, dtype=np.int64),
        "ECode": np.arange(n, dtype=np.int64) + 1,
    }
    builder = LogBuilder(messages("dataflash", {("ERR", 0): errors}), t0_us=10_000_000)
    begin = time.process_time()
    events.report(builder, Clock(builder.messages))
    assert time.process_time() - begin < 2.0
    assert len(builder.problems) == events.MOST_KINDS + 1
    assert builder.problems[-1].code == "damaged_reports"


def test_a_hundred_thousand_devices_take_no_time() -> None:
    n = 100_000
    tables = {
        ("sensor_combined", 0): combined(),
        ("sensor_gyro", 0): {"device_id": np.full(N, 7, np.uint32)},
        ("sensor_selection", 0): {"timestamp": micros(n, 1000.0), "gyro_device_id": np.arange(n, dtype=np.uint32)},
    }
    begin = time.process_time()
    assert read(tables).imu == 0
    assert time.process_time() - begin < 2.0


def test_a_quaternion_with_a_damaged_component_is_refused_and_not_normalised() -> None:
    """One number of four changed is another attitude, and normalising hides it."""
    q = np.tile(np.array([0.8, 0.6, 0.0, 0.0], np.float32), (N, 1))
    q[::4, 1] = 0.4
    found = read({("sensor_combined", 0): combined(), ("vehicle_attitude", 0): {"timestamp": micros(N, 200.0), "q": q}})
    assert len(found.attitudes["vehicle_attitude"].t) == N - N // 4
    assert [p.count for p in found.problems if p.code == "values_out_of_range"] == [N // 4]
