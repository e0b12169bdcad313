"""The size of an error: what numpy says, also where a quantile lies between two values, and the limits of intervals."""

from __future__ import annotations

import json
import math
import pickle

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import stats
from scipy.signal import lfilter

from attlog.core.plain import to_plain
from attlog.metrics import ranking, statistics
from attlog.metrics.metric import Answer
from attlog.metrics.statistics import Kind, Summary, UnitValues, make_ids
from tests.conftest import few


def mean_of(ids):
    return Summary(float(len(ids)), None)


UNITS = UnitValues("slope_group", make_ids([5.0, 0.0004, 9.9999]), np.array([2.0, 1.0, 3.0]), mean_of)


def test_units_are_found_by_the_millisecond_they_begin_at():
    np.testing.assert_array_equal(UNITS.at(make_ids([0.0, 10.0])), [1.0, 3.0])
    with pytest.raises(KeyError, match="7000"):
        UNITS.at(make_ids([7.0, 10.0]))


def test_units_travel_between_processes_and_in_the_json_without_the_function() -> None:
    answer = Answer(1.0, "deg", "all", units=UNITS)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(answer)).units.values, UNITS.values)
    document = json.loads(json.dumps(to_plain(answer)))
    assert document["units"] == {"kind": "slope_group", "ids": [5000, 0, 10000], "values": [2.0, 1.0, 3.0]}
    back = TypeAdapter(Answer).validate_python(document, strict=False)
    assert back.units is not None
    assert back.units.ids.dtype == np.int64
    np.testing.assert_array_equal(back.units.at(make_ids([10.0, 5.0])), [3.0, 2.0])


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("log_variance", [math.log(0.01), math.log(0.04)], math.sqrt(0.02)),  # the geometric mean of 0.1 and 0.2
        ("mean_square", [1.0, 7.0], 2.0),
        ("lag_event", [4.0, 6.0], 5.0),
        ("slope_group", [-1.0, 4.0], 1.5),
        ("step_event", [1.0, 2.0, 9.0], 2.0),
    ],
)
def test_units_from_a_file_are_summed_up_by_their_kind(kind: Kind, values: list[float], expected: float) -> None:
    ids = make_ids(np.arange(len(values) + 1))
    units = UnitValues(kind, ids, np.array([*values, 99.0]))
    assert units.of(ids[:-1]).value == pytest.approx(expected)


def units(kind, values, first=0):
    return UnitValues(kind, make_ids(np.arange(first, first + len(values))), np.asarray(values, float), None)


def p_of(kind, x, y):
    a, b = units(kind, x), units(kind, y)
    return statistics.p_value(a, b, a.ids)


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


def test_the_signed_rank_test_shares_ranks_and_leaves_zeros_out():
    d = np.array([1.0, 1.0, -1.0, 2.0, 3.0, 0.0, 3.0, -2.0])
    every = np.array(np.meshgrid(*[[-1, 1]] * 7)).reshape(7, -1)  # all signs of the seven that are not zero
    rank = stats.rankdata(np.abs(d[d != 0]))
    sums = (rank[:, None] * (every > 0)).sum(axis=0)
    seen = rank[d[d != 0] > 0].sum()
    tail = min(seen, rank.sum() - seen)
    assert statistics.signed_rank(d) == pytest.approx(min(1.0, 2 * np.mean(sums <= tail)))
    many = np.random.default_rng(3).normal(0.2, 1.0, 150)
    assert statistics.signed_rank(many) == pytest.approx(stats.wilcoxon(many, method="asymptotic").pvalue, rel=1e-6)


def test_false_claims_are_held_as_benjamini_and_hochberg_say():
    p = np.array([0.001, 0.012, 0.014, 0.019, 0.2, 0.6, 0.013])
    np.testing.assert_array_equal(statistics.significant(p), stats.false_discovery_control(p) <= 0.05)
    assert not statistics.significant(np.array([])).any()


def test_too_few_units_or_units_of_different_kinds_tell_nothing():
    assert p_of("mean_square", [1e-9, 1e-9], [1.0, 1.0]) == 1.0
    assert p_of("step_event", [0.1] * 5, [9.0] * 5) == 1.0
    a, b = units("log_variance", [0.0]), units("mean_square", [9.0])
    assert statistics.p_value(a, b, a.ids) == 1.0
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
        own = UnitValues(kind, make_ids(np.arange(len(v))), v if kind == "log_variance" else np.exp(v), None)
        answers[str(k)] = Answer(float(np.exp(np.mean(v) / 2)), "deg", "rest", len(v), units=own)
    return ranking.family(answers, "low").significant


@pytest.mark.parametrize("common", few([0.0, 0.9], 1))
@pytest.mark.parametrize(("windows", "time_constant"), few([(1, 0.2), (1, 3.0), (2, 1.0), (5, 3.0), (20, 0.2)], 2))
def test_families_of_equal_rows_hold_a_false_claim_in_at_most_5_percent(windows, time_constant, common):
    rng = np.random.default_rng(7)
    false = [bool(told_among(equal_rows(rng, windows, time_constant, common), "log_variance")) for _ in range(200)]
    assert np.mean(false) <= 0.05


@pytest.mark.parametrize("n", [8, 41, 97, 998])
def test_quantiles_between_two_values_are_those_of_numpy(n: int) -> None:
    for seed in range(5):
        x = np.abs(np.random.default_rng(seed).standard_normal(n))
        size = statistics.ErrorSize(x, 30.0)
        assert size.of("p95")[0] == pytest.approx(np.quantile(x, 0.95), rel=1e-12)


def test_the_interval_of_the_size_is_that_of_its_changes() -> None:
    x = np.repeat([1.0, 1.3, 2.0, 1.1], 50)
    size = statistics.ErrorSize(x, 30.0)
    value, ci95 = size.of("rmse")
    square = x[::50] ** 2
    halves = np.log(square[2:].mean() / square[:2].mean())
    quarters = np.log(square[1] / square[0]), np.log(square[3] / square[2])
    variance = (2.0 * 1.3 + 1.5 * halves**2 + 0.75 * (quarters[0] ** 2 + quarters[1] ** 2)) / 5.0
    factor = np.exp(0.5 * stats.t.ppf(0.975, 5.0) * np.sqrt(0.5 * variance))
    assert ci95 == pytest.approx((value / factor, value * factor))


@pytest.mark.parametrize(("seconds", "count", "known"), [(3.9, 100, False), (4.0, 100, True), (30.0, 7, False)])
def test_four_seconds_and_eight_samples_have_an_interval(seconds: float, count: int, known: bool) -> None:
    _, ci95 = statistics.ErrorSize(np.ones(count), seconds).of("rmse")
    assert (ci95 is not None) is known
    assert bool(statistics.groups_of(count, seconds)) is known


def test_a_root_mean_square_without_groups_has_no_interval_and_of_nothing_is_known_to_be_nothing() -> None:
    x = np.random.default_rng(1).normal(size=100)
    groups = statistics.equal_groups(100, 5)
    assert statistics.root_mean_square(x, groups[:1]) == (pytest.approx(np.sqrt(np.mean(x**2))), None)
    assert statistics.root_mean_square(0.0 * x, groups) == (0.0, (0.0, 0.0))
    _, high = statistics.root_mean_square(170.0 + x, groups)[1] or (0.0, 0.0)
    assert 170.0 < high <= 180.0
    wild = np.repeat([1.0, 1.0, 400.0, 1.0, 1.0], 20)
    assert statistics.root_mean_square(wild, groups)[1][1] == 180.0  # type: ignore[index]


def test_the_factor_of_a_root_mean_square_is_the_relative_half_width_of_its_square_by_half() -> None:
    """Neighbours that do not resemble each other: plain Student's t over four group means of unequal size."""
    levels = np.array([1.0, 2.0, 1.2, 1.9])
    value, ci95 = statistics.root_mean_square(np.repeat(levels, 25), statistics.equal_groups(100, 4))
    half = stats.t.ppf(0.975, 3) * stats.sem(levels**2)
    factor = np.exp(0.5 * half / np.mean(levels**2))
    assert ci95 == pytest.approx((value / factor, value * factor))


def test_the_median_of_ranks_has_the_binomial_coverage() -> None:
    """The largest rank of which both tails together hold at most 5 %, by scipy's binomial distribution."""
    rng = np.random.default_rng(2)
    for k in (5, 6, 7, 9, 20, 33, 100, 2000):
        x = np.sort(rng.normal(size=k))
        fits = [r for r in range(1, k // 2 + 1) if 2.0 * stats.binom.cdf(r - 1, k, 0.5) <= 0.05]
        wanted = (x[fits[-1] - 1], x[k - fits[-1]]) if fits else None
        assert statistics.median_interval(x[::-1]) == wanted


def test_neighbours_are_taken_for_alike_by_their_correlation_without_its_bias() -> None:
    x = np.array([0.3, 1.1, 1.4, 0.2, -0.9, -0.5, 0.8, 2.0, 1.7])
    d = x - x.mean()
    r = np.sum(d[1:] * d[:-1]) / np.sum(d * d) + 1.0 / 9.0
    low, high = stats.t.interval(0.95, 8, x.mean(), stats.sem(x))
    wider = np.sqrt((1.0 + r) / (1.0 - r))
    middle, half = 0.5 * (low + high), 0.5 * (high - low) * wider
    assert statistics.neighbour_interval(x) == pytest.approx((middle - half, middle + half))
    assert statistics.neighbour_interval([1.0, 2.0]) == pytest.approx(statistics.mean_interval([1.0, 2.0]))


def slow_errors(tau_s: float, blocks: int, runs: int, seed: int = 3) -> np.ndarray:
    """Mean squares (runs, blocks) over 5 s of first-order errors."""
    rng, step = np.random.default_rng(seed), 0.5
    a = np.exp(-step / tau_s)
    white = rng.standard_normal((runs, 10 * blocks))
    white[:, 0] /= np.sqrt(1.0 - a * a)
    error = lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], white, axis=1)
    return np.mean(error.reshape(runs, blocks, 10) ** 2, axis=2)


def test_slow_errors_are_no_independent_blocks() -> None:
    """Equal rows with errors of 100 s; what is twice as large in every block stays told apart."""
    one, other = slow_errors(100.0, 60, 300), slow_errors(100.0, 60, 300, seed=4)
    assert np.mean(statistics.p_values("mean_square", one, other) < 0.05) < 0.25
    fast, same = slow_errors(1.0, 60, 300), slow_errors(1.0, 60, 300, seed=4)
    assert np.mean(statistics.p_values("mean_square", fast, same) < 0.05) < 0.1
    assert np.mean(statistics.p_values("mean_square", fast, 2.0 * same) < 0.05) > 0.95


def test_the_white_noise_of_a_truth_is_no_error_of_a_row() -> None:
    """An error of 0.4 deg against a truth with 0.3 deg of noise looks like 0.5; without error none is left."""
    noise = 0.3 * np.random.default_rng(1).standard_normal(20_000)
    error = np.hypot(0.4 * np.sqrt(2.0) * np.sin(np.linspace(0.0, 90.0, len(noise))), noise)
    value, ci95 = statistics.ErrorSize(error, 200.0, 0.1, noise=0.3).of("rmse")
    assert value == pytest.approx(0.4, rel=0.02)
    assert ci95 is not None
    assert ci95[0] < 0.4 < ci95[1]
    assert statistics.ErrorSize(np.abs(noise), 200.0, 0.1, noise=0.3).of("rmse")[0] < 0.06
