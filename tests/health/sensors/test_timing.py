"""Which gaps of the inertial data are the logger's own pauses."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.model import TimeLine
from attlog.health.sensors.timing import pauses
from attlog.segments import Segments


@pytest.mark.parametrize(("armed_s", "is_pause"), [(0.0, True), (1.3, True), (1.6, False), (4.0, False)])
def test_a_gap_of_seconds_is_a_pause_unless_more_than_a_second_and_a_tenth_of_it_was_armed(
    armed_s: float, is_pause: bool
) -> None:
    line = TimeLine(np.array([0.0, 5.0, 10.0 + armed_s]), [False, True, False], "arming")
    log: Any = SimpleNamespace(armed=line)
    assert pauses(10.0, 14.0, log, Segments()) is is_pause
    assert not pauses(10.0, 11.9, log, Segments()), "shorter gaps are lost records"
