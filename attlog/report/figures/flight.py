"""The whole flight: time strip, attitude, difference from the reference, ground track."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from attlog.present.messages import alarming, messages
from attlog.present.names import truth_name
from attlog.present.numbers import duration, moment, quantity
from attlog.report.figures.figure import PageFigure, Rows, listed, reach, reduction_text, series, stored
from attlog.report.figures.marks import jumps, time_range
from attlog.report.pack import Store
from attlog.result import Result, Trace

ANGLE_STEP = 0.01
"""Degrees per stored step of whole-flight figures; a screen shows a tenth at best."""

ANGLES = ("roll", "pitch", "heading")

MARKS = {"impact": "Red: impact and what followed.", "gap": "Grey between two lines: gap in the log."}


def flight(by: dict[str, list[Trace]], names: Rows, store: Store, result: Result) -> list[PageFigure]:
    """The whole flight: time strip, attitude, difference, ground track."""
    figures = [PageFigure("strip", "strip", "", "", 120)]
    if result.reference is not None and result.reference.heading_by == "nobody":
        by = by | {kind: [without_heading(t, result) for t in by.get(kind, [])] for kind in ("attitude", "difference")}
    if by.get("attitude"):
        figures.append(attitude(by["attitude"], by.get("demand", []), names, store, result))
    if by.get("difference"):
        figures.append(difference(by["difference"], by.get("sigma", []), names, store, result))
    if by.get("track"):
        figures.append(track(by["track"][0]))
    return figures


def without_heading(trace: Trace, result: Result) -> Trace:
    """A trace without what rests on the heading of a reference that has none: its own, and all differences from it."""
    own = result.reference is not None and trace.row == result.reference.choice
    if trace.figure == "attitude" and not own:
        return trace
    return replace(trace, columns={name: y for name, y in trace.columns.items() if name != "heading"})


def attitude(found: list[Trace], demand: list[Trace], names: Rows, store: Store, result: Result) -> PageFigure:
    """Angles over the flight: what flew, its set-point and the reference at first, the filters by a choice."""
    drawn, ratio = series(found, ANGLES, names, store, ANGLE_STEP)
    data: dict[str, Any] = {"series": drawn, "cut": heading_cut(found)}
    if demand:
        data["demand"] = stored(demand[0], ANGLES, store, ANGLE_STEP)
    known = {row.name for row in result.estimators if not row.is_reference}
    focus = [t.row for t in found if t.row == "onboard" or t.row not in known]
    called = []
    if focus and len(focus) < len(found):
        data["views"] = [{"focus": [names.index(row) for row in focus]}, {}]
        first = [names[names.index(row)].partition(" (")[0] for row in focus] + ["Set-point"] * bool(demand)
        called = [", ".join(first).capitalize(), "With the filters"]
    caption = "Drag across a figure to zoom: all figures with flight time follow. Double-click to go back. "
    caption += " ".join([*legend(result), reduction_text(ratio)])
    return PageFigure("attitude", "attitude", "Attitude", caption, 470, data, True, reach(found, names), called)


def difference(found: list[Trace], sigma: list[Trace], names: Rows, store: Store, result: Result) -> PageFigure:
    """Each row minus the reference, and how wrong a smoother may be itself."""
    drawn, ratio = series(found, ("inclination", *ANGLES), names, store, ANGLE_STEP)
    reference = result.reference.choice if result.reference else "onboard"
    zero = {"truth": truth_name(result), "smoother": "the smoother"}.get(reference, "agreement with onboard, not truth")
    caption = f"Zero is {zero}{'; grey: its own sigma' if sigma else ''}. "
    caption += "Tilt is the angle between the two down directions. " + reduction_text(ratio)
    start = scored_from(result)
    if start > float(min(t.t[0] for t in found)):
        caption += f" Scored from {moment(start, 0)} on; larger differences before may leave the figure."
    title = f"Difference from {'onboard' if reference == 'none' else reference}"
    data: dict[str, Any] = {"series": drawn, "scored": start}
    if sigma:
        data["sigma"] = stored(sigma[0], ("inclination", "heading"), store, ANGLE_STEP / 10.0)
    return PageFigure("difference", "difference", title, caption, 560, data, words=reach(found, names))


def track(trace: Trace) -> PageFigure:
    """The path over ground, north up, with arrows of heading and course."""
    columns = {name: listed(trace.columns[name]) for name in ("north", "east", "heading", "course", "speed")}
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


def scored_from(result: Result) -> float:
    """Seconds from which rows are compared: before it filters and onboard settle."""
    return result.reference.scoring_start_s if result.reference else 0.0


def legend(result: Result) -> list[str]:
    """What the marks on the time axis mean, for those that this flight has."""
    kinds = {s.kind for s in result.segments}
    found = [text for kind, text in MARKS.items() if kind in kinds]
    if jumps(result):
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
