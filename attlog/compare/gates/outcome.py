"""What a gate said: passed, failed or skipped, why, and how far beyond the limit; the worst first."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Status = Literal["passed", "failed", "skipped"]
Cause = Literal["row", "limit", "unanswered", "no_row"]
ORDER = ("failed", "skipped", "passed")
FIRST = ("row", "limit", "unanswered", "no_row", None)
"""Causes of a failure, the worst first."""


@dataclass(frozen=True, slots=True)
class GateOutcome:
    """What one limit of a gate said of one row, or of one sensor.

    ``check`` names gate and limit as in the file (``lag_ms@airborne max=5``), the same for every log. ``cause`` of what
    did not pass: the ``row`` is lost, ``no_row`` is meant, the ``limit`` is exceeded, the metric is ``unanswered``.
    ``excess``: how many times beyond the limit (1 at the limit), for the order. ``sentence`` tells it all. ``excused``:
    passed though beyond a limit to the baseline, because the evidence does not tell it from that.
    """

    row: str
    check: str
    metric: str
    window: str
    status: Status
    cause: Cause | None
    value: float | None
    unit: str
    allowed: float | None
    excess: float
    sentence: str
    excused: bool = False


def worst_first(outcomes: Iterable[GateOutcome]) -> list[GateOutcome]:
    """Failed before skipped before passed; lost rows first, then by how far beyond the limit."""
    return sorted(outcomes, key=lambda o: (ORDER.index(o.status), FIRST.index(o.cause), -o.excess))
