"""Windows of 5 s: the unit in which noise is measured, the same for every row of a log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.metrics.base import Case, per_times
from attlog.metrics.evidence.phases import SHORTEST_S, own_start, phase_spans
from attlog.metrics.evidence.samples import row_segments
from attlog.reference.model import Row
from attlog.segments.spans import Span

Array = NDArray[np.float64]

SECONDS = 5.0
"""The length is part of the definition: 1, 2 and 5 s show 0.04, 0.08 and 0.31 deg for the same filter in hover."""
TOGETHER = 1 << 15
"""Samples of windows that are looked at at once."""
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
    return whole(filled(t, window), x, segment)


def filled(t: Array, window: Span) -> slice | None:
    """The samples of times (n,) s in a window; None where they are under 20, hold a gap or leave an end open."""
    i, j = (int(k) for k in np.searchsorted(t, [window[0] - 1e-9, window[1] - 1e-9]))
    if j - i < MIN_SAMPLES:
        return None
    steps = np.diff(t[i:j])
    ends = max(t[i] - window[0], window[1] - t[j - 1] - ROUND_S)
    gap = max(GAP_S, GAP_STEPS * float(np.median(steps)))
    return slice(i, j) if max(float(np.max(steps)), float(ends)) <= gap else None


def whole(inside: slice | None, x: Array, segment: NDArray[np.int64]) -> slice | None:
    """The samples again where ``x`` (n, k) knows all of them and they are of one segment (n,), else None."""
    if inside is None or segment[inside.start] != segment[inside.stop - 1]:
        return None
    return inside if rotation.finite(x[inside]).all() else None


def together(inside: Sequence[slice]) -> Iterator[tuple[list[slice], NDArray[np.int64], NDArray[np.int64]]]:
    """Ranges of samples, some at a time, with the samples' numbers behind each other and where each range begins there.

    The last of these (ranges + 1,) is the end.
    """
    ends = np.cumsum([part.stop - part.start for part in inside])
    edges = [0, *(np.flatnonzero(np.diff((ends - 1) // TOGETHER)) + 1).tolist(), len(inside)]
    for a, b in pairwise(edges):
        if b > a:
            own = list(inside[a:b])
            lengths = [part.stop - part.start for part in own]
            yield own, np.concatenate([np.arange(p.start, p.stop) for p in own]), np.cumsum([0, *lengths])


@per_times
def filled_in(case: Case, t: Array, phase: str, span: Span) -> list[tuple[Span, slice | None]]:
    """The windows of a span with the samples of times (n,) in each: of all rows that have these times."""
    return [(window, filled(t, window)) for window in lay(span, phase)]


def of_row(case: Case, row: Row, phase: str, window: str) -> list[list[tuple[Span, slice]]]:
    """The usable windows of a row in a phase, span by span: their times, which rows share, and the row's samples."""
    found = [of_span(case, row, phase, span) for span in phase_spans(case, phase, window)]
    return [group for group in found if group]


def of_span(case: Case, row: Row, phase: str, span: Span) -> list[tuple[Span, slice]]:
    """The same of one span."""
    start, segment = own_start(case, row), row_segments(case, row)
    laid = [(w, s) for w, s in filled_in(case, row.t, phase, span) if w[0] >= start - ROUND_S]
    own = [(w, whole(s, row.q, segment)) for w, s in laid]
    return [(w, s) for w, s in own if s is not None]
