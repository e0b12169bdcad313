"""Delays of receiver and compass planted in a flight in closed form come back, inside their standard errors."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.health.fits import delays
from tests.health.assessments.onboard.made import EARTH_UT, RATE, SECONDS, attitude, flight

FLOWN = [(5.0, SECONDS - 5.0)]


def path(turn_deg: float = 0.0) -> delays.AttitudePath:
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    return delays.AttitudePath(t, rotation.turn_about_down(attitude(t), np.radians(turn_deg)), None, "truth")


def found(late_s: float, turn_deg: float = 0.0, seed: int = 0) -> delays.DelayFit:
    log = flight(late_s, seed)
    imu = log.replay_imu
    assert imu is not None
    one = delays.gnss(imu, log.gnss[0], path(turn_deg), FLOWN, 0.1)
    assert one is not None
    return one


@pytest.mark.parametrize("late_s", [-0.05, 0.0, 0.06, 0.12, 0.2, 0.4])
def test_a_late_receiver_is_found_from_any_start(late_s: float) -> None:
    one = found(late_s)
    assert one.delay == pytest.approx(late_s, abs=0.006)
    assert all(half == pytest.approx(late_s, abs=0.012) for half in one.halves)


def test_the_standard_error_is_that_of_the_scatter() -> None:
    every = [found(0.12, seed=seed) for seed in range(8)]
    scatter = np.std([one.delay for one in every], ddof=1)
    assert np.median([one.sigma for one in every]) == pytest.approx(scatter, rel=0.6)


def test_a_turned_heading_is_no_delay() -> None:
    one = found(0.12, turn_deg=6.0)
    assert one.delay == pytest.approx(0.12, abs=0.008)
    assert abs(one.turn_deg) == pytest.approx(6.0, abs=0.5)


def test_the_time_of_receipt_counts_and_not_that_of_the_record() -> None:
    log = flight(0.12)
    log.gnss[0].received = log.gnss[0].t - 0.03
    imu = log.replay_imu
    assert imu is not None
    one = delays.gnss(imu, log.gnss[0], path(), FLOWN, 0.1)
    assert one is not None
    assert one.delay == pytest.approx(0.09, abs=0.006)


def test_holes_between_inertial_samples_are_not_bridged() -> None:
    log = flight(0.12)
    imu = log.replay_imu
    assert imu is not None
    keep = (imu.acc.t % 20.0) > 3.0
    for stream in (imu.gyro, imu.acc):
        stream.t, stream.x = stream.t[keep], stream.x[keep]
    one = delays.gnss(imu, log.gnss[0], path(), FLOWN, 0.1)
    assert one is not None
    assert one.delay == pytest.approx(0.12, abs=0.008)
    assert one.n < 0.8 * found(0.12).n


def test_nothing_is_made_of_nothing() -> None:
    log = flight()
    imu = log.replay_imu
    assert imu is not None
    log.gnss[0].fix[:] = 0
    assert delays.gnss(imu, log.gnss[0], path(), FLOWN, 0.1) is None
    assert delays.gnss(imu, flight().gnss[0], path(), [], 0.1) is None
    assert delays.compass(np.zeros(0), np.zeros((0, 3)), EARTH_UT, path()) is None


@pytest.mark.parametrize("late_s", [0.0, 0.05, -0.03])
def test_a_late_compass_is_found_beside_offset_turn_and_scale(late_s: float) -> None:
    t = np.arange(5.0, SECONDS - 5.0, 0.1)
    q = rotation.turn_about_down(attitude(t - late_s), np.radians(4.0))
    field = 1.03 * rotation.rotate_inverse(q, np.tile(EARTH_UT, (len(t), 1))) + np.array([4.0, -3.0, 2.0])
    field += np.random.default_rng(1).normal(0.0, 0.3, field.shape)
    one = delays.compass(t, field, EARTH_UT, path())
    assert one is not None
    assert one.delay == pytest.approx(late_s, abs=0.006)
    assert one.sigma < 0.004


def test_force_that_a_filter_makes_late_is_not_taken_for_an_early_receiver() -> None:
    log = flight(0.12)
    imu = log.replay_imu
    assert imu is not None
    imu.acc.t, imu.acc.delay = imu.acc.t + 0.04, 0.04
    one = delays.gnss(imu, log.gnss[0], path(), FLOWN, 0.1)
    assert one is not None
    assert one.delay == pytest.approx(0.12, abs=0.006)
