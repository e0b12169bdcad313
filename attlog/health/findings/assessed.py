"""What do the assessments of sensors add to the findings? A cause that no check told, and what should be set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from attlog.health.assessments.model import Assessment
from attlog.health.assessments.offered import offered, sentence
from attlog.health.assessments.topics import ACCELEROMETER, GYRO_BIAS, TOPICS
from attlog.health.findings import compass
from attlog.health.findings.finding import Finding, Weight

TROUBLE = ("warning", "fault")
"""Verdicts of which a finding is made: what is unknown is none."""
SURER = ("compass",)
"""Kinds whose assessments know more of the cause than checks: a calibration mends no field of motors. What they say is
to be done wins also without values to set."""
RATE = "deg/s"
"""IMUs that differ by a rate differ in their gyros."""
CAUSES = {
    "compass_motors": compass.CHECKS["field against motors"].cause,
    "compass_offset": compass.CHECKS["compass offset"].cause,
    "compass_choice": "The compass in use is disturbed or badly calibrated; another one is not.",
}
"""Why a compass is wrong, by the question that says what to do about it."""


@dataclass(frozen=True, slots=True)
class Advice:
    """What should be done for a kind of finding, and the cause that it mends (empty: that of the checks)."""

    action: str
    cause: str = ""


def with_assessments(
    signs: Iterable[Finding], health: Iterable[Assessment], others: Sequence[Assessment] = ()
) -> list[Finding]:
    """The signs, and one for each assessment that is not ok and whose kind no check has called trouble.

    Where a check has, its sentence stands, and assessments that are surer of the cause are its evidence. ``others``:
    assessments of sensors that are not in use, which are notes.
    """
    told = list(signs)
    known = {sign.kind for sign in told if sign.is_trouble}
    mine = [_sign(a) for a in troubles(health)]
    told += [sign for sign in mine if sign.kind not in known or sign.kind in SURER]
    known |= {sign.kind for sign in mine}
    spare = [_sign(a, "note") for a in troubles(others)]
    return told + [sign for sign in spare if sign.kind not in known]


def kind_of(assessment: Assessment) -> str:
    """The kind of finding that an assessment belongs to."""
    kind = TOPICS[assessment.question].finding
    return GYRO_BIAS if kind == ACCELEROMETER and assessment.unit == RATE else kind


def troubles(health: Iterable[Assessment]) -> list[Assessment]:
    """The assessments that are faults or warnings: first those with something to set, so that a finding's sentence and
    its action are of one sensor, then faults."""
    found = [a for a in health if a.verdict in TROUBLE and a.question in TOPICS]
    return sorted(found, key=lambda a: (not a.settings, -TROUBLE.index(a.verdict)))


def advice_of(health: Sequence[Assessment]) -> dict[str, Advice]:
    """What should be set, or done, for each kind of finding; values that questions dispute are left out."""
    agreed = {setting.name for setting in offered(health)}
    to_set: dict[str, dict[str, str]] = {}
    to_do: dict[str, Advice] = {}
    for found in troubles(health):
        kind = kind_of(found)
        if found.settings and all(setting.name in agreed for setting in found.settings):
            to_set.setdefault(kind, {})[_to_set(found)] = CAUSES.get(found.question, "")
        elif found.action and kind in SURER:
            to_do.setdefault(kind, Advice(found.action, CAUSES.get(found.question, "")))
    return to_do | {kind: Advice(" ".join(told), next(iter(told.values()))) for kind, told in to_set.items()}


def _to_set(found: Assessment) -> str:
    """The question's own words where they name each parameter, such as a suggestion; else what to set."""
    named = found.action and all(setting.name in found.action for setting in found.settings)
    return found.action if named else sentence(found.settings)


def explained(sign: Finding, answer: Assessment | None) -> Finding:
    """The sign of a check, without cause and action where its answer knows none: motors that turn no heading."""
    return replace(sign, cause="", action="") if answer is not None and _is_harmless(answer) else sign


def _is_harmless(found: Assessment) -> bool:
    return found.question == "compass_motors" and not (found.action or found.settings)


def _sign(assessment: Assessment, severity: Weight = "warning") -> Finding:
    """An assessment as a sign of its kind of finding. A fault is a warning, as that of a check of a sensor: what is
    serious is an attitude that it made wrong, which another check shows."""
    return Finding(
        kind_of(assessment),
        severity,
        assessment.text,
        t=assessment.t,
        value=assessment.value,
        unit=assessment.unit if assessment.value is not None else "",
        about=assessment.question,
        evidence=list(assessment.evidence),
        cause="" if _is_harmless(assessment) else CAUSES.get(assessment.question, ""),
        action=_to_set(assessment) or assessment.action or assessment.why_no_setting,
    )
