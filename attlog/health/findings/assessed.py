"""What do the assessments of sensors add to the findings? A cause that no check told, and what should be set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from attlog.health.assessments.model import Assessment
from attlog.health.assessments.offered import offered, sentence
from attlog.health.assessments.topics import TOPICS
from attlog.health.findings.finding import Finding

TROUBLE = ("warning", "fault")
"""Verdicts of which a finding is made: what is unknown is none."""
SURER = ("compass",)
"""Kinds whose assessments know more of the cause than checks: a calibration mends no field of motors. What they say is
to be done wins also without values to set."""


def with_assessments(signs: Iterable[Finding], health: Iterable[Assessment]) -> list[Finding]:
    """The signs, and one for each assessment that is not ok and whose kind no check has called trouble.

    Where a check has, its sentence stands; the number of the assessment stands in the table of sensors.
    """
    told = list(signs)
    known = {sign.kind for sign in told if sign.is_trouble}
    return told + [sign for sign in map(_sign, troubles(health)) if sign.kind not in known]


def troubles(health: Iterable[Assessment]) -> list[Assessment]:
    """The assessments that are faults or warnings: first those with something to set, so that a finding's sentence and
    its action are of one sensor, then faults."""
    found = [a for a in health if a.verdict in TROUBLE and a.question in TOPICS]
    return sorted(found, key=lambda a: (not a.settings, -TROUBLE.index(a.verdict)))


def actions_of(health: Sequence[Assessment]) -> dict[str, str]:
    """What should be set, or done, for each kind of finding; values that questions dispute are left out."""
    agreed = {setting.name for setting in offered(health)}
    to_set: dict[str, dict[str, None]] = {}
    to_do: dict[str, str] = {}
    for found in troubles(health):
        kind = TOPICS[found.question].finding
        if found.settings and all(setting.name in agreed for setting in found.settings):
            to_set.setdefault(kind, {})[_to_set(found)] = None
        elif found.action and kind in SURER:
            to_do.setdefault(kind, found.action)
    return to_do | {kind: " ".join(sentences) for kind, sentences in to_set.items()}


def _to_set(found: Assessment) -> str:
    """The question's own words where they name each parameter, such as a suggestion; else what to set."""
    named = found.action and all(setting.name in found.action for setting in found.settings)
    return found.action if named else sentence(found.settings)


def _sign(assessment: Assessment) -> Finding:
    """An assessment as a sign of its kind of finding. A fault is a warning, as that of a check of a sensor."""
    return Finding(
        TOPICS[assessment.question].finding,
        "warning",
        assessment.text,
        t=assessment.t,
        value=assessment.value,
        unit=assessment.unit if assessment.value is not None else "",
        about=assessment.question,
        evidence=list(assessment.evidence),
        action=_to_set(assessment) or assessment.action or assessment.why_no_setting,
    )
