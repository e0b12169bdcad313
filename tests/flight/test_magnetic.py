"""Magnetometers: which one measures nothing."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.magnetic import dead, spikes, turn
from attlog.flight.model import Imu, Mag, Stream

T = np.arange(0.0, 10.0, 0.01)


def turning(deg: float) -> Imu:
    """A unit that turns by so much about its z axis and back."""
    rate = np.zeros((len(T), 3))
    rate[:, 2] = np.radians(deg) * np.pi / 10.0 * np.cos(2.0 * np.pi * T / 10.0)
    return Imu(0, Stream(T, rate, "rad/s", "FRD", "IMU"), Stream(T, 0.0 * rate, "m/s^2", "FRD", "IMU"))


def compass(field: np.ndarray) -> Mag:
    return Mag(0, Stream(T[::10], np.tile(field, (len(T) // 10, 1)), "T", "FRD", "MAG"))


@pytest.mark.parametrize(("deg", "is_dead"), [(10.0, False), (25.0, True)])
def test_a_field_that_never_changes_is_none_only_where_the_vehicle_turns(deg: float, is_dead: bool) -> None:
    assert turn(turning(deg), 0.0, 10.0) == pytest.approx(deg, rel=0.02)
    assert bool(dead(compass(np.array([2e-5, 0.0, 4e-5])), turning(deg))) is is_dead


def test_a_field_of_zero_is_none_whatever_the_vehicle_does() -> None:
    assert dead(compass(np.zeros(3)), None) == "all its values are zero"


def test_a_record_three_times_as_large_or_small_as_its_neighbours_is_a_spike() -> None:
    rng = np.random.default_rng(3)
    field = np.array([21e-6, 2e-6, 42e-6]) * (1.0 + 0.05 * rng.standard_normal((100, 1)))
    for k, factor in ((20, 4.0), (40, 0.2), (60, 2.0), (70, 0.5), (0, 0.2), (99, 4.0)):
        field[k] *= factor
    field[80], field[90] = 0.0, np.nan
    assert np.flatnonzero(spikes(field)).tolist() == [0, 20, 40, 80, 90, 99]
