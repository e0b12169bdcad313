"""Times of records that carry none: from their place in the file between GPS records."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink import DFReader

import attlog
from attlog import formats
from attlog.flight.ardupilot.clock import Clock, between


def test_places_between_gps_records_are_times_between_theirs_and_go_on_at_the_mean_pace():
    stamps = between(np.array([0, 100, 150, 300, 400]), np.array([100, 200, 300]), np.array([1000, 3000, 5000]))
    np.testing.assert_array_equal(stamps, [-1000 + 1000, 1000, 2000, 5000, 7000])


def test_a_gps_record_without_a_time_places_nothing():
    stamps = between(np.array([150]), np.array([100, 140, 200]), np.array([1000, -1, 2000]))
    np.testing.assert_array_equal(stamps, [1500])


def test_attitudes_of_arducopter_3_1_are_placed_as_pymavlink_places_them(corpus):
    """Only its GPS records carry a time; pymavlink counts messages between them."""
    path = corpus / "logs" / "log_copter_3.1_noimu.log"
    theirs = DFReader.DFReader_text(str(path))
    stamps, first = [], None
    while (m := theirs.recv_match(type=["ATT", "GPS"])) is not None:
        if m.get_type() == "GPS" and first is None:
            first = m._timestamp - 1e-3 * m.T
        elif m.get_type() == "ATT" and first is not None:
            stamps.append(m._timestamp - first)
    messages = formats.open(path)
    ours = 1e-6 * Clock(messages).of_samples(messages.first("ATT"))[-len(stamps) :]
    assert np.median(np.abs(ours - stamps)) < 0.2
    assert np.abs(ours - stamps).max() < 1.0


def test_the_crash_of_a_log_without_an_imu_is_told(corpus):
    """ATT turns to 113 deg at 105 s, and the crash check stops the motors 5 s later (ERR 12/1)."""
    result = attlog.analyze(corpus / "logs" / "log_copter_3.1_noimu.log")
    (crash,) = [e for e in result.events if e.severity == "serious"]
    assert (crash.kind, crash.t) == ("overturn", pytest.approx(104.9, abs=0.5))
    assert any("ERR 12/1" in x for x in crash.evidence)
    assert any(e.kind == "liftoff" and e.evidence == ["CTUN.BarAlt"] for e in result.events)


def test_an_attitude_that_turns_over_without_imu_or_report_is_no_crash(corpus):
    log = attlog.read(corpus / "logs" / "log_copter_3.1_noimu.log")
    log.problems = [p for p in log.problems if p.code != "crash"]
    assert not [e for e in attlog.analyze(log).events if e.severity == "serious"]
