"""What is wrong with this log: the worst first, in words."""

from __future__ import annotations

import math
from dataclasses import dataclass

from attlog.present.numbers import moment
from attlog.result import Problem, Result

SEVERITY = {
    "error": ("Serious", "bad"),
    "warning": ("Limits", "warn"),
    "note": ("Note", "note"),
    "info": ("Note", "note"),
}
"""Severity, worst first: its label and style."""


@dataclass(slots=True)
class Said:
    """A problem as it is shown: ``where`` in words, ``t`` seconds or None, how often it came."""

    label: str
    style: str
    text: str
    where: str
    t: float | None
    count: int = 0


def problems(result: Result) -> list[Said]:
    """Problems, the worst first, equal sentences once with their count."""
    order = {name: i for i, name in enumerate(SEVERITY)}
    gathered: dict[tuple[str, str], Said] = {}
    for problem in sorted(result.problems, key=lambda p: order.get(p.severity, 9)):
        label, style = SEVERITY.get(problem.severity, ("Note", "note"))
        first = Said(label, style, problem.text, where(problem), shown_time(problem))
        gathered.setdefault((problem.severity, problem.text), first).count += problem.count
    return list(gathered.values())


def shown_time(problem: Problem) -> float | None:
    """Seconds of a problem on the log's clock, None where it has no time."""
    return round(problem.t, 3) if problem.t is not None and math.isfinite(problem.t) else None


def where(problem: Problem) -> str:
    """Where in the log: time or bytes."""
    if (t := shown_time(problem)) is not None:
        return f"at {moment(t)}"
    said = problem.offset is None or str(problem.offset) in problem.text
    return "" if said else f"at byte {problem.offset:,}"
