"""Medians are numpy's, to the bit."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from attlog.base.median import median, quantile

SHAPES = [((1,), None), ((2,), None), ((9,), None), ((1000,), None), ((7, 3), 0), ((8, 3), 0), ((8, 3), 1),
          ((4, 6), None), ((3, 2, 5), 1), ((3, 2, 5), -1)]  # fmt: skip


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64, np.uint64, np.bool_])
@pytest.mark.parametrize(("shape", "axis"), SHAPES)
def test_the_value_is_numpys(shape: tuple[int, ...], axis: int | None, kind: Any) -> None:
    x = (1e3 * np.random.default_rng(7).normal(size=shape)).astype(np.int64).astype(kind)
    for part in (x, x / 3) if x.dtype.kind == "f" else (x,):
        before = part.tobytes()
        expected, found = np.median(part, axis=axis), median(part, axis)
        assert np.asarray(found).tobytes() == np.asarray(expected).tobytes()
        assert (type(found), found.dtype) == (type(expected), expected.dtype)
        assert part.tobytes() == before


@pytest.mark.parametrize(("shape", "axis"), [(shape, axis) for shape, axis in SHAPES if shape != (1,)])
def test_one_nan_makes_the_median_nan_and_infinities_count(shape: tuple[int, ...], axis: int | None) -> None:
    x = np.random.default_rng(7).normal(size=shape)
    for value in (np.nan, np.inf, -np.inf):
        x.flat[x.size // 2] = value
        np.testing.assert_array_equal(median(x, axis), np.median(x, axis=axis))


def test_of_nothing_it_is_nan() -> None:
    assert np.isnan(median([]))
    np.testing.assert_array_equal(median(np.zeros((0, 3)), axis=0), np.full(3, np.nan))
    assert median([3, 1, 2]) == 2


def test_it_imports_no_masked_arrays() -> None:
    code = "import sys; from attlog.base.median import median; median([1.0, 2.0]); print('numpy.ma' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"


@pytest.mark.parametrize("n", [1, 2, 3, 10, 101, 1000])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.05, 0.5, 0.8, 0.95, 1.0])
def test_quantiles_are_numpys(n: int, share: float) -> None:
    x = np.random.default_rng(n).normal(size=n)
    assert quantile(x, share) == np.quantile(x, share) == np.percentile(x, 100.0 * share)
    x[n // 2] = np.nan
    assert np.isnan(quantile(x, share))
