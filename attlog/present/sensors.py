"""Can the sensors be trusted, and what should be set: assessments as they are shown, the worst first."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from attlog.present.numbers import MINUS, decimals, duration, interval, listed, number, quantity
from attlog.present.text import typeset

if TYPE_CHECKING:
    from attlog.result import Assessment, Check, Result

ORDER = {"fault": 0, "warning": 1, "unknown": 2, "ok": 3}
ABBREVIATIONS = {"gnss": "GNSS", "imu": "IMU", "imus": "IMUs", "gyro": "gyro"}
TITLES = {
    "compass_offset": "Compass offset",
    "compass_motors": "Motors’ field",
    "compass_choice": "Which compass",
    "soft_iron": "Soft iron",
    "innovations": "Test ratios of aids",
    "lanes": "Which lane",
    "notch": "Notch filters",
    "vibration_level": "Vibration",
}
"""Questions whose id does not say it well."""


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A parameter to set: its name, its value when the log was flown (empty where unknown) and the new one."""

    name: str
    old: str
    new: str


@dataclass(frozen=True, slots=True)
class SensorAnswer:
    """An answer as it is shown. ``value`` with its unit, ``ci`` its 95 % interval, ``axes`` x, y, z where it has any.

    ``advice``: what to do where there is nothing to set; ``why``: evidence, extent, limit with source, a line each.
    """

    sensor: str
    title: str
    verdict: str
    text: str
    value: str
    ci: str
    axes: tuple[str, ...]
    settings: tuple[ParameterChange, ...]
    advice: str
    why: tuple[str, ...]
    t: float | None


@dataclass(frozen=True, slots=True)
class SensorAnswers:
    """All answers: ``trouble`` (faults, then warnings), what is ``ok``, what is ``unknown``; ``summary`` of all."""

    trouble: list[SensorAnswer]
    ok: list[SensorAnswer]
    unknown: list[SensorAnswer]

    @property
    def ok_titles(self) -> str:
        """The questions that are ok in one line, each once."""
        return listed(list(dict.fromkeys(f"{one.title} {one.sensor}".strip() for one in self.ok)))


def health(result: Result) -> SensorAnswers:
    """The assessments of a result as they are shown."""
    found = [_shown(one) for one in sorted(result.health, key=lambda one: ORDER.get(one.verdict, 2))]
    by = {verdict: [one for one in found if one.verdict == verdict] for verdict in ORDER}
    return SensorAnswers([*by["fault"], *by["warning"]], by["ok"], by["unknown"])


def checks_by_trouble(checks: list[Check]) -> tuple[list[Check], list[Check]]:
    """Checks that found something (faults first), and the others."""
    trouble = [c for c in checks if c.verdict in ("fault", "warning")]
    return sorted(trouble, key=lambda c: ORDER[c.verdict]), [c for c in checks if c not in trouble]


def title(question: str) -> str:
    """A question's id in words: ``gnss_delay`` is GNSS delay."""
    if question in TITLES:
        return TITLES[question]
    words = [ABBREVIATIONS.get(word, word) for word in re.split(r"[_\s]+", question) if word]
    return " ".join([words[0][:1].upper() + words[0][1:], *words[1:]]) if words else "Question"


def _shown(one: Assessment) -> SensorAnswer:
    ci = interval(one.ci95, one.unit)
    extent = [f"n = {one.n:,}"] if one.n else []
    extent += [f"over {duration(one.seconds)}"] if one.seconds > 0 else []
    limit = f"{one.threshold} ({one.source})" if one.threshold and one.source else one.threshold or one.source
    lines = [*one.evidence, " ".join(extent), f"Limit: {limit}" if limit else ""]
    if one.settings:  # what to set is the action
        lines = [one.action, *lines]
    advice = "" if one.settings else " ".join(text for text in (one.action, one.why_no_setting) if text)
    return SensorAnswer(
        one.sensor,
        title(one.question),
        one.verdict if one.verdict in ORDER else "unknown",
        typeset(one.text),
        quantity(one.value, one.unit),
        ci,
        tuple(_axis(*pair, one.unit) for pair in zip("xyz", _pairs(one), strict=False)),
        tuple(ParameterChange(s.name, _plain(s.old), _plain(s.new)) for s in one.settings),
        typeset(advice),
        tuple(typeset(text) for text in lines if text),
        one.t,
    )


def _pairs(one: Assessment) -> list[tuple[float, float | None]]:
    halves = one.vector_ci95 if len(one.vector_ci95) == len(one.vector) else [None] * len(one.vector)
    return list(zip(one.vector, halves, strict=True))


def _axis(name: str, pair: tuple[float, float | None], unit: str) -> str:
    value, half = pair
    if half is None or not (math.isfinite(value) and math.isfinite(half)):
        return f"{name} {number(value, unit)}".rstrip()
    places = decimals(max(abs(value), half), unit)
    return f"{name} {value:.{places}f} ± {half:.{places}f}".replace("-", MINUS)


def _plain(value: float | None) -> str:
    """A parameter's value with the digits that a vehicle keeps, in signs that can be pasted into a ground station."""
    return "" if value is None else f"{value:.6g}"
