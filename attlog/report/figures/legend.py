"""Legend above a printed figure: entries flow into as few rows as fit.

plotly's own legend has columns as wide as the longest name: as high as the figure in one column of a journal.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

Layout = dict[str, Any]

# Pixels (96 per inch) in a point; width of one column of a two-column page, 88 mm; text of 8 pt.
PT, WIDTH = 96.0 / 72.0, 332
TEXT = 8.0 * PT
INK = "#000000"
PLACED = {"xref": "paper", "yref": "paper"}
# Legend in pixels: sample of a line, of a symbol, gap behind it, gap between entries, left margin, gap below.
SAMPLE, POINT, BEHIND, BETWEEN, EDGE, GAP = 18.0, 8.0, 1.0, 9.0, 4.0, 3.0
ROW = 1.25 * TEXT
NARROW, WIDE = set("fijlrtI.,:;'|!()[] -·°"), set("mwMW@%")
# Polygon of a symbol: number of corners, direction of the first one in deg.
CORNERS = {
    "diamond": (4, 90),
    "square": (4, 45),
    "triangle-up": (3, 90),
    "triangle-down": (3, 270),
    "pentagon": (5, 90),
}


@dataclass(frozen=True, slots=True)
class Key:
    """Legend entry: dashed line, band (``fill``), or ``symbol``, filled or hollow."""

    name: str
    colour: str
    dash: str = "solid"
    width: float = 1.0
    symbol: str = ""
    full: bool = True
    fill: bool = False


def text_width(text: str) -> float:
    """Estimate the width of a text in Arial, pixels."""
    return TEXT * sum(0.3 if c in NARROW else 0.86 if c in WIDE else 0.7 if c.isupper() else 0.55 for c in text)


def shortened(name: str, most: int = 26) -> str:
    """Shorten a name to ``most`` characters."""
    return name if len(name) <= most else name[: most - 1] + "…"


def legend(keys: Iterable[Key], left: float, above: float) -> tuple[list[Layout], list[Layout], float]:
    """Return shapes, texts and height of a legend above the figure, in pixels.

    Entries flow into as few rows as fit.
    """
    places, x, row = [], EDGE, 0
    for key in keys:
        sample = POINT if key.symbol else SAMPLE
        wide = sample + BEHIND + text_width(key.name)
        if x > EDGE and x + wide > WIDTH - EDGE:
            x, row = EDGE, row + 1
        places.append((key, x - left, row, sample))
        x += wide + BETWEEN
    height = ROW * (row + 1) + GAP if places else 0.0
    shapes, texts = [], []
    for key, x, row, sample in places:
        y = above + height - ROW * (row + 0.5)
        shapes.append(_legend_sample(key, x, y))
        font = {"size": TEXT, "color": INK}
        place = {"x": 0, "y": 1, "xanchor": "left", "yanchor": "middle"} | PLACED
        shift = {"xshift": x + sample + BEHIND, "yshift": y}
        texts.append({"text": key.name, "showarrow": False, "font": font} | place | shift)
    return shapes, texts, height


def _legend_sample(key: Key, x: float, y: float) -> Layout:
    """Return the shape of an entry with its left middle at x, y."""
    place: Layout = PLACED | {"xanchor": 0, "yanchor": 1, "xsizemode": "pixel", "ysizemode": "pixel"}
    line = {"color": key.colour, "width": key.width, "dash": key.dash}
    if key.fill:
        box = {"x0": x, "x1": x + SAMPLE, "y0": y - 4, "y1": y + 4, "line": {"width": 0}}
        return place | box | {"type": "rect", "fillcolor": key.colour, "opacity": 0.25}
    if not key.symbol:
        return place | {"type": "line", "x0": x, "x1": x + SAMPLE, "y0": y, "y1": y, "line": line}
    middle, size = x + POINT / 2, POINT / 2 - 0.7
    look = {"fillcolor": key.colour if key.full else "#ffffff", "line": {"color": key.colour, "width": 1.0}}
    if key.symbol not in CORNERS:
        box = {"x0": middle - size, "x1": middle + size, "y0": y - size, "y1": y + size}
        return place | box | look | {"type": "circle"}
    corners, first = CORNERS[key.symbol]
    turns = [math.radians(first + 360.0 * k / corners) for k in range(corners)]
    points = [f"{middle + size * math.cos(a):.2f} {y + size * math.sin(a):.2f}" for a in turns]
    return place | look | {"type": "path", "path": f"M{' L'.join(points)} Z"}
