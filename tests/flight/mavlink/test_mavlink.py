"""Telemetry: whose packets, on which clock, in which units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import flight, formats
from attlog.base import rotation
from attlog.base.errors import LogUnusable, UsageError
from attlog.flight.mavlink import reader
from attlog.flight.mavlink.clock import rising, steady
from attlog.flight.model import FlightLog
from attlog.formats import Recording
from attlog.health.sensors.timing import checks as rate_audit
from attlog.segments.model import Segments
from tests.flight.fake import messages

UNIX = 1_700_000_000_000_000
ME = 1 * 256 + 1


def systems(autopilot: int, kind: int = 2) -> dict[str, Any]:
    return {
        "systems": {1: {"autopilot": autopilot, "type": kind, "component": 1, "components": [1], "packets": 9}},
        "system": 1,
    }


def clock(n: int, rate: float, latency: np.ndarray | float = 0.0) -> dict[str, Any]:
    boot = (5000 + np.round(np.arange(n) * 1e3 / rate)).astype(np.uint32)
    return {"time_boot_ms": boot, "_t_us": UNIX + boot.astype(np.int64) * 1000 + np.int64(latency * np.ones(n))}


def raw_imu(n: int, rate: float) -> dict[str, Any]:
    columns = clock(n, rate)
    del columns["time_boot_ms"]
    columns["time_usec"] = (5_000_000 + np.round(np.arange(n) * 1e6 / rate)).astype(np.uint64)
    values = {
        "xacc": 0,
        "yacc": 0,
        "zacc": -1000,
        "xgyro": 100,
        "ygyro": -200,
        "zgyro": 300,
        "xmag": 200,
        "ymag": 0,
        "zmag": 400,
    }
    return columns | {c: np.full(n, v, np.int16) for c, v in values.items()}


def attitude(n: int, rate: float, latency: np.ndarray | float = 0.0) -> dict[str, Any]:
    yaw = 0.5 * np.sin(np.arange(n) / rate)
    return clock(n, rate, latency) | {"roll": np.zeros(n), "pitch": np.zeros(n), "yaw": yaw}


def read(tables: dict[tuple[str, int], Any], autopilot: int = 3, system: int | None = None) -> FlightLog:
    return reader.read(messages("tlog", tables, info=systems(autopilot)), None, None, system)


def test_ardupilot_counts_are_milli_units_on_the_message_clock() -> None:
    log = read({("RAW_IMU", ME): raw_imu(500, 50), ("ATTITUDE", ME): attitude(100, 10)})
    imu = log.imus[log.imu]
    np.testing.assert_allclose(imu.gyro.x[0], [0.1, -0.2, 0.3])
    np.testing.assert_allclose(imu.acc.x[0], [0, 0, -9.80665])
    np.testing.assert_allclose(log.mags[0].field.x[0], [2e-5, 0, 4e-5])
    assert log.t0_us == 5_000_000
    assert log.attitudes["ATTITUDE"].has_trim


def test_px4_sends_si_units_and_its_raw_imu_is_left_alone() -> None:
    si = {"zacc": -9.81, "xgyro": 0.1, "ygyro": 0.0, "zgyro": 0.0, "xmag": 0.2, "ymag": 0.0, "zmag": 0.4}
    highres = raw_imu(500, 50) | {c: np.full(500, v, np.float32) for c, v in si.items()}
    log = read({("HIGHRES_IMU", ME): highres, ("RAW_IMU", ME): raw_imu(500, 50), ("ATTITUDE", ME): attitude(9, 10)}, 12)
    assert log.imus[log.imu].gyro.source == "HIGHRES_IMU"
    np.testing.assert_allclose(log.imus[0].acc.x[0], [0, 0, -9.81], rtol=1e-6)
    np.testing.assert_allclose(log.mags[0].field.x[0], [2e-5, 0, 4e-5], rtol=1e-6)
    assert not log.attitudes["ATTITUDE"].has_trim
    assert log.firmware.name == "PX4"


def test_truth_without_a_clock_gets_the_packets_time_mapped_to_the_boot_clock() -> None:
    rng = np.random.default_rng(4)
    n, rate = 500, 25.0
    t = np.arange(n) / rate
    q = rotation.from_euler(0.1 * np.sin(t), 0.0, 0.3 * t)
    latency = rng.exponential(3000, n)
    truth = {"_t_us": UNIX + 5_000_000 + np.int64(t * 1e6 + latency)} | {f"q{k + 1}": q[:, k] for k in range(4)}
    clocks = attitude(1000, 50, rng.exponential(3000, 1000))
    made = messages(
        "tlog",
        {("RAW_IMU", ME): raw_imu(1000, 50), ("ATTITUDE", ME): clocks, ("SIM_STATE", ME): truth},
        info=systems(3),
    )
    made.tables["ATTITUDE", ME].offsets[:] = 1000 + 100 * np.arange(1000)
    made.tables["SIM_STATE", ME].offsets[:] = 1050 + 200 * np.arange(n)
    log = reader.read(made, None, None, None)
    yaw = rotation.to_euler(log.truth.q)[:, 2]
    late = np.median(log.truth.t - np.unwrap(yaw) / 0.3)
    assert abs(late) < 0.002
    assert log.simulated


@pytest.mark.parametrize("fault", ["standing still", "milliseconds", "backwards", "sent in bursts"])
def test_truth_without_a_clock_is_timed_by_its_place_where_packet_stamps_are_no_clock(fault: str) -> None:
    n, rate = 500, 25.0
    t = np.arange(n) / rate
    q = rotation.from_euler(0.1 * np.sin(t), 0.0, 0.3 * t)

    def stamps(true_us: np.ndarray) -> np.ndarray:
        since = np.asarray(true_us, np.int64)
        shown = {
            "standing still": 0 * since,
            "milliseconds": since // 1000,
            "backwards": -since,
            "sent in bursts": (since // 700_000 + 1) * 700_000,
        }
        return UNIX + shown[fault]

    truth = {"_t_us": stamps(t * 1e6)} | {f"q{k + 1}": q[:, k] for k in range(4)}
    clocks = attitude(1000, 50) | {"_t_us": stamps(np.arange(1000) * 20_000)}
    made = messages(
        "tlog",
        {("RAW_IMU", ME): raw_imu(1000, 50), ("ATTITUDE", ME): clocks, ("SIM_STATE", ME): truth},
        info=systems(3),
    )
    made.tables["ATTITUDE", ME].offsets[:] = 1000 + 100 * np.arange(1000)
    made.tables["SIM_STATE", ME].offsets[:] = 1010 + 200 * np.arange(n)
    log = reader.read(made, None, None, None)
    yaw = rotation.to_euler(log.truth.q)[:, 2]
    assert np.abs(log.truth.t - np.unwrap(yaw) / 0.3).max() < 0.005
    assert ["its place" in p.text for p in log.problems if p.code == "truth_packet_times"] == [True]


def test_packets_that_rise_keep_their_time_however_many_they_are() -> None:
    t = 5_000_000 + 40_000 * np.arange(90_000)
    np.testing.assert_array_equal(rising(t), t)
    late = t.copy()
    late[1000] -= 50_000
    made = rising(late)
    assert np.all(np.diff(made) > 0)
    assert np.flatnonzero(made != late).tolist() == [1000]
    assert made[1000] == late[999] + 1


def test_samples_stamped_in_unix_time_are_put_on_the_boot_clock_and_not_on_their_packets() -> None:
    """The link delays packets by 3 ms and more; the sensor's own stamps do not know of that."""
    n, late = 500, np.random.default_rng(4).exponential(3000, 500)
    imu = raw_imu(n, 50)
    own = imu["time_usec"].astype(np.int64)
    imu |= {"time_usec": (own + UNIX).astype(np.uint64), "_t_us": UNIX + own + np.int64(late)}
    system = clock(9, 1) | {"time_unix_usec": (UNIX + clock(9, 1)["time_boot_ms"].astype(np.int64) * 1000)}
    log = read({("RAW_IMU", ME): imu, ("ATTITUDE", ME): attitude(100, 10, late[:100]), ("SYSTEM_TIME", ME): system})
    assert log.t0_us == 5_000_000
    np.testing.assert_allclose(log.imus[log.imu].gyro.t, np.arange(n) / 50, atol=2e-6)


def test_a_rate_below_ten_hertz_is_refused_with_what_to_do() -> None:
    none = {k: v if k in ("_t_us", "time_usec") else np.zeros_like(v) for k, v in raw_imu(100, 4).items()}
    log = read({("RAW_IMU", ME): raw_imu(100, 4), ("SCALED_IMU3", ME): none, ("ATTITUDE", ME): attitude(100, 4)})
    assert log.imu is None
    problem = next(p for p in log.problems if p.code == "imu_rate_too_low")
    assert "4.0 Hz" in problem.text
    assert "SD card" in problem.text


@pytest.mark.parametrize(("hz", "replayed"), [(9.97, True), (9.9, False)])
def test_a_rate_is_judged_as_it_is_shown(hz: float, replayed: bool) -> None:
    """Refused was "logged at 10.0 Hz; a replay needs at least 10 Hz"."""
    log = read({("RAW_IMU", ME): raw_imu(300, hz), ("ATTITUDE", ME): attitude(100, 4)})
    assert (log.imu is not None) == replayed
    assert all("10.0 Hz; a replay needs" not in p.text for p in log.problems)
    rate = next(check for check in rate_audit(log, Segments()) if check.name == "rate")
    assert (rate.verdict != "fault") == replayed


def test_a_ground_stations_file_without_a_vehicle_ends_with_65_and_that_sentence(attlog, tmp_path: Path) -> None:
    from pymavlink.dialects.v20 import ardupilotmega as link

    station = link.MAVLink(None, srcSystem=255, srcComponent=230)
    with (tmp_path / "alone.tlog").open("wb") as file:
        for k in range(50):
            packet = station.heartbeat_encode(link.MAV_TYPE_GCS, link.MAV_AUTOPILOT_INVALID, 0, 0, 0).pack(station)
            file.write((1_700_000_000_000_000 + 1_000_000 * k).to_bytes(8, "big") + packet)
    for command in (["info"], ["analyze", "-o", tmp_path], ["extract", "-o", tmp_path]):
        done = attlog(*command, tmp_path / "alone.tlog")
        assert done.code == 65
        assert "no vehicle in this MAVLink file" in done.err


def test_an_unknown_system_and_a_file_without_vehicle_are_refused() -> None:
    tables = {("RAW_IMU", ME): raw_imu(100, 50)}
    with pytest.raises(UsageError, match="system 7"):
        read(tables, system=7)
    with pytest.raises(LogUnusable, match="no vehicle"):
        reader.read(messages("tlog", tables, info={"systems": {}, "system": None}), None, None, None)


def test_a_unit_that_sends_zeros_is_named_and_not_used() -> None:
    dead = {k: v if k in ("_t_us", "time_usec") else np.zeros_like(v) for k, v in raw_imu(500, 50).items()}
    log = read({("RAW_IMU", ME): dead, ("ATTITUDE", ME): attitude(100, 10)})
    assert log.imu is None
    assert "imu_all_zero" in {p.code for p in log.problems}


def test_heartbeats_tell_arming_mode_and_vehicle() -> None:
    n = 20
    beats = {
        "_t_us": UNIX + 5_000_000 + 1_000_000 * np.arange(n),
        "type": np.full(n, 2, np.uint8),
        "base_mode": np.where(np.arange(n) < 10, 81, 209).astype(np.uint8),
        "custom_mode": np.where(np.arange(n) < 15, 0, 9).astype(np.uint32),
    }
    log = read({("RAW_IMU", ME): raw_imu(1000, 50), ("ATTITUDE", ME): attitude(400, 20), ("HEARTBEAT", ME): beats})
    assert log.vehicle == "quadrotor"
    assert log.armed.value == [False, True]
    assert log.mode.value == ["STABILIZE", "LAND"]


def test_landed_and_the_version_are_read_from_their_numbers() -> None:
    """MAV_LANDED_STATE: 0 undefined, 1 on the ground, 2 in the air; the version is a byte each, then the release."""
    extended = clock(6, 1) | {"landed_state": np.array([0, 1, 1, 2, 2, 1], np.uint8)}
    version = clock(1, 1) | {"flight_sw_version": np.array([1 << 24 | 14 << 16 | 3 << 8 | 255], np.uint32)}
    log = read(
        {
            ("HIGHRES_IMU", ME): raw_imu(500, 50) | {"zacc": np.full(500, -9.81, np.float32)},
            ("ATTITUDE", ME): attitude(100, 10),
            ("EXTENDED_SYS_STATE", ME): extended,
            ("AUTOPILOT_VERSION", ME): version,
        },
        12,
    )
    assert [log.landed.at(t + 0.5) for t in (1.0, 2.0, 3.0, 4.0, 5.0)] == [True, True, False, False, True]
    assert log.firmware.version.startswith("1.14.3")


def test_of_two_vehicles_in_a_file_the_one_asked_for_is_read(tmp_path: Path) -> None:
    tables: dict[tuple[str, int], Any] = {}
    for system, rate in ((1, 50.0), (2, 25.0)):
        me = system * 256 + 1
        beats = {
            "_t_us": UNIX + 5_000_000 + 500_000 * np.arange(20),
            "autopilot": np.full(20, 3, np.uint8),
            "type": np.full(20, system, np.uint8),
        }
        tables |= {("RAW_IMU", me): raw_imu(500, rate), ("ATTITUDE", me): attitude(100, 10), ("HEARTBEAT", me): beats}
    path = tmp_path / "two.tlog"
    formats.write(path, Recording(tables))
    first, second = flight.read(path), flight.read(path, system=2)
    assert (first.vehicle, second.vehicle) == ("fixed wing", "quadrotor")
    assert second.imus[0].gyro.rate == pytest.approx(25, rel=0.01)
    assert "several_systems" in {p.code for p in first.problems}
    with pytest.raises(UsageError, match="system 9"):
        flight.read(path, system=9)


@pytest.mark.parametrize(("autopilot", "levels"), [(3, [1.0, 2.0, 30.0]), (12, None)])
def test_clipped_samples_are_counted_by_unit_and_levels_are_those_of_ardupilot(autopilot: int, levels: Any) -> None:
    columns = raw_imu(5, 1.0)
    own = {"time_usec": columns["time_usec"], "_t_us": columns["_t_us"]}
    own |= {c: np.full(5, v) for c, v in zip(("vibration_x", "vibration_y", "vibration_z"), (1, 2, 30), strict=True)}
    own |= {f"clipping_{k}": np.zeros(5, np.uint32) for k in (0, 2)}
    own["clipping_1"] = np.array([7, 7, 9, 0, 4], np.uint32)  # it begins anew when a unit does
    log = read({("RAW_IMU", ME): raw_imu(500, 50), ("VIBRATION", ME): own}, autopilot)
    assert [c.new.tolist() for c in log.clippings] == [[0] * 5, [0, 0, 2, 0, 4], [0] * 5]
    assert (log.clippings[1].source, log.clippings[1].whole) == ("VIBRATION.clipping_1", True)
    assert np.diff(log.clippings[1].t) == pytest.approx(1.0)
    told = None if log.onboard_vibration is None else log.onboard_vibration.x[0].tolist()
    assert told == levels


def test_packets_that_come_in_bursts_are_steady_where_they_are_late_by_less_than_half_a_mean_step() -> None:
    boot = np.cumsum(np.tile([1_000, 1_000, 1_000, 97_000], 25))
    late = 3_000 * (-1) ** np.arange(len(boot))  # steps are wrong by 6 ms: half of the mean is 12.5, of the median 0.5
    assert steady(boot + late, boot)
    assert not steady(boot + 3 * late, boot)


@pytest.mark.parametrize(
    ("autopilot", "name", "columns"),
    [
        (3, "EKF_STATUS_REPORT", ("compass_variance", "velocity_variance")),
        (12, "ESTIMATOR_STATUS", ("mag_ratio", "vel_ratio")),
    ],
)
def test_test_ratios_of_both_firmwares_are_read(autopilot: int, name: str, columns: tuple[str, str]) -> None:
    sent = clock(20, 1.0) | {columns[0]: np.full(20, 0.4, np.float32), columns[1]: np.full(20, -1.0, np.float32)}
    tables = {("RAW_IMU", ME): raw_imu(600, 25.0), ("ATTITUDE", ME): attitude(240, 10.0), (name, ME): sent}
    log = reader.read(messages("tlog", tables, info=systems(autopilot)), None, None, None)
    compass, velocity = log.innovation_tests
    assert (compass.aid, velocity.aid) == ("compass", "velocity")
    np.testing.assert_allclose(compass.ratio, 0.4, rtol=1e-6)
    assert np.isnan(velocity.ratio).all()


def test_a_landed_state_that_is_undefined_is_neither_ground_nor_air() -> None:
    extended = clock(6, 1) | {"landed_state": np.array([0, 1, 1, 0, 2, 1], np.uint8)}
    log = read(
        {("RAW_IMU", ME): raw_imu(500, 50), ("ATTITUDE", ME): attitude(100, 10), ("EXTENDED_SYS_STATE", ME): extended}
    )
    assert log.landed.value == [True, False, True]
