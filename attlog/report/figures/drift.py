"""Figures of heading drift and lag: fitted lines, and values with intervals by row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from attlog.report.figures.figure import FigureSource, PageFigure, View, interval_of, is_number, range_words
from attlog.report.figures.style import safe
from attlog.result import Answer, Trace
from attlog.words.names import heading_reference_name
from attlog.words.numbers import interval, quantity
from attlog.words.ranking import AIR, find_answer

# Marker of a drift by its origin: sign in the caption, plotly symbol, filled or not.
DRIFT_PLACES = {
    "at rest": ("●", "circle", True),
    "against truth": ("◆", "diamond", True),
    "against smoother": ("◇", "diamond", False),
    "against onboard": ("○", "circle", False),
    "against mag": ("□", "square", False),
    "against gnss_yaw": ("△", "triangle-up", False),
    "against yaw_estimator": ("⬠", "pentagon", False),
    "against course": ("▽", "triangle-down", False),
}
VIEW_ORDER = ("rest", *(where.removeprefix("against ") for where in DRIFT_PLACES if where != "at rest"))
# Values beyond this multiple of the largest ranked value are outside the figure.
FAR_DOT_FACTOR = 4.0
BOUNDED = ["filter", "quantity", "value", "lower", "upper", "n", "unit"]


def drift(source: FigureSource) -> PageFigure | None:
    """Draw the heading error with its fitted line, one heading reference per view."""
    found = source.traces("drift")
    if not found:
        return None
    keys = sorted({t.key for t in found}, key=lambda k: (VIEW_ORDER.index(k) if k in VIEW_ORDER else 99, k))
    views, names = [], []
    for key in keys:
        own, view = overlapping([t for t in found if t.key == key]), source.view()
        name = f"{'at rest' if key == 'rest' else 'in the air'}, against {heading_reference_name(key)}"
        for r, trace in source.by_depth(own):
            if "heading" in trace.columns:
                meta = {"time": True, "step": 0.001, "quantity": f"heading error, {name}", "keyless": True}
                y = trace.columns["heading"]
                view.row(r, trace.t, y, unit="deg", width=1.1, dash="solid", opacity=0.7, meta=meta)
            if "line" in trace.columns:
                meta = {"time": True, "step": 0.001, "quantity": f"fitted line, {name}", "quiet": True}
                view.row(r, trace.t, trace.columns["line"], unit="deg", width=2.6, meta=meta)
        span = [min(float(t.t[0]) for t in own), max(float(t.t[-1]) for t in own)]
        view.axis("x", "time, s", range=span)
        view.axis("y", "heading, °", fit={"least": 0.1, "calm": True})
        views.append(view.as_data())
        names.append(name)
    caption = "One-second means with the fitted line, each minus its own mean; anything but flat is drift."
    words = range_words(overlapping([t for t in found if t.key == keys[0]]), source)
    data = {"views": views, "labels": "end", "table": ["time_s", "filter", "quantity", "value", "unit"]}
    return PageFigure("drift", "plot", "Heading", caption, 330, data, False, words, names)


def overlapping(traces: list[Trace]) -> list[Trace]:
    """Keep the traces that overlap the longest one in time."""
    longest = max(traces, key=lambda t: float(t.t[-1] - t.t[0]))
    return [t for t in traces if t.t[0] <= longest.t[-1] and t.t[-1] >= longest.t[0]]


class AnswerDot(NamedTuple):
    """Value of row ``r`` with interval, origin, and the single values behind it."""

    r: int
    value: float
    ci95: list[float] | None
    ranked: bool
    n: int
    where: str = ""
    single: tuple[float, ...] = ()

    @classmethod
    def of(cls, r: int, answer: Answer, **more: Any) -> AnswerDot:
        """Return the dot of an answer with value and interval."""
        return cls(r, float(answer.value or 0.0), interval_of(answer), answer.ranked, answer.n, **more)


def drifts(source: FigureSource) -> PageFigure | None:
    """Draw every drift of every row with its interval, one symbol per origin."""
    dots = drift_dots(source)
    if not dots:
        return None
    places = dict.fromkeys(d.where for d in dots)
    caption = ", ".join(f"{DRIFT_PLACES.get(where, ('○',))[0]} {place_text(where)}" for where in places)
    caption += ". An interval across zero: no drift that differs from zero. ▶ beyond the figure."
    view = dot_view(source, dots, "drift", "deg/min")
    view.axes["xaxis"]["title"] = "drift of the heading, °/min"
    return _dots_figure("drifts", "Drift with 95 % interval", caption, view, dots, source, "deg/min")


def drift_dots(source: FigureSource) -> list[AnswerDot]:
    """Collect every drift once, even if several windows have it."""
    dots: list[AnswerDot] = []
    for row in source.result.estimators:
        for window in row.metrics.values():
            for metric, found in window.items():
                if (
                    "drift_" not in metric
                    or found.unit != "deg/min"
                    or found.value is None
                    or row.name not in source.styles
                ):
                    continue
                where = "at rest" if metric.startswith("drift_rest") else "against " + metric.partition(".")[2]
                dot = AnswerDot.of(source.index(row.name), found, where=where)
                if not any((dot.r, dot.value, dot.ci95, dot.where) == (d.r, d.value, d.ci95, d.where) for d in dots):
                    dots.append(dot)
    return dots


def place_text(where: str) -> str:
    """Describe the origin of a drift in words."""
    word, _, reference = where.partition(" ")
    return f"against {heading_reference_name(reference)}" if word == "against" else where


def lag(source: FigureSource) -> PageFigure | None:
    """Draw the lag of each row with its interval and single steps."""
    dots = []
    for row in source.result.estimators:
        found = find_answer(row, "lag_ms", AIR)
        if found is not None and row.name in source.styles and found.value is not None:
            single = tuple(float(x) for x in found.each if is_number(x)) if found.ranked else ()
            dots.append(AnswerDot.of(source.index(row.name), found, single=single))
    if not dots:
        return None
    caption = (
        "Line: lag with 95 % interval; small dots: single steps. Hollow: not ranked. "
        "▶ beyond the figure. Grey: half an IMU sample either way."
    )
    view = dot_view(source, dots, "lag", "ms")
    view.axes["xaxis"]["title"] = "lag (left: ahead, right: behind), ms"
    rate = float((source.result.log.get("imu") or {}).get("rate_hz") or 0.0)
    if rate > 0:
        view.span(-500.0 / rate, 500.0 / rate, "arm")
        view.note("± half an IMU sample", x=0.0)
    return _dots_figure("lag", "Lag", caption, view, dots, source, "ms")


def _dots_figure(
    name: str, title: str, caption: str, view: View, dots: list[AnswerDot], source: FigureSource, unit: str
) -> PageFigure:
    height = 90 + 34 * max(len({d.r for d in dots}), 2)
    data = {"views": [view.as_data()], "hover": "closest", "table": BOUNDED}
    return PageFigure(name, "plot", title, caption, height, data, False, dots_words(dots, source, unit))


def dot_view(source: FigureSource, dots: Sequence[AnswerDot], what: str, unit: str) -> View:
    """Draw one line per row, with its dots one above the other.

    Hollow dots are not ranked, or measured against a reference that is no truth.
    """
    view = source.view()
    low, high = dot_range(source, dots)
    rows = list(dict.fromkeys(d.r for d in dots))
    for r in rows:
        own = [d for d in dots if d.r == r]
        for i, d in enumerate(own):
            singles = [x for x in d.single if low <= x <= high]
            if singles:
                _singles(view, d, singles, unit)
            offset = 0.28 - 0.56 * i / (len(own) - 1) if len(own) > 1 else 0.0
            _dot(view, d, offset, (low, high), f"{what} {d.where}".strip(), unit)
    view.axis("x", "", range=[low, high])
    view.axis("y", "", rows=rows, fixedrange=True, zeroline=False)
    view.upright(0.0, "tx", width=1)
    return view


def _dot(view: View, d: AnswerDot, offset: float, ends: tuple[float, float], what: str, unit: str) -> None:
    """Add a value with its interval; an arrow if it lies outside the figure."""
    style = view.rows[d.r]
    colour = f"e{style.slot}"
    _, symbol, full = DRIFT_PLACES.get(d.where, ("○", "circle", not d.where))
    symbol = "triangle-left" if d.value < ends[0] else "triangle-right" if d.value > ends[1] else symbol
    inside = ends[0] <= d.value <= ends[1]
    filled = colour if full and d.ranked is not False else "bg"
    marker = {"size": 9, "symbol": symbol, "color": filled, "line": {"color": colour, "width": 2}}
    said = f"{style.name}{', ' + place_text(d.where) if d.where else ''}: {quantity(d.value, unit)}"
    said += f" ({interval(d.ci95, unit)})" if d.ci95 else ""
    meta = {"row": d.r, "quantity": what, "n": d.n, "value": d.value, "ci": d.ci95, "places": place_text(d.where)}
    more: dict[str, Any] = {}
    if inside and d.ci95:
        sizes = {"array": [d.ci95[1] - d.value], "arrayminus": [d.value - d.ci95[0]]}
        more["error_x"] = {"type": "data", "symmetric": False, "color": colour, "thickness": 2, "width": 4} | sizes
    view.markers(
        style.name,
        [min(max(d.value, ends[0]), ends[1])],
        [offset],
        marker,
        unit=unit,
        meta=meta,
        hovertemplate=safe(said, 160) + "<extra></extra>",
        cliponaxis=inside,
        **more,
    )


def _singles(view: View, d: AnswerDot, values: list[float], unit: str) -> None:
    """Add single values as small dots around the line of their row."""
    offsets = [((i * 7919) % 101) / 101 * 0.5 - 0.25 for i in range(len(values))]
    marker = {"size": 5, "color": f"e{view.rows[d.r].slot}", "opacity": 0.55}
    name = view.rows[d.r].name
    meta = {"row": d.r, "quantity": "lag of one step", "keyless": True}
    hover = safe(name) + ": %{x:.0f} ms<extra></extra>"
    view.markers(name, values, offsets, marker, unit=unit, meta=meta, hovertemplate=hover)


def dot_range(source: FigureSource, dots: Sequence[AnswerDot]) -> tuple[float, float]:
    """Return the axis range, set by ranked values, by all of rows that are not lost where none is ranked.

    Values and intervals far beyond them leave the figure.
    """
    kept = [d for d in dots if not source.rows[d.r].lost]
    sound = [d for d in kept if d.ranked is not False] or kept
    core = sorted(abs(d.value) for d in sound or dots)
    most = max(1e-3, core[-1] if sound else core[len(core) // 2])
    values = [v for d in dots for v in (d.value, *d.single)] + [v for d in sound or dots for v in d.ci95 or ()]
    near = np.array([0.0, *(v for v in values if abs(v) < FAR_DOT_FACTOR * most)])
    pad = 0.08 * float(near.max() - near.min()) or 1.0
    return float(near.min()) - pad, float(near.max()) + pad


def dots_words(dots: Sequence[AnswerDot], source: FigureSource, unit: str) -> str:
    """Describe dots in words: row, origin, value and interval."""
    parts = []
    for d in dots:
        bounds = f" ({interval(d.ci95, unit)})" if d.ci95 else ""
        where = f" {d.where}" if d.where else ""
        parts.append(f"{source.rows[d.r].name}{where}: {quantity(d.value, unit)}{bounds}")
    return "; ".join(parts)
