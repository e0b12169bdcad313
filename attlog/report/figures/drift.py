"""How fast the heading drifts: against one heading reference at a time, and all drifts with their intervals."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.report.bundle import ArrayPacker
from attlog.report.figures.canvas import (
    Canvas,
    Key,
    PageFigure,
    Rows,
    answer_dot,
    as_array,
    dot_height,
    dots_words,
    packed_series,
    range_words,
    text_width,
)
from attlog.report.figures.panels import fitted, leaving, thinned, time_axis
from attlog.report.figures.style import AXIS_LINE, INK, LINE, MARKER, STRONG, WIDTH, axis, below, palette
from attlog.result import Result, Trace
from attlog.words.names import heading_reference_name

DRIFT_SIGNS = {
    "at rest": "●",
    "against truth": "◆",
    "against smoother": "◇",
    "against onboard": "○",
    "against mag": "□",
    "against gnss_yaw": "△",
    "against yaw_estimator": "⬠",
    "against course": "▽",
}
"""How a drift is drawn by where it was found; the script has the same list."""

VIEW_ORDER = ("rest", *(where.removeprefix("against ") for where in DRIFT_SIGNS if where != "at rest"))
"""What is shown first where it can be chosen."""


def drift_figures(by: dict[str, list[Trace]], names: Rows, store: ArrayPacker, result: Result) -> list[PageFigure]:
    """Heading drift against the heading reference that is chosen, and all drifts with their intervals."""
    figures = []
    if by.get("drift"):
        figures.append(drift_figure(by["drift"], names, store))
    dots = drift_dots(result, names)
    if dots:
        symbols = dict.fromkeys(d["where"] for d in dots)
        caption = ", ".join(f"{DRIFT_SIGNS.get(where, '○')} {place_text(where)}" for where in symbols)
        caption += ". An interval across zero: no drift that differs from zero. ▶ beyond the figure."
        height, words = dot_height(dots), dots_words(dots, names, "deg/min")
        figures.append(
            PageFigure("drifts", "drifts", "Drift with 95 % interval", caption, height, {"rows": dots}, False, words)
        )
    return figures


def drift_figure(traces: list[Trace], names: Rows, store: ArrayPacker) -> PageFigure:
    """Heading error with its line, one heading reference at a time."""
    keys = sorted(
        {t.key for t in traces}, key=lambda k: (VIEW_ORDER.index(k) if k in VIEW_ORDER else len(VIEW_ORDER), k)
    )
    views, called = [], []
    for key in keys:
        same = overlapping([t for t in traces if t.key == key])
        drawn, _ = packed_series(same, ("heading", "line"), names, store, 0.001)
        views.append({"series": drawn, "range": [min(float(t.t[0]) for t in same), max(float(t.t[-1]) for t in same)]})
        called.append(f"{'at rest' if key == 'rest' else 'in the air'}, against {heading_reference_name(key)}")
    caption = "One-second means with the fitted line, each minus its own mean; anything but flat is drift."
    words = range_words(overlapping([t for t in traces if t.key == keys[0]]), names)
    return PageFigure("drift", "drift", "Heading", caption, 330, {"views": views}, False, words, called)


def drift_dots(result: Result, names: Rows) -> list[dict[str, Any]]:
    """Every drift of every row with its interval, and where it was found."""
    dots: list[dict[str, Any]] = []
    for row in result.estimators:
        for window in row.metrics.values():
            for metric, found in window.items():
                if "drift_" in metric and found.unit == "deg/min" and found.value is not None and row.name in names:
                    where = "at rest" if metric.startswith("drift_rest") else "against " + metric.partition(".")[2]
                    entry = answer_dot(names.index(row.name), found) | {"where": where}
                    if not any(entry | {"n": d["n"]} == d for d in dots):
                        dots.append(entry)
    return dots


def place_text(where: str) -> str:
    """Where a drift was found, in words."""
    word, _, reference = where.partition(" ")
    return f"against {heading_reference_name(reference)}" if word == "against" else where


def overlapping(traces: list[Trace]) -> list[Trace]:
    """Those that share time with the longest: a row may have its longest rest elsewhere."""
    longest = max(traces, key=lambda t: float(t.t[-1] - t.t[0]))
    return [t for t in traces if t.t[0] <= longest.t[-1] and t.t[-1] >= longest.t[0]]


# How fast the heading drifts against one heading reference.


def draw_drift(canvas: Canvas, data: dict[str, Any]) -> None:
    """Means of a second, pale, and the fitted line."""
    for s in canvas.drawn_rows(data["series"]):
        t, drawn = as_array(s["t"]), s["y"]
        if "heading" in drawn:
            pale = {"width": AXIS_LINE, "dash": "solid"}
            canvas.row(s["r"], *thinned(t, as_array(drawn["heading"])), line=pale, opacity=0.6, key="line" not in drawn)
        if "line" in drawn:
            canvas.row(s["r"], *thinned(t, as_array(drawn["line"])), line={"width": STRONG})
    canvas.axes["xaxis"] = time_axis(tuple(data["range"]))
    canvas.axes["yaxis"] = axis("heading, °", range=fitted(canvas, canvas.traces, 0.1, True), nticks=6)
    leaving(canvas)


# Values with their intervals, a line for each row: lag and drift.

DRIFT_SYMBOLS = {
    "against truth": "diamond",
    "against smoother": "diamond",
    "against mag": "square",
    "against gnss_yaw": "triangle-up",
    "against yaw_estimator": "pentagon",
    "against course": "triangle-down",
}
FILLED_PLACES = ("", "at rest", "against truth")
"""Where a drift was found whose dot is filled."""
FAR_DOT_FACTOR = 4.0
"""What is beyond so many times the largest ranked value runs out of the figure."""
LETTERS = 26


def draw_lag(canvas: Canvas, data: dict[str, Any]) -> None:
    """Lag of each row with its interval and its single steps; grey: half a sample of the IMU either way."""
    if data["half"]:
        canvas.band(-data["half"], data["half"], palette()["arm"])
        canvas.key(Key("± half a sample of the IMU", palette()["mu"], fill=True))
    draw_dots(canvas, data["rows"], "lag, ms")


def draw_drifts(canvas: Canvas, data: dict[str, Any]) -> None:
    """Drift of each row with its interval, a symbol for each place where it was found."""
    draw_dots(canvas, data["rows"], "drift of the heading, °/min")
    for where in dict.fromkeys(d["where"] for d in data["rows"] if d["r"] in canvas.shown):
        canvas.key(Key(place_text(where), INK, symbol=DRIFT_SYMBOLS.get(where, "circle"), full=where in FILLED_PLACES))


def draw_dots(canvas: Canvas, found: list[dict[str, Any]], title: str) -> None:
    """A line for each row from the top down; hollow: not ranked, or not against a truth."""
    found = [d for d in found if d["r"] in canvas.shown and d["v"] is not None]
    rows = list(dict.fromkeys(d["r"] for d in found))
    ends = _dot_range(canvas, found)
    places = {r: float(len(rows) - 1 - i) for i, r in enumerate(rows)}
    for r in rows:
        own = [d for d in found if d["r"] == r]
        for i, d in enumerate(own):
            y = places[r] + (0.28 - 0.56 * i / (len(own) - 1) if len(own) > 1 else 0.0)
            _dot(canvas, d, y, ends)
            _singles(canvas, d, places[r], ends)
    names = [n if len(n := canvas.rows[r].name) <= LETTERS else n[: LETTERS - 1] + "…" for r in rows]
    canvas.left = min(12.0 + max(map(text_width, names), default=0.0), 0.42 * WIDTH)
    canvas.height = 16.0 * max(len(rows), 3) * (1.4 if len(found) > len(rows) else 1.0)
    canvas.axes["xaxis"] = below(title, range=ends)
    canvas.axes["yaxis"] = axis(
        "", tickvals=list(places.values()), ticktext=names, range=[-0.6, len(rows) - 0.4], ticks=""
    )
    canvas.upright(0.0, INK, width=AXIS_LINE)


def _dot(canvas: Canvas, d: dict[str, Any], y: float, ends: list[float]) -> None:
    """A value with its interval; beyond the figure an arrow."""
    colour = canvas.rows[d["r"]].colour
    out = -1 if d["v"] < ends[0] else 1 if d["v"] > ends[1] else 0
    full = d.get("where", "") in FILLED_PLACES and d["ok"] is not False
    symbol = ("", "triangle-right", "triangle-left")[out] or DRIFT_SYMBOLS.get(d.get("where", ""), "circle")
    line = {"color": colour, "width": LINE}
    marker = {"size": MARKER + 1.5, "symbol": symbol, "color": colour if full else "#ffffff", "line": line}
    bars = {}
    if d["ci"] and not out:
        sizes = {"array": [d["ci"][1] - d["v"]], "arrayminus": [d["v"] - d["ci"][0]]}
        bars = {"error_x": {"symmetric": False, "color": colour, "thickness": LINE, "width": 2} | sizes}
    canvas.marker([min(max(d["v"], ends[0]), ends[1])], [y], marker, cliponaxis=not out, meta=d["r"], **bars)


def _singles(canvas: Canvas, d: dict[str, Any], y: float, ends: list[float]) -> None:
    """Single steps as small dots around the row's line, those in the figure."""
    x = [v for v in d.get("single", []) if ends[0] <= v <= ends[1]]
    if x:
        away = [y + ((i * 7919) % 101) / 101 * 0.5 - 0.25 for i in range(len(x))]
        marker = {"size": 2.2, "color": canvas.rows[d["r"]].colour, "opacity": 0.55}
        canvas.marker(x, away, marker, meta=d["r"], hoverinfo="skip")


def _dot_range(canvas: Canvas, found: list[dict[str, Any]]) -> list[float]:
    """A range fitted to what is ranked: values far beyond it and intervals far wider leave it."""
    sound = [d for d in found if d["ok"] is not False and not canvas.rows[d["r"]].lost] or found
    most = max([1e-3, *(abs(d["v"]) for d in sound)])
    values = [v for d in found for v in (d["v"], *d.get("single", []))] + [v for d in sound for v in d["ci"] or ()]
    near = np.array([0.0, *(v for v in values if abs(v) < FAR_DOT_FACTOR * most)])
    pad = 0.08 * float(near.max() - near.min()) or 1.0
    return [float(near.min()) - pad, float(near.max()) + pad]
