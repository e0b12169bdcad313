"""What PX4 logs of its aids: which readings count."""

from __future__ import annotations

import numpy as np

from attlog.flight.builder import LogBuilder
from attlog.flight.px4.state import rangefinder
from tests.flight import fake


def test_of_a_rangefinder_only_readings_with_a_signal_and_in_range_count() -> None:
    """signal_quality: 0 is no signal, -1 unknown; a distance at the end of the range is no reading."""
    columns = {
        "timestamp": fake.micros(6, 10.0),
        "current_distance": np.array([1.0, 2.0, 3.0, 0.1, 40.0, 6.0], np.float32),
        "min_distance": np.full(6, 0.2, np.float32),
        "max_distance": np.full(6, 40.0, np.float32),
        "signal_quality": np.array([80, 0, -1, 90, 90, 1], np.int8),
        "orientation": np.full(6, 25, np.uint8),
    }
    found = rangefinder(LogBuilder(fake.messages("ulog", {("distance_sensor", 0): columns}), t0_us=10_000_000))
    assert found is not None
    assert found.x[:, 0].tolist() == [1.0, 3.0, 6.0]
