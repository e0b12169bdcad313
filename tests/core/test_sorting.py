"""Medians, quantiles, distinct values: numpy's values for every shape, kind of number and NaN."""

import numpy as np
import pytest

from attlog.core.sorting import FEW, is_in, median, nanmedian, quantile, unique

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
    "large": [1.5e308, 1.5e308, 1.6e308],
    "NaN": [3.0, np.nan, 2.0, 1.0, 0.0],
    "NaN of two": [np.nan, 1.0],
    "nothing but NaN": [np.nan, np.nan],
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore:All-NaN")
def test_the_median_is_numpys(name):
    assert np.array_equal(median(CASES[name]), np.median(CASES[name]), equal_nan=True)
    assert np.array_equal(nanmedian(CASES[name]), np.nanmedian(CASES[name]), equal_nan=True)


@pytest.mark.parametrize("n", [FEW, FEW + 1, FEW + 2])
@pytest.mark.parametrize("kind", ["float64", "float32", "int64", "uint8"])
@pytest.mark.parametrize("missing", [0, 1, 300])
def test_the_median_of_many_values_is_numpys(n, kind, missing):
    """Above FEW values by partition: odd and even counts, along each axis, with NaN in one column."""
    draws = np.random.default_rng(n)
    x = draws.normal(100.0, 20.0, (n, 3)).astype(kind)
    if kind.startswith("float"):
        x[draws.permutation(n)[:missing], 1] = np.nan
    for values, axis in ((x[:, 0], None), (x[:, 1], None), (x, None), (x, 0), (x.T, 1), (x.T, -1)):
        assert np.array_equal(median(values, axis=axis), np.median(values, axis=axis), equal_nan=True)
        assert np.array_equal(nanmedian(values, axis=axis), np.nanmedian(values, axis=axis), equal_nan=True)


def test_the_median_of_many_infinite_values_is_numpys():
    for n in (FEW + 1, FEW + 2):
        x = np.where(np.arange(n) < n // 2, -np.inf, np.inf)
        with np.errstate(invalid="ignore"):
            assert np.array_equal(median(x), np.median(x), equal_nan=True)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_quantiles_are_numpys(name):
    x, shares = np.asarray(CASES[name]), [0.0, 0.02, 0.3, 0.5, 0.95, 1.0]
    wanted = np.quantile(x if x.dtype.kind == "f" else x.astype(float), shares)
    assert np.allclose(quantile(x, shares), wanted, rtol=np.finfo(wanted.dtype).eps, atol=0.0, equal_nan=True)
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
