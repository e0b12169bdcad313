"""How long an interval between samples is a gap? One rule for streams, filters and metrics (docs/metrics.md)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MEDIANS, LEAST_S = 5.0, 0.05
"""Longer than five usual intervals, and than 50 ms."""
RESTART_S = 0.5
"""Up to here a filter integrates across a gap; beyond, it restarts."""


def limit(usual_s: float) -> float:
    """The longest interval in s that is no gap where ``usual_s`` is the usual one."""
    return max(MEDIANS * usual_s, LEAST_S)


def limit_of(t: NDArray[np.float64]) -> float:
    """The same of times (n,) in s, by the median of their intervals forwards; the least where there is none."""
    dt = np.diff(t)
    dt = dt[np.isfinite(dt) & (dt > 0)]
    return limit(float(np.median(dt))) if len(dt) else LEAST_S
