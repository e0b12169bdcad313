"""The height over the flight, for a strip that shows it at a glance.

``height``: ``height`` (m) above what the vehicle stood on, means over equal parts of the log; no row. ``top`` (m): the
largest in flight, which the headline tells, where the log shows the ground.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import Stream
from attlog.metrics.base import Case
from attlog.metrics.figures.trace import Trace
from attlog.segments.airborne.heights import height, highest
from attlog.segments.spans import inside

Array = NDArray[np.float64]
Span = tuple[float, float]

POINTS = 400
"""Parts of the log: a strip is no wider."""
STOOD_S = 5.0
"""The ground is what the vehicle stood on within so long before and after a flight."""
LEAST_S = 0.5
"""A log that ends in the air goes on for a moment after the last sample that tells so: there it stood on nothing."""


def height_trace(case: Case) -> list[Trace]:
    """The height that the headline tells; of a log that shows no ground that of its barometer, else of GNSS."""
    air, flights = case.segments.air, case.segments.spans("airborne")
    found = None if air is None or not flights else highest(air.levels, inside(air.grid.t, flights))
    if air is not None and found is not None:
        level, top = found
        known = np.isfinite(level.above)
        t, means = averaged(air.grid.t[known], level.above[known])
        return [Trace("height", "", t, {"height": means}, key=level.source, values={"top": top})]
    stream = height(case.log)
    if stream is None or len(stream.t) < 2 or stream.t[-1] <= stream.t[0]:
        return []
    above = stream.x[:, 0] - ground(stream, flights)
    t, means = averaged(stream.t, above)
    return [Trace("height", "", t, {"height": means}, key=stream.source)]


def ground(stream: Stream, flights: list[Span]) -> Array:
    """The height (n,) of the ground: straight between what was measured before and after each flight.

    A barometer drifts by metres in minutes. Without a flight it is the median, without any ground the lowest height.
    """
    t, x = stream.t, stream.x[:, 0]
    if not flights:
        return np.full(len(t), np.median(x))
    flying = np.zeros(len(t), bool)
    for a, b in flights:
        flying |= (t >= a) & (t <= b)
    stood = [span for a, b in flights for span in ((a - STOOD_S, a), (b, b + STOOD_S))]
    parts = [(t >= a) & (t <= b) & ~flying for a, b in stood]
    long = [part for part in parts if part.any() and np.ptp(t[part]) >= LEAST_S]
    levels = [(float(np.mean(t[part])), float(np.median(x[part]))) for part in long]
    if not levels:
        return np.full(len(t), np.min(x))
    at, level = np.array(sorted(levels)).T
    under: Array = np.interp(t, at, level)
    return under


def averaged(t: Array, x: Array) -> tuple[Array, Array]:
    """Times and means (m,) of x (n,) over at most POINTS equal parts; NaN in a part without any sample."""
    edges = np.linspace(t[0], t[-1], min(POINTS, max(len(t) // 4, 1)) + 1)
    part = np.clip(np.searchsorted(edges, t, "right") - 1, 0, len(edges) - 2)
    count = np.bincount(part, minlength=len(edges) - 1)
    total = np.bincount(part, weights=x, minlength=len(edges) - 1)
    return 0.5 * (edges[:-1] + edges[1:]), np.where(count > 0, total / np.maximum(count, 1), np.nan)
