"""Magnetometers: which one measures nothing."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.magnetic import dead, turn
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
