"""What is scored starts late, pauses after restarts, ends at an impact; and all rows share it."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.reference import Options, choose, replayed, scoring
from attlog.segments.model import Segment

from .flights import RATE, SECONDS, estimate, flight

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
    row = replayed(log, found, choose(log, found, Options(declination=0.0)), estimate(t), name="made", uses_mag=True)
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
