"""A paper run again as one self-contained page: claims with verdicts, figures, tables, settings."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from attlog.base.files.output import write_atomic
from attlog.base.plain import plain
from attlog.present.numbers import below, interval, quantity, unit_sign
from attlog.present.text import typeset
from attlog.report import shell
from attlog.report.figures.figure import PageFigure as Place
from attlog.report.figures.figure import listed
from attlog.report.pack import Store
from attlog.reproduce.paper import TRUTH, FigureLine, Paper, PaperFigure, PaperNumber, tally

OWN = Path(__file__).parent / "web"
COLOURS = 8
STEP = 1e-6
"""Values of lines are stored in steps of this size, coarser where the range needs it."""
CHIP = {"holds": "good", "holds in part": "warn", "does not hold": "bad", "cannot be judged": ""}


def write(paper: Paper, path: Path) -> None:
    """Write the page of a paper (atomically). OutputError if it cannot be written."""
    write_atomic(path, render(paper))


def render(paper: Paper) -> str:
    """The page as text: nothing in it is loaded from anywhere."""
    store = Store()
    names = list(dict.fromkeys(line.name for figure in paper.figures for line in figure.lines))
    rows = looks(names)
    figures = [_place(figure, names, store) for figure in paper.figures]
    return shell.render(
        "paper.html",
        OWN,
        rows=rows,
        figures=figures,
        store=store,
        document=plain(paper),
        scripts=("curves.js",),
        styles=("paper.css",),
        paper=paper,
        places=list(zip(paper.figures, figures, strict=True)),
        chip=CHIP,
        measured=measured,
        tally=tally(paper),
    )


def looks(names: Iterable[str]) -> list[dict[str, Any]]:
    """How each line name is drawn: the truth in black, the others in the colours of the palette."""
    others = [name for name in names if name != TRUTH]
    return [
        {
            "name": name,
            "slot": 0 if name == TRUTH else 1 + others.index(name) % COLOURS,
            "dash": ("solid", "dash", "dot")[0 if name == TRUTH else others.index(name) // COLOURS % 3],
            "shown": True,
            "onboard": name == TRUTH,
            "lost": False,
        }
        for name in names
    ]


def measured(number: PaperNumber) -> str:
    """A number with its interval and how many flights it stands on: ``0.42° (0.40 to 0.44; 20)``."""
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
    """The unit that a title of an axis ends with, empty where there is none."""
    return title.rpartition(", ")[2] if ", " in title else ""


def _place(figure: PaperFigure, names: list[str], store: Store) -> Place:
    panels = [_titled(title) for title in figure.panels]
    x = np.concatenate([np.asarray(line.x, np.float64) for line in figure.lines])
    low, high = (float(x.min()), float(x.max())) if len(x) else (0.0, 1.0)
    data: dict[str, Any] = {
        "panels": panels,
        "units": [_sign(p) for p in figure.panels],
        "x": _titled(figure.x_title),
        "at": _sign(figure.x_title),
        "range": [low, high],
        "ticks": list(figure.ticks),
        "log": figure.x_log,
    }
    if figure.kind == "curves":
        data["series"] = [
            {
                "r": names.index(line.name),
                "t": store.times(np.asarray(line.x, np.float64)),
                "y": {str(line.panel): store.values(np.asarray(line.y, np.float64), STEP)},
            }
            for line in figure.lines
        ]
    else:
        data["dots"] = [_dots(line, names) for line in figure.lines]
    words = "; ".join(_reach(line, figure) for line in figure.lines)
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


def _dots(line: FigureLine, names: list[str]) -> dict[str, Any]:
    ends = None if line.low is None or line.high is None else [listed(line.low), listed(line.high)]
    return {"r": names.index(line.name), "panel": line.panel, "x": listed(line.x), "y": listed(line.y), "ci": ends}


def _titled(title: str) -> str:
    unit = unit_of(title)
    return f"{typeset(title.removesuffix(unit))}{unit_sign(unit)}" if unit else typeset(title)


def _sign(title: str) -> str:
    """The unit behind a number."""
    unit = unit_sign(unit_of(title))
    return unit if unit.startswith("°") or not unit else f" {unit}"


def _reach(line: FigureLine, figure: PaperFigure) -> str:
    """What a line shows in words: its smallest and largest value."""
    y = np.asarray(line.y, np.float64)
    good = y[np.isfinite(y)]
    title = figure.panels[line.panel]
    named = f"{line.name}, {typeset(title).partition(',')[0]}"
    if not len(good):
        return f"{named}: nothing"
    ends = [quantity(float(v), unit_of(title), False) for v in (good.min(), good.max())]
    return f"{named}: {ends[0]} to {ends[1]}"
