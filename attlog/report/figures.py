"""Which figures a result can fill, and their data for the page script.

Each function returns the figures of one question. A figure exists only where there is
something to draw; the page then says in its place what is missing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from attlog.metrics.answer import Answer
from attlog.metrics.trace import Trace
from attlog.numbers import duration
from attlog.report.look import Look
from attlog.report.pack import BUDGET, Array, Store, reduce
from attlog.report.table import ALL
from attlog.result import Result
from attlog.verdicts import AIR, find

ANGLE_STEP = 0.01
"""Degrees per stored step of whole-flight figures; a screen shows a tenth at best."""

BINS = 61
WITNESS = {
    "rest": "at rest, against standing still",
    "onboard": "in the air, minus onboard",
    "truth": "in the air, minus truth",
    "smoother": "in the air, minus smoother",
    "mag": "in the air, minus magnetometer heading",
    "gnss_yaw": "in the air, minus GNSS heading",
    "course": "in the air, minus GNSS course",
}


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


@dataclass(slots=True)
class Figure:
    """A place in the page: ``kind`` names the drawing function of the script, ``data`` is what it draws."""

    id: str
    kind: str
    title: str
    caption: str
    height: int
    data: dict[str, Any] = field(default_factory=dict)
    wide: bool = True


def sections(result: Result, looks: dict[str, Look], store: Store) -> dict[str, list[Figure]]:
    """Figures by section of the page: flight, rest, step, drift, more."""
    names = list(looks)
    traces = [t for t in result.traces if t.row in looks and len(t.t)]
    by = {kind: [t for t in traces if t.figure == kind] for kind in {t.figure for t in traces}}
    found = {
        "flight": flight(by, names, store, result),
        "rest": rest(by, names, store),
        "step": steps(by, names, store, result),
        "drift": drift(by, names, store, result),
        "more": more(by, names, store, result),
    }
    for part in found.values():
        fill(part)
    return found


def fill(part: list[Figure]) -> None:
    """Make a half-width figure wide where no other stands beside it."""
    beside = 0
    for i, figure in enumerate(part):
        beside = 0 if figure.wide else beside + 1
        if beside % 2 == 1 and (i + 1 == len(part) or part[i + 1].wide):
            figure.wide = True


def series(
    traces: list[Trace], columns: tuple[str, ...], names: list[str], store: Store, budget: int, step: float
) -> tuple[list[dict[str, Any]], float]:
    """Traces reduced to a budget and put into the store, and the ratio of reduction (1: all samples kept)."""
    total = sum(len(t.t) for t in traces)
    out, before, after = [], 0, 0
    for trace in traces:
        keep = max(int(budget * len(trace.t) / total), 200) if total > 1.1 * budget else len(trace.t)
        present = {c: np.asarray(trace.columns[c], np.float64) for c in columns if c in trace.columns}
        t, kept = reduce(np.asarray(trace.t, np.float64), present, keep)
        before, after = before + len(trace.t), after + len(t)
        out.append(
            {
                "r": names.index(trace.row),
                "k": trace.key,
                "t": store.times(t),
                "y": {c: store.values(y, step) for c, y in kept.items()},
            }
        )
    return out, before / after if after else 1.0


def said(ratio: float) -> str:
    """The sentence about reduction."""
    if ratio <= 1.0:
        return "Every sample is stored."
    return f"Stored: smallest and largest value of each stretch, 1 in {ratio:.1f} samples; no peak is lost."


def flight(by: dict[str, list[Trace]], names: list[str], store: Store, result: Result) -> list[Figure]:
    """The whole flight: time strip, attitude, difference."""
    strip = Figure("strip", "strip", "", "", 120)
    figures = [strip]
    if by.get("attitude"):
        drawn, ratio = series(by["attitude"], ("roll", "pitch", "heading"), names, store, BUDGET, ANGLE_STEP)
        caption = (
            "Drag across a figure to zoom: all figures with flight time follow. Double-click to go back. "
            "Dotted red: jumps of the onboard attitude. Dark band: gap in the log. " + said(ratio)
        )
        data = {"series": drawn, "cut": heading_cut(by["attitude"])}
        figures.append(Figure("attitude", "attitude", "Attitude", caption, 470, data))
    if by.get("difference"):
        columns = ("inclination", "roll", "pitch", "heading")
        drawn, ratio = series(by["difference"], columns, names, store, BUDGET, ANGLE_STEP)
        reference = result.reference.choice if result.reference else "onboard"
        caption = {
            "truth": "Zero is the logged truth. ",
            "smoother": "Zero is the smoother. ",
        }.get(reference, "Zero is agreement with onboard, not truth. ")
        caption += "Tilt is the angle between the two down directions. " + said(ratio)
        title = f"Difference from {'onboard' if reference == 'none' else reference}"
        figures.append(Figure("difference", "difference", title, caption, 560, {"series": drawn}))
    return figures


def heading_cut(traces: list[Trace]) -> float:
    """Where to cut the circle of headings open, in degrees: the middle of the widest unused arc."""
    heading = np.concatenate(
        [np.asarray(t.columns["heading"], np.float64) for t in traces if "heading" in t.columns] or [[0.0]]
    )
    counts, _ = np.histogram(heading[np.isfinite(heading)] % 360.0, bins=72, range=(0.0, 360.0))
    used = np.flatnonzero(counts > 0.0005 * max(counts.sum(), 1))
    if len(used) == 0:
        return -180.0
    arcs = np.diff(np.append(used, used[0] + 72))
    widest = int(np.argmax(arcs))
    if arcs[widest] <= 1:
        return float(5.0 * np.argmin(counts))
    return float((5.0 * (used[widest] + arcs[widest] / 2.0 + 0.5)) % 360.0)


def rest(by: dict[str, list[Trace]], names: list[str], store: Store) -> list[Figure]:
    """At rest: close-up, histogram, Allan deviation."""
    figures = []
    if by.get("rest"):
        longest = max(by["rest"], key=lambda t: float(t.t[-1] - t.t[0]))
        same = [t for t in by["rest"] if t.key == longest.key]
        span = [float(longest.t[0]), float(longest.t[-1])]
        drawn, ratio = series(same, ("roll", "pitch", "heading"), names, store, BUDGET, 1e-5)
        caption = (
            f"{duration(span[1] - span[0])} from {span[0]:.0f} s on, motors off. Each line minus its own mean. "
            + said(ratio)
        )
        figures.append(Figure("rest", "rest", "Rest, close up", caption, 430, {"series": drawn, "range": span}))
        spread = histogram(same, names)
        if spread:
            caption = "Roll and pitch together, after a straight line is taken out of every 5 s."
            figures.append(Figure("spread", "spread", "Spread", caption, 330, spread, wide=False))
    if by.get("allan"):
        caption = "Down: noise averages out. Up: the angle wanders. Band on hover: 95 % interval."
        curves = [
            {"r": names.index(t.row), "k": t.key}
            | {c: listed(t.columns[c]) for c in ("tau", "deviation", "low", "high") if c in t.columns}
            for t in by["allan"]
        ]
        figures.append(
            Figure("allan", "allan", "Allan deviation of the angle", caption, 330, {"curves": curves}, wide=False)
        )
    return figures


def histogram(traces: list[Trace], names: list[str]) -> dict[str, Any]:
    """Shares of samples per bin for each row, counted here because the small bundle has no histogram."""
    residual = {t.row: np.concatenate([detrended(t, axis) for axis in ("roll", "pitch")]) for t in traces}
    residual = {row: r[np.isfinite(r)] for row, r in residual.items()}
    residual = {row: r for row, r in residual.items() if len(r) > 10}
    if not residual:
        return {}
    spread = sorted(float(np.std(r)) for r in residual.values())
    half = max(3.5 * spread[len(spread) // 2], 1e-4)
    edges = np.linspace(-half, half, BINS + 1)
    shares = [
        {"r": names.index(row), "y": listed(100.0 * np.histogram(r, edges)[0] / len(r))} for row, r in residual.items()
    ]
    return {"x": listed(0.5 * (edges[:-1] + edges[1:])), "shares": shares}


def detrended(trace: Trace, axis: str) -> Array:
    """A rest trace with a straight line taken out of every 5 s."""
    y = np.asarray(trace.columns.get(axis, np.zeros(0)), np.float64)
    out = np.full(len(y), np.nan)
    if len(y) == 0:
        return out
    window = np.floor((trace.t - trace.t[0]) / 5.0).astype(int)
    edges = np.searchsorted(window, np.arange(window[-1] + 2))
    for i, j in pairwise(edges):
        good = np.isfinite(y[i:j])
        if good.sum() > 2:
            t = trace.t[i:j] - trace.t[i]
            u, v = t[good] - t[good].mean(), y[i:j][good] - y[i:j][good].mean()
            slope = float(u @ v / (u @ u)) if float(u @ u) > 0 else 0.0
            out[i:j] = y[i:j] - y[i:j][good].mean() - slope * (t - t[good].mean())
    return out


def steps(by: dict[str, list[Trace]], names: list[str], store: Store, result: Result) -> list[Figure]:
    """Quick movements: one at a time, all delays as dots, set-point response."""
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
        data = [{"axis": axis, "at": at, "lines": lines} for (axis, at, _), lines in events.items()]
        caption = "Angle about the moving axis since the start of the movement. Below: filter minus reference."
        figures.append(Figure("step", "step", "One movement at a time", caption, 430, {"events": data}))
    dots = lag_dots(result, names)
    if dots:
        caption = (
            "Line: delay with 95 % interval; small dots: single movements, hollow where the row is not judged. "
            "Grey: half an IMU sample either way."
        )
        rate = float((result.log.get("imu") or {}).get("rate_hz") or 0.0)
        data = {"rows": dots, "half": 500.0 / rate if rate > 0 else 0.0}
        figures.append(Figure("lag", "lag", "Delay", caption, dot_height(dots), data, wide=False))
    if by.get("setpoint"):
        columns = tuple(dict.fromkeys(c for t in by["setpoint"] for c in t.columns))
        drawn, _ = series(by["setpoint"], columns, names, store, BUDGET // 10, 1e-4)
        caption = "How the vehicle followed its set-point: a property of vehicle and controller, not of a filter."
        figures.append(
            Figure("setpoint", "setpoint", "Response to the set-point", caption, 330, {"series": drawn}, wide=False)
        )
    return figures


def lag_dots(result: Result, names: list[str]) -> list[dict[str, Any]]:
    """Delay of every row that has one: value, interval, single movements; of a row that is not judged only these."""
    out = []
    for row in result.estimators:
        found = find(row, "lag_ms", AIR)
        single = [float(x) for x in (found.detail.get("each_ms") or []) if number(x)] if found is not None else []
        if found is not None and row.name in names and (found.value is not None or single):
            out.append(dot(names.index(row.name), found) | {"single": single})
    return out


def drift(by: dict[str, list[Trace]], names: list[str], store: Store, result: Result) -> list[Figure]:
    """Heading drift against every witness, and all drifts with their intervals."""
    figures = []
    traces = by.get("drift", [])
    keys = sorted({t.key for t in traces}, key=lambda k: (k.partition("@")[0] != "rest", k))
    for i, key in enumerate(keys):
        same = together([t for t in traces if t.key == key])
        drawn, _ = series([centred(t) for t in same], ("heading", "line"), names, store, BUDGET // 4, 0.001)
        title = "Heading " + WITNESS.get(key, f"minus {key}")
        caption = "One-second means with the fitted line, each minus its own mean; anything but flat is drift."
        data = {"series": drawn, "range": [min(float(t.t[0]) for t in same), max(float(t.t[-1]) for t in same)]}
        figures.append(Figure(f"drift{i}", "drift", title, caption, 330, data, wide=False))
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
        caption = ", ".join(f"{SYMBOLS.get(where, '○')} {where}" for where in symbols)
        caption = f"{caption[0]}{caption[1:]}. An interval across zero: no drift that differs from zero."
        figures.append(
            Figure(
                "drifts", "drifts", "Drift with 95 % interval", caption, dot_height(dots), {"rows": dots}, wide=False
            )
        )
    return figures


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


def more(by: dict[str, list[Trace]], names: list[str], store: Store, result: Result) -> list[Figure]:
    """Gyro bias that the filters found, and cost against accuracy."""
    figures = []
    if by.get("bias"):
        drawn, ratio = series(by["bias"], ("x", "y", "z"), names, store, BUDGET // 2, 1e-4)
        caption = "Subtracted from the logged gyro. Filters without a bias state are not drawn. " + said(ratio)
        figures.append(Figure("bias", "bias", "Gyro bias that the filters found", caption, 430, {"series": drawn}))
    points = []
    for row in result.estimators:
        cost, error = find(row, "cost_ns", ALL), find(row, "inclination_rmse_deg", AIR)
        price = cost.value if cost is not None and cost.value is not None else row.ns_per_update
        if price is not None and number(price) and error is not None and error.value is not None and row.name in names:
            points.append({"r": names.index(row.name), "x": float(price), "y": float(error.value)})
    if points:
        caption = (
            "Left is cheap, down is close to the reference. "
            "Cost: nanoseconds per IMU sample on the machine that made this report."
        )
        figures.append(Figure("cost", "cost", "Cost against tilt error", caption, 330, {"points": points}, wide=False))
    return figures


def dot(r: int, found: Answer) -> dict[str, Any]:
    """A value with its interval as a figure draws it."""
    interval = [float(x) for x in found.ci95] if found.ci95 and all(map(number, found.ci95)) else None
    return {"r": r, "v": None if found.value is None else float(found.value), "ci": interval, "ok": found.ranked}


def dot_height(dots: list[dict[str, Any]]) -> int:
    """Pixels for a figure with one line per row."""
    return 90 + 34 * max(len({d["r"] for d in dots}), 2)


def listed(y: Any) -> list[float | None]:
    """A short array as JSON numbers; what is not finite becomes null."""
    return [float(f"{v:.5g}") if math.isfinite(v) else None for v in np.asarray(y, np.float64).tolist()]


def number(x: Any) -> bool:
    """Whether x is a finite number."""
    return isinstance(x, (int, float, np.number)) and not isinstance(x, bool) and math.isfinite(x)
