"""How much lag: one step like most, what all have in common, lags with intervals, response to the set-point."""

from __future__ import annotations

from typing import Any

from attlog.present.numbers import counted, moment
from attlog.present.table.rows import AIR, find, leads
from attlog.report.figures.figure import PageFigure, Rows, dot, dot_height, dots_text, listed, number, series, stored
from attlog.report.pack import Store
from attlog.result import Result, Trace

MOVED_STEP = 0.002
"""Degrees per stored step of a single step."""


def steps(by: dict[str, list[Trace]], names: Rows, store: Store, result: Result) -> list[PageFigure]:
    """Steps: one of them, all of them, lags as dots, set-point response."""
    figures = []
    if by.get("step"):
        figures.append(one_step(by["step"], names, store, result))
    if by.get("steps"):
        figures.append(all_steps(by["steps"], names, first_band(by["steps"], result)))
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
                "lag", "lag", "Lag", caption, dot_height(dots), data, wide=False, words=dots_text(dots, names, "ms")
            )
        )
    if by.get("setpoint"):
        axes = tuple(dict.fromkeys(c for t in by["setpoint"] for c in t.columns))
        drawn, _ = series(by["setpoint"], axes, names, store, 1e-4)
        caption = "How the vehicle followed its set-point: a property of vehicle and controller, not of a filter."
        caption += " Solid: roll, dashed: pitch." if {"roll", "pitch"} <= set(axes) else ""
        figures.append(
            PageFigure("setpoint", "setpoint", "Response to the set-point", caption, 330, {"series": drawn}, wide=False)
        )
    return figures


def one_step(traces: list[Trace], names: Rows, store: Store, result: Result) -> PageFigure:
    """The representative step: what set-point, reference and filters turned since its start."""
    axis, _, at = traces[0].key.partition("@")
    lines = [{"r": names.index(t.row)} | stored(t, ("est", "ref", "set"), store, MOVED_STEP) for t in traces]
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


def all_steps(traces: list[Trace], names: Rows, band: str) -> PageFigure:
    """Median of every filter over all steps, the axis to be chosen; the middle 80 % of one, ``band`` at first."""
    keys = list(dict.fromkeys(t.key for t in traces))
    views, called = [], []
    for key in keys:
        own = [t for t in traces if t.key == key]
        count = int(max(t.values.get("events", 0.0) for t in own))
        called.append(f"{key} ({counted(count, 'step')})" if count else key)
        lines = [{"r": names.index(t.row)} | {c: listed(t.columns[c]) for c in ("median", "low", "high")} for t in own]
        views.append({"x": listed(1e3 * own[0].t), "lines": lines})
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
    return max([row for row in drawn if row in best] or drawn, key=lambda row: leads(result, row))


def lag_dots(result: Result, names: Rows) -> list[dict[str, Any]]:
    """Lag of every row that has one: value, interval, single steps."""
    out = []
    for row in result.estimators:
        found = find(row, "lag_ms", AIR)
        if found is not None and row.name in names and found.value is not None:
            single = [x for x in found.each if number(x)] if found.ranked else []
            out.append(dot(names.index(row.name), found) | {"single": single})
    return out
