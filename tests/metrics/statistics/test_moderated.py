"""Intervals that are too narrow and intervals that are too wide both fail here."""

import numpy as np
import pytest
from scipy import stats

from attlog.metrics.statistics import intervals as interval
from attlog.metrics.statistics import moderated
from attlog.metrics.statistics.moderated import Prior
from tests.conftest import few

PRIOR = Prior(0.25, 4.0)
RUNS = 6000
"""Coverage of 95 % is then known to 0.3 %."""


def of_the_model(rng, k, prior):
    """k values whose scatter differs from log to log as the prior says: variance = s0^2 nu0 / chi2(nu0)."""
    sigma = np.sqrt(prior.variance * prior.dof / rng.chisquare(prior.dof))
    return sigma * rng.standard_normal(k)


@pytest.mark.parametrize("k", few([1, 2, 4, 12], 2))
def test_the_interval_covers_95_percent_neither_less_nor_more(k):
    rng = np.random.default_rng(k)
    bounds = np.array([moderated.interval(of_the_model(rng, k, PRIOR), PRIOR) for _ in range(RUNS)])
    assert np.mean((bounds[:, 0] <= 0) & (bounds[:, 1] >= 0)) == pytest.approx(0.95, abs=0.01)


@pytest.mark.slow
def test_p_values_of_equal_rows_are_uniform():
    rng = np.random.default_rng(5)
    p = [moderated.p_values(of_the_model(rng, 3, PRIOR)[None], PRIOR)[0] for _ in range(RUNS)]
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_the_interval_is_smyths():
    x = np.array([0.3, -0.4, 1.1])
    s2 = (4 * 0.25 + 2 * np.var(x, ddof=1)) / 6
    half = stats.t.ppf(0.975, 6) * np.sqrt(s2 / 3)
    assert moderated.interval(x, PRIOR) == pytest.approx((x.mean() - half, x.mean() + half))
    assert moderated.p_values(x[None], PRIOR)[0] == pytest.approx(2 * stats.t.sf(x.mean() / np.sqrt(s2 / 3), 6))


def test_factors_of_noise_intervals_at_rest():
    """At one, two and four windows the interval reaches a factor of 2.0, 1.5 and 1.3 about the typical window."""
    scatter = np.sqrt(0.25)
    for k, factor in ((1, 2.0), (2, 1.5), (4, 1.35)):
        x = stats.norm.ppf((np.arange(k) + 0.5) / k)
        x = x / np.std(x, ddof=1) * scatter if k > 1 else x
        assert np.exp(0.5 * moderated.interval(x, PRIOR)[1]) == pytest.approx(factor, rel=0.08)


@pytest.mark.parametrize("k", [3, 5, 12])
def test_the_jackknife_interval_covers_95_percent_neither_less_nor_more(k):
    """Of a mean it is exact: without the t factor three events would cover 81 %."""
    rng = np.random.default_rng(k)
    hits = 0
    for _ in range(RUNS):
        x = rng.standard_normal(k)
        low, high = interval.of_jackknife(x.mean(), (x.sum() - x) / (k - 1))
        hits += low <= 0 <= high
    assert hits / RUNS == pytest.approx(0.95, abs=0.01)


@pytest.mark.parametrize("k", [3, 8])
def test_the_interval_of_pooled_powers_covers_95_percent_neither_less_nor_more(k):
    rng = np.random.default_rng(k)
    hits = 0
    for _ in range(RUNS):
        v = np.exp(0.1 * rng.standard_normal(k))
        low, high = interval.of_sigma_log(np.sqrt(v.mean()), v)
        hits += low <= np.exp(0.25 * 0.1**2) <= high
    assert hits / RUNS == pytest.approx(0.95, abs=0.012)


@pytest.mark.parametrize("k", [2, 6])
def test_the_t_interval_covers_95_percent_neither_less_nor_more(k):
    rng = np.random.default_rng(k)
    bounds = np.array([interval.of_mean(rng.standard_normal(k)) for _ in range(RUNS)])
    assert np.mean((bounds[:, 0] <= 0) & (bounds[:, 1] >= 0)) == pytest.approx(0.95, abs=0.01)
