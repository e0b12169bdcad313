"""What is wrong with this log: the worst first, in words."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from attlog.present.numbers import moment

if TYPE_CHECKING:
    from attlog.result import Problem, Result

SEVERITY = {
    "error": ("Serious", "bad"),
    "warning": ("Warning", "warn"),
    "note": ("Note", "note"),
    "info": ("Note", "note"),
}
"""Severity, worst first: its label and style."""


@dataclass(slots=True)
class ProblemText:
    """A problem as it is shown: ``where`` in words, ``t`` seconds or None, how often it came.

    ``more``: why it came, what to do, and what it means for the comparison, each with its label.
    """

    label: str
    style: str
    text: str
    where: str
    t: float | None
    count: int = 0
    more: tuple[tuple[str, str], ...] = ()


def problems(result: Result) -> list[ProblemText]:
    """What is wrong with a log as it is shown."""
    return problem_texts(result.problems)


def problem_texts(found: Iterable[Problem]) -> list[ProblemText]:
    """Problems, the worst first, equal sentences once with their count."""
    order = {name: i for i, name in enumerate(SEVERITY)}
    gathered: dict[tuple[str, str], ProblemText] = {}
    for problem in sorted(found, key=lambda p: order.get(p.severity, 9)):
        label, style = SEVERITY.get(problem.severity, ("Note", "note"))
        first = ProblemText(label, style, problem.text, where(problem), shown_time(problem), more=more(problem))
        gathered.setdefault((problem.severity, problem.text), first).count += problem.count
    return list(gathered.values())


def more(problem: Problem) -> tuple[tuple[str, str], ...]:
    """Cause, remedy and meaning with their labels, those that are known; no remedy that the text names already."""
    remedy = "" if problem.remedy in problem.text else problem.remedy
    known = (("why", problem.cause), ("do", remedy), ("so", problem.means))
    return tuple((label, text) for label, text in known if text)


def nothing_wrong(problem_texts: list[ProblemText], hidden: int = 0) -> str:
    """What stands where no problem is listed; ``hidden`` notes are not."""
    if problem_texts:
        return ""
    return (
        f"No problem was found; {hidden} notes with -v."
        if hidden > 1
        else ("No problem was found; 1 note with -v." if hidden else "No problem was found.")
    )


def shown_time(problem: Problem) -> float | None:
    """Seconds of a problem on the log's clock, None where it has no time."""
    return round(problem.t, 3) if problem.t is not None and math.isfinite(problem.t) else None


def where(problem: Problem) -> str:
    """Where in the log: time or bytes."""
    if (t := shown_time(problem)) is not None:
        told = any(f" {t:.{k}f} s" in problem.text for k in (0, 1))  # not twice
        return "" if told else f"at {moment(t)}"
    problem_texts = problem.offset is None or str(problem.offset) in problem.text
    return "" if problem_texts else f"at byte {problem.offset:,}"
