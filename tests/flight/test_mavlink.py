"""Telemetry: whose packets, on which clock, in which units."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import median_filter

from attlog import flight, formats
from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.flight import mavlink, packet_clock
from attlog.flight.mavlink import TelemetryBuilder
from attlog.flight.model import FlightLog
from attlog.flight.packet_clock import PacketClock, is_steady, without_stale_packets
from attlog.formats import Recording
from attlog.formats.mavlink.layout import STAMP_COLUMN
from attlog.formats.table import Boot, Messages
from attlog.health.check import HealthCase
from attlog.health.timing import timing_checks
from attlog.segments.model import Segments
from tests.flight import fake
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
    return mavlink.read(messages("tlog", tables, info=systems(autopilot)), None, None, system)


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
    log = mavlink.read(made, None, None, None)
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
    log = mavlink.read(made, None, None, None)
    yaw = rotation.to_euler(log.truth.q)[:, 2]
    assert np.abs(log.truth.t - np.unwrap(yaw) / 0.3).max() < 0.005
    assert ["its place" in p.text for p in log.problems if p.code == "truth_packet_times"] == [True]


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
    assert "SD card" in problem.remedy


@pytest.mark.parametrize(("hz", "replayed"), [(9.97, True), (9.9, False)])
def test_a_rate_is_judged_as_it_is_shown(hz: float, replayed: bool) -> None:
    """Refused was "logged at 10.0 Hz; a replay needs at least 10 Hz"."""
    log = read({("RAW_IMU", ME): raw_imu(300, hz), ("ATTITUDE", ME): attitude(100, 4)})
    assert (log.imu is not None) == replayed
    assert all("10.0 Hz; a replay needs" not in p.text for p in log.problems)
    rate = next(check for check in timing_checks(HealthCase(log, Segments())) if check.question == "rate")
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
    assert log.state.armed.value == [False, True]
    assert log.state.mode.value == ["STABILIZE", "LAND"]


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
    assert [log.state.landed.at(t + 0.5) for t in (1.0, 2.0, 3.0, 4.0, 5.0)] == [True, True, False, False, True]
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
    own["clipping_0"] = np.zeros(5, np.uint32)
    own["clipping_2"] = np.array([0, 1, 2**32 - 1, 1, 2], np.uint32)  # more than a sensor can sample in a second
    own["clipping_1"] = np.array([7, 7, 9, 0, 4], np.uint32)  # it begins anew when a unit does
    log = read({("RAW_IMU", ME): raw_imu(500, 50), ("VIBRATION", ME): own}, autopilot)
    assert [c.new.tolist() for c in log.vibration.clippings] == [[0] * 5, [0, 0, 2, 0, 4], [0, 1, 0, 0, 1]]
    assert [p.text for p in log.problems if "clipping" in p.text] == [
        "VIBRATION.clipping_2: left out 1 of 5 counts, higher than a sensor can sample."
    ]
    assert (log.vibration.clippings[1].source, log.vibration.clippings[1].whole) == ("VIBRATION.clipping_1", True)
    assert np.diff(log.vibration.clippings[1].t) == pytest.approx(1.0)
    told = None if log.vibration.level is None else log.vibration.level.x[0].tolist()
    assert told == levels


def test_packets_that_come_in_bursts_are_steady_where_they_are_late_by_less_than_half_a_mean_step() -> None:
    boot = np.cumsum(np.tile([1_000, 1_000, 1_000, 97_000], 25))
    late = 3_000 * (-1) ** np.arange(len(boot))  # steps are wrong by 6 ms: half of the mean is 12.5, of the median 0.5
    assert is_steady(boot + late, boot)
    assert not is_steady(boot + 3 * late, boot)


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
    log = mavlink.read(messages("tlog", tables, info=systems(autopilot)), None, None, None)
    compass, velocity = log.estimator.innovation_tests
    assert (compass.aid, velocity.aid) == ("compass", "velocity")
    np.testing.assert_allclose(compass.ratio, 0.4, rtol=1e-6)
    assert np.isnan(velocity.ratio).all()


# The autopilot's clock of packets: their own, that of the receiver, or their place in the file.

BOOT_MS = 5_000 + 20 * np.arange(200)
AHEAD_US = 1_700_000_000_000_000
"""The receiver's clock is Unix time."""


class Told(SimpleNamespace):
    """A table by its columns."""

    def __getitem__(self, column: str) -> np.ndarray:
        return np.asarray(self.columns[column])

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    def __len__(self) -> int:
        return len(self.offsets)


def told(offsets: Any, instance: int = 1, **columns: Any) -> Any:
    given = {STAMP_COLUMN if key == "stamp" else key: np.asarray(x) for key, x in columns.items()}
    return Told(instance=instance, offsets=np.asarray(offsets), columns=given)


def clock_of(**tables: Any) -> PacketClock:
    known: Any = {(name, t.instance): t for name, t in tables.items()}
    return PacketClock(Messages(Path("x.tlog"), "tlog", 100, known), 1)


ATTITUDE = told(100 * np.arange(200), time_boot_ms=BOOT_MS, stamp=AHEAD_US + 1000 * BOOT_MS)


def test_whole_milliseconds_that_have_passed_are_half_of_one_more() -> None:
    assert packet_clock.boot_stamps(told([1, 2], time_boot_ms=[7, 4_000_000_000])).tolist() == [
        7_500,
        4_000_000_000_500,
    ]


@pytest.mark.parametrize(("late", "steady"), [(0.45, True), (0.55, False)])
def test_stamps_that_advance_otherwise_by_more_than_half_of_a_step_are_no_clock(late: float, steady: bool) -> None:
    boot = 20_000 * np.arange(60)
    packet = boot + np.where(np.arange(60) % 2, round(late * 20_000), 0)
    assert packet_clock.is_steady(packet, boot) is steady
    assert packet_clock.is_steady(packet[:20], boot[:20])
    assert packet_clock.is_steady(packet[:21], boot[:21]) is steady


def test_a_date_that_the_autopilot_never_knew_or_that_cannot_be_is_none() -> None:
    """Milliseconds of Unix time, a year beyond 2100, and a boot clock that stands at zero."""
    for unix, boot_ms in ((10**15 - 1, 5), (5 * 10**15, 5), (1_650_000_000_000_000, 0)):
        system = told([1], time_boot_ms=[boot_ms], time_unix_usec=[unix])
        assert clock_of(SYSTEM_TIME=system).unix is None
    assert clock_of(ATTITUDE=ATTITUDE).unix is None


def test_small_backward_steps_become_steps_of_a_microsecond_and_large_ones_stay() -> None:
    t = np.array([0, 10, 7, 8, 30, 31])
    assert packet_clock.force_rising(t).tolist() == [0, 10, 11, 12, 30, 31]
    restarted = np.array([2_000_000, 2_000_010, 5, 15])
    assert packet_clock.force_rising(restarted).tolist() == restarted.tolist()
    edge = np.array([1_000_000, 2])
    assert packet_clock.force_rising(edge).tolist() == [1_000_000, 1_000_001]


@pytest.mark.parametrize("count", [11, 12, 21, 60])
def test_the_running_median_is_that_of_scipy_mirrored_at_the_ends(count: int) -> None:
    x = np.random.default_rng(count).integers(0, 10_000, count)
    np.testing.assert_array_equal(packet_clock.running_median(x), median_filter(x, 21, mode="mirror"))


# Units and unset values of MAVLink's rarer messages: other numbers in every column.

N = 6
RARE_BOOT_MS = (10_000 + 100 * np.arange(N)).astype(np.uint32)


def read_rare(function: Any, *more: Any, vehicle: str = "quadrotor", **tables: dict[str, Any]) -> Any:
    """What a function makes of messages of vehicle 1, whose records have the same times."""
    made = {(name, 1): {"time_boot_ms": RARE_BOOT_MS, **columns} for name, columns in tables.items()}
    builder = TelemetryBuilder(fake.messages("tlog", made), 10_000_500, instance=1, autopilot=mavlink.ARDUPILOT)
    builder.log.vehicle = vehicle
    return function(builder, *more)


def receiver(**more: Any) -> dict[str, Any]:
    return {
        "time_usec": np.zeros(N, np.uint64),
        "lat": np.full(N, 473_977_420, np.int32),
        "lon": np.full(N, -85_455_940, np.int32),
        "alt": np.full(N, 488_150, np.int32),
        "fix_type": np.full(N, 3, np.uint8),
        "vel": np.array([500, 600, 0xFFFF, 700, 800, 900], np.uint16),
        "cog": np.array([3000, 12_000, 9000, 0xFFFF, 27_000, 0], np.uint16),
        "h_acc": np.array([800, 0, 900, 800, 800, 800], np.uint32),
        "v_acc": np.full(N, 1600, np.uint32),
        "vel_acc": np.full(N, 300, np.uint32),
        "yaw": np.array([0, 36_000, 9000, 27_000, 0xFFFF, 18_100], np.uint16),
        "satellites_visible": np.full(N, 17, np.uint8),
        "eph": np.full(N, 85, np.uint16),
        **more,
    }


def test_a_receiver_counts_centimetres_hundredths_of_a_degree_and_millimetres() -> None:
    found = read_rare(mavlink.read_receiver, 0, GPS_RAW_INT=receiver())
    assert found is not None
    assert (found.lat[0], found.lon[0], found.alt[0]) == pytest.approx((47.3977420, -8.5455940, 488.15))
    course = np.radians([30.0, 120.0, 90.0, np.nan, 270.0, 0.0])
    speed = np.array([5.0, 6.0, np.nan, 7.0, 8.0, 9.0])
    np.testing.assert_allclose(found.vel_ned[:, 0], speed * np.cos(course), atol=1e-9)
    np.testing.assert_allclose(found.vel_ned[:, 1], speed * np.sin(course), atol=1e-9)
    assert np.isnan(found.vel_ned[:, 2]).all()
    np.testing.assert_allclose(found.h_acc, [0.8, np.nan, 0.9, 0.8, 0.8, 0.8])
    assert (found.v_acc[0], found.s_acc[0]) == pytest.approx((1.6, 0.3))
    assert read_rare(mavlink.read_receiver, 1, GPS_RAW_INT=receiver()) is None
    assert read_rare(mavlink.read_receiver, 1, GPS2_RAW=receiver()).source == "GPS2_RAW"


def test_a_heading_of_antennas_is_hundredths_of_a_degree_and_zero_or_all_ones_is_none() -> None:
    found = read_rare(mavlink.read_receiver, 0, GPS_RAW_INT=receiver())
    yaw = np.radians([np.nan, 0.0, 90.0, -90.0, np.nan, -179.0])
    assert found.yaw is not None
    np.testing.assert_allclose(found.yaw, yaw, atol=1e-9)
    for unset in (0, 0xFFFF):
        assert read_rare(mavlink.read_receiver, 0, GPS_RAW_INT=receiver(yaw=np.full(N, unset, np.uint16))).yaw is None


@pytest.mark.parametrize(("hpa", "metres"), [(1013.25, 0.0), (898.75, 1000.0), (794.95, 2000.0)])
def test_pressure_is_the_altitude_of_the_standard_atmosphere(hpa: float, metres: float) -> None:
    """US Standard Atmosphere 1976, table I."""
    pressure = {"press_abs": np.full(N, hpa, np.float32)}
    (found,) = read_rare(mavlink.baro_streams, SCALED_PRESSURE=pressure)
    assert found.x[0, 0] == pytest.approx(metres, abs=1.5)
    (second,) = read_rare(mavlink.baro_streams, SCALED_PRESSURE2=pressure)
    assert second.source == "SCALED_PRESSURE2"
    assert read_rare(mavlink.baro_streams) == []
    nothing = {"press_abs": np.array([0.5, *[hpa] * (N - 1)], np.float32)}
    assert len(read_rare(mavlink.baro_streams, SCALED_PRESSURE=nothing)[0].x) == N - 1


def test_a_battery_is_in_millivolts_and_hundredths_of_an_ampere() -> None:
    volts = np.array([12_000, 0xFFFF, 11_500, 11_400, 11_300, 11_200], np.uint16)
    amperes = np.array([1_550, 200, -1, 300, 400, 500], np.int16)
    found = read_rare(mavlink.battery_stream, SYS_STATUS={"voltage_battery": volts, "current_battery": amperes})
    assert found is not None
    np.testing.assert_allclose(found.x[[0, 3]], [[12.0, 15.5], [11.4, 3.0]])
    assert np.isnan(found.x[1, 0])
    assert np.isnan(found.x[2, 1])


def test_only_rotors_that_ever_turn_are_rotors() -> None:
    rpm = np.outer(np.arange(N), [1000, 0, 300, 0]).astype(np.uint16)
    found = read_rare(mavlink.rpm_stream, ESC_TELEMETRY_1_TO_4={"rpm": rpm})
    assert found is not None
    assert found.x[-1].tolist() == [5000.0, 1500.0]
    assert read_rare(mavlink.rpm_stream, ESC_TELEMETRY_1_TO_4={"rpm": 0 * rpm}) is None
    first, second = ({"rpm": rpm, "current": 100 + 0 * rpm, "temperature": 30 + 0 * rpm} for _ in range(2))
    found = read_rare(mavlink.esc_list, ESC_TELEMETRY_1_TO_4=first, ESC_TELEMETRY_5_TO_8=second)
    turned = [k for k in range(4) if rpm[:, k].any()]
    assert [esc.name for esc in found] == [f"ESC[{first + k}]" for first in (0, 4) for k in turned]
    assert (found[0].current[0], found[0].temperature[0]) == (1.0, 30.0)


@pytest.mark.parametrize(("vehicle", "has_airspeed"), [("quadrotor", False), ("fixed wing", True)])
def test_throttle_is_percent_and_airspeed_that_of_planes(vehicle: str, has_airspeed: bool) -> None:
    hud = {"throttle": np.full(N, 43, np.uint16), "airspeed": np.full(N, 17.5, np.float32)}
    throttle = read_rare(mavlink.throttle_stream, VFR_HUD=hud)
    assert throttle.x[0, 0] == pytest.approx(0.43)
    airspeed = read_rare(mavlink.airspeed_stream, vehicle=vehicle, VFR_HUD=hud)
    assert (None if airspeed is None else airspeed.x[0, 0]) == (17.5 if has_airspeed else None)


def test_set_points_keep_their_axes() -> None:
    rates = {f"body_{axis}_rate": np.full(N, 0.1 * k, np.float32) for k, axis in enumerate(("roll", "pitch", "yaw"), 1)}
    target = {"q": np.tile(np.array([0.8, 0.0, 0.6, 0.0], np.float32), (N, 1)), **rates}
    attitude = read_rare(mavlink.attitude_setpoint, ATTITUDE_TARGET=target)
    np.testing.assert_allclose(attitude.q[0], [0.8, 0.0, 0.6, 0.0], atol=1e-6)
    assert attitude.has_trim
    found = read_rare(mavlink.rate_setpoint_stream, ATTITUDE_TARGET=target)
    np.testing.assert_allclose(found.x[0], [0.1, 0.2, 0.3], rtol=1e-6)


def test_a_date_is_unix_time_between_the_first_flights_and_the_end_of_the_clock() -> None:
    builder = TelemetryBuilder(fake.messages("tlog", {}))
    builder.clock.unix = 1_700_000_000_000_000
    assert mavlink.utc_offset(builder) == pytest.approx(1.7e9)
    assert builder.problems == []
    for unix in (10**14, 10**16):
        builder.clock.unix = unix
        assert mavlink.utc_offset(builder) is None
    assert len(builder.problems) == 2


def link(boot_s: np.ndarray, received_s: np.ndarray, counter_s: np.ndarray | None = None) -> Messages:
    """A tlog of ATTITUDE and RAW_IMU packets in turn, sent at boot times and received at others."""
    n = len(boot_s)
    both = {
        "ATTITUDE": attitude(n, 5.0) | {"time_boot_ms": np.round(1e3 * boot_s).astype(np.uint32)},
        "RAW_IMU": raw_imu(n, 5.0)
        | {"time_usec": np.round(1e6 * (boot_s if counter_s is None else counter_s)).astype(np.uint64)},
    }
    made = {}
    for k, (name, columns) in enumerate(both.items()):
        stamped = columns | {STAMP_COLUMN: UNIX + np.round(1e6 * received_s).astype(np.int64)}
        made[name, ME] = fake.table(name, ME, stamped, 200 * np.arange(n) + 100 * k)
    result = Messages(Path("made.tlog"), "tlog", 200 * n, made, [], [], systems(3))
    result.boots = [Boot(0, 200 * n)]
    return result


@pytest.mark.parametrize(("jump_s", "gap_s", "left"), [(520.0, 0.2, 380), (520.0, 500.0, 400), (20.0, 0.2, 400)])
def test_packets_from_before_a_jump_of_the_boot_clock_alone_are_stale(jump_s: float, gap_s: float, left: int) -> None:
    """Twenty packets at the start: where the receiver waits as long, the link or the logger paused."""
    even, behind = 0.2 * np.arange(400), np.arange(400) >= 20
    log = mavlink.read(link(1000.0 + even + jump_s * behind, even + gap_s * behind), None, None, None)
    assert len(log.imus[0].gyro.t) == left
    assert ("stale_packets" in [p.code for p in log.problems]) is (left < 400)


def test_stamps_that_stand_still_show_no_stale_packets() -> None:
    even, behind = 0.2 * np.arange(400), np.arange(400) >= 20
    log = mavlink.read(link(1000.0 + even + 520.0 * behind, 0.0 * even), None, None, None)
    assert "stale_packets" not in [p.code for p in log.problems]


def test_without_inertial_packets_the_longer_part_is_kept() -> None:
    even, behind = 0.2 * np.arange(400), np.arange(400) >= 20
    both = link(1000.0 + even + 520.0 * behind, even + 0.2 * behind)
    del both.tables["RAW_IMU", ME]
    left, said = without_stale_packets(both, ME, ["RAW_IMU"])
    assert len(left.tables["ATTITUDE", ME]) == 380
    assert said.startswith("Packets of an older time")


def test_a_clock_that_jumps_again_and_again_is_left_alone() -> None:
    even = 0.2 * np.arange(400)
    assert (
        len(mavlink.read(link(even + 1.0 + 40.0 * (np.arange(400) // 80), even), None, None, None).imus[0].gyro.t)
        == 400
    )


@pytest.mark.parametrize("turns", [0, 1, 3])
def test_a_counter_of_microseconds_that_turned_over_is_put_on_the_boot_clock(turns: int) -> None:
    """It turns once more in the middle of the log."""
    turn_s = 2.0**32 * 1e-6
    boot = turn_s * (turns + 1) - 40.0 + 0.2 * np.arange(400)
    log = mavlink.read(link(boot, boot, boot % turn_s), None, None, None)
    assert log.t0_us == pytest.approx(1e6 * boot[0], abs=1e3)
    np.testing.assert_allclose(log.imus[0].gyro.t, boot - boot[0], atol=2e-3)


QUAD = {
    "FRAME_CLASS": 1.0,
    "FRAME_TYPE": 1.0,
    "MOT_SPIN_MIN": 0.15,
    "MOT_SPIN_MAX": 0.95,
    "RC3_MIN": 1100.0,
    "RC3_MAX": 1900.0,
}


@pytest.mark.parametrize(
    ("autopilot", "params", "scaled", "wanted"),
    [
        (3, QUAD | {"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0}, True, (0.0, 1.0, 0.5, -0.1875)),
        (3, QUAD, False, (0.15, 0.95, 0.55, 0.0)),  # a list of parameters sent in part: RC3 is another scale
        (12, {"SYS_AUTOSTART": 4001.0, "PWM_MIN": 1150.0, "PWM_MAX": 1950.0}, True, (0.0, 1.0, 0.5, -0.1875)),
        (12, {"SYS_AUTOSTART": 4001.0, "BAT1_N_CELLS": 4.0}, False, (0.15, 0.95, 0.55, 0.0)),
    ],
)
def test_motor_outputs_of_telemetry_run_from_floor_to_ceiling(
    autopilot: int, params: dict[str, float], scaled: bool, wanted: tuple[float, ...]
) -> None:
    pulses = {f"servo{n}_raw": np.full(50, pulse) for n, pulse in enumerate((1150, 1950, 1550, 1000, 1500), 1)}
    stamps = clock(50, 5)
    outputs = {"time_usec": stamps["time_boot_ms"].astype(np.uint64) * 1000, "_t_us": stamps["_t_us"], **pulses}
    outputs["port"] = np.where(np.arange(50) == 7, 1, 0)  # of another port
    heart = clock(10, 1) | {n: np.full(10, v) for n, v in {"type": 2, "autopilot": autopilot, "base_mode": 0}.items()}
    tables = {("SERVO_OUTPUT_RAW", ME): outputs, ("ATTITUDE", ME): attitude(100, 10)}
    tables["HEARTBEAT", ME] = heart | {"custom_mode": np.zeros(10)}
    found = mavlink.read(messages("tlog", tables, params, info=systems(autopilot)), None, None, None).power.outputs
    assert found is not None
    assert found.scaled is scaled
    assert len(found.t) == 49
    assert found.x[0] == pytest.approx(wanted)
