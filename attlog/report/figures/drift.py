"""How fast the heading drifts: against one heading reference at a time, and all drifts with their intervals."""

from __future__ import annotations

from typing import Any

from attlog.present.names import heading_reference_name
from attlog.report.figures.figure import PageFigure, Rows, dot, dot_height, dots_text, reach, series
from attlog.report.pack import Store
from attlog.result import Result, Trace

SYMBOLS = {
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

ORDER = ("rest", *(where.removeprefix("against ") for where in SYMBOLS if where != "at rest"))
"""What is shown first where it can be chosen."""


def drift(by: dict[str, list[Trace]], names: Rows, store: Store, result: Result) -> list[PageFigure]:
    """Heading drift against the heading reference that is chosen, and all drifts with their intervals."""
    figures = []
    if by.get("drift"):
        figures.append(headings(by["drift"], names, store))
    dots = drift_dots(result, names)
    if dots:
        symbols = dict.fromkeys(d["where"] for d in dots)
        caption = ", ".join(f"{SYMBOLS.get(where, '○')} {place_text(where)}" for where in symbols)
        caption += ". An interval across zero: no drift that differs from zero. ▶ beyond the figure."
        height, words = dot_height(dots), dots_text(dots, names, "deg/min")
        figures.append(
            PageFigure("drifts", "drifts", "Drift with 95 % interval", caption, height, {"rows": dots}, False, words)
        )
    return figures


def headings(traces: list[Trace], names: Rows, store: Store) -> PageFigure:
    """Heading error with its line, one heading reference at a time."""
    keys = sorted({t.key for t in traces}, key=lambda k: (ORDER.index(k) if k in ORDER else len(ORDER), k))
    views, called = [], []
    for key in keys:
        same = together([t for t in traces if t.key == key])
        drawn, _ = series(same, ("heading", "line"), names, store, 0.001)
        views.append({"series": drawn, "range": [min(float(t.t[0]) for t in same), max(float(t.t[-1]) for t in same)]})
        called.append(f"{'at rest' if key == 'rest' else 'in the air'}, against {heading_reference_name(key)}")
    caption = "One-second means with the fitted line, each minus its own mean; anything but flat is drift."
    words = reach(together([t for t in traces if t.key == keys[0]]), names)
    return PageFigure("drift", "drift", "Heading", caption, 330, {"views": views}, False, words, called)


def drift_dots(result: Result, names: Rows) -> list[dict[str, Any]]:
    """Every drift of every row with its interval, and where it was found."""
    dots: list[dict[str, Any]] = []
    for row in result.estimators:
        for window in row.metrics.values():
            for metric, found in window.items():
                if "drift_" in metric and found.unit == "deg/min" and found.value is not None and row.name in names:
                    where = "at rest" if metric.startswith("drift_rest") else "against " + metric.partition(".")[2]
                    entry = dot(names.index(row.name), found) | {"where": where}
                    if not any(entry | {"n": d["n"]} == d for d in dots):
                        dots.append(entry)
    return dots


def place_text(where: str) -> str:
    """Where a drift was found, in words."""
    word, _, reference = where.partition(" ")
    return f"against {heading_reference_name(reference)}" if word == "against" else where


def together(traces: list[Trace]) -> list[Trace]:
    """Those that share time with the longest: a row may have its longest rest elsewhere."""
    longest = max(traces, key=lambda t: float(t.t[-1] - t.t[0]))
    return [t for t in traces if t.t[0] <= longest.t[-1] and t.t[-1] >= longest.t[0]]
