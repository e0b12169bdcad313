"""How fast the heading drifts: against every heading reference, and all drifts with their intervals."""

from __future__ import annotations

import numpy as np

from attlog.present.names import heading_reference_name
from attlog.report.figure import Figure, Rows, dot, dot_height, reach, series, told
from attlog.report.pack import BUDGET, Store
from attlog.result import Result, Trace

SYMBOLS = {
    "at rest": "●",
    "against truth": "◆",
    "against smoother": "◇",
    "against onboard": "○",
    "against mag": "□",
    "against gnss_yaw": "△",
    "against course": "▽",
}
"""How a drift is drawn by where it was found; the script has the same list."""


def drift(by: dict[str, list[Trace]], names: Rows, store: Store, result: Result) -> list[Figure]:
    """Heading drift against every heading reference, and all drifts with their intervals."""
    figures = []
    traces = by.get("drift", [])
    keys = sorted({t.key for t in traces}, key=lambda k: (k.partition("@")[0] != "rest", k))
    for i, key in enumerate(keys):
        same = together([t for t in traces if t.key == key])
        drawn, _ = series([centred(t) for t in same], ("heading", "line"), names, store, BUDGET // 4, 0.001)
        place = "at rest" if key == "rest" else "in the air"
        title = f"Heading {place}, against {heading_reference_name(key)}"
        caption = "One-second means with the fitted line, each minus its own mean; anything but flat is drift."
        caption = caption if i == 0 else ""
        words = reach(same, names)
        data = {"series": drawn, "range": [min(float(t.t[0]) for t in same), max(float(t.t[-1]) for t in same)]}
        figures.append(Figure(f"drift{i}", "drift", title, caption, 330, data, wide=False, words=words))
    dots = []
    for row in result.estimators:
        for window in row.metrics.values():
            for metric, found in window.items():
                if "drift_" in metric and found.unit == "deg/min" and found.value is not None and row.name in names:
                    where = "at rest" if metric.startswith("drift_rest") else "against " + metric.partition(".")[2]
                    entry = dot(names.index(row.name), found) | {"where": where}
                    if entry not in dots:
                        dots.append(entry)
    if dots:
        symbols = dict.fromkeys(d["where"] for d in dots)
        caption = ", ".join(f"{SYMBOLS.get(where, '○')} {told_where(where)}" for where in symbols)
        caption += ". An interval across zero: no drift that differs from zero."
        figures.append(
            Figure(
                "drifts",
                "drifts",
                "Drift with 95 % interval",
                caption,
                dot_height(dots),
                {"rows": dots},
                wide=False,
                words=told(dots, names, "deg/min"),
            )
        )
    return figures


def told_where(where: str) -> str:
    """Where a drift was found, in words."""
    word, _, reference = where.partition(" ")
    return f"against {heading_reference_name(reference)}" if word == "against" else where


def together(traces: list[Trace]) -> list[Trace]:
    """Those that share time with the longest: a row may have its longest rest elsewhere."""
    longest = max(traces, key=lambda t: float(t.t[-1] - t.t[0]))
    return [t for t in traces if t.t[0] <= longest.t[-1] and t.t[-1] >= longest.t[0]]


def centred(trace: Trace) -> Trace:
    """A drift trace minus the mean of its heading, so that slopes compare."""
    heading = np.asarray(trace.columns["heading"], np.float64)
    good = np.isfinite(heading)
    mean = float(np.mean(heading[good])) if good.any() else 0.0
    columns = {name: np.asarray(y, np.float64) - mean for name, y in trace.columns.items()}
    return Trace(trace.figure, trace.row, trace.t, columns, trace.key)
