"""A failsafe that ended a flight is told in the headline, whatever else went wrong first."""

from __future__ import annotations

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


def test_it_stays_where_the_words_run_out_and_what_came_first_goes() -> None:
    lies = CrashEvent("impact", 80.0, 81.0, 12.0, "g", "seen", lies_deg=44.0, rate=400.0)
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
    found = story.estimator_events.failsafe_phrases(
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


# What a crash hit and how it lay, in words, on endings made by hand.


def crash_of(kind: Any, t: float, size: float, lies: float | None = None) -> CrashEvent:
    unit = {"impact": "g", "overturn": "deg", "tumble": "deg/s"}[kind]
    return CrashEvent(kind, t, t + 0.1, size, unit, "seen", lies, 400.0)


@pytest.mark.parametrize(
    ("group", "what", "full", "short"),
    [
        (
            [crash_of("impact", 10.0, 7.0, 40.0)],
            "the ground",
            "Hit the ground at 10.0 s (7.0 g), lay at 40°",
            "Hit the ground at 10.0 s (7.0 g)",
        ),
        (
            [crash_of("overturn", 9.0, 120.0), crash_of("impact", 10.0, 7.0, 40.0)],
            "the ground",
            "Rolled to 120° at 9.0 s and hit the ground at 10.0 s (7.0 g)",
            "Hit the ground at 10.0 s (7.0 g)",
        ),
        (
            [crash_of("impact", 10.0, 7.0), crash_of("overturn", 10.4, 120.0)],
            "something",
            "Hit something at 10.0 s (7.0 g) and turned over to 120°",
            "Hit something at 10.0 s (7.0 g)",
        ),
        (
            [crash_of("overturn", 9.0, 80.0), crash_of("overturn", 12.0, 178.0, 170.0)],
            "the ground",
            "Fell over at 9.0 s (80°) and turned over at 12.0 s (178°), lay upside down",
            "Fell over at 9.0 s (80°)",
        ),
        (
            [crash_of("overturn", 9.0, 80.0)],
            "",
            "Flipped over at take-off at 9.0 s (80°)",
            "Flipped over at take-off at 9.0 s (80°)",
        ),
        ([crash_of("tumble", 9.0, 700.0)], "the ground", "Tumbled at 9.0 s (700°/s)", "Tumbled at 9.0 s (700°/s)"),
        ([crash_of("impact", 10.0, 7.0)], "", "Hit something at 10.0 s (7.0 g)", "Hit something at 10.0 s (7.0 g)"),
    ],
)
def test_a_crash_is_told_by_its_blow_its_overturn_or_its_tumble(
    group: list[CrashEvent], what: str, full: str, short: str
) -> None:
    assert _crash_phrases(group, what) == (full, short)


@pytest.mark.parametrize(("height", "hit"), [(5.1, "something"), (4.9, "the ground"), (np.nan, "the ground")])
def test_above_five_metres_it_is_not_the_ground_that_was_hit(height: float, hit: str) -> None:
    level = SimpleNamespace(above=np.array([0.0, 50.0, height]))
    low = SimpleNamespace(above=np.array([0.0, 50.0, 1.0]))
    air: Any = SimpleNamespace(levels=[low, level], grid=SimpleNamespace(index=lambda t: 2))
    flown = Segments([Segment("airborne", 1.0, 20.0)], air=air)
    assert _crash_target(VehicleKind.MULTIROTOR, flown, 15.0) == hit
    assert _crash_target(VehicleKind.PLANE, flown, 15.0) == "the ground"
    assert _crash_target(VehicleKind.MULTIROTOR, Segments(air=air), 15.0) == ""
    assert _crash_target(VehicleKind.MULTIROTOR, Segments([Segment("airborne", 1.0, 20.0)]), 15.0) == "the ground"


# Words and limits of what is told of a flight, on events made by hand.


def ending(kind: Any, t: float, size: float = 5.0, unit: str = "g", **more: Any) -> CrashEvent:
    return CrashEvent(kind, t, more.pop("t_end", t + 0.1), size, unit, "seen", **more)


@pytest.mark.parametrize(
    ("x", "said"), [(0.0, "0"), (0.123, "0.12"), (4.56, "4.6"), (12.6, "13"), (250.4, "250"), (-3.14, "-3.1")]
)
def test_sizes_have_two_figures_without_an_exponent(x: float, said: str) -> None:
    assert format_significant(x) == said


def test_arming_is_told_at_each_change_and_before_the_log_where_it_holds_at_its_start() -> None:
    line = TimeLine(np.array([0.0, 5.0, 7.0, 9.0]), [True, True, False, True], "status")
    found = flight_events._arming(log(armed=line))
    assert [(e.kind, e.t, e.text) for e in found] == [
        ("armed", 0.0, "Armed before the log begins."),
        ("disarmed", 7.0, "Disarmed at 7.0 s."),
        ("armed", 9.0, "Armed at 9.0 s."),
    ]
    line = TimeLine(np.array([0.5, 2.0]), [False, True], "status")
    assert [e.text for e in flight_events._arming(log(armed=line))] == ["Armed at 2.0 s."]
    assert flight_events._arming(log()) == []


def test_power_up_is_told_by_a_clock_since_boot_alone() -> None:
    (found,) = flight_events._power_up(log(t0_us=73_400_000))
    assert (found.t, found.text) == (pytest.approx(-73.4), "Switched on 73 s before the log’s first sample.")
    assert flight_events._power_up(log(t0_us=3_600_000_000)) == []
    assert flight_events._power_up(log(t0_us=-1)) == []


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (ending("impact", 1.0, 7.84, rate=100.0), "7.8 g"),
        (ending("impact", 1.0, 7.84, rate=99.0), "at least 7.8 g"),
        (ending("overturn", 1.0, 91.4, "deg"), "91°"),
        (ending("tumble", 1.0, 700.0, "deg/s"), "700°/s"),
    ],
)
def test_an_ending_has_its_size_in_its_unit(one: CrashEvent, said: str) -> None:
    assert flight_events.format_size(one) == said


def test_up_to_ninety_degrees_it_fell_and_beyond_it_turned_over() -> None:
    assert [flight_events.overturn_word(ending("overturn", 1.0, deg, "deg")) for deg in (90.0, 90.1)] == [
        "Fell over",
        "Turned over",
    ]


def test_an_ending_is_serious_with_how_it_lay_and_a_hard_landing_a_warning() -> None:
    crash = flight_events._crash_event(ending("impact", 12.34, 7.0, lies_deg=44.6, rate=400.0, t_end=13.0), ["e"])
    assert (crash.severity, crash.t_end, crash.is_crash) == ("serious", 13.0, True)
    assert crash.text == "Hit the ground or an obstacle at 12.3 s: 7.0 g. It then lay at 45°."
    hard = flight_events._crash_event(ending("hard_landing", 12.34, 4.0, lies_deg=2.0, rate=400.0, t_end=12.8), [])
    assert (hard.severity, hard.t_end, hard.is_crash) == ("warning", None, False)
    assert hard.text == "Hard landing at 12.3 s: 4.0 g, and it stayed upright."


def test_a_flight_that_lasts_to_the_end_of_the_log_has_no_landing_and_one_from_its_begin_no_lift_off() -> None:
    def kinds(a: float, b: float, *endings: CrashEvent) -> list[str]:
        spans = Segments([Segment("continuous", 0.0, 100.0), Segment("airborne", a, b)], endings=list(endings))
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


def test_what_went_wrong_first_is_a_warning_before_the_crash() -> None:
    events = [
        Event("battery", 3.0, "info", "Battery low."),
        Event("compass_switch", 20.0, "warning", "Compass changed."),
        Event("impact", 15.0, "serious", "Hit."),
    ]
    assert _first_fault(Segments(), events) == [""]
    events[0] = Event("gnss_lost", 3.04, "warning", "GNSS lost.")
    assert _first_fault(Segments(), events) == ["GNSS lost from 3.0 s.", ""]
    shaken = [
        Event("vibration", 2.0, "warning", "Vibration.", value=43.0),
        Event("clipping", 5.6, "warning", "Clipped."),
    ]
    assert _first_fault(Segments(), shaken)[0] == "Accelerometer clipped from 6 s (vibration 43 m/s²)."


@pytest.mark.parametrize(
    ("t", "t_end", "when"),
    [(29.0, 71.0, "throughout"), (31.0, 71.0, "from 31 to 71 s"), (29.0, 69.0, "from 29 to 69 s")],
)
def test_an_angle_is_wrong_throughout_from_ten_seconds_after_lift_off_to_ten_before_landing(
    t: float, t_end: float, when: str
) -> None:
    spans = Segments([Segment("airborne", 20.0, 50.0), Segment("airborne", 60.0, 80.0)])
    wrong = WrongAngle("heading", 27.6, t, t_end)
    assert _with_angle(["", "First."], wrong, spans) == [
        f"Heading was 28° wrong {when}; First.",
        f"Heading was 28° wrong {when}.",
    ]


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


def test_motors_that_ran_for_more_than_ten_seconds_before_a_flight_stood() -> None:
    for begin, stood in ((9.0, True), (11.0, False)):
        assert headlines._stood_armed(Segments([Segment("armed", begin, 60.0)]), 20.0) is stood
    assert not headlines._stood_armed(Segments([Segment("armed", 0.0, 15.0)]), 20.0)


def test_what_happened_after_the_last_sample_lies_within_the_time_that_is_told() -> None:
    """A log's IMU ended at 16 s, and its headline told a failsafe at 21 s beside "in 16 s"."""
    made = log(armed=TimeLine(np.array([0.0]), [False], "ARM"), seconds=16.0)
    late = Event("failsafe", 21.0, "warning", "Radio failsafe at 21.0 s.")
    assert headlines.flight_phrases(made, Segments(), [])[0] == "never armed in 16 s."
    assert headlines.flight_phrases(made, Segments(), [late])[0] == "never armed in 21 s."
    said = Event("message", 64.0, "note", "“Ready”.")
    assert headlines.flight_phrases(made, Segments(), [said])[0] == "never armed in 16 s."
