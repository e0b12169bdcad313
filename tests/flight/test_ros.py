"""A bag of sensor messages as a flight: axes of REP 103 and 145 to forward-right-down and north-east-down."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import flight as flights
from attlog import formats
from attlog.flight.model import FlightLog
from attlog.formats.table import Field, Table
from tests.formats.ros.bags import FIELD, IMU, START_NS, combined, header, write_mcap, xyz

HALF = float(np.sqrt(0.5))
NORTH = [0.0, 0.0, HALF, HALF]
"""Level with the nose to the north, forward-left-up in east-north-up, scalar last."""
FIX, TWIST, POSE = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/PoseStamped"
GYRO_FLU, FIELD_FLU = np.array([0.1, 0.2, 0.3]), np.array([20e-6, 3e-6, -45e-6])
Messages = list[tuple[str, str, int, dict[str, Any]]]


def test_a_bag_without_imu_has_the_time_of_its_other_messages(tmp_path: Path) -> None:
    write_mcap(tmp_path / "a.mcap", gnss(100))
    assert flights.read(tmp_path / "a.mcap").seconds == pytest.approx(19.8, abs=0.3)


def test_a_time_that_is_no_number_costs_only_its_topic(tmp_path: Path) -> None:
    messages = formats.open(_bag(tmp_path))
    table = messages["sensor_combined", 0]
    wide = {"timestamp": Field("timestamp", np.dtype(("u8", (4,))))}
    stored = table["timestamp"]
    decode = table._decode
    messages.tables["sensor_combined", 0] = Table(
        table.name,
        0,
        table.fields | wide,
        table.offsets,
        lambda c, at: np.repeat(stored[at, None], 4, axis=1) if c == "timestamp" else decode(c, at),
    )
    log = flights.flight_in(messages)
    assert log.imu is None
    assert any("is no time" in p.text for p in log.problems)


def _bag(folder: Path) -> Path:
    write_mcap(folder / "b.mcap", combined(60))
    return folder / "b.mcap"


def imus(topic: str, n: int, attitude: bool, late_ns: int = 0) -> Messages:
    rng = np.random.default_rng(n)
    found: Messages = []
    for i in range(n):
        ns, tilt = 10_000_000 * i, 1e-6 * rng.normal()
        values = {
            "header": header(ns, "base_link"),
            "orientation": xyz([NORTH[0] + tilt, *NORTH[1:]], "xyzw"),
            "orientation_covariance": [1.0 if attitude else -1.0] + [0.0] * 8,
            "angular_velocity": xyz(GYRO_FLU + 1e-3 * rng.normal(size=3)),
            "angular_velocity_covariance": [0.0] * 9,
            "linear_acceleration": xyz([0.0, 0.0, 9.8] + 1e-2 * rng.normal(size=3)),
            "linear_acceleration_covariance": [0.0] * 9,
        }
        found.append((topic, IMU, ns + late_ns, values))
    return found


def fields(n: int, factor: float = 1.0) -> Messages:
    rng = np.random.default_rng(9)
    return [
        (
            "/mavros/imu/mag",
            FIELD,
            50_000_000 * i,
            {
                "header": header(50_000_000 * i, "base_link"),
                "magnetic_field": xyz((FIELD_FLU + 1e-8 * rng.normal(size=3)) * factor),
                "magnetic_field_covariance": [0.0] * 9,
            },
        )
        for i in range(n)
    ]


def gnss(n: int) -> Messages:
    found: Messages = []
    for i in range(n):
        ns = 200_000_000 * i
        values = {
            "header": header(ns, "gps"),
            "status": {"status": 0, "service": 1},
            "latitude": 47.0,
            "longitude": 8.0 + 1e-6 * i,
            "altitude": 500.0,
            "position_covariance": [4.0, 0, 0, 0, 4.0, 0, 0, 0, 9.0],
            "position_covariance_type": 2,
        }
        found.append(("/mavros/global_position/raw/fix", FIX, ns, values))
        twist = {"linear": xyz([1.0, 2.0, 3.0]), "angular": xyz([0, 0, 0])}
        found.append(("/mavros/global_position/raw/gps_vel", TWIST, ns, {"header": header(ns, "map"), "twist": twist}))
    return found


def poses(n: int) -> Messages:
    return [
        (
            "/mocap/pose",
            POSE,
            10_000_000 * i + 7_000_000,
            {
                "header": header(10_000_000 * i, "world"),
                "pose": {"position": xyz([i, 0, 1]), "orientation": xyz(NORTH, "xyzw")},
            },
        )
        for i in range(n)
    ]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> FlightLog:
    path = tmp_path_factory.mktemp("bag") / "a.mcap"
    raw, fused = imus("/mavros/imu/data_raw", 1000, False, 2_000_000), imus("/mavros/imu/data", 1000, True)
    write_mcap(path, [*fused, *raw, *imus("/camera/imu", 300, False), *fields(200), *gnss(50), *poses(900)])
    return flights.read(path)


def test_the_raw_topic_of_those_with_most_records_is_replayed_and_said(log: FlightLog) -> None:
    assert log.replay_imu is not None
    assert log.replay_imu.gyro.source == "/mavros/imu/data_raw"
    assert log.choices["imu"] == "The topic with most records, raw before fused."


def test_vectors_are_turned_from_left_up_to_right_down(log: FlightLog) -> None:
    imu = log.replay_imu
    assert imu is not None
    np.testing.assert_allclose(imu.gyro.x.mean(0), GYRO_FLU * [1, -1, -1], atol=2e-4)
    np.testing.assert_allclose(imu.acc.x.mean(0), [0, 0, -9.8], atol=2e-3)
    np.testing.assert_allclose(log.mags[0].field.x.mean(0), FIELD_FLU * [1, -1, -1], atol=1e-8)


def test_stamps_are_those_of_the_headers_not_of_the_recorder(log: FlightLog) -> None:
    assert log.t0_us == START_NS // 1000
    assert log.replay_imu is not None
    np.testing.assert_allclose(log.replay_imu.gyro.t[:3], [0.0, 0.01, 0.02], atol=1e-9)


def test_an_orientation_is_the_onboard_attitude_where_its_covariance_allows(log: FlightLog) -> None:
    assert list(log.attitudes) == ["/mavros/imu/data"]
    assert log.onboard == "/mavros/imu/data"
    level = np.abs(log.attitudes["/mavros/imu/data"].q[:, 0])  # nose to the north and level: no rotation from NED
    np.testing.assert_allclose(level, 1.0, atol=1e-9)


def test_velocities_beside_a_fix_are_north_east_down(log: FlightLog) -> None:
    assert len(log.gnss) == 1
    np.testing.assert_allclose(log.gnss[0].vel_ned[10], [2.0, 1.0, -3.0])
    assert (log.gnss[0].h_acc[0], log.gnss[0].v_acc[0]) == (2.0, 3.0)


def test_poses_keep_their_own_axes(log: FlightLog) -> None:
    pose = log.poses["/mocap/pose"]
    np.testing.assert_allclose(pose.q[0], [NORTH[3], *NORTH[:3]], atol=1e-12)
    np.testing.assert_allclose(pose.t[:2], [0.0, 0.01], atol=1e-9)


def test_what_a_bag_cannot_know_is_unknown(log: FlightLog) -> None:
    assert (log.state.armed, log.state.mode, log.state.landed, log.parameters.lines, log.simulated) == (
        None,
        None,
        None,
        {},
        False,
    )
    assert log.firmware.name == "ROS 2"


@pytest.mark.parametrize(("factor", "word"), [(1e6, "microtesla"), (1e4, "gauss"), (1e10, "milligauss times 1000")])
def test_a_field_in_another_unit_is_converted_and_told(tmp_path: Path, factor: float, word: str) -> None:
    write_mcap(tmp_path / "a.mcap", [*imus("/imu", 500, False), *fields(100, factor)])
    log = flights.read(tmp_path / "a.mcap")
    np.testing.assert_allclose(log.mags[0].field.x.mean(0), FIELD_FLU * [1, -1, -1], rtol=1e-3)
    assert [f"read as {word}" in p.text for p in log.problems if p.code == "mag_unit"] == [True]


def test_poses_beside_px4_topics_stand_on_its_clock(tmp_path: Path) -> None:
    write_mcap(tmp_path / "a.mcap", [*combined(1000), *poses(300)])
    log = flights.read(tmp_path / "a.mcap")
    assert (log.firmware.name, log.t0_us) == ("PX4", 5_000_000)
    np.testing.assert_allclose(log.poses["/mocap/pose"].t[:2], [0.0, 0.01], atol=1e-3)
