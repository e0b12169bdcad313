"""How late the rates are, beside what their filter explains."""

from __future__ import annotations

import pytest

from attlog.health.sensors import delay
from tests.reference.flights import ardupilot, flight
from tests.reference.test_alignment import chosen


@pytest.mark.parametrize(("late_ms", "verdict"), [(11.3, "ok"), (19.0, "warning"), (35.0, "fault"), (3.0, "warning")])
def test_a_gyro_may_be_as_late_as_its_low_pass_makes_it(late_ms: float, verdict: str) -> None:
    """At 20 Hz that is 11.3 ms: 8 ms more or less are another clock's, 24 ms more a wrong one's."""
    log = ardupilot(flight(truth_hz=50.0, gyro_late=1e-3 * late_ms), INS_GYRO_FILTER=20.0)
    _, check = delay.checks(log, chosen(log))
    assert (check.name, check.verdict) == (delay.UNEXPLAINED, verdict)
    assert check.value == pytest.approx(late_ms, abs=0.5)
