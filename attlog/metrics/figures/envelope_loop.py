"""The loop behind :mod:`attlog.metrics.figures.envelope`.

The smallest and the largest value of each bucket of a long array.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.kernels.loops import kernel_of

LARGEST = 1e300
"""What is beyond is infinite. (The question whether a number is finite would call the compiler's own library.)"""
SIGNATURE = "void(f8[:, ::1], (f8[:, ::1]), (i8[::1]))"


def extremes(out: NDArray[np.float64], x: NDArray[np.float64], edges: NDArray[np.int64]) -> None:
    """Fill ``out`` (2 m, k) with both extremes of the columns of ``x`` (n, k) between ``edges`` (m + 1,), as they came.

    NaN for the second where the bucket holds a NaN, for both where it holds nothing else, and for what is infinite.
    """
    for b in range(len(edges) - 1):
        for c in range(x.shape[1]):
            low, high = math.inf, -math.inf
            at_low, at_high, hole = 0, 0, False
            for i in range(edges[b], edges[b + 1]):
                value = x[i, c]
                if value < low:
                    low, at_low = value, i
                if value > high:
                    high, at_high = value, i
                if value != value:
                    hole = True
            first, second = low, high
            if at_high < at_low:
                first, second = high, low
            if hole or not -LARGEST < second < LARGEST:
                second = math.nan
            if not -LARGEST < first < LARGEST:
                first = math.nan
            out[2 * b, c], out[2 * b + 1, c] = first, second


SOURCES = ("metrics/figures/envelope_loop.py", "kernels")
EXTREMES = kernel_of(extremes, SIGNATURE, "metrics", "envelopes of long lines", SOURCES)
