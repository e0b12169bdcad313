"""The questions asked of every row, one file each, and the way to ask them all."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

from attlog.metrics import drift_rest, noise, rmse
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Metric, Trial, Witness
from attlog.metrics.trace import Trace
from attlog.reference.model import Row

__all__ = ["Answer", "Metric", "Trace", "Trial", "Witness", "compute", "definitions", "missing"]

QUESTIONS: tuple[ModuleType, ...] = (noise, drift_rest, rmse)


def definitions() -> dict[str, Metric]:
    """Every metric by its id, in the order of the table."""
    return {metric.name: metric for question in QUESTIONS for metric in question.METRICS}


def compute(trial: Trial, row: Row, windows: Sequence[str]) -> dict[str, dict[str, Answer]]:
    """Answers of one row: window -> metric id -> Answer. A metric that means nothing in a window is left out there."""
    return {
        window: {
            name: answer for question in QUESTIONS for name, answer in question.compute(trial, row, window).items()
        }
        for window in windows
    }
