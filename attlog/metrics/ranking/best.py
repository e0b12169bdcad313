"""Who is best, who is worst in a column? One rule for the table's stars, the sentences and the bars.

A family is one column in one window: all rows that may be ranked, pair by pair, on the units of
evidence that they all have. A pair differs significantly where its test stands among those of the family
(Benjamini & Hochberg, 5 %), the shown values have the same order, and they differ by more than the
log resolves. The best rows are those that no row is significantly better than.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.answer import Answer
from attlog.metrics.base import Metric
from attlog.metrics.ranking.resolution import withhold
from attlog.metrics.statistics import pairs
from attlog.metrics.statistics.units import Ids, Kind, UnitValues
from attlog.reference.model import Row

Table = Mapping[str, Mapping[str, Mapping[str, Answer]]]
"""row name -> window -> metric id -> Answer"""
Marks = dict[str, dict[str, list[str]]]
"""window -> metric id -> row names"""

AT_ONCE = 4096
"""Couples whose differences are held at once."""
MIN_COVERAGE_PCT = 50.0
MIN_UNITS = 0.5
FEWEST: dict[Kind, int] = {"lag_event": 3, "step_event": 6}
"""Common events below which rows are not compared, and keep the values of their own events."""
"""Of the units of the best covered row: rows with fewer are not compared."""


@dataclass(frozen=True, slots=True)
class Family:
    """The rows of one column that were compared, and the pairs (better, worse) that differ significantly."""

    rows: list[str]
    significant: list[tuple[str, str]]

    def without(self, names: list[str]) -> Family:
        """The family when these rows are taken out of it."""
        pairs_left = [pair for pair in self.significant if not set(pair) & set(names)]
        return Family([n for n in self.rows if n not in names], pairs_left) if names else self

    @property
    def best(self) -> list[str]:
        """Rows that no row is significantly better than."""
        beaten = {worse for _, worse in self.significant}
        return [name for name in self.rows if name not in beaten]

    @property
    def worst(self) -> list[str]:
        """The one row that is better than nobody and not among the best; else none."""
        winners = {better for better, _ in self.significant}
        last = [name for name in self.rows if name not in winners]
        return last if len(last) == 1 and last[0] not in self.best else []


@dataclass(slots=True)
class Ranking:
    """What is marked. ``best`` leaves out columns in which everybody is (too close to rank) and rows that stand alone.

    ``worst`` names one row or none; ``ranked`` all rows that were compared in a column.
    """

    best: Marks = field(default_factory=dict)
    worst: Marks = field(default_factory=dict)
    ranked: Marks = field(default_factory=dict)


def may_be_best(row: Row) -> bool:
    """Whether a row can be best at all: replayed, not the reference, sound, and scored on half of its time or more."""
    covered = row.coverage_pct is None or row.coverage_pct >= MIN_COVERAGE_PCT
    return row.kind == "replay" and not row.is_reference and row.status == "ok" and covered


def distance(answer: Answer, better: str) -> tuple[float, float, float]:
    """(low, value, high) of how far an answer is from perfect: smaller is better whatever ``better`` says."""
    value = answer.value if answer.value is not None else float("nan")
    low, high = answer.ci95 if answer.ci95 is not None else (value, value)
    low, high = min(low, value), max(high, value)
    if better == "low":
        return low, value, high
    if better == "high":
        return -high, -value, -low
    if better == "one":
        value, low, high = value - 1.0, low - 1.0, high - 1.0
    near = 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
    return near, abs(value), max(abs(low), abs(high))


def floor(a: Answer, b: Answer) -> float:
    """The difference below which two answers are the same, in their unit: the larger floor of both rows.

    With a ``gyro_share`` g: variances add, so that the larger must exceed sqrt(smaller^2 + g^2).
    """
    share, smaller = max(a.gyro_share, b.gyro_share), min(abs(a.value or 0.0), abs(b.value or 0.0))
    hidden = math.hypot(smaller, share) - smaller
    return max(a.floor, a.counts_as_zero_below, b.floor, b.counts_as_zero_below, hidden)


def common_units(answers: Mapping[str, Answer]) -> tuple[list[str], Ids]:
    """The rows that can be compared unit by unit, and the units that all of them have.

    Rows with less than half of the units of the best covered are left out, then the least
    covered ones until the common units are half of it.
    """
    ids = {name: a.units.ids for name, a in answers.items() if a.units is not None}
    most = max(map(len, ids.values()), default=0)
    rows = [name for name in ids if len(ids[name]) >= MIN_UNITS * most and len(ids[name])]
    while rows:
        common: Ids = reduce(np.intersect1d, [ids[name] for name in rows])
        if len(common) >= MIN_UNITS * most:
            return rows, common
        rows.remove(min(rows, key=lambda name: len(ids[name])))
    return [], np.zeros(0, np.int64)


def family(answers: Mapping[str, Answer], better: str) -> Family:
    """Compare the ranked answers of a column by row; values move to the common units where rows differ."""
    ranked = {name: a for name, a in answers.items() if a.value is not None and a.ranked}
    if not any(a.units is not None for a in ranked.values()):
        return _by_intervals(ranked, better)
    rows, common = common_units(ranked)
    units = {name: a.units for name, a in ranked.items() if a.units is not None}
    if any(len(common) < FEWEST.get(units[name].kind, 1) for name in rows):
        return Family(list(units), [])
    if any(len(a.units.ids) != len(common) for a in (ranked[n] for n in rows) if a.units is not None):
        for name in rows:
            _restrict(ranked[name], common)
    couples = list(combinations(rows, 2))
    p = _p_of_all([units[name] for name in rows], common)
    significant = [couple for couple, stands in zip(couples, pairs.significant(p), strict=True) if stands]
    return Family(rows, _in_order(significant, ranked, better))


def _p_of_all(units: Sequence[UnitValues], common: Ids) -> NDArray[np.float64]:
    """The p of all couples of rows on common units, in the order of ``combinations``; 1 for different kinds."""
    kinds = [one.kind for one in units]
    values = np.array([one.at(common) for one in units])
    first, second = np.triu_indices(len(units), 1)
    p = np.ones(len(first))
    alike = np.array([kinds[i] == kinds[j] for i, j in zip(first, second, strict=True)], bool)
    for kind in dict.fromkeys(kinds):
        of_kind = np.flatnonzero(alike & np.array([kinds[i] == kind for i in first], bool))
        for some in np.array_split(of_kind, len(of_kind) // AT_ONCE + 1):
            p[some] = pairs.p_values(kind, values[first[some]], values[second[some]])
    return p


def _restrict(answer: Answer, common: Ids) -> None:
    """The answer on some of its units: so that what stands side by side was measured at the same time."""
    if answer.units is None:
        return
    summary = answer.units.of(common)
    answer.seconds *= len(common) / len(answer.units.ids)
    answer.value, answer.ci95, answer.n = summary.value, summary.ci95, len(common)
    answer.detail["units_left_out"] = len(answer.units.ids) - len(common)


def _by_intervals(answers: Mapping[str, Answer], better: str) -> Family:
    """Columns without units: rows whose intervals do not meet differ significantly."""
    found = {name: distance(a, better) for name, a in answers.items()}
    disjoint = [(a, b) for a, b in combinations(found, 2) if found[a][2] < found[b][0] or found[b][2] < found[a][0]]
    return Family(list(answers), _in_order(disjoint, answers, better))


def _in_order(
    couples: Iterable[tuple[str, str]], answers: Mapping[str, Answer], better: str, ordered: bool = False
) -> list[tuple[str, str]]:
    """Pairs as (better, worse) by their shown values; those within the floor do not differ.

    ``ordered`` keeps only pairs that come in as (better, worse) already.
    """
    found = []
    for a, b in couples:
        difference = distance(answers[b], better)[1] - distance(answers[a], better)[1]
        if abs(difference) <= floor(answers[a], answers[b]) or difference == 0.0 or (ordered and difference < 0.0):
            continue
        found.append((a, b) if difference > 0 else (b, a))
    return found


def rank(table: Table, rows: Iterable[Row], metrics: Mapping[str, Metric]) -> Ranking:
    """Compare all rows in all columns: what is best, what is worst, and who was compared."""
    names = [row.name for row in rows if may_be_best(row) and row.name in table]
    found = Ranking()
    for window in dict.fromkeys(w for name in names for w in table[name]):
        families: dict[str, Family] = {}
        columns = dict.fromkeys(m for name in names for m in table[name].get(window, {}))
        for column in sorted((c for c in columns if c in metrics), key=lambda c: bool(metrics[c].decided_by)):
            metric = metrics[column]
            answers = {n: table[n][window][column] for n in names if column in table[n].get(window, {})}
            compared = _family(answers, metric, families.get(metric.decided_by))
            families[column] = compared.without([n for n in compared.rows if withhold(metric, answers[n])])
        for column in (c for c in columns if c in families):
            _mark(found, window, column, families[column])
    return found


def _family(answers: Mapping[str, Answer], metric: Metric, deciding: Family | None) -> Family:
    """The family of a column; where another column decides, its pairs that have the same order here."""
    if not metric.decided_by:
        return family(answers, metric.better)
    ranked = {name: a for name, a in answers.items() if a.value is not None and a.ranked}
    if deciding is None:
        return Family([], [])
    significant = [(a, b) for a, b in deciding.significant if a in ranked and b in ranked]
    return Family(
        [n for n in deciding.rows if n in ranked], _in_order(significant, ranked, metric.better, ordered=True)
    )


def _mark(found: Ranking, window: str, column: str, compared: Family) -> None:
    if compared.rows:
        found.ranked.setdefault(window, {})[column] = compared.rows
    if len(compared.best) < len(compared.rows):
        found.best.setdefault(window, {})[column] = compared.best
    if compared.worst:
        found.worst.setdefault(window, {})[column] = compared.worst
