"""Can these sensors be trusted, and what should be set? One file per question; each answers with assessments."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from attlog.base.barrier import guarded
from attlog.health.assessments import compass
from attlog.health.assessments.model import Assessment, HealthCase, MotionAttitude, Setting, Verdict, unknown

__all__ = ["Assessment", "HealthCase", "MotionAttitude", "Setting", "Verdict", "assess", "unknown"]

QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {"compass": compass.assessed}
"""By name, in the order of the table: each gives no, one or several assessments."""


def assess(case: HealthCase) -> list[Assessment]:
    """Every question about the sensors of a log, in a fixed order; one that ends in a bug is unknown and says so."""
    found: list[Assessment] = []
    for name, answer in QUESTIONS.items():
        failed = partial(_failed, name)
        found += guarded(f"The question {name}", partial(answer, case), failed)
    return found


def _failed(name: str, sentence: str) -> list[Assessment]:
    return [unknown("", name.replace(" ", "_"), sentence)]
