"""What does the gyro itself wander by?"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import detrend

from attlog.flight.model import Imu, Stream
from attlog.metrics.noise.gyro_share import gyro_share
from attlog.segments.model import Segment
from tests.metrics import flights

HOVER = [Segment("continuous", 0, 200), Segment("airborne", 0, 200), Segment("hover", 0, 200)]


def flown(gyro, hz):
    """A case with a gyro (n, 3) in deg/s and nothing else, in hover all the time."""
    t = np.arange(len(gyro)) / hz
    case = flights.case([], HOVER)
    acc = Stream(t, np.tile([0.0, 0.0, -9.81], (len(t), 1)), "m/s^2", "FRD", "made")
    case.log.imus, case.log.imu = [Imu(0, Stream(t, np.radians(gyro), "rad/s", "FRD", "made"), acc)], 0
    return case


def wander(gyro, hz):
    """The typical window's deviation about its own line of an integrated rate (n,), by scipy."""
    windows = np.cumsum(gyro / hz)[: len(gyro) // round(5 * hz) * round(5 * hz)].reshape(-1, round(5 * hz))
    return np.exp(np.mean(np.log(np.var(detrend(windows, axis=1), axis=1))) / 2)


@pytest.mark.parametrize("hz", [50.0, 250.0])
def test_it_is_what_white_noise_of_the_gyro_becomes_when_it_is_integrated(hz):
    gyro = np.random.default_rng(3).standard_normal((round(200 * hz), 3)) * [0.2, 0.4, 0.8]
    roll, pitch, heading, tilt = gyro_share(flown(gyro, hz), 0, "hover")
    for k, found in enumerate((roll, pitch, heading)):
        # the typical of few degrees of freedom lies below the mean: 0.8 of it
        assert wander(gyro[:, k], hz) == pytest.approx(0.85 * found, rel=0.2)
    assert tilt == pytest.approx(np.sqrt((roll**2 + pitch**2) / 2))


def test_a_slow_motion_of_the_vehicle_is_hardly_any_of_it():
    t = np.arange(0.0, 200.0, 0.004)
    gyro = 0.3 * np.random.default_rng(3).standard_normal((len(t), 3))
    sway = 20.0 * np.sin(2 * np.pi * 0.3 * t)[:, None]
    assert gyro_share(flown(gyro + sway, 250.0), 0, "hover") == pytest.approx(
        gyro_share(flown(gyro, 250.0), 0, "hover"), rel=0.15
    )


def test_without_a_window_of_the_phase_it_is_not_known():
    assert gyro_share(flown(np.ones((2000, 3)), 100.0), 0, "cruise") == [0.0] * 4
