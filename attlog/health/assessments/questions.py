"""Every question about the sensors of a log, in the order of the table."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from attlog.base.barrier import guarded
from attlog.health.assessments import compass, inertial, onboard, vibration
from attlog.health.assessments.model import Assessment, HealthCase, finite, unknown
from attlog.segments.once import once

QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {
    **compass.QUESTIONS,
    **inertial.QUESTIONS,
    **vibration.QUESTIONS,
    **onboard.QUESTIONS,
}
"""By name: each gives no, one or several assessments, with ids of :data:`attlog.health.assessments.TOPICS`."""


def assess(case: HealthCase) -> list[Assessment]:
    """Every question about the sensors of a log, in a fixed order; one that ends in a bug is unknown and says so."""
    found: list[Assessment] = []
    with once():
        for name, answer in QUESTIONS.items():
            failed = partial(_failed, name)
            found += guarded(f"The question {name}", partial(answer, case), failed)
    return list(map(finite, found))


def _failed(name: str, sentence: str) -> list[Assessment]:
    return [unknown("", name.replace(" ", "_"), sentence)]
