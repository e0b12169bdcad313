"""The compass: its three axes against the earth's field, and its size against the motors."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.present.names import truth_name
from attlog.present.numbers import MINUS, duration, quantity
from attlog.report.figures.figure import PageFigure, listed, stored
from attlog.report.pack import Store
from attlog.result import Result, Trace

AXES = ("x", "y", "z")
FIELD_STEP = 0.01
"""uT per stored step."""
DRIVES = {"current": ("current, A", "A", "the current"), "throttle": ("throttle, %", "%", "the throttle")}


def axes(traces: list[Trace], store: Store, result: Result) -> PageFigure:
    """Measured, expected and, where an offset is offered, corrected field in body axes, a compass at a time."""
    views: list[dict[str, Any]] = [
        stored(t, tuple(f"{part}{a}" for part in ("", "expected_", "corrected_") for a in AXES), store, FIELD_STEP)
        for t in traces
    ]
    first = traces[0]
    whose = "by motion alone, without any compass" if first.values.get("by_motion") else f"by {attitude(result)}"
    caption = f"Colour: measured. Dashes: the earth's field, turned {whose}."
    caption += " Dotted: with the offset that can be set." if "corrected_x" in first.columns else ""
    words = "; ".join(f"{a} off by {quantity(left(first, a), 'uT', True)} in the median" for a in AXES)
    called = [t.key for t in traces]
    title = "Magnetic field in body axes, µT"
    return PageFigure("compass", "compass", title, caption, 500, {"views": views}, True, words, called)


def attitude(result: Result) -> str:
    """Whose attitude turned the earth's field, in words."""
    choice = result.reference.choice if result.reference else "onboard"
    return {"truth": truth_name(result), "smoother": "the smoother"}.get(choice, "the onboard attitude")


def left(trace: Trace, axis: str) -> float:
    """Median of measured less expected field, uT."""
    off = np.asarray(trace.columns[axis] - trace.columns[f"expected_{axis}"], np.float64)
    off = off[np.isfinite(off)]
    return float(np.median(off)) if len(off) else float("nan")


def interference(trace: Trace) -> PageFigure:
    """Points of the field's size less the earth's against the drive, and the fitted line."""
    label, unit, what = DRIVES.get(trace.key, ("drive", "", "the drive"))
    value = trace.values
    slope = f"{value['slope']:+.3f}".replace("-", MINUS)
    caption = f"Size of the field less the earth's against {what} in flight, {duration(value.get('seconds'))}. "
    caption += f"Line: {slope} µT per {unit}, r = {value['r']:.2f}".replace("-", MINUS) + "."
    data = {
        "x": listed(trace.t),
        "y": listed(trace.columns["residual"]),
        "label": label,
        "unit": unit,
        "drive": trace.key,
        "line": [value["start"], value["slope"]],
    }
    words = f"{slope} µT per {unit}"
    title = f"Magnetic field against {trace.key}, µT"
    return PageFigure("interference", "interference", title, caption, 330, data, False, words)
