"""Long arrays for figures: the smallest and the largest value of each bucket, so that no peak is lost."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.kernels.loops import function_of
from attlog.metrics.figures.envelope_loop import EXTREMES, extremes

Array = NDArray[np.float64]

BUDGET = 100_000
"""Samples per angle over all rows of a figure; beyond it envelopes take over."""
FEWEST = 2000
"""Samples that every row keeps, however many rows there are."""


@dataclass(frozen=True, slots=True)
class Share:
    """How many samples a row may keep of its own: its share of the budget of the figure."""

    total: int

    @classmethod
    def of(cls, lengths: Iterable[int]) -> Share:
        """For rows of these lengths."""
        return cls(sum(lengths))

    def __call__(self, n: int) -> int:
        """Samples to keep of n."""
        return n if self.total <= 1.1 * BUDGET else min(n, max(BUDGET * n // self.total, FEWEST))


@dataclass(slots=True)
class Budget:
    """The shares of rows that pass one by one: first ``replays`` replayed ones, then those with ``others`` samples.

    A replayed row has the share it would have if all of them were as long as it is, as they are: they stand at the
    samples of one unit.
    """

    replays: int
    others: int
    passed: int = 0

    def share(self, n: int, replayed: bool) -> Share:
        """That of the next row, which has n samples."""
        if not replayed:
            return Share(self.passed + self.others)
        self.passed += n
        return Share(self.replays * n + self.others)


def envelope(t: Array, columns: Array, keep: int) -> tuple[Array, Array]:
    """Times (m,) and columns (m, k) of (n,), (n, k) with at most ``keep`` samples: two per bucket, its extremes.

    The two values of a bucket stand at its first and its middle time, so that all
    columns share the times; a peak keeps its height and moves by less than a bucket.
    A bucket with NaN in it keeps a NaN, so that a gap stays a gap.
    """
    n, buckets = len(t), max(keep // 2, 1)
    if n <= max(keep, 2):
        return t, columns
    edges = np.linspace(0, n, buckets + 1).astype(np.int64)
    first, middle = edges[:-1], (edges[:-1] + edges[1:]) // 2
    out = np.empty((2 * buckets, columns.shape[1]))
    function_of(EXTREMES, extremes)(out, np.ascontiguousarray(columns), edges)
    return np.column_stack([t[first], t[middle]]).ravel(), out
