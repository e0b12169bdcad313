"""Rows and their answers: where a question is looked up, in which order rows stand, who may be called best."""

from __future__ import annotations

import math

from attlog.result import Answer, EstimatorRow, Result

REST = ("rest", "rest.long", "all")
AIR = ("airborne", "all", "armed")
ALL = ("all", "airborne", "rest")
"""Windows in which a question is looked up, the first with a value counts."""


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


def is_ranked(row: EstimatorRow, answer: Answer) -> bool:
    """Whether this row may be called best or worst by this answer: a sound replay that follows motion."""
    return row.kind == "replay" and row.status == "ok" and answer.ranked


def is_best(result: Result, row: EstimatorRow, metric: str, window: str) -> bool:
    """Whether the row shares the lead of a metric in a window."""
    return row.name in result.best.get(window, {}).get(metric, ())


def leads(result: Result, name: str) -> int:
    """How often a row is marked best, over all windows and metrics."""
    return sum(name in rows for metrics in result.best.values() for rows in metrics.values())


def ordered(result: Result) -> list[EstimatorRow]:
    """Rows as people see them: what flew, the filters, other onboard rows."""
    return sorted(result.estimators, key=lambda r: (not (r.is_reference or r.name == "onboard"), r.kind != "replay"))
