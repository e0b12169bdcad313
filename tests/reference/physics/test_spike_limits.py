"""Spikes of a gyro: each limit from both sides, and samples that stand for themselves on another clock."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Imu, Stream
from attlog.reference.physics import spikes

HZ = 100.0
N = 3000


def unit(dps: float = 0.0, count: int = 6, change: float = 0.0, noise: float = 0.0, blow: tuple[float, float] = (0, 0)):
    """So many samples jump about z; their neighbours differ by ``change``; a blow has a force and is so late."""
    t = np.arange(N) / HZ
    rate = np.zeros((N, 3))
    rate[::2, 0] = np.radians(noise)  # each is so far from the mean of its neighbours
    at = 200 + 400 * np.arange(count)
    rate[at, 2] += np.radians(dps)
    rate[at - 1, 1] -= np.radians(0.5 * change)
    rate[at + 1, 1] += np.radians(0.5 * change)
    force = np.tile([0.0, 0.0, -9.81], (N, 1))
    stamps = t.copy()
    if blow[0]:
        force[at, 1] = np.sqrt(blow[0] ** 2 - 9.81**2)
        stamps = t + blow[1]
    return Imu(0, Stream(t, rate, "rad/s", "FRD", "IMU:0"), Stream(stamps, force, "m/s^2", "FRD", "IMU:0"))


@pytest.mark.parametrize(
    ("made", "count"),
    [
        (unit(99.0), 0),
        (unit(101.0), 6),
        (unit(158.0, noise=8.0), 0),
        (unit(163.0, noise=8.0), 6),
        (unit(130.0, change=44.0), 0),
        (unit(130.0, change=43.0), 6),
        (unit(130.0, blow=(29.9, 0.0)), 6),
        (unit(130.0, blow=(30.1, 0.0)), 0),
        (unit(130.0, blow=(40.0, 0.019)), 0),
        (unit(130.0, blow=(40.0, 0.021)), 6),
        (unit(130.0, blow=(40.0, -0.019)), 0),
        (unit(130.0, blow=(40.0, -0.021)), 6),
    ],
)
def test_a_spike_is_far_from_its_neighbours_alone_and_no_blow(made: Imu, count: int) -> None:
    assert spikes.of(made).count == count


@pytest.mark.parametrize(("count", "told"), [(4, False), (5, True)])
def test_five_spikes_are_told_with_their_turn_and_time(count: int, told: bool) -> None:
    found = spikes.of(unit(150.0, count))
    assert found.count == count
    assert bool(found.why) is told
    if told:
        assert found.t == 2.0
        assert found.deg_per_min == pytest.approx(count * 1.5 / 0.5)
        assert "IMU:0 jumps 5 times for a single sample, by up to 150 deg/s" in found.why


@pytest.mark.parametrize(("dps", "misleads"), [(165.0, False), (168.0, True)])
def test_twenty_degrees_in_a_minute_mislead(dps: float, misleads: bool) -> None:
    """Six of 10 ms in half a minute."""
    assert spikes.of(unit(dps)).misleads is misleads


def test_a_hundred_samples_are_needed() -> None:
    made = unit(150.0)
    for kept, count in ((99, 0), (100, 1)):
        rate = made.gyro.x[160 : 160 + kept]
        few = Imu(0, Stream(made.gyro.t[:kept], rate, "", "", ""), Stream(made.acc.t, made.acc.x, "", "", ""))
        assert spikes.of(few).count == count
