"""Medians, quantiles, distinct values: numpy's values for every shape, kind of number and NaN."""

import numpy as np
import pytest

from attlog.core.sorting import is_in, median, nanmedian, quantile, unique

CASES = {
    "odd": [3.0, 1.0, 2.0],
    "even": [4.0, 1.0, 3.0, 2.0],
    "one": [7.5],
    "ties": [1.0, 1.0, 1.0, 2.0],
    "infinite": [np.inf, 1.0, np.inf, 0.0],
    "whole numbers": [255, 254, 253, 255],
    "small kind": np.array([200, 250, 255, 240], np.uint8),
    "float32": np.array([0.1, 0.2, 0.7, 0.4], np.float32),
    "truths": np.array([True, False, True]),
    "NaN": [3.0, np.nan, 2.0, 1.0, 0.0],
    "NaN of two": [np.nan, 1.0],
    "nothing but NaN": [np.nan, np.nan],
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore:All-NaN")
def test_the_median_is_numpys(name):
    assert np.array_equal(median(CASES[name]), np.median(CASES[name]), equal_nan=True)
    assert np.array_equal(nanmedian(CASES[name]), np.nanmedian(CASES[name]), equal_nan=True)


@pytest.mark.parametrize("name", [name for name in CASES if name != "infinite"])
def test_quantiles_are_numpys(name):
    x, shares = np.asarray(CASES[name], float), [0.0, 0.02, 0.3, 0.5, 0.95, 1.0]
    assert np.array_equal(quantile(x, shares), np.quantile(x, shares), equal_nan=True)
    assert [quantile(x, share) for share in shares] == pytest.approx(quantile(x, shares), abs=0, nan_ok=True)


def test_quantiles_of_many_values_are_numpys():
    draws = np.random.default_rng(5)
    for n in (2, 3, 10, 1001, 4000):
        x, shares = draws.normal(size=n), [0.01, 0.25, 0.6, 0.8, 0.99]
        assert np.array_equal(quantile(x, shares), np.quantile(x, shares))


@pytest.mark.parametrize("x", [[3, 1, 3, 2, 1], [[2.0, 1.0], [2.0, -1.0]], [], [5]])
def test_distinct_values_are_numpys(x):
    assert np.array_equal(unique(x), np.unique(x))
    assert unique(x).dtype == np.asarray(x).dtype


@pytest.mark.parametrize("others", [[], [2], [5, 2, 2, 9], [0.5, 2.0]])
def test_values_among_others_are_numpys(others):
    for x in ([], 2, [1, 2, 3, 9, 10], [[2.0, np.nan], [0.5, 9.0]]):
        assert np.array_equal(is_in(x, others), np.isin(x, others))


@pytest.mark.parametrize("axis", [None, 0, 1, 2, -1])
@pytest.mark.parametrize("missing", [0.0, 0.02, 0.5])
@pytest.mark.filterwarnings("ignore:All-NaN")
def test_medians_along_an_axis_are_numpys(axis, missing):
    draws = np.random.default_rng(3)
    for shape in ((6, 7, 8), (5, 1, 4)):
        x = np.where(draws.random(shape) < missing, np.nan, np.round(draws.normal(size=shape), 1))
        given = x.copy()
        assert np.array_equal(median(x, axis=axis), np.median(x, axis=axis), equal_nan=True)
        assert np.array_equal(nanmedian(x, axis=axis), np.nanmedian(x, axis=axis), equal_nan=True)
        assert np.array_equal(x, given, equal_nan=True)


def test_nothing_has_no_median():
    assert np.isnan([median([]), nanmedian([]), quantile([], 0.5)]).all()
    assert np.isnan(median(np.zeros((0, 3)), axis=0)).all()
    assert median(np.zeros((0, 3)), axis=1).shape == (0,)
