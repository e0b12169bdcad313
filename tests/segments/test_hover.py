"""Hover is hardly moving over the ground, where that is known."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.base import rotation
from attlog.flight.model import Gnss
from attlog.segments import spans

from .flights import END, LANDED, TAKE_OFF, flight


def seconds_of_hover(speed_m_s: float, fix: int = 3) -> float:
    """How long the made flight hovers with a receiver that tells this speed to the east."""
    t = np.arange(0.0, END, 0.2)
    nothing, velocity = np.full(len(t), np.nan), np.tile([0.0, speed_m_s, 0.0], (len(t), 1))
    told = Gnss(0, t, "GPS:0", nothing, nothing, nothing, velocity, nothing, nothing, nothing, np.full(len(t), fix))
    found = segments.build(flight(50.0, calm=True, gnss=[told]))
    return spans.seconds(spans.intersect(found.spans("hover"), [(TAKE_OFF, LANDED)]))


@pytest.mark.parametrize(("speed", "hovers"), [(0.0, True), (0.9, True), (1.1, False), (8.0, False)])
def test_a_metre_a_second_over_the_ground_is_no_hover(speed: float, hovers: bool) -> None:
    assert seconds_of_hover(speed) == pytest.approx(LANDED - TAKE_OFF if hovers else 0.0, abs=4.0)


@pytest.mark.parametrize(("tilt_deg", "hovers"), [(15.0, True), (25.0, False)])
def test_a_vehicle_that_leans_by_20_degrees_does_not_hover(tilt_deg: float, hovers: bool) -> None:
    """However slowly it turns: it accelerates, or leans into wind as in cruise."""
    log = flight(50.0, calm=True)
    attitude = log.attitudes["ATT"]
    leaning = (attitude.t > TAKE_OFF) & (attitude.t < LANDED)
    attitude.q[leaning] = rotation.multiply(attitude.q[leaning], rotation.from_euler(np.radians(tilt_deg), 0.0, 0.0))
    found = spans.intersect(segments.build(log).spans("hover"), [(TAKE_OFF, LANDED)])
    assert spans.seconds(found) == pytest.approx(LANDED - TAKE_OFF if hovers else 0.0, abs=4.0)


def test_a_speed_without_a_fix_tells_nothing() -> None:
    assert seconds_of_hover(8.0, fix=2) == pytest.approx(LANDED - TAKE_OFF, abs=4.0)
