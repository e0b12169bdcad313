"""Lines of figures that several papers draw, and a paper as one self-contained page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.files import write_atomic
from attlog.core.plain import to_plain
from attlog.report import shell
from attlog.report.bundle import ArrayPacker
from attlog.report.figures.canvas import PageFigure as Place
from attlog.report.figures.canvas import json_numbers
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
    write_atomic(path, render_paper(paper))


def render_paper(paper: Paper) -> str:
    """Return the page as text; it loads nothing."""
    store = ArrayPacker()
    names = list(dict.fromkeys(line.name for figure in paper.figures for line in figure.lines))
    rows = line_styles(names)
    figures = [_page_figure(figure, names, store) for figure in paper.figures]
    return shell.render(
        "paper.html",
        WEB_FOLDER,
        rows=rows,
        figures=figures,
        store=store,
        document=to_plain(paper),
        scripts=("curves.js",),
        styles=("paper.css",),
        paper=paper,
        places=list(zip(paper.figures, figures, strict=True)),
        chip=CHIP_CLASS,
        measured=number_text,
        tally=tally_verdicts(paper),
    )


def line_styles(names: Iterable[str]) -> list[dict[str, Any]]:
    """Return the style of each line: the truth in black, the others in the colours of the palette."""
    others = [name for name in names if name != TRUTH_LINE]
    return [
        {
            "name": name,
            "slot": 0 if name == TRUTH_LINE else 1 + others.index(name) % PALETTE_SIZE,
            "dash": ("solid", "dash", "dot")[0 if name == TRUTH_LINE else others.index(name) // PALETTE_SIZE % 3],
            "shown": True,
            "onboard": name == TRUTH_LINE,
            "lost": False,
        }
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


def _page_figure(figure: PaperFigure, names: list[str], store: ArrayPacker) -> Place:
    panels = [_axis_title(title) for title in figure.panels]
    x = np.concatenate([np.asarray(line.x, np.float64) for line in figure.lines])
    low, high = (float(x.min()), float(x.max())) if len(x) else (0.0, 1.0)
    data: dict[str, Any] = {
        "panels": panels,
        "units": [_unit_suffix(p) for p in figure.panels],
        "x": _axis_title(figure.x_title),
        "at": _unit_suffix(figure.x_title),
        "range": [low, high],
        "ticks": list(figure.ticks),
        "log": figure.x_log,
    }
    if figure.kind == "curves":
        data["series"] = [
            {
                "r": names.index(line.name),
                "t": store.times(np.asarray(line.x, np.float64)),
                "y": {str(line.panel): store.values(np.asarray(line.y, np.float64), VALUE_STEP)},
            }
            for line in figure.lines
        ]
    else:
        data["dots"] = [_point_data(line, names) for line in figure.lines]
    words = "; ".join(_line_words(line, figure) for line in figure.lines)
    return Place(
        figure.id,
        figure.kind,
        f"{typeset(figure.title)} ({figure.where})" if figure.where else typeset(figure.title),
        typeset(figure.caption),
        figure.height,
        data,
        True,
        words,
    )


def _point_data(line: FigureLine, names: list[str]) -> dict[str, Any]:
    ends = None if line.low is None or line.high is None else [json_numbers(line.low), json_numbers(line.high)]
    return {
        "r": names.index(line.name),
        "panel": line.panel,
        "x": json_numbers(line.x),
        "y": json_numbers(line.y),
        "ci": ends,
    }


def _axis_title(title: str) -> str:
    unit = unit_of(title)
    return f"{typeset(title.removesuffix(unit))}{unit_sign(unit)}" if unit else typeset(title)


def _unit_suffix(title: str) -> str:
    """Return the unit behind a number."""
    unit = unit_sign(unit_of(title))
    return unit if unit.startswith("°") or not unit else f" {unit}"


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
