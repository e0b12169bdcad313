"""Settled: the time in which a filter has forgotten its own start and the motors."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from attlog.segments import spans
from attlog.segments.model import Segments
from attlog.segments.spans import Span

AFTER_MOTORS_S = 5.0
DRIFT_AFTER_START_S = 20.0
"""Filters were seen to turn their heading for 20 s after their start."""


def settled(within: Iterable[Span], segments: Segments, starts: Iterable[float], after_start_s: float) -> list[Span]:
    """The time within spans that is later than ``after_start_s`` after each start, and 5 s after motors stopped.

    ``starts`` are those of the filter: its first attitude and each restart. Time before the first does not count.
    """
    began = sorted(starts)
    if not began:
        return []
    stopped = [s.t1 for kind in ("armed", "airborne", "idle") for s in segments.of(kind)]
    unsettled = [(-np.inf, began[0]), *((t, t + after_start_s) for t in began)]
    unsettled += [(t, t + AFTER_MOTORS_S) for t in stopped]
    return spans.intersect(within, spans.complement(unsettled, -np.inf, np.inf))
