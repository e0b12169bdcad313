"""Drift in the air against a heading that may drift itself."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.drift import air
from attlog.segments.model import Segment
from tests.metrics import flights

NAME = "drift_air_deg_per_min.smoother"


def test_a_smoother_that_may_be_off_by_half_a_degree_may_drift_by_as_much_over_the_record() -> None:
    """Two sigma of 0.5 deg over 60 s: 1 deg/min either way of a row that never leaves it."""
    t = np.arange(0.0, 60.0, 0.02)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    row = flights.row(t, q)
    case = flights.case([row], [Segment("continuous", 0, 60), Segment("airborne", 0, 60)], (t, q), kind="smoother")
    case.reference.sigma_tilt_deg, case.reference.sigma_heading_deg = np.full((2, len(t)), 0.5)
    answer = air.compute(case, row, "airborne")[NAME]
    assert answer.value == pytest.approx(0.0, abs=1e-6)
    assert answer.ci95 == pytest.approx((-1.0, 1.0), rel=0.05)
