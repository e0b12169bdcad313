"""Aids as a step gets them: in the axes that it knows."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.estimators.aids import VEL_D, VEL_N, Aids, Measurements
from attlog.estimators.engine.events import events


@pytest.mark.parametrize("declination_deg", [0.0, 12.0, -30.0, 90.0])
def test_a_velocity_is_turned_to_magnetic_north_that_lies_east_of_true_north(declination_deg: float) -> None:
    """What flies along a course has that course less the declination by a compass; vertical speed stays."""
    course = np.radians([0.0, 90.0, 200.0])
    velocity = np.column_stack([5.0 * np.cos(course), 5.0 * np.sin(course), [1.0, -2.0, 0.5]])
    estimator: Any = SimpleNamespace(uses={"gnss"})
    aids = Aids(velocity=Measurements(np.array([1.0, 2.0, 3.0]), velocity, np.full(3, 0.1)))
    found = events(estimator, aids, np.arange(0.0, 4.0, 0.5), np.radians(declination_deg))
    told = found.table[found.row[[2, 4, 6]], VEL_N : VEL_D + 1]
    by_compass = course - np.radians(declination_deg)
    assert told[:, 0] == pytest.approx(5.0 * np.cos(by_compass))
    assert told[:, 1] == pytest.approx(5.0 * np.sin(by_compass))
    assert told[:, 2].tolist() == [1.0, -2.0, 0.5]
