"""What the EKF rejected in flight: spans, size and sources, by records whose ratios are given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import segments, story
from attlog.flight.model import FlightLog, InnovationTest
from attlog.health.onboard import aids
from attlog.story import rejections
from tests.segments.test_in_air import carried


def flown(*ratios: tuple[float, float, float], aid: str = "compass") -> FlightLog:
    """A made flight from 5 to 35 s; ``ratios``: from, to (s), and the test ratio there, else 0.2, at 10 Hz."""
    log = carried(0.05)
    t = np.arange(0.0, 40.0, 0.1)
    ratio = np.full(len(t), 0.2)
    for a, b, size in ratios:
        ratio[(t >= a - 1e-9) & (t <= b + 1e-9)] = size
    log.innovation_tests = [InnovationTest(aid, t, ratio, "XKF4:0.SM")]
    return log


def test_rejections_in_flight_are_told_with_seconds_longest_and_size() -> None:
    log = flown((12.0, 15.0, 1.7), (20.0, 32.0, 2.6), (33.0, 33.4, 9.0))
    (one,) = rejections.tested(log, segments.build(log))
    assert one.spans == [pytest.approx((12.0, 15.0)), pytest.approx((20.0, 32.0))]
    assert (one.seconds, one.longest, one.worst) == (pytest.approx(15.0), pytest.approx(12.0), 2.6)
    assert "for 15 s of 28 in 2 parts of 1 s and more (12 s on end), 12.0 to 32.0 s" in one.text


def test_event_and_check_tell_the_same() -> None:
    log = flown((12.0, 15.0, 1.7))
    phases = segments.build(log)
    (event,) = (e for e in story.events(log, phases) if e.kind == "aid_rejected")
    (check,) = aids.checks(log, phases)
    assert event.text == check.text
    assert (event.t, event.t_end) == (check.t, check.t_end) == (pytest.approx(12.0), pytest.approx(15.0))
    assert (check.name, check.verdict) == ("rejected compass", "warning")
    assert "1.7 times its limit (XKF4:0.SM)" in check.text


def test_ten_seconds_on_end_are_a_fault() -> None:
    log = flown((12.0, 22.5, 1.2), aid="velocity")
    (check,) = aids.checks(log, segments.build(log))
    assert (check.name, check.verdict) == ("rejected velocity", "fault")


def test_the_ground_and_a_moment_are_no_rejection() -> None:
    log = flown((0.0, 4.0, 5.0), (20.0, 20.5, 5.0), (37.0, 40.0, 8.0))
    (check,) = aids.checks(log, segments.build(log))
    assert (check.verdict, check.value) == ("ok", 0.0)


def test_a_ratio_that_was_not_logged_is_no_ok() -> None:
    log = flown()
    log.innovation_tests[0].ratio[:] = np.nan
    assert aids.checks(log, segments.build(log)) == []


def test_ratios_of_real_logs_are_roots_of_one_scale_in_every_era(corpus: Path) -> None:
    """By hand from the records: EKF4 of 3.3 (int16 in hundredths), NKF4 of 4.0, XKF4 of 4.5."""
    for name, source, worst in (
        ("copter_3.3dev_181.BIN", "EKF4.SV", 19.0),
        ("copter_two_compasses.bin", "NKF4:0.SM", 1.66),
        ("copter_heading_28deg_off.BIN", "XKF4:0.SM", 1.34),
    ):
        log = attlog.read(corpus / "logs" / "cases" / name)
        ratio = {test.source: test.ratio for test in log.innovation_tests}[source]
        assert np.nanmax(ratio) == pytest.approx(worst, rel=0.01)


def test_the_first_and_the_last_second_of_a_flight_count_for_no_rejection() -> None:
    (begin, end) = segments.build(flown()).spans("airborne")[0]
    edges = flown((begin, begin + 1.6, 5.0), (end - 1.6, end, 5.0))
    (one,) = rejections.tested(edges, segments.build(edges))
    assert (one.spans, one.seconds_flown) == ([], pytest.approx(end - begin - 2.0))


@pytest.mark.parametrize(("ratio", "rejected"), [(1.0, 0), (1.01, 1)])
def test_a_ratio_of_one_is_within_the_gate(ratio: float, rejected: int) -> None:
    (one,) = rejections.tested(*made_phases((12.0, 15.0, ratio)))
    assert len(one.spans) == rejected


@pytest.mark.parametrize(("seconds", "rejected"), [(0.9, 0), (1.1, 1)])
def test_a_rejection_lasts_a_second(seconds: float, rejected: int) -> None:
    (one,) = rejections.tested(*made_phases((12.0, 12.0 + seconds, 3.0)))
    assert len(one.spans) == rejected
    assert one.worst == (3.0 if rejected else 0.0)


def made_phases(*ratios: tuple[float, float, float]) -> tuple[FlightLog, segments.Segments]:
    log = flown(*ratios)
    return log, segments.build(log)
