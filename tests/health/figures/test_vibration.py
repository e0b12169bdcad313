"""The figure of the vibration: the worst second of flight alone, clipping as counted, rotors as they turned."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Clipping, Stream
from attlog.health.figures.vibration import clipping, levels, rotor
from tests.health.figures.made import AIR, T, case, log


def shaken() -> np.ndarray:
    """Level of three axes: 4 m/s^2 in flight, 50 for half a second there, 90 on the ground."""
    level = np.where((T >= AIR[0]) & (T <= AIR[1]), 4.0, 90.0)
    level[(T > 30.0) & (T < 30.5)] = 50.0
    return np.column_stack([0.5 * level, level, 0.1 * level])


def test_percentiles_are_those_of_flight_by_the_worst_axis_of_each_second():
    made = log()
    made.onboard_vibration = Stream(T, shaken(), "m/s^2", "FRD", "VIBE")
    trace = levels(case(made))[0]
    assert trace.values == {"p50": 4.0, "p80": 4.0, "worst": 50.0, "limit": 30.0, "fault": 60.0}
    assert AIR[0] < trace.t[0] < AIR[0] + 1.5
    assert len(trace.t) == pytest.approx(80, abs=1)
    assert levels(case(made, crash=25.0))[0].values["worst"] == 4.0


def test_two_flights_are_no_line():
    made = log()
    made.onboard_vibration = Stream(np.where(T > 50, T + 10.0, T), shaken(), "m/s^2", "FRD", "VIBE")
    assert np.isnan(levels(case(made))[0].columns["level"]).sum() == 1


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
    assert levels(case(made)) == clipping(case(made)) == rotor(case(made)) == []
    made.onboard_vibration = Stream(T, np.full((len(T), 3), np.nan), "m/s^2", "FRD", "VIBE")
    made.rpm = Stream(T, np.zeros((len(T), 4)), "rpm", "", "ESC")
    assert levels(case(made)) == rotor(case(made)) == []
