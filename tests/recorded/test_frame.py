"""By which turns an attitude is told to be the gyro's."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Imu, Stream
from attlog.recorded import frame


def test_what_a_filter_adds_in_slow_turns_does_not_count_where_fast_ones_tell() -> None:
    """Two thirds turn at 40 deg/s as the gyro does; the rest at 4, where the filter adds as much."""
    t = np.arange(0.0, 60.0, 0.01)
    fast = t < 40.0
    gyro = np.radians(np.where(fast, 40.0, 4.0))[:, None] * [1.0, 0.0, 0.0]
    own = np.where(fast, 1.0, 2.0)[:, None] * gyro
    turned = np.concatenate([[0.0], np.cumsum(own[1:, 0] * 0.01)])
    unit = Imu(0, Stream(t, gyro, "rad/s", "FRD", "IMU"), Stream(t, 0.0 * gyro, "m/s^2", "FRD", "IMU"))
    q = rotation.from_euler(turned, 0.0 * t, 0.0 * t)
    assert frame._rate_difference(t, q, unit) == pytest.approx(0.0, abs=0.01)
