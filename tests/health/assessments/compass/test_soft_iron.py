"""Soft iron in words: its size against planted ones."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.health.assessments.compass import soft_iron
from attlog.health.assessments.compass.study import studied
from attlog.health.assessments.model import Assessment
from tests.health.assessments.compass.made import samples


def planted(share: float, turns: float = 2.0, axis_deg: float = 0.0) -> Assessment:
    """The field stretched by ``share`` along an axis, compressed by as much across it."""
    made = samples((3.0, -2.0, 0.0), turns=turns)
    c, s = np.cos(2.0 * np.radians(axis_deg)), np.sin(2.0 * np.radians(axis_deg))
    made.measured[:, :2] += share * made.expected[:, :2] @ np.array([[c, s], [s, -c]])
    found = studied(made)
    assert found is not None
    return soft_iron.assessed(found)


@pytest.mark.parametrize(("share", "axis"), [(0.0, 0.0), (0.05, 0.0), (0.05, 30.0), (0.2, 70.0)])
def test_a_planted_ellipse_is_inside_the_interval(share: float, axis: float) -> None:
    found = planted(share, axis_deg=axis)
    assert found.ci95 is not None
    assert found.ci95[0] <= 100.0 * share <= found.ci95[1]
    assert found.verdict == ("warning" if share > 0.1 else "ok")
    assert not found.settings
    assert bool(found.why_no_setting) == (share > 0.1)


def test_a_flight_that_does_not_turn_shows_none() -> None:
    assert planted(0.2, turns=0.05).verdict == "unknown"
