"""Figures of the rest before and after flight: close-up, histogram, Allan deviation."""

from __future__ import annotations

import numpy as np

from attlog.report.figures.figure import FigureSource, PageFigure, Panel, decades, range_words, sampling_text
from attlog.words.numbers import duration, moment

ANGLES = ("roll", "pitch", "heading")
# Smallest range of a panel at rest, deg.
MIN_REST_RANGE_DEG = 0.002


def close_up(source: FigureSource) -> PageFigure | None:
    """Draw roll, pitch and heading at rest, each minus its fitted line."""
    found = source.traces("rest")
    if not found:
        return None
    first, last = min(float(t.t[0]) for t in found), max(float(t.t[-1]) for t in found)
    view = source.view()
    panels = [Panel(key, f"{key}, °", MIN_REST_RANGE_DEG) for key in ANGLES]
    view.panels(source.by_depth(found), panels, step=1e-5, digits=4, calm=True)
    for trace in view.traces:
        trace["line"]["width"] = 1.1
    view.axes["xaxis"]["range"] = [first, last]
    caption = (
        f"{duration(last - first)} from {moment(first, 0)} on, motors off. "
        "Each line minus its straight line; ▲ a filter that bends far more leaves the figure. " + sampling_text(found)
    )
    data = {"views": [view.as_data()], "table": ["time_s", "filter", "quantity", "value", "unit"]}
    return PageFigure("rest", "plot", "Rest, close up", caption, 430, data, words=range_words(found, source))


def spread(source: FigureSource) -> PageFigure | None:
    """Draw the histogram of angles at rest, as share of the samples."""
    if not source.traces("spread"):
        return None
    view = source.view()
    for r, trace in source.by_depth(source.traces("spread")):
        meta = {"quantity": "share of samples", "digits": 1}
        view.row(r, trace.columns["angle"], trace.columns["share"], unit="%", meta=meta).update(
            line=view.traces[-1]["line"] | {"shape": "hvh"}
        )
    view.axis("x", "angle, °")
    view.axis("y", "share of samples, %", rangemode="tozero")
    caption = "Roll and pitch together, after a straight line is taken out of every 5 s."
    data = {"views": [view.as_data()], "at": "°", "table": ["angle_deg", "filter", "quantity", "value", "unit"]}
    return PageFigure("spread", "plot", "Spread", caption, 330, data, wide=False)


def allan(source: FigureSource) -> PageFigure | None:
    """Draw the Allan deviation with its 95 % interval, one angle per view."""
    found = source.traces("allan")
    if not found:
        return None
    names = [a for a in ANGLES if any(t.key == a for t in found)] or [""]
    views = []
    for name in names:
        view, own = source.view(name), [t for t in found if t.key == name]
        for r, trace in source.by_depth(own):
            c = trace.columns
            more = {}
            if "low" in c:
                up, down = c["high"] - c["deviation"], c["deviation"] - c["low"]
                more["error_y"] = {
                    "type": "data",
                    "symmetric": False,
                    "array": np.nan_to_num(up),
                    "arrayminus": np.nan_to_num(down),
                }
            meta = {"quantity": f"Allan deviation of {name}", "digits": 4, "log": True}
            view.row(r, c["tau"], c["deviation"], unit="deg", meta=meta, **more)
        both = [np.concatenate([t.columns[k] for t in own]) for k in ("tau", "deviation")]
        view.axis("x", "averaging time τ, s", type="log", **decades(both[0]))
        view.axis("y", "Allan deviation, °", type="log", **decades(both[1]))
        views.append(view.as_data())
    caption = "Down: noise averages out. Up: the angle wanders. Pointing at a line: 95 % interval."
    table = ["tau_s", "filter", "quantity", "value", "lower", "upper", "unit"]
    data = {"views": views, "labels": "end", "table": table}
    title = "Allan deviation of the angle"
    return PageFigure("allan", "plot", title, caption, 330, data, wide=False, views=names)
