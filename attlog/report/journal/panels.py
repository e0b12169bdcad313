"""Panels one above the other that share flight time, and what stands on that axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.legend import Key, text_width
from attlog.report.journal.lines import fitted, leaving, thinned
from attlog.report.journal.store import array
from attlog.report.journal.style import DASH, DOT, INK, axis, below, palette

GAP = 0.05
"""Between panels, as a share of the figure."""
MANY_MARKS = 80
"""More marks of a kind than these cannot be seen singly: they are not drawn."""
MOST_ALARMS = 60


@dataclass(frozen=True, slots=True)
class Panel:
    """A column of the traces with the title of its axis. ``cut``: where the circle of headings is cut open, deg."""

    key: str
    title: str
    least: float = 0.2
    wraps: bool = False
    cut: float | None = None
    more: dict[str, Any] = field(default_factory=dict)

    def line(self, stored: dict[str, Any], span: tuple[float, float]) -> tuple[Any, Any]:
        """Times and values of stored lines in this panel."""
        y = array(stored["y"][self.key])
        if self.cut is not None:
            y = y - 360.0 * np.floor((y - self.cut) / 360.0)
        return thinned(array(stored["t"]), y, span, self.wraps)


def domains(n: int) -> list[list[float]]:
    """The vertical places of ``n`` panels from the top down."""
    height = (1.0 - GAP * (n - 1)) / n
    return [[max(1.0 - i * (height + GAP) - height, 0.0), 1.0 - i * (height + GAP)] for i in range(n)]


def axis_key(i: int) -> str:
    """What the vertical axis of panel ``i`` is called: y, y2, y3."""
    return f"y{i + 1}" if i else "y"


def panels(
    canvas: Canvas,
    series: Sequence[dict[str, Any]],
    columns: Sequence[Panel],
    span: tuple[float, float],
    *,
    calm: bool = False,
    between: tuple[float, float] = (-np.inf, np.inf),
) -> None:
    """Lines of the rows in each panel, below them the time; what is ``between`` sets the ranges."""
    canvas.height = 72.0 * len(columns) if len(columns) > 1 else 120.0
    place = domains(len(columns))
    canvas.axes["xaxis"] = time_axis(span, axis_key(len(columns) - 1))
    for i, panel in enumerate(columns):
        key = axis_key(i)
        for s in canvas.drawn_rows(series):
            if panel.key in s["y"]:
                canvas.row(s["r"], *panel.line(s, span), yaxis=key)
        own = [t for t in canvas.traces if t.get("yaxis") == key]
        seen = fitted(canvas, own, panel.least, calm, between)
        canvas.axes["yaxis" + key[1:]] = axis(panel.title, domain=place[i], nticks=5, range=seen) | panel.more
    leaving(canvas)


def before_the_crash(canvas: Canvas, start: float = -np.inf) -> tuple[float, float]:
    """From when to when values set ranges, where a flight ended in a crash."""
    crash = canvas.marks["crash"]
    return start, np.inf if crash is None else float(crash)


def time_axis(span: tuple[float, float], anchor: str = "y") -> dict[str, Any]:
    """The axis of flight time."""
    return below("time, s", range=list(span), anchor=anchor)


def phases(canvas: Canvas) -> None:
    """In the air, at rest, impact, gaps and jumps behind a figure of flight time."""
    marks, (low, high), colours = canvas.marks, canvas.span, palette()

    def seen(kind: str) -> list[list[Any]]:
        return [m for m in marks[kind] if (m[1] if len(m) > 2 else m[0]) >= low and m[0] <= high]

    def few(kind: str) -> list[list[Any]]:
        return found if len(found := seen(kind)) <= MANY_MARKS else []

    for a, b, *_ in marks["airborne"]:
        canvas.band(a, b, colours["arm"])
    for a, b, *_ in few("rest"):
        canvas.band(a, b, colours["rest"])
    for a, b, *_ in marks["impact"]:
        canvas.band(a, max(a, b), colours["crash"])
        canvas.upright(a, colours["bad"])
    for a, b, *_ in few("gaps"):
        canvas.band(a, b, colours["gap"])
        canvas.key(Key("gap", colours["mu"], fill=True))
    for t, *_ in few("resets"):
        canvas.upright(t, colours["bad"], DOT)
        canvas.key(Key("jump of onboard", colours["bad"], DOT))
    _labels(canvas)


def _labels(canvas: Canvas) -> None:
    """The names of phases above their places, where there is room between them."""
    low, high = canvas.span
    taken: list[tuple[float, float]] = []
    words = [(a, a, "impact") for a, *_ in canvas.marks["impact"] if low <= a <= high]
    words += [(a, b, "in the air") for a, b, *_ in canvas.marks["airborne"]]
    words += [(a, b, "rest") for a, b, *_ in canvas.marks["rest"]]
    for a, b, word in words:
        if b < low or a > high:
            continue
        middle = 0.5 * (max(a, low) + min(b, high))
        half = 0.5 * (text_width(word) + 4.0) / canvas.inside * (high - low)
        fits = word == "impact" or min(b, high) - max(a, low) >= 2.0 * half
        if fits and all(middle + half < a or middle - half > b for a, b in taken):
            taken.append((middle - half, middle + half))
            canvas.note(middle, word, palette()["bad"] if word == "impact" else INK)
        elif word == "in the air":
            canvas.key(Key(word, palette()["mu"], fill=True))


def alarms(canvas: Canvas) -> None:
    """Failsafes and critical messages as dashed lines."""
    times = [t for t, level, _ in canvas.marks["texts"] if level == 2 and canvas.span[0] <= t <= canvas.span[1]]
    for t in times[:MOST_ALARMS]:
        canvas.upright(t, palette()["bad"], DASH)
        canvas.key(Key("failsafe, critical message", palette()["bad"], DASH))


def decades(values: NDArray[np.float64], most: int) -> dict[str, Any]:
    """1, 2, 5 of every decade as ticks of a logarithmic axis."""
    good = values[np.isfinite(values) & (values > 0)]
    if not len(good):
        return {}
    low, high = np.log10(good.min()), np.log10(good.max())
    steps = (1,) if high - low > 2 else (1, 2, 5)
    ticks = [m * 10.0**d for d in range(int(np.floor(low)), int(np.floor(high)) + 1) for m in steps]
    ticks = ticks[::2] if len(ticks) > 2 * most else ticks
    return {"tickvals": ticks, "ticktext": [f"{v:.10f}".rstrip("0").rstrip(".") if v < 1 else f"{v:g}" for v in ticks]}
