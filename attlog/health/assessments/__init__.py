"""Can these sensors be trusted, and what should be set? One file per question; each answers with assessments."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from attlog.base.barrier import guarded
from attlog.health.assessments import compass, inertial, onboard, vibration
from attlog.health.assessments.model import Assessment, HealthCase, MotionAttitude, Setting, Verdict, finite, unknown
from attlog.health.assessments.offered import offered
from attlog.health.assessments.topics import TOPICS, SensorQuestion

__all__ = [
    "TOPICS",
    "Assessment",
    "HealthCase",
    "MotionAttitude",
    "SensorQuestion",
    "Setting",
    "Verdict",
    "assess",
    "offered",
    "unknown",
]

QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {
    **compass.QUESTIONS,
    **inertial.QUESTIONS,
    **vibration.QUESTIONS,
    **onboard.QUESTIONS,
}
"""By name, in the order of the table: each gives no, one or several assessments, with ids of :data:`TOPICS`."""


def assess(case: HealthCase) -> list[Assessment]:
    """Every question about the sensors of a log, in a fixed order; one that ends in a bug is unknown and says so."""
    found: list[Assessment] = []
    for name, answer in QUESTIONS.items():
        failed = partial(_failed, name)
        found += guarded(f"The question {name}", partial(answer, case), failed)
    return list(map(finite, found))


def _failed(name: str, sentence: str) -> list[Assessment]:
    return [unknown("", name.replace(" ", "_"), sentence)]
