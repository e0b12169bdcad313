"""A finding: one cause of trouble in a log, however many checks, reports and events speak of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from attlog.flight.model import Problem, Severity
from attlog.flight.remedies import Fault
from attlog.story.event import Event

Weight = Literal["serious", "warning", "note", "info"]
ORDER: tuple[Weight, ...] = ("serious", "warning", "note", "info")
"""Worst first."""
WEIGHTS: Mapping[Severity, Weight] = {"error": "serious", "warning": "warning", "note": "note", "info": "info"}
"""Of a reader's problem."""
APART = ("part_failed", "estimator_failed", "estimator_timed_out")
"""Kinds of which each sign has a cause of its own."""
BY_SIZE = ("hard_landing", "estimator")
"""Kinds whose signs have one unit (g of a blow, s of a rejection), so that the largest leads."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One cause (``kind``) in a sentence: what, how much, from when; its evidence, and one action on this vehicle.

    ``t`` to ``t_end`` s is when, or ``offset`` bytes where in the file; ``count`` how often; ``value`` in ``unit`` the
    size. ``about``: the angle (tilt, heading) or the sensor that it speaks of. ``cause`` and ``action`` are empty where
    nobody knows.
    """

    kind: str
    severity: Weight
    text: str
    t: float | None = None
    t_end: float | None = None
    offset: int | None = None
    count: int = 1
    value: float | None = None
    unit: str = ""
    about: str = ""
    evidence: list[str] = field(default_factory=list)
    cause: str = ""
    action: str = ""

    @property
    def is_trouble(self) -> bool:
        """Whether it is worth a pilot's time: serious, or a warning."""
        return self.severity in ("serious", "warning")


@dataclass(frozen=True, slots=True)
class Explanation:
    """What a check that is not ok means: of which finding it is a sign, how bad, why that is, what mends it."""

    kind: str
    as_warning: Weight = "warning"
    as_fault: Weight = "warning"
    cause: str = ""
    fault: Fault | None = None


def of_problem(problem: Problem, kind: str = "") -> Finding:
    """What a reader, the autopilot's records or the analysis found, as a sign of ``kind`` (its code where empty)."""
    return Finding(
        kind or problem.code,
        WEIGHTS[problem.severity],
        problem.text,
        t=None if problem.t is None or abs(problem.t) >= 1e12 else problem.t,
        offset=problem.offset,
        count=problem.count,
        value=problem.value,
        unit=problem.unit,
        cause=problem.cause,
        action=problem.remedy,
    )


def of_event(event: Event, kind: str) -> Finding:
    """What happened, as a sign of ``kind``."""
    return Finding(
        kind,
        event.severity,
        event.text,
        t=event.t,
        t_end=event.t_end,
        value=event.value,
        unit=event.unit,
        evidence=list(event.evidence),
    )


def merged(signs: Iterable[Finding]) -> list[Finding]:
    """One finding for each kind, in the order of their first sign.

    The worst sign leads, the largest or the first of equals: its sentence is the finding's, others are evidence.
    """
    kinds: dict[tuple[str, str], list[Finding]] = {}
    for sign in signs:
        kinds.setdefault((sign.kind, sign.text if sign.kind in APART else ""), []).append(sign)
    return [_one(same) for same in kinds.values()]


def _rank(sign: Finding) -> tuple[int, float]:
    """The place of a sign among those of its kind: the worse, then the larger, the earlier."""
    return ORDER.index(sign.severity), -(sign.value or 0.0) if sign.kind in BY_SIZE else 0.0


def _one(same: list[Finding]) -> Finding:
    lead = min(same, key=_rank)
    others = [sign for sign in same if sign is not lead]
    texts = [*lead.evidence, *(text for sign in others for text in (sign.text, *sign.evidence))]
    alike = [sign for sign in same if sign.text == lead.text]
    return replace(
        lead,
        count=sum(sign.count for sign in alike),
        evidence=[text for text in dict.fromkeys(texts) if text != lead.text],
        cause=next((sign.cause for sign in (lead, *others) if sign.cause), ""),
        action=next((sign.action for sign in (lead, *others) if sign.action), ""),
    )
