"""How long an interval between samples is a gap? One rule for streams, filters and metrics (docs/metrics.md)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GAP_MEDIANS, MIN_GAP_S = 5.0, 0.05
"""Longer than five usual intervals, and than 50 ms."""
MAX_BRIDGED_GAP_S = 0.5
"""Up to here a filter integrates across a gap; beyond, it restarts."""


def gap_limit(usual_s: float) -> float:
    """The longest interval in s that is no gap where ``usual_s`` is the usual one."""
    return max(GAP_MEDIANS * usual_s, MIN_GAP_S)


def gap_limit_of_times(t: NDArray[np.float64]) -> float:
    """The same of times (n,) in s, by the median of their intervals forwards; the least where there is none."""
    dt = np.diff(t)
    dt = dt[np.isfinite(dt) & (dt > 0)]
    return gap_limit(float(np.median(dt))) if len(dt) else MIN_GAP_S
