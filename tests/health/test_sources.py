"""Other onboard attitudes beside the one that flew: made ones that agree, differ, or never ran."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import Attitude, Firmware, FlightLog, TimeLine
from attlog.health import sources
from attlog.health.check import Check, HealthCase
from attlog.reference.model import Reference
from attlog.segments.model import Segment, Segments
from tests.health.made_flight import SECONDS, case, flight
from tests.health.made_flight import attitude as made_flight_attitude
from tests.reference.flights import grouped

# Two onboard attitudes beside each other: limits of tilt and heading, times, and who is told to be wrong.

T = np.arange(0.0, 100.0, 0.1)
FLOWN = Segments([Segment("continuous", 0.0, 100.0), Segment("airborne", 20.0, 90.0)])


def attitude(tilt_deg: Any = 0.0, heading_deg: Any = 0.0, name: str = "A") -> Attitude:
    """It swings, and is off by a tilt about its own roll axis and by a heading."""
    own = rotation.from_euler(0.1 * np.sin(T), 0.1 * np.cos(T), 0.5 * np.sin(0.1 * T))
    off = rotation.from_rotvec(np.column_stack([np.radians(tilt_deg) + 0.0 * T, 0.0 * T, 0.0 * T]))
    turned = rotation.turn_about_down(rotation.multiply(own, off), np.radians(heading_deg) + 0.0 * T)
    return Attitude(T, turned, name)


def difference(tilt_deg: Any = 0.0, heading_deg: Any = 0.0) -> sources.SourceDifference:
    found = sources.source_difference(attitude(), attitude(tilt_deg, heading_deg), FLOWN)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("tilt", "heading", "off"), [(9.8, 0.0, False), (10.2, 0.0, True), (0.0, 19.8, False), (0.0, -20.2, True)]
)
def test_ten_degrees_of_tilt_or_twenty_of_heading_are_too_far(tilt: float, heading: float, off: bool) -> None:
    found = difference(tilt, heading)
    assert (found.since is not None) is off
    assert found.tilt == pytest.approx(abs(tilt), abs=0.05)
    assert found.heading == pytest.approx(abs(heading), abs=1.2)


@pytest.mark.parametrize(("seconds", "told"), [(13.0, False), (15.0, True)])
def test_a_fifth_of_the_flight_is_long(seconds: float, told: bool) -> None:
    """The flight has 70 s."""
    found = difference(np.where((T >= 40.0) & (T < 40.0 + seconds), 15.0, 0.0))
    assert (found.since is not None) is told
    if told:
        assert (found.since, found.until) == (pytest.approx(40.0, abs=0.11), pytest.approx(54.9, abs=0.11))
        assert found.tilt == pytest.approx(15.0, abs=0.05)


def test_what_comes_and_goes_is_told_with_its_share() -> None:
    found = difference(np.where((T >= 30.0) & (T < 60.0) & (T % 10.0 < 5.0), 15.0, 0.0))
    assert (found.since, found.until) == (pytest.approx(30.0, abs=0.11), pytest.approx(54.9, abs=0.11))
    assert found.share == pytest.approx(15.0 / 25.0, abs=0.01)
    assert not found.lasts
    assert sources.difference_time_text(found, attitude()) == "In 60 % of the time from 30 s to 55 s"


def test_a_difference_lasts_from_when_on_it_is_there_nine_tenths_of_the_time() -> None:
    found = difference(np.where((T >= 50.0) & (T % 20.0 > 1.0), 15.0, 0.0))
    assert found.since == pytest.approx(50.0, abs=0.11)
    assert found.lasts
    assert found.share > 0.9
    assert sources.difference_time_text(found, attitude()) == "From 50 s to 90 s"
    ends = attitude()
    ends.t = ends.t[ends.t < 94.0]
    assert sources.difference_time_text(found, ends) == "From 50 s on"


def test_while_it_starts_and_after_a_crash_nothing_counts() -> None:
    ground = Segments([Segment("continuous", 0.0, 100.0)])
    early = sources.source_difference(attitude(), attitude(np.where(T < 14.9, 40.0, 0.0)), ground)
    assert early is not None
    assert (early.since, early.tilt) == (None, pytest.approx(0.0, abs=1e-6))
    late = sources.source_difference(attitude(), attitude(np.where(T < 60.0, 40.0, 0.0)), ground)
    assert late is not None
    assert late.since == pytest.approx(15.1, abs=0.11)


def test_a_heading_means_nothing_where_it_stands_steep() -> None:
    steep = rotation.from_euler(0.0 * T, np.full(len(T), np.radians(65.0)), 0.0 * T)
    flat = rotation.from_euler(0.0 * T, np.full(len(T), np.radians(55.0)), 0.0 * T)
    for q, told in ((steep, False), (flat, True)):
        turned = rotation.turn_about_down(q, np.full(len(T), np.radians(40.0)))
        found = sources.source_difference(Attitude(T, q, "A"), Attitude(T, turned, "B"), FLOWN)
        assert found is not None
        assert (found.since is not None) is told


def log_of(**others: Attitude) -> FlightLog:
    log = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "quadrotor")
    log.attitudes = {"FLEW": attitude(name="FLEW"), **others}
    log.onboard = "FLEW"
    return log


def truth(tilt_deg: float = 0.0, heading_deg: float = 0.0, kind: str = "truth", **more: Any) -> Reference:
    zeros = np.zeros(len(T), np.int64)
    q = attitude(tilt_deg, heading_deg).q
    return Reference(kind, kind, T, q, zeros, zeros, rate=10.0, **grouped(**more))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("tilt", "heading", "verdict", "value"),
    [
        (0.0, 0.0, "ok", 0.0),
        (15.0, 0.0, "warning", 15.0),
        (31.0, 0.0, "fault", 31.0),
        (29.0, 0.0, "warning", 29.0),
        (0.0, 59.0, "warning", 59.0),
        (0.0, 61.0, "fault", 61.0),
    ],
)
def test_the_verdict_is_that_of_the_larger_share_of_its_limit(
    tilt: float, heading: float, verdict: str, value: float
) -> None:
    (check,) = sources.source_checks(HealthCase(log_of(OTHER=attitude(tilt, heading)), FLOWN))
    assert (check.verdict, check.value) == (verdict, pytest.approx(value, abs=1.5))
    if verdict != "ok":
        assert check.about == ("tilt" if tilt else "heading")
        assert f"by {value:.0f} deg in {check.about}" in check.text or heading
        assert "cannot be determined" in check.text


def test_those_that_differ_alike_are_named_together_and_the_worst_leads() -> None:
    log = log_of(B=attitude(15.0), C=attitude(15.5), D=attitude(25.0), E=attitude(1.0))
    (check,) = sources.source_checks(HealthCase(log, FLOWN))
    assert "D differs from FLEW by 25 deg in tilt" in check.text
    del log.attitudes["D"]
    (check,) = sources.source_checks(HealthCase(log, FLOWN))
    assert "B and C differ from FLEW" in check.text


@pytest.mark.parametrize(
    ("of_truth", "wrong", "verdict"), [(0.0, "OTHER is wrong", "warning"), (35.0, "FLEW is wrong", "fault")]
)
def test_the_truth_says_who_is_wrong(of_truth: float, wrong: str, verdict: str) -> None:
    (check,) = sources.source_checks(HealthCase(log_of(OTHER=attitude(35.0)), FLOWN, truth(of_truth)))
    assert wrong in check.text
    assert check.verdict == verdict
    (undecided,) = sources.source_checks(HealthCase(log_of(OTHER=attitude(35.0)), FLOWN, truth(17.5)))
    assert "cannot be determined" in undecided.text


def test_only_a_heading_of_its_own_judges_headings() -> None:
    log = log_of(OTHER=attitude(0.0, 50.0))
    for more, told in (({"heading_by": "own"}, True), ({"heading_by": "onboard"}, False)):
        found = sources.errors_of_both(truth(kind="smoother", **more), log, "OTHER", "heading", 20.0)
        assert (found is not None) is told
        if found is not None:
            assert found == (pytest.approx(0.0, abs=1e-6), pytest.approx(50.0, abs=1.5))
    assert sources.errors_of_both(truth(kind="onboard"), log, "OTHER", "tilt", 20.0) is None
    tilt = sources.errors_of_both(
        truth(20.0), log_of(OTHER=attitude(np.where(T < 50.0, 90.0, 26.0))), "OTHER", "tilt", 50.0
    )
    assert tilt == (pytest.approx(20.0, abs=0.1), pytest.approx(6.0, abs=0.1))
    assert sources.errors_of_both(truth(), log, "OTHER", "tilt", 99.0) is None


# Lanes with planted errors: the better one is named where the one in use is clearly worse.


def lane(t: np.ndarray, tilt_deg: float) -> Attitude:
    lean = rotation.from_euler(np.full(len(t), np.radians(tilt_deg)), np.zeros(len(t)), np.zeros(len(t)))
    return Attitude(t, rotation.multiply(made_flight_attitude(t), lean), "XKQ")


def flew(*tilts_deg: float, used: int = 0, judged: bool = True) -> HealthCase:
    log = flight(firmware="ArduPilot")
    t = np.arange(0.0, SECONDS, 0.1)
    log.attitudes = {f"XKQ.{k}": lane(t, deg) for k, deg in enumerate(tilts_deg)}
    log.estimator.lane = TimeLine(np.array([0.0, 60.0]), [used, 1 - used], "XKF4.PI")
    asked = case(log)
    whole = np.zeros(len(t), np.int64)
    asked.reference = Reference("truth" if judged else "onboard", "SIM", t, made_flight_attitude(t), whole, whole)
    return asked


def told(asked: HealthCase) -> Check:
    (one,) = sources.lane_errors(asked)
    return one


def test_a_worse_lane_in_use_is_named_with_both_errors() -> None:
    one = told(flew(8.0, 1.0))
    assert one.verdict == "warning"
    assert one.value == pytest.approx(8.0, abs=0.1)
    assert "Lane 0 flew 8.0 deg off" in one.text
    assert "lane 1 is off by 1.0 deg" in one.text
    assert "changed once in flight, at 60.0 s" in one.evidence[-1]


@pytest.mark.parametrize("tilts", [(1.0, 8.0), (8.0, 7.0), (2.0, 0.1)])
def test_a_lane_in_use_that_is_better_or_no_worse_or_small_is_ok(tilts: tuple[float, float]) -> None:
    assert told(flew(*tilts)).verdict == "ok"


def test_the_lane_that_flew_longest_is_the_one_in_use() -> None:
    one = told(flew(1.0, 8.0, used=1))
    assert one.verdict == "warning"
    assert "Lane 1 flew 8.0 deg off" in one.text


def test_without_truth_or_smoother_nobody_judges_but_the_difference_is_told() -> None:
    one = told(flew(8.0, 1.0, judged=False))
    assert one.verdict == "unknown"
    assert "7.0 deg" in one.text
