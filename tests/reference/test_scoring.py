"""What is scored starts late, pauses after restarts, ends at an impact; and all rows share it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog import segments
from attlog.base import rotation
from attlog.reference import ReferenceOptions, choose, onboard_rows, replayed, scoring
from attlog.segments.model import Segment, Segments

from .flights import RATE, SECONDS, compared, estimate, flight

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


def test_the_first_fifteen_seconds_are_not_scored():
    t, _ = scored_times(flight())
    assert t.min() == pytest.approx(15.0, abs=0.051)
    assert t.max() > SECONDS - 0.1


def test_the_first_seconds_after_a_restart_are_not_scored_and_count_against_coverage():
    log = with_gap(25.0, 26.0)
    found = segments.build(log)
    found.segments.append(Segment("airborne", 20.0, SECONDS, "made"))
    t, coverage = scored_times(log, found)
    assert not np.any((t > 25.0) & (t < 41.0))
    assert t[t > 30.0].min() == pytest.approx(41.0, abs=0.06)
    assert coverage == pytest.approx(100 * (10 + 19) / 45, abs=1.0)


def test_a_short_gap_that_a_filter_bridges_costs_no_more_than_itself():
    t, coverage = scored_times(with_gap(25.0, 25.4))
    assert t[t > 25.3].min() == pytest.approx(25.4, abs=0.06)
    assert coverage is not None
    assert coverage > 98


def test_a_short_run_loses_a_third():
    assert scoring.settling(9.0) == 3.0
    assert scoring.settling(29.9) == pytest.approx(29.9 / 3)
    assert scoring.settling(30.0) == 15.0
    assert scoring.settling(0.0) == 0.0


def test_nothing_after_an_impact_is_scored_nor_missed():
    log = flight()
    found = segments.build(log)
    found.segments += [Segment("airborne", 20.0, 50.0, "made"), Segment("impact", 50.0, SECONDS, "made")]
    t, coverage = scored_times(log, found)
    assert t.max() <= 50.0
    assert coverage == pytest.approx(100.0, abs=0.5)


def test_a_log_without_rest_and_flight_is_covered_by_its_runs():
    log = flight()
    found = segments.build(log)
    found.segments = [s for s in found.segments if s.kind == "continuous"]
    assert scored_times(log, found)[1] == pytest.approx(100.0, abs=0.5)


def row_with(heading_deg, tilt_deg=0.0, uses_mag=True, log=None):
    """A row that is off by a heading and a tilt (over time) from the truth, measured."""
    return compared(log or flight(truth_hz=20.0), estimate(T, heading_deg, tilt_deg), uses_mag=uses_mag)[0]


def test_a_heading_beyond_45_deg_for_10_s_has_diverged_and_a_shorter_one_has_not():
    assert row_with(50.0).status == "diverged"
    assert "heading error above 45 deg for 10 s or half of the time from 15" in row_with(50.0).reason
    assert row_with(40.0).status == "ok"
    assert row_with(np.where((T > 30) & (T < 38), 60.0, 0.0)).status == "ok"
    assert row_with(np.where((T > 30) & (T < 42), 60.0, 0.0)).status == "diverged"


def test_a_heading_that_runs_round_has_diverged_though_it_never_stays_away():
    """A turn of the error every 12 s is beyond 45 deg for 9 s at a time."""
    assert row_with((30.0 * T) % 360.0).status == "diverged"
    assert row_with(np.where((T % 12.0) < 5.0, 60.0, 0.0)).status != "diverged"


def test_a_row_without_a_heading_of_its_own_does_not_diverge_in_heading():
    assert row_with(90.0, uses_mag=False).status == "ok"


def test_a_reset_of_the_reference_makes_no_row_diverge():
    """The onboard attitude jumps by 92 deg at 40 s; the row, right before, goes on."""
    log = flight()
    onboard = log.attitudes["ATT"]
    after = onboard.t >= 40.0
    onboard.q[after] = rotation.turn_about_down(onboard.q[after], np.radians(92.0))
    onboard.resets = np.array([int(np.argmax(after))])
    assert row_with(0.0, log=log).status == "ok"


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
    assert not scoring.scored(alone, np.array([16.0, 17.5])).any()
    assert scoring.scored(alone, np.array([18.5, 30.0])).all()


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


def test_flight_after_the_end_of_what_is_scored_is_not_missing_from_the_coverage():
    """An impact at 30 s ends the comparison of a flight from 10 to 50 s; of the 20 s before it 5 were lost."""
    t = np.arange(0.0, 60.0, 0.1)
    reference: Any = SimpleNamespace(scoring_start=10.0, end=30.0)
    counted = (t >= 10.0) & (t <= 25.0)
    flown = Segments([Segment("airborne", 10.0, 50.0)])
    covered = scoring.coverage_pct(t, np.zeros(len(t), np.int64), counted, reference, flown)
    assert covered == pytest.approx(75.0, abs=0.5)
