"""Tune gains by cross-validation over logs.

Logs, or blocks of time of a single log, are left out in turn. The gains with the smallest cost are searched on the
others, and compared with the default gains, pair by pair, on the parts left out. The result is the gains found on all
parts.

    cost = sum_m w_m mean_parts ln((s_m + f_m) / (s0_m + f_m)) / sum_m w_m

s is the distance from ideal, s0 that of the default gains, f a negligible step of the unit
(:data:`attlog.compare.diff.NEGLIGIBLE`), so that a lag near zero does not dominate. The default gains cost 0; -0.2 is
18 % nearer to ideal.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.compare.comparison import Question, commonest_reason
from attlog.compare.diff import NEGLIGIBLE
from attlog.compare.grid import FreeParameter, SearchResult, Setting, minimize
from attlog.compare.paired import Difference
from attlog.compare.search import SettingResult, SettingsOnLog, pooled_setting_difference, swept_questions
from attlog.core.errors import LogUnusable, UsageError, suggestion
from attlog.metrics.metric import Answer, missing
from attlog.metrics.ranking import distance

Array = NDArray[np.float64]

# Blocks of a single log: few enough to hold several units of evidence each.
BLOCKS_PER_LOG = 4
# With more logs than this, groups of logs are left out.
MAX_FOLDS = 5
# Generations of 32 settings per search.
GENERATIONS = 6
# Short names of common objectives.
TERM_NAMES = {
    "tilt": "tilt_rmse_deg",
    "heading": "heading_rmse_deg",
    "total": "total_rmse_deg",
    "noise": "noise_tilt_deg@hover",
    "rest_noise": "noise_tilt_deg",
    "step": "step_error_deg.0.5s",
    "lag": "lag_ms",
    "drift": "drift_rest_deg_per_min",
    "gnss": "innovation_rms.gnss_velocity",
    "compass": "innovation_rms.compass_field",
    "height": "innovation_rms.height",
}
# Cost of a setting that diverges, has no value or is not corrected by gravity: ln 20, 20 times the distance from ideal.
UNSOUND_COST = 3.0


@dataclass(frozen=True, slots=True)
class LogPart:
    """Log (by index), or the time from ``t0`` to ``t1`` s of it."""

    log: int
    name: str
    t0: float | None = None
    t1: float | None = None

    def of(self, answer: Answer) -> Answer | None:
        """Restrict an answer to this part, None where none of its units begins there."""
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
        """Return the value on this part."""
        found = self.of(answer)
        return None if found is None else found.value


def split_parts(logs: Sequence[SettingsOnLog]) -> list[LogPart]:
    """Return every log as a part; split a single log into equal blocks."""
    if len(logs) > 1:
        return [LogPart(k, log.name) for k, log in enumerate(logs)]
    case = logs[0].case
    spans = case.segments.spans("all")
    end = min(max(t1 for _, t1 in spans), case.reference.scoring.end) if spans else 0.0
    edges = np.linspace(case.reference.scoring.start, end, BLOCKS_PER_LOG + 1).tolist()
    edges[0] = min(spans[0][0], edges[0]) if spans else edges[0]
    return [LogPart(0, f"{a:.0f} to {b:.0f} s", a, b) for a, b in pairwise(edges)]


def make_folds(parts: Sequence[LogPart]) -> list[list[LogPart]]:
    """Return the folds: one part each, or MAX_FOLDS groups of parts."""
    groups = min(len(parts), MAX_FOLDS)
    return [list(parts[k::groups]) for k in range(groups)]


@dataclass(frozen=True, slots=True)
class ObjectiveTerm:
    """Question with its weight in the objective."""

    name: str
    question: Question
    weight: float

    @classmethod
    def of(cls, question: Question) -> ObjectiveTerm:
        """Return the term of a question with weight 1 and its short name."""
        names = {metric: name for name, metric in TERM_NAMES.items()}
        return cls(names.get(question.metric, question.metric), question, 1.0)


def parse_objective(texts: Sequence[str]) -> list[ObjectiveTerm]:
    """Parse objectives such as ``tilt=1``, ``tilt=1,noise=0.5``, ``lag_ms@airborne=0.2``.

    UsageError lists every error.
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
            questions = swept_questions([TERM_NAMES.get(name, name)])
        except UsageError:
            hint = suggestion(name, [*TERM_NAMES])
            wrong.append(f"{text}: there is nothing called {name}{hint}, nor a metric of that name")
            continue
        found |= {q.id: ObjectiveTerm(name, q, number) for q in questions}
    if wrong or not found:
        raise UsageError("\n".join(wrong) or "no objective; give one such as tilt=1,noise=0.5")
    return list(found.values())


def objective_cost(
    terms: Sequence[ObjectiveTerm],
    parts: Sequence[LogPart],
    results: Mapping[int, SettingResult],
    base: Mapping[int, SettingResult],
) -> float:
    """Return the cost of a setting on parts.

    ``results``: of the setting, ``base``: of the default gains, both by log.
    """
    total, weights = 0.0, 0.0
    for term in terms:
        costs = [log_ratio(term.question, part, results[part.log], base[part.log]) for part in parts]
        found = [c for c in costs if c is not None]
        if found:
            total += term.weight * sum(found) / len(found)
            weights += term.weight
    return total / weights if weights else UNSOUND_COST


def log_ratio(question: Question, part: LogPart, result: SettingResult, base: SettingResult) -> float | None:
    """Return the log ratio of distances from ideal, setting over default gains, or None."""
    before = part.value(base.answers[question])
    if before is None:
        return None
    value = part.value(result.answers[question]) if result.counts(question) else None
    if value is None:
        return UNSOUND_COST
    step = NEGLIGIBLE.get(question.unit, 0.0) or 1e-9
    now, then = (max(distance(Answer(v, "", ""), question.better)[1], 0.0) + step for v in (value, before))
    return min(math.log(now / then), UNSOUND_COST)


@dataclass(frozen=True, slots=True)
class Fold:
    """Parts left out, the gains found without them, and their cost there."""

    left_out: list[LogPart]
    found: SearchResult
    cost_left_out: float


@dataclass(frozen=True, slots=True)
class HeldOutScore:
    """One question on left-out parts: tuned gains against default gains.

    ``before``, ``after``: values by part, NaN for missing. ``missing``: part index -> why it does not count.
    """

    question: Question
    weight: float
    difference: Difference
    before: Array
    after: Array
    better: int
    worse: int
    missing: dict[int, str]


@dataclass(slots=True)
class Tuning:
    """Result of a tuning. ``start``: default gains, ``found``: gains from all parts."""

    filter: str
    free: list[FreeParameter]
    terms: list[ObjectiveTerm]
    logs: list[str]
    parts: list[LogPart]
    start: Setting
    found: SearchResult
    folds: list[Fold]
    scores: list[HeldOutScore]
    seed: int
    modes: list[str] = field(default_factory=list)

    @property
    def weighed(self) -> list[HeldOutScore]:
        """Return the scores of the objective's questions."""
        return [score for score in self.scores if score.weight > 0.0]

    @property
    def cost_left_out(self) -> float:
        """Return the mean cost over parts, each with gains found without it."""
        sizes = [len(fold.left_out) for fold in self.folds]
        return sum(n * fold.cost_left_out for n, fold in zip(sizes, self.folds, strict=True)) / sum(sizes)


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
    """Search gains and validate them on parts left out.

    ``elsewhere``: the same logs with additional questions. UsageError where a metric cannot be split over the blocks of
    a single log; LogUnusable where the default gains have no value of the objective.
    """
    base = {k: log([{}])[0] for k, log in enumerate(logs)}
    parts = _usable_parts(split_parts(logs), terms, base)

    def search(some: Sequence[LogPart]) -> SearchResult:
        def costs(settings: list[Setting]) -> Array:
            by_log = {k: logs[k](settings) for k in dict.fromkeys(p.log for p in some)}
            rows = [{k: s[i] for k, s in by_log.items()} for i in range(len(settings))]
            return np.array([objective_cost(terms, some, row, base) for row in rows])

        return minimize(free, costs, start, generations, seed)

    folds = []
    for left_out in make_folds(parts):
        found = search([p for p in parts if p not in left_out])
        there = {p.log: logs[p.log]([found.setting])[0] for p in left_out}
        folds.append(Fold(left_out, found, objective_cost(terms, left_out, there, base)))
    scores = [_held_out_score(t.question, t.weight, logs, parts, folds) for t in terms]
    own = {t.question for t in terms}
    others = [q for q in (elsewhere[0].questions if elsewhere else []) if q not in own]
    scores += [_held_out_score(q, 0.0, elsewhere, parts, folds) for q in others]
    names = [log.name for log in logs]
    modes = [log.mode for log in logs]
    return Tuning(filter_name, list(free), list(terms), names, parts, start, search(parts), folds, scores, seed, modes)


def _usable_parts(
    parts: Sequence[LogPart], terms: Sequence[ObjectiveTerm], base: Mapping[int, SettingResult]
) -> list[LogPart]:
    """Return the parts on which the default gains have a value of some term."""
    blocks = parts[0].t0 is not None
    for term in terms if blocks else ():
        answer = base[0].answers[term.question]
        if answer.value is not None and answer.units is None:
            raise UsageError(f"{term.name}: cannot be compared by blocks of one log; give several logs")
    found = [p for p in parts if any(p.value(base[p.log].answers[t.question]) is not None for t in terms)]
    if len(found) < 2:
        said = base[0].answers[terms[0].question].reason or "too little of it can be scored"
        what = "blocks of this log" if blocks else "logs"
        raise LogUnusable(f"two {what} with a value of the objective are needed, to find gains and to judge ({said})")
    return found


def _held_out_score(
    question: Question, weight: float, logs: Sequence[SettingsOnLog], parts: Sequence[LogPart], folds: Sequence[Fold]
) -> HeldOutScore:
    """Score one question with each fold's gains on its left-out parts."""
    gains = {part: fold.found.setting for fold in folds for part in fold.left_out}
    first, second, lost = [], [], {}
    before, after = np.full(len(parts), np.nan), np.full(len(parts), np.nan)
    for k, part in enumerate(parts):
        a, b = (_answers_on(part, result, question) for result in logs[part.log]([{}, gains[part]]))
        values = a.answers[question].value, b.answers[question].value
        before[k], after[k] = (np.nan if v is None else v for v in values)
        if values[0] is None or not b.counts(question):
            lost[k] = b.unsound or a.answers[question].reason or b.answers[question].reason or "no value"
            continue
        first.append(replace(a, unsound=""))
        second.append(b)
    changes = [b.distance(question) - a.distance(question) for a, b in zip(first, second, strict=True)]
    better, worse = sum(c < 0 for c in changes), sum(c > 0 for c in changes)
    found = pooled_setting_difference(question, first, second)
    if not first:
        found = replace(found, reason=commonest_reason(lost.values()))
    return HeldOutScore(question, weight, found, before, after, better, worse, lost)


def _answers_on(part: LogPart, result: SettingResult, question: Question) -> SettingResult:
    """Return the answer to one question on a part."""
    answer = result.answers[question]
    there = part.of(answer)
    if there is None and answer.value is not None:
        there = missing("not_covered", "no whole block of it lies there", question.unit, question.window)
    return replace(result, answers={question: there if there is not None else answer})
