"""Windows that a row is measured in."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.evidence.phases import START_S
from attlog.metrics.noise import windows
from attlog.segments.model import Segment
from tests.metrics import flights


@pytest.mark.parametrize(("start", "first"), [(0.0, 10.0), (1.0, 15.0), (5.0, 15.0)])
def test_no_window_holds_the_seconds_in_which_a_row_settles(start: float, first: float) -> None:
    """10 s after its start; windows of 5 s are laid from the begin of the span on, the same for all rows."""
    assert START_S == 10.0
    t = np.arange(0.0, 30.0, 0.02)
    row = flights.row(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), start=start)
    case = flights.case([row], [Segment("continuous", 0, 30), Segment("rest.long", 0, 30)])
    found = windows.of_span(case, row, "rest", (0.0, 30.0))
    assert [w[0] for w, _ in found] == np.arange(first, 30.0, 5.0).tolist()
