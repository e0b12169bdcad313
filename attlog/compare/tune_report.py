"""Report tuned gains as text, tables, JSON and page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from attlog.compare.grid import FreeParameter
from attlog.compare.paired import Difference
from attlog.compare.sweep_report import (
    PageSection,
    agreement_sentence,
    count_references,
    difference_document,
    question_document,
    render_sections,
    setting_words,
    size_and_interval,
    three_digits,
    titled,
    with_gains,
)
from attlog.compare.tables import TableCells
from attlog.compare.tune import HeldOutScore, Tuning
from attlog.core.plain import to_plain
from attlog.report.figures.figure import PageFigure, json_numbers
from attlog.words.numbers import between, change, change_end, counted, listed, unit_sign
from attlog.words.text import clean

TUNE_SCHEMA = "attlog-tune/2"
# Costs more than this multiple of the better half's spread above the median are drawn at the upper edge.
MAX_SPREAD_SHOWN = 1.5
# A gain within this share of its range from an end counts as at the end.
EDGE_SHARE = 0.02


def tune_sentences(t: Tuning, references: Mapping[str, int]) -> Iterator[str]:
    """Yield recommendation, gains, their benefit and cost elsewhere.

    ``references``: number of logs by kind of reference.
    """
    what = ", ".join(f"{term.name} {term.weight:g}" for term in t.terms)
    where = counted(len(t.logs), "log") if len(t.logs) > 1 else f"{len(t.parts)} blocks of time of one log"
    yield _recommendation(t)
    yield (f"{t.filter}: {setting_words(t.found.setting)} (was {setting_words(t.start)}), found for {what} on {where}.")
    yield f"On what was left out: {'; '.join(map(held_out_text, t.weighed))}."
    others = [score for score in t.scores if score.weight == 0 and score.difference.interval_side]
    if others:
        yield f"Elsewhere, left out too: {'; '.join(map(held_out_text, others))}."
    edges = gains_at_edge(t)
    if edges:
        lie = "lies" if len(edges) == 1 else "lie"
        yield f"{listed(edges)} {lie} at the end of the range: a wider one may hold better gains."
    lost: dict[tuple[str, str], list[str]] = {}
    for score in t.weighed:
        for k, why in score.missing.items():
            lost.setdefault((t.parts[k].name, why), []).append(score.question.title)
    for (name, why), titles in lost.items():
        yield f"Not counted: {listed(titles)} of {clean(name)} ({why})."
    yield from agreement_sentence(references, t.filter, t.modes)


def _recommendation(t: Tuning) -> str:
    """Recommend the gains or not, by their effect on left-out and fitted parts."""
    fitted, left = (100.0 * (1.0 - math.exp(x)) for x in (t.found.cost, t.cost_left_out))
    sizes = (
        f"the objective {_change_words(left)} on what was left out, {_change_words(fitted)} where the gains were found"
    )
    sides = {score.difference.interval_side for score in t.weighed}
    after = f"{sizes[0].upper()}{sizes[1:]}."
    if 1 in sides:
        return f"To be weighed: one metric is significantly worse on what was left out. {after}"
    return (
        f"Worth taking: {sizes}."
        if -1 in sides
        else f"No significant gain: keep what you have until more logs show one. {after}"
    )


def _change_words(percent: float) -> str:
    return f"{'rises' if percent < 0 else 'falls'} by {abs(percent):.0f} %"


def held_out_text(score: HeldOutScore) -> str:
    """Describe one question on the left-out parts.

    Example: ``Tilt error 36 % closer to perfect (16 to 51 %), better on 5 of 5``.
    """
    d, title = score.difference, score.question.title
    if d.value is None:
        return f"{title} not known ({d.reason})"
    if d.direction == "same":
        return f"{title} the same"
    size, ends = _size_and_interval(d, score.question.unit)
    words = {-1: "closer to perfect", 1: "further from perfect", 0: "not significant"}[d.interval_side]
    return f"{title} {size} {words}{ends}, better on {score.better} of {score.better + score.worse}"


def _size_and_interval(d: Difference, unit: str) -> tuple[str, str]:
    """Return size and interval; significant ratios have no sign, because words give the side."""
    if d.scale != "ratio" or d.ci95 is None or d.interval_side == 0:
        return size_and_interval(d, unit)
    ends = [change_end(x, signed=False) for x in sorted(d.ci95, key=lambda x: abs(x - 1.0))]
    return change(d.value or 1.0, signed=False), f" ({between(*ends)})"


def gains_at_edge(t: Tuning) -> list[str]:
    """Return gains at an end of their range."""
    shares = {f.name: f.share(float(t.found.setting[f.name])) for f in t.free}
    return [name for name, share in shares.items() if not EDGE_SHARE <= share <= 1.0 - EDGE_SHARE]


def firmware_gains(t: Tuning) -> dict[str, float]:
    """Return gains that are autopilot parameters: their names are in capital letters."""
    return {name: v for name, v in t.found.setting.items() if name.isupper() and isinstance(v, float)}


def paste_lines(t: Tuning) -> list[str]:
    """Return lines to paste: filter for attlog, and autopilot parameters."""
    return [with_gains(t.filter, t.found.setting), *(f"{name},{v:g}" for name, v in firmware_gains(t).items())]


def gain_rows(t: Tuning) -> TableCells:
    """Return the gains of every fold, which show their dependence on the logs."""
    names = [f.name + (f" [{f.unit}]" if f.unit else "") for f in t.free]

    def gains(setting: Mapping[str, float | str]) -> list[str]:
        return [f"{setting[f.name]:g}" for f in t.free]

    rows = [["nothing: the gains found", *gains(t.found.setting), change(math.exp(t.found.cost)), ""]]
    for fold in t.folds:
        costs = (change(math.exp(cost)) for cost in (fold.found.cost, fold.cost_left_out))
        rows.append([clean(listed([p.name for p in fold.left_out])), *gains(fold.found.setting), *costs])
    return ["left out", *names, "objective found", "objective left out"], rows


def part_rows(t: Tuning) -> TableCells:
    """Return the values of every part before and after, with gains found without it."""
    shown = [score for score in t.scores if score.difference.value is not None]
    titles = [f"{s.question.title} [{s.question.unit}] {when}" for s in shown for when in ("default", "tuned")]
    rows = []
    for k, part in enumerate(t.parts):
        values = [three_digits(float(v)) for score in shown for v in (score.before[k], score.after[k])]
        rows.append([clean(part.name), *values])
    return ["left out", *titles], rows


def held_out_rows(t: Tuning) -> TableCells:
    """Return every question on the left-out parts."""
    rows = []
    for score in t.scores:
        d = score.difference
        size, ends = ("none", "") if d.value is None else size_and_interval(d, score.question.unit)
        words = {-1: "better", 1: "worse", 0: "not significant"}[d.interval_side] if d.value is not None else d.reason
        weight = f"{score.weight:g}" if score.weight else "elsewhere"
        rows.append(
            [score.question.title, weight, size + ends, f"{score.better} of {score.better + score.worse}", words]
        )
    return ["metric", "weight", "tuned beside default (95 %)", "better on", ""], rows


def tune_document(t: Tuning, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON of a tuning; ``about``: version, command, options, logs."""
    return {
        "schema": TUNE_SCHEMA,
        **about,
        "filter": t.filter,
        "seed": t.seed,
        "modes": t.modes,
        "searched": to_plain(t.free),
        "objective": [{**question_document(x.question), "name": x.name, "weight": x.weight} for x in t.terms],
        "as_it_is": t.start,
        "gains": t.found.setting,
        "cost": t.found.cost,
        "cost_left_out": t.cost_left_out,
        "paste": paste_lines(t),
        "firmware": firmware_gains(t),
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
        "judged_on_left_out": [_score_document(t, score) for score in t.scores],
        "tried": [{"gains": s, "cost": c} for s, c in t.found.tried],
    }


def _score_document(t: Tuning, score: HeldOutScore) -> dict[str, Any]:
    parts = enumerate(zip(t.parts, to_plain(score.before), to_plain(score.after), strict=True))
    return {
        **question_document(score.question),
        "weight": score.weight,
        "beside": difference_document(score.difference),
        "better_on": score.better,
        "worse_on": score.worse,
        "parts": [{"name": p.name, "as_it_is": a, "tuned": b, "why": score.missing.get(k)} for k, (p, a, b) in parts],
    }


def tune_page(t: Tuning, about: Mapping[str, Any]) -> str:
    """Return the page; ``about``: version, command and logs as in the JSON."""
    where = counted(len(t.logs), "log") if len(t.logs) > 1 else "one log"
    tried = [_tried_figure(t, f, k) for k, f in enumerate(t.free)]
    said = list(tune_sentences(t, count_references(about)))
    sections = [
        PageSection("How flat the optimum is", figures=tried),
        PageSection("Gains, ready to paste", code="\n".join(paste_lines(t))),
        PageSection("On what was left out", table=held_out_rows(t), folded=True),
        PageSection("How much the gains depend on the logs", table=gain_rows(t), folded=True),
        PageSection("Each part, with gains that were not found on it", table=part_rows(t), folded=True),
    ]
    return render_sections("tune", f"{t.filter}: gains from {where}", tune_document(t, about), said, sections)


def _tried_figure(t: Tuning, f: FreeParameter, number: int) -> PageFigure:
    """Draw the change of the objective over one gain, one dot per setting tried."""
    changes = [100.0 * (math.exp(cost) - 1.0) for _, cost in t.found.tried]
    low, middle = min(changes), sorted(changes)[len(changes) // 2]
    gains = json_numbers([float(setting[f.name]) for setting, _ in t.found.tried])
    again = [float(fold.found.setting[f.name]) for fold in t.folds]
    data = {
        "band": [min(again), max(again)],
        "x": gains,
        "y": json_numbers(changes),
        "log": f.log,
        "range": [f.low, f.high],
        "top": max(middle + MAX_SPREAD_SHOWN * (middle - low), low + 1.0),
        "best": [setting == t.found.setting for setting, _ in t.found.tried],
        "say": [f"{setting_words(tried[0])}: {c:+.0f} %" for tried, c in zip(t.found.tried, changes, strict=True)],
        "axis": titled(f.name, unit_sign(f.unit)),
        "title": "objective, % of the default gains",
        "table": [[f.name, "objective [%]"], *([g, c] for g, c in zip(gains, json_numbers(changes), strict=True))],
    }
    caption = "Red: the gains found. Band: found with logs left out. Triangles: worse than the figure reaches."
    title = f"Every setting that was tried, by {f.name}"
    words = f"{setting_words(t.found.setting)}: {low:+.0f} %"
    return PageFigure(f"tried{number}", "tried", title, caption, 300, data, len(t.free) == 1, words)
