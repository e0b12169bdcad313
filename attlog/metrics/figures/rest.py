"""Arrays of the longest rest: a close-up of each row's angles, and how they are spread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.base import Case
from attlog.metrics.evidence.phases import own_start
from attlog.metrics.evidence.samples import detrended, deviations, within
from attlog.metrics.figures.trace import Budget, Share, Trace, envelope
from attlog.reference.model import Row

Array = NDArray[np.float64]

ANGLES = ("roll", "pitch", "heading")
BINS = 61
WINDOW_S = 5.0
"""As the noise is measured: what is slower is wander."""
FEWEST = 10
ORDERED = 20_000
"""Values of a longer rest are counted by so many of them, spread evenly over their order."""


class RestTraces:
    """``rest`` and ``spread`` of rows that pass one by one: of each that is finite in the longest rest.

    ``replays``: how many replayed rows will pass; ``onboard``: the rows that pass after them.
    """

    def __init__(self, case: Case, replays: int, onboard: Sequence[Row]) -> None:
        self._case = case
        spans = case.segments.spans("rest")
        self._rest = max(spans, key=lambda s: s[1] - s[0]) if spans else None
        segments = [self._segment(row) for row in onboard]
        self._budget = Budget(replays, sum(p.stop - p.start for p in segments if p is not None))
        self._drawn: list[Trace] = []
        self._scatters: list[Scatter] = []

    def add(self, row: Row) -> None:
        """Draw what a row does at rest; it may be released then."""
        segment = self._segment(row)
        if segment is None:
            return
        t, angles = row.t[segment], deviations(row.q[segment])
        self._drawn.append(close_up(row.name, t, angles, self._budget.share(len(t), row.kind == "replay")))
        self._scatters.append(Scatter.of(row.name, residual(t, angles[:, :2]).ravel()))

    def drawn(self) -> list[Trace]:
        """All traces, the spreads in bins that are the same for all rows."""
        return [*self._drawn, *spreads(self._scatters)]

    def _segment(self, row: Row) -> slice | None:
        """The row's longest segment in the rest; None where it is too short or not finite."""
        if self._rest is None:
            return None
        start = max(self._rest[0], own_start(self._case, row))
        segments = within(row.t, (start, self._rest[1]), row.segment) if start < self._rest[1] else []
        segment = max(segments, key=lambda p: p.stop - p.start, default=None)
        if segment is None or segment.stop - segment.start <= FEWEST or not np.isfinite(row.q[segment]).all():
            return None
        return segment


@dataclass(frozen=True, slots=True)
class Scatter:
    """Values of a row whose distribution is to be counted: their standard deviation, and some of them in order."""

    row: str
    size: float
    ordered: Array

    @classmethod
    def of(cls, row: str, values: Array) -> Scatter:
        """Of values (n,): so many that a share of them is kept to 0.005 %."""
        size = float(np.std(values)) if len(values) else 0.0
        if len(values) > ORDERED:
            values = np.sort(values)[np.linspace(0, len(values) - 1, ORDERED).round().astype(np.int64)]
        return cls(row, size, values)


def close_up(name: str, t: Array, angles: Array, share: Share) -> Trace:
    """Angles (n, 3) in deg, each minus its straight line: noise and wander without drift."""
    flat = detrended(t, angles)
    at, kept = envelope(t, flat, share(len(t)))
    return Trace("rest", name, at, {a: kept[:, k] for k, a in enumerate(ANGLES)}, ratio=len(t) / len(at))


def spreads(scatters: Sequence[Scatter]) -> list[Trace]:
    """Shares (%) of the samples of roll and pitch per bin of the angle, the same bins for all rows."""
    scatters = [s for s in scatters if len(s.ordered) > FEWEST]
    if not scatters:
        return []
    half = max(3.5 * float(np.median([s.size for s in scatters])), 1e-4)
    edges = np.linspace(-half, half, BINS + 1)
    middle = 0.5 * (edges[:-1] + edges[1:])
    shares = [100.0 * np.histogram(s.ordered, edges)[0] / len(s.ordered) for s in scatters]
    return [
        Trace("spread", s.row, middle, {"angle": middle, "share": share})
        for s, share in zip(scatters, shares, strict=True)
    ]


def residual(t: Array, angles: Array) -> Array:
    """Angles (n, k) with a straight line taken out of every 5 s; windows of under 3 samples are left out."""
    edges = np.searchsorted(t, np.arange(t[0], t[-1] + WINDOW_S, WINDOW_S))
    windows = [slice(a, b) for a, b in pairwise(edges) if b - a > 2]
    return np.concatenate([detrended(t[w], angles[w]) for w in windows] or [np.zeros((0, angles.shape[1]))])
