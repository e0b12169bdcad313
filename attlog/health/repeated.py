"""Problems of one kind that are too many to list: one entry with their number, the first of them and what all share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from attlog.flight.model import Problem

MANY = 5
"""Up to so many entries of one code stand for themselves; a hostile or badly damaged log brings hundreds."""
SHOWN = 3
"""Of more than that, so many are quoted."""


def joined(problems: Iterable[Problem]) -> list[Problem]:
    """The problems in their order; more than :data:`MANY` of one code and severity as one, where the first stood.

    Its ``count`` is the sum of theirs. Cause, remedy and meaning stay where all have the same.
    """
    kinds: dict[tuple[str, str], list[Problem]] = {}
    for problem in problems:
        kinds.setdefault((problem.code, problem.severity), []).append(problem)
    told: list[Problem] = []
    for same in kinds.values():
        told += same if len(same) <= MANY else [_one(same)]
    return told


def _one(same: list[Problem]) -> Problem:
    first, *_ = same
    quoted = " ".join(p.text for p in same[:SHOWN])
    times = [p.t for p in same if p.t is not None]
    return replace(
        first,
        text=f"{len(same)} of one kind: {quoted} And {len(same) - SHOWN} more.",
        t=min(times, default=None),
        count=sum(p.count for p in same),
        value=None,
        unit="",
        cause=_shared([p.cause for p in same]),
        remedy=_shared([p.remedy for p in same]),
        means=_shared([p.means for p in same]),
    )


def _shared(texts: list[str]) -> str:
    return texts[0] if len(set(texts)) == 1 else ""
