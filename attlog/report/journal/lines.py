"""Long lines made short, the range that shows them, and an arrow where one leaves it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.store import array

Array = NDArray[np.float64]

BUCKETS = 600
"""Of a line: two to a pixel of the column."""
CALM = 8.0
"""In a calm figure a row that moves so many times as far as the middle one may leave it."""
FAR = 0.985
"""Share of the values that set a range: a bump on landing leaves the figure."""


MOSTLY = 0.05
"""A row more of whose values leave the figure is drawn pale: else its strokes hide the others."""


def thinned(t: Array, y: Array, span: tuple[float, float] | None = None, wraps: bool = False) -> tuple[Array, Array]:
    """Smallest and largest value (and a gap) of each bucket of a line (n,) within a span; a full turn breaks it."""
    if span is not None:
        a, b = np.searchsorted(t, span[0], "left"), np.searchsorted(t, span[1], "right")
        t, y = t[max(a - 1, 0) : b + 1], y[max(a - 1, 0) : b + 1]
    if len(t) > 2 * BUCKETS:
        edges = np.linspace(0, len(t), BUCKETS + 1).astype(np.int64)
        kept = _extremes(y, edges)
        t, y = t[kept], y[kept]
    if wraps:
        turns = np.flatnonzero(np.abs(np.diff(y)) > 180.0) + 1
        t, y = np.insert(t, turns, t[turns]), np.insert(y, turns, np.nan)
    return t, y


def _extremes(y: Array, edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where the smallest, the largest and the first missing value of each bucket are, in order."""
    buckets = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    by_size = np.lexsort((y, buckets))  # what is missing comes last in its bucket
    known = np.bincount(buckets[np.isfinite(y)], minlength=len(edges) - 1)
    some = known > 0
    low, high = by_size[edges[:-1][some]], by_size[(edges[:-1] + known - 1)[some]]
    holes = by_size[(edges[:-1] + known)[known < np.diff(edges)]]
    return np.unique(np.concatenate([low, high, holes]))


def fitted(
    canvas: Canvas,
    traces: Iterable[dict[str, Any]],
    least: float,
    calm: bool = False,
    between: tuple[float, float] = (-np.inf, np.inf),
) -> list[float]:
    """A range, ``least`` wide or wider, for lines: diverged rows do not set it; values not ``between`` do not."""
    lines = [(t.get("meta"), array(t["x"]), array(t["y"])) for t in traces]
    sound = [line for line in lines if line[0] is None or not canvas.rows[line[0]].lost] or lines
    if calm and sound:
        travel = [float(np.nanmax(y) - np.nanmin(y)) if np.isfinite(y).any() else 0.0 for _, _, y in sound]
        far = CALM * sorted(travel)[len(travel) // 2]
        sound = [line for line, moved in zip(sound, travel, strict=True) if moved <= far] or sound
    start = between[0] if any(len(x) and x[-1] > between[0] for _, x, _ in sound) else -np.inf
    end = between[1] if any(len(x) and x[0] < between[1] for _, x, _ in sound) else np.inf
    parts = [y[(x >= start) & (x <= end) & np.isfinite(y)] for _, x, y in sound]
    values = np.concatenate([*parts, np.zeros(0)])
    if not len(values):
        return [-least, least]
    low, high = float(values.min()), float(values.max())
    pad = max(0.06 * (high - low), 0.5 * (least - (high - low)), 1e-6)
    return [low - pad, high + pad]


def share(values: Array, p: float) -> float:
    """The value that a share of all lies below."""
    ordered = np.sort(values[np.isfinite(values)])
    return float(ordered[min(int(p * len(ordered)), len(ordered) - 1)]) if len(ordered) else 0.0


def within(t: Array, y: Array, span: tuple[float, float]) -> Array:
    """Finite values of a line in a span."""
    return y[np.isfinite(y) & (t >= span[0]) & (t <= span[1])]


def leaving(canvas: Canvas) -> None:
    """An arrow at the edge where the line of a row leaves the figure; one that mostly does is pale."""
    for t in list(canvas.traces):
        key = t.get("yaxis", "y")
        ax = canvas.axes.get("yaxis" + key[1:], {})
        if t.get("meta") is None or "fill" in t or t.get("mode") != "lines" or "range" not in ax:
            continue
        x, y = array(t["x"]), array(t["y"])
        seen = canvas.axes["xaxis"].get("range", [-np.inf, np.inf])
        here = (x >= seen[0]) & (x <= seen[1])
        for edge, beyond, symbol in ((1, y > ax["range"][1], "triangle-up"), (0, y < ax["range"][0], "triangle-down")):
            out = np.flatnonzero(beyond & here)
            if len(out) > MOSTLY * len(y):
                t["opacity"] = 0.35
            if len(out):
                marker = {"symbol": symbol, "size": 6, "color": canvas.rows[t["meta"]].colour}
                canvas.marker([x[out[0]]], [ax["range"][edge]], marker, yaxis=key, cliponaxis=False, hoverinfo="skip")


def beyond(canvas: Canvas, colour: str, t: Array, y: Array, top: float) -> None:
    """Arrows at the upper edge for values beyond it."""
    out = y > top
    if out.any():
        marker = {"symbol": "triangle-up", "size": 5, "color": colour}
        canvas.marker(t[out], np.full(int(out.sum()), top), marker, cliponaxis=False, hoverinfo="skip")
