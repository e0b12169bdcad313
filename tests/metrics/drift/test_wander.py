"""Wander of the heading about its mean drift."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics.drift import wander
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 120.0, 0.02)


def test_at_rest_the_rows_own_step_limits_it_and_in_flight_the_references_floor() -> None:
    """A sine of 0.5 deg in 20 s about a drift of 1 deg/min: RMS 0.354 deg."""
    yaw = np.radians(0.5 * np.sin(2.0 * np.pi * T / 20.0) + T / 60.0)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1))
    row = flights.row(T, rotation.turn_about_down(still, yaw), step_deg=0.02)
    spans = [Segment("continuous", 0, 120), Segment("rest.long", 0, 60), Segment("airborne", 60, 120)]
    case = flights.case([row], spans, (T, still))
    case.reference.floor_deg = 0.3
    for window, floor in (("rest", 0.01), ("airborne", 0.3)):
        answer = wander.compute(case, row, window)["wander_deg"]
        assert answer.value == pytest.approx(0.5 / np.sqrt(2.0), rel=0.05)
        assert answer.floor == floor
