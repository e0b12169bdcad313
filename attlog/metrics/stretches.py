"""Stretches of samples: where a span of time meets a run of data."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.segments import runs
from attlog.segments.spans import Span

Array = NDArray[np.float64]


def unbroken(t: Array, inside: NDArray[np.bool_], run: NDArray[np.int64] | None = None) -> list[slice]:
    """Index ranges of consecutive samples (n,) that are inside, cut at gaps of ``t`` and where the run changes."""
    piece = runs.pieces(t)
    return runs.stretches(inside, piece if run is None else runs.numbered(piece, run))


def within(t: Array, span: Span, run: NDArray[np.int64] | None = None) -> list[slice]:
    """Unbroken stretches of samples with span[0] <= t <= span[1]; ``t`` (n,) s ascending."""
    i, j = int(np.searchsorted(t, span[0], side="left")), int(np.searchsorted(t, span[1], side="right"))
    found = unbroken(t[i:j], np.ones(j - i, bool), None if run is None else run[i:j])
    return [slice(s.start + i, s.stop + i) for s in found]


def seconds(t: Array, pieces: list[slice]) -> float:
    """Time covered by the stretches, s."""
    return float(sum(t[s.stop - 1] - t[s.start] for s in pieces))
