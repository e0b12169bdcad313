"""Clipping, vibration, switches and lost GNSS as events: limits from both sides on made records."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog import segments, story
from attlog.flight.model import Clipping, FlightLog, Gnss, Problem, Stream, TimeLine
from attlog.segments.airborne import InAir
from attlog.segments.heights import HeightLevel
from attlog.segments.model import Segment, Segments
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.logs import write
from attlog.simulate.logs.records import START_US
from attlog.simulate.scenario import load_scenario, scenario_names
from attlog.story import Event, estimator_events, flight_events
from tests.segments.test_airborne import carried
from tests.segments.test_flight_signs import made_grid
from tests.story.made import log

T = np.arange(0.0, 60.0, 0.1)
FLOWN = [(10.0, 50.0)]
SPANS = Segments([Segment("continuous", 0, 60), Segment("armed", 5, 55), Segment("airborne", 10, 50)])


def own(peak: Any, rest: float = 5.0) -> Stream:
    """The autopilot's measure of three axes, the second the worst."""
    return Stream(T, np.column_stack([0.0 * T + rest, peak + 0.0 * T, 0.0 * T + rest]), "m/s^2", "FRD", "VIBE")


def flying(monkeypatch: pytest.MonkeyPatch, strong: int, size: float) -> FlightLog:
    """A unit whose windows shake by ``size`` for so many seconds."""
    t = np.arange(10.0, 50.0)
    x = np.full((40, 3), 2.0)
    x[7 : 7 + strong, 2] = size
    monkeypatch.setattr(flight_events, "vibration_levels", lambda imu, flown: (t, x))
    return log(imus=[SimpleNamespace(acc=SimpleNamespace(source="IMU:0"))], imu=0)


@pytest.mark.parametrize(
    ("strong", "size", "told"), [(5, 15.1, True), (4, 40.0, False), (9, 14.9, False)], ids=lambda x: str(x)
)
def test_five_seconds_above_fifteen_are_strong_vibration(
    monkeypatch: pytest.MonkeyPatch, strong: int, size: float, told: bool
) -> None:
    found = flight_events._vibration_event(flying(monkeypatch, strong, size), FLOWN)
    assert (found is not None) is told
    if found is not None:
        assert (found.t, found.t_end, found.value) == (17.0, 17.0 + strong, round(size, 1))


@pytest.mark.parametrize(("size", "count", "told"), [(61.0, 3, True), (61.0, 2, False), (59.0, 200, False)])
def test_the_autopilots_own_measure_is_strong_above_sixty(
    monkeypatch: pytest.MonkeyPatch, size: float, count: int, told: bool
) -> None:
    monkeypatch.setattr(flight_events, "_is_calm", lambda own, flown: False)
    made = flying(monkeypatch, 0, 0.0)
    made.vibration.level = own(np.where((np.arange(600) >= 200) & (np.arange(600) < 200 + count), size, 5.0))
    found = flight_events._vibration_event(made, FLOWN)
    assert (found is not None) is told
    if found is not None:
        assert (found.t, found.value) == (pytest.approx(20.0), size)


def test_an_own_measure_that_is_as_it_should_be_speaks_against_strong_vibration() -> None:
    limits = flight_events.VIBRATION_LIMITS["rest"]
    assert flight_events._is_calm(own(0.99 * limits.warning), FLOWN)
    assert not flight_events._is_calm(own(1.01 * limits.warning), FLOWN)
    assert flight_events._is_calm(own(np.where((T < 10.0) | (T > 50.0), 200.0, 5.0)), FLOWN)
    assert not flight_events._is_calm(own(5.0), [(10.05, 10.95)])
    assert flight_events._is_calm(own(5.0), [(10.05, 11.05)])
    assert not flight_events._is_calm(None, FLOWN)


def clipped(count: int, at: float = 20.0, source: str = "IMU:0", whole: bool = True) -> Clipping:
    new = np.zeros(len(T), np.int64)
    new[np.argmin(np.abs(T - at))] = count
    return Clipping("accelerometer", 0, source, T, new, whole)


@pytest.mark.parametrize(("count", "severity"), [(3, None), (4, "note"), (10, "note"), (11, "warning")])
def test_up_to_three_clipped_samples_are_chance_and_up_to_ten_no_warning(count: int, severity: str | None) -> None:
    found, _ = flight_events._clipping_event(log(clippings=[clipped(count), clipped(1, 30.0, "IMU:1")]), FLOWN)
    assert (None if found is None else found.severity) == severity
    if found is not None:
        assert (found.t, found.value) == (pytest.approx(20.0), float(count))


def counted(at: float, hz: float = 1.0, source: str = "IMU:0") -> Clipping:
    """Return a slow counter with 50 clipped samples in the record at ``at`` s."""
    t = np.arange(0.0, 60.0, 1.0 / hz)
    return Clipping("accelerometer", 0, source, t, np.where(np.isclose(t, at), 50, 0), True)


@pytest.mark.parametrize(("flagged", "t"), [(19.5, 19.5), (18.5, 20.0), (25.0, 20.0)])
def test_clipping_begins_at_the_flag_within_the_first_counted_interval(flagged: float, t: float) -> None:
    flags = Clipping("accelerometer", None, "flags", T, np.isclose(T, flagged, atol=1e-6).astype(np.int64), False)
    made = log(clippings=[counted(20.0), flags, clipped(99, 5.0, "IMU:2")])
    found, _ = flight_events._clipping_event(made, FLOWN)
    assert found is not None
    assert (found.t, found.value) == (pytest.approx(t), 50.0)
    assert found.evidence == ["IMU:0: 50 samples", "flags: 1 sample"]


@pytest.mark.parametrize(("other", "t"), [(1, 20.0), (9, 15.0)])
def test_clipping_begins_with_the_first_unit_that_clips_more_than_by_chance(other: int, t: float) -> None:
    found, _ = flight_events._clipping_event(log(clippings=[clipped(other, 15.0, "IMU:1"), clipped(50)]), FLOWN)
    assert found is not None
    assert (found.t, found.t_end, found.value) == (pytest.approx(t), pytest.approx(20.0), 50.0)


def receiver(lost: tuple[float, float], hz: float = 5.0) -> Gnss:
    t = np.arange(0.0, 60.0, 1.0 / hz)
    zero = np.zeros(len(t))
    fix = np.where((t > lost[0]) & (t < lost[1]), 2, 3)
    return Gnss(0, t, "GPS:0", zero, zero, zero, np.zeros((len(t), 3)), zero, zero, zero, fix)


@pytest.mark.parametrize(
    ("lost", "hz", "told"),
    [
        ((20.1, 21.9), 5.0, None),
        ((20.1, 22.3), 5.0, 2.4),
        ((20.5, 25.5), 1.0, 6.0),
        ((20.5, 24.5), 1.0, None),
        ((52.0, 58.0), 5.0, None),
    ],
)
def test_gnss_is_lost_after_two_seconds_or_five_intervals_in_flight(
    lost: tuple[float, float], hz: float, told: float | None
) -> None:
    found = estimator_events._gnss_lost(log(gnss=[receiver(lost, hz)]), SPANS)
    assert [e.value for e in found] == ([] if told is None else [pytest.approx(told, abs=0.11)])
    if told is not None:
        assert found[0].t == pytest.approx(20.0, abs=0.11)
        whole = receiver((70.0, 80.0))
        assert estimator_events._gnss_lost(log(gnss=[receiver(lost, hz), whole]), SPANS) == []


def test_a_change_of_the_unit_in_use_is_told_while_armed() -> None:
    line = TimeLine(np.array([0.0, 3.0, 20.0, 21.0, 58.0]), [0, 1, 1, 2, 0], "flown")
    found = estimator_events._switch_events(log(imu_that_flew=line), SPANS, [])
    assert [(e.kind, e.t, e.text) for e in found] == [("sensor_switch", 21.0, "IMU 2 replaced IMU 1 at 21.0 s.")]


def test_resets_of_the_attitude_count_while_armed() -> None:
    spans = Segments([*SPANS.segments, Segment("reset", 3.9, 4.0, "x"), Segment("reset", 29.9, 30.0, "by 9 deg")])
    (found,) = estimator_events._reset_events(spans)
    assert found.text == "The onboard attitude was reset at 30.0 s: by 9 deg."


def test_what_is_no_measurement_clips_nothing() -> None:
    clipping = Clipping("accelerometer", 0, "vehicle_imu_status:0", T, np.ones(len(T), np.int64), True)
    assert [e.kind for e in flight_events.sensor_events(log(clippings=[clipping]), SPANS)[0]] == ["clipping"]
    refused = [Problem("imu_mostly_refused", "error", "Mostly refused.")]
    assert flight_events.sensor_events(log(clippings=[clipping], problems=refused), SPANS) == ([], [])


# The story of simulated flights against what happened: kinds and times of every scenario, in every format.

WHOLE = ("liftoff", "landing")
HAPPENS = {
    "static": (),
    "lift-drop": (),
    "rotation": (),
    "no-liftoff": (),
    "flip": ("overturn",),
    "hard-landing": ("liftoff", "hard_landing"),
    "crash": ("liftoff", "overturn", "impact"),
    "roll-in": ("liftoff", "overturn", "impact"),
    "carried-home": ("liftoff", "overturn", "impact"),
    "clipping": ("liftoff", "clipping", "landing"),
    "motor-stops": ("liftoff", "impact", "overturn"),
    "output-off": ("liftoff", "impact", "overturn"),
}
"""What happens in a scenario, in order; in all others a lift-off and a landing, WHOLE."""
TRUE = {
    "liftoff": "lift-off",
    "landing": "touch-down",
    "hard_landing": "impact",
    "impact": "impact",
    "overturn": "overturn",
    "clipping": "accelerometer 0 at the end of its range",
}
"""How the simulator calls it."""
WITHIN_S = 0.1
LEANING_S = 0.2
"""With a weak motor one leg leaves the ground after the others."""
COUNTED_S = {("clipping", ".tlog"): 1.0}
"""A link sends the counter of clipped samples once a second."""
SUFFIXES = (".ulg", ".bin", ".tlog")


@cache
def flown(name: str) -> Flight:
    return fly(load_scenario(name), 1)


def told(path: Path) -> tuple[list[Event], float, str]:
    """The events of a log, what its clock shows at the simulation's start, and the headline."""
    log = attlog.read(path)
    phases = segments.build(log)
    events = story.events(log, phases)
    return events, 1e-6 * (START_US - log.t0_us), story.headline(log, phases, events)


def true_times(flight: Flight, kind: str) -> list[float]:
    return [t for t, what in flight.events if what.startswith(TRUE[kind])]


# What it strikes the ground with is told by tests/story/test_known_parts.py; the other scrapes along the ground for
# 1.5 s at 3 g before the blow that counts.
OTHERS = {"no-thrust-left", "compass-turned"}


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", sorted(set(scenario_names()) - OTHERS))
def test_what_happens_in_a_scenario_is_told_at_its_time_and_nothing_else(name: str, suffix: str, tmp_path: Path):
    write(tmp_path / f"x{suffix}", flown(name))
    events, start, headline = told(tmp_path / f"x{suffix}")
    physical = [e for e in events if e.kind in (*TRUE, "tumble", "ends_in_air")]
    assert [e.kind for e in physical] == list(HAPPENS.get(name, WHOLE)), headline
    for event in physical:
        truth = [t + start for t in true_times(flown(name), event.kind)]
        within = COUNTED_S.get((event.kind, suffix), LEANING_S if name == "weak-motor" else WITHIN_S)
        # In the air it wobbles beyond 90 deg for less than an overturn lasts.
        nearest = min(truth, key=lambda t, told=event.t: abs(t - told))
        assert event.t == pytest.approx(nearest, abs=within), event.kind
        if event.kind == "clipping":
            assert event.t_end == pytest.approx(truth[-1], abs=within)
    assert any(e.is_crash for e in events) == bool({"impact", "overturn"} & set(HAPPENS.get(name, WHOLE)))


@pytest.mark.slow
def test_a_wreck_that_is_carried_home_is_told_from_then_on_and_does_not_fly(tmp_path: Path):
    """The movement shows in means over 3 s: up to a second early."""
    flight = flown("carried-home")
    (picked,) = (t for t, what in flight.events if what == "carried by hand")
    write(tmp_path / "x.ulg", flight)
    events, start, _ = told(tmp_path / "x.ulg")
    assert [e.t for e in events if e.kind == "wreck_moved"] == [pytest.approx(picked + start, abs=1.0)]
    walked = flight.truth.t > picked
    assert np.ptp(flight.truth.p[walked, 0]) == pytest.approx(18.0)
    assert np.ptp(flight.truth.p[walked, 2]) == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("flip", ["never flew. Flipped over at take-off", "lay upside down"]),
        ("hard-landing", ["Hard landing at 45.4 s", "upright; nothing else went wrong"]),
        ("roll-in", ["Rolled to", "and hit the ground at 39.0 s"]),
        ("no-liftoff", ["never left the ground in 60 s; throttle up 18 to 38 s"]),
        ("clipping", ["landed safely. Accelerometer clipped from 36 s"]),
        ("hover", ["flew 18 to 91 s, up to 3 m", "landed safely. Nothing went wrong."]),
    ],
)
def test_headlines_of_scenarios_say_what_happened(name: str, parts: list[str], tmp_path: Path):
    write(tmp_path / "x.ulg", flown(name))
    said = told(tmp_path / "x.ulg")[2]
    assert [part for part in parts if part not in said] == [], said


@pytest.mark.slow
def test_a_plane_that_rolls_in_is_told_by_the_rules_for_planes(tmp_path: Path):
    """The simulator has no wings: what rolls in is its quadrotor at 11 m/s, in a log that calls it a plane."""
    flight = flown("roll-in")
    write(tmp_path / "x.ulg", flight)
    log = attlog.read(tmp_path / "x.ulg")
    log.vehicle = "fixed wing"
    phases = segments.build(log)
    start = 1e-6 * (START_US - log.t0_us)
    found = {e.kind: e.t - start for e in story.events(log, phases) if e.kind in TRUE}
    assert {k: found[k] for k in ("overturn", "impact")} == pytest.approx(
        {k: true_times(flight, k)[0] for k in ("overturn", "impact")}, abs=WITHIN_S
    )
    assert found["liftoff"] == pytest.approx(true_times(flight, "liftoff")[0], abs=4.0)  # sure from 2 m of height on


# The story of flights in which a sensor tells nothing or nonsense: told, without an exception or a warning.

Fault = Callable[[Any], Any]


def whole() -> FlightLog:
    """A flight from 5 to 35 s of which everything is logged that the story looks at, with a blow at its end."""
    log = carried(0.05)
    log.imus[0].acc.x[3480:3483, 2] = -80.0
    t = np.arange(0.0, 40.0, 0.2)
    up = np.clip(np.minimum(t - 6.0, 34.5 - t), 0.0, 5.0)
    stream = lambda x, unit, source: Stream(t.copy(), np.asarray(x, float).reshape(len(t), -1), unit, "", source)  # noqa: E731
    log.baro = [stream(up, "m", "BARO")]
    log.rangefinder = stream(up + 0.1, "m", "RFND")
    log.setpoints.rates = stream(np.zeros((len(t), 3)), "rad/s", "RATE")
    log.power.motors = stream(np.tile((up > 0)[:, None] * 0.5, 4), "1", "RCOU")
    log.power.rpm = stream(np.tile((up > 0)[:, None] * 5000.0, 4), "rpm", "ESC")
    log.vibration.level = stream(np.full((len(t), 3), 5.0), "m/s^2", "VIBE")
    log.airspeed = stream(np.zeros(len(t)), "m/s", "ARSP")
    log.power.battery = stream(np.tile([12.0, 10.0], (len(t), 1)), "V, A", "BAT")
    n = len(t)
    flat = np.zeros(n)
    log.gnss = [
        Gnss(
            0,
            t.copy(),
            "GPS",
            flat + 47.0,
            flat + 8.0,
            up + 400.0,
            np.zeros((n, 3)),
            flat + 1,
            flat + 1,
            flat + 1,
            np.full(n, 3),
        )
    ]
    log.vibration.clippings = [Clipping("accelerometer", 0, "VIBE.Clip0", t.copy(), np.zeros(n, np.int64), True)]
    log.texts = [(20.0, 3, "Crash: Disarming"), (21.0, 3, "EKF3 lane switch 1"), (34.0, 6, "Land complete")]
    log.truth = log.attitudes["ATT"]
    return log


STREAMS = (
    "baro",
    "rangefinder",
    "setpoints.rates",
    "power.motors",
    "power.rpm",
    "vibration.level",
    "airspeed",
    "power.battery",
    "power.throttle",
    "gyro",
    "acc",
    "attitude",
    "gnss",
    "vibration.clippings",
)


def parts(log: FlightLog, name: str) -> Iterator[tuple[Any, tuple[str, ...]]]:
    """The objects of a quantity with the names of their arrays."""
    if name in ("gyro", "acc"):
        yield getattr(log.imus[0], name), ("x",)
    elif name == "attitude":
        yield log.attitudes["ATT"], ("q",)
    elif name == "gnss":
        yield log.gnss[0], ("alt", "vel_ned", "lat", "lon")
    elif name == "vibration.clippings":
        yield log.vibration.clippings[0], ()
    else:
        one = attrgetter(name)(log)
        yield (one[0] if isinstance(one, list) else one), ("x",)


def values(of: float) -> Fault:
    """A fault; an attitude that is none is left out when a log is read, so it stays as it is where that is asked."""

    def fault(log: FlightLog, name: str) -> None:
        for thing, arrays in parts(log, name):
            for array in arrays if name != "attitude" or np.isnan(of) else ():
                getattr(thing, array)[:] = of

    return fault


def _half(log: FlightLog, name: str) -> None:
    for thing, arrays in parts(log, name):
        for array in arrays:
            getattr(thing, array)[len(thing.t) // 2 :] = np.nan


def _kept(log: FlightLog, name: str, count: int) -> None:
    """Only the first samples of a quantity; an IMU has as many of both its sensors."""
    names = ("gyro", "acc") if name in ("gyro", "acc") else (name,)
    for each in names:
        for thing, arrays in parts(log, each):
            more = (
                ("new",)
                if name == "vibration.clippings"
                else ("h_acc", "v_acc", "s_acc", "fix")
                if name == "gnss"
                else ()
            )
            for array in (*arrays, *more, "t"):
                setattr(thing, array, getattr(thing, array)[:count].copy())


FAULTS: dict[str, Any] = {
    "nothing but NaN": values(np.nan),
    "zero": values(0.0),
    "infinite": values(np.inf),
    "huge": values(1e30),
    "NaN from the middle on": _half,
    "empty": lambda log, name: _kept(log, name, 0),
    "one sample": lambda log, name: _kept(log, name, 1),
    "two samples": lambda log, name: _kept(log, name, 2),
    "gone": lambda log, name: None if name in ("gyro", "acc") else _gone(log, name),
}


def _gone(log: FlightLog, name: str) -> None:
    if name == "attitude":
        log.attitudes, log.onboard, log.truth = {}, None, None
    else:
        group, _, last = name.rpartition(".")
        holder = attrgetter(group)(log) if group else log
        setattr(holder, last, [] if isinstance(getattr(holder, last), list) else None)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", STREAMS)
def test_a_flight_whose_sensor_fails_has_a_story(name: str, fault: str) -> None:
    """Warnings are errors here."""
    log = whole()
    FAULTS[fault](log, name)
    phases = segments.build(log)
    events = story.events(log, phases)
    said = story.headline(log, phases, events)
    assert 4 <= len(said.split()) <= 30
    assert "nan" not in said.lower().split()
    assert not any("part_failed" in p.code for p in log.problems)
    assert all(np.isfinite(e.t) and (e.t_end is None or np.isfinite(e.t_end)) for e in events)
    assert all(e.value is None or np.isfinite(e.value) for e in events)


def test_the_flight_with_everything_is_told_with_its_blow() -> None:
    log = whole()
    phases = segments.build(log)
    assert [e.kind for e in story.events(log, phases) if e.kind in ("liftoff", "hard_landing")] == [
        "liftoff",
        "hard_landing",
    ]


@pytest.mark.parametrize(
    ("height_m", "disarmed_s", "landed_s", "said_s", "gone", "open_end"),
    [
        (3.0, None, None, None, False, True),
        (3.0, 58.0, None, None, False, False),
        (3.0, 56.5, None, None, False, True),
        (3.0, None, 58.0, None, False, False),
        (3.0, None, None, 58.0, False, False),
        (0.3, None, None, None, True, False),
        (0.3, None, None, None, False, True),
        (40.0, 58.0, None, None, False, True),
        (40.0, 58.0, None, None, True, False),
        (40.0, None, 58.0, None, True, False),
        (40.0, None, None, 58.0, True, False),
        (40.0, None, None, None, True, True),
        (3.0, 75.0, None, None, False, True),
    ],
)
def test_a_log_ends_in_the_air_unless_its_last_three_seconds_show_a_landing(
    height_m: float, disarmed_s: float | None, landed_s: float | None, said_s: float | None, gone: bool, open_end: bool
) -> None:
    """Flown to the last sample, at 60 s; what is stamped 15 s behind it is of another part of the flight."""
    made = log(texts=[] if said_s is None else [(said_s, 6, "Landing detected")])
    if disarmed_s is not None:
        made.state.armed = TimeLine(np.array([0.0, disarmed_s]), [True, False], "vehicle_status")
    if landed_s is not None:
        made.state.landed = TimeLine(np.array([0.0, landed_s]), [False, True], "vehicle_land_detected")
    grid = made_grid(len(T))
    levels = [HeightLevel("barometer", "BARO", np.full(len(T), height_m))]
    driven = (T < 55.0) | (not gone)
    air = InAir(grid, [(10.0, 60.0)], driven, 0.5 * driven, levels, "CTUN.ThO", "made")
    flown = Segments([Segment("continuous", 0, 60), Segment("airborne", 10, 60)], air=air)
    events, _ = flight_events.movement_events(made, flown)
    assert ("ends_in_air" in [e.kind for e in events]) is open_end


@pytest.mark.parametrize("motion", [{}, {"size": 1.0}, {"speed": 12.0}])
def test_disarmed_high_up_a_falling_or_gliding_vehicle_has_not_landed(motion: dict[str, float]) -> None:
    """Motors off from 55 s, disarmed at 58 s, 40 m up: on a roof, in free fall, or gliding at 12 m/s."""
    made = log(armed=TimeLine(np.array([0.0, 58.0]), [True, False], "ARM"))
    grid = made_grid(len(T), **{name: np.full(len(T), value) for name, value in motion.items()})
    levels = [HeightLevel("barometer", "BARO", np.full(len(T), 40.0))]
    air = InAir(grid, [(10.0, 60.0)], T < 55.0, 0.5 * (T < 55.0), levels, "CTUN.ThO", "made")
    flown = Segments([Segment("continuous", 0, 60), Segment("airborne", 10, 60)], air=air)
    assert flight_events.is_still_flying(made, flown, 60.0) is bool(motion)
