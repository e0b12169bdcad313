"""A failsafe that ended a flight is told in the headline, whatever else went wrong first."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog import story
from attlog.core import rotation
from attlog.flight.model import Attitude, FlightLog, TimeLine
from attlog.flight.vehicle import VehicleKind
from attlog.segments.impacts import CrashEvent
from attlog.segments.model import Segment, Segments
from attlog.story import flight_events, headlines
from attlog.story.flight_events import Event, EventSeverity, format_significant
from attlog.story.headlines import WrongAngle, _crash_phrases, _crash_target, _crashes, _first_fault, _with_angle
from tests.golden import check_golden
from tests.story.made import log

LOST = Event("gnss_lost", 40.0, "warning", "GNSS had no fix for 9 s in flight, from 40.0 s.", 49.0)
GLITCH = Event("gnss_jump", 30.0, "warning", "GNSS jumped at 30.0 s, 12 times in all.")


def failsafe(t: float, weight: EventSeverity = "warning") -> Event:
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


def test_it_stays_where_the_words_run_out_and_flights_are_counted() -> None:
    lies = CrashEvent("impact", 80.0, 81.0, 12.0, "g", "seen", lies_deg=44.0, rate=400.0)
    long = flown((10.0, 50.0), (60.0, 80.0), crash_events=[lies])
    crash = Event("impact", 80.0, "serious", "Hit.")
    first = Event("lane_switch", 61.0, "warning", "The EKF switched lanes at 61.0 s.")
    made = log(mode=modes((0.0, "LOITER"), (70.0, "LAND")))
    text = said(made, long, first, failsafe(70.0), crash)
    assert text.endswith("EKF failsafe at 70.0 s. Hit the ground at 80.0 s (12 g), lay at 44°.")
    assert "two flights from 10 s. EKF switched lanes at 61.0 s." in text
    assert len(text.split()) <= 30
    short = flown((10.0, 80.0), crash_events=[lies])
    text = said(made, short, first, failsafe(70.0), crash)
    assert "EKF switched lanes at 61.0 s. EKF failsafe at 70.0 s. Hit" in text


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
    found = story.failsafe_events.failsafe_phrases(
        ["Else.", ""], log(mode=modes(*changes)), flown((10.0, landing)), [failsafe(42.0)]
    )
    assert found[0] == "Else. EKF failsafe at 42.0 s."
    assert ("" not in found) is ended


def test_what_was_first_itself_is_not_told_twice_and_the_kill_switch_stays_with_the_landing() -> None:
    made, spans = log(), flown((10.0, 80.0))
    assert said(made, spans, failsafe(42.0)).count("EKF failsafe") == 1
    kill = Event("failsafe", 79.0, "warning", "Kill switch at 79.0 s.", about="kill switch")
    assert "Kill switch" not in said(made, spans, GLITCH, kill)


def test_one_on_the_ground_is_told_of_what_never_flew_where_nothing_else_is() -> None:
    idle = failsafe(52.4, "note")
    assert said(log(), flown(armed=(80.0, 83.0)), idle).endswith("EKF failsafe at 52.4 s, disarmed.")
    assert "failsafe" not in said(log(), flown((82.0, 90.0), armed=(80.0, 95.0)), idle)
    assert "failsafe" not in said(log(), flown(armed=(80.0, 83.0)), failsafe(0.3, "note"))
    assert "failsafe" not in said(log(), flown(armed=(50.0, 83.0)), idle)


@pytest.mark.parametrize(("height", "hit"), [(5.1, "something"), (4.9, "the ground"), (np.nan, "the ground")])
def test_above_five_metres_it_is_not_the_ground_that_was_hit(height: float, hit: str) -> None:
    level = SimpleNamespace(above=np.array([0.0, 50.0, height]))
    low = SimpleNamespace(above=np.array([0.0, 50.0, 1.0]))
    air: Any = SimpleNamespace(levels=[low, level], grid=SimpleNamespace(index=lambda t: 2))
    span, blow = Segment("airborne", 1.0, 20.0), ending("impact", 15.0)
    flown = Segments([span], air=air)
    assert _crash_target(VehicleKind.MULTIROTOR, flown, blow) == hit
    assert _crash_target(VehicleKind.PLANE, flown, blow) == "the ground"
    assert _crash_target(VehicleKind.PLANE, flown, ending("impact", 15.0, fell_m=9.0)) == "something"
    assert _crash_target(VehicleKind.MULTIROTOR, Segments(air=air), blow) == ""
    assert _crash_target(VehicleKind.MULTIROTOR, Segments([span]), blow) == "the ground"


# Words and limits of what is told of a flight, on events made by hand.


def ending(kind: Any, t: float, size: float = 5.0, unit: str = "g", **more: Any) -> CrashEvent:
    return CrashEvent(kind, t, more.pop("t_end", t + 0.1), size, unit, "seen", **more)


def crashes() -> Iterator[tuple[list[CrashEvent], str]]:
    blow, rolled = ending("impact", 10.0, 7.0, lies_deg=40.0), ending("overturn", 9.0, 120.0, "deg", axis="roll")
    yield [blow], "the ground"
    yield [rolled, blow], "the ground"
    yield [ending("impact", 10.0, 7.0), ending("overturn", 10.4, 120.0, "deg")], "something"
    fell = ending("overturn", 9.0, 80.0, "deg")
    yield [fell, ending("overturn", 12.0, 178.0, "deg", lies_deg=170.0)], "the ground"
    yield [fell], ""
    yield [ending("tumble", 9.0, 700.0, "deg/s")], "the ground"
    yield [ending("impact", 10.0, 7.0)], ""


def phrases() -> Iterator[str]:
    """Yield what is said of crashes, endings, arming, the first fault and wrong angles, at both sides of limits."""
    yield "sizes: " + ", ".join(map(format_significant, (0.0, 0.123, 4.56, 12.6, 250.4, -3.14)))
    for group, what in crashes():
        yield f"crash: {' | '.join(_crash_phrases(group, what))}"
    slow = [ending("impact", 1.0, 7.84, rate=rate) for rate in (100.0, 99.0)]
    others = [ending("overturn", 1.0, deg, "deg") for deg in (90.0, 90.1)] + [ending("tumble", 1.0, 700.0, "deg/s")]
    for one in (*slow, *others):
        yield f"{one.kind}: {flight_events.format_size(one)}, {flight_events.overturn_word(one)}"
    for kind, lies, t_end in (("impact", 44.6, 13.0), ("hard_landing", 2.0, 12.8)):
        made = ending(kind, 12.34, 7.0, lies_deg=lies, rate=400.0, t_end=t_end)
        event = flight_events._crash_event(made, ["e"])
        yield f"{event.kind}: {event.severity}, to {event.t_end}, crash {event.is_crash}: {event.text}"
    for t, on in (([0.0, 5.0, 7.0, 9.0], [True, True, False, True]), ([0.5, 2.0], [False, True])):
        armed = log(armed=TimeLine(np.array(t), on, "status"))
        yield "arming: " + " ".join(f"{e.kind} {e.t}: {e.text}" for e in flight_events._arming(armed))
    for t0_us in (73_400_000, 3_600_000_000, -1):
        yield f"boot {t0_us}: " + " ".join(f"{e.t:.1f}: {e.text}" for e in flight_events._power_up(log(t0_us=t0_us)))
    hit = Event("impact", 15.0, "serious", "Hit.")
    later = Event("compass_switch", 20.0, "warning", "Compass changed.")
    for first in (Event("battery", 3.0, "info", "Battery low."), Event("gnss_lost", 3.04, "warning", "GNSS lost.")):
        yield f"first fault: {_first_fault(Segments(), [first, later, hit])}"
    shaken = Event("vibration", 2.0, "warning", "Vibration.", value=43.0)
    yield f"first fault: {_first_fault(Segments(), [shaken, Event('clipping', 5.6, 'warning', 'Clipped.')])}"
    spans = Segments([Segment("airborne", 20.0, 50.0), Segment("airborne", 60.0, 80.0)])
    for t, t_end in ((29.0, 71.0), (31.0, 71.0), (29.0, 69.0)):  # throughout: 10 s from lift-off and landing
        yield f"angle: {_with_angle(['', 'First.'], WrongAngle('heading', 27.6, t, t_end), spans)}"
        yield f"angle: {_with_angle(['First.'], WrongAngle('heading', 27.6, t, t_end, 'why'), spans)}"


def test_phrases_are_as_reviewed() -> None:
    check_golden(Path(__file__).parent / "golden" / "phrases.txt", phrases())


def test_a_flight_that_lasts_to_the_end_of_the_log_has_no_landing_and_one_from_its_begin_no_lift_off() -> None:
    def kinds(a: float, b: float, *endings: CrashEvent) -> list[str]:
        spans = Segments([Segment("continuous", 0.0, 100.0), Segment("airborne", a, b)], crash_events=list(endings))
        return [e.kind for e in flight_events.movement_events(log(t0_us=-1), spans)[0]]

    assert kinds(0.6, 98.9) == ["liftoff", "landing"]
    assert kinds(0.4, 98.9) == ["landing"]
    assert kinds(0.6, 99.1) == ["liftoff", "ends_in_air"]
    assert kinds(0.6, 60.0, ending("impact", 64.9)) == ["liftoff", "impact"]
    assert kinds(0.6, 60.0, ending("impact", 65.1)) == ["liftoff", "landing", "impact"]


def test_endings_within_five_seconds_are_one_crash() -> None:
    endings = [ending("tumble", 10.0, t_end=12.0), ending("hard_landing", 13.0), ending("impact", 16.9, t_end=17.0)]
    endings.append(ending("impact", 22.0))
    groups = _crashes(endings)
    assert [[e.t for e in group] for group in groups] == [[10.0, 16.9], [22.0]]


def test_the_largest_tilt_is_that_within_the_spans() -> None:
    t = np.arange(0.0, 30.0, 0.1)
    tilt = np.radians(np.where(t < 10.0, 50.0, np.where(t < 20.0, -33.0, 5.0)))
    made = log(attitudes={"A": Attitude(t, rotation.from_euler(tilt, 0.0 * t, 0.0 * t), "A")}, onboard="A")
    assert headlines.largest_tilt(made, [(11.0, 30.0)]) == pytest.approx(33.0)
    assert headlines.largest_tilt(made, [(21.0, 30.0)]) == pytest.approx(5.0)
    assert headlines.largest_tilt(made, [(40.0, 50.0)]) is None
    assert headlines.largest_tilt(log(), [(0.0, 50.0)]) is None
    for end, said in ((17.0, "ended upright"), (7.0, "ended at 33° of tilt")):
        assert headlines.ending_of_slow(made, end + 1.5) == f", {said}"


def test_pushes_of_the_throttle_within_five_seconds_are_one_and_last_a_second() -> None:
    t = 0.1 * np.arange(400)
    up = (
        ((t > 4.95) & (t < 8.05))
        | ((t > 11.95) & (t < 15.05))
        | ((t > 24.95) & (t < 25.85))
        | ((t > 31.95) & (t < 36.05))
    )
    power = np.where(up, 0.6, 0.25)
    air: Any = SimpleNamespace(grid=SimpleNamespace(t=t), driven=power > 0.2, power=power, power_source="CTUN")
    found = headlines._throttle_spans(Segments(air=air))
    assert [(round(a, 1), round(b, 1)) for a, b in found] == [(5.0, 15.0), (32.0, 36.0)]
    air.power_source = "arming"
    assert headlines._throttle_spans(Segments(air=air)) == []


@pytest.mark.parametrize(("t", "first"), [(36.0, "RTL_ALT changed"), (20.0, "GNSS lost")])
def test_a_parameter_changed_long_before_a_fault_is_not_the_first_fault(t: float, first: str) -> None:
    change = Event("parameter_changed", t, "warning", "Changed.", evidence=[f"RTL_ALT from 1 to 2 at {t:.1f} s"])
    assert headlines._first_fault(flown((10.0, 80.0)), [change, LOST])[0].startswith(first)


def test_motors_that_ran_for_more_than_ten_seconds_before_a_flight_stood() -> None:
    for begin, stood in ((9.0, True), (11.0, False)):
        assert headlines._stood_armed(log(), Segments([Segment("armed", begin, 60.0)]), 20.0) is stood
    assert not headlines._stood_armed(log(), Segments([Segment("armed", 0.0, 15.0)]), 20.0)


def test_what_happened_after_the_last_sample_lies_within_the_time_that_is_told() -> None:
    """A log's IMU ended at 16 s, and its headline told a failsafe at 21 s beside "in 16 s"."""
    made = log(armed=TimeLine(np.array([0.0]), [False], "ARM"), seconds=16.0)
    late = Event("failsafe", 21.0, "warning", "Radio failsafe at 21.0 s.")
    assert headlines.flight_phrases(made, Segments(), [])[0] == "never armed in 16 s."
    assert headlines.flight_phrases(made, Segments(), [late])[0] == "never armed in 21 s."
    said = Event("message", 64.0, "note", "“Ready”.")
    assert headlines.flight_phrases(made, Segments(), [said])[0] == "never armed in 16 s."


def test_a_submarine_without_speed_is_said_to_be_armed_and_what_makes_its_page_red_is_named() -> None:
    boat = log(seconds=90.0)
    boat.vehicle = "submarine"
    boat.gnss = []
    boat.state.armed = TimeLine(np.array([0.0, 20.0]), [False, True], "ARM")
    phases = Segments([Segment("continuous", 0.0, 90.0), Segment("armed", 20.0, 77.0)])
    assert headlines.headline(boat, phases, []).endswith(": armed 20 to 77 s of 90 s.")
    said = headlines.headline(boat, phases, [], sound=False, trouble="gyro bias")
    assert said.endswith("of 90 s. Serious: gyro bias.")
    crash = Event("impact", 50.0, "serious", "Hit the ground.")
    assert "Serious" not in headlines.headline(boat, phases, [crash], sound=False, trouble="gyro bias")
