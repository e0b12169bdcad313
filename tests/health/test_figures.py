"""Figures of the compasses: expected by a turned model, corrected only where it is offered, the planted slope."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import Attitude, Clipping, Gnss, Mag, OnboardVibration, Stream
from attlog.health.check import Check, Setting
from attlog.health.figures import (
    M_PER_DEG,
    MAX_POINTS,
    clipping_traces,
    field_traces,
    interference_traces,
    level_traces,
    off_course,
    ratio_traces,
    rotor_traces,
    track_traces,
)
from attlog.reference import alignment
from tests.health.figure_cases import AIR, T, attitude, case, innovations, log

OFFSET = (12.0, -3.0, 5.0)
OFFERED = Check("compass_offset", "fault", "Off.", sensor="MAG:0", settings=[Setting("COMPASS_OFS_X", 0.0, -120.0)])


def off(trace, part: str = "") -> np.ndarray:
    """Mean of a part less what is expected, uT."""
    return np.array([np.nanmean(trace.columns[part + a] - trace.columns["expected_" + a]) for a in "xyz"])


def test_measured_less_expected_is_the_planted_offset():
    (trace,) = field_traces(case(log(OFFSET)), [])
    np.testing.assert_allclose(off(trace), OFFSET, atol=1e-6)
    assert np.ptp(trace.columns["expected_x"]) > 30
    assert (trace.key, trace.values) == ("MAG:0", {"by_motion": 1.0})
    assert len(trace.t) <= MAX_POINTS


@pytest.mark.parametrize("sigma", [None, 30.0])
def test_without_a_sure_heading_by_motion_the_reference_turns_the_field(sigma):
    (trace,) = field_traces(case(log(), sigma), [])
    assert trace.values == {"by_motion": 0.0}
    assert np.nanmax(np.abs(trace.columns["x"] - trace.columns["expected_x"])) > 20


def test_a_heading_that_nobody_knows_turns_no_field():
    unsure, lost, nowhere = case(log(), None), case(log(), None), log()
    unsure.reference.heading.by, lost.reference.kind, nowhere.gnss = "none", "none", []
    assert field_traces(unsure, []) == field_traces(lost, []) == field_traces(case(nowhere), []) == []


def test_a_log_that_is_not_replayed_is_drawn_by_its_onboard_attitude():
    asked = case(log(OFFSET), None)
    asked.reference = None
    np.testing.assert_allclose(off(field_traces(asked, [])[0]), OFFSET, atol=1e-6)


def test_the_compass_in_use_comes_first_and_all_end_at_the_crash():
    made = log()
    made.mags.append(Mag(1, Stream(T, made.mags[0].field.x + 1e-5, "T", "FRD", "MAG:1")))
    made.mag = 1
    found = field_traces(case(made, crash=60.0), [])
    assert [trace.key for trace in found] == ["MAG:1", "MAG:0"]
    assert max(trace.t[-1] for trace in found) < 60.0


def test_the_line_has_the_planted_slope_and_starts_at_nothing():
    made = log(per_ampere=0.2)
    (trace,) = interference_traces(case(made))
    down = alignment.earth_field(made).ned_t[2] / alignment.earth_field(made).strength_t
    assert trace.key == "current"
    assert trace.values["slope"] == pytest.approx(0.2 * down, rel=0.02)
    assert trace.values["start"] == pytest.approx(0.0, abs=0.1)
    assert trace.values["r"] > 0.99
    assert trace.values["seconds"] == pytest.approx(AIR[1] - AIR[0])


def test_a_drive_that_does_not_vary_or_is_not_logged_gives_no_figure():
    made = log(per_ampere=0.2)
    made.power.battery.x[:, 1] = 20.0
    assert interference_traces(case(made)) == []
    made.power.battery = None
    assert interference_traces(case(made)) == []


def test_the_throttle_stands_in_for_the_current_in_percent():
    made = log()
    made.power.battery = None
    share = np.where((T > AIR[0]) & (T < AIR[1]), 0.5 + 0.2 * np.sin(T), 0.0)
    made.power.throttle = Stream(T, share[:, None], "1", "", "CTUN")
    (trace,) = interference_traces(case(made))
    assert trace.key == "throttle"
    assert trace.t.max() == pytest.approx(70.0, abs=0.1)


def test_a_correction_is_drawn_only_where_its_values_are_offered():
    made = case(log(OFFSET))
    (trace,) = field_traces(made, [OFFERED])
    assert np.abs(off(trace, "corrected_")).max() < 1.0
    assert "corrected_x" not in field_traces(made, [])[0].columns


# The figure of the test ratios: what was never used is not drawn, nothing of a wreck, no error without anything.


def test_an_aid_that_was_never_used_is_not_drawn_and_a_wreck_is_none_of_flight():
    made = log()
    made.estimator.innovation_tests = [
        innovations(np.where(T > 50, 9.0, 0.2)),
        innovations(0 * T, "airspeed"),
        innovations(np.nan * T, "height"),
        innovations(np.where(T > 50, 9.0, 0.0), "velocity"),
    ]
    found = ratio_traces(case(made, crash=50.0))
    assert [trace.key for trace in found] == ["compass"]
    assert found[0].columns["ratio"].max() == 0.2


def test_thousands_of_ratios_keep_the_largest_at_its_own_time():
    made = log()
    ratio = np.full(20_000, 0.1)
    ratio[7_777] = 3.0
    made.estimator.innovation_tests = [innovations(ratio)]
    (trace,) = ratio_traces(case(made))
    assert len(trace.t) <= MAX_POINTS
    assert trace.t[np.argmax(trace.columns["ratio"])] == pytest.approx(777.7)
    assert np.all(np.diff(trace.t) > 0.0)


# The ground track: where a vehicle went, and whether its heading points along its course.


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
    found = track_traces(case(circling(off)))[0]
    assert found.values["difference"] == pytest.approx(off, abs=0.5)
    assert found.values["high"] - found.values["low"] < 1.0
    assert found.values["seconds"] == pytest.approx(AIR[1] - AIR[0], abs=1.0)


def test_north_is_up_and_both_scales_are_metres():
    found = track_traces(case(circling()))[0]
    north, east = found.columns["north"], found.columns["east"]
    start, quarter, half = (int(np.searchsorted(found.t, t)) for t in (AIR[0], AIR[0] + 30.0, AIR[0] + 60.0))
    assert np.hypot(north[start], east[start]) < 1.0
    assert np.hypot(north[half], east[half]) == pytest.approx(120.0, rel=0.02)
    assert found.columns["course"][quarter] == pytest.approx(120.0, abs=1.0)
    assert np.ptp(north) == pytest.approx(120.0, rel=0.02)


def test_what_stayed_in_its_place_has_no_track_but_a_small_circle_has():
    assert track_traces(case(circling(radius=1.0))) == []
    assert len(track_traces(case(circling(radius=25.0)))) == 1


def test_a_plane_flies_where_it_points_and_a_copter_may_not():
    made = circling()
    assert track_traces(case(made))[0].values["forward"] == 0.0
    made.vehicle = "fixed wing"
    values = track_traces(case(made))[0].values
    assert values["forward"] == 1.0
    assert "difference" not in values  # at 3 m/s wind would be most of it


def test_angles_about_the_south_have_a_median_there():
    t = np.arange(20.0)
    found = off_course(t, np.where(t % 2 > 0, 179.0, -179.0), np.ones(20, bool))
    assert abs(found["difference"]) == pytest.approx(179.0, abs=1.1)
    assert off_course(t[:5], 0 * t[:5], np.ones(5, bool)) == {}


# The figure of the vibration: the worst second of flight alone, clipping as counted, rotors as they turned.


def shaken(unit: int = 0, t: np.ndarray = T) -> OnboardVibration:
    """Level of one unit: 4 m/s^2 in flight, 50 for a second there, 90 on the ground."""
    level = np.where((T >= AIR[0]) & (T <= AIR[1]), 4.0, 90.0)
    level[(T >= 30.0) & (T < 31.0)] = 50.0
    return OnboardVibration(unit, "rest", f"VIBE:{unit}", t, level)


def test_percentiles_are_those_of_the_seconds_of_flight_of_every_unit():
    made = log()
    made.vibration.levels = [shaken(0), shaken(1)]
    first, second = level_traces(case(made))
    assert (first.key, second.key) == ("VIBE:0", "VIBE:1")
    assert first.values == {"p50": 4.0, "p80": 4.0, "worst": 50.0, "limit": 30.0, "fault": 60.0}
    assert AIR[0] < first.t[0] < first.t[-1] < AIR[1]
    assert level_traces(case(made, crash=25.0))[0].values["worst"] == 4.0


def test_of_the_counters_that_with_most_clipped_samples_in_flight_is_drawn():
    made = log()
    new = np.zeros(len(T), np.int64)
    few, many, ground = new.copy(), new.copy(), new.copy()
    few[500] = 5
    many[[501, 502, 700]] = 3, 4, 6
    ground[20] = 999
    units = [("few", few), ("many", many), ("ground", ground)]
    made.vibration.clippings = [Clipping("accelerometer", i, name, T, x, True) for i, (name, x) in enumerate(units)]
    made.vibration.clippings.append(Clipping("gyro", 0, "gyro", T, 99 * (many > 0), True))
    trace = clipping_traces(case(made))[0]
    assert trace.key == "many"
    assert trace.t.tolist() == [50.5, 70.5]
    assert trace.columns["samples"].tolist() == [7.0, 6.0]
    assert trace.values == {"samples": 13.0}


def test_rotors_in_flight_give_the_fundamental_and_its_harmonics():
    made = log()
    speed = np.where((T > AIR[0]) & (T < AIR[1]), 6000.0, 0.0)
    made.power.rpm = Stream(T, np.column_stack([speed, speed, np.full(len(T), np.nan)]), "rpm", "", "ESC")
    trace = rotor_traces(case(made))[0]
    assert trace.t.tolist() == [100.0, 200.0, 300.0]
    assert trace.columns["low"].tolist() == trace.columns["high"].tolist() == [100.0, 200.0, 300.0]
