"""Arrays of the longest rest: a close-up of each row's angles, and how they are spread."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.base import Case
from attlog.metrics.envelope import Share, envelope
from attlog.metrics.evidence import detrended, deviations, within
from attlog.metrics.settled import own_start
from attlog.metrics.trace import Trace
from attlog.reference.model import Row

Array = NDArray[np.float64]

ANGLES = ("roll", "pitch", "heading")
BINS = 61
WINDOW_S = 5.0
"""As the noise is measured: what is slower is wander."""
FEWEST = 10


def rest_traces(case: Case, rows: list[Row]) -> list[Trace]:
    """``rest`` and ``spread`` of every row that is finite in the longest rest."""
    spans = case.segments.spans("rest")
    if not spans:
        return []
    begin, end = max(spans, key=lambda s: s[1] - s[0])
    found: list[tuple[Row, Array, Array]] = []
    for row in rows:
        start = max(begin, own_start(case, row))
        pieces = within(row.t, (start, end), row.segment) if start < end else []
        piece = max(pieces, key=lambda p: p.stop - p.start, default=None)
        if piece is not None and piece.stop - piece.start > FEWEST and np.isfinite(row.q[piece]).all():
            found.append((row, row.t[piece], deviations(row.q[piece])))
    share = Share.of(len(t) for _, t, _ in found)
    return [*(close_up(row.name, t, angles, share) for row, t, angles in found), *spreads(found)]


def close_up(name: str, t: Array, angles: Array, share: Share) -> Trace:
    """Angles (n, 3) in deg, each minus its straight line: noise and wander without drift."""
    flat = detrended(t, angles)
    at, columns = envelope(t, {a: flat[:, k] for k, a in enumerate(ANGLES)}, share(len(t)))
    return Trace("rest", name, at, columns, ratio=len(t) / len(at))


def spreads(found: list[tuple[Row, Array, Array]]) -> list[Trace]:
    """Shares (%) of the samples of roll and pitch per bin of the angle, the same bins for all rows."""
    residuals = [(row.name, residual(t, angles[:, :2]).ravel()) for row, t, angles in found]
    residuals = [(name, r) for name, r in residuals if len(r) > FEWEST]
    if not residuals:
        return []
    half = max(3.5 * float(np.median([np.std(r) for _, r in residuals])), 1e-4)
    edges = np.linspace(-half, half, BINS + 1)
    middle = 0.5 * (edges[:-1] + edges[1:])
    return [
        Trace("spread", name, middle, {"angle": middle, "share": 100.0 * np.histogram(r, edges)[0] / len(r)})
        for name, r in residuals
    ]


def residual(t: Array, angles: Array) -> Array:
    """Angles (n, k) with a straight line taken out of every 5 s; windows of under 3 samples are left out."""
    edges = np.searchsorted(t, np.arange(t[0], t[-1] + WINDOW_S, WINDOW_S))
    windows = [slice(a, b) for a, b in pairwise(edges) if b - a > 2]
    return np.concatenate([detrended(t[w], angles[w]) for w in windows] or [np.zeros((0, angles.shape[1]))])
