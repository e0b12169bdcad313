"""Movements as figures draw them: the one of middle size, and what all have in common."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.figures.steps import GRID_S, in_percent, representative, together
from attlog.metrics.steps.curves import Curve
from attlog.metrics.steps.events import StepEvent
from tests.metrics import flights


def event(axis: int, onset: float, delta: float) -> StepEvent:
    """A movement that takes 0.3 s."""
    return StepEvent(axis, onset, onset + 0.15, onset + 0.3, delta, onset - 0.5, onset + 1.5)


def curve(stroke: float, error_share: float) -> Curve:
    """A movement of which a row misses a share from the onset on."""
    t = np.arange(-0.4, 1.4, 0.01)
    moved = abs(stroke) * np.clip(t / 0.3, 0.0, 1.0)
    return Curve(event(0, 10.0, stroke), 10.0 + t, moved, error_share * moved)


def test_the_representative_movement_is_the_median_of_the_axis_that_moved_most(monkeypatch):
    events = [event(0, 1, 10), event(0, 5, -30), event(0, 9, 20), event(1, 13, 90), event(1, 17, 91)]
    monkeypatch.setattr("attlog.metrics.steps.events.of_reference", lambda case: events)
    found = representative(flights.case([], []))
    assert found == events[2]


def test_without_movements_there_is_no_representative_one(monkeypatch):
    monkeypatch.setattr("attlog.metrics.steps.events.of_reference", lambda case: [])
    assert representative(flights.case([], [])) is None


def test_movements_are_compared_by_their_share_of_the_stroke_with_the_band_of_the_middle_eighty_percent():
    row = flights.row(np.arange(3.0), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
    shares = np.linspace(-0.3, 0.1, 11)
    trace = together(row, *in_percent([curve(20.0 + 3 * k, s) for k, s in enumerate(shares)]), "roll")
    late = np.flatnonzero((GRID_S > 0.4) & np.isfinite(trace.columns["median"]))
    assert len(late) > 50
    np.testing.assert_allclose(trace.columns["median"][late], -10.0, atol=1e-6)
    np.testing.assert_allclose(trace.columns["low"][late], -26.0, atol=1e-6)
    np.testing.assert_allclose(trace.columns["high"][late], 6.0, atol=1e-6)
    np.testing.assert_allclose(trace.columns["ref"][late], 100.0, atol=1e-6)
    assert trace.columns["median"][np.searchsorted(GRID_S, 0.0)] == pytest.approx(0.0, abs=0.5)
    assert trace.values["events"] == 11
