"""Windows of 5 s: the unit in which noise is measured, the same for every row of a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.base import Case
from attlog.metrics.evidence import row_segments
from attlog.metrics.settled import SHORTEST_S, own_start, phase_spans
from attlog.reference.model import Row
from attlog.segments.spans import Span

Array = NDArray[np.float64]

SECONDS = 5.0
"""The length is part of the definition: 1, 2 and 5 s show 0.04, 0.08 and 0.31 deg for the same filter in hover."""
MIN_SAMPLES = 20
GAP_S, GAP_STEPS = 0.25, 5.0
"""A longer interval between samples of the row is a gap."""
ROUND_S = 0.05
"""A span that misses its last window by less has it."""


def lay(span: Span, phase: str) -> list[Span]:
    """Windows from the start of a span; a rest of 2 to 5 s is one window."""
    length = span[1] - span[0]
    count = int((length + ROUND_S) // SECONDS)
    if count == 0 and phase == "rest" and length >= SHORTEST_S - ROUND_S:
        return [span]
    return [(span[0] + SECONDS * k, span[0] + SECONDS * (k + 1)) for k in range(count)]


def samples(t: Array, x: Array, segment: NDArray[np.int64], window: Span) -> slice | None:
    """The samples of a window; None where they are under 20, hold a gap, a reset or a NaN, or leave an end open.

    ``t`` (n,) s, ``x`` (n, k), ``segment`` (n,) counts restarts and resets.
    """
    i, j = (int(k) for k in np.searchsorted(t, [window[0] - 1e-9, window[1] - 1e-9]))
    if j - i < MIN_SAMPLES or segment[i] != segment[j - 1] or not np.isfinite(x[i:j]).all():
        return None
    steps = np.diff(t[i:j])
    ends = max(t[i] - window[0], window[1] - t[j - 1] - ROUND_S)
    gap = max(GAP_S, GAP_STEPS * float(np.median(steps)))
    return slice(i, j) if max(float(np.max(steps)), float(ends)) <= gap else None


def of_row(case: Case, row: Row, phase: str, window: str) -> list[list[tuple[Span, slice]]]:
    """The usable windows of a row in a phase, span by span: their times, which rows share, and the row's samples."""
    found = [of_span(case, row, phase, span) for span in phase_spans(case, phase, window)]
    return [group for group in found if group]


def of_span(case: Case, row: Row, phase: str, span: Span) -> list[tuple[Span, slice]]:
    """The same of one span."""
    start, segment = own_start(case, row), row_segments(case, row)
    laid = [w for w in lay(span, phase) if w[0] >= start - ROUND_S]
    own = [(w, samples(row.t, row.q, segment, w)) for w in laid]
    return [(w, s) for w, s in own if s is not None]
