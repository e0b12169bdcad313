"""The legend above a figure: samples and names one after the other, in as few rows as they fit.

plotly's own keeps columns as wide as the longest name: in one column of a journal it would be as high as the figure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from attlog.report.journal.style import INK, LINE, TEXT, WIDTH, faded

Layout = dict[str, Any]

SAMPLE, BEHIND, BETWEEN = 18.0, 1.0, 9.0
"""Pixels of a line's sample, between it and its name, and between entries."""
POINT = 8.0
"""Of a symbol's sample."""
EDGE, GAP = 4.0, 3.0
"""Pixels to the left of it, and below it."""
ROW = 1.25 * TEXT
NARROW, WIDE = set("fijlrtI.,:;'|!()[] -·°"), set("mwMW@%")
CORNERS = {
    "diamond": (4, 90),
    "square": (4, 45),
    "triangle-up": (3, 90),
    "triangle-down": (3, 270),
    "pentagon": (5, 90),
}
"""Symbols by how many corners they have and where the first one is, deg."""


@dataclass(frozen=True, slots=True)
class Key:
    """An entry: a line with its dash, a band (``fill``), or a ``symbol``, filled or hollow."""

    name: str
    colour: str
    dash: str = "solid"
    width: float = LINE
    symbol: str = ""
    full: bool = True
    fill: bool = False

    @property
    def sample(self) -> float:
        """Its width in pixels."""
        return POINT if self.symbol else SAMPLE


def text_width(text: str) -> float:
    """About how many pixels a text is wide in Arial."""
    return TEXT * sum(0.3 if c in NARROW else 0.86 if c in WIDE else 0.7 if c.isupper() else 0.55 for c in text)


def legend(keys: Sequence[Key], left: float, above: float) -> tuple[list[Layout], list[Layout], float]:
    """Shapes, texts and height of a legend ``above`` the figure; ``left``: of the figure in the picture; all pixels.

    All is placed from the figure's upper left corner, so that it stays where it is in a wider figure.
    """
    places, x, row = [], EDGE, 0
    for key in keys:
        wide = key.sample + BEHIND + text_width(key.name)
        if x > EDGE and x + wide > WIDTH - EDGE:
            x, row = EDGE, row + 1
        places.append((x - left, row))
        x += wide + BETWEEN
    height = ROW * (row + 1) + GAP if keys else 0.0
    shapes, texts = [], []
    for key, (x, row) in zip(keys, places, strict=True):
        y = above + height - ROW * (row + 0.5)
        shapes.append(_sample(key, x, y))
        font = {"size": TEXT, "color": INK}
        place = {"x": 0, "y": 1, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "middle"}
        shift = {"xshift": x + key.sample + BEHIND, "yshift": y}
        texts.append({"text": key.name, "showarrow": False, "font": font} | place | shift)
    return shapes, texts, height


def _sample(key: Key, x: float, y: float) -> dict[str, Any]:
    """The shape of an entry whose left middle is at x, y."""
    place: dict[str, Any] = {"xref": "paper", "yref": "paper", "xanchor": 0, "yanchor": 1}
    place |= {"xsizemode": "pixel", "ysizemode": "pixel"}
    line = {"color": key.colour, "width": key.width, "dash": key.dash}
    if key.fill:
        box = {"x0": x, "x1": x + SAMPLE, "y0": y - 4, "y1": y + 4, "line": {"width": 0}}
        return place | box | {"type": "rect", "fillcolor": faded(key.colour, 0.25)}
    if not key.symbol:
        return place | {"type": "line", "x0": x, "x1": x + SAMPLE, "y0": y, "y1": y, "line": line}
    middle, size = x + POINT / 2, POINT / 2 - 0.7
    look = {"fillcolor": key.colour if key.full else "#ffffff", "line": {"color": key.colour, "width": LINE}}
    if key.symbol not in CORNERS:
        box = {"x0": middle - size, "x1": middle + size, "y0": y - size, "y1": y + size}
        return place | box | look | {"type": "circle"}
    corners, first = CORNERS[key.symbol]
    turns = [math.radians(first + 360.0 * k / corners) for k in range(corners)]
    points = [f"{middle + size * math.cos(a):.2f} {y + size * math.sin(a):.2f}" for a in turns]
    return place | look | {"type": "path", "path": f"M{' L'.join(points)} Z"}
