"""Is the accelerometer on the clock of the attitude?"""

from __future__ import annotations

import copy

import numpy as np
import pytest

from attlog import flight
from attlog.reference.physics import late_force
from tests.conftest import SAMPLES


@pytest.fixture(scope="module")
def sound():
    return flight.read(SAMPLES / "px4_steps.ulg")


def shifted(log, seconds):
    log = copy.copy(log)
    imu = copy.copy(log.imus[log.imu])
    imu.acc = copy.copy(imu.acc)
    imu.acc.x = np.column_stack([np.interp(imu.acc.t - seconds, imu.acc.t, imu.acc.x[:, k]) for k in range(3)])
    log.imus = [imu if k == log.imu else other for k, other in enumerate(log.imus)]
    return log


@pytest.mark.parametrize("seconds", [-3.0, 1.2, 6.0])
def test_a_delay_of_the_accelerometer_is_found_with_its_size_and_sign(sound, seconds):
    assert late_force.seconds(shifted(sound, seconds)) == pytest.approx(seconds, abs=0.15)


def test_an_accelerometer_on_time_a_noisy_one_and_one_without_gnss_are_not_late(sound):
    assert late_force.seconds(sound) is None
    noisy = shifted(sound, 0.0)
    noisy.replay_imu.acc.x += 3.0 * np.random.default_rng(0).normal(size=noisy.replay_imu.acc.x.shape)
    assert late_force.seconds(noisy) is None
    without = copy.copy(shifted(sound, 3.0))
    without.gnss = []
    assert late_force.seconds(without) is None
