"""A sweep in words: what is best, how sure that is, what one setting for all logs costs; and as table, JSON, CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from attlog.compare.grid import Setting, setting_text
from attlog.compare.search import SettingDifference, SettingResult, Sweep, SweepColumn, SweptMetric
from attlog.compare.tune import HeldOutScore, Tuning
from attlog.core import files, plain
from attlog.words.numbers import between, change, change_end, counted, listed, number, quantity
from attlog.words.text import clean

SWEEP_SCHEMA = "attlog-sweep/2"
DEFAULT_GAINS = "default gains"
MAX_NAMED_LOGS = 3
"""So many logs that do not count are named in a sentence; the table names all."""


def setting_words(setting: Setting) -> str:
    """A setting for people: ``kp 0.6, ki 0.01``; the filter without the grid is ``default gains``."""
    return ", ".join(f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}" for k, v in setting.items()) or DEFAULT_GAINS


def sweep_sentences(s: Sweep, references: Mapping[str, int] | None = None) -> Iterator[str]:
    """What was found for each metric, and what agreement with the ``references`` (how many logs have which) proves."""
    for column in s.columns:
        yield " ".join(_metric_sentences(s, column))
    yield from agreement_sentence(references or {})


def agreement_sentence(references: Mapping[str, int]) -> Iterator[str]:
    """What has to be said where logs hold no truth."""
    if references.get("onboard"):
        yield (
            f"{counted(references['onboard'], 'log')} of {sum(references.values())} can only be compared with the "
            "onboard attitude: what agrees with it, not with the truth."
        )


def count_references(about: Mapping[str, Any]) -> dict[str, int]:
    """How many logs have which reference, of what a JSON says of the logs."""
    kinds = [str(log["reference"]) for log in about["logs"]]
    return {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}


def _metric_sentences(s: Sweep, c: SweepColumn) -> Iterator[str]:
    title, unit, logs = c.metric.title, c.metric.unit, len(c.used)
    if c.single is None:
        left = next(iter(c.left_out.values()), "no setting has a value on every log")
        yield f"{title}: no setting of the grid can be judged ({left})."
        return
    value, where = (
        quantity(float(c.score[c.single]), unit, signed=False),
        "" if len(s.logs) == 1 else f" on average of {counted(logs, 'log')}",
    )
    yield f"{title}: best {'single setting' if logs > 1 else 'setting'} {setting_words(s.settings[c.single])}, {value}{where}."
    if logs > 1:
        own = [abs(float(c.values[k, j])) for j, k in enumerate(c.own) if k is not None]
        yield f"With its own optimum for each log it would be {quantity(sum(own) / len(own), unit, signed=False)}."
    near = [k for k in c.near if k != c.single]
    if near:
        many = f"{counted(len(near), 'other setting')} of {len(s.settings) - 1}"
        yield f"{many} do not differ significantly: {value_ranges(s, [*near, c.single])}."
    else:
        yield "All others are significantly worse, or have no value on some log."
    beside = c.beside[s.base]
    if beside.value is not None:
        yield f"Default gains: {difference_text(beside, unit)}."
    edges = axes_at_edge(s, c.single)
    if {*c.near, c.single, s.base} >= set(range(len(s.settings))):
        edges = []  # which end is best is chance
    if edges:
        yield f"The optimum lies at the end of the range of {listed(edges)}: a wider one may hold a better setting."
    if c.left_out:
        some = [s.logs[j] for j in c.left_out]
        names = listed(
            some
            if len(some) <= MAX_NAMED_LOGS
            else [*some[: MAX_NAMED_LOGS - 1], f"{len(some) - MAX_NAMED_LOGS + 1} more"]
        )
        yield f"Not counted: {clean(names)} ({next(iter(c.left_out.values()))})."


def value_ranges(s: Sweep, numbers: list[int]) -> str:
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


def axes_at_edge(s: Sweep, best: int) -> list[str]:
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


def sweep_order(s: Sweep) -> list[int]:
    """Settings from best to worst in the first metric, those without a value last, the base among them."""
    score = s.columns[0].score
    return sorted(range(len(s.settings)), key=lambda k: (math.isnan(score[k]), score[k], k))


def sweep_rows(s: Sweep) -> tuple[list[str], list[list[str]]]:
    """Heading and rows of the table: a row for each setting, the best first."""
    first = s.columns[0]
    head = [
        *(a.name for a in s.grid.axes),
        *(f"{c.metric.title} [{c.metric.unit}]" for c in s.columns),
        "beside the best",
    ]
    found = []
    for k in sweep_order(s):
        setting = s.settings[k]
        values = [value_text(setting.get(a.name, DEFAULT_GAINS)) for a in s.grid.axes]
        scores = [three_digits(float(c.score[k])) for c in s.columns]
        beside = "best" if k == first.single else difference_text(first.beside[k], first.metric.unit)
        found.append([*values, *scores, beside])
    return head, found


def sweep_log_rows(s: Sweep, c: SweepColumn) -> tuple[list[str], list[list[str]]]:
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
        found.append([clean(name), setting_words(s.settings[best]), three_digits(own), three_digits(one), near])
    unit = f" [{c.metric.unit}]"
    return ["log", "its own optimum", c.metric.title + unit, "with the single best" + unit, ""], found


def three_digits(value: float) -> str:
    """A value to three digits: settings that lie close together differ in them."""
    return "none" if math.isnan(value) else f"{value:.3g}"


def value_text(value: float | str) -> str:
    """A parameter's value."""
    return f"{value:g}" if isinstance(value, float) else value


def sweep_document(s: Sweep, about: dict[str, Any]) -> dict[str, Any]:
    """The JSON of a sweep; ``about``: version, command, options, logs."""
    return {
        "schema": SWEEP_SCHEMA,
        **about,
        "filter": s.filter,
        "axes": [plain.to_plain(axis) for axis in s.grid.axes],
        "metrics": [_metric_document(s, c) for c in s.columns],
        "settings": [
            {"number": k, "values": setting, "logs": [_result_document(cell, s.columns) for cell in s.cells[k]]}
            for k, setting in enumerate(s.settings)
        ],
    }


def _metric_document(s: Sweep, c: SweepColumn) -> dict[str, Any]:
    return {
        "name": c.metric.name,
        "metric": c.metric.metric,
        "window": c.metric.window,
        "unit": c.metric.unit,
        "better": c.metric.better,
        "single_best": c.single,
        "not_significant": c.near,
        "score": plain.to_plain(c.score),
        "beside_the_best": plain.to_plain(c.beside),
        "own_optimum": [
            {"log": name, "setting": best, "not_significant": near, "left_out": c.left_out.get(j)}
            for j, (name, best, near) in enumerate(zip(s.logs, c.own, c.own_near, strict=True))
        ],
    }


def _result_document(cell: SettingResult, columns: list[SweepColumn]) -> dict[str, Any]:
    answers = {}
    for metric in (c.metric for c in columns):
        a = cell.answers[metric]
        kept = (
            {"value": a.value, "ci95": a.ci95, "n": a.n}
            if a.value is not None
            else {"value": None, "code": a.code, "reason": a.reason}
        )
        answers[metric.name] = plain.to_plain(kept)
    return {"status": cell.status, "may_not_be_best": cell.unsound or None, "metrics": answers}


def sweep_csv(s: Sweep) -> str:
    """One line for each setting, log and metric."""
    names = [a.name for a in s.grid.axes]
    lines: list[list[object]] = [
        ["setting", *names, "log", "metric", "window", "unit", "value", "low95", "high95", "n", "status"]
    ]
    for k, setting in enumerate(s.settings):
        for log, cell in zip(s.logs, s.cells[k], strict=True):
            for metric in (c.metric for c in s.columns):
                lines.append(
                    [
                        setting_text(setting) or DEFAULT_GAINS,
                        *(setting.get(n, "") for n in names),
                        log,
                        *_csv_cells(metric, cell),
                    ]
                )
    return files.csv_text(lines)


def _csv_cells(metric: SweptMetric, cell: SettingResult) -> list[object]:
    a = cell.answers[metric]
    low, high = a.ci95 or ("", "")
    value = "" if a.value is None else a.value
    return [metric.metric, metric.window, metric.unit, value, low, high, a.n, cell.unsound or cell.status]


# Tuned gains in words: what they are, what they gained on what was left out, what they cost elsewhere.

TUNE_SCHEMA = "attlog-tune/1"


def tune_sentences(t: Tuning, references: Mapping[str, int]) -> Iterator[str]:
    """Whether to take the gains, what they are, gain and cost; ``references``: how many logs have which."""
    what = ", ".join(f"{term.name} {term.weight:g}" for term in t.terms)
    yield _recommendation(t)
    yield f"{t.filter}: {setting_words(t.found.setting)} (was {setting_words(t.start)}), found for {what} on {_evidence_words(t)}."
    yield f"On what was left out: {'; '.join(held_out_text(j) for j in t.judged if j.weight > 0)}."
    others = [j for j in t.judged if j.weight == 0 and significant_side(j.beside)]
    if others:
        yield f"Elsewhere, left out too: {'; '.join(held_out_text(j) for j in others)}."
    edges = gains_at_edge(t)
    if edges:
        lie = "lies" if len(edges) == 1 else "lie"
        yield f"{listed(edges)} {lie} at the end of the range: a wider one may hold better gains."
    gone: dict[tuple[str, str], list[str]] = {}
    for j in t.judged:
        for k, why in j.missing.items() if j.weight > 0 else ():
            gone.setdefault((t.parts[k].name, why), []).append(j.metric.title)
    for (name, why), titles in gone.items():
        yield f"Not counted: {listed(titles)} of {clean(name)} ({why})."
    yield from agreement_sentence(references)


def _evidence_words(t: Tuning) -> str:
    return counted(len(t.logs), "log") if len(t.logs) > 1 else f"{len(t.parts)} blocks of time of one log"


def held_out_text(j: HeldOutScore) -> str:
    """One metric: ``Tilt error RMS 36 % closer to perfect (16 to 51 %), better on 5 of 5``."""
    b, on = j.beside, f"better on {j.better} of {j.better + j.worse}"
    if b.value is None:
        return f"{j.metric.title} not known ({b.why})"
    if b.ci95 is not None and b.ci95 == (b.value, b.value):
        return f"{j.metric.title} the same"
    change, ends = _change_and_interval(b, j.metric.unit)
    words = {-1: "closer to perfect", 1: "further from perfect", 0: "not significant"}[significant_side(b)]
    return f"{j.metric.title} {change} {words}{ends}, {on}"


def significant_side(b: SettingDifference) -> int:
    """-1 where the tuned filter is significantly better, 1 worse, 0 neither."""
    if b.value is None or b.ci95 is None:
        return 0
    middle = 1.0 if b.scale == "ratio" else 0.0
    return -1 if b.ci95[1] < middle else 1 if b.ci95[0] > middle else 0


def _change_and_interval(b: SettingDifference, unit: str, signed: bool = False) -> tuple[str, str]:
    """How much, and the interval in brackets; without signs where words say on which side, unless ``signed``."""
    assert b.value is not None
    if b.scale != "ratio" or b.ci95 is None or signed or significant_side(b) == 0:
        return size_and_ends(b, unit)
    ends = [change_end(x, signed=False) for x in sorted(b.ci95, key=lambda x: abs(x - 1.0))]
    return change(b.value, signed=False), f" ({between(*ends)})"


def _change_words(percent: float) -> str:
    """``falls by 6 %``, ``rises by 29 %``."""
    return f"{'rises' if percent < 0 else 'falls'} by {abs(percent):.0f} %"


def _recommendation(t: Tuning) -> str:
    """Whether to take the gains: by what was left out, beside what was fitted."""
    weighed = [j for j in t.judged if j.weight > 0]
    fitted, left = (100.0 * (1.0 - math.exp(x)) for x in (t.found.cost, mean_left_out(t)))
    sizes = (
        f"the objective {_change_words(left)} on what was left out, {_change_words(fitted)} where the gains were found"
    )
    if any(significant_side(j.beside) < 0 for j in weighed) and not any(
        significant_side(j.beside) > 0 for j in weighed
    ):
        return f"Worth taking: {sizes}."
    if any(significant_side(j.beside) > 0 for j in weighed):
        return f"To be weighed: one metric is significantly worse on what was left out. {sizes[0].upper()}{sizes[1:]}."
    return f"No significant gain: keep what you have until more logs show one. {sizes[0].upper()}{sizes[1:]}."


def mean_left_out(t: Tuning) -> float:
    """The cost on what was left out, part by part."""
    sizes = [len(fold.left_out) for fold in t.folds]
    return sum(n * fold.cost_left_out for n, fold in zip(sizes, t.folds, strict=True)) / sum(sizes)


def gains_at_edge(t: Tuning) -> list[str]:
    """Gains at the end of their range."""
    found = []
    for f in t.free:
        share = f.share(float(t.found.setting[f.name]))
        if share < 0.02 or share > 0.98:
            found.append(f.name)
    return found


def paste_lines(t: Tuning, firmware: Mapping[str, str]) -> list[str]:
    """Lines ready to paste: the filter as attlog takes it, and the autopilot's parameters where the filter has them."""
    own = f"{t.filter}{',' if ':' in t.filter else ':'}{setting_text(t.found.setting)}"
    return [
        own,
        *(f"{firmware[k]},{v:g}" for k, v in t.found.setting.items() if k in firmware and isinstance(v, float)),
    ]


def gain_rows(t: Tuning) -> tuple[list[str], list[list[str]]]:
    """Gains of every fold: how much they depend on which logs they were found on."""
    head = [
        "left out",
        *(f.name + (f" [{f.unit}]" if f.unit else "") for f in t.free),
        "objective found",
        "objective left out",
    ]
    rows = [["nothing: the gains found", *_gain_cells(t, t.found.setting), _cost_percent(t.found.cost), ""]]
    for fold in t.folds:
        names = clean(listed([p.name for p in fold.left_out]))
        rows.append(
            [
                names,
                *_gain_cells(t, fold.found.setting),
                _cost_percent(fold.found.cost),
                _cost_percent(fold.cost_left_out),
            ]
        )
    return head, rows


def part_rows(t: Tuning) -> tuple[list[str], list[list[str]]]:
    """Values of every part before and after, with gains that were not found on it."""
    shown = [j for j in t.judged if j.beside.value is not None]
    head = ["left out", *(f"{j.metric.title} [{j.metric.unit}] {when}" for j in shown for when in ("default", "tuned"))]
    rows = []
    for k, part in enumerate(t.parts):
        values = [v for j in shown for v in (j.before[k], j.after[k])]
        rows.append([clean(part.name), *(("none" if math.isnan(v) else f"{v:.3g}") for v in values)])
    return head, rows


def held_out_rows(t: Tuning) -> tuple[list[str], list[list[str]]]:
    """Every metric on what was left out."""
    rows = []
    for j in t.judged:
        b = j.beside
        change, ends = ("none", "") if b.value is None else _change_and_interval(b, j.metric.unit, signed=True)
        words = {-1: "better", 1: "worse", 0: "not significant"}[significant_side(b)] if b.value is not None else b.why
        weight = f"{j.weight:g}" if j.weight else "elsewhere"
        rows.append([j.metric.title, weight, change + ends, f"{j.better} of {j.better + j.worse}", words])
    return ["metric", "weight", "tuned beside default (95 %)", "better on", ""], rows


def tune_document(t: Tuning, about: dict[str, Any], firmware: Mapping[str, str]) -> dict[str, Any]:
    """The JSON of a tuning."""
    return {
        "schema": TUNE_SCHEMA,
        **about,
        "filter": t.filter,
        "seed": t.seed,
        "searched": [plain.to_plain(f) for f in t.free],
        "objective": [
            {"name": x.name, "metric": x.metric.metric, "window": x.metric.window, "weight": x.weight} for x in t.terms
        ],
        "as_it_is": t.start,
        "gains": t.found.setting,
        "cost": t.found.cost,
        "cost_left_out": mean_left_out(t),
        "paste": paste_lines(t, firmware),
        "firmware": {firmware[k]: v for k, v in t.found.setting.items() if k in firmware},
        "folds": [
            {
                "left_out": [p.name for p in f.left_out],
                "gains": f.found.setting,
                "cost": f.found.cost,
                "cost_left_out": f.cost_left_out,
                "settings_tried": len(f.found.tried),
            }
            for f in t.folds
        ],
        "judged_on_left_out": [
            {
                "metric": j.metric.metric,
                "window": j.metric.window,
                "unit": j.metric.unit,
                "weight": j.weight,
                "beside": plain.to_plain(j.beside),
                "better_on": j.better,
                "worse_on": j.worse,
                "parts": [
                    {"name": p.name, "as_it_is": none_if_nan(a), "tuned": none_if_nan(b), "why": j.missing.get(k)}
                    for k, (p, a, b) in enumerate(zip(t.parts, j.before, j.after, strict=True))
                ],
            }
            for j in t.judged
        ],
        "tried": [{"gains": s, "cost": c} for s, c in t.found.tried],
    }


def none_if_nan(value: float) -> float | None:
    """A number, None for NaN."""
    return None if math.isnan(value) else float(value)


def _gain_cells(t: Tuning, setting: Mapping[str, float | str]) -> list[str]:
    return [f"{setting[f.name]:g}" for f in t.free]


def _cost_percent(cost: float) -> str:
    return change(math.exp(cost))
