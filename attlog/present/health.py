"""Can the sensors be trusted, and what should be set? The assessments of a result in words: rows, values, settings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from attlog.present.numbers import half_width, interval, number, quantity, unit_sign
from attlog.present.text import clean, typeset
from attlog.result import TOPICS, Assessment, Setting, setting_number

VERDICTS = ("fault", "warning", "ok", "unknown")
"""Worst first; what cannot be told comes last."""
LOPSIDED = 0.25
"""An interval whose middle is off the value by more than this share of its half width is written as two ends."""
COUNTED = ("satellites", "samples")
"""Units of whole numbers."""


@dataclass(frozen=True, slots=True)
class ShownAssessment:
    """An assessment as a row of a table: ``why`` are its sentences, ``to_set`` values, else what to do, or why nothing.

    ``offers``: there are values.
    """

    sensor: str
    question: str
    verdict: str
    value: str
    to_set: str
    text: str
    why: tuple[str, ...] = ()
    offers: bool = False


def shown_assessments(health: Iterable[Assessment]) -> list[ShownAssessment]:
    """The assessments as they are shown: faults, warnings, what is ok, what cannot be told; else in their order."""
    return [_shown(assessment) for assessment in sorted(health, key=lambda a: VERDICTS.index(a.verdict))]


def question_title(question: str) -> str:
    """A question in words."""
    return TOPICS[question].title if question in TOPICS else clean(question.replace("_", " "))


def value_text(assessment: Assessment) -> str:
    """The value with its unit and 95 % interval: ``15.1 ± 2.0 µT``, ``0.4 (0.1 to 1.9) m/s²``; empty without one."""
    unit, ci95 = assessment.unit, assessment.ci95
    value = number(assessment.value, unit)
    if value and unit in COUNTED:
        return f"{assessment.value:,.0f} {unit}"
    if not value or ci95 is None or not interval(ci95, unit):
        return quantity(assessment.value, unit)
    sign = unit_sign(unit)
    end = sign if sign.startswith(("°", "×")) or not sign else f" {sign}"
    middle, half = 0.5 * (ci95[0] + ci95[1]), 0.5 * (ci95[1] - ci95[0])
    if abs(middle - (assessment.value or 0.0)) > LOPSIDED * abs(half):
        return f"{value} ({interval(ci95, unit)}){end}"
    return f"{value} {half_width(ci95, unit).replace('±', '± ')}{end}"


def change(setting: Setting) -> str:
    """What to set: ``COMPASS_OFS_X -12 -> 145``; the new value alone where the log does not hold the old one.

    In signs that every terminal has, because values are typed or pasted from here.
    """
    old = "" if setting.old is None else f" {setting_number(setting.old)} ->"
    return f"{clean(setting.name)}{old} {setting_number(setting.new)}"


def changes(settings: Sequence[Setting], most: int) -> str:
    """What to set in one line, at most so many by name."""
    rest = len(settings) - most
    listed = ", ".join(change(setting) for setting in settings[:most])
    return f"{listed} and {rest} more" if rest > 0 else listed


def _shown(assessment: Assessment) -> ShownAssessment:
    settings = ", ".join(change(setting) for setting in assessment.settings)
    why = [assessment.text, *assessment.evidence]
    if assessment.action and not settings and assessment.why_no_setting not in ("", assessment.action):
        why.insert(1, assessment.why_no_setting)
    if assessment.threshold:
        why.append(f"Limit: {assessment.threshold}{f' ({assessment.source})' if assessment.source else ''}.")
    return ShownAssessment(
        clean(assessment.sensor),
        question_title(assessment.question),
        assessment.verdict,
        value_text(assessment),
        settings or typeset(assessment.action or assessment.why_no_setting),
        typeset(assessment.text),
        tuple(typeset(sentence) for sentence in why),
        bool(assessment.settings),
    )
