"""Planted faults on samples of which each is another."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.simulate.fault import PlantedFault
from attlog.simulate.sensors.damage import damaged

T = np.arange(5.0)
X = np.arange(10.0, 15.0)[:, None] * [1.0, 2.0, 3.0]


@pytest.mark.parametrize(("since", "at"), [(2.0, [11.0, 22.0, 33.0]), (0.0, [7.0, 8.0, 9.0])])
def test_a_sensor_is_stuck_at_what_it_told_last(since: float, at: list[float]) -> None:
    """Within the block of samples, or before it."""
    fault = PlantedFault(since, "mag", "stuck", seconds=2.0)
    stuck = damaged([fault], T, X, np.array([7.0, 8.0, 9.0]))
    now = (since <= T) & (since + 2.0 > T)
    assert stuck[now].tolist() == [at, at]
    assert np.array_equal(stuck[~now], X[~now])


def test_an_offset_a_scale_and_exchanged_signs_act_while_they_last() -> None:
    faults = [
        PlantedFault(1.0, "mag", "offset", seconds=1.0, value=(1.0, -2.0, 0.5)),
        PlantedFault(2.0, "mag", "scale", seconds=1.0, factor=0.5),
        PlantedFault(3.0, "mag", "flipped", seconds=1.0),
    ]
    found = damaged(faults, T, X, X[0])
    assert found.tolist() == [[10, 20, 30], [12, 20, 33.5], [6, 12, 18], [-13, -26, 39], [14, 28, 42]]
