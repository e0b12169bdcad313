"""Rows are aligned once, freed of a heading they cannot know, and told what became of them."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.core import rotation
from attlog.estimators.interface import Estimate
from attlog.reference import ReferenceOptions, alignment, choose, onboard_rows, replayed
from attlog.segments.model import Segment
from tests.reference.flights import RATE, SECONDS, ardupilot, attitude_at, compared, estimate, flight, sampled

T = np.arange(0.0, SECONDS, 1 / RATE)
TRIM = np.array([0.03, -0.02, 0.0])


def with_trim(has_trim: bool = True, **params: float):
    """An ArduPilot log whose ATT has the trim taken out, as the autopilot does."""
    log = ardupilot(flight(), AHRS_TRIM_X=TRIM[0], AHRS_TRIM_Y=TRIM[1], **params)
    attitude = log.attitudes["ATT"]
    if has_trim:
        attitude.q = alignment.apply_trim(attitude.q, TRIM)
        attitude.has_trim = True
    return log


def test_trim_is_taken_out_of_a_replay_once():
    row, reference, _ = compared(with_trim(), estimate())
    assert reference.alignment.trim is not None
    assert row.errors is not None
    assert row.errors.total.max() < 0.05
    assert [s.name for s in row.steps] == ["trim"]


def test_the_vehicles_roll_is_the_imus_less_the_trim():
    """ArduPilot: AHRS_TRIM_X of 2 deg makes an IMU that shows 2 deg of roll a level vehicle."""
    level = alignment.apply_trim(rotation.from_euler(*np.radians([2.0, -1.0, 0.0])), np.radians([2.0, -1.0, 0.0]))
    np.testing.assert_allclose(np.degrees(rotation.to_euler(level)), 0.0, atol=0.03)


def test_trim_switched_off_leaves_its_size_as_tilt():
    row, _, _ = compared(with_trim(), estimate(), ReferenceOptions(trim=False, declination=0.0))
    assert row.errors is not None
    assert np.median(row.errors.tilt) == pytest.approx(np.degrees(np.hypot(*TRIM[:2])), abs=0.02)


@pytest.mark.parametrize("kind", ["imu attitude", "truth", "px4"])
def test_trim_is_not_applied_where_the_reference_has_none(kind):
    """XKQ, truth and everything of PX4 are attitudes of the IMU: taking a trim out of the replay would be the error."""
    log = with_trim(has_trim=False)
    if kind == "truth":
        log.truth = sampled(50.0, source="SIM")
    if kind == "px4":
        log = flight()
    row, reference, _ = compared(log, estimate())
    assert reference.alignment.trim is None
    assert row.errors is not None
    assert row.errors.total.max() < 0.05


def test_an_unknown_trim_is_said_and_not_invented():
    log = with_trim()
    log.parameters.trim = None
    _, reference, _ = compared(log, estimate())
    step = next(s for s in reference.alignment.steps if s.name == "trim")
    assert reference.alignment.trim is None
    assert step.value is None
    assert "does not hold AHRS_TRIM_X" in step.text


def test_onboard_attitudes_without_trim_are_levelled_like_replays():
    log = with_trim()
    log.attitudes["XKQ.0"] = sampled(20.0, source="XKQ")
    found = segments.build(log)
    rows = {r.name: r for r in onboard_rows(log, found, choose(log, found))}
    assert rows["onboard"].is_reference
    assert rows["onboard:XKQ.0"].errors is not None
    assert rows["onboard:XKQ.0"].errors.total.max() < 0.05


def test_a_filter_without_magnetometer_is_compared_with_its_heading_offset_removed():
    """The trap: its heading starts anywhere, so the plain RMSE would be the arbitrary start."""
    row, _, _ = compared(flight(), estimate(heading_deg=123.0), uses_mag=False)
    assert row.errors is not None
    assert row.heading_offset_deg == pytest.approx(123.0, abs=0.01)
    assert np.abs(row.errors.heading).max() < 0.05
    assert row.status == "ok"
    step = next(s for s in row.steps if s.name == "heading_offset")
    assert "the rest from 15 s" in step.text
    yaw = rotation.earth_error(row.q, attitude_at(row.t))
    assert np.degrees(np.abs(rotation.heading_angle(yaw))).max() < 0.05


def test_a_filter_with_magnetometer_keeps_its_heading_error():
    row, _, _ = compared(flight(), estimate(heading_deg=7.0))
    assert row.heading_offset_deg is None
    assert row.errors is not None
    assert np.median(row.errors.heading) == pytest.approx(7.0, abs=0.01)


def test_with_unknown_declination_magnetic_headings_are_compared_without_offset():
    row, reference, _ = compared(flight(), estimate(heading_deg=7.0), ReferenceOptions())
    assert reference.alignment.declination_deg is None
    assert row.heading_offset_deg == pytest.approx(7.0, abs=0.05)


def test_each_restart_has_an_offset_of_its_own():
    run = (T >= 30.0).astype(np.int64)
    e = estimate(heading_deg=np.where(run == 1, -60.0, 20.0))
    e.segment = run
    row, _, _ = compared(flight(), e, uses_mag=False)
    assert row.errors is not None
    assert np.abs(row.errors.heading).max() < 0.1
    assert "in each of 2 segments" in row.steps[-1].text


def test_a_reset_of_the_reference_is_no_error_of_a_gyro_filter():
    """The trap "reset counted as drift": the onboard heading jumps by 50 deg, the vehicle and the filter do not."""
    log = flight()
    attitude = log.attitudes["ATT"]
    after = attitude.t >= 40.0
    attitude.q[after] = rotation.turn_about_down(attitude.q[after], np.radians(50.0))
    row, reference, _ = compared(log, estimate(heading_deg=10.0), uses_mag=False)
    assert np.unique(reference.segment).tolist() == [0, 1]
    assert row.errors is not None
    assert np.abs(row.errors.heading).max() < 0.2
    assert "1 resets of the reference not counted" in row.steps[-1].text
    jumps = np.abs(np.degrees(rotation.heading_angle(rotation.earth_error(row.q[1:], row.q[:-1]))))
    assert jumps.max() < 1.0


def test_the_onboard_attitude_is_a_row_when_truth_is_the_reference():
    log = flight(truth_hz=50.0)
    log.attitudes["AHR2"] = sampled(5.0, source="AHR2")
    found = segments.build(log)
    rows = onboard_rows(log, found, choose(log, found))
    assert [r.name for r in rows] == ["onboard", "onboard:AHR2"]
    assert not any(r.is_reference for r in rows)
    assert all(r.errors is not None and r.errors.total.max() < 0.05 for r in rows)
    assert rows[0].coverage_pct == pytest.approx(100.0, abs=0.5)


def test_the_reference_is_a_marked_row_without_errors():
    log = flight()
    log.attitudes["AHR2"] = sampled(5.0, source="AHR2")
    found = segments.build(log)
    rows = onboard_rows(log, found, choose(log, found, ReferenceOptions(reference="onboard:AHR2")))
    assert {r.name: (r.is_reference, r.errors is None) for r in rows} == {
        "onboard": (False, False),
        "onboard:AHR2": (True, True),
    }


def test_a_row_that_topples_is_diverged_from_then_on():
    row, _, _ = compared(flight(), estimate(tilt_deg=np.where(T > 45.0, 40.0, 0.0)))
    assert row.status == "diverged"
    assert "from 45.0" in row.reason or "from 45.1" in row.reason
    assert row.errors is not None


def test_an_estimate_that_ends_in_nan_is_diverged_and_one_that_is_all_nan_failed():
    e = estimate()
    e.q[T > 45.0] = np.nan
    row, _, _ = compared(flight(), e)
    assert row.status == "diverged"
    assert row.reason == "returned NaN from 45.0 s on"
    e = estimate()
    e.q[1:] = np.nan
    row, _, _ = compared(flight(), e)
    assert (row.status, row.reason) == ("failed", f"returned NaN from {T[1]:.1f} s on")
    e = estimate()
    e.q[:] = np.nan
    assert compared(flight(), e)[0].status == "failed"


def test_a_filter_that_never_settles_within_a_minute_has_not_converged():
    log = flight(200.0)
    t = np.arange(0.0, 200.0, 1 / RATE)
    row, _, _ = compared(log, estimate(t, tilt_deg=np.where(t < 90.0, 20.0, 0.0)))
    assert row.status == "not_converged"
    assert row.convergence_s is None


def test_a_row_that_is_never_there_for_5_s_is_not_said_not_to_settle():
    t = T[(T % 3.0) > 1.0]
    row, _, _ = compared(flight(), estimate(t))
    assert row.status == "ok"
    assert row.convergence_s is None


def test_coverage_counts_the_rest_and_flight_that_was_scored():
    """The trap: a filter scored on its good half only."""
    log = flight()
    found = segments.build(log)
    found.segments.append(Segment("airborne", 20.0, SECONDS, "made"))
    reference = choose(log, found, ReferenceOptions(declination=0.0))
    whole = replayed(log, found, reference, estimate(), name="whole", uses_mag=True)
    half = replayed(log, found, reference, estimate(T[T < 37.5]), name="half", uses_mag=True)
    assert whole.coverage_pct == pytest.approx(100.0, abs=0.5)
    assert half.coverage_pct == pytest.approx(50.0, abs=1.0)
    holes = estimate()
    holes.q[(T > 30) & (T < 39)] = np.nan
    holed = replayed(log, found, reference, holes, name="holes", uses_mag=True)
    assert holed.coverage_pct == pytest.approx(80.0, abs=1.0)


def test_a_row_without_common_time_says_so():
    row, _, _ = compared(flight(), estimate(T + 1000.0))
    assert row.coverage_pct == 0.0
    assert "no time in common" in row.reason


def test_without_reference_a_row_has_no_errors_and_is_not_judged():
    log = flight()
    log.attitudes, log.onboard = {}, None
    row, _, _ = compared(log, estimate(heading_deg=5.0))
    assert row.errors is None
    assert row.status == "ok"
    assert row.coverage_pct is None


def test_what_was_said_before_a_late_field_is_no_heading_failure():
    """90 deg off until the first field at 30 s: nothing before is scored, what follows is judged."""
    e = estimate(heading_deg=np.where(T < 30.0, 90.0, 1.0))
    told = Estimate(e.t, e.q, no_heading=[(0.0, 30.0)])
    row, _, _ = compared(flight(), told)
    assert row.errors is not None
    assert row.status == "ok"
    assert row.errors.t[row.errors.scored].min() == pytest.approx(30.0, abs=0.06)
    assert np.abs(row.errors.heading[row.errors.scored]).max() < 2.0
    assert [(s.name, s.value, s.applied) for s in row.steps] == [("late_field", 30.0, True)]
    assert np.flatnonzero(np.diff(row.segment)).tolist() == [np.searchsorted(T, 30.0) - 1]
    assert compared(flight(), e)[0].status == "diverged"


# The step of logged attitudes, what a floor is made of, and which samples of an attitude are fit to compare.
