"""The questions asked of every row, one file each, and the way to ask them all."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from attlog.core.errors import guarded
from attlog.metrics.metric import Answer, Case, Metric, missing
from attlog.reference.model import HeadingReference, Row

if TYPE_CHECKING:
    from attlog.metrics import ranking
    from attlog.metrics.trace import Trace
    from attlog.metrics.traces import Drawing

__all__ = [
    "Answer",
    "Case",
    "Drawing",
    "HeadingReference",
    "Metric",
    "Trace",
    "compute",
    "definitions",
    "missing",
    "rank",
    "settle",
]

QUESTIONS = {
    "noise.added": ("noise", "NOISE_METRICS", "compute_noise"),
    "steps.lag": ("lag", "LAG_METRICS", "compute_lag"),
    "steps.step_error": ("step_error", "STEP_ERROR_METRICS", "compute_step_error"),
    "steps.leak": ("lag", "CORRECTION_RATE_METRICS", "compute_correction_rate"),
    "steps.settling": ("step_error", "SETTLING_METRICS", "compute_settling"),
    "drift.rest": ("drift", "REST_DRIFT_METRICS", "compute_rest_drift"),
    "drift.air": ("drift", "AIR_DRIFT_METRICS", "compute_air_drift"),
    "drift.wander": ("heading", "HEADING_RESIDUAL_METRICS", "compute_heading_residual"),
    "errors.rmse": ("accuracy", "RMSE_METRICS", "compute_rmse"),
    "errors.gnss_heading": ("heading", "GNSS_HEADING_METRICS", "compute_gnss_heading"),
    "noise.allan": ("allan", "ALLAN_METRICS", "compute_allan"),
    "errors.convergence": ("recovery", "CONVERGENCE_METRICS", "compute_convergence"),
    "errors.recovery": ("recovery", "RECOVERY_METRICS", "compute_recovery"),
    "noise.hover": ("hover", "HOVER_METRICS", "compute_hover"),
    "errors.bias": ("accuracy", "BIAS_METRICS", "compute_bias"),
    "trials.cost": ("cost", "COST_METRICS", "compute_cost"),
    "steps.controller": ("setpoint", "SETPOINT_METRICS", "compute_setpoint"),
}
"""Question -> file, its metrics, its function; in the order of the table. Imported when first asked."""
MEASURED = "trials.cost"
"""The question that is answered by running the filter again, not from the log."""
LATE = {"Drawing": "traces", "Trace": "trace"}
FULL_COVERAGE_PCT = 95.0


class Question(NamedTuple):
    """Metrics that one function computes."""

    name: str
    METRICS: tuple[Metric, ...]
    compute: Callable[[Case, Row, str], dict[str, Answer]]


@cache
def questions() -> tuple[Question, ...]:
    """Return all questions, imported."""
    found = []
    for name, (room, table, function) in QUESTIONS.items():
        module = import_module(f"{__name__}.{room}")
        found.append(Question(name, getattr(module, table), getattr(module, function)))
    return tuple(found)


def measured() -> Question:
    """Return the question that is answered by running the filter again."""
    return next(q for q in questions() if q.name == MEASURED)


def __getattr__(name: str) -> Any:
    """What figures are drawn from, imported when it is first used."""
    if name not in LATE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{LATE[name]}"), name)


def __dir__() -> list[str]:
    """What completion offers: the public names also before their first use."""
    return sorted({*globals(), *__all__})


def definitions() -> dict[str, Metric]:
    """Every metric by its id, in the order of the table."""
    return {metric.name: metric for question in questions() for metric in question.METRICS}


def compute(
    case: Case, row: Row, windows: Sequence[str], *, cost: bool = True, only: Collection[str] = ()
) -> dict[str, dict[str, Answer]]:
    """Answers of one row: window -> metric id -> Answer. A metric that means nothing in a window is left out there.

    ``cost=False`` leaves out what has to be measured by running the filter again. ``only``: the metrics that are
    wanted, by id or by what their ids begin with before a dot; others come where one question answers both.
    ``coverage_pct`` stands beside comparisons of a row that was scored on less than 95 % of
    its time. A row that gravity does not correct is a baseline: it is ranked nowhere. What tells nothing is withheld.
    """
    from attlog.metrics import following
    from attlog.metrics.ranking import mark_not_ranked

    table: dict[str, dict[str, Answer]] = {}
    asked = [q for q in questions() if (cost or q is not measured()) and (not only or _is_of(q, only))]
    partly = row.coverage_pct is not None and row.coverage_pct < FULL_COVERAGE_PCT
    uncorrected = following.why_uncorrected(case, row)
    for window in windows:
        answers = table.setdefault(window, {})
        for question in asked:
            answers |= _asked(question, case, row, window)
            for metric in question.METRICS:
                if metric.name in answers:
                    mark_not_ranked(metric, answers[metric.name])
                    if partly and metric.covers:
                        answers[metric.name].coverage_pct = row.coverage_pct
        for answer in answers.values():
            if uncorrected and answer.ranked:
                answer.ranked, answer.reason = False, uncorrected
    return table


def settle(
    case: Case, table: Mapping[str, dict[str, dict[str, Answer]]], *, cost: bool = True, only: Collection[str] = ()
) -> None:
    """Complete the answers of ``case.rows``, by their names, with what can be said only now that all have passed.

    What was measured stands in the order of the table as if it had been asked with the rest.
    """
    from attlog.metrics import accuracy

    accuracy.rank_errors(case)
    if not cost or (only and not _is_of(measured(), only)):
        return
    after = {m.name for q in questions()[list(QUESTIONS).index(MEASURED) + 1 :] for m in q.METRICS}
    for row in case.rows:
        for window, answers in table[row.name].items():
            later = {name: answers.pop(name) for name in list(answers) if name in after}
            answers |= _asked(measured(), case, row, window) | later


def _is_of(question: Question, wanted: Collection[str]) -> bool:
    return any(m.name in wanted or m.name.partition(".")[0] in wanted for m in question.METRICS)


def _asked(question: Question, case: Case, row: Row, window: str) -> dict[str, Answer]:
    """The answers of one question; where it ends in a bug each of its metrics is missing with the reason."""

    def without(sentence: str) -> dict[str, Answer]:
        return {m.name: missing("part_failed", sentence, m.unit, window) for m in question.METRICS}

    name = question.name.rpartition(".")[2].replace("_", " ")
    return guarded(f"{row.name}: {name}", lambda: question.compute(case, row, window), without)


def rank(table: ranking.Table, rows: Sequence[Row]) -> ranking.Ranking:
    """Who is best and worst in each column; values of ranked rows move to the units that all of them have."""
    from attlog.metrics import ranking

    return ranking.rank(table, rows, definitions())
