"""What is left out in turn, so that gains are judged where they were not found: whole logs, or blocks of one log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from attlog.compare.sweep.many import SettingsOnLog
from attlog.metrics.answer import Answer

BLOCKS = 4
"""Blocks of one log: each long enough to hold several units of evidence."""
MOST_FOLDS = 5
"""More logs than this are left out in groups."""


@dataclass(frozen=True, slots=True)
class LogPart:
    """A log by its number, or the time from ``t0`` to ``t1`` s of it."""

    log: int
    name: str
    t0: float | None = None
    t1: float | None = None

    def of(self, answer: Answer) -> Answer | None:
        """The answer on this part; None where it has none, or none of its units lies in there."""
        if answer.value is None or self.t0 is None or self.t1 is None:
            return None if answer.value is None else answer
        if answer.units is None:
            return None
        inside = (answer.units.ids >= 1000.0 * self.t0) & (answer.units.ids < 1000.0 * self.t1)
        if not inside.any():
            return None
        ids = answer.units.ids[inside]
        summary = answer.units.of(ids)
        units = replace(answer.units, ids=ids, values=answer.units.values[inside])
        return replace(answer, value=summary.value, ci95=summary.ci95, n=len(ids), units=units)

    def value(self, answer: Answer) -> float | None:
        """The value on this part."""
        found = self.of(answer)
        return None if found is None else found.value


def parts_of(logs: Sequence[SettingsOnLog]) -> list[LogPart]:
    """Every log as a part; of one log alone blocks of equal time from the scoring start to its end."""
    if len(logs) > 1:
        return [LogPart(k, log.name) for k, log in enumerate(logs)]
    case = logs[0].case
    spans = case.segments.spans("all")
    end = min(max(t1 for _, t1 in spans), case.reference.end) if spans else 0.0
    edges = np.linspace(case.reference.scoring_start, end, BLOCKS + 1).tolist()
    edges[0] = min(spans[0][0], edges[0]) if spans else edges[0]
    return [LogPart(0, f"{a:.0f} to {b:.0f} s", a, b) for a, b in pairwise(edges)]


def folds(parts: Sequence[LogPart]) -> list[list[LogPart]]:
    """Groups of parts to be left out in turn: each alone up to MOST_FOLDS, else dealt in turn into so many groups."""
    groups = min(len(parts), MOST_FOLDS)
    return [list(parts[k::groups]) for k in range(groups)]
