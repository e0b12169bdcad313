"""An envelope loses no peak and no gap, within what the figure may hold."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from attlog.kernels.loops import function_of
from attlog.metrics.figures.trace import BUDGET, EXTREMES, Budget, Share, envelope, extremes

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


def test_extremes_stand_in_the_order_they_came():
    rising = np.arange(1000.0)
    _, kept = envelope(rising, np.column_stack([rising, -rising]), 100)
    assert np.all(np.diff(kept[:, 0]) > 0)
    assert np.all(np.diff(kept[:, 1]) < 0)


def test_without_a_compiler_the_loop_gives_the_same():
    x = np.random.default_rng(1).standard_normal((500, 2))
    x[[7, 300], [0, 1]] = np.nan, np.inf
    edges = np.linspace(0, 500, 41).astype(np.int64)
    compiled, plain = np.empty((80, 2)), np.empty((80, 2))
    function_of(EXTREMES, extremes)(compiled, x, edges)
    extremes(plain, x, edges)
    np.testing.assert_array_equal(compiled, plain)
    assert np.isnan(plain).any(axis=0).all()


def test_rows_share_what_a_figure_may_hold_by_their_length():
    share = Share.of([1_000_000, 1_000_000, 40_000])
    assert 2 * share(1_000_000) + share(40_000) <= 1.01 * BUDGET
    assert share(40_000) < share(1_000_000)
    assert Share.of([1000, 500])(1000) == 1000


def test_rows_that_pass_one_by_one_get_the_shares_they_get_together() -> None:
    replays, others = [300_000] * 3, [40_000, 10_000]
    together = Share.of([*replays, *others])
    budget = Budget(len(replays), sum(others))
    assert [budget.share(n, True)(n) for n in replays] == [together(n) for n in replays]
    assert [budget.share(n, False)(n) for n in others] == [together(n) for n in others]
