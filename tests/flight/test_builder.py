"""Times of measurement: which of them a log's column is believed."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import flight
from attlog.core.errors import LogUnusable
from attlog.core.limits import MAX_ATTITUDES
from attlog.flight import compass
from attlog.flight.builder import LogBuilder
from attlog.flight.imu import ImuCandidate, best_per_unit, longest_held, resample_vectors, validate_candidate
from attlog.flight.model import FlightLog
from attlog.flight.px4 import reader
from tests.conftest import SAMPLES
from tests.flight.fake import gravity, level, messages, micros


@pytest.mark.parametrize(("age_us", "believed"), [(3_000, True), (999_999, True), (1_000_000, False), (-1, False)])
def test_a_sample_lies_at_most_a_second_before_its_stamp(age_us: int, believed: bool) -> None:
    """Single ones that cannot be true get the usual age; a column that is mostly wrong is none."""
    nothing = messages("ulog", {})
    builder, stamps = LogBuilder(nothing, t0_us=5_000_000), 10_000_000 + 20_000 * np.arange(40)
    found = builder.sample_times(stamps, stamps - age_us)
    assert (found is not None) is believed
    one = stamps - 4_000
    one[7] = stamps[7] - age_us
    if not believed:
        mended = builder.sample_times(stamps, one)
        assert mended is not None
        assert mended[7] == pytest.approx(1e-6 * (stamps[7] - 4_000 - 5_000_000), abs=1e-9)


# Values that no sensor can give never reach a stream, and every one left out is counted.

N = 200


def builder() -> LogBuilder:
    return LogBuilder(messages("ulog", {("x", 0): {"timestamp": micros(2, 1)}}), t0_us=10_000_000)


def candidate(gyro: np.ndarray, acc: np.ndarray, **fields: object) -> ImuCandidate:
    return ImuCandidate(0, 0, micros(len(gyro), 100).astype(np.int64), gyro, acc, "made", "interval", **fields)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e15, -150.0])
def test_impossible_rates_leave_the_stream_and_are_told_when_the_source_is_used(wrong: float) -> None:
    gyro = np.zeros((N, 3))
    gyro[70, 1] = wrong
    r = builder()
    one = validate_candidate(r, candidate(gyro, gravity(N).astype(float)))
    assert len(one.t_us) == N - 1
    assert not r.problems
    best_per_unit(r, [one])
    assert [(p.code, p.count) for p in r.problems] == [("values_out_of_range", 1)]


def test_magnetometer_spikes_become_missing_and_slow_disturbance_stays() -> None:
    field = np.tile([2e-5, 0, 4e-5], (N, 1))
    field[20] *= 12
    field[50] = 0
    field[100:150] *= np.linspace(1, 2.5, 50)[:, None]
    r = builder()
    mag = compass.build_mag(r, 0, micros(N, 10).astype(np.int64), field, "MAG")
    assert np.flatnonzero(~np.isfinite(mag.field.x).all(axis=1)).tolist() == [20, 50]
    assert [(p.code, p.count) for p in r.problems] == [("mag_spikes", 2)]


def test_quaternions_that_are_none_leave_the_attitude() -> None:
    q = level(N).astype(float)
    q[:10] = 0
    q[30] *= 1e6
    q[31] = np.nan
    r = builder()
    attitude = r.attitude(micros(N, 50).astype(np.int64), q, "ATT")
    assert len(attitude.t) == N - 12
    np.testing.assert_allclose(np.linalg.norm(attitude.q, axis=1), 1)
    assert r.attitude(micros(5, 50).astype(np.int64), np.zeros((5, 4)), "ATT") is None


def test_time_lines_keep_changes_only() -> None:
    line = builder().time_line(micros(6, 1).astype(np.int64), [0, 0, 1, 1, 0, 0], "x")
    assert (line.t.tolist(), line.value) == ([0.0, 2.0, 4.0], [0, 1, 0])
    assert (line.at(-5), line.at(2.5), line.at(99)) == (0, 1, 0)


def test_interpolation_onto_another_sensor_never_crosses_a_gap() -> None:
    at = np.concatenate([np.arange(0, 100_000, 1000), np.arange(300_000, 400_000, 1000)])
    got = resample_vectors(np.array([500, 50_500, 200_000, 300_500]), at, np.tile(at[:, None] * 1.0, (1, 3)))
    np.testing.assert_allclose(got[[0, 1, 3], 0], [500, 50_500, 300_500])
    assert np.isnan(got[2]).all()


def test_the_unit_that_flew_longest_counts() -> None:
    t = np.array([0, 1_000_000, 20_000_000])
    assert longest_held(t, [1, 0, 2]) == 0
    assert longest_held(t[:0], []) is None


def test_a_message_with_a_damaged_definition_does_not_take_the_others_with_it() -> None:
    r = builder()
    assert r.read_optional("GPS", lambda: r.messages["x", 0]["lat"], "nothing") == "nothing"
    assert [(p.code, p.severity) for p in r.problems] == [("unreadable_message", "warning")]
    assert "x has no field 'lat'" in r.problems[0].text


def test_two_axes_are_no_gyro_and_three_numbers_no_attitude() -> None:
    r = builder()
    assert validate_candidate(r, candidate(np.zeros((N, 2)), gravity(N).astype(float))) is None
    assert [p.code for p in r.problems] == ["unreadable_message"]
    t = micros(5, 50).astype(np.int64)
    assert r.read_optional("ATT", lambda: r.attitude(t, np.ones((5, 3)), "ATT"), None) is None
    assert r.read_optional("MAG", lambda: compass.build_mag(r, 0, t, np.ones((5, 2)), "MAG"), None) is None
    assert len(r.problems) == 3


@pytest.mark.parametrize(("spikes", "weight"), [(1, "note"), (3, "note"), (4, "warning")])
def test_single_spikes_of_a_short_log_warn_of_nothing_and_name_the_magnetometer(spikes: int, weight: str) -> None:
    field = np.tile([2e-5, 0, 4e-5], (67, 1))
    field[10 : 10 + 10 * spikes : 10] = 0
    r = builder()
    compass.build_mag(r, 0, micros(67, 1).astype(np.int64), field, "RAW_IMU")
    (one,) = r.problems
    assert one.severity == weight
    assert one.text.startswith(f"RAW_IMU: left out {spikes} of 67 records of the magnetometer,")


# Values that real logs hold now and then and that mean nothing: impossible dates, sensors without one good record.

ODD_RECORDS = 400


def combined() -> dict[str, Any]:
    return {
        "timestamp": micros(ODD_RECORDS, 200.0),
        "gyro_rad": np.zeros((ODD_RECORDS, 3), np.float32),
        "gyro_integral_dt": np.full(ODD_RECORDS, 5000, np.uint32),
        "accelerometer_m_s2": gravity(ODD_RECORDS),
    }


def read(tables: dict[tuple[str, int], Any]) -> FlightLog:
    with np.errstate(invalid="ignore"):
        return reader.read(messages("ulog", tables, info={"sys_name": "PX4"}))


def test_a_sensor_without_one_good_record_is_not_called_unlogged() -> None:
    dead = combined() | {"gyro_rad": np.full((ODD_RECORDS, 3), np.nan, np.float32)}
    for tables, says in (
        ({("sensor_combined", 0): dead}, "can be used"),
        ({("vehicle_attitude", 0): {"timestamp": micros(ODD_RECORDS, 50.0), "q": level(ODD_RECORDS)}}, "SDLOG"),
    ):
        log = read(tables)
        assert log.imu is None
        assert [says in p.text + p.remedy for p in log.problems if p.code == "no_imu"] == [True]


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"gyro_rad": np.full((ODD_RECORDS, 3), np.nan, np.float32)}, "no sensor can give|missing or outside"),
        ({"timestamp": np.full(ODD_RECORDS, 7_000_000, np.uint64)}, "repeat a time stamp"),
        ({"timestamp": np.arange(ODD_RECORDS, 0, -1, dtype=np.uint64) * 5000}, "go back in time"),
        ({"timestamp": micros(ODD_RECORDS, 200.0) // 1000}, "Their stamps are false"),
        ({"gyro_rad": np.zeros(ODD_RECORDS, np.float32)}, "three axes"),
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


@pytest.mark.parametrize("name", ["px4_hover.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog"])
@pytest.mark.parametrize("size", [300, 3000, 20_000, 40_000])
def test_the_beginning_of_a_log_shows_no_setting_to_change(name: str, size: int, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes((SAMPLES / name).read_bytes()[:size])
    log = flight.read(path)
    told = [f"{p.text} {p.remedy}" for p in log.problems if p.severity != "note"]
    if log.seconds < 2.0:
        assert not any(re.search("SDLOG|LOG_BITMASK|SD card|logger_topics|onnect", p) for p in told)
        assert any(f"after {size:,} bytes" in p for p in told)


def test_a_log_cut_within_its_definitions_says_so(tmp_path: Path) -> None:
    path = tmp_path / "cut.bin"
    path.write_bytes((SAMPLES / "copter_yaw_turns.bin").read_bytes()[:200])
    with pytest.raises(LogUnusable, match="ends after 200 bytes, before any data"):
        flight.read(path)


@pytest.mark.parametrize(("by", "says"), [({}, "Another program"), ({"sys_name": "Rig"}, "Rig")])
def test_a_ulog_of_no_autopilot_is_not_told_a_setting_of_px4(by: dict[str, str], says: str) -> None:
    tables = {("strain", 0): {"timestamp": micros(900, 100.0), "value": np.zeros(900, np.float32)}}
    log = reader.read(messages("ulog", tables, {"GAIN": 1.0}, info=by))
    assert [p.text for p in log.problems if p.code == "no_imu" and f"{says} wrote it" in p.remedy]
    assert not any("SDLOG" in p.remedy for p in log.problems)


def test_a_log_that_is_mostly_damaged_is_not_told_what_to_log() -> None:
    made = messages(
        "ulog", {("vehicle_attitude", 0): {"timestamp": micros(ODD_RECORDS, 50.0), "q": level(ODD_RECORDS)}}
    )
    made.losses.add(77, made.size, "900 bytes that are no records", "")
    told = next(p.text for p in reader.read(made).problems if p.code == "no_imu")
    assert "900 bytes that are no records at byte 77" in told
    assert "SDLOG" not in told


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
    table = {"timestamp": micros(ODD_RECORDS, 100.0), "timestamp_sample": micros(ODD_RECORDS, 100.0)}
    log = read(
        {
            ("vehicle_angular_velocity", 0): table | {"xyz": np.zeros((ODD_RECORDS, 3), np.float32)},
            ("vehicle_acceleration", 0): table | {"xyz": gravity(ODD_RECORDS)},
        }
    )
    assert "0 Hz" not in log.imus[0].filtered


def test_a_unit_that_is_all_zero_is_none() -> None:
    log = read({("sensor_combined", 0): combined() | {"accelerometer_m_s2": np.zeros((ODD_RECORDS, 3), np.float32)}})
    assert log.imu is None
    assert [p.code for p in log.problems] == ["imu_all_zero", "no_imu", "no_mag"]


def test_a_hundred_thousand_devices_take_no_time() -> None:
    n = 100_000
    tables = {
        ("sensor_combined", 0): combined(),
        ("sensor_gyro", 0): {"device_id": np.full(ODD_RECORDS, 7, np.uint32)},
        ("sensor_selection", 0): {"timestamp": micros(n, 1000.0), "gyro_device_id": np.arange(n, dtype=np.uint32)},
    }
    begin = time.process_time()
    assert read(tables).imu == 0
    assert time.process_time() - begin < 2.0


def test_a_quaternion_with_a_damaged_component_is_refused_and_not_normalised() -> None:
    """One number of four changed is another attitude, and normalising hides it."""
    q = np.tile(np.array([0.8, 0.6, 0.0, 0.0], np.float32), (ODD_RECORDS, 1))
    q[::4, 1] = 0.4
    found = read(
        {("sensor_combined", 0): combined(), ("vehicle_attitude", 0): {"timestamp": micros(ODD_RECORDS, 200.0), "q": q}}
    )
    assert len(found.attitudes["vehicle_attitude"].t) == ODD_RECORDS - ODD_RECORDS // 4
    assert [p.count for p in found.problems if p.code == "values_out_of_range"] == [ODD_RECORDS // 4]
