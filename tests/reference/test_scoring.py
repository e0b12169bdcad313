"""What is scored starts late, pauses after restarts, ends at an impact; and all rows share it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attlog import segments
from attlog.core import rotation
from attlog.flight.model import Attitude
from attlog.reference import ReferenceOptions, choose, onboard_rows, replayed, scoring
from attlog.reference.model import AttitudeErrors, Reference
from attlog.reference.scoring import withhold
from attlog.segments.model import Segment, Segments
from tests.reference.flights import RATE, SECONDS, attitude_at, compared, estimate, flight, grouped, sampled

T = np.arange(0.0, SECONDS, 1 / RATE)


def with_gap(t0: float, t1: float):
    """A flight whose IMU is silent between two times."""
    log = flight()
    for stream in (log.imus[0].gyro, log.imus[0].acc):
        keep = (stream.t < t0) | (stream.t > t1)
        stream.t, stream.x = stream.t[keep], stream.x[keep]
    return log


def scored_times(log, found=None) -> tuple[np.ndarray, float | None]:
    """Scored times of a perfect row, and its coverage."""
    found = found or segments.build(log)
    t = log.imus[0].gyro.t
    row = replayed(
        log, found, choose(log, found, ReferenceOptions(declination=0.0)), estimate(t), name="made", uses_mag=True
    )
    assert row.errors is not None
    return row.errors.t[row.errors.scored], row.coverage_pct


def test_the_first_seconds_after_a_restart_are_not_scored_and_count_against_coverage():
    log = with_gap(25.0, 26.0)
    found = segments.build(log)
    found.segments.append(Segment("airborne", 20.0, SECONDS, "made"))
    t, coverage = scored_times(log, found)
    assert not np.any((t > 25.0) & (t < 41.0))
    assert t[t > 30.0].min() == pytest.approx(41.0, abs=0.06)
    assert coverage == pytest.approx(100 * (10 + 19) / 45, abs=1.0)


def row_with(heading_deg, tilt_deg=0.0, uses_mag=True, log=None):
    """A row that is off by a heading and a tilt (over time) from the truth, measured."""
    return compared(log or flight(truth_hz=20.0), estimate(T, heading_deg, tilt_deg), uses_mag=uses_mag)[0]


def test_a_row_without_a_heading_of_its_own_does_not_diverge_in_heading():
    assert row_with(90.0, uses_mag=False).status == "ok"


def test_convergence_is_one_sided_and_counts_heading_only_where_there_is_one():
    """Tilt settles at 25 s, heading at 32 s; afterwards the row gets worse, which is no convergence."""
    tilt = np.where(T < 25, 10.0, np.where(T > 50, 20.0, 0.5))
    heading = np.where(T < 32, 20.0, 0.5)
    assert row_with(heading, tilt).convergence_s == pytest.approx(32.0, abs=0.1)
    assert row_with(heading, tilt, uses_mag=False).convergence_s == pytest.approx(25.0, abs=0.1)
    assert row_with(0.0, np.where(T > 50, 20.0, 0.5)).convergence_s == 0.0


def test_an_onboard_attitude_counts_from_its_own_alignment_on():
    """Yaw 0 until it jumps to the true heading at 18 s, still on the ground."""
    log = flight(truth_hz=20.0)
    onboard = log.attitudes["ATT"]
    before = onboard.t < 18.0
    onboard.q[before] = rotation.turn_about_down(onboard.q[before], np.radians(70.0))
    found = segments.build(log)
    reference = choose(log, found, ReferenceOptions(declination=0.0))
    (row,) = onboard_rows(log, found, reference)
    assert row.start == pytest.approx(18.0, abs=0.06)
    assert row.errors.t[row.errors.scored].min() >= 18.0 - 0.06
    assert np.abs(row.errors.heading[row.errors.scored]).max() < 1.0
    assert row.status == "ok"
    log.truth = None
    alone = choose(log, found, ReferenceOptions(declination=0.0))
    assert not scoring.scored_mask(alone, np.array([16.0, 17.5])).any()
    assert scoring.scored_mask(alone, np.array([18.5, 30.0])).all()


def test_a_jump_in_flight_is_no_alignment():
    log = flight(truth_hz=20.0)
    onboard = log.attitudes["ATT"]
    late = onboard.t >= 30.0
    onboard.q[late] = rotation.turn_about_down(onboard.q[late], np.radians(20.0))
    found = segments.build(log)
    found.segments.append(Segment("airborne", 20.0, 60.0, "made"))
    (row,) = onboard_rows(log, found, choose(log, found, ReferenceOptions(declination=0.0)))
    assert row.start == 0.0


def test_a_reference_that_is_written_for_a_third_of_the_flight_covers_a_third():
    """Not its span from first to last record."""
    log = flight()
    onboard = log.attitudes["ATT"]
    keep = (onboard.t < 30.0) | (onboard.t > 58.0)
    onboard.t, onboard.q = onboard.t[keep], onboard.q[keep]
    found = segments.build(log)
    found.segments.append(Segment("airborne", 20.0, 60.0, "made"))
    (row,) = onboard_rows(log, found, choose(log, found, ReferenceOptions(declination=0.0)))
    assert row.is_reference
    assert row.coverage_pct == pytest.approx(100 * (15 + 2) / 45, abs=2.0)


# What of a log is scored, covered, lost and converged: limits from both sides, by closed forms.

SCORED_T = np.arange(0.0, 100.0, 0.1)


def reference(**more: Any) -> Reference:
    zeros = np.zeros(len(SCORED_T), np.int64)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(SCORED_T), 1))
    return Reference("truth", "truth", SCORED_T, q, zeros, zeros, rate=10.0, **grouped(**more))


def scored_errors(tilt: Any = 0.0, heading: Any = 0.0, t: np.ndarray = SCORED_T, **more: Any) -> AttitudeErrors:
    n = len(t)
    q, zeros = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros(n, np.int64)
    gap, segment = more.get("gap", zeros), more.get("segment", zeros)
    scored = more.get("scored", np.ones(n, bool))
    tilt, heading = tilt + 0.0 * t, heading + 0.0 * t
    return AttitudeErrors(t, np.hypot(tilt, heading), heading, tilt, gap, segment, scored, q, q)


@pytest.mark.parametrize(("seconds", "left_out"), [(30.0, 15.0), (29.9, 29.9 / 3.0), (300.0, 15.0), (-1.0, 0.0)])
def test_fifteen_seconds_or_a_third_of_a_short_record_are_left_out(seconds: float, left_out: float) -> None:
    assert scoring.unscored_seconds(seconds) == pytest.approx(left_out)


def test_what_counts_lies_between_start_and_end_and_outside_what_is_not_scored() -> None:
    found = scoring.scored_mask(
        reference(scoring_start=15.0, end=90.0, unscored=[(40.0, 52.0), (60.0, 61.0)]), SCORED_T
    )
    wanted = (
        (SCORED_T >= 15.0)
        & (SCORED_T <= 90.0)
        & ~((SCORED_T >= 40.0) & (SCORED_T < 52.0))
        & ~((SCORED_T >= 60.0) & (SCORED_T < 61.0))
    )
    assert np.count_nonzero(found != wanted) <= 2
    assert found[150]
    assert not found[149]


@pytest.mark.parametrize(
    ("tilt", "seconds", "lost"), [(30.5, 2.1, True), (29.5, 20.0, False), (60.0, 1.9, False)], ids=lambda x: str(x)
)
def test_a_tilt_of_thirty_degrees_for_two_seconds_is_diverged(tilt: float, seconds: float, lost: bool) -> None:
    off = np.where((SCORED_T >= 40.0) & (SCORED_T < 40.05 + seconds), tilt, 1.0)
    found = scoring.diverged_at(scored_errors(off))
    assert found == (pytest.approx(40.0) if lost else None)
    assert scoring.diverged_at(scored_errors(off, scored=SCORED_T < 39.0)) is None
    cut = (SCORED_T >= 41.0).astype(np.int64)
    assert (
        scoring.diverged_at(scored_errors(np.where((SCORED_T >= 40.0) & (SCORED_T < 42.5), 90.0, 1.0), gap=cut)) is None
    )


@pytest.mark.parametrize(
    ("heading", "seconds", "lost"), [(-46.0, 10.2, True), (44.0, 40.0, False), (90.0, 9.8, False)], ids=lambda x: str(x)
)
def test_a_heading_off_by_forty_five_degrees_for_ten_seconds_is_lost(
    heading: float, seconds: float, lost: bool
) -> None:
    found = scoring.lost_heading_at(
        scored_errors(0.0, np.where((SCORED_T >= 40.0) & (SCORED_T < 40.0 + seconds), heading, 1.0))
    )
    assert found == (pytest.approx(40.0) if lost else None)


def test_a_heading_that_is_off_more_than_half_of_the_time_is_lost_though_never_for_long() -> None:
    for share, lost in ((5.2, True), (4.8, False)):
        off = np.where(SCORED_T % 10.0 < share, 80.0, 0.0)
        assert (scoring.lost_heading_at(scored_errors(0.0, off)) is not None) is lost
    short = SCORED_T[:30]
    assert scoring.lost_heading_at(scored_errors(0.0, 80.0, short)) == 0.0
    assert scoring.lost_heading_at(scored_errors(0.0, 80.0, short[:20])) is None


def test_a_jump_of_the_reference_is_no_loss_of_heading() -> None:
    """The reference jumps by 70 deg at 50 s: the error is 70 deg from there on, and would be 0 without."""
    segment = (SCORED_T >= 50.0).astype(np.int64)
    off = np.where(SCORED_T >= 50.0, 70.0, 0.0)
    assert scoring.lost_heading_at(scored_errors(0.0, off, segment=segment)) is None
    assert scoring.lost_heading_at(scored_errors(0.0, off)) == pytest.approx(50.0)
    assert scoring.lost_heading_at(
        scored_errors(0.0, 2.0 * np.where(SCORED_T >= 70.0, 50.0, 0.0), segment=segment)
    ) == pytest.approx(70.0)


@pytest.mark.parametrize(
    ("degrees", "at", "flown", "aligned"),
    [(5.1, 30.0, 80.0, True), (4.9, 30.0, 80.0, False), (90.0, 61.0, 80.0, False), (90.0, 30.0, 25.0, False)],
)
def test_an_onboard_attitude_was_aligned_by_its_last_jump_before_the_flight(
    degrees: float, at: float, flown: float, aligned: bool
) -> None:
    i = round(10 * at)
    heading = np.where(np.arange(len(SCORED_T)) >= i, np.radians(degrees), 0.0)
    attitude = Attitude(SCORED_T, rotation.from_euler(0.0 * SCORED_T, 0.0 * SCORED_T, heading), "ATT")
    found = scoring.aligned_at(attitude, np.array([0, 50, i]), Segments([Segment("airborne", flown, 95.0)]))
    assert found == (pytest.approx(at) if aligned else None)
    assert scoring.aligned_at(attitude, np.zeros(0, np.int64), Segments([])) is None


@pytest.mark.parametrize(
    ("kind", "status", "withheld"),
    [
        ("replay", "ok", True),
        ("replay", "not_converged", True),
        ("replay", "diverged", True),
        ("replay", "failed", False),
        ("onboard", "ok", False),
    ],
)
def test_no_filter_is_judged_on_a_sensor_that_is_beyond_use(kind: str, status: str, withheld: bool) -> None:
    row: Any = SimpleNamespace(kind=kind, status=status, reason="")
    withhold(row, "")
    assert (row.status, row.reason) == (status, "")
    withhold(row, "the accelerometer stands still")
    assert row.status == ("not_judged" if withheld else status)
    assert row.reason == ("the accelerometer stands still" if withheld else "")


@pytest.mark.parametrize(("size", "converged"), [(1.9, 0.0), (2.1, 7.0)])
def test_a_row_has_converged_when_its_tilt_comes_within_two_degrees_of_its_median(
    size: float, converged: float
) -> None:
    found = scored_errors(np.where(SCORED_T < 7.0, 1.0 + size, 1.0))
    assert scoring.convergence_s(found, 0.0, False) == pytest.approx(converged)
    heading = scored_errors(1.0, -np.where(SCORED_T < 7.0, 2.5 * size, 0.0))
    assert scoring.convergence_s(heading, 0.0, True) == pytest.approx(converged)
    assert scoring.convergence_s(heading, 0.0, False) == 0.0


def test_more_than_sixty_seconds_are_no_convergence_and_a_later_start_counts_from_there() -> None:
    for until, took in ((59.0, 49.0), (69.0, 59.0), (71.0, None)):
        found = scored_errors(np.where(SCORED_T < until, 20.0, 1.0), scored=SCORED_T >= 75.0)
        told = scoring.convergence_s(found, 10.0, False)
        assert told == (None if took is None else pytest.approx(took))


# Errors are taken where both attitudes are known: never upsampled, never across a gap or a reset.


def reference_of(t, q, segment=None, run=None) -> Reference:
    """A reference without a log."""
    zeros = np.zeros(len(t), np.int64)
    rate = (len(t) - 1) / (t[-1] - t[0])
    return Reference(
        "truth", "SIM", t, q, zeros if run is None else run, zeros if segment is None else segment, rate=rate
    )


def errors(t, q, ref, run=None):
    """Errors of a row."""
    return scoring.errors_against(t, q, np.zeros(len(t), np.int64) if run is None else run, ref)


def test_a_fast_row_is_compared_at_the_slow_references_own_times():
    """The trap: a 10 Hz reference drawn out to 100 Hz would show its own interpolation as the row's error."""
    ref = reference_of((slow := sampled(10.0)).t, slow.q)
    t = np.arange(0, 60, 0.01)
    found = errors(t, attitude_at(t), ref)
    np.testing.assert_array_equal(found.t, ref.t[ref.t <= t[-1]])
    assert found.total.max() < 0.01
    drawn_out = rotation.slerp(ref.t, ref.q, t[t <= ref.t[-1]])
    lost = np.degrees(rotation.total_angle(rotation.earth_error(attitude_at(t[t <= ref.t[-1]]), drawn_out)))
    assert lost.max() > 2 * found.total.max()


def test_a_slow_row_is_compared_at_its_own_times():
    ref = reference_of((fast := sampled(50.0)).t, fast.q)
    slow = sampled(10.0)
    found = errors(slow.t + 0.003, attitude_at(slow.t + 0.003), ref)
    assert len(found.t) == np.count_nonzero(slow.t + 0.003 <= ref.t[-1])
    assert found.total.max() < 0.01


def test_nothing_is_compared_across_a_gap_of_the_row():
    ref = reference_of((slow := sampled(10.0)).t, slow.q)
    t = np.arange(0, 60, 0.01)
    t = t[(t < 30.0) | (t > 30.3)]
    found = errors(t, attitude_at(t), ref)
    assert not np.any((found.t > 30.0) & (found.t < 30.3))
    assert found.total.max() < 0.01
    assert np.unique(found.gap_segment).tolist() == [0, 1]


def test_nothing_is_compared_across_a_gap_or_reset_of_the_reference():
    slow = sampled(10.0)
    segment = (slow.t >= 30.0).astype(np.int64)
    q = np.where(segment[:, None], rotation.turn_about_down(slow.q, np.radians(40.0)), slow.q)
    ref = reference_of(slow.t, q, segment)
    own = np.arange(0.05, 59, 0.1)
    found = errors(own, attitude_at(own), ref)
    assert not np.any((found.t > 29.9) & (found.t < 30.0))
    assert set(np.round(found.heading, 1)) <= {0.0, -0.0, -40.0}
    assert np.flatnonzero(np.diff(found.segment)).tolist() == [np.searchsorted(found.t, 30.0) - 1]


def test_heading_errors_wrap_and_never_read_as_a_full_turn():
    """The flight turns through south: headings of +179 and -179 are 2 deg apart."""
    row, _, _ = compared(flight(), estimate(heading_deg=2.0))
    assert row.errors is not None
    np.testing.assert_allclose(row.errors.heading, 2.0, atol=0.05)
    np.testing.assert_allclose(row.errors.total, 2.0, atol=0.05)
    np.testing.assert_allclose(row.errors.tilt, 0.0, atol=0.05)


@settings(max_examples=25, deadline=None)
@given(yaw=st.floats(-3.1, 3.1), shift=st.floats(-1e4, 1e4))
def test_errors_depend_neither_on_north_nor_on_the_clock(yaw, shift):
    """Yaw equivariance and time shift invariance, whatever the signs of the quaternions."""
    slow = sampled(10.0)
    t = np.arange(0, 60, 0.02)
    q = rotation.multiply(rotation.from_rotvec(np.radians([2.0, -1.0, 4.0])), attitude_at(t))
    plain = errors(t, q, reference_of(slow.t, slow.q))
    signs = np.where(np.arange(len(t)) % 3, 1.0, -1.0)[:, None]
    ref = reference_of(slow.t + shift, rotation.turn_about_down(slow.q, yaw))
    moved = errors(t + shift, signs * rotation.turn_about_down(q, yaw), ref)
    assert abs(len(moved.t) - len(plain.t)) <= 1
    n = min(len(moved.t), len(plain.t))
    np.testing.assert_allclose(moved.heading[1 : n - 1], plain.heading[1 : n - 1], atol=1e-5)
    np.testing.assert_allclose(moved.total[1 : n - 1], plain.total[1 : n - 1], atol=1e-5)
    np.testing.assert_allclose(moved.tilt.mean(), plain.tilt.mean(), atol=1e-3)


@pytest.mark.parametrize("hz", [100.0, 4.0])
def test_rows_of_the_same_times_share_what_they_are_compared_with_and_no_others_do(hz):
    ref = reference_of((slow := sampled(10.0)).t, slow.q)
    t = np.arange(0, 60, 1.0 / hz)
    q = attitude_at(t)
    lost = q.copy()
    lost[len(t) // 2] = np.nan
    first, same, holed, later = (errors(at, x, ref) for at, x in ((t, q), (t, q), (t, lost), (t + 0.01, q)))
    assert same.q_ref is first.q_ref
    assert same.t is first.t
    for found, at, x in ((holed, t, lost), (later, t + 0.01, q)):
        alone = errors(at, x, reference_of(slow.t, slow.q))
        assert found.q_ref is not first.q_ref
        for name in ("t", "q_est", "q_ref", "total", "segment", "gap_segment", "scored"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))
