"""Means of groups and quantiles of ordered values are numpy's."""

import numpy as np
import pytest
from scipy import stats

from attlog.metrics.figures.steps import of_known
from attlog.metrics.statistics import intervals as interval


def test_means_of_groups_are_those_of_each_group_wherever_it_lies():
    x = np.random.default_rng(0).standard_normal(50)
    groups = [slice(3, 10), slice(10, 11), slice(20, 50)]
    np.testing.assert_allclose(interval.means(x, groups), [x[g].mean() for g in groups], rtol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 7, 100])
def test_a_quantile_of_ordered_values_is_that_of_numpy(n):
    x = np.random.default_rng(n).standard_normal(n)
    for p in (0.0, 0.1, 0.5, 0.95, 1.0):
        assert interval.quantile(np.sort(x), p) == pytest.approx(np.quantile(x, p), rel=1e-12, abs=1e-12)


def test_the_interval_of_a_quantile_needs_no_second_sorting():
    x = np.random.default_rng(2).standard_normal(400)
    groups = interval.equal_groups(400, 10)
    assert interval.of_quantile(x, 0.9, groups, np.sort(x)) == interval.of_quantile(x, 0.9, groups)


def test_quantiles_of_what_is_known_are_those_of_numpy():
    x = np.random.default_rng(1).standard_normal((9, 40))
    x[np.random.default_rng(2).random(x.shape) < 0.5] = np.nan
    x[0] = 1.0
    np.testing.assert_allclose(of_known(x, (0.1, 0.5, 0.9)), np.nanquantile(x, (0.1, 0.5, 0.9), axis=0), rtol=1e-12)


def test_sums_of_ranges_are_those_of_each_range_empty_ones_too():
    x = np.random.default_rng(3).standard_normal(20)
    first, last = np.array([0, 3, 3, 18, 20, 5]), np.array([4, 3, 9, 20, 20, 5])
    wanted = [x[a:b].sum() for a, b in zip(first, last, strict=True)]
    np.testing.assert_allclose(interval.sums(x, first, last), wanted, atol=1e-14)
    assert len(interval.sums(x, first[:0], last[:0])) == 0


def test_neighbours_that_do_not_resemble_each_other_widen_nothing():
    x = np.array([1.0, -1.0] * 6)
    assert interval.of_neighbours(x) == pytest.approx(interval.of_mean(x))
    assert interval.of_neighbours([1.0]) is None
    assert interval.of_neighbours([2.0, 2.0, 2.0]) == (2.0, 2.0)


def test_neighbours_that_resemble_each_other_widen_as_a_first_order_process():
    x = np.array([1.0, 1.0, -1.0, -1.0] * 10)  # neighbours alike in 20 of 39 cases: r = 1/40, and 1/40 for its bias
    wider = np.diff(interval.of_neighbours(x)) / np.diff(interval.of_mean(x))
    assert wider == pytest.approx(np.sqrt(1.05 / 0.95))
    slow = np.repeat([1.0, -1.0], 10)
    assert np.diff(interval.of_neighbours(slow)) / np.diff(interval.of_mean(slow)) == pytest.approx(2.0)


def test_a_jackknife_of_means_is_the_t_interval_of_the_values():
    """Leaving one value out of a mean: the jackknife's error is the standard error, exactly."""
    x = np.random.default_rng(4).standard_normal(12)
    left_out = (x.sum() - x) / 11
    half = stats.t.ppf(0.975, 11) * x.std(ddof=1) / np.sqrt(12)
    assert interval.of_jackknife(x.mean(), left_out) == pytest.approx((x.mean() - half, x.mean() + half), rel=1e-6)


@pytest.mark.parametrize("left_out", [[1.0, 2.0], [1.0, 2.0, np.inf], [1.0, np.nan, 2.0, 3.0]])
def test_a_jackknife_of_too_few_or_of_values_that_are_none_tells_nothing(left_out):
    assert interval.of_jackknife(1.0, left_out) is None
