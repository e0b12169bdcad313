"""The robust fit against closed forms: a line with outliers, clustered errors, and a prior."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.health.fits.regression import fit, interval
from attlog.health.fits.turns import largest_step


def test_a_line_is_found_in_spite_of_gross_errors() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 200.0, 0.5)
    x = rng.normal(size=len(t))
    y = 2.0 * x - 0.7 + 0.05 * rng.normal(size=len(t))
    y[::20] += 30.0
    found = fit(t, np.column_stack([x, np.ones(len(t))])[:, None, :], y[:, None])
    assert found is not None
    assert found.x == pytest.approx([2.0, -0.7], abs=0.02)
    assert found.blocks == 40


def test_errors_that_last_make_the_standard_error_larger_than_independent_ones() -> None:
    """A mean of 40 independent values, each repeated ten times: s / sqrt(40), not s / sqrt(400)."""
    rng = np.random.default_rng(4)
    values = rng.normal(size=40)
    t = np.arange(0.0, 200.0, 0.5)
    found = fit(t, np.ones((400, 1, 1)), np.repeat(values, 10)[:, None])
    assert found is not None
    assert found.sigma[0] == pytest.approx(1.0 / np.sqrt(40), rel=0.35)
    assert found.sigma[0] > 2.0 / np.sqrt(400)


def test_a_prior_holds_what_the_data_do_not_tell_and_its_width_is_the_answers() -> None:
    """Two columns that are one: the sum is known, the second is held to its prior."""
    rng = np.random.default_rng(5)
    t, one = np.arange(0.0, 100.0, 0.5), np.ones(200)
    y = 1.0 + 0.01 * rng.normal(size=200)
    columns = np.column_stack([one, one])[:, None, :]
    assert fit(t, columns, y[:, None]) is None
    found = fit(t, columns, y[:, None], np.array([np.inf, 0.1]))
    assert found is not None
    assert found.x == pytest.approx([1.0, 0.0], abs=0.02)
    assert found.sigma[1] == pytest.approx(0.1, rel=0.3)


def test_the_interval_is_two_standard_errors_wide_each_way() -> None:
    assert interval(10.0, 1.0, 2) == "8.04 to 11.96"


def test_a_step_is_found_where_it_is_and_noise_is_none() -> None:
    rng = np.random.default_rng(6)
    bias = 0.05 * rng.normal(size=(20, 3))
    size, sigma, _, _ = largest_step(bias)
    assert abs(size) < 6 * sigma
    bias[13:, 2] -= 0.9
    size, sigma, axis, at = largest_step(bias)
    assert (axis, at) == (2, 13)
    assert size == pytest.approx(-0.9, abs=0.1)
    assert abs(size) > 6 * sigma


def test_a_mean_of_few_blocks_has_the_standard_error_of_few_values() -> None:
    """Six values, one in each block: s / sqrt(6) with five degrees of freedom, as scipy has it."""
    from scipy.stats import sem

    values = np.array([1.0, 1.4, 0.7, 1.1, 0.8, 1.3])
    found = fit(5.0 * np.arange(6) + 1.0, np.ones((6, 1, 1)), values[:, None], huber=1e9)
    assert found is not None
    assert found.sigma[0] == pytest.approx(sem(values), rel=1e-9)


def test_a_mean_of_two_blocks_is_not_surer_than_two_values() -> None:
    from scipy.stats import sem

    found = fit(np.array([1.0, 6.0]), np.ones((2, 1, 1)), np.array([[1.0], [1.8]]), huber=1e9)
    assert found is not None
    assert found.sigma[0] == pytest.approx(sem([1.0, 1.8]), rel=1e-9)
    assert (found.x[0], found.blocks) == (pytest.approx(1.4), 2)


@pytest.mark.parametrize(("at", "n"), [((4.9, 5.1), 2), ((5.1, 9.9), 1), ((0.0, 4.9), 1)])
def test_blocks_are_of_five_seconds(at: tuple[float, float], n: int) -> None:
    found = fit(np.array(at), np.ones((2, 1, 1)), np.array([[1.0], [2.0]]))
    assert found is not None
    assert found.blocks == n
