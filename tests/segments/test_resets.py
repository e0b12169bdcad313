"""The gyro's rotation between instants is that of multiplying small rotations one after the other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.flight.model import Attitude, Imu, Stream
from attlog.segments import increments
from attlog.segments.increments import GyroIncrements
from tests.conftest import few


@pytest.mark.parametrize("sampling", few(["interval", "instant"], 2))
def test_rotation_over_an_interval_is_the_product_of_its_samples(sampling):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.003, 0.006, 4000))
    rate = np.radians(120) * np.sin(np.outer(t, [3.1, 2.3, 1.7]) + np.arange(3))
    edges = np.arange(0, 3990, 20)
    found = GyroIncrements(t, rate, sampling).between(t[edges[:-1]], t[edges[1:]])
    mean = rate[1:] if sampling == "interval" else 0.5 * (rate[1:] + rate[:-1])
    steps = Rotation.from_rotvec(mean * np.diff(t)[:, None])
    for k, (a, b) in enumerate(pairwise(edges)):
        product = Rotation.identity()
        for i in range(a, b):
            product = product * steps[i]
        off = Rotation.from_rotvec(found[k]).inv() * product
        assert np.degrees(off.magnitude()) < 0.01


def test_a_cone_turns_about_its_axis_though_no_rate_does():
    """Coning: rates about x and y in quadrature turn the body about z; the plain sum of angles misses it."""
    t = np.arange(0, 1, 1e-4)
    amplitude, frequency = np.radians(2.0), 2 * np.pi * 20
    rate = amplitude * frequency * np.column_stack([np.cos(frequency * t), np.sin(frequency * t), 0 * t])
    start, end = np.array([0.1]), np.array([0.6])
    found = GyroIncrements(t, rate, "instant").between(start, end)[0]
    expected = 0.5 * amplitude**2 * frequency * 0.5
    assert found[2] == pytest.approx(expected, rel=0.02)


def test_the_gyro_stands_still_outside_its_times_whatever_the_order_in_which_it_is_asked():
    t = np.arange(0.0, 1.0, 0.01)
    turning = GyroIncrements(t, np.tile([0.3, -0.2, 0.1], (len(t), 1)))
    start, end = np.array([0.5, -3.0, 0.2, 0.985, 2.0, np.nan]), np.array([0.505, 0.1, 4.0, 0.995, 3.0, 0.5])
    wanted = np.outer([0.005, 0.1, 0.79, 0.005, 0.0, np.nan], [0.3, -0.2, 0.1])
    np.testing.assert_allclose(turning.between(start, end), wanted, atol=1e-12)
    assert not GyroIncrements(t[:1], np.ones((1, 3))).between(start, end).any()


# Resets of an attitude are found by the autopilot's counter, and without one by the gyro.

RATE, ATTITUDE_EVERY = 200.0, 10


def agile(seconds: float = 40.0, seed: int = 1, late: float = 0.0) -> tuple[Imu, Attitude]:
    """Fast turns of up to 250 deg/s, their gyro, and the attitude at 20 Hz, ``late`` by that many seconds."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / RATE)
    rate = np.radians(250) * np.sin(np.outer(t, [5.1, 3.7, 1.3])) * np.sin(0.3 * t)[:, None] ** 2
    q = np.empty((len(t), 4))
    q[0] = [1, 0, 0, 0]
    steps = rotation.from_rotvec(0.5 * (rate[1:] + rate[:-1]) / RATE)
    for i in range(1, len(t)):
        q[i] = rotation.multiply(q[i - 1], steps[i - 1])
    gyro = rate + np.radians(1.0 + 0.1 * rng.normal(size=rate.shape))
    imu = Imu(0, Stream(t, gyro, "rad/s", "FRD", "IMU:0"), Stream(t, np.zeros((len(t), 3)), "m/s^2", "FRD", "IMU:0"))
    at = t[::ATTITUDE_EVERY]
    return imu, Attitude(at, rotation.slerp(t, q, np.maximum(at - late, 0)), "ATT")


def jump(attitude: Attitude, i: int, heading_deg: float, tilt_deg: float = 0.0) -> None:
    """Reset the attitude from sample i on."""
    turn = rotation.from_rotvec(np.radians([tilt_deg, 0.0, heading_deg]))
    attitude.q[i:] = rotation.multiply(turn, attitude.q[i:])


@pytest.mark.parametrize("late", [0.0, 0.02])
def test_fast_flight_shows_no_reset(late):
    imu, attitude = agile(late=late)
    assert len(increments.find_resets(attitude, imu)[0]) == 0


@pytest.mark.parametrize("size", few([3.0, 20.0, -90.0, 180.0], 2))
def test_a_jump_in_heading_is_found_at_its_sample_without_any_counter(size):
    imu, attitude = agile()
    jump(attitude, 240, size)
    found, why = increments.find_resets(attitude, imu)
    assert found.tolist() == [240]
    assert "the gyro does not explain" in why[0]
    assert f"{abs(size):.0f}." in why[0] or abs(size) == 3.0


def test_a_counter_is_believed_even_where_the_jump_is_small_and_counts_once():
    imu, attitude = agile()
    jump(attitude, 240, 30.0)
    jump(attitude, 500, 0.2)
    attitude.resets = np.array([240, 500])
    found, why = increments.find_resets(attitude, imu)
    assert found.tolist() == [240, 500]
    assert all("counter" in w for w in why)


@pytest.mark.parametrize("beside", [-1, 1])
def test_a_jump_one_sample_beside_its_counter_is_no_second_reset(beside):
    """Counter and attitude may stand in records of their own, one sample apart."""
    imu, attitude = agile()
    jump(attitude, 240, 30.0)
    attitude.resets = np.array([240 + beside])
    assert increments.find_resets(attitude, imu)[0].tolist() == [240 + beside]


def test_a_step_across_a_gap_is_not_called_a_reset():
    imu, attitude = agile()
    keep = (imu.gyro.t < 10) | (imu.gyro.t > 12)
    imu.gyro.t, imu.gyro.x = imu.gyro.t[keep], imu.gyro.x[keep]
    assert len(increments.find_resets(attitude, imu)[0]) == 0
    keep = (attitude.t < 10) | (attitude.t > 12)
    attitude.t, attitude.q = attitude.t[keep], attitude.q[keep]
    assert len(increments.find_resets(attitude, imu)[0]) == 0


def test_without_gyro_only_the_counter_tells():
    _, attitude = agile()
    jump(attitude, 240, 90.0)
    assert len(increments.find_resets(attitude, None)[0]) == 0
    attitude.resets = np.array([240])
    assert increments.find_resets(attitude, None)[0].tolist() == [240]


@pytest.mark.parametrize(
    ("rate_dps", "size", "told"), [(0.0, 0.9, False), (0.0, 1.1, True), (200.0, 1.8, False), (200.0, 2.2, True)]
)
def test_a_jump_is_more_than_a_degree_and_a_tenth_of_what_was_turned(rate_dps, size, told):
    """200 deg/s turn 10 deg between two attitudes at 20 Hz: 1 deg more may be the gyro's scale."""
    t = np.arange(0.0, 20.0, 1 / RATE)
    gyro = np.tile(np.radians([0.0, 0.0, rate_dps]), (len(t), 1))
    imu = Imu(0, Stream(t, gyro, "rad/s", "FRD", "IMU:0"), Stream(t, 0 * gyro, "m/s^2", "FRD", "IMU:0"))
    at = t[::ATTITUDE_EVERY]
    attitude = Attitude(at, rotation.from_euler(0 * at, 0 * at, np.radians(rate_dps) * at), "ATT")
    jump(attitude, 200, size)
    assert increments.find_resets(attitude, imu)[0].tolist() == ([200] if told else [])


def test_before_the_gyro_begins_and_after_it_ends_nothing_is_said_of_a_jump():
    imu, attitude = agile()
    for stream in (imu.gyro, imu.acc):
        inside = (stream.t >= 5.0) & (stream.t <= 30.0)
        stream.t, stream.x = stream.t[inside], stream.x[inside]
    found = increments.unexplained_deg(attitude, imu)
    assert found is not None
    known = np.isfinite(found[0])
    np.testing.assert_array_equal(known, (attitude.t[:-1] >= imu.gyro.t[0]) & (attitude.t[1:] <= imu.gyro.t[-1]))
