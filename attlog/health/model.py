"""What the audit says: checks with verdicts, and which questions a log can answer."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


@dataclass(slots=True)
class Check:
    """One physics check of the log: ``verdict`` is ok, warning, fault or unknown.

    ``t`` s is where it begins and ``t_end`` s where it ends, None for all of the log; ``count`` how often it happens.
    ``about``: the angle (tilt, heading) or the sensor that it speaks of, where not of what its name says.
    ``evidence``: further sentences with numbers. ``cause`` where this log tells it, empty where it is the usual one.
    ``ci95``: the 95 % interval of ``value`` where one is known, by so many ``samples`` in ``seconds``.
    """

    name: str
    verdict: str
    text: str
    value: int | float | str | None = None
    unit: str = ""
    threshold: str = ""
    t: float | None = None
    count: int = 1
    t_end: float | None = None
    about: str = ""
    evidence: list[str] = field(default_factory=list)
    cause: str = ""
    ci95: tuple[float, float] | None = None
    samples: int = 0
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Answerable:
    """Whether one of the four questions (accuracy, noise, lag, yaw_drift) can be answered from this log.

    ``reason`` is a sentence with the numbers; ``setting`` names what would log what is
    missing, for the firmware that flew, empty where nothing is missing.
    """

    question: str
    can: bool
    reason: str
    setting: str = ""


def graded(value: float, ok: float, warning: float) -> Literal["ok", "warning", "fault"]:
    """The verdict of a size: ok up to ``ok``, warning up to ``warning``, else fault."""
    return "ok" if value <= ok else "warning" if value <= warning else "fault"


FAILED = "part_failed"
"""The value of a check that ended in a bug."""


def failed(name: str, sentence: str) -> list[Check]:
    """A check that ended in a bug, with the sentence that says so."""
    return [Check(name, "unknown", sentence, value=FAILED)]


def not_judged(name: str, why: str, threshold: str = "") -> Check:
    """A check that cannot be made, with the reason."""
    return Check(name, "unknown", why, threshold=threshold)
