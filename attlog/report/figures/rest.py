"""How quiet: close-up at rest, histogram, Allan deviation."""

from __future__ import annotations

from attlog.present.numbers import duration, moment
from attlog.report.figures.figure import PageFigure, Rows, listed, reach, reduction_text, series
from attlog.report.pack import Store
from attlog.result import Trace

ANGLES = ("roll", "pitch", "heading")


def rest(by: dict[str, list[Trace]], names: Rows, store: Store) -> list[PageFigure]:
    """At rest: close-up, histogram, Allan deviation of one angle at a time."""
    figures = []
    if by.get("rest"):
        same = by["rest"]
        span = [min(float(t.t[0]) for t in same), max(float(t.t[-1]) for t in same)]
        drawn, ratio = series(same, ANGLES, names, store, 1e-5)
        caption = (
            f"{duration(span[1] - span[0])} from {moment(span[0], 0)} on, motors off. "
            "Each line minus its straight line; ▲ a filter that bends far more leaves the figure. "
            + reduction_text(ratio)
        )
        data = {"series": drawn, "range": span}
        figures.append(PageFigure("rest", "rest", "Rest, close up", caption, 430, data, words=reach(same, names)))
    if by.get("spread"):
        caption = "Roll and pitch together, after a straight line is taken out of every 5 s."
        data = {
            "x": listed(by["spread"][0].columns["angle"]),
            "shares": [{"r": names.index(t.row), "y": listed(t.columns["share"])} for t in by["spread"]],
        }
        figures.append(PageFigure("spread", "spread", "Spread", caption, 330, data, wide=False))
    if by.get("allan"):
        caption = "Down: noise averages out. Up: the angle wanders. Pointing at a line: 95 % interval."
        keys = [a for a in ANGLES if any(t.key == a for t in by["allan"])] or [""]
        columns = ("tau", "deviation", "low", "high")
        views = [
            {
                "curves": [
                    {"r": names.index(t.row)} | {c: listed(t.columns[c]) for c in columns if c in t.columns}
                    for t in by["allan"]
                    if t.key == key
                ]
            }
            for key in keys
        ]
        title = "Allan deviation of the angle"
        figures.append(PageFigure("allan", "allan", title, caption, 330, {"views": views}, wide=False, views=keys))
    return figures
