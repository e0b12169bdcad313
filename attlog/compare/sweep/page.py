"""The page of a sweep: a curve along each parameter, a heat map of the first two, what they show, tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from attlog.compare.sweep.grid import GridAxis, text_of
from attlog.compare.sweep.sweep import Sweep, SweepColumn
from attlog.compare.sweep.text import difference_text, document, log_rows, named, references_of, rows, sentences
from attlog.compare.tables.settings_page import PageSection, SettingsPage, render
from attlog.present.numbers import counted, number, quantity, unit_sign
from attlog.report.figures.figure import PageFigure, listed

DARKEST = 3.0
"""Cells three times as far from perfect as the best, and beyond, are the darkest."""


def sweep_page(s: Sweep, about: Mapping[str, Any]) -> str:
    """The page as text; ``about``: version, command and logs as in the JSON."""
    title = f"{s.filter}: {counted(len(s.grid), 'setting')} on {counted(len(s.logs), 'log')}"
    return render(SettingsPage("sweep", title, document(s, dict(about)), list(_sections(s, about))))


def _sections(s: Sweep, about: Mapping[str, Any]) -> Iterator[PageSection]:
    said = list(sentences(s, references_of(about)))
    for m, column in enumerate(s.columns):
        last = m + 1 == len(s.columns)
        under = said[m:] if last else said[m : m + 1]
        yield PageSection(column.metric.title, figures=list(_of(s, m)), said=under)
    single = s.columns[0].single
    if single is not None:
        own = text_of(s.settings[single])
        paste = f"attlog analyze LOG --estimators {s.filter}{',' if ':' in s.filter else ':'}{own}"
        yield PageSection("Best setting, to paste", code=paste)
    yield PageSection("Every setting", table=rows(s), folded=True)
    if len(s.logs) > 1:
        for column in (c for c in s.columns if c.single is not None):
            yield PageSection(f"Each log: {column.metric.title}", table=log_rows(s, column), left=2, folded=True)
    keys = ("name", "vehicle", "firmware", "reference")
    logs = [[str(log[k]) for k in keys] for log in about["logs"]]
    yield PageSection("Logs", table=(["log", "vehicle", "firmware", "compared with"], logs), left=3, folded=True)


def figures(s: Sweep) -> list[PageFigure]:
    """Every figure, metric by metric."""
    return [figure for m in range(len(s.columns)) for figure in _of(s, m)]


def _of(s: Sweep, m: int) -> Iterator[PageFigure]:
    """The figures of one metric; none where no setting can be judged."""
    free = [a for a in s.grid.axes if len(a.values) > 1]
    column = s.columns[m]
    if column.single is None:
        return
    for k, axis in enumerate(free):
        yield _curve(s, column, axis, f"along{m}_{k}", alone=len(free) == 1)
    if len(free) > 1:
        yield _heat_map(s, column, free, f"cells{m}")


def _heat_map(s: Sweep, c: SweepColumn, free: list[GridAxis], name: str) -> PageFigure:
    """Cells of the first two parameters; of settings that share both the best is shown."""
    down, across = free[:2]
    lowest = float(np.nanmin(c.score[: s.base]))
    near = set(c.near)
    cells: list[dict[str, Any]] = []
    for i, x in enumerate(across.values):
        for j, y in enumerate(down.values):
            own = [k for k in range(s.base) if s.settings[k][across.name] == x and s.settings[k][down.name] == y]
            k = _best(c, own)
            if k is None:
                cells.append(
                    {"i": i, "j": j, "share": None, "text": "", "say": "no value", "near": False, "best": False}
                )
                continue
            value = float(c.score[k])
            far = math.log(max(value, 1e-300) / max(lowest, 1e-300)) / math.log(DARKEST) if value > 0 else 0.0
            cells.append(
                {
                    "i": i,
                    "j": j,
                    "share": min(far, 1.0),
                    "text": number(value, c.metric.unit, False),
                    "say": _words(s, c, k),
                    "near": k in near,
                    "best": k == c.single,
                }
            )
    others = ", ".join(a.name for a in free[2:])
    data = {
        "cells": cells,
        "across": [_label(v) for v in across.values],
        "down": [_label(v) for v in down.values],
        "x": _titled(across),
        "y": _titled(down),
        "table": _table(s, c, near),
    }
    mean = "Mean of the logs. " if len(s.logs) > 1 else ""
    caption = f"{mean}Dark: three times as far from perfect, or more. Framed: the best. Dot: not significantly worse."
    title = f"{c.metric.title} over {down.name} and {across.name}{_at_best(others)}"
    return PageFigure(name, "cells", title, caption, 96 + 34 * len(down.values), data, True, _described(s, c))


def _curve(s: Sweep, c: SweepColumn, axis: GridAxis, name: str, *, alone: bool) -> PageFigure:
    """Values along one parameter, all others each at its best; the mean over the logs and each log."""
    best = [_best(c, [k for k in range(s.base) if s.settings[k][axis.name] == v]) for v in axis.values]
    mean = [math.nan if k is None else float(c.score[k]) for k in best]
    each = [
        [math.nan if k is None else abs(float(c.values[k, j])) for k in best]
        for j in (c.used if len(s.logs) > 1 else [])
    ]
    near = set(c.near)
    places, spacing = _places(axis)
    unit = unit_sign(c.metric.unit)
    data: dict[str, Any] = {
        "x": places,
        "log": spacing == "log",
        "ticks": [_label(v) for v in axis.values],
        "axis": _titled(axis),
        "title": f"{c.metric.title}, {unit}" if unit else c.metric.title,
        "y": listed(mean),
        "logs": [{"name": s.logs[j], "y": listed(y)} for j, y in zip(c.used, each, strict=False)],
        "near": [k in near for k in best],
        "best": best.index(c.single) if c.single in best else None,
        "say": ["" if k is None else _words(s, c, k) for k in best],
        "table": _table(s, c, near),
    }
    lines = " Thin lines: each log." if each else ""
    return PageFigure(
        name,
        "along",
        f"{c.metric.title} along {axis.name}{'' if alone else _at_best('all others')}",
        f"Red: best. Band and filled: not significantly worse.{lines}",
        300,
        data,
        alone,
        _described(s, c),
    )


def _at_best(others: str) -> str:
    return f", {others} each at its best" if others else ""


def _words(s: Sweep, c: SweepColumn, k: int) -> str:
    """What the pointer shows of a setting."""
    value = quantity(float(c.score[k]), c.metric.unit, False) or "no value"
    return f"{named(s.settings[k])}: {value}, {difference_text(c.beside[k], c.metric.unit)}"


def _described(s: Sweep, c: SweepColumn) -> str:
    """What a figure shows, for those who do not see it: the best, and what does not differ significantly."""
    first = [] if c.single is None else [_words(s, c, c.single)]
    return "; ".join([*first, *(_words(s, c, k) for k in c.near if k != c.single)])


def _table(s: Sweep, c: SweepColumn, near: set[int]) -> list[list[Any]]:
    """The figure's numbers to be saved: every setting of the grid."""
    names = [a.name for a in s.grid.axes]
    rows: list[list[Any]] = [[*names, f"{c.metric.metric} [{c.metric.unit}]", "differs significantly from the best"]]
    for k in range(s.base):
        value = float(c.score[k])
        differs = "no" if k in near else "yes"
        rows.append([*(s.settings[k][n] for n in names), *listed([value]), differs if math.isfinite(value) else ""])
    return rows


def _best(c: SweepColumn, numbers: list[int]) -> int | None:
    """Of these settings the one with the smallest score, None where none has one."""
    known = [k for k in numbers if math.isfinite(c.score[k])]
    return min(known, key=lambda k: (float(c.score[k]), k)) if known else None


def _places(axis: GridAxis) -> tuple[list[float], str]:
    """Where the values of an axis stand, and on which scale: ``log`` or ``linear`` by size, else ``side by side``.

    Words stand side by side, and so do lists that hold very different sizes.
    """
    values = [v for v in axis.values if isinstance(v, float)]
    in_order = [float(i) for i in range(len(axis.values))]
    if len(values) < len(axis.values):
        return in_order, "side by side"
    ordered = sorted(values)
    steps = [b - a for a, b in pairwise(ordered)]
    if axis.spacing == "log" or (ordered[0] > 0 and ordered[-1] / ordered[0] >= 10.0):
        return values, "log"
    if max(steps) > 20.0 * min(steps):
        return in_order, "side by side"
    return values, "linear"


def _label(value: float | str) -> str:
    return f"{value:.3g}" if isinstance(value, float) else value


def _titled(axis: GridAxis) -> str:
    return f"{axis.name}, {unit_sign(axis.unit)}" if unit_sign(axis.unit) else axis.name
