"""Where windows are laid, which samples fill one, and what counts as settling: closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import detrend  # type: ignore[import-untyped]

from attlog.base import rotation
from attlog.metrics.noise import variances, windows
from attlog.segments.model import Segment
from tests.metrics import flights


@pytest.mark.parametrize(
    ("length", "count"), [(4.9, 0), (4.96, 1), (9.9, 1), (9.96, 2), (30.0, 6)], ids=lambda x: str(x)
)
def test_a_span_has_a_window_for_each_five_seconds_from_its_start(length: float, count: int) -> None:
    laid = windows.lay((3.0, 3.0 + length), "hover")
    assert laid == [(3.0 + 5.0 * k, 8.0 + 5.0 * k) for k in range(count)]


def test_a_rest_of_two_seconds_is_one_window_and_no_hover_is() -> None:
    assert windows.lay((1.0, 3.0), "rest") == [(1.0, 3.0)]
    assert windows.lay((1.0, 5.9), "rest") == [(1.0, 5.9)]
    assert windows.lay((1.0, 2.9), "rest") == []
    assert windows.lay((1.0, 3.0), "hover") == []


def test_a_window_needs_twenty_samples_without_a_gap_up_to_both_ends() -> None:
    t = 0.02 * np.arange(1000)
    assert windows.filled(t, (5.0, 10.0)) == slice(250, 500)
    slow = 0.25 * np.arange(80)
    assert windows.filled(slow, (5.0, 10.0)) == slice(20, 40)
    assert windows.filled(slow, (5.0, 9.75)) is None
    for lost, filled in ((0.22, True), (0.28, False)):
        for begin in (5.0, 7.0):
            kept = t[(t < begin - 1e-9) | (t >= begin + lost - 1e-9)]
            assert (windows.filled(kept, (5.0, 10.0)) is not None) is filled
    for end, filled in ((9.75, True), (9.69, False)):  # 50 ms are nobody's
        assert (windows.filled(t[t < end], (5.0, 10.0)) is not None) is filled


def test_a_gap_of_slow_samples_is_longer_than_five_of_their_intervals() -> None:
    t = 0.1 * np.arange(400)
    for lost, filled in ((3, True), (5, False)):
        kept = np.delete(t, np.arange(70, 70 + lost))
        assert (windows.filled(kept, (5.0, 10.0)) is not None) is filled


def test_a_window_lies_in_one_segment_and_knows_every_number() -> None:
    x, segment = np.zeros((100, 4)), (np.arange(100) >= 60).astype(np.int64)
    assert windows.whole(slice(10, 60), x, segment) == slice(10, 60)
    assert windows.whole(slice(60, 99), x, segment) == slice(60, 99)
    assert windows.whole(slice(10, 61), x, segment) is None
    assert windows.whole(None, x, segment) is None
    x[40, 2] = np.nan
    assert windows.whole(slice(10, 60), x, segment) is None
    assert windows.whole(slice(10, 40), x, segment) == slice(10, 40)


def test_a_variance_about_a_line_has_two_degrees_of_freedom_less_and_tilt_is_the_mean_of_roll_and_pitch() -> None:
    residual = np.random.default_rng(1).normal(size=(7, 3)) * [1.0, 3.0, 5.0]
    squares = np.sum(residual**2, axis=0) / 5.0
    np.testing.assert_allclose(variances.variance(residual), [*squares, 0.5 * (squares[0] + squares[1])])


@pytest.mark.parametrize("column", [2, 3])
def test_leading_windows_of_more_than_four_times_the_later_median_settle(column: int) -> None:
    v = np.ones((8, 4))
    v[:3, column] = 50.0, 4.5, 3.9
    assert variances.unsettled(v) == 2
    v[:, :2] = 100.0 * np.arange(8, 0, -1)[:, None] ** 4.0  # roll and pitch alone settle nothing
    assert variances.unsettled(v) == 2
    assert variances.unsettled(np.ones((8, 4))) == 0


def test_where_every_window_settles_the_least_that_tell_stay() -> None:
    v = np.tile(10.0 ** -np.arange(8.0)[:, None], (1, 4))
    assert variances.unsettled(v) == 8 - variances.MIN_LATER
    assert variances.unsettled(v[:2]) == 0


@pytest.mark.parametrize(("phase", "left"), [("rest", 11), ("hover", 12)])
def test_windows_that_settle_are_left_out_at_rest_alone(phase: str, left: int) -> None:
    """A heading that swings by ten times as much in the first of twelve windows."""
    t = np.arange(0.0, 80.0, 0.02)
    size = np.radians(np.where(t < 25.0, 1.0, 0.1))
    q = rotation.from_euler(0.0 * t, 0.0 * t, size * np.sin(2.0 * np.pi * t))
    row = flights.row(t, q)
    found = [((20.0 + 5.0 * k, 25.0 + 5.0 * k), slice(1000 + 250 * k, 1250 + 250 * k)) for k in range(12)]
    residuals = list(variances.residuals_at_rest(row, [inside for _, inside in found]))
    part = variances._part(row, phase, [(w, r) for (w, _), r in zip(found, residuals, strict=True)])
    assert part is not None
    assert len(part.t0) == len(part.lengths) == len(part.variances) == left
    assert len(part.residuals) == 250 * left
    assert part.settled_s == (pytest.approx(25.0 - row.start) if phase == "rest" else None)


def test_a_row_is_measured_in_all_spans_of_a_phase_together() -> None:
    t = np.arange(0.0, 100.0, 0.02)
    q = rotation.from_euler(np.radians(0.1) * np.sin(2.0 * np.pi * t), 0.0 * t, 0.0 * t)
    row = flights.row(t, q)
    spans = [Segment("continuous", 0, 100), Segment("rest.long", 20, 41), Segment("rest.long", 60, 93)]
    found = variances.measured(flights.case([row], spans), row, "rest", "all")
    assert found is not None
    assert found.t0.tolist() == [20.0, 25.0, 30.0, 35.0, 60.0, 65.0, 70.0, 75.0, 80.0, 85.0]
    assert found.seconds == pytest.approx(50.0)
    assert np.sqrt(found.variances[:, 0]) == pytest.approx(0.1 / np.sqrt(2.0), rel=0.02)
    swing = 0.1 * np.sin(2.0 * np.pi * t)
    left = np.concatenate([detrend(swing[round(50 * a) : round(50 * a) + 250]) for a in found.t0])
    assert found.p2p[0] == pytest.approx(np.quantile(left, 0.999) - np.quantile(left, 0.001), rel=1e-3)
    assert found.p2p[1] < 1e-6
