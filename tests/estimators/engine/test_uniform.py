"""Samples on an even grid."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.estimators.engine.uniform import uniform


def test_a_constant_rate_stays_what_it_is_to_the_last_sample() -> None:
    """The grid of 10 ms ends half a step after the samples do."""
    t = np.array([0.0, 0.01, 0.02, 0.035, 0.045])
    gyr, acc = np.tile([0.3, -0.2, 0.1], (5, 1)), np.tile([0.0, 0.0, -9.81], (5, 1))
    found = uniform(t, gyr, acc, np.full((5, 3), np.nan))
    assert not found.regular
    assert found.t == pytest.approx(np.arange(6) * 0.01)
    assert found.gyr == pytest.approx(np.tile(gyr[0], (6, 1)))
    assert found.acc == pytest.approx(np.tile(acc[0], (6, 1)))


def test_a_field_sample_stands_at_the_grid_time_that_it_has_else_at_the_next() -> None:
    """Measured at 0 and 10 ms, which are on the grid, and at 35 ms, which is between two of its times."""
    t = np.array([0.0, 0.01, 0.02, 0.035, 0.045])
    mag = np.full((5, 3), np.nan)
    mag[[0, 1, 3]] = [[1.0, 0.0, 2.0], [3.0, 0.0, 4.0], [5.0, 0.0, 6.0]]
    found = uniform(t, np.zeros((5, 3)), np.tile([0.0, 0.0, -9.81], (5, 1)), mag)
    assert np.flatnonzero(found.mag.any(axis=1)).tolist() == [0, 1, 4]
    assert found.mag[[0, 1, 4]].tolist() == mag[[0, 1, 3]].tolist()
