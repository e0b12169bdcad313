"""Figure of the four questions: one dot with interval per filter."""

from __future__ import annotations

import math

from attlog.report.figures.figure import FigureSource, PageFigure, View
from attlog.report.first_screen import TITLES, DotScale, accuracy_title, filters_in_order, scale_of, unit_text
from attlog.words.answers import answer_lines
from attlog.words.numbers import MINUS
from attlog.words.ranking import ColumnRanking, RankedValue

# Heights in pixels of a row, and of the gap between panels one above the other.
ROW_PX, BETWEEN_PX = 14.0, 56.0
# Shares of the width: gap between panels, and margin at both ends of a panel.
APART, MARGIN = 0.04, 0.04


def comparison(source: FigureSource) -> PageFigure | None:
    """Draw four panels, two per row.

    Hollow dots are not ranked; dashed lines mark the onboard attitude.
    """
    answers = answer_lines(source.result)
    rows = [r for r in filters_in_order(source.result, answers["accuracy"].column) if r.name in source.styles]
    found = [(key, answers[key].column) for key in TITLES if answers[key].column.filters]
    if not found:
        return None
    view, places = source.view(), [source.index(row.name) for row in rows]
    lines, high = (len(found) + 1) // 2, ROW_PX * max(len(rows), 2)
    size = lines * high + (lines - 1) * BETWEEN_PX
    for i, (key, column) in enumerate(found):
        number, scale = str(i + 1) if i else "", scale_of(column)
        width = 0.5 * (1.0 - APART) if len(found) > 1 else 1.0
        left, top = (i % 2) * (1.0 - width), 1.0 - (i // 2) * (high + BETWEEN_PX) / size
        ends = [math.log10(v) if scale.log else v for v in (scale.low, scale.high)]
        pad = MARGIN * (ends[1] - ends[0])
        view.axis(
            f"x{number}",
            unit_text(key, column),
            type="log" if scale.log else "linear",
            range=[ends[0] - pad, ends[1] + pad],
            domain=[left, left + width],
            anchor=f"y{number}",
            tickvals=scale.ticks,
            ticktext=[f"{t:g}".replace("-", MINUS) for t in scale.ticks],
        )
        domain = [max(top - high / size, 0.0), top]
        view.axis(f"y{number}", "", domain=domain, anchor=f"x{number}", rows=places, named=i % 2 == 0)
        title = TITLES[key][0] if key != "accuracy" else accuracy_title(source.result)
        place = {"x": left, "y": top, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
        view.notes.append(place | {"text": f"<b>{title}</b>", "font": {"color": "tx"}})
        if not scale.log:
            _upright(view, number, 0.0, "tx")
        for row, r in zip(rows, places, strict=True):
            if (judged := column.of(row)) is not None:
                _dot(view, number, r, judged, scale)
        _onboard(view, number, column, scale)
    data = {"views": [view.as_data()], "size": size}
    return PageFigure("comparison", "plot", "The filters compared", "", 0, data)


def _dot(view: View, number: str, r: int, judged: RankedValue, scale: DotScale) -> None:
    """Add a value with its clipped interval; arrows mark values beyond the scale."""
    style, value = view.rows[r], judged.value
    colour = f"e{style.slot}"
    x, low, high = (min(max(v, scale.low), scale.high) for v in (value, *judged.ends))
    symbol = "triangle-left" if value < scale.low else "triangle-right" if value > scale.high else "circle"
    ranked = judged.ranked or not judged.replay
    marker = {"size": 7.5, "symbol": symbol, "color": colour if ranked else "bg"}
    bars = {"type": "data", "symmetric": False, "array": [max(high - x, 0.0)], "arrayminus": [max(x - low, 0.0)]}
    view.markers(
        style.name,
        [x],
        [0.0],
        marker | {"line": {"color": colour, "width": 1.5}},
        meta={"row": r} | ({} if ranked else {"places": "not ranked"}),
        error_x=bars | {"color": colour},
        cliponaxis=False,
        xaxis=f"x{number}",
        yaxis=f"y{number}",
    )


def _onboard(view: View, number: str, column: ColumnRanking, scale: DotScale) -> None:
    """Mark the onboard value if it lies on the scale."""
    onboard = next((j for j in column.judged if j.row.name == "onboard"), None)
    if onboard is not None and scale.holds(onboard.value):
        _upright(view, number, onboard.value, "mu", "dash")


def _upright(view: View, number: str, x: float, colour: str, dash: str = "solid") -> None:
    """Draw a line over the full height of a panel."""
    place = {"xref": f"x{number}", "yref": f"y{number} domain", "x0": x, "x1": x, "y0": 0, "y1": 1}
    line = {"color": colour, "width": 1, "dash": dash}
    view.shapes.append({"type": "line", "layer": "below", "line": line} | place)
