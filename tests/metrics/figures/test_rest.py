"""The rest close up: noise without drift, and its spread counted."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.figures.rest import ORDERED, RestTraces, Scatter, close_up, residual, spreads
from attlog.metrics.figures.trace import Share
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 20.0, 0.01)


def angles(size: float, slope: float = 3.0, seed: int = 1) -> np.ndarray:
    """Three angles in deg with noise of a size and a drift."""
    return slope * T[:, None] + np.random.default_rng(seed).normal(0.0, size, (len(T), 3))


def drawn(case, row):
    traces = RestTraces(case, 1, [])
    traces.add(row)
    return traces.drawn()


def test_the_close_up_shows_noise_without_drift():
    flat = close_up("gyro", T, angles(0.01), Share.of([len(T)])).columns["roll"]
    assert np.std(flat) == pytest.approx(0.01, rel=0.1)
    assert np.abs(flat).max() < 0.06


def test_wander_slower_than_five_seconds_is_not_in_the_spread():
    slow = np.sin(2 * np.pi * T / 200.0)[:, None] * [1.0, 1.0]
    assert np.std(residual(T, angles(0.01)[:, :2] + slow)) == pytest.approx(0.01, rel=0.1)


def test_the_spread_counts_shares_of_samples_in_bins_common_to_all_rows():
    made = (angles(0.01), angles(0.02, seed=2))
    found = spreads([Scatter.of("filter", residual(T, x[:, :2]).ravel()) for x in made])
    np.testing.assert_array_equal(found[0].columns["angle"], found[1].columns["angle"])
    for trace, size in zip(found, (0.01, 0.02), strict=True):
        share = trace.columns["share"] / 100.0
        assert 0.97 < share.sum() <= 1.0
        assert np.sqrt(np.sum(share * trace.t**2) / share.sum()) == pytest.approx(size, rel=0.15)


def test_a_long_rest_is_counted_by_some_of_its_samples_as_by_all() -> None:
    long = np.random.default_rng(3).normal(0.0, 0.01, 300_000)
    some = Scatter.of("filter", long)
    assert len(some.ordered) == ORDERED
    (trace,) = spreads([some])
    half = 3.5 * np.std(long)
    whole = np.histogram(long, np.linspace(-half, half, len(trace.t) + 1))[0] / len(long) * 100.0
    np.testing.assert_allclose(trace.columns["share"], whole, atol=0.011)


def test_a_row_that_settles_after_the_rest_has_no_close_up(monkeypatch):
    row = flights.row(T, np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1)))
    case = flights.case([row], [Segment("rest.long", 0.0, 4.0, "still")])
    monkeypatch.setattr("attlog.metrics.figures.rest.own_start", lambda case, row: 9.0)
    assert drawn(case, row) == []
    monkeypatch.setattr("attlog.metrics.figures.rest.own_start", lambda case, row: 1.0)
    assert [t.figure for t in drawn(case, row)] == ["rest", "spread"]
