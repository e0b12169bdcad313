"""The whole flight: time strip, attitude, difference from the reference, ground track."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.bundle import ArrayPacker
from attlog.report.figures.canvas import (
    Canvas,
    Key,
    PageFigure,
    Rows,
    as_array,
    json_numbers,
    packed_series,
    packed_trace,
    range_words,
    reduction_text,
    text_width,
)
from attlog.report.figures.panels import (
    Panel,
    alarms,
    attitude_jumps,
    axis_key,
    before_the_crash,
    panels,
    phases,
    quantile,
    thinned,
    time_axis,
    time_range,
)
from attlog.report.figures.style import AXIS_LINE, DASH, DOT, INK, LINE, MARKER, TEXT, axis, below, faded, palette, safe
from attlog.result import Result, Trace
from attlog.words.flight import alarming, messages
from attlog.words.names import truth_name
from attlog.words.numbers import duration, moment, quantity

ANGLE_STEP = 0.01
"""Degrees per stored step of whole-flight figures; a screen shows a tenth at best."""

ANGLES = ("roll", "pitch", "heading")

MARKS = {"impact": "Red: impact and what followed.", "gap": "Grey between two lines: gap in the log."}


def flight_figures(by: dict[str, list[Trace]], names: Rows, store: ArrayPacker, result: Result) -> list[PageFigure]:
    """The whole flight: time strip, attitude, difference, ground track."""
    figures = [PageFigure("strip", "strip", "", "", 120)]
    if result.reference is not None and result.reference.heading_by == "nobody":
        by = by | {kind: [without_heading(t, result) for t in by.get(kind, [])] for kind in ("attitude", "difference")}
    if by.get("attitude"):
        figures.append(attitude_figure(by["attitude"], by.get("demand", []), names, store, result))
    if by.get("difference"):
        figures.append(difference_figure(by["difference"], by.get("sigma", []), names, store, result))
    if by.get("track"):
        figures.append(track_figure(by["track"][0]))
    return figures


def without_heading(trace: Trace, result: Result) -> Trace:
    """A trace without what rests on the heading of a reference that has none: its own, and all differences from it."""
    own = result.reference is not None and trace.row == result.reference.choice
    if trace.figure == "attitude" and not own:
        return trace
    return replace(trace, columns={name: y for name, y in trace.columns.items() if name != "heading"})


def attitude_figure(
    found: list[Trace], demand: list[Trace], names: Rows, store: ArrayPacker, result: Result
) -> PageFigure:
    """Angles over the flight: what flew, its set-point and the reference at first, the filters by a choice."""
    drawn, ratio = packed_series(found, ANGLES, names, store, ANGLE_STEP)
    data: dict[str, Any] = {"series": drawn, "cut": heading_cut(found)}
    if demand:
        data["demand"] = packed_trace(demand[0], ANGLES, store, ANGLE_STEP)
    known = {row.name for row in result.estimators if not row.is_reference}
    focus = [t.row for t in found if t.row == "onboard" or t.row not in known]
    called = []
    if focus and len(focus) < len(found):
        data["views"] = [{"focus": [names.index(row) for row in focus]}, {}]
        first = [names[names.index(row)].partition(" (")[0] for row in focus] + ["Set-point"] * bool(demand)
        called = [", ".join(first).capitalize(), "With the filters"]
    caption = "Drag across a figure to zoom: all figures with flight time follow. Double-click to go back. "
    caption += " ".join([*marks_legend(result), reduction_text(ratio)])
    return PageFigure("attitude", "attitude", "Attitude", caption, 470, data, True, range_words(found, names), called)


def difference_figure(
    found: list[Trace], sigma: list[Trace], names: Rows, store: ArrayPacker, result: Result
) -> PageFigure:
    """Each row minus the reference, and how wrong a smoother may be itself."""
    drawn, ratio = packed_series(found, ("tilt", *ANGLES), names, store, ANGLE_STEP)
    reference = result.reference.choice if result.reference else "onboard"
    zero = {"truth": truth_name(result), "smoother": "the smoother"}.get(reference, "agreement with onboard, not truth")
    caption = f"Zero is {zero}{'; grey: its own sigma' if sigma else ''}. "
    caption += "Tilt is the angle between the two down directions. " + reduction_text(ratio)
    start = scoring_start(result)
    if start > float(min(t.t[0] for t in found)):
        caption += f" Scored from {moment(start, 0)} on; larger differences before may leave the figure."
    title = f"Difference from {'onboard' if reference == 'none' else reference}"
    data: dict[str, Any] = {"series": drawn, "scored": start}
    if sigma:
        data["sigma"] = packed_trace(sigma[0], ("tilt", "heading"), store, ANGLE_STEP / 10.0)
    return PageFigure("difference", "difference", title, caption, 560, data, words=range_words(found, names))


def track_figure(trace: Trace) -> PageFigure:
    """The path over ground, north up, with arrows of heading and course."""
    columns = {name: json_numbers(trace.columns[name]) for name in ("north", "east", "heading", "course", "speed")}
    data: dict[str, Any] = {"t": [round(float(t), 2) for t in trace.t]} | columns
    data["driven"] = [int(v > 0) for v in trace.columns["driven"]]
    caption = f"By {trace.key}, north up. Arrows along the path: course; beside it: onboard heading. "
    caption += course_text(trace)
    return PageFigure("track", "track", "Ground track", caption, 480, data, True, course_text(trace).rstrip("."))


def course_text(trace: Trace) -> str:
    """How far heading and course differ, in words."""
    v = trace.values
    if "difference" not in v:
        return f"Too little time above {v['least']:.0f} m/s to compare heading and course."
    ends = [quantity(v[name], "deg", True) for name in ("difference", "low", "high")]
    text = f"Heading minus course: median {ends[0]}, middle half {ends[1]} to {ends[2]}, "
    text += f"in {duration(v['seconds'])} above {v['least']:.0f} m/s. "
    return text + ("Wind and turns add to it." if v["forward"] else "A copter may fly sideways.")


def scoring_start(result: Result) -> float:
    """Seconds from which rows are compared: before it filters and onboard settle."""
    return result.reference.scoring_start_s if result.reference else 0.0


def marks_legend(result: Result) -> list[str]:
    """What the marks on the time axis mean, for those that this flight has."""
    kinds = {s.kind for s in result.segments}
    found = [text for kind, text in MARKS.items() if kind in kinds]
    if attitude_jumps(result):
        found.append("Dotted red: jump of the onboard attitude.")
    first, last = time_range(result)
    if any(alarming(level, text) and first <= t <= last for t, level, text in messages(result)):
        found.append("Dashed red: failsafe or critical message.")
    return found


def heading_cut(traces: list[Trace]) -> float:
    """Where to cut the circle of headings open, in degrees: the middle of the widest unused arc."""
    heading = np.concatenate(
        [np.asarray(t.columns["heading"], np.float64) for t in traces if "heading" in t.columns] or [np.zeros(1)]
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


# The whole flight: time strip, attitude, difference from the reference.

LANES = ("messages", "armed", "mode")
GRADES = (("message", "circle"), ("warning", "triangle-up"), ("failsafe, critical message", "diamond"))
"""What messages are called, and how they are drawn."""


def draw_strip(canvas: Canvas, data: dict[str, Any]) -> None:
    """Modes, armed and airborne time, messages."""
    marks, colours = canvas.marks, palette()
    canvas.height = 66.0
    names = list(dict.fromkeys(name for *_, name in marks["modes"]))
    _lane(canvas, 2, [(a, b, colours[f"m{names.index(name) % 4}"], name) for a, b, name in marks["modes"]])
    _lane(canvas, 1, [(a, b, colours["armed"], "") for a, b, *_ in marks["armed"]])
    _lane(canvas, 1, [(a, b, colours["air"], "in the air") for a, b, *_ in marks["airborne"]])
    for level, colour in enumerate((INK, colours["warn"], colours["bad"])):
        times = [t for t, grade, _ in marks["texts"] if grade == level and canvas.span[0] <= t <= canvas.span[1]]
        name, symbol = GRADES[level]
        if times:
            marker = {"symbol": symbol, "size": MARKER, "color": colour}
            canvas.marker(times, [0] * len(times), marker, name=name, cliponaxis=False)
    canvas.axes["xaxis"] = time_axis(canvas.span)
    lanes = {"tickvals": [0, 1, 2], "ticktext": list(LANES), "ticks": "", "showline": False, "ticklabelstandoff": 3}
    canvas.axes["yaxis"] = axis("", range=[-0.5, 2.5], **lanes)
    canvas.left = 14.0 + max(map(text_width, LANES))


def _lane(canvas: Canvas, y: float, spans: list[tuple[float, float, str, str]]) -> None:
    """Bars of time with their names where they fit."""
    low, high = canvas.span
    for a, b, fill, name in spans:
        a, b = max(a, low), min(b, high)
        if b <= a:
            continue
        place = {"xref": "x", "yref": "y", "x0": a, "x1": b, "y0": y - 0.38, "y1": y + 0.38}
        canvas.shapes.append({"type": "rect", "layer": "below", "fillcolor": fill, "line": {"width": 0}} | place)
        if (b - a) / (high - low) * canvas.inside > text_width(name) + 4.0 and name:
            font = {"size": TEXT, "color": INK}
            words = {"text": safe(name, 24), "showarrow": False, "font": font, "xref": "x", "yref": "y"}
            canvas.notes.append(words | {"x": 0.5 * (a + b), "y": y})


def draw_attitude(canvas: Canvas, data: dict[str, Any]) -> None:
    """Roll, pitch and heading; the circle of headings is cut open where it is used least."""
    cut = float(data["cut"])
    columns = [
        Panel("roll", "roll, °", 4.0, True),
        Panel("pitch", "pitch, °", 4.0),
        Panel("heading", "heading, °", 10.0, True, cut),
    ]
    panels(canvas, data["series"], columns, canvas.span)
    _headings(canvas.axes["yaxis3"])
    if "demand" in data:  # it sets no range: in a crash nothing follows it
        for i, panel in enumerate(columns):
            line = {"color": palette()["mu"], "dash": DASH}
            canvas.plain("set-point", INK, *panel.line(data["demand"], canvas.span), yaxis=axis_key(i), line=line)
    phases(canvas)
    alarms(canvas)


def _headings(ax: dict[str, Any]) -> None:
    """Ticks of a heading axis: numbers of the compass."""
    low, high = ax["range"]
    step = next((s for s in (1, 2, 5, 10, 20, 45) if (high - low) / s < 5), 90)
    ticks = np.arange(np.ceil(low / step) * step, high + 1e-9, step)
    ax["tickvals"], ax["ticktext"] = ticks.tolist(), [str(int(v) % 360) for v in ticks]


def draw_difference(canvas: Canvas, data: dict[str, Any]) -> None:
    """Filter minus reference in tilt, roll, pitch, heading; grey: how wrong a smoother may be itself."""
    columns = [
        Panel("tilt", "tilt, °", more={"rangemode": "nonnegative"}),
        Panel("roll", "roll, °", wraps=True),
        Panel("pitch", "pitch, °"),
        Panel("heading", "heading, °", wraps=True),
    ]
    columns = [c for c in columns if any(c.key in s["y"] for s in data["series"])]
    if "sigma" in data:
        grey = {"fill": "tonexty", "fillcolor": faded(INK, 0.15)}
        for key, yaxis, low in (("tilt", "y", 0.0), ("heading", "y4", -1.0)):
            if key in data["sigma"]["y"]:
                x, y = thinned(as_array(data["sigma"]["t"]), as_array(data["sigma"]["y"][key]), canvas.span)
                canvas.edge(x, low * y, yaxis=yaxis)
                canvas.edge(x, y, yaxis=yaxis, **grey)
                canvas.key(Key("sigma of the smoother", INK, fill=True))
    panels(canvas, data["series"], columns, canvas.span, between=before_the_crash(canvas, float(data["scored"])))
    phases(canvas)
    alarms(canvas)


# The path over ground, north up, with arrows of heading and course.

Array = NDArray[np.float64]

TRACK_HEIGHT_PX = 230.0
ARROW_PX = 18.0
"""Pixels of an arrow."""
MAX_ARROWS = 60
"""Arrows of a kind."""
MIN_EXTENT_M = 4.0
"""What the figure shows at least from bottom to top."""
TRACK_MARGIN = 1.15


def draw_track(canvas: Canvas, data: dict[str, Any]) -> None:
    """Metres, equal on both axes; arrows all along the path that is in sight, by distance flown."""
    t, east, north = (as_array(data[name]) for name in ("t", "east", "north"))
    driven = as_array(data["driven"]) > 0
    seen = (t >= canvas.span[0]) & (t <= canvas.span[1]) & np.isfinite(north)
    canvas.height = TRACK_HEIGHT_PX
    flown = driven & np.concatenate([[False], driven[:-1]])
    if (seen & ~flown).any():
        line = {"width": AXIS_LINE, "dash": DOT}
        canvas.plain("on the ground", palette()["mu"], east[seen], np.where(flown, np.nan, north)[seen], line=line)
    canvas.plain("path", palette()["mu"], east[seen], np.where(driven, north, np.nan)[seen])
    fit = np.flatnonzero(seen & driven) if (seen & driven).any() else np.flatnonzero(seen)
    if not len(fit):
        fit = np.zeros(1, np.int64)
    ends, scale = _ends(canvas, east[fit], north[fit])
    canvas.axes["xaxis"] = below("east, m", range=ends[0])
    canvas.axes["yaxis"] = axis("north, m", range=ends[1], scaleanchor="x", nticks=7)
    for name, colour in (("course", palette()["ac"]), ("heading", INK)):
        angles = as_array(data[name])
        at = _spaced(east, north, fit[np.isfinite(angles[fit])], 1.1 * ARROW_PX * scale)
        _arrows(canvas, name, east[at], north[at], np.radians(angles[at]), ARROW_PX * scale, colour)
    for name, symbol, i in (("start", "circle", fit[0]), ("end", "square", fit[-1])):
        marker = {"symbol": symbol, "size": 6, "color": "#ffffff", "line": {"color": INK, "width": LINE}}
        canvas.marker([east[i]], [north[i]], marker, hoverinfo="skip")
        canvas.key(Key(name, INK, symbol=symbol, full=False))


def _ends(canvas: Canvas, east: Array, north: Array) -> tuple[tuple[list[float], list[float]], float]:
    """The ranges of both axes, and how many metres a pixel is."""
    sides = [(quantile(x, 0.002), quantile(x, 0.998)) for x in (east, north)]
    pixels = (canvas.inside, canvas.height)
    longest = [(high - low) / p for (low, high), p in zip(sides, pixels, strict=True)]
    scale = TRACK_MARGIN * max(*longest, MIN_EXTENT_M / canvas.height)
    half = [0.5 * scale * p for p in pixels]
    return (
        [0.5 * sum(sides[0]) - half[0], 0.5 * sum(sides[0]) + half[0]],
        [0.5 * sum(sides[1]) - half[1], 0.5 * sum(sides[1]) + half[1]],
    ), scale


def _spaced(east: Array, north: Array, at: NDArray[np.int64], apart: float) -> NDArray[np.int64]:
    """Of the places those that are so many metres apart along the path, at most MOST."""
    if not len(at):
        return at
    flown = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(east[at]), np.diff(north[at])))])
    step = max(apart, flown[-1] / MAX_ARROWS, 1e-9)
    places: NDArray[np.int64] = np.searchsorted(flown, np.arange(0.0, flown[-1] + step, step)).clip(max=len(at) - 1)
    return np.asarray(at[np.unique(places)])


def _arrows(canvas: Canvas, name: str, east: Array, north: Array, angle: Array, long: float, colour: str) -> None:
    """Shafts as one line, heads as markers turned to the picture's top."""
    tips = east + long * np.sin(angle), north + long * np.cos(angle)
    gap = np.full(len(east), np.nan)
    shafts = [np.column_stack([a, b, gap]).ravel() for a, b in zip((east, north), tips, strict=True)]
    canvas.plain(name, colour, *shafts, hoverinfo="skip")
    marker = {"symbol": "triangle-up", "size": 4, "color": colour, "angle": np.degrees(angle)}
    canvas.marker(*tips, marker, hoverinfo="skip")
