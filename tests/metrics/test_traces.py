"""An envelope loses no peak and no gap, within what the figure may hold."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import signal

import attlog
from attlog.core import rotation
from attlog.flight.model import Attitude, Imu, Stream
from attlog.metrics.step_error import Curve
from attlog.metrics.step_turning import StepEvent
from attlog.metrics.trace import (
    BUDGET,
    MAX_BUCKETS,
    G,
    SampleBudget,
    clipped_samples,
    envelope,
    extremes,
    ground,
    periodogram,
    size_of,
    vibration,
)
from attlog.metrics.traces import (
    GRID_S,
    RestTraces,
    Scatter,
    close_up,
    demand_traces,
    in_percent,
    representative,
    residual,
    spreads,
    step_statistics,
)
from attlog.report.first_screen import flight_strip
from attlog.segments.model import Segment
from tests.metrics import flights

FINITE = st.floats(-180, 180, width=32)


@settings(deadline=None)  # the first call may compile
@given(hnp.arrays(np.float64, st.integers(1, 400), elements=FINITE), st.integers(2, 300))
def test_reduction_keeps_the_extremes_within_the_budget(y, keep):
    t, kept = envelope(np.arange(len(y)) * 0.01, y[:, None], keep)
    assert len(t) == len(kept) <= max(keep, 2)
    assert np.max(kept) == np.max(y)
    assert np.min(kept) == np.min(y)
    assert np.all(np.diff(t) >= 0)


def test_a_gap_stays_a_gap():
    y = np.sin(np.arange(10_000) / 50)
    y[5000] = np.nan
    _, kept = envelope(np.arange(10_000) * 0.01, np.column_stack([y, np.full(10_000, np.nan)]), 500)
    assert np.isnan(kept[:, 0]).sum() == 1
    assert np.isnan(kept[:, 1]).all()


def test_without_a_compiler_the_loop_gives_the_same():
    x = np.random.default_rng(1).standard_normal((500, 2))
    x[[7, 300], [0, 1]] = np.nan, np.inf
    edges = np.linspace(0, 500, 41).astype(np.int64)
    compiled, plain = np.empty((80, 2)), np.empty((80, 2))
    extremes(compiled, x, edges)
    extremes.function(plain, x, edges)
    np.testing.assert_array_equal(compiled, plain)
    assert np.isnan(plain).any(axis=0).all()


def test_rows_share_what_a_figure_may_hold_by_their_length():
    replays, others = [1_000_000] * 2, [40_000, 10_000]
    budget = SampleBudget(len(replays), sum(others))
    kept = [budget.keep(n, True) for n in replays] + [budget.keep(n, False) for n in others]
    assert 0.95 * BUDGET <= sum(kept) <= 1.05 * BUDGET
    assert kept[0] == kept[1] > kept[2] == 2000
    assert SampleBudget(0, 1500).keep(1000, False) == 1000


# The sensors' own figures: spectra against scipy, clipping, sizes that keep their peaks.

RATE = 200.0


def imu(acc: np.ndarray) -> Imu:
    """A unit with the given accelerometer at 200 Hz."""
    t = np.arange(len(acc)) / RATE
    return Imu(0, Stream(t, np.zeros_like(acc), "rad/s", "FRD", "IMU"), Stream(t, acc, "m/s^2", "FRD", "IMU"))


@pytest.mark.parametrize("n", [512, 511])
def test_a_spectrum_is_that_of_scipy(n):
    x = np.random.default_rng(2).normal(0.0, 1.0, (n, 2)) + np.arange(n)[:, None] * [0.01, -0.02]
    expected = signal.welch(x, RATE, "hann", n, 0, detrend="linear", axis=0)[1]
    np.testing.assert_allclose(periodogram(x, 1 / RATE)[1:], expected[1:], rtol=1e-9)


def test_vibration_is_the_deviation_within_a_second_and_counts_clipped_samples_there():
    t = np.arange(0, 10, 1 / RATE)
    acc = np.column_stack([0.0 * t, 0.0 * t, -G + np.where(t > 5, 3.0, 0.0) * np.sin(2 * np.pi * 20 * t)])
    acc[1700, 0] = 16 * G
    trace = vibration(imu(acc))[0]
    calm, shaken = trace.columns["z"][trace.t < 4.9], trace.columns["z"][trace.t > 6]
    assert calm.max() < 1e-9
    np.testing.assert_allclose(shaken, 3 / np.sqrt(2), rtol=0.01)
    assert trace.columns["clipped"].sum() == trace.values["samples"] == 1
    assert trace.t[np.argmax(trace.columns["clipped"])] == pytest.approx(8.5, abs=0.5)


def test_a_strong_movement_that_reaches_no_full_scale_is_not_clipped():
    assert not clipped_samples(np.array([[0.0, 0.0, -G], [120.0, 0.0, 0.0]])).any()
    assert clipped_samples(np.array([[0.0, 0.0, -G], [-8 * G, 0.0, 0.0]])).tolist() == [False, True]


def test_the_size_keeps_its_mean_and_its_peaks():
    t = np.arange(0, 3600.0, 0.02)
    size = np.full(len(t), 9.8)
    size[77_777], size[99_999] = 60.0, np.nan
    trace = size_of("gravity", t, size, {})
    assert len(trace.t) <= MAX_BUCKETS + 1
    assert trace.columns["high"].max() == 60.0
    assert np.median(trace.columns["mean"]) == pytest.approx(9.8)
    assert np.isfinite(trace.columns["mean"]).all()


# The height over a flight is that over the ground it stood on, though its barometer drifts.

HEIGHT_T = np.arange(0.0, 200.0, 0.1)
FLIGHT = (50.0, 150.0)


def test_a_drift_of_the_barometer_is_no_height() -> None:
    true = 8.0 * ((HEIGHT_T > FLIGHT[0] + 1) & (HEIGHT_T < FLIGHT[1] - 1))
    x = 100.0 + 0.02 * HEIGHT_T + true
    above = x - ground(Stream(HEIGHT_T, x[:, None], "m", "", "BARO"), [FLIGHT])
    inside = (HEIGHT_T > FLIGHT[0] + 1) & (HEIGHT_T < FLIGHT[1] - 1)
    assert np.abs(above[inside] - 8.0).max() < 0.1


def test_where_a_log_ends_in_the_air_there_is_no_ground() -> None:
    x = np.where(HEIGHT_T < 50.0, 100.0, 130.0)
    above = x - ground(Stream(HEIGHT_T, x[:, None], "m", "", "BARO"), [(50.0, HEIGHT_T[-1] - 0.15)])
    assert (above[HEIGHT_T > 51.0] == 30.0).all()


@pytest.mark.parametrize("name", ["copter_heading_28deg_off.BIN", "px4_1.8_hexa.ulg"])
def test_the_strip_tells_the_height_of_the_headline(corpus: Path, name: str) -> None:
    """The rangefinder of the first saw 11 m in all the flight, where its barometer peaked at 13 m in wind."""
    result = attlog.analyze(corpus / "logs" / "cases" / name, attlog.Config(estimators=("mahony",)))
    said = re.search(r"up to ([\d.]+ m)\b", result.headline)
    assert said is not None, result.headline
    assert flight_strip(result).top == said.group(1)


# The set-point over the flight: while armed, with its gaps, in the axes of the rows.

SETPOINT_T = np.arange(0.0, 60.0, 0.1)


def rolled(t: np.ndarray, deg: float = 10.0) -> np.ndarray:
    """A constant roll."""
    return rotation.from_rotvec(np.tile(np.radians([deg, 0.0, 0.0]), (len(t), 1)))


def asked(t: np.ndarray = SETPOINT_T, armed: tuple[float, float] = (10.0, 50.0)):
    """A case whose log holds a set-point."""
    case = flights.case([], [Segment("continuous", 0.0, 60.0), Segment("armed", *armed)])
    case.log.setpoints.attitude = Attitude(t, rolled(t), "ATT.Des")
    return case


def test_the_set_point_is_drawn_while_armed():
    found = demand_traces(asked())[0]
    assert (found.figure, found.row) == ("demand", "")
    assert found.t[[0, -1]] == pytest.approx([10.0, 50.0], abs=0.11)
    assert found.columns["roll"] == pytest.approx(10.0)


def test_a_pause_of_the_logger_breaks_the_line():
    found = demand_traces(asked(SETPOINT_T[(SETPOINT_T < 20.0) | (SETPOINT_T > 30.0)]))[0]
    assert np.isnan(found.columns["heading"]).sum() == 1


def test_the_trim_is_taken_out_as_of_the_rows():
    case = asked()
    case.reference.alignment.trim = np.radians([2.0, 0.0, 0.0])
    assert demand_traces(case)[0].columns["roll"] == pytest.approx(8.0)
    case.log.setpoints.attitude.has_trim = True
    assert demand_traces(case)[0].columns["roll"] == pytest.approx(10.0)


# The rest close up: noise without drift, and its spread counted.

REST_T = np.arange(0.0, 20.0, 0.01)


def angles(size: float, slope: float = 3.0, seed: int = 1) -> np.ndarray:
    """Three angles in deg with noise of a size and a drift."""
    return slope * REST_T[:, None] + np.random.default_rng(seed).normal(0.0, size, (len(REST_T), 3))


def drawn(case, row):
    traces = RestTraces(case, 1, [])
    traces.add(row)
    return traces.drawn()


def test_the_close_up_shows_noise_without_drift():
    flat = close_up("gyro", REST_T, angles(0.01), len(REST_T)).columns["roll"]
    assert np.std(flat) == pytest.approx(0.01, rel=0.1)
    assert np.abs(flat).max() < 0.06


def test_wander_slower_than_five_seconds_is_not_in_the_spread():
    slow = np.sin(2 * np.pi * REST_T / 200.0)[:, None] * [1.0, 1.0]
    assert np.std(residual(REST_T, angles(0.01)[:, :2] + slow)) == pytest.approx(0.01, rel=0.1)


def test_the_spread_counts_shares_of_samples_in_bins_common_to_all_rows():
    made = (angles(0.01), angles(0.02, seed=2))
    found = spreads([Scatter.of("filter", residual(REST_T, x[:, :2]).ravel()) for x in made])
    np.testing.assert_array_equal(found[0].columns["angle"], found[1].columns["angle"])
    for trace, size in zip(found, (0.01, 0.02), strict=True):
        share = trace.columns["share"] / 100.0
        assert 0.97 < share.sum() <= 1.0
        assert np.sqrt(np.sum(share * trace.t**2) / share.sum()) == pytest.approx(size, rel=0.15)


def test_a_row_that_settles_after_the_rest_has_no_close_up(monkeypatch):
    row = flights.row(REST_T, np.tile([1.0, 0.0, 0.0, 0.0], (len(REST_T), 1)))
    case = flights.case([row], [Segment("rest.long", 0.0, 4.0, "still")])
    monkeypatch.setattr("attlog.metrics.traces.own_start", lambda case, row: 9.0)
    assert drawn(case, row) == []
    monkeypatch.setattr("attlog.metrics.traces.own_start", lambda case, row: 1.0)
    assert [t.figure for t in drawn(case, row)] == ["rest", "spread"]


# Movements as figures draw them: the one of middle size, and what all have in common.


def event(axis: int, onset: float, delta: float) -> StepEvent:
    """A movement that takes 0.3 s."""
    return StepEvent(axis, onset, onset + 0.15, onset + 0.3, delta, onset - 0.5, onset + 1.5)


def curve(stroke: float, error_share: float) -> Curve:
    """A movement of which a row misses a share from the onset on."""
    t = np.arange(-0.4, 1.4, 0.01)
    moved = abs(stroke) * np.clip(t / 0.3, 0.0, 1.0)
    return Curve(event(0, 10.0, stroke), 10.0 + t, moved, error_share * moved)


def test_the_representative_movement_is_the_median_of_the_axis_that_moved_most(monkeypatch):
    events = [event(0, 1, 10), event(0, 5, -30), event(0, 9, 20), event(1, 13, 90), event(1, 17, 91)]
    monkeypatch.setattr("attlog.metrics.step_turning.reference_steps", lambda case: events)
    found = representative(flights.case([], []))
    assert found == events[2]


def test_movements_are_compared_by_their_share_of_the_stroke_with_the_band_of_the_middle_eighty_percent():
    row = flights.row(np.arange(3.0), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
    shares = np.linspace(-0.3, 0.1, 11)
    trace = step_statistics(row, *in_percent([curve(20.0 + 3 * k, s) for k, s in enumerate(shares)]), "roll")
    late = np.flatnonzero((GRID_S > 0.4) & np.isfinite(trace.columns["median"]))
    assert len(late) > 50
    np.testing.assert_allclose(trace.columns["median"][late], -10.0, atol=1e-6)
    np.testing.assert_allclose(trace.columns["low"][late], -26.0, atol=1e-6)
    np.testing.assert_allclose(trace.columns["high"][late], 6.0, atol=1e-6)
    np.testing.assert_allclose(trace.columns["ref"][late], 100.0, atol=1e-6)
    assert trace.columns["median"][np.searchsorted(GRID_S, 0.0)] == pytest.approx(0.0, abs=0.5)
    assert trace.values["events"] == 11
