"""Gravity at rest against an attitude of a vehicle in which the IMU sits tilted."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.base import rotation
from attlog.health.sensors import accelerometer
from tests.reference.flights import flight


@pytest.mark.parametrize(("told", "deg"), [(True, 0.0), (False, 5.0)])
def test_a_trim_that_the_log_tells_is_no_angle_to_gravity(told: bool, deg: float) -> None:
    """The vehicle's attitude is ``q_imu (x) exp(-trim)``, with 3 and 4 deg in roll and pitch."""
    log, trim = flight(), np.radians([3.0, -4.0, 0.0])
    attitude = log.attitudes["ATT"]
    attitude.q = rotation.multiply(attitude.q, rotation.from_rotvec(-trim))
    attitude.has_trim, log.trim = True, trim if told else None
    found = accelerometer.checks(log, segments.build(log))
    (check,) = (c for c in found if c.name == "gravity direction")
    assert check.value == pytest.approx(deg, abs=0.1)
