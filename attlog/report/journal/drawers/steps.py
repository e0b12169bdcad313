"""How much lag: one step, all steps, the response to the set-point."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.legend import Key
from attlog.report.journal.lines import fitted, leaving
from attlog.report.journal.store import array
from attlog.report.journal.style import DASH, DOT, INK, STRONG, axis, below, faded, palette, safe

FEW = 90
"""Samples of a reference that are marked one by one."""
SINCE = "time from the start of the step, ms"
RESPONSES = {"roll": "solid", "pitch": DASH, "yaw": DOT}


def step(canvas: Canvas, data: dict[str, Any]) -> None:
    """What reference, set-point and filters turned in one step; below: filter minus reference."""
    canvas.height = 170.0
    longest = max(data["lines"], key=lambda line: len(array(line["t"])))
    x = 1e3 * array(longest["t"])
    if "set" in longest["y"]:
        dashed = {"color": palette()["mu"], "dash": DASH}
        canvas.plain("set-point", INK, x, array(longest["y"]["set"]), line=dashed, yaxis="y")
    marked = "lines+markers" if len(x) < FEW else "lines"
    own = canvas.rows[data["reference"]] if "reference" in data else None
    line = {"width": STRONG} | ({} if own is None else {"color": own.colour, "dash": own.dash})
    reference = {"line": line, "marker": {"size": 3, "color": line.get("color", INK)}, "mode": marked}
    canvas.plain("reference", INK, x, array(longest["y"]["ref"]), yaxis="y", **reference)
    for line in canvas.drawn_rows(data["lines"]):
        t, turned = 1e3 * array(line["t"]), array(line["y"]["est"])
        canvas.row(line["r"], t, turned, yaxis="y")
        canvas.row(line["r"], t, turned - array(line["y"]["ref"]), yaxis="y2")
    upper, lower = ([t for t in canvas.traces if t["yaxis"] == key] for key in ("y", "y2"))
    canvas.axes["xaxis"] = below(SINCE, anchor="y2")
    canvas.axes["yaxis"] = axis(
        f"{safe(data['axis'])} change, °", domain=[0.45, 1], range=fitted(canvas, upper, 1.0, True), nticks=6
    )
    canvas.axes["yaxis2"] = axis("error, °", domain=[0, 0.39], range=fitted(canvas, lower, 0.5, True), nticks=5)
    leaving(canvas)


def steps(canvas: Canvas, data: dict[str, Any]) -> None:
    """Median over all steps of filter minus reference; the band of one filter holds 80 % of them."""
    x = array(data["x"])
    lines = canvas.drawn_rows(data["lines"])
    for line in [line for line in lines if line["r"] == data["band"]] or lines[:1]:
        own = canvas.rows[line["r"]]
        known = np.isfinite(array(line["median"]))
        canvas.edge(x[known], array(line["low"])[known], meta=line["r"])
        fill = {"fill": "tonexty", "fillcolor": faded(own.colour, 0.25)}
        canvas.edge(x[known], array(line["high"])[known], meta=line["r"], **fill)
        canvas.key(Key(f"{own.name}: 80 % of the steps", own.colour, fill=True))
    for line in lines:
        known = np.isfinite(array(line["median"]))
        canvas.row(line["r"], x[known], array(line["median"])[known])
    canvas.axes["xaxis"] = below(SINCE, range=[x[0], x[-1]])
    canvas.axes["yaxis"] = axis("error, % of the step", range=fitted(canvas, canvas.traces, 4.0, True), nticks=6)
    leaving(canvas)


def setpoint(canvas: Canvas, data: dict[str, Any]) -> None:
    """How the vehicle follows a step of its set-point."""
    for s in data["series"]:
        t = 1e3 * array(s["t"])
        for key, y in s["y"].items():
            canvas.plain(key, INK, t, array(y), line={"dash": RESPONSES.get(key, "solid")})
    canvas.axes["xaxis"] = below("time after the command, ms")
    canvas.axes["yaxis"] = axis("share of the command", nticks=6)
