"""Can the compasses be trusted? Every one against the earth's field, by an attitude that no compass had part in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from attlog.health.assessments.compass import choice, motors, offset, soft_iron
from attlog.health.assessments.compass.figures import FieldHistory, Interference, field_against_expected, interference
from attlog.health.assessments.compass.study import studies
from attlog.health.assessments.model import Assessment, HealthCase, unknown

__all__ = ["QUESTIONS", "FieldHistory", "Interference", "assessed", "field_against_expected", "interference"]


def assessed(case: HealthCase) -> list[Assessment]:
    """Offset, motors and soft iron of each compass, and which one to use; nothing without any compass."""
    log = case.log
    if not log.mags:
        return []
    used = log.mags[log.mag or 0].field.source
    found, why = studies(case)
    if not found:
        offsets = unknown(used, offset.OFFSET, why, offset.LIMIT, offset.SOURCE)
        return [offsets, *motors.by_size(case, used), *choice.assessed(case, [])]
    # One that is switched off misleads nothing; where it is the better one, the choice tells its numbers.
    judged = [study for study in found if study.samples.mag.enabled] or found
    answers = [offset.assessed(case, study) for study in judged]
    answers += motors.advised([motors.assessed(case, study) for study in judged], judged)
    answers += [soft_iron.assessed(study) for study in judged]
    answers = [answer if answer.sensor == used else spare(answer) for answer in answers]
    return once(answers) + choice.assessed(case, found)


def spare(answer: Assessment) -> Assessment:
    """Of a compass that is not in use: no fault, because the vehicle did not fly by it."""
    return replace(answer, verdict="warning") if answer.verdict == "fault" else answer


def once(answers: list[Assessment]) -> list[Assessment]:
    """Without what is unknown of another compass for the same reason."""
    said: set[str] = set()
    kept = []
    for answer in answers:
        if answer.verdict != "unknown" or answer.text not in said:
            kept.append(answer)
        if answer.verdict == "unknown":
            said.add(answer.text)
    return kept


QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {"compass": assessed}
"""By name, in the order of the table."""
