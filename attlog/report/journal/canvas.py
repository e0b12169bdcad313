"""What a drawing function draws on: lines of rows, plain lines, marks, and the layout that they end in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.journal.legend import Key, legend
from attlog.report.journal.style import AXIS_LINE, DASH, DASHES, FONT, INK, LINE, STRONG, TEXT, WIDTH, palette, safe
from attlog.report.look import DASHES as PAGE_DASHES
from attlog.report.look import Look

Array = NDArray[np.float64]

LEFT, RIGHT, BOTTOM = 54, 11, 34
ABOVE = 1.2 * TEXT
"""Pixels of words above the figure."""


@dataclass(frozen=True, slots=True)
class RowLine:
    """How a row is drawn in print. A ``lost`` row (diverged) does not set the range of an axis."""

    name: str
    colour: str
    dash: str
    width: float
    lost: bool
    onboard: bool


def row_lines(looks: Iterable[Look]) -> list[RowLine]:
    """Of all rows: the page's colours; the dash follows from the colour, and from the page's dash."""
    found: list[RowLine] = []
    for look in looks:
        shift = PAGE_DASHES.index(look.dash)
        dash = DASHES[shift if look.slot == 0 else (look.slot - 1 + 3 * shift) % len(DASHES)]
        width = STRONG if look.onboard else LINE
        found.append(RowLine(safe(look.name, 40), palette()[f"e{look.slot}"], dash, width, look.lost, look.onboard))
    return found


class Canvas:
    """Traces and layout of one figure. ``shown``: positions of the rows that are drawn; ``span``: flight time, s."""

    def __init__(self, rows: list[RowLine], shown: set[int], marks: dict[str, Any], span: tuple[float, float]) -> None:
        self.rows, self.shown, self.marks, self.span = rows, shown, marks, span
        self.traces: list[dict[str, Any]] = []
        self.axes: dict[str, dict[str, Any]] = {}
        self.shapes: list[dict[str, Any]] = []
        self.notes: list[dict[str, Any]] = []
        self.keys: dict[str, Key] = {}
        self.left, self.right, self.height, self.above = float(LEFT), float(RIGHT), 150.0, 0.0

    @property
    def inside(self) -> float:
        """Pixels between the left and the right axis."""
        return WIDTH - self.left - self.right

    def row(self, r: int, x: Any, y: Any, *, key: bool = True, **more: Any) -> dict[str, Any]:
        """A line of a row."""
        own = self.rows[r]
        line = {"color": own.colour, "width": own.width, "dash": own.dash} | more.pop("line", {})
        return self._put({"x": x, "y": y, "name": own.name, "mode": "lines", "line": line, "meta": r} | more, key)

    def plain(self, name: str, colour: str, x: Any, y: Any, **more: Any) -> dict[str, Any]:
        """A line that belongs to no row."""
        line = {"color": colour, "width": LINE} | more.pop("line", {})
        return self._put({"x": x, "y": y, "name": safe(name), "mode": "lines", "line": line} | more, key=True)

    def edge(self, x: Any, y: Any, **more: Any) -> dict[str, Any]:
        """An edge of a band: not drawn itself."""
        return self._put({"x": x, "y": y, "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"} | more)

    def marker(self, x: Any, y: Any, marker: dict[str, Any], **more: Any) -> dict[str, Any]:
        """Points without a line; what has a name stands in the legend."""
        if "name" in more:
            self.key(Key(more["name"], marker["color"], symbol=marker.get("symbol", "circle")))
        return self._put({"x": x, "y": y, "mode": "markers", "marker": marker} | more)

    def key(self, key: Key) -> None:
        """An entry of the legend; the first of a name stays."""
        self.keys.setdefault(key.name, key)

    def level(self, name: str, y: float, colour: str, dash: str = DASH) -> None:
        """A line across the figure."""
        line = {"color": colour, "width": LINE, "dash": dash}
        place = {"xref": "paper", "yref": "y", "x0": 0, "x1": 1, "y0": y, "y1": y}
        self.shapes.append({"type": "line", "line": line} | place)
        self.key(Key(name, colour, dash))

    def upright(self, x: float, colour: str, dash: str = "solid", width: float = AXIS_LINE) -> None:
        """A line from bottom to top."""
        line = {"color": colour, "width": width, "dash": dash}
        place = {"xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1}
        self.shapes.append({"type": "line", "layer": "below", "line": line} | place)

    def band(self, low: float, high: float, fill: str, **more: Any) -> None:
        """A shaded part of the horizontal axis."""
        place = {"xref": "x", "yref": "paper", "x0": low, "x1": high, "y0": 0, "y1": 1}
        self.shapes.append({"type": "rect", "layer": "below", "fillcolor": fill, "line": {"width": 0}} | place | more)

    def note(self, x: float, words: str, colour: str = INK, **more: Any) -> None:
        """Words above the figure, at a place of its horizontal axis."""
        self.above = ABOVE
        font = {"size": TEXT, "color": colour}
        place = {"x": x, "y": 1, "xref": "x", "yref": "paper", "yanchor": "bottom", "showarrow": False}
        self.notes.append(place | {"text": safe(words), "font": font} | more)

    def drawn_rows(self, found: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        """Entries whose row is shown, the onboard lines first: filters are drawn over them."""
        return sorted((s for s in found if s["r"] in self.shown), key=lambda s: (not self.rows[s["r"]].onboard, s["r"]))

    def finished(self) -> dict[str, Any]:
        """Traces and layout as plotly takes them."""
        keys = list(self.keys.values())
        if len(keys) == 1 and not (keys[0].fill or keys[0].symbol):
            keys = []  # one line alone: the axis says what it is
        if "domain" not in self.axes["yaxis"]:
            self.axes["yaxis"]["title"]["standoff"] = 3  # of several panels the titles stand in line instead
        shapes, texts, high = legend(keys, self.left, self.above)
        top = 6.0 + high + self.above
        layout: dict[str, Any] = {
            "width": WIDTH,
            "height": round(self.height + top + BOTTOM),
            "font": {"family": FONT, "size": TEXT, "color": INK},
            "margin": {"l": self.left, "r": self.right, "t": top, "b": BOTTOM, "pad": 0},
            "paper_bgcolor": "#ffffff",
            "plot_bgcolor": "#ffffff",
            "showlegend": False,
            "shapes": [*self.shapes, *shapes],
            "annotations": [*self.notes, *texts],
        }
        return {"data": self.traces, "layout": layout | self.axes}

    def _put(self, trace: dict[str, Any], key: bool = False) -> dict[str, Any]:
        """Keep a trace; with ``key`` its name stands in the legend, once."""
        trace = {"type": "scatter"} | trace
        if key:
            line = trace["line"]
            self.key(Key(trace["name"], line["color"], line.get("dash", "solid"), line["width"]))
        self.traces.append(trace)
        return trace
