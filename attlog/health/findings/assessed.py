"""What do the assessments of sensors add to the findings? A cause that no check told, and what should be set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from attlog.health.assessments.model import Assessment
from attlog.health.assessments.offered import offered, sentence
from attlog.health.assessments.topics import TOPICS
from attlog.health.findings.finding import Finding

TROUBLE = ("warning", "fault")
"""Verdicts of which a finding is made: what is unknown is none."""


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
    """What should be set, a sentence for each kind of finding; values that questions dispute are left out."""
    agreed = {setting.name for setting in offered(health)}
    kinds: dict[str, list[Assessment]] = {}
    for assessment in troubles(health):
        if assessment.settings and all(setting.name in agreed for setting in assessment.settings):
            kinds.setdefault(TOPICS[assessment.question].finding, []).append(assessment)
    return {kind: sentence(offered(same)) for kind, same in kinds.items()}


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
        action=assessment.action or sentence(assessment.settings) or assessment.why_no_setting,
    )
