"""A sweep in words: what is best, how sure that is, what one setting for all logs costs; and as table, JSON, CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from attlog.base import plain
from attlog.base.files import spreadsheet
from attlog.compare.sweep.grid import Setting, text_of
from attlog.compare.sweep.many import SettingResult, SweptMetric
from attlog.compare.sweep.sweep import SettingDifference, Sweep, SweepColumn
from attlog.present.numbers import between, change, change_end, counted, listed, number, quantity
from attlog.present.text import clean

SCHEMA = "attlog-sweep/2"
DEFAULT = "default gains"
NAMED = 3
"""So many logs that do not count are named in a sentence; the table names all."""


def named(setting: Setting) -> str:
    """A setting for people: ``kp 0.6, ki 0.01``; the filter without the grid is ``default gains``."""
    return ", ".join(f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}" for k, v in setting.items()) or DEFAULT


def sentences(s: Sweep, references: Mapping[str, int] | None = None) -> Iterator[str]:
    """What was found for each metric, and what agreement with the ``references`` (how many logs have which) proves."""
    for column in s.columns:
        yield " ".join(_of(s, column))
    yield from only_agreement(references or {})


def only_agreement(references: Mapping[str, int]) -> Iterator[str]:
    """What has to be said where logs hold no truth."""
    if references.get("onboard"):
        yield (
            f"{counted(references['onboard'], 'log')} of {sum(references.values())} can only be compared with the "
            "onboard attitude: what agrees with it, not with the truth."
        )


def references_of(about: Mapping[str, Any]) -> dict[str, int]:
    """How many logs have which reference, of what a JSON says of the logs."""
    kinds = [str(log["reference"]) for log in about["logs"]]
    return {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}


def _of(s: Sweep, c: SweepColumn) -> Iterator[str]:
    title, unit, logs = c.metric.title, c.metric.unit, len(c.used)
    if c.single is None:
        left = next(iter(c.left_out.values()), "no setting has a value on every log")
        yield f"{title}: no setting of the grid can be judged ({left})."
        return
    value, where = (
        quantity(float(c.score[c.single]), unit, signed=False),
        "" if len(s.logs) == 1 else f" on average of {counted(logs, 'log')}",
    )
    yield f"{title}: best {'single setting' if logs > 1 else 'setting'} {named(s.settings[c.single])}, {value}{where}."
    if logs > 1:
        own = [abs(float(c.values[k, j])) for j, k in enumerate(c.own) if k is not None]
        yield f"With its own optimum for each log it would be {quantity(sum(own) / len(own), unit, signed=False)}."
    near = [k for k in c.near if k != c.single]
    if near:
        many = f"{counted(len(near), 'other setting')} of {len(s.settings) - 1}"
        yield f"{many} do not differ significantly: {ranges(s, [*near, c.single])}."
    else:
        yield "All others are significantly worse, or have no value on some log."
    beside = c.beside[s.base]
    if beside.value is not None:
        yield f"Default gains: {difference_text(beside, unit)}."
    edges = at_edge(s, c.single)
    if {*c.near, c.single, s.base} >= set(range(len(s.settings))):
        edges = []  # which end is best is chance
    if edges:
        yield f"The optimum lies at the end of the range of {listed(edges)}: a wider one may hold a better setting."
    if c.left_out:
        some = [s.logs[j] for j in c.left_out]
        names = listed(some if len(some) <= NAMED else [*some[: NAMED - 1], f"{len(some) - NAMED + 1} more"])
        yield f"Not counted: {clean(names)} ({next(iter(c.left_out.values()))})."


def ranges(s: Sweep, numbers: list[int]) -> str:
    """Between which values settings lie, parameter by parameter: ``kp 0.3 to 1.1, mag_form heading or vector``."""
    parts = []
    for axis in s.grid.axes:
        values = [v for v in axis.values if any(s.settings[k].get(axis.name) == v for k in numbers)]
        sizes = [v for v in values if isinstance(v, float)]
        if sizes:
            parts.append(f"{axis.name} {min(sizes):g}" + (f" to {max(sizes):g}" if max(sizes) > min(sizes) else ""))
        else:
            parts.append(f"{axis.name} {' or '.join(map(str, values))}")
    return ", ".join(parts)


def at_edge(s: Sweep, best: int) -> list[str]:
    """The parameters whose best value is the first or last of three or more."""
    found = []
    for axis in s.grid.axes:
        sizes = [v for v in axis.values if isinstance(v, float)]
        if len(sizes) > 2 and s.settings[best][axis.name] in (min(sizes), max(sizes)):
            found.append(axis.name)
    return found


def difference_text(b: SettingDifference, unit: str) -> str:
    """A setting beside the best: ``27 % worse (15 to 41 %)``, ``not significant``, or why they are not compared."""
    if b.value is None:
        return b.why or "no value"
    size, ends = size_and_ends(b, unit)
    if b.ci95 == (b.value, b.value):
        return "equal to it"
    alone = b.ci95 is not None and b.ci95[0] > (1.0 if b.scale == "ratio" else 0.0)
    return f"{size}{ends}, {'worse' if b.worse else 'not significant among so many' if alone else 'not significant'}"


def size_and_ends(b: SettingDifference, unit: str) -> tuple[str, str]:
    """How much one is beside another, with its sign, and the interval in brackets behind a blank."""
    assert b.value is not None
    if b.scale != "ratio":
        ends = "" if b.ci95 is None else f" ({number(b.ci95[0], unit, True)} to {number(b.ci95[1], unit, True)})"
        return quantity(b.value, unit, signed=True), ends
    size = change(b.value)
    return size, "" if b.ci95 is None or size == "not comparable" else f" ({between(*map(change_end, b.ci95))})"


def order(s: Sweep) -> list[int]:
    """Settings from best to worst in the first metric, those without a value last, the base among them."""
    score = s.columns[0].score
    return sorted(range(len(s.settings)), key=lambda k: (math.isnan(score[k]), score[k], k))


def rows(s: Sweep) -> tuple[list[str], list[list[str]]]:
    """Heading and rows of the table: a row for each setting, the best first."""
    first = s.columns[0]
    head = [
        *(a.name for a in s.grid.axes),
        *(f"{c.metric.title} [{c.metric.unit}]" for c in s.columns),
        "beside the best",
    ]
    found = []
    for k in order(s):
        setting = s.settings[k]
        values = [value_text(setting.get(a.name, DEFAULT)) for a in s.grid.axes]
        scores = [digits(float(c.score[k])) for c in s.columns]
        beside = "best" if k == first.single else difference_text(first.beside[k], first.metric.unit)
        found.append([*values, *scores, beside])
    return head, found


def log_rows(s: Sweep, c: SweepColumn) -> tuple[list[str], list[list[str]]]:
    """Heading and rows of the second table: each log's own optimum, and what the single best costs there."""
    found = []
    for j, name in enumerate(s.logs):
        best = c.own[j]
        if best is None or c.single is None:
            found.append([clean(name), "none", "", "", c.left_out.get(j, "")])
            continue
        own, one = (float(c.values[k, j]) for k in (best, c.single))
        near = (
            "not significant"
            if c.single in c.own_near[j] and c.single != best
            else ""
            if c.single != best
            else "the same"
        )
        found.append([clean(name), named(s.settings[best]), digits(own), digits(one), near])
    unit = f" [{c.metric.unit}]"
    return ["log", "its own optimum", c.metric.title + unit, "with the single best" + unit, ""], found


def digits(value: float) -> str:
    """A value to three digits: settings that lie close together differ in them."""
    return "none" if math.isnan(value) else f"{value:.3g}"


def value_text(value: float | str) -> str:
    """A parameter's value."""
    return f"{value:g}" if isinstance(value, float) else value


def document(s: Sweep, about: dict[str, Any]) -> dict[str, Any]:
    """The JSON of a sweep; ``about``: version, command, options, logs."""
    return {
        "schema": SCHEMA,
        **about,
        "filter": s.filter,
        "axes": [plain.plain(axis) for axis in s.grid.axes],
        "metrics": [_metric(s, c) for c in s.columns],
        "settings": [
            {"number": k, "values": setting, "logs": [_cell(cell, s.columns) for cell in s.cells[k]]}
            for k, setting in enumerate(s.settings)
        ],
    }


def _metric(s: Sweep, c: SweepColumn) -> dict[str, Any]:
    return {
        "name": c.metric.name,
        "metric": c.metric.metric,
        "window": c.metric.window,
        "unit": c.metric.unit,
        "better": c.metric.better,
        "single_best": c.single,
        "not_significant": c.near,
        "score": plain.plain(c.score),
        "beside_the_best": plain.plain(c.beside),
        "own_optimum": [
            {"log": name, "setting": best, "not_significant": near, "left_out": c.left_out.get(j)}
            for j, (name, best, near) in enumerate(zip(s.logs, c.own, c.own_near, strict=True))
        ],
    }


def _cell(cell: SettingResult, columns: list[SweepColumn]) -> dict[str, Any]:
    answers = {}
    for metric in (c.metric for c in columns):
        a = cell.answers[metric]
        kept = (
            {"value": a.value, "ci95": a.ci95, "n": a.n}
            if a.value is not None
            else {"value": None, "code": a.code, "reason": a.reason}
        )
        answers[metric.name] = plain.plain(kept)
    return {"status": cell.status, "may_not_be_best": cell.unsound or None, "metrics": answers}


def csv_text(s: Sweep) -> str:
    """One line for each setting, log and metric."""
    names = [a.name for a in s.grid.axes]
    lines: list[list[object]] = [
        ["setting", *names, "log", "metric", "window", "unit", "value", "low95", "high95", "n", "status"]
    ]
    for k, setting in enumerate(s.settings):
        for log, cell in zip(s.logs, s.cells[k], strict=True):
            for metric in (c.metric for c in s.columns):
                lines.append(
                    [text_of(setting) or DEFAULT, *(setting.get(n, "") for n in names), log, *_written(metric, cell)]
                )
    return spreadsheet.csv_text(lines)


def _written(metric: SweptMetric, cell: SettingResult) -> list[object]:
    a = cell.answers[metric]
    low, high = a.ci95 or ("", "")
    value = "" if a.value is None else a.value
    return [metric.metric, metric.window, metric.unit, value, low, high, a.n, cell.unsound or cell.status]
