"""Segments of samples: where a span of time meets a continuous segment of data."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.segments import gaps
from attlog.segments.spans import Span

Array = NDArray[np.float64]


def unbroken(t: Array, inside: NDArray[np.bool_], segment_of: NDArray[np.int64] | None = None) -> list[slice]:
    """Index ranges of consecutive samples (n,) that are inside, cut at gaps of ``t`` and where ``segment_of`` (n,) changes."""
    segment = gaps.number(t)
    return gaps.slices(inside, segment if segment_of is None else gaps.renumber(segment, segment_of))


def within(t: Array, span: Span, segment_of: NDArray[np.int64] | None = None) -> list[slice]:
    """Unbroken segments of samples with span[0] <= t <= span[1]; ``t`` (n,) s ascending."""
    i, j = int(np.searchsorted(t, span[0], side="left")), int(np.searchsorted(t, span[1], side="right"))
    found = unbroken(t[i:j], np.ones(j - i, bool), None if segment_of is None else segment_of[i:j])
    return [slice(s.start + i, s.stop + i) for s in found]


def seconds(t: Array, pieces: list[slice]) -> float:
    """Time covered by the segments, s."""
    return float(sum(t[s.stop - 1] - t[s.start] for s in pieces))
