"""Do the assessments of a log's sensors keep what a gate allows? Verdicts no worse than one, values within limits.

A question that the log cannot answer, or that nobody asked, fails its gate, unless the gate says that unknown passes:
then it is skipped, and never counted as passed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from attlog.compare.gates.limits import GateLimit
from attlog.compare.gates.limits import judged as limit_judged
from attlog.compare.gates.outcome import Cause, GateOutcome, Status
from attlog.compare.gates.text import beyond_limit_text, with_unit
from attlog.present.numbers import quantity
from attlog.result import Answer, Assessment

NO_SENSOR = "sensors"
"""In place of a sensor where a log has no assessment that a gate means."""
ALLOWED = ("ok", "warning")
"""Worst verdicts that a gate can allow, the better first; a fault is the third."""


@dataclass(frozen=True, slots=True)
class SensorGate:
    """A line of ``[gates.health]``: limits on the value of a question, and the worst verdict allowed.

    ``sensors``: names or patterns of the sensors that are meant, None for all. ``unknown_passes``: what cannot be
    told is skipped.
    """

    question: str
    limits: tuple[GateLimit, ...] = ()
    worst: str | None = None
    sensors: tuple[str, ...] | None = None
    unknown_passes: bool = False


def judged(gate: SensorGate, health: Iterable[Assessment]) -> list[GateOutcome]:
    """What a gate says of the assessments of a log: an outcome for each sensor and limit."""
    asked = [a for a in health if a.question == gate.question and _meant(gate.sensors, a.sensor)]
    checks: list[GateLimit | str] = [*gate.limits, *([] if gate.worst is None else [gate.worst])]
    if not asked:
        named = "" if gate.sensors is None else f" for {' or '.join(gate.sensors)}"
        why = f"the log has no answer to {gate.question}{named}"
        return [_unanswered(gate, check, ", ".join(gate.sensors or (NO_SENSOR,)), why) for check in checks]
    return [outcome for assessment in asked for outcome in _of_sensor(gate, checks, assessment)]


def _meant(patterns: Sequence[str] | None, sensor: str) -> bool:
    return patterns is None or any(fnmatchcase(sensor, pattern) for pattern in patterns)


def _of_sensor(gate: SensorGate, checks: Iterable[GateLimit | str], found: Assessment) -> Iterator[GateOutcome]:
    sensor = found.sensor or NO_SENSOR
    for check in checks:
        if found.verdict == "unknown":
            yield _unanswered(gate, check, sensor, f"{sensor}: {gate.question} is unknown: {found.text}")
        elif isinstance(check, str):
            yield _of_verdict(gate, check, sensor, found)
        elif found.value is None:
            yield _unanswered(gate, check, sensor, f"{sensor}: {gate.question} has no value: {found.text}")
        else:
            yield _of_value(gate, check, sensor, found, found.value)


def _of_verdict(gate: SensorGate, worst: str, sensor: str, found: Assessment) -> GateOutcome:
    place = {verdict: k for k, verdict in enumerate((*ALLOWED, "fault"))}
    beyond = place[found.verdict] - place[worst]
    text = f"{sensor}: {gate.question} is {found.verdict}, at worst {worst}: {found.text}"
    return _outcome(gate, worst, sensor, found, beyond > 0, 1.0 + beyond, text)


def _of_value(gate: SensorGate, limit: GateLimit, sensor: str, found: Assessment, value: float) -> GateOutcome:
    size = abs(value) if limit.kind == "max" else value
    verdict = limit_judged(limit, gate.question, "", Answer(size, found.unit))
    word = "most" if limit.kind == "max" else "least"
    unit = with_unit(found.unit)
    shown = beyond_limit_text(value, limit.value, quantity(value, found.unit), unit)
    text = f"{sensor}: {gate.question} {shown}, at {word} {limit.value:g}{unit}"
    return _outcome(gate, limit, sensor, found, not verdict.passed, verdict.excess, text)


def _outcome(
    gate: SensorGate, check: GateLimit | str, sensor: str, found: Assessment, failed: bool, excess: float, text: str
) -> GateOutcome:
    allowed = check.value if isinstance(check, GateLimit) else None
    status: Status = "failed" if failed else "passed"
    cause: Cause | None = "limit" if failed else None
    return GateOutcome(
        sensor, name_of(gate, check), gate.question, "", status, cause, found.value, found.unit, allowed, excess, text
    )


def _unanswered(gate: SensorGate, check: GateLimit | str, sensor: str, why: str) -> GateOutcome:
    status: Status = "skipped" if gate.unknown_passes else "failed"
    return GateOutcome(
        sensor, name_of(gate, check), gate.question, "", status, "unanswered", None, "", None, math.inf, why
    )


def name_of(gate: SensorGate, check: GateLimit | str) -> str:
    """A check as in the file: ``health.compass_offset max=5``, ``health.notch verdict=warning``."""
    return f"health.{gate.question} {check if isinstance(check, GateLimit) else f'verdict={check}'}"
