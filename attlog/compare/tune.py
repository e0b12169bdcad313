"""What is left out in turn, so that gains are judged where they were not found: whole logs, or blocks of one log."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.compare.diff import NEGLIGIBLE
from attlog.compare.grid import FreeParameter, SearchResult, Setting, minimize
from attlog.compare.search import (
    SettingDifference,
    SettingResult,
    SettingsOnLog,
    SweptMetric,
    distance_or_nan,
    parse_metrics,
    pooled_setting_difference,
)
from attlog.core.errors import LogUnusable, UsageError, suggestion
from attlog.metrics.metric import Answer
from attlog.metrics.ranking import distance

BLOCKS_PER_LOG = 4
"""Blocks of one log: each long enough to hold several units of evidence."""
MAX_FOLDS = 5
"""More logs than this are left out in groups."""


@dataclass(frozen=True, slots=True)
class LogPart:
    """A log by its number, or the time from ``t0`` to ``t1`` s of it."""

    log: int
    name: str
    t0: float | None = None
    t1: float | None = None

    def of(self, answer: Answer) -> Answer | None:
        """The answer on this part; None where it has none, or none of its units lies in there."""
        if answer.value is None or self.t0 is None or self.t1 is None:
            return None if answer.value is None else answer
        if answer.units is None:
            return None
        inside = (answer.units.ids >= 1000.0 * self.t0) & (answer.units.ids < 1000.0 * self.t1)
        if not inside.any():
            return None
        ids = answer.units.ids[inside]
        summary = answer.units.of(ids)
        units = replace(answer.units, ids=ids, values=answer.units.values[inside])
        return replace(answer, value=summary.value, ci95=summary.ci95, n=len(ids), units=units)

    def value(self, answer: Answer) -> float | None:
        """The value on this part."""
        found = self.of(answer)
        return None if found is None else found.value


def split_parts(logs: Sequence[SettingsOnLog]) -> list[LogPart]:
    """Every log as a part; of one log alone blocks of equal time from the scoring start to its end."""
    if len(logs) > 1:
        return [LogPart(k, log.name) for k, log in enumerate(logs)]
    case = logs[0].case
    spans = case.segments.spans("all")
    end = min(max(t1 for _, t1 in spans), case.reference.end) if spans else 0.0
    edges = np.linspace(case.reference.scoring_start, end, BLOCKS_PER_LOG + 1).tolist()
    edges[0] = min(spans[0][0], edges[0]) if spans else edges[0]
    return [LogPart(0, f"{a:.0f} to {b:.0f} s", a, b) for a, b in pairwise(edges)]


def make_folds(parts: Sequence[LogPart]) -> list[list[LogPart]]:
    """Groups of parts to be left out in turn: each alone up to MOST_FOLDS, else dealt in turn into so many groups."""
    groups = min(len(parts), MAX_FOLDS)
    return [list(parts[k::groups]) for k in range(groups)]


# What a search looks for: metrics with weights, each as the logarithm of its ratio to the default gains.
#
#     cost = sum_m w_m mean_parts ln((s_m + f_m) / (s0_m + f_m)) / sum_m w_m
#
# with s the size of the value (how far from perfect), s0 that of the default gains, and f a step that means nothing
# to
# anybody who flies (that of :mod:`attlog.compare.diff`), so that a lag near zero does not decide
# everything.
# The cost of the default gains is 0; -0.2 is 18 % closer to perfect.

TERM_NAMES = {
    "tilt": "tilt_rmse_deg",
    "heading": "heading_rmse_deg",
    "total": "total_rmse_deg",
    "noise": "noise_tilt_deg@hover",
    "rest_noise": "noise_tilt_deg",
    "step": "step_error_deg.0.5s",
    "lag": "lag_ms",
    "drift": "drift_rest_deg_per_min",
}
"""Short names of what is usually weighed; every metric can be named by its id."""
UNSOUND_COST = 3.0
"""The cost of a setting that diverges, has no value or is not corrected by gravity: as if twenty times as far off."""


@dataclass(frozen=True, slots=True)
class ObjectiveTerm:
    """A metric and its weight."""

    name: str
    metric: SweptMetric
    weight: float


def parse_objective(texts: Sequence[str]) -> list[ObjectiveTerm]:
    """The terms of texts such as ``tilt=1``, ``noise=0.5``, ``lag_ms@airborne=0.2``; commas part several in one text.

    UsageError tells everything wrong in them.
    """
    found: dict[str, ObjectiveTerm] = {}
    wrong = []
    for text in (part.strip() for given in texts for part in given.split(",") if part.strip()):
        name, sign, weight = (part.strip() for part in text.partition("="))
        try:
            number = float(weight) if sign else 1.0
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and number > 0.0):
            wrong.append(f"{text}: the weight is a number above 0, such as {name or 'tilt'}=1")
            continue
        try:
            metrics = parse_metrics([TERM_NAMES.get(name, name)])
        except UsageError:
            wrong.append(
                f"{text}: there is nothing called {name}{suggestion(name, [*TERM_NAMES])}, nor a metric of that name"
            )
            continue
        found |= {m.name: ObjectiveTerm(name, m, number) for m in metrics}
    if wrong or not found:
        raise UsageError("\n".join(wrong) or "no objective; give one such as tilt=1,noise=0.5")
    return list(found.values())


def objective_cost(
    terms: Sequence[ObjectiveTerm],
    parts: Sequence[LogPart],
    settled: Mapping[int, SettingResult],
    base: Mapping[int, SettingResult],
) -> float:
    """The cost of a setting on parts, from what it and the default gains (``base``) are worth by log."""
    total, weights = 0.0, 0.0
    for term in terms:
        found = [c for part in parts if (c := log_ratio(term, part, settled[part.log], base[part.log])) is not None]
        if found:
            total += term.weight * sum(found) / len(found)
            weights += term.weight
    return total / weights if weights else UNSOUND_COST


def log_ratio(term: ObjectiveTerm, part: LogPart, settled: SettingResult, base: SettingResult) -> float | None:
    """ln of how far a setting is from perfect over how far the default gains are; None where that is not known."""
    metric = term.metric
    before = part.value(base.answers[metric])
    if before is None:
        return None
    value = part.value(settled.answers[metric]) if settled.fit(metric) else None
    if value is None:
        return UNSOUND_COST
    step = NEGLIGIBLE.get(metric.unit, 0.0) or 1e-9
    sizes = (_value_distance(v, metric.better) for v in (value, before))
    now, then = (max(s, 0.0) + step for s in sizes)
    return min(math.log(now / then), UNSOUND_COST)


def _value_distance(value: float, better: str) -> float:
    from attlog.metrics.metric import Answer

    return distance(Answer(value, "", ""), better)[1]


# Gains for a filter from logs, judged on what was left out of finding them.
#
# The logs (of one log alone blocks of time) are left out in turn; on the others the gains with the smallest cost are
# searched for, and judged on what was left out, beside its default gains, pair by pair. The gains that are given are
# those found on all parts; what they are worth is what gains found in the same way gained where they were not fitted.

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Fold:
    """What was left out, the gains found without it, and both costs."""

    left_out: list[LogPart]
    found: SearchResult
    cost_left_out: float


@dataclass(frozen=True, slots=True)
class HeldOutScore:
    """A metric on parts left out: the tuned filter beside its default gains, pooled, and part by part.

    ``before``, ``after``: values by part, NaN where there is none. ``better``, ``worse``: on how many parts;
    ``missing``: why parts do not count.
    """

    metric: SweptMetric
    weight: float
    beside: SettingDifference
    before: Array
    after: Array
    better: int
    worse: int
    missing: dict[int, str]


@dataclass(slots=True)
class Tuning:
    """The whole answer. ``start`` are the gains as they are, ``found`` those from all parts."""

    filter: str
    free: list[FreeParameter]
    terms: list[ObjectiveTerm]
    logs: list[str]
    parts: list[LogPart]
    start: Setting
    found: SearchResult
    folds: list[Fold]
    judged: list[HeldOutScore]
    seed: int


GENERATIONS = 6
"""Of 32 settings in each search."""


def tune(
    filter_name: str,
    free: Sequence[FreeParameter],
    terms: Sequence[ObjectiveTerm],
    logs: Sequence[SettingsOnLog],
    elsewhere: Sequence[SettingsOnLog],
    start: Setting,
    generations: int,
    seed: int,
) -> Tuning:
    """Search and judge. ``logs`` are asked for the terms' metrics, ``elsewhere`` the same logs for others.

    UsageError where a metric cannot be split over the blocks of a single log; LogUnusable where the default gains
    has no value to begin from.
    """
    base = {k: log([{}])[0] for k, log in enumerate(logs)}
    parts = _usable_parts(split_parts(logs), terms, base)

    def costs_on(some: Sequence[LogPart]) -> SearchResult:
        def costs(settings: list[Setting]) -> Array:
            by_log = {k: logs[k](settings) for k in dict.fromkeys(p.log for p in some)}
            rows = [{k: s[i] for k, s in by_log.items()} for i in range(len(settings))]
            return np.array([objective_cost(terms, some, row, base) for row in rows])

        return minimize(free, costs, start, generations, seed)

    groups = make_folds(parts)
    done = []
    for left_out in groups:
        found = costs_on([p for p in parts if p not in left_out])
        there = {p.log: logs[p.log]([found.setting])[0] for p in left_out}
        done.append(Fold(left_out, found, objective_cost(terms, left_out, there, base)))
    judged = [_held_out_score(t.metric, t.weight, logs, parts, done) for t in terms]
    own = {t.metric for t in terms}
    others = [m for m in (elsewhere[0].asked if elsewhere else []) if m not in own]
    judged += [_held_out_score(m, 0.0, elsewhere, parts, done) for m in others]
    found = costs_on(parts)
    names = [log.name for log in logs]
    return Tuning(filter_name, list(free), list(terms), names, parts, start, found, done, judged, seed)


def _usable_parts(
    parts: Sequence[LogPart], terms: Sequence[ObjectiveTerm], base: Mapping[int, SettingResult]
) -> list[LogPart]:
    """The parts on which the default gains have a value of some term."""
    blocks = parts[0].t0 is not None
    for term in terms if blocks else ():
        answer = base[0].answers[term.metric]
        if answer.value is not None and answer.units is None:
            raise UsageError(f"{term.name}: cannot be compared by blocks of one log; give several logs")
    found = [p for p in parts if any(p.value(base[p.log].answers[t.metric]) is not None for t in terms)]
    if len(found) < 2:
        said = base[0].answers[terms[0].metric].reason or "too little of it can be scored"
        what = "blocks of this log" if blocks else "logs"
        raise LogUnusable(f"two {what} with a value of the objective are needed, to find gains and to judge ({said})")
    return found


def _held_out_score(
    metric: SweptMetric, weight: float, logs: Sequence[SettingsOnLog], parts: Sequence[LogPart], done: Sequence[Fold]
) -> HeldOutScore:
    """A metric of the folds' gains on the parts that they did not see."""
    gains = {part: fold.found.setting for fold in done for part in fold.left_out}
    first, second, missing = [], [], {}
    before, after = np.full(len(parts), np.nan), np.full(len(parts), np.nan)
    for k, part in enumerate(parts):
        a, b = (_answers_on(part, settled, metric) for settled in logs[part.log]([{}, gains[part]]))
        values = a.answers[metric].value, b.answers[metric].value
        before[k], after[k] = (np.nan if v is None else v for v in values)
        if values[0] is None or not b.fit(metric):
            missing[k] = b.unsound or a.answers[metric].reason or b.answers[metric].reason or "no value"
            continue
        first.append(a)
        second.append(b)
    changes = [
        distance_or_nan(b, metric) - distance_or_nan(replace(a, unsound=""), metric)
        for a, b in zip(first, second, strict=True)
    ]
    better, worse = sum(c < 0 for c in changes), sum(c > 0 for c in changes)
    beside, _ = pooled_setting_difference(metric, [replace(a, unsound="") for a in first], second)
    if not first:
        said = list(missing.values())
        beside = replace(beside, why=max(said, key=said.count))
    return HeldOutScore(metric, weight, beside, before, after, better, worse, missing)


def _answers_on(part: LogPart, settled: SettingResult, metric: SweptMetric) -> SettingResult:
    """The settled answers of one metric on a part."""
    from attlog.metrics.metric import missing

    answer = settled.answers[metric]
    there = part.of(answer)
    if there is None and answer.value is not None:
        there = missing("not_covered", "no whole block of it lies there", metric.unit, metric.window)
    return replace(settled, answers={metric: there if there is not None else answer})
