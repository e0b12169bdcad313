"""The figure of the vibration: the worst second of flight alone, clipping as counted, rotors as they turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from attlog.flight.model import Clipping, Stream
from attlog.flight.vibration.model import OnboardVibration
from attlog.health.assessments import vibration
from attlog.health.figures.vibration import clipping, levels, notches, rotor
from tests.health.figures.made import AIR, T, case, log


def shaken(unit: int = 0, t: np.ndarray = T) -> OnboardVibration:
    """Level of one unit: 4 m/s^2 in flight, 50 for a second there, 90 on the ground."""
    level = np.where((T >= AIR[0]) & (T <= AIR[1]), 4.0, 90.0)
    level[(T >= 30.0) & (T < 31.0)] = 50.0
    return OnboardVibration(unit, "rest", f"VIBE:{unit}", t, level)


def test_percentiles_are_those_of_the_seconds_of_flight_of_every_unit():
    made = log()
    made.vibrations = [shaken(0), shaken(1)]
    first, second = levels(case(made))
    assert (first.key, second.key) == ("VIBE:0", "VIBE:1")
    assert first.values == {"p50": 4.0, "p80": 4.0, "worst": 50.0, "limit": 30.0, "fault": 60.0}
    assert AIR[0] < first.t[0] < first.t[-1] < AIR[1]
    assert levels(case(made, crash=25.0))[0].values["worst"] == 4.0


def test_a_measure_with_one_limit_has_no_second_one():
    made = log()
    made.vibrations = [replace(shaken(), measure="difference")]
    assert "fault" not in levels(case(made))[0].values


def test_two_flights_are_no_line():
    made = log()
    made.vibrations = [shaken(t=np.where(T > 50, T + 10.0, T))]
    assert np.isnan(levels(case(made))[0].columns["level"]).sum() == 1


def test_notches_that_are_set_and_proposed_have_their_edges(monkeypatch):
    drawn = [("a", 80.0, 40.0, False), ("b", 120.0, 10.0, True), ("c", 60.0, 20.0, False)]
    fields = ("name", "frequency", "width", "proposed")
    spectra = [{"sensor": "gyro", "notches": [dict(zip(fields, one, strict=True)) for one in drawn]}]
    monkeypatch.setattr(vibration, "spectrum", lambda asked: spectra)
    on, proposed = notches(case(log()))
    assert (on.key, on.t.tolist(), proposed.key, proposed.t.tolist()) == ("set", [60.0, 80.0], "proposed", [120.0])
    assert (on.columns["low"].tolist(), on.columns["high"].tolist()) == ([50.0, 60.0], [70.0, 100.0])


def test_of_the_counters_that_with_most_clipped_samples_in_flight_is_drawn():
    made = log()
    new = np.zeros(len(T), np.int64)
    few, many, ground = new.copy(), new.copy(), new.copy()
    few[500] = 5
    many[[501, 502, 700]] = 3, 4, 6
    ground[20] = 999
    units = [("few", few), ("many", many), ("ground", ground)]
    made.clippings = [Clipping("accelerometer", i, name, T, x, True) for i, (name, x) in enumerate(units)]
    made.clippings.append(Clipping("gyro", 0, "gyro", T, 99 * (many > 0), True))
    trace = clipping(case(made))[0]
    assert trace.key == "many"
    assert trace.t.tolist() == [50.5, 70.5]
    assert trace.columns["samples"].tolist() == [7.0, 6.0]
    assert trace.values == {"samples": 13.0}


def test_rotors_in_flight_give_the_fundamental_and_its_harmonics():
    made = log()
    speed = np.where((T > AIR[0]) & (T < AIR[1]), 6000.0, 0.0)
    made.rpm = Stream(T, np.column_stack([speed, speed, np.full(len(T), np.nan)]), "rpm", "", "ESC")
    trace = rotor(case(made))[0]
    assert trace.t.tolist() == [100.0, 200.0, 300.0]
    assert trace.columns["low"].tolist() == trace.columns["high"].tolist() == [100.0, 200.0, 300.0]


def test_what_was_not_logged_is_not_drawn():
    made = log()
    assert levels(case(made)) == clipping(case(made)) == rotor(case(made)) == notches(case(made)) == []
    made.vibrations = [replace(shaken(), level=np.full(len(T), np.nan))]
    made.rpm = Stream(T, np.zeros((len(T), 4)), "rpm", "", "ESC")
    assert levels(case(made)) == rotor(case(made)) == []
