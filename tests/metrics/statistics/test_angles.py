"""The size of an error: what numpy says, also where a quantile lies between two values, and the limits of intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from attlog.metrics.statistics import angles
from attlog.metrics.statistics import intervals as interval


@pytest.mark.parametrize("n", [8, 41, 97, 998])
def test_quantiles_between_two_values_are_those_of_numpy(n: int) -> None:
    for seed in range(5):
        x = np.abs(np.random.default_rng(seed).standard_normal(n))
        size = angles.ErrorSize(x, 30.0)
        assert size.of("p95")[0] == pytest.approx(np.quantile(x, 0.95), rel=1e-12)
        assert size.of("median")[0] == pytest.approx(np.median(x), rel=1e-12)


def test_pieces_are_the_halves_and_the_quarters_in_their_order() -> None:
    x = np.repeat([1.0, 2.0, 4.0, 16.0], 50)
    whole, *parts = angles.ErrorSize(x, 30.0)._sizes("rmse")
    squares = [np.mean(x[a:b] ** 2) for a, b in ((0, 200), (0, 100), (100, 200), (0, 50), (50, 100))]
    squares += [16.0, 256.0]
    np.testing.assert_allclose([whole, *parts], np.sqrt(squares))
    changes = angles._changes(parts, whole)
    ratio = [squares[2] / squares[1], squares[4] / squares[3], 16.0]
    np.testing.assert_allclose(changes, np.log(ratio))


def test_a_part_without_error_counts_as_a_thousandth_of_the_whole() -> None:
    np.testing.assert_allclose(angles._changes([2.0, 0.0, 1.0, 1.0, 0.0, 0.0], 2.0), [2.0 * np.log(1000.0), 0.0, 0.0])
    np.testing.assert_array_equal(angles._changes([0.0] * 6, 0.0), np.zeros(3))


def test_the_interval_of_the_size_is_that_of_its_changes() -> None:
    x = np.repeat([1.0, 1.3, 2.0, 1.1], 50)
    size = angles.ErrorSize(x, 30.0)
    value, ci95 = size.of("rmse")
    square = x[::50] ** 2
    halves = np.log(square[2:].mean() / square[:2].mean())
    quarters = np.log(square[1] / square[0]), np.log(square[3] / square[2])
    variance = (2.0 * 1.3 + 1.5 * halves**2 + 0.75 * (quarters[0] ** 2 + quarters[1] ** 2)) / 5.0
    factor = np.exp(0.5 * stats.t.ppf(0.975, 5.0) * np.sqrt(0.5 * variance))
    assert ci95 == pytest.approx((value / factor, value * factor))


@pytest.mark.parametrize(("seconds", "count", "known"), [(3.9, 100, False), (4.0, 100, True), (30.0, 7, False)])
def test_four_seconds_and_eight_samples_have_an_interval(seconds: float, count: int, known: bool) -> None:
    _, ci95 = angles.ErrorSize(np.ones(count), seconds).of("rmse")
    assert (ci95 is not None) is known
    assert bool(angles.groups_of(count, seconds)) is known


def test_a_record_has_a_group_for_each_five_seconds_from_four_to_twenty() -> None:
    for seconds, groups in ((4.0, 4), (19.0, 4), (26.0, 5), (49.0, 9), (99.0, 19), (500.0, 20)):
        assert len(angles.groups_of(1000, seconds)) == groups


def test_the_sigma_of_a_reference_widens_an_interval_down_to_zero_and_up_to_half_a_turn() -> None:
    size = angles.ErrorSize(np.full(100, 3.0), 30.0, 0.5)
    value, (low, high) = size.of("max")  # type: ignore[misc]
    assert (value, low, high) == (3.0, 2.0, 4.0)
    assert angles.ErrorSize(np.full(100, 0.3), 30.0, 0.5).of("max")[1] == (0.0, pytest.approx(1.3))
    assert angles.ErrorSize(np.full(100, 179.5), 30.0, 0.5).of("max")[1] == (178.5, 180.0)
    assert angles.ErrorSize(np.full(100, 3.0), 30.0).of("max")[1] is None


def test_a_root_mean_square_without_groups_has_no_interval_and_of_nothing_is_known_to_be_nothing() -> None:
    x = np.random.default_rng(1).normal(size=100)
    groups = interval.equal_groups(100, 5)
    assert angles.root_mean_square(x, groups[:1]) == (pytest.approx(np.sqrt(np.mean(x**2))), None)
    assert angles.root_mean_square(0.0 * x, groups) == (0.0, (0.0, 0.0))
    _, high = angles.root_mean_square(170.0 + x, groups)[1] or (0.0, 0.0)
    assert 170.0 < high <= 180.0
    wild = np.repeat([1.0, 1.0, 400.0, 1.0, 1.0], 20)
    assert angles.root_mean_square(wild, groups)[1][1] == 180.0  # type: ignore[index]


def test_the_factor_of_a_root_mean_square_is_the_relative_half_width_of_its_square_by_half() -> None:
    """Neighbours that do not resemble each other: plain Student's t over four group means of unequal size."""
    levels = np.array([1.0, 2.0, 1.2, 1.9])
    value, ci95 = angles.root_mean_square(np.repeat(levels, 25), interval.equal_groups(100, 4))
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
        assert interval.of_median(x[::-1]) == wanted


def test_the_interval_of_a_deviation_is_that_of_chi_square() -> None:
    low, high = interval.of_sigma_chi_square(2.0, 11.5)
    ends = 2.0 * np.sqrt(11.5 / stats.chi2.ppf([0.975, 0.025], 11.5))
    assert (low, high) == pytest.approx(tuple(ends))


def test_the_interval_of_pooled_variances_is_students_t_of_their_logarithms_by_half() -> None:
    v = np.array([1.0, 4.0, 2.0, 9.0, 0.5])
    half = 0.5 * stats.t.ppf(0.975, 4) * stats.sem(np.log(v))
    assert interval.of_sigma_log(3.0, v) == pytest.approx((3.0 * np.exp(-half), 3.0 * np.exp(half)))
    assert interval.of_sigma_log(3.0, [1.0]) is None
    assert interval.of_sigma_log(3.0, [1.0, 0.0]) is None


def test_neighbours_are_taken_for_alike_by_their_correlation_without_its_bias() -> None:
    x = np.array([0.3, 1.1, 1.4, 0.2, -0.9, -0.5, 0.8, 2.0, 1.7])
    d = x - x.mean()
    r = np.sum(d[1:] * d[:-1]) / np.sum(d * d) + 1.0 / 9.0
    low, high = stats.t.interval(0.95, 8, x.mean(), stats.sem(x))
    wider = np.sqrt((1.0 + r) / (1.0 - r))
    middle, half = 0.5 * (low + high), 0.5 * (high - low) * wider
    assert interval.of_neighbours(x) == pytest.approx((middle - half, middle + half))
    assert interval.of_neighbours([1.0, 2.0]) == pytest.approx(interval.of_mean([1.0, 2.0]))


def test_an_interval_that_is_not_symmetric_keeps_its_sides_beside_the_sigma_of_a_reference() -> None:
    found = interval.with_reference(5.0, (4.7, 5.4), 0.2)
    assert found == pytest.approx((5.0 - np.hypot(0.3, 0.4), 5.0 + np.hypot(0.4, 0.4)))
