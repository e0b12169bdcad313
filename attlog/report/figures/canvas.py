"""What figures are made of: places in the page, stored lines, dots with intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.bundle import ArrayPacker
from attlog.report.figures.style import (
    AXIS_LINE,
    DASH,
    FONT,
    INK,
    LINE,
    PRINT_DASHES,
    STRONG,
    TEXT,
    WIDTH,
    RowStyle,
    faded,
    palette,
    safe,
)
from attlog.report.figures.style import DASHES as PAGE_DASHES
from attlog.result import Answer, Trace
from attlog.words.numbers import interval, quantity


@dataclass(slots=True)
class PageFigure:
    """A place in the page: ``kind`` names the drawing function of the script, ``data`` is what it draws.

    ``words`` says for those who do not see it what it shows. ``views`` names what can be
    chosen in it: ``data["views"]`` holds as many, each laid over the rest of ``data``. Where
    ``data`` names rows as ``focus``, only they are drawn. ``bands`` are rows whose band can be chosen, by position and
    name; ``data["band"]`` is drawn first.
    """

    id: str
    kind: str
    title: str
    caption: str
    height: int
    data: dict[str, Any] = field(default_factory=dict)
    wide: bool = True
    words: str = ""
    views: list[str] = field(default_factory=list)
    bands: list[tuple[int, str]] = field(default_factory=list)


class Rows:
    """The rows of all figures: figures know them by their position, people by their name."""

    def __init__(self, called: Mapping[str, str]) -> None:
        """``called``: names by id, in the order of the page."""
        self.ids, self.called = list(called), list(called.values())

    def index(self, row: str) -> int:
        """The position of a row by its id."""
        return self.ids.index(row)

    def __contains__(self, row: str) -> bool:
        return row in self.ids

    def __getitem__(self, i: int) -> str:
        return self.called[i]


def packed_series(
    traces: list[Trace], columns: tuple[str, ...], names: Rows, store: ArrayPacker, step: float
) -> tuple[list[dict[str, Any]], float]:
    """Traces put into the store, and how many samples one stored sample stands for (1: all were kept)."""
    drawn = [
        {
            "r": names.index(trace.row),
            "k": trace.key,
            "ratio": round(trace.ratio, 2),
            **packed_trace(trace, columns, store, step),
        }
        for trace in traces
    ]
    whole, kept = sum(len(t.t) * t.ratio for t in traces), sum(len(t.t) for t in traces)
    return drawn, whole / kept if kept else 1.0


def packed_trace(trace: Trace, columns: tuple[str, ...], store: ArrayPacker, step: float) -> dict[str, Any]:
    """Where times and columns of a trace stand in the store."""
    present = {c: np.asarray(trace.columns[c], np.float64) for c in columns if c in trace.columns}
    return {
        "t": store.times(np.asarray(trace.t, np.float64)),
        "y": {c: store.values(y, step) for c, y in present.items()},
    }


def reduction_text(ratio: float) -> str:
    """The sentence about reduction."""
    if ratio <= 1.005:
        return "Every sample is stored."
    return f"Stored: smallest and largest value of each interval, 1 in {ratio:.1f} samples; no peak is lost."


def range_words(traces: list[Trace], names: Rows, unit: str = "deg") -> str:
    """What lines show in words: of each row and column the smallest and the largest value."""
    rows: dict[str, list[str]] = {}
    for trace in traces:
        for column, y in trace.columns.items():
            good = np.asarray(y, np.float64)[np.isfinite(y)]
            if len(good):
                ends = f"{quantity(float(good.min()), unit, False)} to {quantity(float(good.max()), unit, False)}"
                rows.setdefault(trace.row, []).append(f"{column} {ends}")
    return "; ".join(f"{names[names.index(row)]}: {', '.join(parts)}" for row, parts in rows.items())


def dots_words(dots: list[dict[str, Any]], names: Rows, unit: str) -> str:
    """What dots show in words: of each the row, where it was found, the value and its interval."""
    parts = []
    for d in dots:
        bounds = f" ({interval(d['ci'], unit)})" if d["ci"] else ""
        value = "not judged" if d["v"] is None else quantity(d["v"], unit) + bounds
        parts.append(f"{names[d['r']]}{' ' + d['where'] if 'where' in d else ''}: {value}")
    return "; ".join(parts)


def answer_dot(r: int, found: Answer) -> dict[str, Any]:
    """A value with its interval as a figure draws it."""
    interval = [float(x) for x in found.ci95] if found.ci95 and all(map(is_number, found.ci95)) else None
    value = None if found.value is None else float(found.value)
    return {"r": r, "v": value, "ci": interval, "ok": found.ranked, "n": found.n}


def dot_height(dots: list[dict[str, Any]]) -> int:
    """Pixels for a figure with one line per row."""
    return 90 + 34 * max(len({d["r"] for d in dots}), 2)


def json_numbers(y: Any) -> list[float | None]:
    """A short array as JSON numbers; what is not finite becomes null."""
    return [float(f"{v:.5g}") if math.isfinite(v) else None for v in np.asarray(y, np.float64).tolist()]


def is_number(x: Any) -> bool:
    """Whether x is a finite number."""
    return isinstance(x, (int, float, np.number)) and not isinstance(x, bool) and math.isfinite(x)


# Arrays as they are, in place of what travels in a page.

Array = NDArray[np.float64]


class PlainArrays(ArrayPacker):
    """A store that puts nothing away: what it returns holds the array itself."""

    def values(self, y: Array, step: float = 1e-9) -> dict[str, Any]:
        """The array; ``step`` is of no concern."""
        return {"array": y}

    def times(self, t: Array) -> dict[str, Any]:
        """The times."""
        return {"array": t}


def as_array(stored: Any) -> Array:
    """What a figure's data hold as an array: from the store, or a list in which None is missing."""
    return np.asarray(stored["array"] if isinstance(stored, dict) else stored, np.float64)


# The legend above a figure: samples and names one after the other, in as few rows as they fit.
#
# plotly's own keeps columns as wide as the longest name: in one column of a journal it would be as high as the
# figure.

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
        shapes.append(_legend_sample(key, x, y))
        font = {"size": TEXT, "color": INK}
        place = {"x": 0, "y": 1, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "middle"}
        shift = {"xshift": x + key.sample + BEHIND, "yshift": y}
        texts.append({"text": key.name, "showarrow": False, "font": font} | place | shift)
    return shapes, texts, height


def _legend_sample(key: Key, x: float, y: float) -> dict[str, Any]:
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


# What a drawing function draws on: lines of rows, plain lines, marks, and the layout that they end in.

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


def row_lines(looks: Iterable[RowStyle]) -> list[RowLine]:
    """Of all rows: the page's colours; the dash follows from the colour, and from the page's dash."""
    found: list[RowLine] = []
    for look in looks:
        shift = PAGE_DASHES.index(look.dash)
        dash = PRINT_DASHES[shift if look.slot == 0 else (look.slot - 1 + 3 * shift) % len(PRINT_DASHES)]
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
