"""Metrics of every row: registry, computation and ranking."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from attlog.core.errors import call_guarded
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, missing
from attlog.reference.model import HeadingReference, Track

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
    "MetricGroup",
    "Trace",
    "compute",
    "definitions",
    "finish",
    "groups",
    "missing",
    "rank",
]

# Files with a tuple METRIC_GROUPS, in the order of the table; imported at first use.
FILES = ("noise", "lag", "step_error", "drift", "accuracy", "heading", "allan", "setpoint", "rerun")
LATE = {"Drawing": "traces", "Trace": "trace"}
FULL_COVERAGE_PCT = 95.0  # answers report a coverage below this


@cache
def groups() -> tuple[MetricGroup, ...]:
    """Return all metric groups except cost, in the order of the table."""
    return tuple(q for name in FILES for q in import_module(f"{__name__}.{name}").METRIC_GROUPS)


def __getattr__(name: str) -> Any:
    if name not in LATE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{LATE[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


@cache
def definitions() -> dict[str, Metric]:
    """Return every metric by its id, in the order of the table."""
    from attlog.metrics.cost import COST

    return {metric.name: metric for group in (*groups(), COST) for metric in group.metrics}


def compute(
    case: Case, row: Track, windows: Sequence[str], *, only: Collection[str] = ()
) -> dict[str, dict[str, Answer]]:
    """Return the answers of one row: window -> metric id -> Answer.

    Metrics that do not apply to a window are left out. ``only``: metrics by id or by the part before the dot; others of
    the same group come too. A row that gravity does not correct is never ranked.
    """
    from attlog.metrics import following
    from attlog.metrics.ranking import withdraw_uncertain

    table: dict[str, dict[str, Answer]] = {}
    asked = [q for q in groups() if not only or _is_of(q, only)]
    partly = row.coverage_pct is not None and row.coverage_pct < FULL_COVERAGE_PCT
    uncorrected = following.why_uncorrected(case, row)
    for window in windows:
        answers = table.setdefault(window, {})
        for group in asked:
            answers |= _ask(group, case, row, window)
            for metric in group.metrics:
                if metric.name in answers:
                    withdraw_uncertain(metric, answers[metric.name])
                    if partly and metric.covers:
                        answers[metric.name].coverage_pct = row.coverage_pct
        for answer in answers.values():
            if uncorrected and answer.ranked:
                answer.ranked, answer.reason = False, uncorrected
    return table


def finish(
    case: Case, table: Mapping[str, dict[str, dict[str, Answer]]], *, cost: bool = True, only: Collection[str] = ()
) -> None:
    """Complete the answers of ``case.rows`` once all rows are computed.

    ``table``: answers by row name. Decides which errors are ranked. ``cost``: add the processor time of each filter.
    """
    from attlog.metrics import accuracy
    from attlog.metrics.cost import COST

    accuracy.rank_errors(case)
    if cost and (not only or _is_of(COST, only)):
        for row in case.rows:
            for window, answers in table[row.name].items():
                answers |= _ask(COST, case, row, window)


def _is_of(group: MetricGroup, wanted: Collection[str]) -> bool:
    return any(m.name in wanted or m.name.partition(".")[0] in wanted for m in group.metrics)


def _ask(group: MetricGroup, case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the answers of one group; for an exception, its reason."""

    def failed(sentence: str) -> dict[str, Answer]:
        return group.without("part_failed", sentence, window)

    return call_guarded(f"{row.name}: {group.name}", lambda: group.ask(case, row, window), failed)


def rank(table: ranking.Table, rows: Sequence[Track]) -> ranking.Ranking:
    """Return the best and worst row of each column.

    Values of ranked rows are recomputed on their common units.
    """
    from attlog.metrics import ranking

    return ranking.rank(table, rows, definitions())
