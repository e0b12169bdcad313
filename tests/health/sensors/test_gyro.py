"""What the gyro reads while the vehicle stands still."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.health.sensors import gyro
from attlog.segments import Segment, Segments
from tests.segments.flights import imu_log


@pytest.mark.parametrize(
    ("before", "after", "verdict"), [(-0.6, 0.6, "warning"), (-0.4, 0.4, "ok"), (-1.6, 1.6, "fault"), (0.6, 0.6, "ok")]
)
def test_a_bias_that_changes_counts_though_each_reading_is_small(before: float, after: float, verdict: str) -> None:
    """Two rests: ok up to 1 deg/s, fault above 3, for the reading and for its change."""
    t = np.arange(0.0, 60.0, 0.01)
    x = np.zeros((len(t), 3))
    x[:, 1] = np.radians(np.where(t < 30.0, before, after))
    log = imu_log(t, x, np.tile([0.0, 0.0, -9.81], (len(t), 1)))
    rests = Segments([Segment("rest.long", 0.0, 20.0), Segment("rest.long", 40.0, 60.0)])
    assert gyro.bias(log.imus[0], rests).verdict == verdict
