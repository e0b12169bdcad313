"""Settled: the time in which a filter has forgotten its own start and the motors."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator

import numpy as np

from attlog.segments import spans
from attlog.segments.model import Segments
from attlog.segments.spans import Span

AFTER_MOTORS_S = 5.0
DRIFT_AFTER_START_S = 20.0
"""Filters were seen to turn their heading for 20 s after their start."""


def settled(
    each: Iterable[Span], segments: Segments, starts: Iterable[float], after_start_s: float
) -> Iterator[list[Span]]:
    """Of each span the time that is later than ``after_start_s`` after each start, and 5 s after motors stopped.

    ``starts`` are those of the filter: its first attitude and each restart. Time before the first does not count.
    """
    began = sorted(starts)
    if not began:
        yield from ([] for _ in each)
        return
    stopped = [s.t1 for kind in ("armed", "airborne", "idle") for s in segments.of(kind)]
    unsettled = [(-np.inf, began[0]), *((t, t + after_start_s) for t in began)]
    unsettled += [(t, t + AFTER_MOTORS_S) for t in stopped]
    free = spans.complement(unsettled, -np.inf, np.inf)
    begins, ends = [t0 for t0, _ in free], [t1 for _, t1 in free]
    for t0, t1 in each:
        overlapping = free[bisect_right(ends, t0) : bisect_left(begins, t1)]
        yield [(max(t0, a), min(t1, b)) for a, b in overlapping]
