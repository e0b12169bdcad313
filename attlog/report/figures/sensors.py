"""Figures of sensors: compass, interference, gravity, field, test ratios, gyro bias."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import median
from attlog.report.figures.figure import (
    FigureSource,
    PageFigure,
    Panel,
    axis_key,
    panel_domain,
    quantile,
    range_words,
    sampling_text,
)
from attlog.report.figures.flight import SENSED, before_crash
from attlog.result import Result, Trace
from attlog.words.names import truth_name
from attlog.words.numbers import MINUS, duration, number, quantity, unit_sign

AXES = ("x", "y", "z")
# Quantisation of fields (uT) and test ratios.
FIELD_STEP, RATIO_STEP = 0.01, 0.001
FIELD_PARTS = (
    ("", "measured", "solid", 1.5),
    ("expected_", "expected", "dash", 1.6),
    ("corrected_", "corrected", "dot", 1.8),
)
DRIVES = {"current": ("current, A", "A", "the current"), "throttle": ("throttle, %", "%", "the throttle")}
# Colours of aids; others share the rest of the palette.
AIDS = ("compass", "velocity", "position", "height", "airspeed")
# Share of the values that sets a range: a bump on landing leaves the figure.
FAR = 0.985
HIGHEST_RATIO = 4.0
SIZE_WORDS = {
    "gravity": (
        "Size of the acceleration",
        "acceleration",
        "m/s^2",
        "gravity at the place",
        "at rest it shows gravity",
    ),
    "field": (
        "Size of the magnetic field",
        "magnetic field",
        "uT",
        "the earth's field there",
        "motors and iron change it",
    ),
}


def compass(source: FigureSource) -> PageFigure | None:
    """Draw measured, expected and corrected field in body axes, one compass per view."""
    found = source.traces("compass")
    if not found:
        return None
    views = []
    for trace in found:
        view = source.view()
        parts = [part for part in FIELD_PARTS if f"{part[0]}x" in trace.columns]
        for i, axis in enumerate((*AXES, "size")):
            for prefix, what, dash, width in parts:
                colour = "tx" if what == "expected" else f"a{axis}" if i < 3 else "mu"
                said = f"{f'{trace.key} ' if len(found) > 1 else ''}{axis} {what}"
                meta = {"time": True, "step": FIELD_STEP, "digits": 1, "group": what}
                meta |= {"quantity": said} if i < 3 else {}
                view.line(
                    f"{axis} {what}",
                    colour,
                    trace.t,
                    field_column(trace, prefix, axis),
                    unit="uT",
                    width=width,
                    dash=dash,
                    yaxis=axis_key(i),
                    meta=meta,
                )
            fit = {"share": 0.003, "pad": 0.1, "least_pad": 1.0}
            view.axis(axis_key(i), f"{axis}, µT", domain=panel_domain(i, 4), nticks=5, fit=fit)
        view.axis("x", "time, s", anchor="y4")
        views.append(view.as_data())
    first = found[0]
    whose = f"by {attitude_words(source.result)}"
    whose = "by motion alone, without any compass" if first.values.get("by_motion") else whose
    caption = f"Colour: measured. Dashes: the earth's field, turned {whose}."
    caption += " Dotted: with the offset that can be set." if "corrected_x" in first.columns else ""
    words = "; ".join(f"{a} off by {quantity(median_residual(first, a), 'uT', True)} in the median" for a in AXES)
    data = {"views": views, "timed": True, "phases": "named", "table": SENSED}
    title = "Magnetic field in body axes, µT"
    return PageFigure("compass", "plot", title, caption, 500, data, True, words, [t.key for t in found])


def field_column(trace: Trace, prefix: str, axis: str) -> NDArray[np.float64]:
    """Return one axis of a field, or its strength."""
    if axis != "size":
        return np.asarray(trace.columns[prefix + axis], np.float64)
    return np.asarray(np.sqrt(sum(np.asarray(trace.columns[prefix + a], np.float64) ** 2 for a in AXES)))


def attitude_words(result: Result) -> str:
    """Name the attitude that rotated the earth's field into body axes."""
    choice = result.reference.choice if result.reference else "onboard"
    return {"truth": truth_name(result), "smoother": "the smoother"}.get(choice, "the onboard attitude")


def median_residual(trace: Trace, axis: str) -> float:
    """Return the median of measured minus expected field, uT."""
    off = np.asarray(trace.columns[axis] - trace.columns[f"expected_{axis}"], np.float64)
    off = off[np.isfinite(off)]
    return float(median(off)) if len(off) else math.nan


def interference(source: FigureSource) -> PageFigure | None:
    """Draw excess field strength against motor drive, with the fitted line."""
    if not source.traces("interference"):
        return None
    trace = source.traces("interference")[0]
    label, unit, what = DRIVES.get(trace.key, ("drive", "", "the drive"))
    value, view = trace.values, source.view()
    x, y = np.asarray(trace.t, np.float64), np.asarray(trace.columns["residual"], np.float64)
    ends = np.array([x.min(), x.max()])
    line = value["start"] + value["slope"] * ends
    marker = {"size": 4, "color": "ac", "opacity": 0.45}
    view.markers("samples", x, y, marker, unit="uT", meta={"quantity": "residual", "digits": 1})
    view.line("fitted line", "tx", ends, line, unit="uT", width=2, meta={"quantity": "fitted line", "digits": 1})
    both = np.concatenate([y, line])
    low, high = quantile(both, 0.005), quantile(both, 0.995)
    pad = max(0.1 * (high - low), 0.5)
    view.axis("x", label, zeroline=False)
    view.axis("y", "field minus the earth’s, µT", range=[low - pad, high + pad])
    slope = f"{value['slope']:+.3f}".replace("-", MINUS)
    caption = f"Size of the field less the earth's against {what} in flight, {duration(value.get('seconds'))}. "
    caption += f"Line: {slope} µT per {unit}, r = {value['r']:.2f}".replace("-", MINUS) + "."
    drive = f"drive_{'pct' if unit == '%' else unit.lower()}"
    data = {"views": [view.as_data()], "at": f" {unit}", "hover": "closest"}
    data |= {"table": [drive, "quantity", "value", "unit"]}
    title = f"Magnetic field against {trace.key}, µT"
    return PageFigure("interference", "plot", title, caption, 330, data, False, f"{slope} µT per {unit}")


def gravity(source: FigureSource) -> PageFigure | None:
    """Draw the magnitude of the acceleration."""
    return _size(source, "gravity")


def field(source: FigureSource) -> PageFigure | None:
    """Draw the magnitude of the magnetic field where its axes cannot be drawn."""
    return None if source.traces("compass") else _size(source, "field")


def _size(source: FigureSource, kind: str) -> PageFigure | None:
    """Draw smallest, mean and largest magnitude over time, expected value, throttle."""
    if not source.traces(kind):
        return None
    trace, view = source.traces(kind)[0], source.view()
    title, what, unit, expected, why = SIZE_WORDS[kind]
    c, sign = trace.columns, unit_sign(unit)
    caption = f"Line: mean, band: smallest to largest; {why}."
    fit: dict[str, Any] = {"share": 1.0 - FAR, "pad": 0.15}
    if "expected" in trace.values:
        value = trace.values["expected"]
        view.level_line("expected", value, "tx", source.marks["range"])
        fit["include"] = [value]
        caption += f" Dashed: {expected}, {value:.1f} {sign}."
    for throttle in source.traces("throttle")[:1]:
        y = throttle.columns["throttle"]
        meta = {"time": True, "quantity": "throttle", "digits": 0, "free": True}
        view.line("throttle", "edge", throttle.t, y, unit="%", width=1, yaxis="y2", meta=meta)
        ticks = {"tickvals": [0, 50, 100], "overlaying": "y", "side": "right"}
        view.axis("y2", "throttle, %", range=[0, 100], showgrid=False, zeroline=False, **ticks)
        caption += " Grey: throttle."
    meta = {"time": True, "unit": unit}
    view.band("smallest to largest", "e1", trace.t, c["low"], c["high"], opacity=0.25, unit=unit, meta=meta)
    for edge, name in zip(view.traces[-2:], ("smallest", "largest"), strict=True):
        edge["meta"] = edge["meta"] | {"quantity": name} | ({"beyond": True} if name == "largest" else {})
    view.line("mean", "e1", trace.t, c["mean"], unit=unit, width=1.6, meta=meta | {"quantity": "mean"})
    view.axis("x", "time, s")
    view.axis("y", f"{what}, {sign}", fit=fit, zeroline=False)
    low, high = float(c["low"].min()), float(c["high"].max())
    data = {"views": [view.as_data()], "timed": True, "phases": "plain", "table": SENSED}
    return PageFigure(kind, "plot", title, caption, 330, data, False, f"{low:.1f} to {high:.1f} {sign}")


def ratios(source: FigureSource) -> PageFigure | None:
    """Draw the onboard estimator's test ratios; 1 is the firmware's gate."""
    known = sorted(source.traces("ratios"), key=lambda t: AIDS.index(t.key) if t.key in AIDS else len(AIDS))
    if not known:
        return None
    view = source.view()
    for i, trace in enumerate(known):
        slot = AIDS.index(trace.key) if trace.key in AIDS else max(i, len(AIDS))
        meta = {"time": True, "step": RATIO_STEP, "quantity": f"{trace.key} test ratio", "beyond": True}
        view.line(trace.key, f"e{1 + slot % 8}", trace.t, trace.columns["ratio"], unit="1", meta=meta)
    view.level_line("gate", 1.0, "bad", source.marks["range"])
    view.axis("x", "time, s")
    view.axis(
        "y", "test ratio, share of the gate", fit={"floor": 0.0, "pad": 0.15, "least": 1.25, "most": HIGHEST_RATIO}
    )
    highest = ", ".join(f"{t.key} {number(float(t.columns['ratio'].max()))}" for t in known)
    caption = "Distance of each aid from the onboard estimator's prediction, as a share of its gate. "
    caption += "Above 1: rejected. ▲ beyond the figure."
    data = {"views": [view.as_data()], "timed": True, "phases": "plain", "labels": "head", "table": SENSED}
    title = "Test ratios of the onboard estimator"
    return PageFigure("ratios", "plot", title, caption, 330, data, True, f"Highest: {highest}")


def bias(source: FigureSource) -> PageFigure | None:
    """Draw the gyro bias estimated by filters, beside the gyro's mean at rest."""
    found, rests = source.traces("bias"), source.traces("rest_bias")
    if not found and not rests:
        return None
    view = source.view()
    panels = [Panel(a, f"{a}, °/s", 0.02) for a in AXES]
    view.panels(source.by_depth(found), panels, unit="deg/s", step=1e-4, digits=3, **before_crash(source))
    caption = "Subtracted from the logged gyro. Filters without a bias state are not drawn. "
    if any(t.row == "onboard" for t in found):
        caption += f"{source.styles['onboard'].name}: what the autopilot's own estimator logged. "
    for trace in rests[:1]:
        for i, a in enumerate(AXES):
            meta = {"quantity": a, "digits": 3}
            marker = {"size": 9, "color": "tx"}
            view.markers("gyro at rest", trace.t, trace.columns[a], marker, unit="deg/s", yaxis=axis_key(i), meta=meta)
        caption += "● what the gyro shows at rest. "
    title = "Gyro bias that the filters found" if found else "Gyro bias at rest"
    data = {"views": [view.as_data()], "timed": True, "phases": "plain"}
    data |= {"table": ["time_s", "filter", "quantity", "value", "unit"]}
    words = range_words(found, source, "deg/s")
    return PageFigure("bias", "plot", title, caption + sampling_text(found), 430, data, True, words)
