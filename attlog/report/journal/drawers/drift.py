"""How fast the heading drifts against one heading reference."""

from __future__ import annotations

from typing import Any

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.lines import fitted, leaving, thinned
from attlog.report.journal.panels import time_axis
from attlog.report.journal.store import array
from attlog.report.journal.style import AXIS_LINE, STRONG, axis


def drift(canvas: Canvas, data: dict[str, Any]) -> None:
    """Means of a second, pale, and the fitted line."""
    for s in canvas.drawn_rows(data["series"]):
        t, drawn = array(s["t"]), s["y"]
        if "heading" in drawn:
            pale = {"width": AXIS_LINE, "dash": "solid"}
            canvas.row(s["r"], *thinned(t, array(drawn["heading"])), line=pale, opacity=0.6, key="line" not in drawn)
        if "line" in drawn:
            canvas.row(s["r"], *thinned(t, array(drawn["line"])), line={"width": STRONG})
    canvas.axes["xaxis"] = time_axis(tuple(data["range"]))
    canvas.axes["yaxis"] = axis("heading, °", range=fitted(canvas, canvas.traces, 0.1, True), nticks=6)
    leaving(canvas)
