"""The ground track: where a vehicle went, and whether its heading points along its course."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude, Gnss
from attlog.health.figures.track import M_PER_DEG, MOST, off_course, track
from tests.health.figures.made import AIR, T, attitude, case, log


def circling(off_deg: float = 0.0, radius: float = 60.0, t: np.ndarray = T):
    """The made vehicle on a circle along its own heading, which the autopilot takes to be off by so much."""
    made = log()
    heading = np.radians(3.0 * t)
    speed = radius * np.radians(3.0)
    lat = 47.4 + radius * np.sin(heading) / M_PER_DEG
    lon = 8.5 - radius * np.cos(heading) / (M_PER_DEG * np.cos(np.radians(47.4)))
    velocity = speed * np.column_stack([np.cos(heading), np.sin(heading), 0 * t])
    ones = np.ones(len(t))
    made.gnss = [Gnss(0, t, "GPS:0", lat, lon, 500.0 * ones, velocity, ones, ones, ones, np.full(len(t), 3))]
    turned = rotation.multiply(rotation.from_rotvec(np.radians([0.0, 0.0, off_deg])), attitude())
    made.attitudes = {"ATT": Attitude(T, turned, "ATT")}
    return made


@pytest.mark.parametrize("off", [0.0, 28.0, -170.0])
def test_a_heading_that_is_off_stands_off_the_course_by_as_much(off):
    found = track(case(circling(off)))[0]
    assert found.values["difference"] == pytest.approx(off, abs=0.5)
    assert found.values["high"] - found.values["low"] < 1.0
    assert found.values["seconds"] == pytest.approx(AIR[1] - AIR[0], abs=1.0)


def test_north_is_up_and_both_scales_are_metres():
    found = track(case(circling()))[0]
    north, east = found.columns["north"], found.columns["east"]
    start, quarter, half = (int(np.searchsorted(found.t, t)) for t in (AIR[0], AIR[0] + 30.0, AIR[0] + 60.0))
    assert np.hypot(north[start], east[start]) < 1.0
    assert np.hypot(north[half], east[half]) == pytest.approx(120.0, rel=0.02)
    assert found.columns["course"][quarter] == pytest.approx(120.0, abs=1.0)
    assert np.ptp(north) == pytest.approx(120.0, rel=0.02)


def test_what_stayed_in_its_place_has_no_track_but_a_small_circle_has():
    assert track(case(circling(radius=1.0))) == []
    assert len(track(case(circling(radius=25.0)))) == 1


def test_a_long_flight_keeps_few_points():
    found = track(case(circling(t=np.arange(0, 100.0, 0.01))))[0]
    assert 0.5 * MOST < len(found.t) <= MOST


def test_a_plane_flies_where_it_points_and_a_copter_may_not():
    made = circling()
    assert track(case(made))[0].values["forward"] == 0.0
    made.vehicle = "fixed wing"
    values = track(case(made))[0].values
    assert values["forward"] == 1.0
    assert "difference" not in values  # at 3 m/s wind would be most of it


def test_angles_about_the_south_have_a_median_there():
    t = np.arange(20.0)
    found = off_course(t, np.where(t % 2 > 0, 179.0, -179.0), np.ones(20, bool))
    assert abs(found["difference"]) == pytest.approx(179.0, abs=1.1)
    assert off_course(t[:5], 0 * t[:5], np.ones(5, bool)) == {}


def test_a_receiver_without_a_fix_or_place_gives_nothing():
    made = circling()
    made.gnss[0].fix[:] = 1
    assert track(case(made)) == []
    made.gnss = []
    assert track(case(made)) == []
