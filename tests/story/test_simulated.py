"""The story of simulated flights against what happened: kinds and times of every scenario, in every format."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import segments, story
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.logs import write
from attlog.simulate.logs.records import START_US
from attlog.simulate.scenario.scenario import load, names
from attlog.story import Event

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
COUNTED_S = {("clipping", ".tlog"): 1.0}
"""A link sends the counter of clipped samples once a second."""
SUFFIXES = (".ulg", ".bin", ".tlog")


@cache
def flown(name: str) -> Flight:
    return fly(load(name), 1)


def told(path: Path) -> tuple[list[Event], float, str]:
    """The events of a log, what its clock shows at the simulation's start, and the headline."""
    log = attlog.read(path)
    phases = segments.build(log)
    events = story.events(log, phases)
    return events, 1e-6 * (START_US - log.t0_us), story.headline(log, phases, events)


def true_times(flight: Flight, kind: str) -> list[float]:
    return [t for t, what in flight.events if what.startswith(TRUE[kind])]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", names())
def test_what_happens_in_a_scenario_is_told_at_its_time_and_nothing_else(name: str, suffix: str, tmp_path: Path):
    write(tmp_path / f"x{suffix}", flown(name))
    events, start, headline = told(tmp_path / f"x{suffix}")
    physical = [e for e in events if e.kind in (*TRUE, "tumble", "ends_in_air")]
    assert [e.kind for e in physical] == list(HAPPENS.get(name, WHOLE)), headline
    for event in physical:
        truth = [t + start for t in true_times(flown(name), event.kind)]
        within = COUNTED_S.get((event.kind, suffix), WITHIN_S)
        assert event.t == pytest.approx(truth[0], abs=within), event.kind
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
