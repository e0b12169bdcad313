"""A flight as a bag is the flight as a ULog, beside a motion capture on a clock and in axes of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog import flight as flights
from attlog.base import rotation
from attlog.flight.model import FlightLog
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.logs import write
from attlog.simulate.scenario.overrides import overridden
from attlog.simulate.scenario.scenario import build, values_of
from tests.formats.ros.bags import decoded

Logs = tuple[FlightLog, FlightLog]


@pytest.fixture(scope="module")
def flown() -> Flight:
    """The first 12 s of the hover: at rest, armed, taken off."""
    return fly(build(overridden(values_of("hover"), ["seconds=12"])), 0)


@pytest.fixture(scope="module")
def bag(flown: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "a.mcap"
    write(path, flown)
    return path


@pytest.fixture(scope="module")
def both(flown: Flight, bag: Path) -> Logs:
    write(bag.with_suffix(".ulg"), flown)
    return flights.read(bag), flights.read(bag.with_suffix(".ulg"))


def test_every_stream_equals_that_of_the_ulog(both: Logs) -> None:
    one, other = both
    assert one.replay_imu is not None
    assert other.replay_imu is not None
    assert (one.t0_us, one.replay_imu.gyro.source) == (other.t0_us, other.replay_imu.gyro.source)
    pairs = [(one.replay_imu.gyro, other.replay_imu.gyro), (one.replay_imu.acc, other.replay_imu.acc)]
    pairs += [(a.field, b.field) for a, b in zip(one.mags, other.mags, strict=True)]
    for a, b in pairs:
        np.testing.assert_array_equal(a.t, b.t)
        np.testing.assert_array_equal(a.x, b.x)
    np.testing.assert_array_equal(one.attitudes["vehicle_attitude"].q, other.attitudes["vehicle_attitude"].q)
    np.testing.assert_array_equal(one.gnss[0].vel_ned, other.gnss[0].vel_ned)
    assert one.armed is not None
    assert other.armed is not None
    assert (one.armed.value, list(one.armed.t)) == (other.armed.value, list(other.armed.t))


def test_the_motion_capture_is_the_truth_but_for_its_axes_and_noise(both: Logs) -> None:
    one, other = both
    truth, pose = other.truth, one.poses["/mocap/pose"]
    assert truth is not None
    at = np.searchsorted(truth.t, pose.t[100:-100])
    world = rotation.multiply(pose.q[100:-100], np.array([0.0, 1.0, 0.0, 0.0]))  # body forward-right-down
    turned = rotation.multiply(world, rotation.conjugate(truth.q[at]))
    spread = rotation.total_angle(rotation.multiply(rotation.conjugate(turned[:1]), turned))
    assert 0.02 < np.degrees(np.median(spread)) < 0.5
    assert len(pose.t) > 1100


@pytest.mark.slow
def test_the_official_decoder_reads_it(bag: Path, flown: Flight) -> None:
    poses = [m for m in decoded(bag) if hasattr(m, "pose")]
    assert poses[0].header.frame_id == "map"
    assert len(poses) > 1100


def test_the_same_flight_gives_the_same_bytes(bag: Path, flown: Flight, tmp_path: Path) -> None:
    write(tmp_path / "b.mcap", flown)
    assert (tmp_path / "b.mcap").read_bytes() == bag.read_bytes()
