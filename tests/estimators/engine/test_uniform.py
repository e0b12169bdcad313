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
