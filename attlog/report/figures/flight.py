"""Figures of the whole flight: time strip, attitude, difference from the reference, ground track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from attlog.report.figures.figure import (
    FigureSource,
    PageFigure,
    Panel,
    View,
    attitude_jumps,
    axis_key,
    panel_meta,
    panel_values,
    range_words,
    sampling_text,
    time_range,
)
from attlog.report.figures.style import safe
from attlog.result import Result, Trace
from attlog.words.flight import alarming, messages
from attlog.words.names import truth_name
from attlog.words.numbers import duration, moment, quantity

# Quantisation of whole-flight figures, deg; a screen resolves ten times as much at best.
ANGLE_STEP = 0.01
ANGLES = ("roll", "pitch", "heading")
SEGMENT_WORDS = {"impact": "Red: impact and what followed.", "gap": "Grey between two lines: gap in the log."}
MESSAGE_GRADES = (("message", "circle", 6, "mu"), ("warning", "triangle-up", 9, "warn"), ("alarm", "x", 9, "bad"))
FILTERED = ["time_s", "filter", "quantity", "value", "unit"]
SENSED = ["time_s", "quantity", "value", "unit"]
# Length of an arrow of the ground track (pixels), smallest extent of the track (m).
ARROW_PX, MIN_EXTENT_M = 26, 4.0


def strip(source: FigureSource) -> PageFigure:
    """Draw flight modes, armed and airborne time, messages."""
    view, marks = source.view(), source.marks
    modes = list(dict.fromkeys(name for *_, name in marks["modes"]))
    colours = [f"m{modes.index(name) % 4}" for *_, name in marks["modes"]]
    _lane(view, 2, "mode", marks["modes"], colours)
    _lane(view, 1, "armed", [[a, b, "armed"] for a, b in marks["armed"]], "armed")
    _lane(view, 1, "in the air", [[a, b, "in the air"] for a, b in marks["airborne"]], "air")
    for grade, (name, symbol, size, colour) in enumerate(MESSAGE_GRADES):
        texts = [(t, text) for t, level, text in marks["texts"] if level == grade]
        if texts:
            said = [safe(f"{moment(t)}: {text}", 120) for t, text in texts]
            view.markers(
                name,
                [t for t, _ in texts],
                [0] * len(texts),
                {"symbol": symbol, "size": size, "color": colour},
                customdata=said,
                hovertemplate="%{customdata}<extra></extra>",
                cliponaxis=False,
                meta={"quantity": name, "text": [text for _, text in texts]},
            )
    view.axis("x", "", showticklabels=False, zeroline=False)
    lanes = {"tickvals": [0, 1, 2], "ticktext": ["messages", "armed", "mode"], "narrow": ["texts", "armed", "mode"]}
    view.axis("y", "", range=[-0.5, 2.5], fixedrange=True, zeroline=False, showgrid=False, ticks="", **lanes)
    data = {"views": [view.as_data()], "timed": True, "alarms": True, "hover": "closest", "margin": {"t": 18, "b": 6}}
    return PageFigure("strip", "plot", "", "", 120, data | {"table": ["time_s", "end_s", "quantity", "value"]})


def _lane(view: View, y: int, what: str, spans: Sequence[Sequence[Any]], fill: Any) -> None:
    """Add a lane of bars over time; an armed span has no label."""
    if not spans:
        return
    said = [safe(f"{name}, {moment(a)} to {moment(b)}") for a, b, name in spans]
    names = ["" if what == "armed" else safe(name, 24) for *_, name in spans]
    view.traces.append(
        {
            "type": "bar",
            "orientation": "h",
            "base": [a for a, *_ in spans],
            "x": [b - a for a, b, *_ in spans],
            "y": [y] * len(spans),
            "width": 0.76,
            "marker": {"color": fill, "line": {"color": "bg", "width": 1}},
            "text": names,
            "textposition": "inside",
            "insidetextanchor": "start",
            "constraintext": "none",
            "textangle": 0,
            "textfont": {"color": "tx"},
            "customdata": said,
            "hovertemplate": "%{customdata}<extra></extra>",
            "name": what,
            "meta": {"quantity": what, "text": [name if what == "mode" else "" for *_, name in spans]},
        }
    )


def attitude(source: FigureSource) -> PageFigure | None:
    """Draw the angles over the flight.

    Onboard attitude, set-point and reference are shown first, filters by choice.
    """
    found = _comparable(source, "attitude")
    if not found:
        return None
    view, demand = source.view(), source.traces("demand")[:1]
    cut = heading_cut(found)
    panels = [
        Panel("roll", "roll, °", 4.0, True),
        Panel("pitch", "pitch, °", 4.0),
        Panel("heading", "heading, °", 10.0, True, cut, {"heading": True, "zeroline": False}),
    ]
    view.panels(source.by_depth(found), panels, step=ANGLE_STEP)
    for trace in demand:  # does not extend the range: in a crash nothing follows it
        for i, panel in enumerate(panels):
            meta = {"time": True, "step": ANGLE_STEP, "quantity": panel.key, "free": True} | panel_meta(panel)
            y = panel_values(panel, trace)
            view.line("set-point", "mu", trace.t, y, unit="deg", dash="dash", yaxis=axis_key(i), meta=meta)
    whole = view.as_data()
    views, names = [whole], []
    known = {row.name for row in source.result.estimators if not row.is_reference}
    focus = [t.row for t in found if t.row == "onboard" or t.row not in known]
    if focus and len(focus) < len(found):
        views = [{"focus": [source.index(row) for row in focus]}, {}]
        first = [source.styles[row].name.partition(" (")[0] for row in focus] + ["Set-point"] * bool(demand)
        names = [", ".join(first).capitalize(), "With the filters"]
    data = whole | {"views": views, "timed": True, "phases": "named", "alarms": True, "labels": "head"}
    caption = "Drag across a figure to zoom: all figures with flight time follow. Double-click to go back. "
    caption += " ".join([*mark_words(source.result), sampling_text(found)])
    words = range_words(found, source)
    return PageFigure(
        "attitude", "plot", "Attitude", caption, 470, data | {"table": FILTERED}, words=words, views=names
    )


def difference(source: FigureSource) -> PageFigure | None:
    """Draw each row minus the reference, and the smoother's own sigma."""
    found, result = _comparable(source, "difference"), source.result
    if not found:
        return None
    view = source.view()
    panels = [
        Panel("tilt", "tilt, °", axis={"rangemode": "nonnegative"}),
        Panel("roll", "roll, °", wraps=True),
        Panel("pitch", "pitch, °"),
        Panel("heading", "heading, °", wraps=True),
    ]
    panels = [p for p in panels if any(p.key in t.columns for t in found)]
    start = result.reference.scoring_start_s if result.reference else 0.0
    for trace in source.traces("sigma")[:1]:
        for i, panel in enumerate(panels):
            if panel.key in trace.columns:
                sigma = trace.columns[panel.key]
                low = -sigma if panel.key == "heading" else 0.0 * sigma
                meta = {"time": True, "step": 0.1 * ANGLE_STEP, "free": True}
                name = "sigma of the smoother"
                view.band(name, "tx", trace.t, low, sigma, opacity=0.14, yaxis=axis_key(i), meta=meta)
                view.traces[-1]["meta"] |= {"quantity": f"sigma of {panel.title.partition(',')[0]}", "unit": "deg"}
    view.panels(source.by_depth(found), panels, step=ANGLE_STEP, **before_crash(source, start))
    reference = result.reference.choice if result.reference else "onboard"
    zero = {"truth": truth_name(result), "smoother": "the smoother"}.get(reference, "agreement with onboard, not truth")
    caption = f"Zero is {zero}{'; grey: its own sigma' if source.traces('sigma') else ''}. "
    caption += "Tilt is the angle between the two down directions. " + sampling_text(found)
    if start > float(min(t.t[0] for t in found)):
        caption += f" Scored from {moment(start, 0)} on; larger differences before may leave the figure."
    title = f"Difference from {'onboard' if reference == 'none' else reference}"
    data = {"views": [view.as_data()], "timed": True, "phases": "named", "alarms": True, "labels": "head"}
    return PageFigure(
        "difference", "plot", title, caption, 560, data | {"table": FILTERED}, words=range_words(found, source)
    )


def track(source: FigureSource) -> PageFigure | None:
    """Draw the ground track, north up, with arrows of heading and course."""
    if not source.traces("track"):
        return None
    trace = source.traces("track")[0]
    east, north = (np.asarray(trace.columns[k], np.float64) for k in ("east", "north"))
    driven = trace.columns["driven"] > 0
    moving = driven & np.concatenate([[False], driven[:-1]])
    view = source.view()
    hover: dict[str, Any] = {"customdata": [moment(float(t)) for t in trace.t], "hoverinfo": None}
    hover["hovertemplate"] = "%{customdata}: north %{y:.1f} m, east %{x:.1f} m<extra></extra>"
    fit = driven & np.isfinite(north)
    for name, colour, width, kept in (("on the ground", "edge", 1.2, ~moving), ("path", "ac", 1.6, driven)):
        if kept.any() and np.isfinite(north[kept]).any():
            meta: dict[str, Any] = {"t": trace.t, "free": bool(fit.any()) and name != "path", "silent": True}
            y = np.where(kept, north, np.nan)
            view.line(name, colour, east, y, width=width, meta=meta, **hover)
    for name, colour in (("course", "ac"), ("heading", "e0")):
        angle = np.where(driven | ~fit.any(), trace.columns[name], np.nan)
        meta = {"t": trace.t, "angle": angle, "arrow": ARROW_PX, "free": True, "silent": True}
        view.line(name, colour, east, north, width=1.6, meta=meta, hoverinfo="skip")
    view.axis("x", "east, m", zeroline=False)
    view.axis("y", "north, m", zeroline=False, scaleanchor="x", nticks=7)
    for name, symbol, i in (("start", "circle-open", 0), ("end", "square-open", -1)):
        kept = np.flatnonzero(fit if fit.any() else np.isfinite(north))
        if len(kept):
            marker = {"symbol": symbol, "size": 12, "color": "e0", "line": {"width": 2, "color": "e0"}}
            meta = {"t": trace.t[kept[[i]]], "free": True}
            view.markers(name, east[kept[[i]]], north[kept[[i]]], marker, meta=meta, hoverinfo="skip")
    units = {"north": "m", "east": "m", "heading": "deg", "course": "deg", "speed": "m/s"}
    saved = {k: [np.asarray(trace.columns[k], np.float64), unit] for k, unit in units.items()}
    view.traces[0]["meta"]["columns"] = saved
    text = course_text(trace)
    caption = f"By {trace.key}, north up. Arrows along the path: course; beside it: onboard heading. {text}"
    data = {"views": [view.as_data()], "follows": True, "equal": MIN_EXTENT_M, "labels": "head", "hover": "closest"}
    return PageFigure("track", "plot", "Ground track", caption, 480, data | {"table": SENSED}, words=text.rstrip("."))


def _comparable(source: FigureSource, kind: str) -> list[Trace]:
    """Drop differences from a reference without heading, and its heading itself."""
    found, reference = source.traces(kind), source.result.reference
    if reference is None or reference.heading_by != "none":
        return found
    return [
        replace(t, columns={k: y for k, y in t.columns.items() if k != "heading"})
        if kind == "difference" or t.row == reference.choice
        else t
        for t in found
    ]


def before_crash(source: FigureSource, start: float | None = None) -> dict[str, Any]:
    """Return the time span that sets axis ranges: from ``start`` to the crash."""
    crash = source.marks["crash"]
    return ({} if start is None else {"from": start}) | ({} if crash is None else {"to": float(crash)})


def course_text(trace: Trace) -> str:
    """Describe the difference of heading and course."""
    v = trace.values
    if "difference" not in v:
        return f"Too little time above {v['least']:.0f} m/s to compare heading and course."
    ends = [quantity(v[name], "deg", True) for name in ("difference", "low", "high")]
    text = f"Heading minus course: median {ends[0]}, middle half {ends[1]} to {ends[2]}, "
    text += f"in {duration(v['seconds'])} above {v['least']:.0f} m/s. "
    return text + ("Wind and turns add to it." if v["forward"] else "A copter may fly sideways.")


def mark_words(result: Result) -> list[str]:
    """Explain the marks on this flight's time axis."""
    kinds = {s.kind for s in result.segments}
    found = [text for kind, text in SEGMENT_WORDS.items() if kind in kinds]
    if attitude_jumps(result):
        found.append("Dotted red: jump of the onboard attitude.")
    first, last = time_range(result)
    if any(alarming(level, text) and first <= t <= last for t, level, text in messages(result)):
        found.append("Dashed red: failsafe or critical message.")
    return found


def heading_cut(traces: list[Trace]) -> float:
    """Return the middle of the widest unused arc of headings, deg."""
    heading = np.concatenate(
        [np.asarray(t.columns["heading"], np.float64) for t in traces if "heading" in t.columns] or [np.zeros(1)]
    )
    counts = np.bincount(np.floor(heading[np.isfinite(heading)] / 5.0).astype(np.int64) % 72, minlength=72)
    used = np.flatnonzero(counts > 0.0005 * max(counts.sum(), 1))
    if len(used) == 0:
        return -180.0
    arcs = np.diff(np.append(used, used[0] + 72))
    widest = int(np.argmax(arcs))
    if arcs[widest] <= 1:
        return float(5.0 * np.argmin(counts))
    return float((5.0 * (used[widest] + arcs[widest] / 2.0 + 0.5)) % 360.0)
