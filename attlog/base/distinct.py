"""Which values are different, and which are among others?

``unique``, ``isin`` and ``intersect1d`` of numpy ask much of short arrays, which is what metrics ask about hundreds of
times, and import ``numpy.ma`` (11 ms).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def distinct(values: NDArray[Any]) -> NDArray[Any]:
    """The different values of an array (n,), in order: what ``np.unique`` gives of numbers without NaN."""
    ordered = np.sort(values)
    return ordered[np.append(True, ordered[1:] != ordered[:-1])] if len(ordered) else ordered


def among(values: NDArray[Any], others: NDArray[Any]) -> NDArray[np.bool_]:
    """Which of the ``values`` (n,) are among ``others`` (m,): what ``np.isin`` gives of numbers."""
    if not len(others):
        return np.zeros(len(values), bool)
    ordered = np.sort(others)
    found: NDArray[np.bool_] = ordered[np.minimum(np.searchsorted(ordered, values), len(ordered) - 1)] == values
    return found


def in_both(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """The different values that both arrays hold, in order: what ``np.intersect1d`` gives of numbers."""
    return distinct(a[among(a, b)])
