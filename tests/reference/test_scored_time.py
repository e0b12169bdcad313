"""What of a log is scored, covered, lost and converged: limits from both sides, by closed forms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude
from attlog.reference import scoring
from attlog.reference.model import AttitudeErrors, Reference
from attlog.reference.rows import withhold
from attlog.segments.model import Segment, Segments

T = np.arange(0.0, 100.0, 0.1)


def reference(**more: Any) -> Reference:
    zeros = np.zeros(len(T), np.int64)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1))
    return Reference("truth", "truth", T, q, zeros, zeros, rate=10.0, **more)


def errors(tilt: Any = 0.0, heading: Any = 0.0, t: np.ndarray = T, **more: Any) -> AttitudeErrors:
    n = len(t)
    q, zeros = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros(n, np.int64)
    gap, segment = more.get("gap", zeros), more.get("segment", zeros)
    scored = more.get("scored", np.ones(n, bool))
    tilt, heading = tilt + 0.0 * t, heading + 0.0 * t
    return AttitudeErrors(t, np.hypot(tilt, heading), heading, tilt, gap, segment, scored, q, q)


@pytest.mark.parametrize(("seconds", "left_out"), [(30.0, 15.0), (29.9, 29.9 / 3.0), (300.0, 15.0), (-1.0, 0.0)])
def test_fifteen_seconds_or_a_third_of_a_short_record_are_left_out(seconds: float, left_out: float) -> None:
    assert scoring.settling(seconds) == pytest.approx(left_out)


def test_scoring_starts_after_the_start_and_after_each_restart() -> None:
    t = np.concatenate([5.0 + T[:400], 50.0 + T[:120], 80.0 + T[:600]])
    first, unscored = scoring.start_and_unscored(t, None)
    assert first == pytest.approx(20.0)
    assert unscored == [(pytest.approx(50.0), pytest.approx(65.0)), (pytest.approx(80.0), pytest.approx(95.0))]
    assert scoring.start_and_unscored(t, 3.0)[0] == 3.0
    assert scoring.start_and_unscored(t[:0], None) == (0.0, [])
    near = np.concatenate([T[:400], 40.3 + T[:400]])
    assert scoring.start_and_unscored(near, None)[1] == []


def test_what_counts_lies_between_start_and_end_and_outside_what_is_not_scored() -> None:
    found = scoring.scored(reference(scoring_start=15.0, end=90.0, unscored=[(40.0, 52.0), (60.0, 61.0)]), T)
    wanted = (T >= 15.0) & (T <= 90.0) & ~((T >= 40.0) & (T < 52.0)) & ~((T >= 60.0) & (T < 61.0))
    assert np.count_nonzero(found != wanted) <= 2
    assert found[150]
    assert not found[149]


def test_coverage_is_the_share_of_flight_and_rest_that_was_counted() -> None:
    segments = Segments([Segment("continuous", 0, 100), Segment("rest.long", 0, 30), Segment("airborne", 40, 80)])
    number = np.zeros(len(T), np.int64)
    counted = (T < 50.0) | (T >= 60.0)
    found = scoring.coverage_pct(T, number, counted, reference(scoring_start=10.0, end=70.0), segments)
    assert found == pytest.approx(100.0 * 40.0 / 50.0, abs=0.3)  # of 20 s at rest and 30 s in the air
    whole = scoring.coverage_pct(
        T, number, counted, reference(scoring_start=0.0), Segments([Segment("continuous", 0, 100)])
    )
    assert whole == pytest.approx(90.0, abs=0.2)
    assert scoring.coverage_pct(T, number, counted, reference(scoring_start=90.0, end=70.0), segments) is None
    assert scoring.coverage_pct(T, number, ~number.astype(bool), reference(), segments) == pytest.approx(100.0, abs=0.2)


@pytest.mark.parametrize(
    ("tilt", "seconds", "lost"), [(30.5, 2.1, True), (29.5, 20.0, False), (60.0, 1.9, False)], ids=lambda x: str(x)
)
def test_a_tilt_of_thirty_degrees_for_two_seconds_is_diverged(tilt: float, seconds: float, lost: bool) -> None:
    off = np.where((T >= 40.0) & (T < 40.05 + seconds), tilt, 1.0)
    found = scoring.diverged_at(errors(off))
    assert found == (pytest.approx(40.0) if lost else None)
    assert scoring.diverged_at(errors(off, scored=T < 39.0)) is None
    cut = (T >= 41.0).astype(np.int64)
    assert scoring.diverged_at(errors(np.where((T >= 40.0) & (T < 42.5), 90.0, 1.0), gap=cut)) is None


@pytest.mark.parametrize(
    ("heading", "seconds", "lost"), [(-46.0, 10.2, True), (44.0, 40.0, False), (90.0, 9.8, False)], ids=lambda x: str(x)
)
def test_a_heading_off_by_forty_five_degrees_for_ten_seconds_is_lost(
    heading: float, seconds: float, lost: bool
) -> None:
    found = scoring.lost_heading_at(errors(0.0, np.where((T >= 40.0) & (T < 40.0 + seconds), heading, 1.0)))
    assert found == (pytest.approx(40.0) if lost else None)


def test_a_heading_that_is_off_more_than_half_of_the_time_is_lost_though_never_for_long() -> None:
    for share, lost in ((5.2, True), (4.8, False)):
        off = np.where(T % 10.0 < share, 80.0, 0.0)
        assert (scoring.lost_heading_at(errors(0.0, off)) is not None) is lost
    short = T[:30]
    assert scoring.lost_heading_at(errors(0.0, 80.0, short)) == 0.0
    assert scoring.lost_heading_at(errors(0.0, 80.0, short[:20])) is None


def test_a_jump_of_the_reference_is_no_loss_of_heading() -> None:
    """The reference jumps by 70 deg at 50 s: the error is 70 deg from there on, and would be 0 without."""
    segment = (T >= 50.0).astype(np.int64)
    off = np.where(T >= 50.0, 70.0, 0.0)
    assert scoring.lost_heading_at(errors(0.0, off, segment=segment)) is None
    assert scoring.lost_heading_at(errors(0.0, off)) == pytest.approx(50.0)
    assert scoring.lost_heading_at(errors(0.0, 2.0 * np.where(T >= 70.0, 50.0, 0.0), segment=segment)) == pytest.approx(
        70.0
    )


def test_a_jump_at_a_reset_is_the_mean_of_a_second_on_either_side_within_its_segments() -> None:
    along = 0.01 * T + np.where(T >= 50.0, 1.0, 0.0)
    steps = scoring.reset_steps(errors(segment=(T >= 50.0).astype(np.int64)), along)
    assert np.flatnonzero(steps).tolist() == [500]
    assert steps[500] == pytest.approx(1.0 + 0.01 * 1.1, abs=2e-3)
    twice = np.searchsorted([50.0, 50.5], T + 1e-9, side="right")
    steps = scoring.reset_steps(errors(segment=twice), along)
    assert steps[500] == pytest.approx(1.0 + 0.01 * 0.75, abs=3e-3)
    assert abs(steps[505]) < 0.02
    gap = (T >= 50.0).astype(np.int64)
    assert not scoring.reset_steps(errors(segment=gap, gap=gap), along).any()


@pytest.mark.parametrize(
    ("degrees", "at", "flown", "aligned"),
    [(5.1, 30.0, 80.0, True), (4.9, 30.0, 80.0, False), (90.0, 61.0, 80.0, False), (90.0, 30.0, 25.0, False)],
)
def test_an_onboard_attitude_was_aligned_by_its_last_jump_before_the_flight(
    degrees: float, at: float, flown: float, aligned: bool
) -> None:
    i = round(10 * at)
    heading = np.where(np.arange(len(T)) >= i, np.radians(degrees), 0.0)
    attitude = Attitude(T, rotation.from_euler(0.0 * T, 0.0 * T, heading), "ATT")
    found = scoring.aligned_at(attitude, np.array([0, 50, i]), Segments([Segment("airborne", flown, 95.0)]))
    assert found == (pytest.approx(at) if aligned else None)
    assert scoring.aligned_at(attitude, np.zeros(0, np.int64), Segments([])) is None


def test_five_seconds_without_a_break_tell_whether_a_row_converged() -> None:
    assert scoring.convergence_observable(errors(t=T[:52]))
    assert not scoring.convergence_observable(errors(t=T[:49]))
    broken = np.concatenate([T[:40], 20.0 + T[:40]])
    assert not scoring.convergence_observable(errors(t=broken, gap=np.repeat([0, 1], 40)))


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
    found = errors(np.where(T < 7.0, 1.0 + size, 1.0))
    assert scoring.convergence_s(found, 0.0, False) == pytest.approx(converged)
    heading = errors(1.0, -np.where(T < 7.0, 2.5 * size, 0.0))
    assert scoring.convergence_s(heading, 0.0, True) == pytest.approx(converged)
    assert scoring.convergence_s(heading, 0.0, False) == 0.0


def test_more_than_sixty_seconds_are_no_convergence_and_a_later_start_counts_from_there() -> None:
    for until, took in ((59.0, 49.0), (69.0, 59.0), (71.0, None)):
        found = errors(np.where(T < until, 20.0, 1.0), scored=T >= 75.0)
        told = scoring.convergence_s(found, 10.0, False)
        assert told == (None if took is None else pytest.approx(took))
