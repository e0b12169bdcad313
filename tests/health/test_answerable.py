"""What ``info`` says can be answered is what an analysis answers: one rule for both."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import health
from attlog.core import rotation
from attlog.flight.model import Attitude, FlightLog
from attlog.metrics import drift as drift_rest
from attlog.pipeline import prepare
from attlog.segments.model import Segment
from tests.metrics import flights
from tests.segments.test_rest import still_log


@pytest.mark.parametrize(("seconds", "answered"), [(22.9, False), (27.0, False), (29.0, True), (60.0, True)])
def test_a_rest_is_long_enough_for_drift_in_info_exactly_where_it_is_in_an_analysis(seconds, answered):
    """20 s to settle and 8 s to measure."""
    t = np.arange(0.0, seconds, 0.02)
    log = still_log(t)
    log.attitudes, log.onboard = {}, None
    said = {a.question: a for a in health.answerable(log, prepare(log))}["yaw_drift"]
    row = flights.row(t, rotation.from_euler(0.0, 0.0, np.radians(0.01) * t))
    phases = [Segment("continuous", 0.0, seconds), Segment("rest.long", 0.0, seconds)]
    found = drift_rest.REST_DRIFT.ask(flights.case([row], phases), row, "rest")["drift_rest_deg_per_min"]
    assert said.can is answered
    assert (found.value is not None) is answered


@pytest.mark.parametrize(
    ("attitude", "reference", "told"), [(False, "none", "log the attitude"), (True, "none", ""), (True, "onboard", "")]
)
def test_what_would_log_an_attitude_is_told_where_nothing_is_there_to_compare_with(
    monkeypatch, attitude, reference, told
):
    """With an attitude in the log the setting would help nobody."""
    monkeypatch.setattr(FlightLog, "advice", lambda log, what, rate=None: f"log the {what}")
    t = np.arange(0.0, 40.0, 0.02)
    log = still_log(t)
    level = Attitude(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), "ATT")
    log.attitudes, log.onboard = ({"ATT": level}, "ATT") if attitude else ({}, None)
    case = prepare(log, {"reference": reference})
    assert case.reference.kind == reference
    assert health.missing_setting("accuracy", (), case) == told
