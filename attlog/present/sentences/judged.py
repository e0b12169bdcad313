"""Rows with the answer that counts for a question, and how they are spoken of."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.present.names import name_in_sentence
from attlog.present.numbers import interval, listed, quantity
from attlog.present.rows import has_value, is_ranked, value_of
from attlog.result import Answer, EstimatorRow

NAMED = 3
"""So many rows are named in a sentence; more are counted."""


@dataclass(slots=True)
class Judged:
    """One row with an answer that has a value."""

    row: EstimatorRow
    answer: Answer

    @property
    def name(self) -> str:
        """What the row is called in a sentence."""
        return name_in_sentence(self.row)

    @property
    def value(self) -> float:
        """The value."""
        return value_of(self.answer)

    @property
    def replay(self) -> bool:
        """Whether it is a filter that was run again."""
        return self.row.kind == "replay"

    @property
    def ranked(self) -> bool:
        """Whether this row may be called best or worst."""
        return is_ranked(self.row, self.answer)

    @property
    def shown(self) -> bool:
        """Whether the card has a bar for it: filters and what flew; other onboard rows stand in the table."""
        return self.replay or self.row.name == "onboard"

    @property
    def interval(self) -> str:
        """The interval in brackets with a blank before it; empty where there is none."""
        text = interval(self.answer.ci95, self.answer.unit)
        return f" ({text})" if text else ""


@dataclass(frozen=True, slots=True)
class Absent:
    """One row without a value: why."""

    row: EstimatorRow
    code: str
    reason: str


def split(rows: list[tuple[EstimatorRow, Answer | None]]) -> tuple[list[Judged], list[Absent]]:
    """Rows with a value, and those without, each with code and reason."""
    with_value = [Judged(r, a) for r, a in rows if a is not None and has_value(a)]
    without = [Absent(r, a.code or "", a.reason or "") for r, a in rows if a is not None and a.value is None]
    return with_value, without


def unranked(judged: list[Judged]) -> list[tuple[str, str]]:
    """Replayed rows (by id) whose value is shown but not ranked, each with its reason."""
    return [
        (j.row.name, j.answer.reason or j.row.reason or f"is {j.row.status.replace('_', ' ')}")
        for j in judged
        if j.replay and not j.ranked
    ]


def bars(judged: list[Judged], unit: str) -> list[tuple[str, float, str]]:
    """What the card draws, the smallest size first: (row id, value, unit)."""
    size = abs if unit == "deg/min" else float
    return [(j.row.name, j.value, unit) for j in sorted(judged, key=lambda j: size(j.value)) if j.shown]


def counted(names: list[str]) -> str:
    """Up to NAMED filters by name, more as a count."""
    return listed(names) if len(names) <= NAMED else f"{len(names)} filters"


def some(judged: list[Judged], of: int) -> str:
    """Up to NAMED rows by name, more as a count."""
    names = [j.name for j in judged]
    return listed(names) if len(names) <= NAMED else f"{len(names)} of {of} filters"


def onboard_part(judged: list[Judged], unit: str) -> str:
    """What the attitude that flew did, as a short last sentence; against itself it has no lag."""
    onboard = [j for j in judged if j.row.name == "onboard" and not (unit == "ms" and j.row.is_reference)]
    interval = onboard[0].interval if onboard and unit == "deg/min" else ""
    return f" Onboard: {quantity(onboard[0].value, unit)}{interval}." if onboard else ""
