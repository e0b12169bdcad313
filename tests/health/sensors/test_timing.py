"""Which gaps of the inertial data are the logger's own pauses."""

from __future__ import annotations

from copy import deepcopy
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Problem, TimeLine
from attlog.health.sensors.timing import checks, pauses
from attlog.segments import Segments
from tests.health.test_health import good


@pytest.mark.parametrize(("armed_s", "is_pause"), [(0.0, True), (1.3, True), (1.6, False), (4.0, False)])
def test_a_gap_of_seconds_is_a_pause_unless_more_than_a_second_and_a_tenth_of_it_was_armed(
    armed_s: float, is_pause: bool
) -> None:
    line = TimeLine(np.array([0.0, 5.0, 10.0 + armed_s]), [False, True, False], "arming")
    log: Any = SimpleNamespace(armed=line)
    assert pauses(10.0, 14.0, log, Segments()) is is_pause
    assert not pauses(10.0, 11.9, log, Segments()), "shorter gaps are lost records"


def test_a_logger_that_keeps_every_tenth_sample_is_not_called_uneven_too() -> None:
    log = deepcopy(good("px4_steps.ulg"))
    assert "jitter" in [c.name for c in checks(log, Segments())]
    thinned = f"{log.imus[0].gyro.source}: the logger kept one sample per 100 ms."
    log.problems.append(Problem("imu_decimated", "note", thinned))
    assert "jitter" not in [c.name for c in checks(log, Segments())]
