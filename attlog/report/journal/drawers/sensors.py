"""The sensors themselves: gyro bias, sizes of gravity and field, vibration, what the onboard estimator rejects."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.legend import Key
from attlog.report.journal.lines import FAR, beyond, share, thinned, within
from attlog.report.journal.panels import Panel, before_the_crash, panels, phases, time_axis
from attlog.report.journal.store import array
from attlog.report.journal.style import AXIS_DASHES, DASH, DASHES, DOT, INK, LINE, MARKER, axis, faded, palette

HIGHEST_RATIO = 4.0
IN_SIGHT = 6.0
"""A limit beyond so many times the highest level is not shown."""
AXES = ("x", "y", "z")


def bias(canvas: Canvas, data: dict[str, Any]) -> None:
    """Gyro bias that filters found, and what the gyro shows at rest."""
    panels(
        canvas,
        data["series"],
        [Panel(a, f"{a}, °/s", 0.02) for a in AXES],
        canvas.span,
        between=before_the_crash(canvas),
    )
    for i, a in enumerate(AXES if "rests" in data else ()):
        key = f"y{i + 1}" if i else "y"
        y = array(data["rests"][a])
        marker = {"size": MARKER, "color": INK}
        canvas.marker(array(data["rests"]["t"]), y, marker, yaxis=key, name="gyro at rest")
        seen = canvas.axes["yaxis" + key[1:]]["range"]
        low, high = min(seen[0], float(y.min())), max(seen[1], float(y.max()))
        pad = 0.06 * (high - low)
        canvas.axes["yaxis" + key[1:]]["range"] = [
            min(seen[0], float(y.min()) - pad),
            max(seen[1], float(y.max()) + pad),
        ]
    phases(canvas)


def size(canvas: Canvas, data: dict[str, Any]) -> None:
    """Mean size with the band of smallest to largest, what is expected, and the throttle."""
    tint, t = palette()["e1"], array(data["t"])
    low, mean, high = (array(data[k]) for k in ("low", "mean", "high"))
    if "throttle" in data:
        x, y = (array(part) for part in data["throttle"])
        canvas.plain("throttle", INK, x, y, yaxis="y2", line={"color": palette()["edge"], "width": LINE})
        ticks = {"tickvals": [0, 50, 100], "overlaying": "y", "side": "right"}
        canvas.axes["yaxis2"] = axis("throttle, %", range=[0, 100], **ticks)
        canvas.right = 44.0
    canvas.edge(t, low)
    canvas.edge(t, high, fill="tonexty", fillcolor=faded(tint, 0.25))
    canvas.plain("mean", tint, t, mean)
    canvas.key(Key("smallest to largest", tint, fill=True))
    wanted = [data["expected"]] if "expected" in data else []
    bottom = min([share(within(t, low, canvas.span), 1.0 - FAR), *wanted])
    top = max([share(within(t, high, canvas.span), FAR), *wanted])
    pad = 0.15 * (top - bottom) or 1.0
    beyond(canvas, tint, t, high, top + pad)
    for value in wanted:
        canvas.plain("expected", INK, list(canvas.span), [value, value], line={"dash": DASH})
    canvas.axes["xaxis"] = time_axis(canvas.span)
    canvas.axes["yaxis"] = axis(
        f"{QUANTITIES.get(data['unit'], 'size')}, {data['unit']}", range=[bottom - pad, top + pad]
    )
    phases(canvas)


QUANTITIES = {"m/s²": "acceleration", "µT": "magnetic field"}
"""What has a size in this unit."""


def ratios(canvas: Canvas, data: dict[str, Any]) -> None:
    """Test ratios of the onboard estimator's aids; 1 is the gate."""
    lines = [(line, array(line["t"]), array(line["y"]["ratio"])) for line in data["lines"]]
    most = max([0.0, *(float(v.max()) for _, t, y in lines if len(v := within(t, y, canvas.span)))])
    top = min(max(1.15 * most, 1.25), HIGHEST_RATIO)
    for i, (line, t, y) in enumerate(lines):
        colour = palette()[f"e{line['slot']}"]
        canvas.plain(line["aid"], colour, *thinned(t, y, canvas.span), line={"dash": DASHES[i % len(DASHES)]})
        if most > top:
            beyond(canvas, colour, t, y, top)
    canvas.axes["xaxis"] = time_axis(canvas.span)
    canvas.axes["yaxis"] = axis("test ratio, share of the gate", range=[0, top])
    canvas.level("gate", 1.0, palette()["bad"])
    phases(canvas)


def vibration(canvas: Canvas, data: dict[str, Any]) -> None:
    """The autopilot's own level with its limits, or the standard deviation of the logged accelerometer."""
    top = _levels(canvas, data) if "level" in data else _deviations(canvas, data)
    if data["clipped"]:
        marker = {"symbol": "triangle-down", "size": MARKER + 1, "color": palette()["bad"]}
        t = [c[0] for c in data["clipped"]]
        canvas.marker(t, [0.97 * top] * len(t), marker, name="clipped")
    canvas.axes["xaxis"] = time_axis(canvas.span)
    phases(canvas)


def _levels(canvas: Canvas, data: dict[str, Any]) -> float:
    """The level and those percentiles and limits that are in sight; the upper end of the axis."""
    tint, t, y = palette()["e1"], array(data["t"]), array(data["level"])
    most = max(0.1, float(np.max(within(t, y, canvas.span), initial=0.0)))
    top: float = max([1.15 * most, *(1.1 * v for v in data["limits"][:1] if 1.1 * v < IN_SIGHT * most)])
    canvas.plain("level", tint, *thinned(t, y, canvas.span))
    for what, v in data["shares"].items():
        if v <= top and what != "worst":
            canvas.level(f"{what} {v:.3g}", v, palette()["mu"], DOT if what == "p50" else DASHES[3])
    for i, v in enumerate(data["limits"]):
        if v <= top:
            canvas.level(f"limit {v:g}", v, palette()["bad" if i else "warn"], DASH if i else DASHES[4])
    canvas.axes["yaxis"] = axis("vibration, m/s²", range=[0, top], nticks=6)
    return top


def _deviations(canvas: Canvas, data: dict[str, Any]) -> float:
    """The three axes of the logged accelerometer; the upper end of the axis."""
    t, top = array(data["t"]), 0.1
    for a, values in data["axes"].items():
        y = array(values)
        canvas.plain(a, palette()[f"a{a}"], *thinned(t, y, canvas.span), line={"dash": AXIS_DASHES[a]})
        top = max(top, float(np.max(within(t, y, canvas.span), initial=0.0)))
    canvas.axes["yaxis"] = axis("standard deviation, m/s²", range=[0, 1.08 * top], nticks=6)
    return 1.08 * top
