"""A flight at a glance: how far it leaned and how far attitudes differed over time, in a few dozen points."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.compare.gates.rows import BASELINES
from attlog.result import Result, Trace

Array = NDArray[np.float64]
Points = list[float | None]

POINTS = 48
"""Points of a thumbnail over the whole log."""
MARKS = ("reset", "impact", "loss_of_control")
MOST_MARKS = 20
FULL_DEG, FULL_BYTE, NO_BYTE = 180.0, 254, 255


def thumbnail(result: Result) -> dict[str, Any] | None:
    """The largest tilt and difference in each of POINTS equal parts of the log, degrees; None without traces.

    ``tilt`` of the attitude that everything is compared with, else of the one that flew, else of a filter.
    ``tilt_diff`` and ``heading_diff`` of ``of``: the attitude that flew, or, where that is the reference itself,
    the median of the filters. None where nothing is known. ``air``: seconds in the air; ``marks``: [seconds, kind]
    of impacts, and of jumps of the attitude in the air, since one that is set right before take-off is no news.
    """
    attitudes = {t.row: t for t in result.traces if t.figure == "attitude" and np.isfinite(t.t).any()}
    if not attitudes:
        return None
    start = min(0.0, *(float(np.nanmin(t.t)) for t in attitudes.values()))
    end = max(float(np.nanmax(t.t)) for t in attitudes.values())
    edges = np.linspace(start, max(end, start + 1e-3), POINTS + 1)
    choice = result.reference.choice if result.reference else ""
    shown = next(attitudes[k] for k in (choice, "onboard", *_filters(result), *attitudes) if k in attitudes)
    of, tilt, heading = _differences(result, edges)
    air = (result.log.get("timeline") or {}).get("airborne") or []
    marks = [s for s in result.segments if s.kind in MARKS and (s.kind != "reset" or not air or _within(s.t1, air))]
    return {
        "t0": round(start, 2),
        "t1": round(float(edges[-1]), 2),
        "tilt": _points(_largest(shown.t, _tilt(shown), edges)),
        "of": of,
        "tilt_diff": _points(tilt),
        "heading_diff": _points(heading),
        "air": [[round(float(a), 1), round(float(b), 1)] for a, b in air[:MOST_MARKS]],
        "marks": [[round(s.t1 if s.kind == "reset" else s.t0, 1), s.kind] for s in marks[:MOST_MARKS]],
    }


def encoded(seen: dict[str, Any] | None, out: bytearray) -> list[Any] | None:
    """What stands beside the curves of a thumbnail; the curves go to ``out``, small angles finer than large ones."""
    if seen is None:
        return None
    at = len(out)
    for curve in ("tilt", "tilt_diff", "heading_diff"):
        out += bytes(NO_BYTE if v is None else round(FULL_BYTE * math.sqrt(v / FULL_DEG)) for v in seen[curve])
    return [at, seen["t0"], seen["t1"], seen["of"], seen["air"], [t for t, _ in seen["marks"]]]


def _within(t: float, spans: list[list[float]]) -> bool:
    return any(a <= t <= b for a, b in spans)


def _differences(result: Result, edges: Array) -> tuple[str, Array, Array]:
    traces = {t.row: t for t in result.traces if t.figure == "difference" and len(t.t)}
    if "onboard" in traces:
        of, chosen = "onboard", [traces["onboard"]]
    else:
        of, chosen = "filters", [traces[name] for name in _filters(result) if name in traces]
    tilt, heading = (_median([_largest(t.t, t.columns[c], edges) for t in chosen]) for c in ("inclination", "heading"))
    return of, tilt, heading


def _filters(result: Result) -> list[str]:
    return [r.name for r in result.estimators if r.kind == "replay" and r.estimator not in BASELINES]


def _tilt(trace: Trace) -> Array:
    roll, pitch = (np.radians(trace.columns[c]) for c in ("roll", "pitch"))
    return np.asarray(np.degrees(np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0))), np.float64)


def _largest(t: Array, y: Array, edges: Array) -> Array:
    """The largest size of y (n,) between each pair of edges; NaN where there is no finite value."""
    y = np.abs(np.asarray(y, np.float64))
    good = np.isfinite(y) & np.isfinite(t)
    out = np.full(len(edges) - 1, -np.inf)
    np.maximum.at(out, np.clip(np.searchsorted(edges, t[good], "right") - 1, 0, len(out) - 1), y[good])
    return np.where(np.isfinite(out), np.minimum(out, FULL_DEG), np.nan)


def _median(each: list[Array]) -> Array:
    if not each:
        return np.full(POINTS, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a part of the log that no row covers stays NaN
        return np.asarray(np.nanmedian(np.stack(each), axis=0), np.float64)


def _points(values: Array) -> Points:
    return [round(float(v), 1) if math.isfinite(v) else None for v in values]
