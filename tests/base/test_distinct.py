"""Different values and values among others against numpy's own."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base.distinct import among, distinct, in_both

RANDOM = np.random.default_rng(8)
ARRAYS = [
    RANDOM.integers(0, 40, 60),
    RANDOM.integers(-5, 5, 3) * 10**12,
    np.round(RANDOM.normal(size=200), 1),
    np.array([7]),
    np.array([], np.int64),
    np.array([-np.inf, np.inf, 0.0, -0.0]),
]


@pytest.mark.parametrize("values", ARRAYS)
def test_different_values_are_those_of_numpy(values: np.ndarray) -> None:
    found = distinct(values)
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found, np.unique(values))


@pytest.mark.parametrize("values", ARRAYS)
@pytest.mark.parametrize("others", ARRAYS)
def test_values_among_others_are_those_of_numpy(values: np.ndarray, others: np.ndarray) -> None:
    np.testing.assert_array_equal(among(values, others), np.isin(values, others))
    np.testing.assert_array_equal(in_both(values, others), np.intersect1d(values, others))


def test_what_is_no_number_is_among_nothing() -> None:
    found = among(np.array([np.nan, 1.0]), np.array([np.nan, 1.0]))
    assert found.tolist() == np.isin(np.array([np.nan, 1.0]), np.array([np.nan, 1.0])).tolist() == [False, True]
