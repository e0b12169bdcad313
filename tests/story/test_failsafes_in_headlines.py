"""A failsafe that ended a flight is told in the headline, whatever else went wrong first."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import story
from attlog.flight.model import FlightLog, TimeLine
from attlog.segments.crash import Ending
from attlog.segments.model import Segment, Segments
from attlog.story.event import Event, Weight
from tests.story.made import log

LOST = Event("gnss_lost", 40.0, "warning", "GNSS had no fix for 9 s in flight, from 40.0 s.", 49.0)
GLITCH = Event("gnss_jump", 30.0, "warning", "GNSS jumped at 30.0 s, 12 times in all.")


def failsafe(t: float, weight: Weight = "warning") -> Event:
    return Event("failsafe", t, weight, f"EKF failsafe at {t:.1f} s.")


def modes(*changes: tuple[float, str]) -> TimeLine:
    return TimeLine(np.array([t for t, _ in changes]), [name for _, name in changes], "MODE")


def flown(*flights: tuple[float, float], armed: tuple[float, float] = (5.0, 100.0), **more: object) -> Segments:
    air = [Segment("airborne", a, b) for a, b in flights]
    return Segments([Segment("continuous", 0.0, 120.0), Segment("armed", *armed), *air], **more)  # type: ignore[arg-type]


def said(made: FlightLog, segments: Segments, *events: Event) -> str:
    return story.headline(made, segments, events, sound=False)


def test_a_failsafe_after_which_nobody_chose_a_mode_is_told_after_what_came_first() -> None:
    made = log(mode=modes((0.0, "LOITER"), (42.5, "LAND")))
    text = said(made, flown((10.0, 80.0)), LOST, failsafe(42.0))
    assert text.endswith("GNSS lost from 40 s. EKF failsafe at 42.0 s.")


def test_it_stays_where_the_words_run_out_and_what_came_first_goes() -> None:
    lies = Ending("impact", 80.0, 81.0, 12.0, "g", "seen", lies_deg=44.0, rate=400.0)
    long = flown((10.0, 50.0), (60.0, 80.0), endings=[lies])
    crash = Event("impact", 80.0, "serious", "Hit.")
    first = Event("lane_switch", 61.0, "warning", "The estimator changed its core at 61.0 s.")
    made = log(mode=modes((0.0, "LOITER"), (70.0, "LAND")))
    text = said(made, long, first, failsafe(70.0), crash)
    assert text.endswith("EKF failsafe at 70.0 s. Hit the ground at 80.0 s (12 g), lay at 44°.")
    assert "core changed" not in text
    assert len(text.split()) <= 30
    short = flown((10.0, 80.0), endings=[lies])
    text = said(made, short, first, failsafe(70.0), crash)
    assert "Estimator core changed at 61.0 s. EKF failsafe at 70.0 s. Hit" in text


@pytest.mark.parametrize(
    ("changes", "landing", "ended"),
    [
        (((0.0, "LOITER"), (42.0, "RTL")), 90.0, True),
        (((0.0, "LOITER"), (42.0, "RTL"), (60.0, "STABILIZE")), 90.0, False),
        (((0.0, "LOITER"),), 90.0, False),
        (((0.0, "LOITER"),), 52.0, True),
        (((0.0, "LOITER"), (42.0, "RTL"), (89.0, "STABILIZE")), 90.0, True),
    ],
)
def test_a_failsafe_ended_a_flight_that_landed_at_once_or_in_the_mode_that_it_set(
    changes: tuple[tuple[float, str], ...], landing: float, ended: bool
) -> None:
    found = story.failsafes.in_headline(
        ["Else.", ""], log(mode=modes(*changes)), flown((10.0, landing)), [failsafe(42.0)]
    )
    assert found[0] == "Else. EKF failsafe at 42.0 s."
    assert ("" not in found) is ended


def test_what_was_first_itself_is_not_told_twice_and_the_kill_switch_stays_with_the_landing() -> None:
    made, spans = log(), flown((10.0, 80.0))
    assert said(made, spans, failsafe(42.0)).count("EKF failsafe") == 1
    kill = Event("failsafe", 79.0, "warning", "Kill switch at 79.0 s.")
    assert "Kill switch" not in said(made, spans, GLITCH, kill)


def test_one_on_the_ground_is_told_of_what_never_flew_where_nothing_else_is() -> None:
    idle = failsafe(52.4, "note")
    assert said(log(), flown(armed=(80.0, 83.0)), idle).endswith("EKF failsafe at 52.4 s, disarmed.")
    assert "failsafe" not in said(log(), flown((82.0, 90.0), armed=(80.0, 95.0)), idle)
    assert "failsafe" not in said(log(), flown(armed=(80.0, 83.0)), failsafe(0.3, "note"))
    assert "failsafe" not in said(log(), flown(armed=(50.0, 83.0)), idle)
