"""Gains for a filter from logs, judged on what was left out of finding them.

The logs (of one log alone blocks of time) are left out in turn; on the others the gains with the smallest cost are
searched for, and judged on what was left out, beside its default gains, pair by pair. The gains that are given are
those found on all parts; what they are worth is what gains found in the same way gained where they were not fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import LogUnusable, UsageError
from attlog.compare.sweep.grid import Setting
from attlog.compare.sweep.many import SettingResult, SettingsOnLog, SweptMetric
from attlog.compare.sweep.sweep import SettingDifference, over_logs, size
from attlog.compare.tune.folds import LogPart, folds, parts_of
from attlog.compare.tune.objective import ObjectiveTerm, cost
from attlog.compare.tune.search import FreeParameter, SearchResult, search

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
    parts = _usable(parts_of(logs), terms, base)

    def costs_on(some: Sequence[LogPart]) -> SearchResult:
        def costs(settings: list[Setting]) -> Array:
            by_log = {k: logs[k](settings) for k in dict.fromkeys(p.log for p in some)}
            rows = [{k: s[i] for k, s in by_log.items()} for i in range(len(settings))]
            return np.array([cost(terms, some, row, base) for row in rows])

        return search(free, costs, start, generations, seed)

    groups = folds(parts)
    done = []
    for left_out in groups:
        found = costs_on([p for p in parts if p not in left_out])
        there = {p.log: logs[p.log]([found.setting])[0] for p in left_out}
        done.append(Fold(left_out, found, cost(terms, left_out, there, base)))
    judged = [_judged(t.metric, t.weight, logs, parts, done) for t in terms]
    own = {t.metric for t in terms}
    others = [m for m in (elsewhere[0].asked if elsewhere else []) if m not in own]
    judged += [_judged(m, 0.0, elsewhere, parts, done) for m in others]
    found = costs_on(parts)
    names = [log.name for log in logs]
    return Tuning(filter_name, list(free), list(terms), names, parts, start, found, done, judged, seed)


def _usable(
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


def _judged(
    metric: SweptMetric, weight: float, logs: Sequence[SettingsOnLog], parts: Sequence[LogPart], done: Sequence[Fold]
) -> HeldOutScore:
    """A metric of the folds' gains on the parts that they did not see."""
    gains = {part: fold.found.setting for fold in done for part in fold.left_out}
    first, second, missing = [], [], {}
    before, after = np.full(len(parts), np.nan), np.full(len(parts), np.nan)
    for k, part in enumerate(parts):
        a, b = (_on(part, settled, metric) for settled in logs[part.log]([{}, gains[part]]))
        values = a.answers[metric].value, b.answers[metric].value
        before[k], after[k] = (np.nan if v is None else v for v in values)
        if values[0] is None or not b.fit(metric):
            missing[k] = b.unsound or a.answers[metric].reason or b.answers[metric].reason or "no value"
            continue
        first.append(a)
        second.append(b)
    changes = [size(b, metric) - size(replace(a, unsound=""), metric) for a, b in zip(first, second, strict=True)]
    better, worse = sum(c < 0 for c in changes), sum(c > 0 for c in changes)
    beside, _ = over_logs(metric, [replace(a, unsound="") for a in first], second)
    if not first:
        said = list(missing.values())
        beside = replace(beside, why=max(said, key=said.count))
    return HeldOutScore(metric, weight, beside, before, after, better, worse, missing)


def _on(part: LogPart, settled: SettingResult, metric: SweptMetric) -> SettingResult:
    """The settled answers of one metric on a part."""
    from attlog.metrics.answer import missing

    answer = settled.answers[metric]
    there = part.of(answer)
    if there is None and answer.value is not None:
        there = missing("not_covered", "no whole block of it lies there", metric.unit, metric.window)
    return replace(settled, answers={metric: there if there is not None else answer})
