"""Figures of attitude steps: one step, all steps, response to the set-point."""

from __future__ import annotations

import numpy as np

from attlog.report.figures.figure import FigureSource, PageFigure
from attlog.result import Trace
from attlog.words.numbers import counted, moment
from attlog.words.ranking import AIR, count_best

# Quantisation of a single step, deg.
MOVED_STEP = 0.002
# Largest number of reference samples with individual markers.
MARKED_SAMPLES = 90
SINCE = "time from the start of the step, ms"
DASHES = {"roll": "solid", "pitch": "dash", "yaw": "dot"}


def one_step(source: FigureSource) -> PageFigure | None:
    """Draw one step: turn of set-point, reference, filters; below their error."""
    found = source.traces("step")
    if not found:
        return None
    axis, _, at = found[0].key.partition("@")
    view, quantity = source.view(), f"{axis} change"
    meta = {"quantity": quantity, "step": MOVED_STEP}
    for r, trace in source.by_depth(found):
        t, turned = 1e3 * trace.t, trace.columns["est"]
        view.row(r, t, turned, unit="deg", width=1.8, yaxis="y", meta=meta)
        off = {"quantity": f"{quantity} minus reference", "step": MOVED_STEP}
        view.row(r, t, turned - trace.columns["ref"], unit="deg", width=1.8, yaxis="y2", meta=off)
    longest = max(found, key=lambda trace: len(trace.t))
    choice = source.result.reference.choice if source.result.reference else ""
    style = source.styles.get(choice)
    colour = "e0" if style is None else f"e{style.slot}"
    t = 1e3 * longest.t
    mode = {"mode": "lines+markers", "marker": {"size": 5, "color": colour}} if len(t) < MARKED_SAMPLES else {}
    dash = "solid" if style is None else style.dash
    view.line("reference", colour, t, longest.columns["ref"], unit="deg", width=2.4, dash=dash, meta=meta, **mode)
    wanted = "set" in longest.columns
    if wanted:
        view.line("set-point", "mu", t, longest.columns["set"], unit="deg", width=2, dash="dash", meta=meta)
    view.axis("x", SINCE, anchor="y2")
    view.axis("y", f"{axis} change, °", domain=[0.42, 1], fit={"least": 1.0, "calm": True})
    view.axis("y2", "error, °", domain=[0, 0.34], nticks=5, fit={"least": 0.5, "calm": True})
    title = f"One step in {axis}{f', at {moment(float(at), 1)}' if at else ''}"
    caption = "The step of middle size about the axis that moved most often. Thick: reference"
    caption += f"{', grey dashes: set-point' if wanted else ''}. Below: filter minus reference."
    table = ["time_s", "filter", "quantity", "value", "unit"]
    data = {"views": [view.as_data()], "labels": "end", "at": " ms", "scale": 1e-3, "table": table}
    return PageFigure("step", "plot", title, caption, 430, data)


def all_steps(source: FigureSource) -> PageFigure | None:
    """Draw each filter's median over all steps, and one filter's middle 80 %."""
    found = source.traces("steps")
    if not found:
        return None
    views, names = [], []
    for key in dict.fromkeys(t.key for t in found):
        own = source.by_depth(t for t in found if t.key == key)
        view = source.view()
        for r, trace in own:
            x, c = 1e3 * trace.t, trace.columns
            known = np.isfinite(c["median"])
            name = f"{source.rows[r].name}: 80 % of the steps"
            view.band(name, f"e{source.rows[r].slot}", x[known], c["low"][known], c["high"][known], meta={"band": r})
        for r, trace in own:
            x, c = 1e3 * trace.t, trace.columns
            known = np.isfinite(c["median"])
            meta = {"quantity": f"median error, {key}", "low": c["low"][known], "high": c["high"][known], "digits": 1}
            view.row(r, x[known], c["median"][known], unit="% of the step", width=2, meta=meta | {"say": " %"})
        view.axis("x", SINCE, range=[float(1e3 * own[0][1].t[0]), float(1e3 * own[0][1].t[-1])])
        view.axis("y", "error, % of the step", fit={"least": 4.0, "calm": True})
        count = int(max(t.values.get("events", 0.0) for _, t in own))
        views.append(view.as_data())
        names.append(f"{key} ({counted(count, 'step')})" if count else key)
    caption = "All steps laid on their start, filter minus reference in % of the step. Lines: medians. "
    caption += "Band: the middle 80 % of the steps of one filter."
    table = ["time_s", "filter", "quantity", "value", "p10", "p90", "unit"]
    data = {"views": views, "band": source.index(first_band(found, source)), "labels": "end", "at": " ms"}
    data |= {"scale": 1e-3, "table": table}
    bands = [(r, source.rows[r].name) for r in sorted({source.index(t.row) for t in found})]
    return PageFigure("steps", "plot", "All steps together", caption, 360, data, views=names, bands=bands)


def first_band(traces: list[Trace], source: FigureSource) -> str:
    """Return the row whose band is drawn first: most often best."""
    result = source.result
    best = next((w["lag_ms"] for w in (result.best.get(name, {}) for name in AIR) if w.get("lag_ms")), [])
    drawn = list(dict.fromkeys(t.row for t in traces))
    return max([row for row in drawn if row in best] or drawn, key=lambda row: count_best(result, row))


def setpoint(source: FigureSource) -> PageFigure | None:
    """Draw the response of the vehicle to a step of its set-point."""
    found = source.traces("setpoint")
    if not found:
        return None
    view = source.view()
    for trace in found:
        for key, y in trace.columns.items():
            style = source.styles[trace.row]
            meta = {"quantity": key, "row": source.index(trace.row), "step": 1e-4}
            dash = DASHES.get(key, style.dash)
            view.line(key, f"e{style.slot}", 1e3 * trace.t, y, width=2.2, dash=dash, unit="1", meta=meta)
    view.axis("x", "time after the command, ms")
    view.axis("y", "share of the command")
    axes = {c for t in found for c in t.columns}
    caption = "How the vehicle followed its set-point: a property of vehicle and controller, not of a filter."
    caption += " Solid: roll, dashed: pitch." if {"roll", "pitch"} <= axes else ""
    table = ["time_s", "quantity", "value", "unit"]
    data = {"views": [view.as_data()], "labels": "end", "at": " ms", "scale": 1e-3, "table": table}
    return PageFigure("setpoint", "plot", "Response to the set-point", caption, 330, data, wide=False)
