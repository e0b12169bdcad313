"""A page about settings of one filter: figures, the sentences under them, tables; drawn by the report's machinery."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from attlog.compare.grid import FreeParameter, GridAxis, setting_text
from attlog.compare.search import Sweep, SweepColumn
from attlog.compare.search_text import (
    count_references,
    difference_text,
    gain_rows,
    held_out_rows,
    part_rows,
    paste_lines,
    setting_words,
    sweep_document,
    sweep_log_rows,
    sweep_rows,
    sweep_sentences,
    tune_document,
    tune_sentences,
)
from attlog.compare.tune import Tuning
from attlog.core.plain import to_plain
from attlog.report import shell
from attlog.report.bundle import ArrayPacker
from attlog.report.figures.canvas import PageFigure, json_numbers
from attlog.words.numbers import counted, number, quantity, unit_sign

WEB_FOLDER = Path(__file__).parent / "web"
TableCells = tuple[Sequence[str], Sequence[Sequence[str]]]


@dataclass(slots=True)
class PageSection:
    """What stands under a heading: figures, sentences, text to be copied, a table whose first ``left`` columns and last
    hold words. ``folded``: only the title is shown at first."""

    title: str
    code: str = ""
    figures: Sequence[PageFigure] = ()
    said: Sequence[str] = ()
    table: TableCells | None = None
    left: int = 1
    folded: bool = False


@dataclass(slots=True)
class SettingsPage:
    """``name`` begins the names of tables saved from it; ``document`` is the JSON that can be saved, which holds
    version and command."""

    name: str
    title: str
    document: dict[str, Any]
    sections: list[PageSection] = field(default_factory=list)


def render_settings(page: SettingsPage) -> str:
    """The page as text: nothing in it is loaded from anywhere."""
    return shell.render(
        "settings.html",
        WEB_FOLDER,
        rows=[],
        figures=[figure for section in page.sections for figure in section.figures],
        store=ArrayPacker(),
        document=to_plain(page.document),
        scripts=("settings.js",),
        styles=("settings.css",),
        page=page,
    )


# The page of a sweep: a curve along each parameter, a heat map of the first two, what they show, tables.

DARKEST_RATIO = 3.0
"""Cells three times as far from perfect as the best, and beyond, are the darkest."""


def sweep_page(s: Sweep, about: Mapping[str, Any]) -> str:
    """The page as text; ``about``: version, command and logs as in the JSON."""
    title = f"{s.filter}: {counted(len(s.grid), 'setting')} on {counted(len(s.logs), 'log')}"
    return render_settings(
        SettingsPage("sweep", title, sweep_document(s, dict(about)), list(_sweep_sections(s, about)))
    )


def _sweep_sections(s: Sweep, about: Mapping[str, Any]) -> Iterator[PageSection]:
    said = list(sweep_sentences(s, count_references(about)))
    for m, column in enumerate(s.columns):
        last = m + 1 == len(s.columns)
        under = said[m:] if last else said[m : m + 1]
        yield PageSection(column.metric.title, figures=list(_metric_figures(s, m)), said=under)
    single = s.columns[0].single
    if single is not None:
        own = setting_text(s.settings[single])
        paste = f"attlog analyze LOG --estimators {s.filter}{',' if ':' in s.filter else ':'}{own}"
        yield PageSection("Best setting, to paste", code=paste)
    yield PageSection("Every setting", table=sweep_rows(s), folded=True)
    if len(s.logs) > 1:
        for column in (c for c in s.columns if c.single is not None):
            yield PageSection(f"Each log: {column.metric.title}", table=sweep_log_rows(s, column), left=2, folded=True)
    keys = ("name", "vehicle", "firmware", "reference")
    logs = [[str(log[k]) for k in keys] for log in about["logs"]]
    yield PageSection("Logs", table=(["log", "vehicle", "firmware", "compared with"], logs), left=3, folded=True)


def sweep_figures(s: Sweep) -> list[PageFigure]:
    """Every figure, metric by metric."""
    return [figure for m in range(len(s.columns)) for figure in _metric_figures(s, m)]


def _metric_figures(s: Sweep, m: int) -> Iterator[PageFigure]:
    """The figures of one metric; none where no setting can be judged."""
    free = [a for a in s.grid.axes if len(a.values) > 1]
    column = s.columns[m]
    if column.single is None:
        return
    for k, axis in enumerate(free):
        yield _axis_figure(s, column, axis, f"along{m}_{k}", alone=len(free) == 1)
    if len(free) > 1:
        yield _heat_map_figure(s, column, free, f"cells{m}")


def _heat_map_figure(s: Sweep, c: SweepColumn, free: list[GridAxis], name: str) -> PageFigure:
    """Cells of the first two parameters; of settings that share both the best is shown."""
    down, across = free[:2]
    lowest = float(np.nanmin(c.score[: s.base]))
    near = set(c.near)
    cells: list[dict[str, Any]] = []
    for i, x in enumerate(across.values):
        for j, y in enumerate(down.values):
            own = [k for k in range(s.base) if s.settings[k][across.name] == x and s.settings[k][down.name] == y]
            k = _best_setting(c, own)
            if k is None:
                cells.append(
                    {"i": i, "j": j, "share": None, "text": "", "say": "no value", "near": False, "best": False}
                )
                continue
            value = float(c.score[k])
            far = math.log(max(value, 1e-300) / max(lowest, 1e-300)) / math.log(DARKEST_RATIO) if value > 0 else 0.0
            cells.append(
                {
                    "i": i,
                    "j": j,
                    "share": min(far, 1.0),
                    "text": number(value, c.metric.unit, False),
                    "say": _setting_words(s, c, k),
                    "near": k in near,
                    "best": k == c.single,
                }
            )
    others = ", ".join(a.name for a in free[2:])
    data = {
        "cells": cells,
        "across": [_value_label(v) for v in across.values],
        "down": [_value_label(v) for v in down.values],
        "x": _axis_title(across),
        "y": _axis_title(down),
        "table": _figure_table(s, c, near),
    }
    mean = "Mean of the logs. " if len(s.logs) > 1 else ""
    caption = f"{mean}Dark: three times as far from perfect, or more. Framed: the best. Dot: not significantly worse."
    title = f"{c.metric.title} over {down.name} and {across.name}{_at_best(others)}"
    return PageFigure(name, "cells", title, caption, 96 + 34 * len(down.values), data, True, _figure_words(s, c))


def _axis_figure(s: Sweep, c: SweepColumn, axis: GridAxis, name: str, *, alone: bool) -> PageFigure:
    """Values along one parameter, all others each at its best; the mean over the logs and each log."""
    best = [_best_setting(c, [k for k in range(s.base) if s.settings[k][axis.name] == v]) for v in axis.values]
    mean = [math.nan if k is None else float(c.score[k]) for k in best]
    each = [
        [math.nan if k is None else abs(float(c.values[k, j])) for k in best]
        for j in (c.used if len(s.logs) > 1 else [])
    ]
    near = set(c.near)
    places, spacing = axis_places(axis)
    unit = unit_sign(c.metric.unit)
    data: dict[str, Any] = {
        "x": places,
        "log": spacing == "log",
        "ticks": [_value_label(v) for v in axis.values],
        "axis": _axis_title(axis),
        "title": f"{c.metric.title}, {unit}" if unit else c.metric.title,
        "y": json_numbers(mean),
        "logs": [{"name": s.logs[j], "y": json_numbers(y)} for j, y in zip(c.used, each, strict=False)],
        "near": [k in near for k in best],
        "best": best.index(c.single) if c.single in best else None,
        "say": ["" if k is None else _setting_words(s, c, k) for k in best],
        "table": _figure_table(s, c, near),
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
        _figure_words(s, c),
    )


def _at_best(others: str) -> str:
    return f", {others} each at its best" if others else ""


def _setting_words(s: Sweep, c: SweepColumn, k: int) -> str:
    """What the pointer shows of a setting."""
    value = quantity(float(c.score[k]), c.metric.unit, False) or "no value"
    return f"{setting_words(s.settings[k])}: {value}, {difference_text(c.beside[k], c.metric.unit)}"


def _figure_words(s: Sweep, c: SweepColumn) -> str:
    """What a figure shows, for those who do not see it: the best, and what does not differ significantly."""
    first = [] if c.single is None else [_setting_words(s, c, c.single)]
    return "; ".join([*first, *(_setting_words(s, c, k) for k in c.near if k != c.single)])


def _figure_table(s: Sweep, c: SweepColumn, near: set[int]) -> list[list[Any]]:
    """The figure's numbers to be saved: every setting of the grid."""
    names = [a.name for a in s.grid.axes]
    rows: list[list[Any]] = [[*names, f"{c.metric.metric} [{c.metric.unit}]", "differs significantly from the best"]]
    for k in range(s.base):
        value = float(c.score[k])
        differs = "no" if k in near else "yes"
        rows.append(
            [*(s.settings[k][n] for n in names), *json_numbers([value]), differs if math.isfinite(value) else ""]
        )
    return rows


def _best_setting(c: SweepColumn, numbers: list[int]) -> int | None:
    """Of these settings the one with the smallest score, None where none has one."""
    known = [k for k in numbers if math.isfinite(c.score[k])]
    return min(known, key=lambda k: (float(c.score[k]), k)) if known else None


def axis_places(axis: GridAxis) -> tuple[list[float], str]:
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


def _value_label(value: float | str) -> str:
    return f"{value:.3g}" if isinstance(value, float) else value


def _axis_title(axis: GridAxis) -> str:
    return f"{axis.name}, {unit_sign(axis.unit)}" if unit_sign(axis.unit) else axis.name


# The page of a tuning: how flat the optimum is, what was gained, gains to paste, what was judged where.

MAX_SPREAD_SHOWN = 1.5
"""Costs beyond this share above the spread of the better half are drawn at the upper edge."""


def tune_page(t: Tuning, about: Mapping[str, Any], firmware: Mapping[str, str]) -> str:
    """The page as text; ``about``: version, command and logs as in the JSON."""
    where = counted(len(t.logs), "log") if len(t.logs) > 1 else "one log"
    sections = list(_tune_sections(t, about, firmware))
    whole = tune_document(t, dict(about), dict(firmware))
    return render_settings(SettingsPage("tune", f"{t.filter}: gains from {where}", whole, sections))


def _tune_sections(t: Tuning, about: Mapping[str, Any], firmware: Mapping[str, str]) -> Iterator[PageSection]:
    tried = [_tried_figure(t, f, k) for k, f in enumerate(t.free)]
    yield PageSection("How flat the optimum is", figures=tried, said=list(tune_sentences(t, count_references(about))))
    yield PageSection("Gains, ready to paste", code="\n".join(paste_lines(t, firmware)))
    yield PageSection("On what was left out", table=held_out_rows(t), folded=True)
    yield PageSection("How much the gains depend on the logs", table=gain_rows(t), folded=True)
    yield PageSection("Each part, with gains that were not found on it", table=part_rows(t), folded=True)


def _tried_figure(t: Tuning, f: FreeParameter, number: int) -> PageFigure:
    """The change of the objective over one gain, a dot for each setting that was tried."""
    changes = [100.0 * (math.exp(cost) - 1.0) for _, cost in t.found.tried]
    low, middle = min(changes), sorted(changes)[len(changes) // 2]
    gains = [float(setting[f.name]) for setting, _ in t.found.tried]
    unit = unit_sign(f.unit)
    again = [float(fold.found.setting[f.name]) for fold in t.folds]
    data = {
        "band": [min(again), max(again)],
        "x": json_numbers(gains),
        "y": json_numbers(changes),
        "log": f.log,
        "range": [f.low, f.high],
        "top": max(middle + MAX_SPREAD_SHOWN * (middle - low), low + 1.0),
        "best": [setting == t.found.setting for setting, _ in t.found.tried],
        "say": [f"{setting_words(tried[0])}: {c:+.0f} %" for tried, c in zip(t.found.tried, changes, strict=True)],
        "axis": f"{f.name}, {unit}" if unit else f.name,
        "title": "objective, % of the default gains",
        "table": [
            [f.name, "objective [%]"],
            *([g, c] for g, c in zip(json_numbers(gains), json_numbers(changes), strict=True)),
        ],
    }
    caption = "Red: the gains found. Band: found with logs left out. Triangles: worse than the figure reaches."
    words = f"{setting_words(t.found.setting)}: {min(changes):+.0f} %"
    return PageFigure(
        f"tried{number}",
        "tried",
        f"Every setting that was tried, by {f.name}",
        caption,
        300,
        data,
        len(t.free) == 1,
        words,
    )
