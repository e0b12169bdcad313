"""Who is best in a column? Nobody alone, unless the interval separates it from the next."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from attlog.metrics.answer import Answer
from attlog.metrics.base import Metric
from attlog.reference.model import Row

Table = Mapping[str, Mapping[str, Mapping[str, Answer]]]
"""row name -> window -> metric id -> Answer"""

MIN_COVERAGE_PCT = 50.0
MIN_ROWS = 2
"""A mark says better than another: one row alone gets none."""


def may_be_best(row: Row) -> bool:
    """Whether a row can be best at all: replayed, not the reference, sound, and scored on half of its time or more."""
    covered = row.coverage_pct is None or row.coverage_pct >= MIN_COVERAGE_PCT
    return row.kind == "replay" and not row.is_reference and row.status == "ok" and covered


def distance(answer: Answer, better: str) -> tuple[float, float, float]:
    """(low, value, high) of how far an answer is from perfect: smaller is better whatever ``better`` says."""
    value = answer.value if answer.value is not None else float("nan")
    low, high = answer.ci95 if answer.ci95 is not None else (value, value)
    if better == "high":
        value, low, high = -value, -high, -low
    if better == "one":
        value, low, high = value - 1.0, low - 1.0, high - 1.0
    low, high = min(low, value) - answer.resolution, max(high, value) + answer.resolution
    if better in ("low", "high"):
        return low, value, high
    near = 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
    size = abs(value)
    if size < answer.counts_as_zero_below:
        size = near = 0.0
    return near, size, max(abs(low), abs(high))


def leaders(answers: Mapping[str, Answer], better: str) -> list[str]:
    """The rows that share the lead: the smallest distance and all whose interval meets the leader's.

    Differences below the larger ``floor`` of the two are ties as well.
    """
    ranked = {name: a for name, a in answers.items() if a.value is not None and a.ranked}
    if len(ranked) < MIN_ROWS:
        return []
    found = {name: distance(a, better) for name, a in ranked.items()}
    first = min(found, key=lambda name: found[name][1:])
    _, best, best_high = found[first]

    def ties(name: str) -> bool:
        near, size, _ = found[name]
        floor = max(ranked[name].floor, ranked[first].floor)
        return near <= best_high or size - best < floor

    return [name for name in found if ties(name)]


def best(table: Table, rows: Iterable[Row], metrics: Mapping[str, Metric]) -> dict[str, dict[str, list[str]]]:
    """Window -> metric id -> names of the rows that share the lead, in the order of the rows."""
    names = [row.name for row in rows if may_be_best(row) and row.name in table]
    marks: dict[str, dict[str, list[str]]] = {}
    for window in dict.fromkeys(w for name in names for w in table[name]):
        columns = dict.fromkeys(m for name in names for m in table[name].get(window, {}))
        for column in columns:
            if column not in metrics:
                continue
            answers = {n: table[n][window][column] for n in names if column in table[n].get(window, {})}
            lead = leaders(answers, metrics[column].better)
            if lead:
                marks.setdefault(window, {})[column] = lead
    return marks
