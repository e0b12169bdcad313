"""What the onboard estimator rejects: test ratios of its aids over the flight."""

from __future__ import annotations

from attlog.present.numbers import number
from attlog.report.figures.figure import PageFigure, stored
from attlog.report.pack import Store
from attlog.result import Trace

RATIO_STEP = 0.001
AIDS = ("compass", "velocity", "position", "height", "airspeed")
"""Each has its colour; others share the rest of the palette."""


def ratios(traces: list[Trace], store: Store) -> PageFigure:
    """A line for each aid, 1 is the gate of the firmware."""
    known = sorted(traces, key=lambda t: AIDS.index(t.key) if t.key in AIDS else len(AIDS))
    lines = []
    for i, trace in enumerate(known):
        slot = AIDS.index(trace.key) if trace.key in AIDS else max(i, len(AIDS))
        lines.append({"aid": trace.key, "slot": 1 + slot % 8, **stored(trace, ("ratio",), store, RATIO_STEP)})
    highest = ", ".join(f"{t.key} {number(float(t.columns['ratio'].max()))}" for t in known)
    caption = "Distance of each aid from the onboard estimator's prediction, as a share of its gate. "
    caption += "Above 1: rejected. ▲ beyond the figure."
    title = "Test ratios of the onboard estimator"
    return PageFigure("ratios", "ratios", title, caption, 330, {"lines": lines}, True, f"Highest: {highest}")
