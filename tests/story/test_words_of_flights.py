"""Words and limits of what is told of a flight, on events made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude, TimeLine
from attlog.segments.crash import Ending
from attlog.segments.model import Segment, Segments
from attlog.story import flights, flown
from attlog.story.event import Event, figures, moment
from attlog.story.headline import WrongAngle, _crashes, _first, _with_angle
from tests.story.made import log


def ending(kind: Any, t: float, size: float = 5.0, unit: str = "g", **more: Any) -> Ending:
    return Ending(kind, t, more.pop("t_end", t + 0.1), size, unit, "seen", **more)


@pytest.mark.parametrize(
    ("x", "said"), [(0.0, "0"), (0.123, "0.12"), (4.56, "4.6"), (12.6, "13"), (250.4, "250"), (-3.14, "-3.1")]
)
def test_sizes_have_two_figures_without_an_exponent(x: float, said: str) -> None:
    assert figures(x) == said


def test_a_moment_a_little_before_zero_is_zero() -> None:
    assert [moment(t) for t in (-0.04, -0.06, 3.26)] == ["at 0.0 s", "at -0.1 s", "at 3.3 s"]


def test_arming_is_told_at_each_change_and_before_the_log_where_it_holds_at_its_start() -> None:
    line = TimeLine(np.array([0.0, 5.0, 7.0, 9.0]), [True, True, False, True], "status")
    found = flights._arming(log(armed=line))
    assert [(e.kind, e.t, e.text) for e in found] == [
        ("armed", 0.0, "Armed before the log begins."),
        ("disarmed", 7.0, "Disarmed at 7.0 s."),
        ("armed", 9.0, "Armed at 9.0 s."),
    ]
    line = TimeLine(np.array([0.5, 2.0]), [False, True], "status")
    assert [e.text for e in flights._arming(log(armed=line))] == ["Armed at 2.0 s."]
    assert flights._arming(log()) == []


def test_power_up_is_told_by_a_clock_since_boot_alone() -> None:
    (found,) = flights._power_up(log(t0_us=73_400_000))
    assert (found.t, found.text) == (pytest.approx(-73.4), "Switched on 73 s before the log’s first sample.")
    assert flights._power_up(log(t0_us=3_600_000_000)) == []
    assert flights._power_up(log(t0_us=-1)) == []


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (ending("impact", 1.0, 7.84, rate=100.0), "7.8 g"),
        (ending("impact", 1.0, 7.84, rate=99.0), "at least 7.8 g"),
        (ending("overturn", 1.0, 91.4, "deg"), "91°"),
        (ending("tumble", 1.0, 700.0, "deg/s"), "700°/s"),
    ],
)
def test_an_ending_has_its_size_in_its_unit(one: Ending, said: str) -> None:
    assert flights.sized(one) == said


def test_up_to_ninety_degrees_it_fell_and_beyond_it_turned_over() -> None:
    assert [flights.turned(ending("overturn", 1.0, deg, "deg")) for deg in (90.0, 90.1)] == ["Fell over", "Turned over"]


def test_an_ending_is_serious_with_how_it_lay_and_a_hard_landing_a_warning() -> None:
    crash = flights._ended(ending("impact", 12.34, 7.0, lies_deg=44.6, rate=400.0, t_end=13.0), ["e"])
    assert (crash.severity, crash.t_end, crash.is_crash) == ("serious", 13.0, True)
    assert crash.text == "Hit the ground or an obstacle at 12.3 s: 7.0 g. It then lay at 45°."
    hard = flights._ended(ending("hard_landing", 12.34, 4.0, lies_deg=2.0, rate=400.0, t_end=12.8), [])
    assert (hard.severity, hard.t_end, hard.is_crash) == ("warning", None, False)
    assert hard.text == "Hard landing at 12.3 s: 4.0 g, and it stayed upright."


def test_a_flight_that_lasts_to_the_end_of_the_log_has_no_landing_and_one_from_its_begin_no_lift_off() -> None:
    def kinds(a: float, b: float, *endings: Ending) -> list[str]:
        spans = Segments([Segment("continuous", 0.0, 100.0), Segment("airborne", a, b)], endings=list(endings))
        return [e.kind for e in flights.events(log(t0_us=-1), spans)[0]]

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
    assert _first(Segments(), events) == [""]
    events[0] = Event("gnss_lost", 3.04, "warning", "GNSS lost.")
    assert _first(Segments(), events) == ["GNSS lost from 3.0 s.", ""]
    shaken = [
        Event("vibration", 2.0, "warning", "Vibration.", value=43.0),
        Event("clipping", 5.6, "warning", "Clipped."),
    ]
    assert _first(Segments(), shaken)[0] == "Accelerometer clipped from 6 s (vibration 43 m/s²)."


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


def test_numbers_are_words_up_to_nine() -> None:
    assert [flown.number(n) for n in (0, 2, 9, 10)] == ["no", "two", "nine", "10"]
    assert [flown.how_often(n) for n in (2, 3)] == ["twice", "three times"]
    assert flown.seconds_of([(11.4, 102.6), (120.0, 130.0)]) == "11 to 103 s and 120 to 130 s"


def test_the_largest_tilt_is_that_within_the_spans() -> None:
    t = np.arange(0.0, 30.0, 0.1)
    tilt = np.radians(np.where(t < 10.0, 50.0, np.where(t < 20.0, -33.0, 5.0)))
    made = log(attitudes={"A": Attitude(t, rotation.from_euler(tilt, 0.0 * t, 0.0 * t), "A")}, onboard="A")
    assert flown.largest_tilt(made, [(11.0, 30.0)]) == pytest.approx(33.0)
    assert flown.largest_tilt(made, [(21.0, 30.0)]) == pytest.approx(5.0)
    assert flown.largest_tilt(made, [(40.0, 50.0)]) is None
    assert flown.largest_tilt(log(), [(0.0, 50.0)]) is None
    for end, said in ((17.0, "ended upright"), (7.0, "ended at 33° of tilt")):
        assert flown.ending_of_slow(made, end + 1.5) == f", {said}"


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
    found = flown._pushed(Segments(air=air))
    assert [(round(a, 1), round(b, 1)) for a, b in found] == [(5.0, 15.0), (32.0, 36.0)]
    air.power_source = "arming"
    assert flown._pushed(Segments(air=air)) == []


def test_motors_that_ran_for_more_than_ten_seconds_before_a_flight_stood() -> None:
    for begin, stood in ((9.0, True), (11.0, False)):
        assert flown._stood_armed(Segments([Segment("armed", begin, 60.0)]), 20.0) is stood
    assert not flown._stood_armed(Segments([Segment("armed", 0.0, 15.0)]), 20.0)


def test_what_happened_after_the_last_sample_lies_within_the_time_that_is_told() -> None:
    """A log's IMU ended at 16 s, and its headline told a failsafe at 21 s beside "in 16 s"."""
    made = log(armed=TimeLine(np.array([0.0]), [False], "ARM"), seconds=16.0)
    late = Event("failsafe", 21.0, "warning", "Radio failsafe at 21.0 s.")
    assert flown.flown(made, Segments(), [])[0] == "never armed in 16 s."
    assert flown.flown(made, Segments(), [late])[0] == "never armed in 21 s."
    said = Event("message", 64.0, "note", "“Ready”.")
    assert flown.flown(made, Segments(), [said])[0] == "never armed in 16 s."
