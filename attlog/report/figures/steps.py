"""How much lag: one step like most, what all have in common, lags with intervals, response to the set-point."""

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
    is_number,
    json_numbers,
    packed_series,
    packed_trace,
)
from attlog.report.figures.panels import fitted, leaving
from attlog.report.figures.style import DASH, DOT, INK, STRONG, axis, below, faded, palette, safe
from attlog.result import Result, Trace
from attlog.words.numbers import counted, moment
from attlog.words.ranking import AIR, count_best, find_answer

MOVED_STEP = 0.002
"""Degrees per stored step of a single step."""


def step_figures(by: dict[str, list[Trace]], names: Rows, store: ArrayPacker, result: Result) -> list[PageFigure]:
    """Steps: one of them, all of them, lags as dots, set-point response."""
    figures = []
    if by.get("step"):
        figures.append(step_figure(by["step"], names, store, result))
    if by.get("steps"):
        figures.append(steps_figure(by["steps"], names, first_band(by["steps"], result)))
    dots = lag_dots(result, names)
    if dots:
        caption = (
            "Line: lag with 95 % interval; small dots: single steps. Hollow: not ranked. "
            "▶ beyond the figure. Grey: half an IMU sample either way."
        )
        rate = float((result.log.get("imu") or {}).get("rate_hz") or 0.0)
        data = {"rows": dots, "half": 500.0 / rate if rate > 0 else 0.0}
        figures.append(
            PageFigure(
                "lag", "lag", "Lag", caption, dot_height(dots), data, wide=False, words=dots_words(dots, names, "ms")
            )
        )
    if by.get("setpoint"):
        axes = tuple(dict.fromkeys(c for t in by["setpoint"] for c in t.columns))
        drawn, _ = packed_series(by["setpoint"], axes, names, store, 1e-4)
        caption = "How the vehicle followed its set-point: a property of vehicle and controller, not of a filter."
        caption += " Solid: roll, dashed: pitch." if {"roll", "pitch"} <= set(axes) else ""
        figures.append(
            PageFigure("setpoint", "setpoint", "Response to the set-point", caption, 330, {"series": drawn}, wide=False)
        )
    return figures


def step_figure(traces: list[Trace], names: Rows, store: ArrayPacker, result: Result) -> PageFigure:
    """The representative step: what set-point, reference and filters turned since its start."""
    axis, _, at = traces[0].key.partition("@")
    lines = [{"r": names.index(t.row)} | packed_trace(t, ("est", "ref", "set"), store, MOVED_STEP) for t in traces]
    when = f", at {moment(float(at), 1)}" if at else ""
    title = f"One step in {axis}{when}"
    wanted = any("set" in t.columns for t in traces)
    caption = "The step of middle size about the axis that moved most often. "
    caption += (
        "Thick: reference" + (", grey dashes: set-point. " if wanted else ". ") + "Below: filter minus reference."
    )
    data: dict[str, Any] = {"axis": axis, "lines": lines} | ({"t": float(at)} if at else {})
    choice = result.reference.choice if result.reference else ""
    if choice in names:
        data["reference"] = names.index(choice)
    return PageFigure("step", "step", title, caption, 430, data)


def steps_figure(traces: list[Trace], names: Rows, band: str) -> PageFigure:
    """Median of every filter over all steps, the axis to be chosen; the middle 80 % of one, ``band`` at first."""
    keys = list(dict.fromkeys(t.key for t in traces))
    views, called = [], []
    for key in keys:
        own = [t for t in traces if t.key == key]
        count = int(max(t.values.get("events", 0.0) for t in own))
        called.append(f"{key} ({counted(count, 'step')})" if count else key)
        lines = [
            {"r": names.index(t.row)} | {c: json_numbers(t.columns[c]) for c in ("median", "low", "high")} for t in own
        ]
        views.append({"x": json_numbers(1e3 * own[0].t), "lines": lines})
    caption = "All steps laid on their start, filter minus reference in % of the step. Lines: medians. "
    caption += "Band: the middle 80 % of the steps of one filter."
    rows = sorted({names.index(t.row) for t in traces})
    data = {"views": views, "band": names.index(band)}
    bands = [(r, names[r]) for r in rows]
    return PageFigure("steps", "steps", "All steps together", caption, 360, data, views=called, bands=bands)


def first_band(traces: list[Trace], result: Result) -> str:
    """The row whose band is drawn first: of the best in lag, else of all, the one with most best values."""
    best = next((w["lag_ms"] for w in (result.best.get(name, {}) for name in AIR) if w.get("lag_ms")), [])
    drawn = list(dict.fromkeys(t.row for t in traces))
    return max([row for row in drawn if row in best] or drawn, key=lambda row: count_best(result, row))


def lag_dots(result: Result, names: Rows) -> list[dict[str, Any]]:
    """Lag of every row that has one: value, interval, single steps."""
    out = []
    for row in result.estimators:
        found = find_answer(row, "lag_ms", AIR)
        if found is not None and row.name in names and found.value is not None:
            single = [x for x in found.each if is_number(x)] if found.ranked else []
            out.append(answer_dot(names.index(row.name), found) | {"single": single})
    return out


# How much lag: one step, all steps, the response to the set-point.

MARKED_SAMPLES = 90
"""Samples of a reference that are marked one by one."""
SINCE = "time from the start of the step, ms"
RESPONSES = {"roll": "solid", "pitch": DASH, "yaw": DOT}


def draw_step(canvas: Canvas, data: dict[str, Any]) -> None:
    """What reference, set-point and filters turned in one step; below: filter minus reference."""
    canvas.height = 170.0
    longest = max(data["lines"], key=lambda line: len(as_array(line["t"])))
    x = 1e3 * as_array(longest["t"])
    if "set" in longest["y"]:
        dashed = {"color": palette()["mu"], "dash": DASH}
        canvas.plain("set-point", INK, x, as_array(longest["y"]["set"]), line=dashed, yaxis="y")
    marked = "lines+markers" if len(x) < MARKED_SAMPLES else "lines"
    own = canvas.rows[data["reference"]] if "reference" in data else None
    line = {"width": STRONG} | ({} if own is None else {"color": own.colour, "dash": own.dash})
    reference = {"line": line, "marker": {"size": 3, "color": line.get("color", INK)}, "mode": marked}
    canvas.plain("reference", INK, x, as_array(longest["y"]["ref"]), yaxis="y", **reference)
    for line in canvas.drawn_rows(data["lines"]):
        t, turned = 1e3 * as_array(line["t"]), as_array(line["y"]["est"])
        canvas.row(line["r"], t, turned, yaxis="y")
        canvas.row(line["r"], t, turned - as_array(line["y"]["ref"]), yaxis="y2")
    upper, lower = ([t for t in canvas.traces if t["yaxis"] == key] for key in ("y", "y2"))
    canvas.axes["xaxis"] = below(SINCE, anchor="y2")
    canvas.axes["yaxis"] = axis(
        f"{safe(data['axis'])} change, °", domain=[0.45, 1], range=fitted(canvas, upper, 1.0, True), nticks=6
    )
    canvas.axes["yaxis2"] = axis("error, °", domain=[0, 0.39], range=fitted(canvas, lower, 0.5, True), nticks=5)
    leaving(canvas)


def draw_steps(canvas: Canvas, data: dict[str, Any]) -> None:
    """Median over all steps of filter minus reference; the band of one filter holds 80 % of them."""
    x = as_array(data["x"])
    lines = canvas.drawn_rows(data["lines"])
    for line in [line for line in lines if line["r"] == data["band"]] or lines[:1]:
        own = canvas.rows[line["r"]]
        known = np.isfinite(as_array(line["median"]))
        canvas.edge(x[known], as_array(line["low"])[known], meta=line["r"])
        fill = {"fill": "tonexty", "fillcolor": faded(own.colour, 0.25)}
        canvas.edge(x[known], as_array(line["high"])[known], meta=line["r"], **fill)
        canvas.key(Key(f"{own.name}: 80 % of the steps", own.colour, fill=True))
    for line in lines:
        known = np.isfinite(as_array(line["median"]))
        canvas.row(line["r"], x[known], as_array(line["median"])[known])
    canvas.axes["xaxis"] = below(SINCE, range=[x[0], x[-1]])
    canvas.axes["yaxis"] = axis("error, % of the step", range=fitted(canvas, canvas.traces, 4.0, True), nticks=6)
    leaving(canvas)


def draw_setpoint(canvas: Canvas, data: dict[str, Any]) -> None:
    """How the vehicle follows a step of its set-point."""
    for s in data["series"]:
        t = 1e3 * as_array(s["t"])
        for key, y in s["y"].items():
            canvas.plain(key, INK, t, as_array(y), line={"dash": RESPONSES.get(key, "solid")})
    canvas.axes["xaxis"] = below("time after the command, ms")
    canvas.axes["yaxis"] = axis("share of the command", nticks=6)
