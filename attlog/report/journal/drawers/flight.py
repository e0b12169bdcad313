"""The whole flight: time strip, attitude, difference from the reference."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.legend import Key, text_width
from attlog.report.journal.lines import thinned
from attlog.report.journal.panels import Panel, alarms, axis_key, before_the_crash, panels, phases, time_axis
from attlog.report.journal.store import array
from attlog.report.journal.style import DASH, INK, MARKER, TEXT, axis, faded, palette, safe

LANES = ("messages", "armed", "mode")
GRADES = (("message", "circle"), ("warning", "triangle-up"), ("failsafe, critical message", "diamond"))
"""What messages are called, and how they are drawn."""


def strip(canvas: Canvas, data: dict[str, Any]) -> None:
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


def attitude(canvas: Canvas, data: dict[str, Any]) -> None:
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


def difference(canvas: Canvas, data: dict[str, Any]) -> None:
    """Filter minus reference in tilt, roll, pitch, heading; grey: how wrong a smoother may be itself."""
    columns = [
        Panel("inclination", "tilt, °", more={"rangemode": "nonnegative"}),
        Panel("roll", "roll, °", wraps=True),
        Panel("pitch", "pitch, °"),
        Panel("heading", "heading, °", wraps=True),
    ]
    columns = [c for c in columns if any(c.key in s["y"] for s in data["series"])]
    if "sigma" in data:
        grey = {"fill": "tonexty", "fillcolor": faded(INK, 0.15)}
        for key, yaxis, low in (("inclination", "y", 0.0), ("heading", "y4", -1.0)):
            if key in data["sigma"]["y"]:
                x, y = thinned(array(data["sigma"]["t"]), array(data["sigma"]["y"][key]), canvas.span)
                canvas.edge(x, low * y, yaxis=yaxis)
                canvas.edge(x, y, yaxis=yaxis, **grey)
                canvas.key(Key("sigma of the smoother", INK, fill=True))
    panels(canvas, data["series"], columns, canvas.span, between=before_the_crash(canvas, float(data["scored"])))
    phases(canvas)
    alarms(canvas)
