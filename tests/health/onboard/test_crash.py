"""What is said of a crash follows what happened: the first thing first, and what is compared."""

from __future__ import annotations

from attlog.health.onboard import crash
from attlog.segments.model import Segment, Segments
from tests.segments.flights import flight

LOSS = Segment("loss_of_control", 41.7, 42.0, "tilt of 159 deg, and 0.3 s later it was disarmed")


def said(*found: Segment) -> str:
    (check,) = crash.checks(flight(), Segments(list(found)))
    return " ".join([check.text, *check.evidence])


def test_a_wreck_that_rolls_over_after_its_impact_lost_no_control_there() -> None:
    blow = Segment("impact", 40.3, 60.0, "16.4 g with a tumble, and 1.7 s later it was disarmed")
    assert said(LOSS, blow) == f"An impact at 40.3 s: {blow.why}. Nothing is compared after 40.3 s."


def test_an_impact_after_a_loss_is_the_end_of_what_is_compared() -> None:
    blow = Segment("impact", 42.0, 60.0, LOSS.why)
    assert said(LOSS, blow) == f"Control was lost at 41.7 s: {LOSS.why}. Nothing is compared after 42.0 s."


def test_a_loss_that_is_flown_on_ends_nothing() -> None:
    again = Segment("loss_of_control", 90.0, 91.0, "tilt of 99 deg, and at once it was disarmed")
    text = f"Control was lost 2 times, first at 41.7 s: {LOSS.why}. It flew again: what follows is compared too."
    assert said(LOSS, again) == text


def test_an_impact_of_a_later_flight_is_told_beside_the_loss() -> None:
    blow = Segment("impact", 90.0, 95.0, "5.0 g with a tumble, and 2.5 s later the log stopped")
    again = "It flew again until an impact at 90.0 s, after which nothing is compared."
    assert said(LOSS, blow) == f"Control was lost at 41.7 s: {LOSS.why}. {again}"


def test_a_flight_without_a_crash_is_good_only_where_samples_could_show_one() -> None:
    flown = Segments([Segment("airborne", 35.0, 75.0)])
    (fast,), (slow,) = crash.checks(flight(200.0), flown), crash.checks(flight(25.0), flown)
    assert (fast.verdict, slow.verdict) == ("ok", "unknown")
    assert "IMU at 25 Hz" in slow.text
