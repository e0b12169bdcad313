"""How quiet: close-up at rest, histogram, Allan deviation."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.report.bundle import ArrayPacker
from attlog.report.figures.canvas import (
    Canvas,
    PageFigure,
    Rows,
    as_array,
    json_numbers,
    packed_series,
    range_words,
    reduction_text,
)
from attlog.report.figures.panels import Panel, decades, panels
from attlog.report.figures.style import axis, below
from attlog.result import Trace
from attlog.words.numbers import duration, moment

ANGLES = ("roll", "pitch", "heading")


def rest_figures(by: dict[str, list[Trace]], names: Rows, store: ArrayPacker) -> list[PageFigure]:
    """At rest: close-up, histogram, Allan deviation of one angle at a time."""
    figures = []
    if by.get("rest"):
        same = by["rest"]
        span = [min(float(t.t[0]) for t in same), max(float(t.t[-1]) for t in same)]
        drawn, ratio = packed_series(same, ANGLES, names, store, 1e-5)
        caption = (
            f"{duration(span[1] - span[0])} from {moment(span[0], 0)} on, motors off. "
            "Each line minus its straight line; ▲ a filter that bends far more leaves the figure. "
            + reduction_text(ratio)
        )
        data = {"series": drawn, "range": span}
        figures.append(PageFigure("rest", "rest", "Rest, close up", caption, 430, data, words=range_words(same, names)))
    if by.get("spread"):
        caption = "Roll and pitch together, after a straight line is taken out of every 5 s."
        data = {
            "x": json_numbers(by["spread"][0].columns["angle"]),
            "shares": [{"r": names.index(t.row), "y": json_numbers(t.columns["share"])} for t in by["spread"]],
        }
        figures.append(PageFigure("spread", "spread", "Spread", caption, 330, data, wide=False))
    if by.get("allan"):
        caption = "Down: noise averages out. Up: the angle wanders. Pointing at a line: 95 % interval."
        keys = [a for a in ANGLES if any(t.key == a for t in by["allan"])] or [""]
        columns = ("tau", "deviation", "low", "high")
        views = [
            {
                "curves": [
                    {"r": names.index(t.row)} | {c: json_numbers(t.columns[c]) for c in columns if c in t.columns}
                    for t in by["allan"]
                    if t.key == key
                ]
            }
            for key in keys
        ]
        title = "Allan deviation of the angle"
        figures.append(PageFigure("allan", "allan", title, caption, 330, {"views": views}, wide=False, views=keys))
    return figures


MIN_REST_RANGE_DEG = 0.002
"""Degrees that a panel at rest shows at least."""


def draw_rest(canvas: Canvas, data: dict[str, Any]) -> None:
    """Roll, pitch and heading at rest, each minus its straight line."""
    columns = [Panel(key, f"{key}, °", MIN_REST_RANGE_DEG) for key in ("roll", "pitch", "heading")]
    panels(canvas, data["series"], columns, tuple(data["range"]), calm=True)


def draw_spread(canvas: Canvas, data: dict[str, Any]) -> None:
    """How the angles are spread: the share of the samples in each bin."""
    x = as_array(data["x"])
    for share in canvas.drawn_rows(data["shares"]):
        canvas.row(share["r"], x, as_array(share["y"]), line={"shape": "hvh"})
    canvas.axes["xaxis"] = below("angle, °")
    canvas.axes["yaxis"] = axis("share of samples, %", rangemode="tozero", nticks=6)


def draw_allan(canvas: Canvas, data: dict[str, Any]) -> None:
    """Allan deviation with its 95 % interval as bars."""
    curves = canvas.drawn_rows(data["curves"])
    for c in curves:
        tau, deviation = as_array(c["tau"]), as_array(c["deviation"])
        bars: dict[str, Any] = {}
        if "low" in c:
            up, down = as_array(c["high"]) - deviation, deviation - as_array(c["low"])
            sizes = {"array": np.nan_to_num(up), "arrayminus": np.nan_to_num(down)}
            look = {"thickness": 0.67, "width": 1.5, "color": canvas.rows[c["r"]].colour}
            bars = {"error_y": {"type": "data", "symmetric": False} | sizes | look}
        canvas.row(c["r"], tau, deviation, **bars)
    taus, deviations = (np.concatenate([as_array(c[k]) for c in curves] or [np.zeros(0)]) for k in ("tau", "deviation"))
    canvas.axes["xaxis"] = below("averaging time τ, s", type="log", **decades(taus, 5))
    canvas.axes["yaxis"] = axis("Allan deviation, °", type="log", **decades(deviations, 6))
