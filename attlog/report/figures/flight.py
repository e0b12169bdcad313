"""The whole flight: time strip, attitude, difference from the reference."""

from __future__ import annotations

import numpy as np

from attlog.present.messages import alarming, messages
from attlog.present.numbers import moment
from attlog.report.figures.figure import PageFigure, Rows, reach, reduction_text, series, stored
from attlog.report.pack import Store
from attlog.result import Result, Trace

ANGLE_STEP = 0.01
"""Degrees per stored step of whole-flight figures; a screen shows a tenth at best."""

MARKS = {
    "reset": "Dotted red: jump of the onboard attitude.",
    "impact": "Red: impact and what followed.",
    "gap": "Grey between two lines: gap in the log.",
}


def flight(by: dict[str, list[Trace]], names: Rows, store: Store, result: Result) -> list[PageFigure]:
    """The whole flight: time strip, attitude, difference."""
    strip = PageFigure("strip", "strip", "", "", 120)
    figures = [strip]
    if by.get("attitude"):
        drawn, ratio = series(by["attitude"], ("roll", "pitch", "heading"), names, store, ANGLE_STEP)
        caption = "Drag across a figure to zoom: all figures with flight time follow. Double-click to go back. "
        caption += " ".join([*legend(result), reduction_text(ratio)])
        data = {"series": drawn, "cut": heading_cut(by["attitude"])}
        figures.append(
            PageFigure("attitude", "attitude", "Attitude", caption, 470, data, words=reach(by["attitude"], names))
        )
    if by.get("difference"):
        columns = ("inclination", "roll", "pitch", "heading")
        drawn, ratio = series(by["difference"], columns, names, store, ANGLE_STEP)
        reference = result.reference.choice if result.reference else "onboard"
        caption = {
            "truth": "Zero is the logged truth. ",
            "smoother": "Zero is the smoother; grey: its own sigma. ",
        }.get(reference, "Zero is agreement with onboard, not truth. ")
        caption += "Tilt is the angle between the two down directions. " + reduction_text(ratio)
        start = scored_from(result)
        if start > float(min(t.t[0] for t in by["difference"])):
            caption += f" Scored from {moment(start, 0)} on; larger differences before may leave the figure."
        title = f"Difference from {'onboard' if reference == 'none' else reference}"
        words = reach(by["difference"], names)
        data = {"series": drawn, "scored": start}
        if by.get("sigma"):
            data["sigma"] = stored(by["sigma"][0], ("inclination", "heading"), store, ANGLE_STEP / 10.0)
        figures.append(PageFigure("difference", "difference", title, caption, 560, data, words=words))
    return figures


def scored_from(result: Result) -> float:
    """Seconds from which rows are compared: before it filters and onboard settle."""
    return result.reference.scoring_start_s if result.reference else 0.0


def legend(result: Result) -> list[str]:
    """What the marks on the time axis mean, for those that this flight has."""
    kinds = {s.kind for s in result.segments}
    found = [text for kind, text in MARKS.items() if kind in kinds]
    if any(alarming(level, text) for _, level, text in messages(result)):
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
