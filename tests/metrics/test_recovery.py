"""Coverage, convergence and the log's own floor: answers of the whole log, not of its windows."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import Imu, Mag, Stream
from attlog.metrics import recovery
from attlog.segments.model import Segment
from tests.metrics import flights

CONVERGENCE_T = np.arange(0.0, 60.0, 0.02)


def answers(window: str, coverage: float | None = 80.0):
    level = rotation.from_euler(0 * CONVERGENCE_T, 0 * CONVERGENCE_T, 0.3)
    row = flights.row(CONVERGENCE_T, rotation.from_euler(np.radians(1.0) + 0 * CONVERGENCE_T, 0 * CONVERGENCE_T, 0.3))
    case = flights.case([row], [Segment("continuous", 0, 60)], (CONVERGENCE_T[::2], level[::2]), scoring_start=10.0)
    row.coverage_pct = coverage
    return recovery.compute_convergence(case, row, window)


def test_the_whole_log_has_them_all_and_a_window_none():
    assert set(answers("all")) == {m.name for m in recovery.CONVERGENCE_METRICS}
    assert answers("rest") == answers("airborne") == {}


def test_coverage_is_the_rows_or_missing_where_nothing_counts():
    assert answers("all")["coverage_pct"].value == pytest.approx(80.0)
    assert answers("all", None)["coverage_pct"].code == "not_covered"


def test_the_floor_is_the_references_and_never_ranked():
    floor = answers("all")["replay_floor_deg"]
    assert floor.value is not None
    assert not floor.ranked


RECOVERY_T = np.arange(0.0, 100.0, 0.02)
SEGMENTS = [Segment("continuous", 0, 100), Segment("airborne", 10, 100)]


def recovered(tilt_deg, force=1.0, vibration=0.0):
    """The answer of a row with this tilt error, in a flight with ``force`` g from 50 to 52 s."""
    level = rotation.from_euler(0 * RECOVERY_T, 0 * RECOVERY_T, 0.7)
    row = flights.row(RECOVERY_T, rotation.from_euler(np.radians(tilt_deg) + 0 * RECOVERY_T, 0 * RECOVERY_T, 0.7))
    case = flights.case([row], SEGMENTS, (RECOVERY_T[::2], level[::2]), scoring_start=15.0)
    size = np.where((RECOVERY_T >= 50) & (RECOVERY_T < 52), force, 1.0) + vibration * np.sin(
        2 * np.pi * 20.0 * RECOVERY_T
    )
    acc = Stream(RECOVERY_T, -9.81 * size[:, None] * [0.0, 0.0, 1.0], "m/s^2", "FRD", "imu")
    case.log.imus, case.log.imu = (
        [Imu(0, Stream(RECOVERY_T, np.zeros((len(RECOVERY_T), 3)), "rad/s", "FRD", "imu"), acc)],
        0,
    )
    return recovery.compute_recovery(case, row, "all")["recovery_s"]


def test_recovery_lasts_until_the_error_is_within_2_deg_of_what_it_was():
    """12 deg at 52 s, falling by 1 deg/s onto 1 deg: back at 3 deg after 9 s."""
    error = np.where(RECOVERY_T < 50, 1.0, np.where(RECOVERY_T < 52, 12.0, np.maximum(12.0 - (RECOVERY_T - 52.0), 1.0)))
    answer = recovered(error, force=1.8)
    assert answer.value == pytest.approx(9.0, abs=0.15)
    assert answer.detail["from_s"] == pytest.approx(50.0, abs=0.1)
    assert not answer.ranked


def test_a_row_that_never_left_recovers_at_once():
    assert recovered(1.0, force=1.8).value == 0.0


def test_a_row_that_stays_away_has_not_recovered():
    assert recovered(np.where(RECOVERY_T < 50, 1.0, 12.0), force=1.8).code == "not_converged"


@pytest.mark.parametrize("disturbed", [{"force": 1.2}, {"force": 1.0, "vibration": 0.6}])
def test_a_small_manoeuvre_and_vibration_are_no_disturbance(disturbed):
    assert recovered(1.0, **disturbed).code == "no_events"


def test_a_row_is_back_only_where_it_stays_for_a_second():
    t = np.arange(0.0, 30.0, 0.02)
    short = (t >= 12.0) & (t < 12.995)  # its samples span 0.98 s
    error = np.where((t < 10.0) | short | (t >= 15.0), 0.0, 10.0)
    assert recovery.time_back(t, error, (10.0, 11.0)) == pytest.approx(4.0)
    error[(t >= 12.995) & (t < 13.005)] = 0.0
    assert recovery.time_back(t, error, (10.0, 11.0)) == pytest.approx(1.0)


def test_a_row_that_comes_back_at_the_very_end_of_a_log_is_back():
    t = np.arange(0.0, 20.0, 0.02)
    assert recovery.time_back(t, np.where((t < 10.0) | (t >= 18.0), 0.0, 10.0), (10.0, 11.0)) == pytest.approx(7.0)


def test_of_two_disturbances_the_larger_one_counts():
    force = np.where(
        (RECOVERY_T >= 20) & (RECOVERY_T < 21), 1.5, np.where((RECOVERY_T >= 60) & (RECOVERY_T < 64), 2.0, 1.0)
    )
    assert recovery.largest(RECOVERY_T, force[:, None] * [0.0, 0.0, -9.81], 9.81) == pytest.approx(
        (60.0, 64.0), abs=0.05
    )


@pytest.mark.parametrize(("seconds", "kind"), [(8.0, "mag"), (1.0, "acc")])
def test_of_a_manoeuvre_and_a_magnetic_disturbance_the_longer_one_counts(monkeypatch, seconds, kind):
    found = {"acc": (50.0, 52.0), "mag": (70.0, 70.0 + seconds)}
    monkeypatch.setattr(recovery, "disturbances", lambda case: found)
    assert recovered(1.0, force=1.8).detail["disturbance"] == kind


def test_a_row_without_a_compass_recovers_from_no_magnetic_disturbance(monkeypatch):
    monkeypatch.setattr(recovery, "disturbances", lambda case: {"mag": (70.0, 78.0)})
    row = flights.row(RECOVERY_T, rotation.from_euler(0 * RECOVERY_T, 0 * RECOVERY_T, 0.7))
    case = flights.case([row], SEGMENTS, (row.t, row.q), scoring_start=15.0)
    assert recovery.compute_recovery(case, row, "all")["recovery_s"].detail["disturbance"] == "mag"
    row.uses_mag = False
    assert recovery.compute_recovery(case, row, "all")["recovery_s"].code == "no_events"


def test_a_magnetic_disturbance_is_when_the_compass_measured_it_and_not_when_it_was_told():
    row = flights.row(RECOVERY_T, rotation.from_euler(0 * RECOVERY_T, 0 * RECOVERY_T, 0.7))
    case = flights.case([row], SEGMENTS, (row.t, row.q), scoring_start=15.0)
    size = np.where((RECOVERY_T >= 50.0) & (RECOVERY_T < 54.0), 80e-6, 50e-6)
    field = Stream(RECOVERY_T + 0.5, size[:, None] * [1.0, 0.0, 0.0], "T", "FRD", "mag", t_sample=RECOVERY_T)
    case.log.mags, case.log.mag = [Mag(0, field)], 0
    assert recovery.disturbances(case) == {"mag": pytest.approx((50.0, 54.0), abs=0.1)}
