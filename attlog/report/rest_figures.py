"""How quiet: close-up at rest, histogram, Allan deviation."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from attlog.present.numbers import duration, moment
from attlog.report.figure import Figure, Rows, listed, reach, said, series
from attlog.report.pack import BUDGET, Array, Store
from attlog.result import Trace

BINS = 61


def rest(by: dict[str, list[Trace]], names: Rows, store: Store) -> list[Figure]:
    """At rest: close-up, histogram, Allan deviation."""
    figures = []
    if by.get("rest"):
        longest = max(by["rest"], key=lambda t: float(t.t[-1] - t.t[0]))
        same = [levelled(t) for t in by["rest"] if t.key == longest.key]
        span = [float(longest.t[0]), float(longest.t[-1])]
        drawn, ratio = series(same, ("roll", "pitch", "heading"), names, store, BUDGET, 1e-5)
        caption = (
            f"{duration(span[1] - span[0])} from {moment(span[0], 0)} on, motors off. "
            "Each line minus its straight line; a filter that still bends far more than the others leaves the figure. "
            + said(ratio)
        )
        figures.append(
            Figure(
                "rest",
                "rest",
                "Rest, close up",
                caption,
                430,
                {"series": drawn, "range": span},
                words=reach(same, names),
            )
        )
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


def levelled(trace: Trace) -> Trace:
    """A rest trace minus the straight line through each of its angles: noise and wander without drift."""
    columns = {}
    for name, column in trace.columns.items():
        y = np.asarray(column, np.float64)
        good = np.isfinite(y)
        u = trace.t - trace.t[0]
        columns[name] = y - np.polynomial.Polynomial.fit(u[good], y[good], 1)(u) if good.sum() > 2 else y
    return Trace(trace.figure, trace.row, trace.t, columns, trace.key)


def histogram(traces: list[Trace], names: Rows) -> dict[str, Any]:
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
