"""The compass: its axes against the earth's field, its size against the motors; and spectra."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.legend import Key
from attlog.report.journal.lines import share, thinned, within
from attlog.report.journal.panels import axis_key, domains, phases, time_axis
from attlog.report.journal.store import array
from attlog.report.journal.style import DASH, DOT, INK, LINE, STRONG, axis, below, palette

AXES = ("x", "y", "z")
PARTS = (("", "measured", "solid"), ("expected_", "expected", DASH), ("corrected_", "corrected", DOT))


def compass(canvas: Canvas, data: dict[str, Any]) -> None:
    """Measured, expected and corrected field in body axes, and its size."""
    t, colours = array(data["t"]), palette()
    canvas.height = 72.0 * 4
    parts = [(what, dash, _sized(data["y"], prefix)) for prefix, what, dash in PARTS if f"{prefix}x" in data["y"]]
    for i, (name, place) in enumerate(zip((*AXES, "size"), domains(4), strict=True)):
        key = axis_key(i)
        colour = colours[f"a{name}"] if i < 3 else colours["mu"]
        for what, dash, columns in parts:
            own = INK if what == "expected" else colour
            x, y = thinned(t, columns[i], canvas.span)
            line = {"color": own, "dash": dash, "width": LINE}
            canvas.key(Key(what, INK, dash))
            canvas.plain(what, own, x, y, yaxis=key, line=line)
        seen = np.concatenate([within(t, columns[i], canvas.span) for _, _, columns in parts])
        low, high = share(seen, 0.003), share(seen, 0.997)
        pad = max(0.1 * (high - low), 1.0)
        canvas.axes["yaxis" + key[1:]] = axis(f"{name}, µT", domain=place, nticks=5, range=[low - pad, high + pad])
    canvas.axes["xaxis"] = time_axis(canvas.span, "y4")
    phases(canvas)


def _sized(columns: dict[str, Any], prefix: str) -> list[NDArray[np.float64]]:
    """The three axes of a field and its size."""
    axes = [array(columns[prefix + a]) for a in AXES]
    return [*axes, np.sqrt(sum(a * a for a in axes))]


def interference(canvas: Canvas, data: dict[str, Any]) -> None:
    """The field's size less the earth's against what drives the motors, with the fitted line."""
    x, y = array(data["x"]), array(data["y"])
    ends = np.array([x.min(), x.max()])
    line = data["line"][0] + data["line"][1] * ends
    canvas.marker(x, y, {"size": 2.5, "color": palette()["ac"], "opacity": 0.5}, name="samples")
    canvas.plain("fitted line", INK, ends, line, line={"width": STRONG})
    both = np.concatenate([y, line])
    low, high = share(both, 0.005), share(both, 0.995)
    pad = max(0.1 * (high - low), 0.5)
    canvas.axes["xaxis"] = below(data["label"])
    canvas.axes["yaxis"] = axis("field minus the earth’s, µT", range=[low - pad, high + pad], nticks=6)
