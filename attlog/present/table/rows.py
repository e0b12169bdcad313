"""Rows and their answers: where a question is looked up, in which order rows stand, who may be called best."""

from __future__ import annotations

import math

from attlog.result import Answer, EstimatorRow, Result

REST = ("rest", "rest.long", "all")
AIR = ("airborne", "all", "armed")
ALL = ("all", "airborne", "rest")
"""Windows in which a question is looked up; the first in which a filter has an answer counts for all rows."""

PHASES = ("rest", "hover", "cruise", "idle")
"""Where noise is looked up, never pooled; the first with an answer leads."""

BASELINE = "gyro"
"""The estimator that nothing corrects: it is drawn beside the others and wins nothing."""


def window_of(result: Result, metric: str, windows: tuple[str, ...]) -> str:
    """The one window of a column: the first in which a filter has a value, else any row, else any answer."""
    for wanted in (_filters, _rows):
        for window in windows:
            if any(has_value(row.metrics.get(window, {}).get(metric)) for row in wanted(result)):
                return window
    known = (w for w in windows if any(metric in row.metrics.get(w, {}) for row in result.estimators))
    return next(known, windows[0])


def _filters(result: Result) -> list[EstimatorRow]:
    return [row for row in result.estimators if row.kind == "replay" and not is_baseline(row)]


def _rows(result: Result) -> list[EstimatorRow]:
    return result.estimators


def find(row: EstimatorRow, metric: str, windows: tuple[str, ...]) -> Answer | None:
    """The row's answer in the first of the windows that has it, one with a value preferred."""
    answers = [row.metrics[w][metric] for w in windows if metric in row.metrics.get(w, {})]
    return next((a for a in answers if a.value is not None), answers[0] if answers else None)


def value_of(answer: Answer) -> float:
    """The value as a float, NaN where there is none."""
    return math.nan if answer.value is None else float(answer.value)


def has_value(answer: Answer | None) -> bool:
    """Whether there is a number to show."""
    return answer is not None and math.isfinite(value_of(answer))


def is_baseline(row: EstimatorRow) -> bool:
    """Whether this row only integrates the gyro."""
    return row.kind == "replay" and row.estimator == BASELINE


def is_ranked(result: Result, row: EstimatorRow, metric: str, window: str) -> bool:
    """Whether this row was compared with others: only then may it be called best or worst."""
    return not is_baseline(row) and row.name in result.ranked.get(window, {}).get(metric, ())


def is_best(result: Result, row: EstimatorRow, metric: str, window: str) -> bool:
    """Whether no row is significantly better than this one, and at least one significantly worse."""
    return not is_baseline(row) and row.name in result.best.get(window, {}).get(metric, ())


def leads(result: Result, name: str) -> int:
    """How often a row is marked best, over all windows and metrics."""
    return sum(name in rows for metrics in result.best.values() for rows in metrics.values())


def ordered(result: Result) -> list[EstimatorRow]:
    """Rows as people see them: what flew, the filters, the baseline, other onboard rows."""

    def place(row: EstimatorRow) -> int:
        if row.is_reference or row.name == "onboard":
            return 0
        return 1 if row.kind == "replay" and not is_baseline(row) else 2 if row.kind == "replay" else 3

    return sorted(result.estimators, key=place)
