"""Does gravity or the field turn as the gyro says? Planted turns, from both sides of each limit."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import rotation
from attlog.metrics import windows
from attlog.segments.model import Segment
from tests.metrics import flights


def row(t0=0.0, t1=120.0, hz=20.0, **fields):
    t = np.arange(t0, t1, 1.0 / hz)
    return flights.row(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), start=t0, **fields)


FLIGHT = [
    Segment("continuous", 0, 120),
    Segment("rest.long", 0, 31),
    Segment("armed", 31, 90),
    Segment("idle", 31, 38),
    Segment("airborne", 40, 88),
    Segment("hover", 42, 60),
    Segment("cruise", 60, 88),
    Segment("rest.long", 90, 118),
]


def starts(case, row, phase):
    return [w[0] for group in windows.row_windows(case, row, phase, phase) for w, _ in group]


def test_a_row_settles_for_10_s_after_its_start_and_5_s_after_the_motors_stop():
    own = row()
    case = flights.case([own], FLIGHT)
    assert windows.rest_spans(case, own, "rest") == [(10.0, 31.0), (95.0, 118.0)]
    assert starts(case, own, "rest") == [10.0, 15.0, 20.0, 25.0, 95.0, 100.0, 105.0, 110.0]


def test_after_a_restart_a_row_settles_again_and_no_window_crosses_it():
    segments = [Segment("continuous", 0, 30), Segment("continuous", 33, 120), Segment("rest.long", 0, 120)]
    own = row()
    own.segment = (own.t > 33).astype(np.int64)
    case = flights.case([own], segments)
    assert starts(case, own, "rest")[:5] == [10.0, 15.0, 20.0, 25.0, 43.0]


def test_an_onboard_row_counts_from_the_reset_that_aligned_it():
    own = row()
    own.kind = "onboard"
    aligned = [Segment("reset", 12.0, 12.05), Segment("reset", 70.0, 70.05)]
    case = flights.case([own], FLIGHT + aligned)
    assert windows.own_start(case, own) == pytest.approx(22.05)


def test_in_the_air_windows_begin_at_the_scoring_start_and_end_at_the_impact():
    own = row()
    case = flights.case([own], FLIGHT, (own.t, own.q), scoring_start=50.0)
    case.reference.scoring.end = 71.0
    assert (starts(case, own, "hover"), starts(case, own, "cruise")) == ([50.0, 55.0], [60.0, 65.0])
    case.forget()
    case.reference.scoring.unscored = [(52.0, 67.0)]
    assert (starts(case, own, "hover"), starts(case, own, "cruise")) == ([], [])


def test_rest_of_2_to_5_s_is_one_window_and_shorter_flight_is_none():
    assert windows.lay_windows((3.0, 6.5), "rest") == [(3.0, 6.5)]
    assert windows.lay_windows((3.0, 4.5), "rest") == []
    assert windows.lay_windows((3.0, 6.5), "hover") == []
    assert windows.lay_windows((0.0, 14.97), "hover") == [(0.0, 5.0), (5.0, 10.0), (10.0, 15.0)]


def test_stretches_end_at_gaps_and_restarts():
    t = np.concatenate([np.arange(0.0, 5.0, 0.01), np.arange(6.0, 9.0, 0.01)])
    run = (t > 7.5).astype(np.int64)
    found = windows.within(t, (1.0, 8.5), run)
    assert [(round(t[s.start], 2), round(t[s.stop - 1], 2)) for s in found] == [(1.0, 4.99), (6.0, 7.5), (7.51, 8.5)]
    assert windows.within(t, (5.2, 5.8)) == []
    assert windows.within(np.zeros(0), (0.0, 1.0)) == []


def test_a_heading_that_wanders_is_no_tilt_however_the_vehicle_lies():
    wander = np.radians(np.sin(np.linspace(0.0, 20.0, 400)))
    found = windows.deviations(rotation.from_euler(0.6 + 0 * wander, -0.3 + 0 * wander, 1.2 + wander))
    np.testing.assert_allclose(found[:, :2], 0.0, atol=1e-6)
    np.testing.assert_allclose(found[:, 2], np.degrees(wander - np.mean(wander)), atol=1e-3)


def test_tilt_is_told_about_the_vehicles_own_roll_and_pitch_axis_whatever_its_heading():
    nod = np.radians(np.sin(np.linspace(0.0, 20.0, 400)))
    for axis, q in enumerate((rotation.from_euler(nod, 0 * nod, 2.0), rotation.from_euler(0 * nod, nod, 2.0))):
        found = windows.deviations(q)
        np.testing.assert_allclose(found[:, axis], np.degrees(nod - np.mean(nod)), atol=1e-3)
        np.testing.assert_allclose(found[:, 1 - axis], 0.0, atol=1e-6)
