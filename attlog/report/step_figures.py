"""How much lag: movements laid on their start, lags with intervals, response to the set-point."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.present.rows import AIR, find
from attlog.report.figure import Figure, Rows, dot, dot_height, number, series, told
from attlog.report.pack import BUDGET, Store
from attlog.result import Result, Trace


def steps(by: dict[str, list[Trace]], names: Rows, store: Store, result: Result) -> list[Figure]:
    """Quick movements: one at a time, all lags as dots, set-point response."""
    figures = []
    if by.get("step"):
        events: dict[tuple[str, str, int], list[dict[str, Any]]] = {}
        count: dict[tuple[str, str], int] = {}
        for trace in by["step"]:
            i = count.get((trace.row, trace.key), 0)
            count[trace.row, trace.key] = i + 1
            axis, _, at = trace.key.partition("@")
            columns = {c: store.values(np.asarray(trace.columns[c], np.float64), 0.002) for c in ("est", "ref")}
            line = {"r": names.index(trace.row), "t": store.times(np.asarray(trace.t, np.float64)), "y": columns}
            events.setdefault((axis, at, 0 if at else i), []).append(line)
        movements = [{"axis": axis, "at": at, "lines": lines} for (axis, at, _), lines in events.items()]
        caption = "Angle about the moving axis since the start of the movement. Below: filter minus reference."
        figures.append(Figure("step", "step", "One movement at a time", caption, 430, {"events": movements}))
    dots = lag_dots(result, names)
    if dots:
        caption = (
            "Line: lag with 95 % interval; small dots: single movements, hollow where the row is not judged. "
            "Grey: half an IMU sample either way."
        )
        rate = float((result.log.get("imu") or {}).get("rate_hz") or 0.0)
        data = {"rows": dots, "half": 500.0 / rate if rate > 0 else 0.0}
        figures.append(
            Figure("lag", "lag", "Lag", caption, dot_height(dots), data, wide=False, words=told(dots, names, "ms"))
        )
    if by.get("setpoint"):
        axes = tuple(dict.fromkeys(c for t in by["setpoint"] for c in t.columns))
        drawn, _ = series(by["setpoint"], axes, names, store, BUDGET // 10, 1e-4)
        caption = "How the vehicle followed its set-point: a property of vehicle and controller, not of a filter."
        caption += " Solid: roll, dashed: pitch." if {"roll", "pitch"} <= set(axes) else ""
        figures.append(
            Figure("setpoint", "setpoint", "Response to the set-point", caption, 330, {"series": drawn}, wide=False)
        )
    return figures


def lag_dots(result: Result, names: Rows) -> list[dict[str, Any]]:
    """Lag of every row that has one: value, interval, single movements; of a row that is not judged only these."""
    out = []
    for row in result.estimators:
        found = find(row, "lag_ms", AIR)
        single = [x for x in found.each if number(x)] if found is not None else []
        if found is not None and row.name in names and (found.value is not None or single):
            out.append(dot(names.index(row.name), found) | {"single": single})
    return out
