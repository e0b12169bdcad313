"""Report a sweep as text, tables, JSON, CSV and page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from attlog.compare.comparison import Question, commonest_reason, modes_text
from attlog.compare.grid import GridAxis, Setting, setting_text
from attlog.compare.paired import Difference
from attlog.compare.search import SettingResult, Sweep, SweepColumn
from attlog.compare.tables import WEB_FOLDER, TableCells
from attlog.core import files
from attlog.core.plain import json_text, to_plain
from attlog.estimators.registry import FLOWN
from attlog.report import shell
from attlog.report.figures.figure import PageFigure, json_numbers
from attlog.words.numbers import between, change, change_end, counted, listed, number, quantity, unit_sign
from attlog.words.text import clean, typeset

SWEEP_SCHEMA = "attlog-sweep/3"
DEFAULT_GAINS = "default gains"
# Unused logs listed in a sentence. The table lists all.
MAX_NAMED_LOGS = 3
# Distance from ideal, relative to the best, of the darkest cells.
DARKEST_RATIO = 3.0
# A list of values is drawn on a logarithmic axis from this ratio of its ends on, side by side from this ratio of its
# steps on.
MIN_LOG_RATIO, MAX_STEP_RATIO = 10.0, 20.0


def setting_words(setting: Setting) -> str:
    """Format a setting: ``kp 0.6, ki 0.01``; without values ``default gains``."""
    return ", ".join(f"{k} {value_text(v)}" for k, v in setting.items()) or DEFAULT_GAINS


def value_text(value: float | str) -> str:
    """Return a parameter's value."""
    return f"{value:g}" if isinstance(value, float) else value


def sweep_sentences(s: Sweep, references: Mapping[str, int] | None = None) -> Iterator[str]:
    """Yield sentences on each question, and a remark on logs without truth.

    ``references``: number of logs by kind.
    """
    for column in s.columns:
        yield " ".join(_question_sentences(s, column))
    yield from agreement_sentence(references or {}, s.filter, s.modes)


def agreement_sentence(references: Mapping[str, int], filter_name: str, modes: Sequence[str] = ()) -> Iterator[str]:
    """Yield the remarks on the mode of re-runs, and on logs without truth."""
    if mode := modes_text(modes):
        yield f"Run again with {mode}."
    if references.get("onboard"):
        some = f"{counted(references['onboard'], 'log')} of {sum(references.values())}"
        if filter_name.partition(":")[0] in FLOWN:
            yield f"On {some} neither truth nor smoother judges: innovations alone do."
        else:
            yield f"{some} can only be compared with the onboard attitude: what agrees with it, not with the truth."


def count_references(about: Mapping[str, Any]) -> dict[str, int]:
    """Return the number of logs by kind of reference."""
    kinds = [str(log["reference"]) for log in about["logs"]]
    return {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}


def _question_sentences(s: Sweep, c: SweepColumn) -> Iterator[str]:
    title, unit, logs = c.question.title, c.question.unit, len(c.used)
    if c.single is None:
        left = next(iter(c.left_out.values()), "no setting has a value on every log")
        yield f"{title}: no setting of the grid can be judged ({left})."
        return
    value = quantity(float(c.score[c.single]), unit, signed=False)
    where = "" if len(s.logs) == 1 else f" on average of {counted(logs, 'log')}"
    single = "single setting" if logs > 1 else "setting"
    yield f"{title}: best {single} {setting_words(s.settings[c.single])}, {value}{where}."
    if logs > 1:
        own = [abs(float(c.values[k, j])) for j, k in enumerate(c.own) if k is not None]
        yield f"With its own optimum for each log it would be {quantity(sum(own) / len(own), unit, signed=False)}."
    near = [k for k in c.near if k != c.single]
    if near:
        many = f"{counted(len(near), 'other setting')} of {len(s.settings) - 1}"
        yield f"{many} do not differ significantly: {value_ranges(s, [*near, c.single])}."
    else:
        yield "All others are significantly worse, or have no value on some log."
    if c.differences[s.base].value is not None:
        yield f"{_base_name(s).capitalize()}: {difference_text(c.differences[s.base], unit)}."
    edges = axes_at_edge(s, c.single)
    all_equal = {*c.near, c.single, s.base} >= set(range(len(s.settings)))  # the best setting is then chance
    if edges and not all_equal:
        yield f"The optimum lies at the end of the range of {listed(edges)}: a wider one may hold a better setting."
    if c.left_out:
        names = named_logs([s.logs[j] for j in c.left_out])
        yield f"Not counted: {clean(names)} ({next(iter(c.left_out.values()))})."


def named_logs(names: list[str]) -> str:
    """Join the names of logs; beyond MAX_NAMED_LOGS the others are counted."""
    rest = len(names) - MAX_NAMED_LOGS + 1
    return listed(names if rest <= 1 else [*names[: MAX_NAMED_LOGS - 1], f"{rest} more"])


def _base_name(s: Sweep) -> str:
    """Name the settings without values: as flown, or the default gains."""
    return "as flown" if s.filter.partition(":")[0] in FLOWN else DEFAULT_GAINS


def value_ranges(s: Sweep, numbers: Sequence[int]) -> str:
    """Summarise settings by parameter: ``kp 0.3 to 1.1, mag_form heading or vector``."""
    parts = []
    for axis in s.grid.axes:
        values = [v for v in axis.values if any(s.settings[k].get(axis.name) == v for k in numbers)]
        sizes = [v for v in values if isinstance(v, float)]
        if sizes:
            parts.append(f"{axis.name} {min(sizes):g}" + (f" to {max(sizes):g}" if max(sizes) > min(sizes) else ""))
        else:
            parts.append(f"{axis.name} {' or '.join(map(str, values))}")
    return ", ".join(parts)


def axes_at_edge(s: Sweep, best: int) -> list[str]:
    """Return parameters whose best value is an end of their three or more values."""
    found = []
    for axis in s.grid.axes:
        sizes = [v for v in axis.values if isinstance(v, float)]
        if len(sizes) > 2 and s.settings[best][axis.name] in (min(sizes), max(sizes)):
            found.append(axis.name)
    return found


def difference_text(d: Difference, unit: str) -> str:
    """Describe a setting against the best: ``27 % worse (15 to 41 %)``."""
    if d.value is None:
        return d.reason or "no value"
    if d.direction == "same":
        return "equal to it"
    size, ends = size_and_interval(d, unit)
    word = "worse" if d.direction == "worse" else "not significant"
    return f"{size}{ends}, {word}{' among so many' if word != 'worse' and d.interval_side > 0 else ''}"


def size_and_interval(d: Difference, unit: str) -> tuple[str, str]:
    """Format a difference with sign, and its interval in brackets after a blank."""
    value = d.even if d.value is None else d.value
    if d.scale != "ratio":
        ends = "" if d.ci95 is None else f" ({number(d.ci95[0], unit, True)} to {number(d.ci95[1], unit, True)})"
        return quantity(value, unit, signed=True), ends
    size = change(value)
    return size, "" if d.ci95 is None or size == "not comparable" else f" ({between(*map(change_end, d.ci95))})"


def sweep_rows(s: Sweep) -> TableCells:
    """Return one row per setting, best in the first question first."""
    first = s.columns[0]
    axes = [a.name for a in s.grid.axes]
    head = [*axes, *(f"{c.question.title} [{c.question.unit}]" for c in s.columns), "beside the best"]
    rows = []
    for k in sorted(range(len(s.settings)), key=lambda k: (math.isnan(first.score[k]), first.score[k], k)):
        values = [value_text(s.settings[k].get(a, _base_name(s))) for a in axes]
        scores = [three_digits(float(c.score[k])) for c in s.columns]
        beside = "best" if k == first.single else difference_text(first.differences[k], first.question.unit)
        rows.append([*values, *scores, beside])
    return head, rows


def sweep_log_rows(s: Sweep, c: SweepColumn) -> TableCells:
    """Return each log's own best, and its value with the single best setting."""
    rows = []
    for j, name in enumerate(s.logs):
        best = c.own[j]
        if best is None or c.single is None:
            rows.append([clean(name), "none", "", "", c.left_out.get(j, "")])
            continue
        own, one = (three_digits(float(c.values[k, j])) for k in (best, c.single))
        near = "the same" if c.single == best else "not significant" if c.single in c.own_near[j] else ""
        rows.append([clean(name), setting_words(s.settings[best]), own, one, near])
    unit = f" [{c.question.unit}]"
    return ["log", "its own optimum", c.question.title + unit, "with the single best" + unit, ""], rows


def three_digits(value: float) -> str:
    """Format with three digits, in which neighbouring settings differ."""
    return "none" if math.isnan(value) else f"{value:.3g}"


def sweep_document(s: Sweep, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON of a sweep; ``about``: version, command, options, logs."""
    return {
        "schema": SWEEP_SCHEMA,
        **about,
        "filter": s.filter,
        "modes": s.modes,
        "axes": to_plain(s.grid.axes),
        "metrics": [_question_document(s, c) for c in s.columns],
        "settings": [
            {"number": k, "values": setting, "logs": [_result_document(cell, s.columns) for cell in s.cells[k]]}
            for k, setting in enumerate(s.settings)
        ],
    }


def _question_document(s: Sweep, c: SweepColumn) -> dict[str, Any]:
    q, own = c.question, zip(s.logs, c.own, c.own_near, strict=True)
    return {
        **question_document(q),
        "single_best": c.single,
        "not_significant": c.near,
        "score": to_plain(c.score),
        "beside_the_best": [difference_document(d) for d in c.differences],
        "own_optimum": [
            {"log": name, "setting": best, "not_significant": near, "left_out": c.left_out.get(j)}
            for j, (name, best, near) in enumerate(own)
        ],
    }


def question_document(q: Question) -> dict[str, Any]:
    """Return the JSON of a question in one window."""
    return {"name": q.name, "metric": q.metric, "window": q.window, "unit": q.unit, "better": q.better}


def difference_document(d: Difference) -> dict[str, Any]:
    """Return the JSON of a difference between two settings."""
    keys = ("scale", "value", "ci95", "direction", "reason")
    return {key: to_plain(getattr(d, key)) for key in keys}


def _result_document(cell: SettingResult, columns: Sequence[SweepColumn]) -> dict[str, Any]:
    answers = {}
    for q in (c.question for c in columns):
        a = cell.answers[q]
        if a.value is not None:
            answers[q.name] = to_plain({"value": a.value, "ci95": a.ci95, "n": a.n})
        else:
            answers[q.name] = {"value": None, "code": a.code, "reason": a.reason}
    return {"status": cell.status, "may_not_be_best": cell.unsound or None, "metrics": answers}


def sweep_csv(s: Sweep) -> str:
    """Return one CSV line for each setting, log and metric."""
    names = [a.name for a in s.grid.axes]
    head = ["setting", *names, "log", "metric", "window", "unit", "value", "low95", "high95", "n", "status"]
    lines: list[list[object]] = [list(head)]
    for setting, cells in zip(s.settings, s.cells, strict=True):
        own = [setting_text(setting) or DEFAULT_GAINS, *(setting.get(n, "") for n in names)]
        for log, cell in zip(s.logs, cells, strict=True):
            for q in (c.question for c in s.columns):
                a = cell.answers[q]
                value = "" if a.value is None else a.value
                answer = [value, *(a.ci95 or ("", "")), a.n, cell.unsound or cell.status]
                lines.append([*own, log, q.metric, q.window, q.unit, *answer])
    return files.csv_text(lines)


@dataclass(slots=True)
class PageSection:
    """Heading with figures, sentences, text to copy and a table.

    ``folded``: show only the heading initially. The first ``left`` columns of the table and the last hold words.
    """

    title: str
    code: str = ""
    figures: Sequence[PageFigure] = ()
    said: Sequence[str] = ()
    table: TableCells | None = None
    left: int = 1
    folded: bool = False


def render_sections(
    name: str, title: str, document: dict[str, Any], answer: Sequence[str], sections: Sequence[PageSection]
) -> str:
    """Return a self-contained page.

    ``name`` begins the file names of saved tables. ``document``: JSON of the page. ``answer``: sentences before all
    figures, the first as headline.
    """
    return shell.render(
        "settings.html",
        WEB_FOLDER,
        rows=[],
        figures=[figure for section in sections for figure in section.figures],
        document=json_text(to_plain(document)),
        scripts=("settings.js",),
        styles=("settings.css",),
        name=name,
        title=title,
        about=document,
        answer=answer,
        sections=sections,
    )


def titled(name: str, unit: str) -> str:
    """Append the unit to a name, behind a comma."""
    return f"{name}, {unit}" if unit else name


def sweep_page(s: Sweep, about: Mapping[str, Any]) -> str:
    """Return the page; ``about``: version, command and logs as in the JSON."""
    title = f"{s.filter}: {counted(len(s.grid), 'setting')} on {counted(len(s.logs), 'log')}"
    answer = [next(_question_sentences(s, column)) for column in s.columns]
    return render_sections("sweep", title, sweep_document(s, about), answer, list(_sweep_sections(s, about)))


def _sweep_sections(s: Sweep, about: Mapping[str, Any]) -> Iterator[PageSection]:
    remarks = list(agreement_sentence(count_references(about), s.filter, s.modes))
    for m, column in enumerate(s.columns):
        _, *rest = _question_sentences(s, column)  # the first is the page's answer
        under = [" ".join(rest)] if rest else []
        if m + 1 == len(s.columns):
            under += remarks
        yield PageSection(column.question.title, figures=list(_question_figures(s, m)), said=under)
    single = s.columns[0].single
    if single is not None:
        paste = f"attlog analyze LOG --estimators {with_gains(s.filter, s.settings[single])}"
        yield PageSection("Best setting, to paste", code=paste)
    yield PageSection("Every setting", table=sweep_rows(s), folded=True)
    if len(s.logs) > 1:
        for column in (c for c in s.columns if c.single is not None):
            rows = sweep_log_rows(s, column)
            yield PageSection(f"Each log: {column.question.title}", table=rows, left=2, folded=True)
    logs = [[str(log[k]) for k in ("name", "vehicle", "firmware", "reference")] for log in about["logs"]]
    yield PageSection("Logs", table=(["log", "vehicle", "firmware", "compared with"], logs), left=3, folded=True)


def with_gains(filter_name: str, setting: Setting) -> str:
    """Format a filter with gains for the command line."""
    return f"{filter_name}{',' if ':' in filter_name else ':'}{setting_text(setting)}"


def sweep_figures(s: Sweep) -> list[PageFigure]:
    """Return every figure, question by question."""
    return [figure for m in range(len(s.columns)) for figure in _question_figures(s, m)]


def _question_figures(s: Sweep, m: int) -> Iterator[PageFigure]:
    """Yield one curve per parameter and a heat map of the first two."""
    free = [a for a in s.grid.axes if len(a.values) > 1]
    column = s.columns[m]
    if column.single is None:
        return
    for k, axis in enumerate(free):
        yield _axis_figure(s, column, axis, f"along{m}_{k}", alone=len(free) == 1)
    if len(free) > 1:
        yield _heat_map_figure(s, column, free, f"cells{m}")


def _heat_map_figure(s: Sweep, c: SweepColumn, free: list[GridAxis], name: str) -> PageFigure:
    """Draw the first two parameters as cells, each the best over all others."""
    down, across = free[:2]
    lowest, near = float(np.nanmin(c.score[: s.base])), set(c.near)
    cells: list[dict[str, Any]] = []
    for i, x in enumerate(across.values):
        for j, y in enumerate(down.values):
            k = _best_setting(s, c, {across.name: x, down.name: y})
            cell: dict[str, Any] = {
                "i": i,
                "j": j,
                "share": None,
                "text": "",
                "say": "no value",
                "near": False,
                "best": False,
            }
            if k is not None:
                value = float(c.score[k])
                far = math.log(max(value, 1e-300) / max(lowest, 1e-300)) / math.log(DARKEST_RATIO) if value > 0 else 0.0
                cell |= {"share": min(far, 1.0), "text": number(value, c.question.unit, False)}
                cell |= {"say": _setting_value(s, c, k), "near": k in near, "best": k == c.single}
            cells.append(cell)
    data = {
        "cells": cells,
        "across": [_value_label(v) for v in across.values],
        "down": [_value_label(v) for v in down.values],
        "x": titled(across.name, unit_sign(across.unit)),
        "y": titled(down.name, unit_sign(down.unit)),
        "table": _figure_table(s, c),
    }
    mean = "Mean of the logs. " if len(s.logs) > 1 else ""
    caption = f"{mean}Dark: three times as far from perfect, or more. Framed: the best. Dot: not significantly worse."
    title = f"{c.question.title} over {down.name} and {across.name}{_at_best(', '.join(a.name for a in free[2:]))}"
    return PageFigure(name, "cells", title, caption, 96 + 34 * len(down.values), data, True, _figure_words(s, c))


def _axis_figure(s: Sweep, c: SweepColumn, axis: GridAxis, name: str, *, alone: bool) -> PageFigure:
    """Draw values along one parameter, others at their best: mean and each log."""
    best = [_best_setting(s, c, {axis.name: v}) for v in axis.values]
    mean = [math.nan if k is None else float(c.score[k]) for k in best]
    drawn = c.used if len(s.logs) > 1 else []
    each = [[math.nan if k is None else abs(float(c.values[k, j])) for k in best] for j in drawn]
    near = set(c.near)
    places, spacing = axis_places(axis)
    data: dict[str, Any] = {
        "x": places,
        "log": spacing == "log",
        "ticks": [_value_label(v) for v in axis.values],
        "axis": titled(axis.name, unit_sign(axis.unit)),
        "title": titled(c.question.title, unit_sign(c.question.unit)),
        "y": json_numbers(mean),
        "logs": [{"name": s.logs[j], "y": json_numbers(y)} for j, y in zip(drawn, each, strict=True)],
        "near": [k in near for k in best],
        "best": best.index(c.single) if c.single in best else None,
        "say": ["" if k is None else _setting_value(s, c, k) for k in best],
        "table": _figure_table(s, c),
    }
    title = f"{c.question.title} along {axis.name}{'' if alone else _at_best('all others')}"
    caption = f"Red: best. Band and filled: not significantly worse.{' Thin lines: each log.' if each else ''}"
    caption = f"{caption} {missing_values(s, c, axis)}".rstrip()
    return PageFigure(name, "along", title, caption, 300, data, alone, _figure_words(s, c))


def missing_values(s: Sweep, c: SweepColumn, axis: GridAxis) -> str:
    """Return sentences on values of a parameter without a result on a log: ``kp above 0.17 diverged on NAME.``."""
    logs_by_words: dict[str, list[str]] = {}
    for j, log in enumerate(s.logs):
        lost: dict[float | str, list[SettingResult]] = {}
        for value in axis.values:
            cells = [s.cells[k][j] for k in range(s.base) if s.settings[k][axis.name] == value]
            if not any(cell.counts(c.question) for cell in cells):
                lost[value] = cells
        if not 0 < len(lost) < len(axis.values):  # all lost: the log is left out and named elsewhere
            continue
        cells = [cell for some in lost.values() for cell in some]
        diverged = any(cell.status == "diverged" for cell in cells)
        what = " diverged" if diverged else f": {commonest_reason(cell.reason(c.question) for cell in cells)}"
        logs_by_words.setdefault(f"{axis.name} {_range_words(axis, list(lost))}{what}", []).append(log)
    return " ".join(f"{typeset(words)} on {clean(named_logs(logs))}." for words, logs in logs_by_words.items())


def _range_words(axis: GridAxis, values: Sequence[float | str]) -> str:
    """Return values of a parameter: ``above 0.17``, ``below 0.1``, else their list."""
    kept = [v for v in axis.values if v not in values]
    if all(isinstance(v, float) for v in axis.values):
        sizes, others = [float(v) for v in values], [float(v) for v in kept]
        if min(sizes) > max(others):
            return f"above {max(others):g}"
        if max(sizes) < min(others):
            return f"below {min(others):g}"
    return listed([value_text(v) for v in values])


def _at_best(others: str) -> str:
    return f", {others} each at its best" if others else ""


def _setting_value(s: Sweep, c: SweepColumn, k: int) -> str:
    """Return the hover text of a setting."""
    value = quantity(float(c.score[k]), c.question.unit, False) or "no value"
    return f"{setting_words(s.settings[k])}: {value}, {difference_text(c.differences[k], c.question.unit)}"


def _figure_words(s: Sweep, c: SweepColumn) -> str:
    """Describe a figure in words: the best, and settings not significantly different."""
    first = [] if c.single is None else [c.single]
    return "; ".join(_setting_value(s, c, k) for k in (*first, *(k for k in c.near if k != c.single)))


def _figure_table(s: Sweep, c: SweepColumn) -> list[list[Any]]:
    """Return the figure's data for saving: every setting of the grid."""
    names, near = [a.name for a in s.grid.axes], set(c.near)
    rows: list[list[Any]] = [
        [*names, f"{c.question.metric} [{c.question.unit}]", "differs significantly from the best"]
    ]
    for k in range(s.base):
        value = float(c.score[k])
        differs = "" if not math.isfinite(value) else "no" if k in near else "yes"
        rows.append([*(s.settings[k][n] for n in names), *json_numbers([value]), differs])
    return rows


def _best_setting(s: Sweep, c: SweepColumn, values: Setting) -> int | None:
    """Return the setting with these values and the smallest score, or None."""
    numbers = [k for k in range(s.base) if all(s.settings[k][name] == v for name, v in values.items())]
    known = [k for k in numbers if math.isfinite(c.score[k])]
    return min(known, key=lambda k: (float(c.score[k]), k)) if known else None


def axis_places(axis: GridAxis) -> tuple[list[float], str]:
    """Return axis positions and scale: ``log``, ``linear``, or ``side by side``."""
    values = [v for v in axis.values if isinstance(v, float)]
    in_order = [float(i) for i in range(len(axis.values))]
    if len(values) < len(axis.values):
        return in_order, "side by side"
    ordered = sorted(values)
    steps = [b - a for a, b in pairwise(ordered)]
    if axis.spacing == "log" or (ordered[0] > 0 and ordered[-1] / ordered[0] >= MIN_LOG_RATIO):
        return values, "log"
    if max(steps) > MAX_STEP_RATIO * min(steps):
        return in_order, "side by side"
    return values, "linear"


def _value_label(value: float | str) -> str:
    return f"{value:.3g}" if isinstance(value, float) else value
