"""Means of groups and quantiles of ordered values are numpy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from attlog.metrics import statistics
from attlog.metrics.statistics import VariancePrior
from attlog.metrics.traces import known_steps

DOFS = (0.7, 1.0, 2.0, 3.3, 10.0, 55.5, 300.0, 1e4)
PROBABILITIES = (0.001, 0.025, 0.05, 0.5, 0.95, 0.975, 0.999)


@pytest.mark.parametrize("dof", DOFS)
def test_chi_square_quantiles_are_those_of_scipy(dof):
    ours = [statistics.chi_square(p, dof) for p in PROBABILITIES]
    np.testing.assert_allclose(ours, stats.chi2.ppf(PROBABILITIES, dof), rtol=1e-7)


@pytest.mark.parametrize("dof", DOFS)
def test_student_quantiles_are_those_of_scipy(dof):
    ours = [statistics.student(p, dof) for p in PROBABILITIES]
    np.testing.assert_allclose(ours, stats.t.ppf(PROBABILITIES, dof), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("dof", [*DOFS, 4.0, 35.0])
def test_tails_are_those_of_scipy(dof):
    t = np.array([0.0, 1e-300, np.inf, *np.geomspace(1e-6, 1e6, 40), *np.linspace(0.1, 5.0, 40)])
    found = statistics.students_two_sided(t, dof)
    np.testing.assert_allclose(found, 2 * stats.t.sf(t, dof), rtol=1e-6, atol=1e-12)
    assert np.isnan(statistics.students_two_sided(np.array([np.nan]), dof)[0])
    assert len(statistics.students_two_sided(t[:0], dof)) == 0


@pytest.mark.parametrize("n", [1, 2, 7, 100])
def test_a_quantile_of_ordered_values_is_that_of_numpy(n):
    x = np.random.default_rng(n).standard_normal(n)
    for p in (0.0, 0.1, 0.5, 0.95, 1.0):
        assert statistics.quantile(np.sort(x), p) == pytest.approx(np.quantile(x, p), rel=1e-12, abs=1e-12)


def test_quantiles_of_what_is_known_are_those_of_numpy():
    x = np.random.default_rng(1).standard_normal((9, 40))
    x[np.random.default_rng(2).random(x.shape) < 0.5] = np.nan
    x[0] = 1.0
    np.testing.assert_allclose(known_steps(x, (0.1, 0.5, 0.9)), np.nanquantile(x, (0.1, 0.5, 0.9), axis=0), rtol=1e-12)


def test_sums_of_ranges_are_those_of_each_range_empty_ones_too():
    x = np.random.default_rng(3).standard_normal(20)
    first, last = np.array([0, 3, 3, 18, 20, 5]), np.array([4, 3, 9, 20, 20, 5])
    wanted = [x[a:b].sum() for a, b in zip(first, last, strict=True)]
    np.testing.assert_allclose(statistics.group_sums(x, first, last), wanted, atol=1e-14)
    assert len(statistics.group_sums(x, first[:0], last[:0])) == 0


def test_neighbours_that_do_not_resemble_each_other_widen_nothing():
    x = np.array([1.0, -1.0] * 6)
    assert statistics.neighbour_interval(x) == pytest.approx(statistics.mean_interval(x))
    assert statistics.neighbour_interval([1.0]) is None
    assert statistics.neighbour_interval([2.0, 2.0, 2.0]) == (2.0, 2.0)


def test_an_error_that_does_not_change_is_known_by_a_factor_of_two():
    """Without changes the variance is 2 * 1.3 / 5 for the difference of two records, half of it for one."""
    low, high = statistics.wandering_interval(3.0, [0.0, 0.0, 0.0])
    factor = np.exp(0.5 * stats.t.ppf(0.975, 5) * np.sqrt(0.5 * 2 * 1.3 / 5))
    assert (low, high) == pytest.approx((3.0 / factor, 3.0 * factor))
    assert factor == pytest.approx(1.93, abs=0.01)


@pytest.mark.parametrize(("half", "sigma", "wanted"), [(0.0, 0.1, 0.2), (0.3, 0.2, 0.5), (0.3, 0.0, 0.3)])
def test_the_sigma_of_a_reference_adds_in_quadrature_twice(half, sigma, wanted):
    assert statistics.widen_by_reference(1.0, (1.0 - half, 1.0 + half), sigma) == pytest.approx(
        (1.0 - wanted, 1.0 + wanted)
    )


def test_a_jackknife_of_means_is_the_t_interval_of_the_values():
    """Leaving one value out of a mean: the jackknife's error is the standard error, exactly."""
    x = np.random.default_rng(4).standard_normal(12)
    left_out = (x.sum() - x) / 11
    half = stats.t.ppf(0.975, 11) * x.std(ddof=1) / np.sqrt(12)
    assert statistics.jackknife_interval(x.mean(), left_out) == pytest.approx(
        (x.mean() - half, x.mean() + half), rel=1e-6
    )


@pytest.mark.parametrize("left_out", [[1.0, 2.0], [1.0, 2.0, np.inf], [1.0, np.nan, 2.0, 3.0]])
def test_a_jackknife_of_too_few_or_of_values_that_are_none_tells_nothing(left_out):
    assert statistics.jackknife_interval(1.0, left_out) is None


PRIOR = VariancePrior(0.25, 4.0)


def test_the_interval_is_smyths():
    x = np.array([0.3, -0.4, 1.1])
    s2 = (4 * 0.25 + 2 * np.var(x, ddof=1)) / 6
    half = stats.t.ppf(0.975, 6) * np.sqrt(s2 / 3)
    assert statistics.moderated_interval(x, PRIOR) == pytest.approx((x.mean() - half, x.mean() + half))
    assert statistics.moderated_p_value(x[None], PRIOR)[0] == pytest.approx(
        2 * stats.t.sf(x.mean() / np.sqrt(s2 / 3), 6)
    )
