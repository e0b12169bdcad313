"""Does the gyro jump for single samples?"""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Imu, Stream
from attlog.reference.physics import spikes


def gyro(rate):
    t = np.arange(len(rate)) / 200.0
    return Imu(0, Stream(t, rate, "rad/s", "FRD", "IMU"), Stream(t, np.zeros_like(rate), "m/s^2", "FRD", "IMU"))


def flown(n=12000):
    t = np.arange(n) / 200.0
    turns = np.column_stack([np.sin(t), 3.0 * np.sin(2.0 * t) ** 9, 0.5 * np.cos(t)])
    return turns + np.radians(0.3) * np.random.default_rng(1).normal(size=(n, 3))


def test_spikes_are_counted_and_their_turn_is_summed():
    rate = flown()
    rate[1000::1000, 1] += 20.0
    found = spikes.of(gyro(rate))
    assert found.count == 11
    assert found.deg_per_min == pytest.approx(11 * np.degrees(20.0 / 200.0), rel=0.02)
    assert found.t == pytest.approx(5.0)
    assert found.misleads


def test_brisk_turns_noise_and_a_blow_are_no_spikes():
    assert spikes.of(gyro(flown())).count == 0
    blow = flown()
    blow[6000] += 30.0
    assert spikes.of(gyro(blow)).why == ""
    shaken = flown() + np.radians(40.0) * np.random.default_rng(2).normal(size=(12000, 3))
    assert spikes.of(gyro(shaken)).why == ""


def test_small_spikes_are_told_and_mislead_nobody():
    rate = flown()
    rate[1000::2000, 2] += 3.0
    found = spikes.of(gyro(rate))
    assert found.why
    assert not found.misleads


def test_a_sample_beside_a_gap_is_no_spike():
    """What turned during the gap is not there, so that the neighbours tell nothing."""
    rate = flown()
    rate[1000::1000, 1] += 20.0
    unit = gyro(rate)
    unit.gyro.t = unit.gyro.t + 0.02 * (np.arange(len(rate)) // 1000)
    assert spikes.of(unit).count == 0


def test_what_the_accelerometer_feels_as_a_blow_is_no_spike_of_the_gyro():
    rate = flown()
    rate[1000::1000, 1] += 20.0
    struck = gyro(rate)
    struck.acc.x[1001::1000, 2] = -60.0
    assert spikes.of(struck).count == 0
    struck.acc.x[5001:, 2] = 0.0
    assert spikes.of(struck).count == 7
