"""Lines of figures that several papers draw, and a paper as one self-contained page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.files import write_atomic
from attlog.core.own_files import PAPER
from attlog.core.plain import json_text, to_plain
from attlog.report import shell
from attlog.report.figures.figure import PageFigure, View, axis_key, panel_domain, unit_suffix
from attlog.report.figures.style import RowStyle
from attlog.reproduce.bench import AXES, FlightSamples, angles, run_filter
from attlog.reproduce.paper import TRUTH_LINE, FigureLine, Paper, PaperFigure, PaperNumber, tally_verdicts
from attlog.words.numbers import below, interval, quantity, unit_sign
from attlog.words.text import typeset

Array = NDArray[np.float64]
Span = tuple[float, float]
WHOLE_FLIGHT: Span = (-np.inf, np.inf)


def curve_line(name: str, t: Array, y: Array, panel: int = 0, span: Span = WHOLE_FLIGHT) -> FigureLine:
    """Return a line of ``y`` (n,) at ``t`` (n,) s within ``span``, thinned for a page."""
    part = (t >= span[0]) & (t < span[1])
    return FigureLine(name, *thin(t[part], y[part]), panel)


def truth_lines(s: FlightSamples, span: Span = WHOLE_FLIGHT, axes: int = len(AXES)) -> list[FigureLine]:
    """Return the true roll, pitch, heading [deg] of a flight, a panel each."""
    y = angles(s.q)
    return [curve_line(TRUTH_LINE, s.t, y[:, axis], axis, span) for axis in range(axes)]


def filter_lines(
    s: FlightSamples, rows: Mapping[str, str], errors: bool = False, span: Span = WHOLE_FLIGHT
) -> list[FigureLine]:
    """Return angles of filters over the samples of a flight, or their ``errors``, by axis [deg], a panel each.

    ``rows``: name of the line by filter (``mahony@xu-0.6``).
    """
    lines = []
    for row, name in rows.items():
        found = run_filter(row, s)
        y = found.errors if errors else found.angles
        lines += [curve_line(name, found.t, y[:, axis], axis, span) for axis in range(len(AXES))]
    return lines


def points_line(name: str, x: Sequence[float], numbers: Sequence[PaperNumber], panel: int = 0) -> FigureLine:
    """Return numbers at ``x`` with the ends of their intervals."""
    y = np.array([np.nan if n.value is None else n.value for n in numbers])
    ends = np.array([n.ci95 or (v, v) for n, v in zip(numbers, y, strict=True)])
    return FigureLine(name, x, y, panel, ends[:, 0], ends[:, 1])


def thin(t: Array, y: Array, most: int = 8000) -> tuple[Array, Array]:
    """Return every k-th point of a line, so that a page stays small."""
    every = -(-len(t) // most)
    return t[::every], y[::every]


WEB_FOLDER = Path(__file__).parent / "web"
PALETTE_SIZE = 8
# Step of stored values, coarser where the range needs it.
VALUE_STEP = 1e-6
CHIP_CLASS = {"holds": "good", "holds in part": "warn", "does not hold": "bad", "cannot be judged": ""}


def write_page(paper: Paper, path: Path) -> None:
    """Write the page of a paper (atomically). OutputError if it cannot be written."""
    write_atomic(path, render_paper(paper), PAPER)


def render_paper(paper: Paper) -> str:
    """Return the page as text: nothing in it is loaded from anywhere."""
    rows = line_styles(list(dict.fromkeys(line.name for figure in paper.figures for line in figure.lines)))
    figures = [_page_figure(figure, rows) for figure in paper.figures]
    return shell.render(
        "paper.html",
        WEB_FOLDER,
        rows=rows,
        figures=figures,
        document=json_text(to_plain(paper)),
        styles=("paper.css",),
        paper=paper,
        places=list(zip(paper.figures, figures, strict=True)),
        chip=CHIP_CLASS,
        measured=number_text,
        tally=tally_verdicts(paper),
    )


def line_styles(names: Sequence[str]) -> list[RowStyle]:
    """Return how each line is drawn: the truth in black, the others in the colours of the palette."""
    others = [name for name in names if name != TRUTH_LINE]
    dashes = ("solid", "dash", "dot")
    return [
        RowStyle(name, 0, "solid", onboard=True)
        if name == TRUTH_LINE
        else RowStyle(name, 1 + others.index(name) % PALETTE_SIZE, dashes[others.index(name) // PALETTE_SIZE % 3])
        for name in names
    ]


def number_text(number: PaperNumber) -> str:
    """Return a number with its interval and its flights: ``0.42° (0.40 to 0.44; 20)``."""
    if number.value is None:
        return "not measurable"
    most = max(map(abs, (number.value, *(number.ci95 or ()))))
    if quantity(most, number.unit, False).startswith("<"):  # nothing of it can be shown
        return f"below {below(most, number.unit)} ({number.n})"
    if most == 0.0:
        return f"0{'' if number.unit == 'deg' else ' '}{unit_sign(number.unit)} ({number.n})"
    ends = interval(number.ci95, number.unit)
    return (
        f"{quantity(number.value, number.unit)} ({ends}; {number.n})" if ends else quantity(number.value, number.unit)
    )


def unit_of(title: str) -> str:
    """Return the unit at the end of an axis' title, empty without one."""
    return title.rpartition(", ")[2] if ", " in title else ""


def _page_figure(figure: PaperFigure, rows: Sequence[RowStyle]) -> PageFigure:
    """Return the figure for the page: curves, or points with their intervals."""
    view = View(rows)
    places = {row.name: r for r, row in enumerate(rows)}
    lines = sorted(figure.lines, key=lambda line: rows[places[line.name]].depth)
    drawn = list(dict.fromkeys(places[line.name] for line in figure.lines))
    x = np.concatenate([np.asarray(line.x, np.float64) for line in lines] or [np.zeros(1)])
    limits = [math.log10(v) if figure.x_log else float(v) for v in (x.min(), x.max())]
    shift = 0.5 / (len(drawn) + 1) if figure.ticks else 0.0
    for line in lines:
        r, unit = places[line.name], unit_of(figure.panels[line.panel])
        meta: dict[str, Any] = {"digits": 3}
        key = axis_key(line.panel)
        if figure.kind == "curves":
            meta |= {"time": True, "step": VALUE_STEP}
            view.row(r, np.asarray(line.x), np.asarray(line.y), unit=unit, yaxis=key, meta=meta)
        else:
            place = np.asarray(line.x, np.float64) + shift * (drawn.index(r) - 0.5 * (len(drawn) - 1))
            _add_points(view, r, place, line, unit=unit, yaxis=key, meta=meta, ticks=bool(figure.ticks))
    for i, title in enumerate(figure.panels):
        fit: dict[str, Any] = {"least": 1e-4}
        if figure.kind == "points":
            own = [x for line in lines if line.panel == i for x in (line.low, line.high) if x is not None]
            fit = {"include": [0.0, *(float(f(np.asarray(x))) for x in own for f in (np.nanmin, np.nanmax))]}
        view.axis(axis_key(i), _axis_title(title), domain=panel_domain(i, len(figure.panels)), nticks=5, fit=fit)
    pad = 0.0 if figure.kind == "curves" else (0.06 * (limits[1] - limits[0]) or 0.5) + shift * len(drawn)
    axis: dict[str, Any] = {"range": [limits[0] - pad, limits[1] + pad], "anchor": axis_key(len(figure.panels) - 1)}
    axis |= {"type": "log"} if figure.x_log else {}
    axis |= {"tickvals": list(range(len(figure.ticks))), "ticktext": list(figure.ticks)} if figure.ticks else {}
    view.axis("x", _axis_title(figure.x_title), **axis)
    data = {"views": [view.as_data()], "at": unit_suffix(unit_of(figure.x_title))}
    title = f"{typeset(figure.title)} ({figure.where})" if figure.where else typeset(figure.title)
    words = "; ".join(_line_words(line, figure) for line in figure.lines)
    return PageFigure(figure.id, "plot", title, typeset(figure.caption), figure.height, data, words=words)


def _add_points(view: View, r: int, x: Array, line: FigureLine, *, ticks: bool, **more: Any) -> None:
    """Add points with their intervals; points at named places are not joined."""
    colour, y = f"e{view.rows[r].slot}", np.asarray(line.y, np.float64)
    if line.low is not None and line.high is not None:
        size = {"array": np.asarray(line.high) - y, "arrayminus": y - np.asarray(line.low)}
        look = {"type": "data", "symmetric": False, "color": colour, "thickness": 1.6, "width": 4}
        more["error_y"] = look | size
    marker = {"size": 8, "color": colour}
    view.row(r, x, y, mode="markers" if ticks else "lines+markers", marker=marker, **more)


def _axis_title(title: str) -> str:
    unit = unit_of(title)
    return f"{typeset(title.removesuffix(unit))}{unit_sign(unit)}" if unit else typeset(title)


def _line_words(line: FigureLine, figure: PaperFigure) -> str:
    """Return a line's smallest and largest value in words."""
    y = np.asarray(line.y, np.float64)
    good = y[np.isfinite(y)]
    title = figure.panels[line.panel]
    named = f"{line.name}, {typeset(title).partition(',')[0]}"
    if not len(good):
        return f"{named}: nothing"
    ends = [quantity(float(v), unit_of(title), False) for v in (good.min(), good.max())]
    return f"{named}: {ends[0]} to {ends[1]}"
