"""How quiet: close-up at rest, histogram, Allan deviation."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.panels import Panel, decades, panels
from attlog.report.journal.store import array
from attlog.report.journal.style import axis, below

LEAST = 0.002
"""Degrees that a panel at rest shows at least."""


def rest(canvas: Canvas, data: dict[str, Any]) -> None:
    """Roll, pitch and heading at rest, each minus its straight line."""
    columns = [Panel(key, f"{key}, °", LEAST) for key in ("roll", "pitch", "heading")]
    panels(canvas, data["series"], columns, tuple(data["range"]), calm=True)


def spread(canvas: Canvas, data: dict[str, Any]) -> None:
    """How the angles are spread: the share of the samples in each bin."""
    x = array(data["x"])
    for share in canvas.drawn_rows(data["shares"]):
        canvas.row(share["r"], x, array(share["y"]), line={"shape": "hvh"})
    canvas.axes["xaxis"] = below("angle, °")
    canvas.axes["yaxis"] = axis("share of samples, %", rangemode="tozero", nticks=6)


def allan(canvas: Canvas, data: dict[str, Any]) -> None:
    """Allan deviation with its 95 % interval as bars."""
    curves = canvas.drawn_rows(data["curves"])
    for c in curves:
        tau, deviation = array(c["tau"]), array(c["deviation"])
        bars: dict[str, Any] = {}
        if "low" in c:
            up, down = array(c["high"]) - deviation, deviation - array(c["low"])
            sizes = {"array": np.nan_to_num(up), "arrayminus": np.nan_to_num(down)}
            look = {"thickness": 0.67, "width": 1.5, "color": canvas.rows[c["r"]].colour}
            bars = {"error_y": {"type": "data", "symmetric": False} | sizes | look}
        canvas.row(c["r"], tau, deviation, **bars)
    taus, deviations = (np.concatenate([array(c[k]) for c in curves] or [np.zeros(0)]) for k in ("tau", "deviation"))
    canvas.axes["xaxis"] = below("averaging time τ, s", type="log", **decades(taus, 5))
    canvas.axes["yaxis"] = axis("Allan deviation, °", type="log", **decades(deviations, 6))
