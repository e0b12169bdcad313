"""The four questions beside each other: of every filter a dot with its interval, the figure of the first screen."""

from __future__ import annotations

import math
from typing import Any

from attlog.report.figures.canvas import ABOVE, Canvas, Key, PageFigure, Rows, text_width
from attlog.report.figures.style import AXIS_LINE, DASH, INK, LINE, MARKER, TEXT, WIDTH, RowStyle, axis, below, palette
from attlog.report.first_screen import TITLES, filters_in_order, scale_of, unit_text
from attlog.result import Result
from attlog.words.answers import answer_lines

ROW_PX = 14.0
"""Pixels of a row."""
APART, BETWEEN = 10.0, 56.0
"""Pixels between two panels beside each other, and between two above each other."""
PANEL_MARGIN = 0.04
"""Share of a panel that is free at both ends."""


def comparison_figure(result: Result, look: dict[str, RowStyle]) -> list[PageFigure]:
    """The figure where a question can be answered: rows and, by question, a scale and dots."""
    answers = answer_lines(result)
    names = Rows({key: own.name for key, own in look.items()})
    rows = [row for row in filters_in_order(result, answers["accuracy"].column) if row.name in names]
    found = [(key, answers[key].column) for key in TITLES if answers[key].column.filters]
    if not found:
        return []
    places = [names.index(row.name) for row in rows]
    questions = []
    for key, column in found:
        scale = scale_of(column)
        dots = [
            {"r": r, "v": judged.value, "ci": judged.ends, "ok": judged.ranked or not judged.replay}
            for r, row in zip(places, rows, strict=True)
            if (judged := column.of(row)) is not None
        ]
        about = {"title": TITLES[key][0], "axis": unit_text(key, column), "ticks": scale.ticks}
        questions.append(about | {"low": scale.low, "high": scale.high, "log": scale.log, "dots": dots})
    data = {"rows": places, "questions": questions}
    return [PageFigure("comparison", "comparison", "The filters compared", "", 0, data)]


def draw_comparison(canvas: Canvas, data: dict[str, Any]) -> None:
    """Two panels beside each other, two rows of them; hollow: not ranked; dashes: the onboard attitude."""
    rows = [r for r in data["rows"] if r in canvas.shown]
    names = [canvas.rows[r].name for r in rows]
    questions = data["questions"]
    lines = (len(questions) + 1) // 2
    canvas.left = min(10.0 + max(map(text_width, names), default=0.0), 0.4 * WIDTH)
    high = ROW_PX * max(len(rows), 2)
    canvas.height, canvas.above = lines * high + (lines - 1) * BETWEEN, ABOVE
    for i, question in enumerate(questions):
        panel = ComparisonPanel(canvas, i, len(questions))
        panel.axes(question, rows, names if i % 2 == 0 else [], high)
        for d in question["dots"]:
            if d["r"] in rows:
                panel.dot(question, d, len(rows) - 1.0 - rows.index(d["r"]))


class ComparisonPanel:
    """One panel: the place of its axes and what stands in it."""

    def __init__(self, canvas: Canvas, i: int, count: int) -> None:
        self.canvas, self.i, self.count = canvas, i, count
        self.number = str(i + 1) if i else ""

    def axes(self, question: dict[str, Any], rows: list[int], names: list[str], high: float) -> None:
        """Scale below, names at the left, the question above."""
        canvas = self.canvas
        width = 0.5 * (1.0 - APART / canvas.inside) if self.count > 1 else 1.0
        left = (self.i % 2) * (1.0 - width)
        top = 1.0 - (self.i // 2) * (high + BETWEEN) / canvas.height
        ends = [question["low"], question["high"]]
        ends = [math.log10(v) for v in ends] if question["log"] else ends
        pad = PANEL_MARGIN * (ends[1] - ends[0])
        ticks = question["ticks"]
        canvas.axes[f"xaxis{self.number}"] = below(
            question["axis"],
            type="log" if question["log"] else "linear",
            range=[ends[0] - pad, ends[1] + pad],
            domain=[left, left + width],
            anchor=f"y{self.number}",
            tickvals=ticks,
            ticktext=[f"{t:g}".replace("-", "\u2212") for t in ticks],
        )
        canvas.axes[f"yaxis{self.number}"] = axis(
            "",
            domain=[max(top - high / canvas.height, 0.0), top],
            anchor=f"x{self.number}",
            range=[-0.6, len(rows) - 0.4],
            tickvals=[len(rows) - 1.0 - k for k in range(len(names))],
            ticktext=names,
            ticks="",
        )
        place = {"x": left, "y": top, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
        font = {"size": TEXT, "color": INK}
        canvas.notes.append(place | {"text": f"<b>{question['title']}</b>", "showarrow": False, "font": font})
        if not question["log"]:
            self.upright(0.0, {"color": INK, "width": AXIS_LINE})

    def dot(self, question: dict[str, Any], d: dict[str, Any], y: float) -> None:
        """A value with its interval, cut at the ends of the scale; beyond them an arrow."""
        low, high = question["low"], question["high"]
        own = self.canvas.rows[d["r"]]
        v = min(max(d["v"], low), high)
        symbol = "triangle-left" if d["v"] < low else "triangle-right" if d["v"] > high else "circle"
        ends = [min(max(x, low), high) for x in d["ci"]]
        bars = {"symmetric": False, "array": [max(ends[1] - v, 0.0)], "arrayminus": [max(v - ends[0], 0.0)]}
        bars |= {"color": own.colour, "thickness": LINE, "width": 1.5}
        marker = {"size": MARKER, "symbol": symbol, "color": own.colour if d["ok"] else "#ffffff"}
        marker["line"] = {"color": own.colour, "width": LINE}
        place = {"xaxis": f"x{self.number}", "yaxis": f"y{self.number}", "meta": d["r"]}
        self.canvas.marker([v], [y], marker, error_x=bars, cliponaxis=False, **place)
        if own.onboard and low <= d["v"] <= high:
            self.upright(d["v"], {"color": palette()["mu"], "width": AXIS_LINE, "dash": DASH})
            self.canvas.key(Key("onboard", palette()["mu"], DASH, AXIS_LINE))
        if not d["ok"]:
            self.canvas.key(Key("not ranked", INK, symbol="circle", full=False))

    def upright(self, x: float, line: dict[str, Any]) -> None:
        """A line from the panel's bottom to its top."""
        place = {"xref": f"x{self.number}", "yref": f"y{self.number} domain", "x0": x, "x1": x, "y0": 0, "y1": 1}
        self.canvas.shapes.append({"type": "line", "layer": "below", "line": line} | place)
