"""Tuned gains in words: what they are, what they gained on what was left out, what they cost elsewhere."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from attlog.base import plain
from attlog.compare.sweep.grid import text_of
from attlog.compare.sweep.sweep import SettingDifference
from attlog.compare.sweep.text import named, only_agreement, size_and_ends
from attlog.compare.tune.tune import HeldOutScore, Tuning
from attlog.present.numbers import between, change, change_end, counted, listed
from attlog.present.text import clean

SCHEMA = "attlog-tune/1"


def sentences(t: Tuning, references: Mapping[str, int]) -> Iterator[str]:
    """Whether to take the gains, what they are, gain and cost; ``references``: how many logs have which."""
    what = ", ".join(f"{term.name} {term.weight:g}" for term in t.terms)
    yield _sure(t)
    yield f"{t.filter}: {named(t.found.setting)} (was {named(t.start)}), found for {what} on {_where(t)}."
    yield f"On what was left out: {'; '.join(judged_text(j) for j in t.judged if j.weight > 0)}."
    others = [j for j in t.judged if j.weight == 0 and significant_side(j.beside)]
    if others:
        yield f"Elsewhere, left out too: {'; '.join(judged_text(j) for j in others)}."
    edges = at_edge(t)
    if edges:
        lie = "lies" if len(edges) == 1 else "lie"
        yield f"{listed(edges)} {lie} at the end of the range: a wider one may hold better gains."
    gone: dict[tuple[str, str], list[str]] = {}
    for j in t.judged:
        for k, why in j.missing.items() if j.weight > 0 else ():
            gone.setdefault((t.parts[k].name, why), []).append(j.metric.title)
    for (name, why), titles in gone.items():
        yield f"Not counted: {listed(titles)} of {clean(name)} ({why})."
    yield from only_agreement(references)


def _where(t: Tuning) -> str:
    return counted(len(t.logs), "log") if len(t.logs) > 1 else f"{len(t.parts)} blocks of time of one log"


def judged_text(j: HeldOutScore) -> str:
    """One metric: ``Tilt error RMS 36 % closer to perfect (16 to 51 %), better on 5 of 5``."""
    b, on = j.beside, f"better on {j.better} of {j.better + j.worse}"
    if b.value is None:
        return f"{j.metric.title} not known ({b.why})"
    if b.ci95 is not None and b.ci95 == (b.value, b.value):
        return f"{j.metric.title} the same"
    change, ends = _change(b, j.metric.unit)
    words = {-1: "closer to perfect", 1: "further from perfect", 0: "not significant"}[significant_side(b)]
    return f"{j.metric.title} {change} {words}{ends}, {on}"


def significant_side(b: SettingDifference) -> int:
    """-1 where the tuned filter is significantly better, 1 worse, 0 neither."""
    if b.value is None or b.ci95 is None:
        return 0
    middle = 1.0 if b.scale == "ratio" else 0.0
    return -1 if b.ci95[1] < middle else 1 if b.ci95[0] > middle else 0


def _change(b: SettingDifference, unit: str, signed: bool = False) -> tuple[str, str]:
    """How much, and the interval in brackets; without signs where words say on which side, unless ``signed``."""
    assert b.value is not None
    if b.scale != "ratio" or b.ci95 is None or signed or significant_side(b) == 0:
        return size_and_ends(b, unit)
    ends = [change_end(x, signed=False) for x in sorted(b.ci95, key=lambda x: abs(x - 1.0))]
    return change(b.value, signed=False), f" ({between(*ends)})"


def _moved(percent: float) -> str:
    """``falls by 6 %``, ``rises by 29 %``."""
    return f"{'rises' if percent < 0 else 'falls'} by {abs(percent):.0f} %"


def _sure(t: Tuning) -> str:
    """Whether to take the gains: by what was left out, beside what was fitted."""
    weighed = [j for j in t.judged if j.weight > 0]
    fitted, left = (100.0 * (1.0 - math.exp(x)) for x in (t.found.cost, mean_left_out(t)))
    sizes = f"the objective {_moved(left)} on what was left out, {_moved(fitted)} where the gains were found"
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


def at_edge(t: Tuning) -> list[str]:
    """Gains at the end of their range."""
    found = []
    for f in t.free:
        share = f.share(float(t.found.setting[f.name]))
        if share < 0.02 or share > 0.98:
            found.append(f.name)
    return found


def paste(t: Tuning, firmware: Mapping[str, str]) -> list[str]:
    """Lines ready to paste: the filter as attlog takes it, and the autopilot's parameters where the filter has them."""
    own = f"{t.filter}{',' if ':' in t.filter else ':'}{text_of(t.found.setting)}"
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
    rows = [["nothing: the gains found", *_gains(t, t.found.setting), _percent(t.found.cost), ""]]
    for fold in t.folds:
        names = clean(listed([p.name for p in fold.left_out]))
        rows.append([names, *_gains(t, fold.found.setting), _percent(fold.found.cost), _percent(fold.cost_left_out)])
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


def judged_rows(t: Tuning) -> tuple[list[str], list[list[str]]]:
    """Every metric on what was left out."""
    rows = []
    for j in t.judged:
        b = j.beside
        change, ends = ("none", "") if b.value is None else _change(b, j.metric.unit, signed=True)
        words = {-1: "better", 1: "worse", 0: "not significant"}[significant_side(b)] if b.value is not None else b.why
        weight = f"{j.weight:g}" if j.weight else "elsewhere"
        rows.append([j.metric.title, weight, change + ends, f"{j.better} of {j.better + j.worse}", words])
    return ["metric", "weight", "tuned beside default (95 %)", "better on", ""], rows


def document(t: Tuning, about: dict[str, Any], firmware: Mapping[str, str]) -> dict[str, Any]:
    """The JSON of a tuning."""
    return {
        "schema": SCHEMA,
        **about,
        "filter": t.filter,
        "seed": t.seed,
        "searched": [plain.plain(f) for f in t.free],
        "objective": [
            {"name": x.name, "metric": x.metric.metric, "window": x.metric.window, "weight": x.weight} for x in t.terms
        ],
        "as_it_is": t.start,
        "gains": t.found.setting,
        "cost": t.found.cost,
        "cost_left_out": mean_left_out(t),
        "paste": paste(t, firmware),
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
                "beside": plain.plain(j.beside),
                "better_on": j.better,
                "worse_on": j.worse,
                "parts": [
                    {"name": p.name, "as_it_is": known(a), "tuned": known(b), "why": j.missing.get(k)}
                    for k, (p, a, b) in enumerate(zip(t.parts, j.before, j.after, strict=True))
                ],
            }
            for j in t.judged
        ],
        "tried": [{"gains": s, "cost": c} for s, c in t.found.tried],
    }


def known(value: float) -> float | None:
    """A number, None for NaN."""
    return None if math.isnan(value) else float(value)


def _gains(t: Tuning, setting: Mapping[str, float | str]) -> list[str]:
    return [f"{setting[f.name]:g}" for f in t.free]


def _percent(cost: float) -> str:
    return change(math.exp(cost))
