"""The path over ground, north up, with arrows of heading and course."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.legend import Key
from attlog.report.journal.lines import share
from attlog.report.journal.store import array
from attlog.report.journal.style import AXIS_LINE, DOT, INK, LINE, axis, below, palette

Array = NDArray[np.float64]

HEIGHT = 230.0
LONG = 18.0
"""Pixels of an arrow."""
MOST = 60
"""Arrows of a kind."""
LEAST_M = 4.0
"""What the figure shows at least from bottom to top."""
MARGIN = 1.15


def track(canvas: Canvas, data: dict[str, Any]) -> None:
    """Metres, equal on both axes; arrows all along the path that is in sight, by distance flown."""
    t, east, north = (array(data[name]) for name in ("t", "east", "north"))
    driven = array(data["driven"]) > 0
    seen = (t >= canvas.span[0]) & (t <= canvas.span[1]) & np.isfinite(north)
    canvas.height = HEIGHT
    flown = driven & np.concatenate([[False], driven[:-1]])
    if (seen & ~flown).any():
        line = {"width": AXIS_LINE, "dash": DOT}
        canvas.plain("on the ground", palette()["mu"], east[seen], np.where(flown, np.nan, north)[seen], line=line)
    canvas.plain("path", palette()["mu"], east[seen], np.where(driven, north, np.nan)[seen])
    fit = np.flatnonzero(seen & driven) if (seen & driven).any() else np.flatnonzero(seen)
    if not len(fit):
        fit = np.zeros(1, np.int64)
    ends, scale = _ends(canvas, east[fit], north[fit])
    canvas.axes["xaxis"] = below("east, m", range=ends[0])
    canvas.axes["yaxis"] = axis("north, m", range=ends[1], scaleanchor="x", nticks=7)
    for name, colour in (("course", palette()["ac"]), ("heading", INK)):
        angles = array(data[name])
        at = _spaced(east, north, fit[np.isfinite(angles[fit])], 1.1 * LONG * scale)
        _arrows(canvas, name, east[at], north[at], np.radians(angles[at]), LONG * scale, colour)
    for name, symbol, i in (("start", "circle", fit[0]), ("end", "square", fit[-1])):
        marker = {"symbol": symbol, "size": 6, "color": "#ffffff", "line": {"color": INK, "width": LINE}}
        canvas.marker([east[i]], [north[i]], marker, hoverinfo="skip")
        canvas.key(Key(name, INK, symbol=symbol, full=False))


def _ends(canvas: Canvas, east: Array, north: Array) -> tuple[tuple[list[float], list[float]], float]:
    """The ranges of both axes, and how many metres a pixel is."""
    sides = [(share(x, 0.002), share(x, 0.998)) for x in (east, north)]
    pixels = (canvas.inside, canvas.height)
    longest = [(high - low) / p for (low, high), p in zip(sides, pixels, strict=True)]
    scale = MARGIN * max(*longest, LEAST_M / canvas.height)
    half = [0.5 * scale * p for p in pixels]
    return (
        [0.5 * sum(sides[0]) - half[0], 0.5 * sum(sides[0]) + half[0]],
        [0.5 * sum(sides[1]) - half[1], 0.5 * sum(sides[1]) + half[1]],
    ), scale


def _spaced(east: Array, north: Array, at: NDArray[np.int64], apart: float) -> NDArray[np.int64]:
    """Of the places those that are so many metres apart along the path, at most MOST."""
    if not len(at):
        return at
    flown = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(east[at]), np.diff(north[at])))])
    step = max(apart, flown[-1] / MOST, 1e-9)
    places: NDArray[np.int64] = np.searchsorted(flown, np.arange(0.0, flown[-1] + step, step)).clip(max=len(at) - 1)
    return np.asarray(at[np.unique(places)])


def _arrows(canvas: Canvas, name: str, east: Array, north: Array, angle: Array, long: float, colour: str) -> None:
    """Shafts as one line, heads as markers turned to the picture's top."""
    tips = east + long * np.sin(angle), north + long * np.cos(angle)
    gap = np.full(len(east), np.nan)
    shafts = [np.column_stack([a, b, gap]).ravel() for a, b in zip((east, north), tips, strict=True)]
    canvas.plain(name, colour, *shafts, hoverinfo="skip")
    marker = {"symbol": "triangle-up", "size": 4, "color": colour, "angle": np.degrees(angle)}
    canvas.marker(*tips, marker, hoverinfo="skip")
