"""What can differ between two results: numbers, settings, texts; and all of it together."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

Verdict = Literal["beyond", "within", "not_significant", "appeared", "vanished"]
Interval = tuple[float, float]
ABSENT = "(absent)"


@dataclass(frozen=True, slots=True)
class NumberChange:
    """A number that differs. ``closer``: the newer value is the better one; None where neither is.

    ``verdict``: ``beyond`` the tolerance, ``within``, ``not_significant`` (two flights whose intervals overlap, or
    without interval), ``appeared``, ``vanished`` (``reason`` says why there is no value). ``interval`` is that of the
    difference of two flights.
    """

    row: str
    window: str
    metric: str
    unit: str
    old: float | None
    new: float | None
    old_ci95: Interval | None
    new_ci95: Interval | None
    difference: float | None
    interval: Interval | None
    tolerance: float | None
    verdict: Verdict
    closer: bool | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class TextChange:
    """A setting, text or state that differs; ``(absent)`` where one side does not have it."""

    name: str
    old: Any
    new: Any


@dataclass(slots=True)
class RunDifference:
    """Two results side by side.

    ``statements``: headline and findings above notes that differ; ``verdicts``: sentences; ``made_by``: versions
    of attlog; ``log``: firmware, vehicle and what else describes the flight; ``config``: options; ``parameters``: of
    the log, first those that both have (none of two kinds of autopilot), None where a side was written before results
    held them; ``gains``: filter parameters; ``status``: of rows; ``moved``: numbers that differ, sorted by
    :mod:`attlog.compare.diff.order`.
    """

    name: str
    same_log: bool
    statements: list[TextChange] = field(default_factory=list)
    verdicts: list[TextChange] = field(default_factory=list)
    made_by: list[TextChange] = field(default_factory=list)
    log: list[TextChange] = field(default_factory=list)
    config: list[TextChange] = field(default_factory=list)
    parameters: list[TextChange] | None = None
    gains: list[TextChange] = field(default_factory=list)
    rows_appeared: list[str] = field(default_factory=list)
    rows_vanished: list[str] = field(default_factory=list)
    status: list[TextChange] = field(default_factory=list)
    moved: list[NumberChange] = field(default_factory=list)
    equal: int = 0

    @property
    def beyond(self) -> list[NumberChange]:
        """The numbers that count as different."""
        gone = ("appeared", "vanished") if self.same_log else ()
        return [m for m in self.moved if m.verdict == "beyond" or m.verdict in gone]

    @property
    def count(self) -> int:
        """How many differences count: numbers, rows, states of rows."""
        return len(self.beyond) + len(self.rows_appeared) + len(self.rows_vanished) + len(self.status)
