"""What rows show of steps: none of a row that has no sample, however it came to that."""

from __future__ import annotations

from attlog.metrics.steps import curves as step_curves
from attlog.metrics.steps import events as steps
from attlog.segments.model import Segment
from tests.metrics import flights
from tests.metrics.motions import motion


def test_a_row_without_a_sample_beside_the_reference_shows_no_movement():
    t, q = motion("steps", 30.0)
    row = flights.row(t + 100.0, q)
    case = flights.case([row], [Segment("continuous", 0, 30.0)], (t[::4], q[::4]))
    events = tuple(steps.of_reference(case))
    assert events
    assert list(step_curves.of_events(case, row, events)) == []
