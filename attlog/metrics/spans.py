"""Stretches of samples: where a span of time meets a run of data."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Span = tuple[float, float]


def stretches(t: Array, inside: NDArray[np.bool_], run: NDArray[np.int64] | None = None) -> list[slice]:
    """Index ranges of consecutive samples that are inside, cut where the run changes and at gaps.

    ``t`` (n,) s. A gap is longer than max(5 median steps, 50 ms), as in METRICS 1.
    """
    if len(t) == 0:
        return []
    step = np.diff(t)
    median = float(np.median(step)) if len(step) else 0.0
    cut = step > max(5.0 * median, 0.05)
    if run is not None:
        cut = cut | (np.diff(run) != 0)
    cut = cut | (inside[1:] != inside[:-1])
    edges = np.concatenate([[0], np.flatnonzero(cut) + 1, [len(t)]])
    return [slice(int(a), int(b)) for a, b in pairwise(edges) if inside[a]]


def within(t: Array, span: Span, run: NDArray[np.int64] | None = None) -> list[slice]:
    """Stretches of samples with span[0] <= t <= span[1]; ``t`` ascending."""
    i, j = np.searchsorted(t, span[0], side="left"), np.searchsorted(t, span[1], side="right")
    found = stretches(t[i:j], np.ones(j - i, bool), None if run is None else run[i:j])
    return [slice(s.start + int(i), s.stop + int(i)) for s in found]


def seconds(t: Array, pieces: list[slice]) -> float:
    """Time covered by the stretches, s."""
    return float(sum(t[s.stop - 1] - t[s.start] for s in pieces))


def about(window: str, *names: str) -> bool:
    """Whether a metric that belongs to the named windows says something about this one (``T0:T1`` always)."""
    return ":" in window or window in names
