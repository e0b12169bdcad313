import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from attlog.metrics.answer import Answer
from attlog.metrics.ranking import best as ranking
from attlog.metrics.statistics import pairs
from attlog.metrics.statistics.quantiles import student_two_sided
from attlog.metrics.statistics.units import UnitValues, ids_of
from tests.conftest import few


def units(kind, values, first=0):
    return UnitValues(kind, ids_of(np.arange(first, first + len(values))), np.asarray(values, float), None)


def p_of(kind, x, y):
    a, b = units(kind, x), units(kind, y)
    return pairs.p_value(a, b, a.ids)


@pytest.mark.parametrize(("t", "dof"), [(0.0, 3), (1.0, 1), (-2.5, 7.5), (12.0, 4)])
def test_tails_of_students_t_are_those_of_scipy(t, dof):
    assert student_two_sided(t, dof) == pytest.approx(2 * stats.t.sf(abs(t), dof), rel=1e-9)


def test_drifts_are_compared_by_size_whatever_their_sign():
    rng = np.random.default_rng(0)
    a, b = 5 + 0.1 * rng.standard_normal(6), -5 + 0.1 * rng.standard_normal(6)
    assert p_of("slope_group", a, b) > 0.05  # 5 to the left is as bad as 5 to the right
    assert p_of("slope_group", a, b / 5) < 1e-3
    expected = max(stats.ttest_1samp(a - b / 5, 0).pvalue, stats.ttest_1samp(a + b / 5, 0).pvalue)
    assert p_of("slope_group", a, b / 5) == pytest.approx(expected, rel=1e-6)


def test_lags_are_compared_by_the_jackknife_of_their_difference():
    """Pseudo-values of a ratio: the t test on them is the delete-one jackknife."""
    rng = np.random.default_rng(1)
    n = 8
    rate = 1 + 0.2 * rng.standard_normal(n)
    lags, pseudo = [], []
    for true in (10.0, 12.0):
        moved = rate * true + 0.3 * rng.standard_normal(n)
        whole = moved.sum() / rate.sum()
        left_out = (moved.sum() - moved) / (rate.sum() - rate)
        lags.append(left_out)
        pseudo.append(n * whole - (n - 1) * left_out)
    difference = lags[0] - lags[1]
    error = np.sqrt((n - 1) / n * np.sum((difference - difference.mean()) ** 2))
    mean = np.mean(pseudo[0] - pseudo[1])
    assert p_of("lag_event", *pseudo) == pytest.approx(2 * stats.t.sf(abs(mean / error), n - 1), rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_the_signed_rank_test_is_wilcoxons(seed):
    d = np.random.default_rng(seed).normal(0.4, 1.0, 9 + seed)
    assert pairs.signed_rank(d) == pytest.approx(stats.wilcoxon(d, method="exact").pvalue)


def test_the_signed_rank_test_shares_ranks_and_leaves_zeros_out():
    d = np.array([1.0, 1.0, -1.0, 2.0, 3.0, 0.0, 3.0, -2.0])
    every = np.array(np.meshgrid(*[[-1, 1]] * 7)).reshape(7, -1)  # all signs of the seven that are not zero
    rank = stats.rankdata(np.abs(d[d != 0]))
    sums = (rank[:, None] * (every > 0)).sum(axis=0)
    seen = rank[d[d != 0] > 0].sum()
    tail = min(seen, rank.sum() - seen)
    assert pairs.signed_rank(d) == pytest.approx(min(1.0, 2 * np.mean(sums <= tail)))
    many = np.random.default_rng(3).normal(0.2, 1.0, 150)
    assert pairs.signed_rank(many) == pytest.approx(stats.wilcoxon(many, method="asymptotic").pvalue, rel=1e-6)


def test_false_claims_are_held_as_benjamini_and_hochberg_say():
    p = np.array([0.001, 0.012, 0.014, 0.019, 0.2, 0.6, 0.013])
    np.testing.assert_array_equal(pairs.significant(p), stats.false_discovery_control(p) <= 0.05)
    assert not pairs.significant(np.array([])).any()


def test_too_few_units_or_units_of_different_kinds_tell_nothing():
    assert p_of("mean_square", [1e-9, 1e-9], [1.0, 1.0]) == 1.0
    assert p_of("step_event", [0.1] * 5, [9.0] * 5) == 1.0
    a, b = units("log_variance", [0.0]), units("mean_square", [9.0])
    assert pairs.p_value(a, b, a.ids) == 1.0
    assert p_of("log_variance", [-8.0], [0.0]) < 0.01  # one window of 5 s


def equal_rows(rng, windows, time_constant, common):
    """Six equal rows: ln v of windows of Gauss-Markov noise, a share of which is the same in all of them."""
    n, step = 100, 0.05
    a = np.exp(-step / time_constant)
    x = lfilter([np.sqrt(1 - a * a)], [1, -a], rng.standard_normal((7, windows * n + 200)), axis=1)[:, 200:]
    rows = np.sqrt(common) * x[6] + np.sqrt(1 - common) * x[:6]
    u = np.arange(n) - (n - 1) / 2
    w = rows.reshape(6, windows, n)
    w = w - w.mean(axis=2, keepdims=True)
    w = w - (w @ u)[..., None] * u / (u @ u)
    return np.log(np.sum(w**2, axis=2) / (n - 2))


def told_among(values, kind):
    answers = {}
    for k, v in enumerate(values):
        own = UnitValues(kind, ids_of(np.arange(len(v))), v if kind == "log_variance" else np.exp(v), None)
        answers[str(k)] = Answer(float(np.exp(np.mean(v) / 2)), "deg", "rest", len(v), units=own)
    return ranking.family(answers, "low").significant


@pytest.mark.parametrize("common", few([0.0, 0.9], 1))
@pytest.mark.parametrize(("windows", "time_constant"), few([(1, 0.2), (1, 3.0), (2, 1.0), (5, 3.0), (20, 0.2)], 2))
def test_families_of_equal_rows_hold_a_false_claim_in_at_most_5_percent(windows, time_constant, common):
    rng = np.random.default_rng(7)
    false = [bool(told_among(equal_rows(rng, windows, time_constant, common), "log_variance")) for _ in range(200)]
    assert np.mean(false) <= 0.05


def test_rows_that_do_differ_are_told_apart():
    rng = np.random.default_rng(8)
    found = []
    for _ in range(60):
        values = equal_rows(rng, 6, 1.0, 0.0) + 2 * np.log([1, 1, 1, 1, 1, 3.0])[:, None]
        told = told_among(values, "log_variance")
        found.append(len([t for t in told if t[1] == "5"]) / 5)
    assert np.mean(found) > 0.9


@pytest.mark.parametrize("k", [8, 108])
def test_signed_ranks_of_many_are_those_of_each_and_of_scipy(k):
    d = np.random.default_rng(2).standard_normal((40, k)) + 0.15
    d[3], d[4, : k // 2], d[5, :3] = 0.0, 0.0, 0.25  # nothing, zeros, ties
    found = pairs.signed_ranks(d)
    np.testing.assert_array_equal(found, [pairs.signed_rank(row) for row in d])
    for row in (0, 1, 2, 6):
        method = "exact" if k <= pairs.EXACT else "approx"
        assert found[row] == pytest.approx(stats.wilcoxon(d[row], method=method, correction=False).pvalue, rel=1e-9)
