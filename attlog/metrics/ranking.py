"""Answers too uncertain to show, duplicate rows, best and worst rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.core.sorting import is_in, unique
from attlog.metrics import statistics
from attlog.metrics.metric import Answer, Metric, Resolution
from attlog.metrics.statistics import Ids, Kind, UnitValues
from attlog.reference.model import Track

TOO_UNCERTAIN = "too_uncertain"
# Flight time, steps and windows that a user can record; an answer that needs more is too noisy.
ENOUGH_S, ENOUGH_STEPS, ENOUGH_WINDOWS = 300.0, 30, 4
# Largest ratio of an interval's ends; beyond it, not even the number of digits is known.
MAX_INTERVAL_RATIO = 100.0
PERFECT = {"zero": 0.0, "one": 1.0}


def withdraw_uncertain(metric: Metric, answer: Answer) -> bool:
    """Withdraw an answer too uncertain to show; return whether it was withdrawn.

    "No significant drift, below 500 deg/min" is true and of no use. An answer whose interval excludes
    perfect is kept at any width, as are records that disagree.
    """
    limit = metric.resolution
    if limit is None or answer.value is None or answer.ci95 is None or answer.disagree is not None:
        return False
    if _resolved(limit, metric.better, *answer.ci95):
        return False
    answer.reason = _why(limit, metric.better, answer)
    answer.value, answer.ci95, answer.code, answer.ranked, answer.units = None, None, TOO_UNCERTAIN, False, None
    return True


def _resolved(limit: Resolution, better: str, low: float, high: float) -> bool:
    if better == "low":
        return high <= limit.size or low * MAX_INTERVAL_RATIO >= high
    return not low <= PERFECT[better] <= high or _beyond(better, (low, high)) <= limit.size


def _beyond(better: str, ci95: tuple[float, float]) -> float:
    """Return the distance of an interval's farther end from perfect."""
    return max(abs(end - PERFECT.get(better, 0.0)) for end in ci95)


def _why(limit: Resolution, better: str, answer: Answer) -> str:
    """Return the reason: too short or few, else too noisy."""
    times = (_beyond(better, answer.ci95 or (0.0, 0.0)) / limit.size) ** 2
    few, more = "too few", ""
    if limit.evidence == "windows":
        evidence, short = f"{answer.n} window{' is' if answer.n == 1 else 's are'}", answer.n < ENOUGH_WINDOWS
    elif limit.evidence == "steps":
        needed = times * answer.n
        evidence, short = f"{answer.n} steps are", needed <= ENOUGH_STEPS
        more = f"; about {math.ceil(needed)} are needed"
    else:
        needed, few = times * answer.seconds, "too short"
        evidence, short = f"{answer.seconds:.0f} s are", needed <= ENOUGH_S
        more = f"; about {10.0 * math.ceil(needed / 10.0):.0f} s are needed"
    return f"{evidence} {few if short else 'too noisy'} to show even {limit.even}{more if short else ''}"


# Duplicate rows: filters with a common declared equation, or equal attitudes.

Array = NDArray[np.float64]

# Largest angle between equal attitudes at every sample; the order of sums makes far less.
EQUAL_DEG = 1e-6
EXCERPT_SAMPLES = 100  # samples of an excerpt


@dataclass(slots=True)
class Duplicates:
    """Rows of one filter, ``by`` declared ``equation`` or equal ``attitudes``.

    ``source``: of the equation. ``differ``: parameters common to all rows with different values, one value per row.
    ``apart_deg``: largest angle between their attitudes, None if not measured.
    """

    rows: list[str]
    by: Literal["equation", "attitudes"]
    source: str = ""
    differ: dict[str, list[float | str]] = field(default_factory=dict)
    apart_deg: float | None = None


class DuplicateSearch:
    """Search for duplicates among replays that are added one by one.

    Replays of the same samples with equal attitudes or a common declared equation. Only an excerpt of each row is kept.
    If the excerpts agree, ``again`` re-runs the earlier row: rare, and cheaper than keeping all.
    """

    def __init__(self, again: Callable[[Track], Track]) -> None:
        self._again = again
        self._rows: list[Track] = []
        self._groups: list[_Group] = []

    def add(self, row: Track) -> None:
        """Add a row, which may be released afterwards."""
        if row.kind != "replay" or row.status == "failed":
            return
        self._rows.append(row)
        excerpt = _excerpt(row)
        for group in self._groups:
            angle = self._angle(group, row, excerpt)
            if angle <= EQUAL_DEG:
                group.rows.append(row)
                group.apart_deg = max(group.apart_deg, angle)
                return
        self._groups.append(_Group([row], excerpt))

    def found(self) -> list[Duplicates]:
        """Return equal attitudes first, then filters that share an equation.

        Rows of one filter with other parameters are listed only if their attitudes are equal, or beside another filter.
        """
        groups = [group for group in self._groups if len(group.rows) > 1]
        equal = {row.name for group in groups for row in group.rows}
        found = [
            Duplicates([r.name for r in g.rows], "attitudes", differ=_differ(g.rows), apart_deg=g.apart_deg)
            for g in groups
        ]
        declared: dict[tuple[str, int], list[Track]] = {}
        for row in self._rows:
            if row.equation:
                declared.setdefault((row.equation, id(row.imu)), []).append(row)
        for (source, _), rows in declared.items():
            several = len({row.estimator for row in rows}) > 1
            if several and not equal.issuperset(row.name for row in rows):
                found.append(Duplicates([row.name for row in rows], "equation", source, _differ(rows)))
        return found

    def _angle(self, group: _Group, row: Track, excerpt: _Excerpt) -> float:
        """Return the largest angle in deg between a row and a group."""
        first, seen = group.rows[0], group.excerpt
        if first.imu is not row.imu or seen.n != excerpt.n or not np.array_equal(seen.t, excerpt.t):
            return np.inf
        if not _largest_deg(seen.q, excerpt.q) <= EQUAL_DEG:
            return np.inf
        try:
            whole = self._again(first)
        except AttlogError:
            return np.inf
        return _largest_deg(whole.q, row.q) if np.array_equal(whole.t, row.t) else np.inf


class _Excerpt(NamedTuple):
    """Attitudes (m, 4) at times (m,), spread over a row's ``n`` samples."""

    n: int
    t: Array
    q: Array


@dataclass(slots=True)
class _Group:
    """Rows equal to the first, its excerpt, and the largest angle."""

    rows: list[Track]
    excerpt: _Excerpt
    apart_deg: float = 0.0


def _excerpt(row: Track) -> _Excerpt:
    few = np.linspace(0, len(row.t) - 1, min(EXCERPT_SAMPLES, len(row.t))).astype(int)
    return _Excerpt(len(row.t), row.t[few], row.q[few])


def _largest_deg(a: Array, b: Array) -> float:
    """Return the largest angle in deg between attitudes (n, 4)."""
    largest = float(np.max(np.degrees(rotation.total_angle(rotation.earth_error(a, b))))) if len(a) else np.inf
    return largest if np.isfinite(largest) else np.inf


def _differ(group: Sequence[Track]) -> dict[str, list[float | str]]:
    """Return the parameters common to a group's rows whose values differ."""
    names = [name for name in group[0].parameters if all(name in row.parameters for row in group)]
    values = {name: [row.parameters[name] for row in group] for name in names}
    return {name: own for name, own in values.items() if any(a != b for a, b in combinations(own, 2))}


# Best and worst rows of a column: one rule for the table's stars, the sentences and the bars.
#
# A family is one column in one window: all rows that may be ranked, pair by pair, on the units of
# evidence common to all. A pair differs significantly where its test is significant among those of the family
# (Benjamini & Hochberg, 5 %), the shown values have the same order, and they differ by more than the
# log resolves. The best rows are those that no row is significantly better than.

# row name -> window -> metric id -> Answer
Table = Mapping[str, Mapping[str, Mapping[str, Answer]]]
# window -> metric id -> row names
Marks = dict[str, dict[str, list[str]]]

# Largest number of pairs whose differences are in memory at once.
MAX_COUPLES = 4096
MIN_COVERAGE_PCT = 50.0  # smallest coverage of a best row
MIN_UNITS = 0.5  # share of the largest number of units
# Smallest number of common events; with fewer, rows are not compared and keep their values.
MIN_COMMON_UNITS: dict[Kind, int] = {"lag_event": 3, "step_event": 6}
# Smallest number of common windows of noise: one shows no scatter from window to window, so it ranks no row.
MIN_WINDOWS = 2


class Family(NamedTuple):
    """Compared rows of one column."""

    rows: list[str]
    significant: list[tuple[str, str]]

    def without(self, names: list[str]) -> Family:
        """Return the family without these rows."""
        pairs_left = [pair for pair in self.significant if not set(pair) & set(names)]
        return Family([n for n in self.rows if n not in names], pairs_left) if names else self

    @property
    def best(self) -> list[str]:
        """Rows without a significantly better row."""
        beaten = {worse for _, worse in self.significant}
        return [name for name in self.rows if name not in beaten]

    @property
    def worst(self) -> list[str]:
        """The only row better than no other, unless best; else empty."""
        winners = {better for better, _ in self.significant}
        last = [name for name in self.rows if name not in winners]
        return last if len(last) == 1 and last[0] not in self.best else []


@dataclass(slots=True)
class Ranking:
    """Best, worst and compared rows by window and metric.

    ``best`` lacks columns whose rows are too close to rank, and single rows. ``worst`` has at most one row per column;
    ``ranked``: all compared rows.
    """

    best: Marks = field(default_factory=dict)
    worst: Marks = field(default_factory=dict)
    ranked: Marks = field(default_factory=dict)


def may_be_best(row: Track) -> bool:
    """Return whether a row can be best.

    A sound replay, not the reference, scored on half of its time or more.
    """
    covered = row.coverage_pct is None or row.coverage_pct >= MIN_COVERAGE_PCT
    return row.kind == "replay" and not row.is_reference and row.status == "ok" and covered


def distance(answer: Answer, better: str) -> tuple[float, float, float]:
    """Return (low, value, high) of an answer's distance from perfect."""
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
    """Return the difference below which two answers are equal.

    The larger floor of both rows. With a ``gyro_share`` g variances add, so that the larger must exceed sqrt(smaller^2
    + g^2).
    """
    share, smaller = max(a.gyro_share, b.gyro_share), min(abs(a.value or 0.0), abs(b.value or 0.0))
    hidden = math.hypot(smaller, share) - smaller
    return max(a.floor, a.counts_as_zero_below, b.floor, b.counts_as_zero_below, hidden)


def common_units(answers: Mapping[str, Answer]) -> tuple[list[str], Ids]:
    """Return the rows to compare unit by unit, and their common units.

    Rows with less than half of the largest number of units are left out, then those with the fewest, until the common
    units are half of that number.
    """
    ids = {name: a.units.ids for name, a in answers.items() if a.units is not None}
    most = max(map(len, ids.values()), default=0)
    rows = [name for name in ids if len(ids[name]) >= MIN_UNITS * most and len(ids[name])]
    while rows:
        first, *others = (ids[name] for name in rows)
        common: Ids = reduce(lambda shared, own: shared[is_in(shared, own)], others, unique(first))
        if len(common) >= MIN_UNITS * most:
            return rows, common
        rows.remove(min(rows, key=lambda name: len(ids[name])))
    return [], np.zeros(0, np.int64)


def family(answers: Mapping[str, Answer], better: str) -> Family:
    """Compare the ranked answers of a column by row.

    Values are recomputed on the common units if rows differ in theirs.
    """
    ranked = {name: a for name, a in answers.items() if a.value is not None and a.ranked}
    if not any(a.units is not None for a in ranked.values()):
        return _by_intervals(ranked, better)
    rows, common = common_units(ranked)
    units = {name: a.units for name, a in ranked.items() if a.units is not None}
    if len(common) < MIN_WINDOWS and any(units[name].kind == "log_variance" for name in rows):
        return Family([], [])
    if any(len(common) < MIN_COMMON_UNITS.get(units[name].kind, 1) for name in rows):
        return Family(list(units), [])
    if any(len(a.units.ids) != len(common) for a in (ranked[n] for n in rows) if a.units is not None):
        for name in rows:
            _restrict(ranked[name], common)
    couples = list(combinations(rows, 2))
    p = _p_of_all([units[name] for name in rows], common)
    significant = [couple for couple, stands in zip(couples, statistics.significant(p), strict=True) if stands]
    return Family(rows, _in_order(significant, ranked, better))


def _p_of_all(units: Sequence[UnitValues], common: Ids) -> NDArray[np.float64]:
    """Return the p-values of all pairs of rows on common units."""
    kinds = [one.kind for one in units]
    values = np.array([one.at(common) for one in units])
    first, second = np.triu_indices(len(units), 1)
    p = np.ones(len(first))
    alike = np.array([kinds[i] == kinds[j] for i, j in zip(first, second, strict=True)], bool)
    for kind in dict.fromkeys(kinds):
        of_kind = np.flatnonzero(alike & np.array([kinds[i] == kind for i in first], bool))
        for some in np.array_split(of_kind, len(of_kind) // MAX_COUPLES + 1):
            p[some] = statistics.p_values(kind, values[first[some]], values[second[some]])
    return p


def _restrict(answer: Answer, common: Ids) -> None:
    """Recompute an answer on the units ``common`` to all rows."""
    if answer.units is None:
        return
    summary = answer.units.of(common)
    answer.seconds *= len(common) / len(answer.units.ids)
    answer.value, answer.ci95, answer.n = summary.value, summary.ci95, len(common)


def _by_intervals(answers: Mapping[str, Answer], better: str) -> Family:
    """Compare a column without units: disjoint intervals differ significantly."""
    found = {name: distance(a, better) for name, a in answers.items()}
    disjoint = [(a, b) for a, b in combinations(found, 2) if found[a][2] < found[b][0] or found[b][2] < found[a][0]]
    return Family(list(answers), _in_order(disjoint, answers, better))


def _in_order(
    couples: Iterable[tuple[str, str]], answers: Mapping[str, Answer], better: str, ordered: bool = False
) -> list[tuple[str, str]]:
    """Return pairs as (better, worse) by their shown values.

    Pairs within the floor are left out. ``ordered``: keep only pairs that are (better, worse) on input.
    """
    found = []
    for a, b in couples:
        difference = distance(answers[b], better)[1] - distance(answers[a], better)[1]
        if abs(difference) <= floor(answers[a], answers[b]) or difference == 0.0 or (ordered and difference < 0.0):
            continue
        found.append((a, b) if difference > 0 else (b, a))
    return found


def rank(table: Table, rows: Iterable[Track], metrics: Mapping[str, Metric]) -> Ranking:
    """Return the best, worst and compared rows of all columns."""
    names = [row.name for row in rows if may_be_best(row) and row.name in table]
    found = Ranking()
    for window in dict.fromkeys(w for name in names for w in table[name]):
        families: dict[str, Family] = {}
        columns = dict.fromkeys(m for name in names for m in table[name].get(window, {}))
        for column in sorted((c for c in columns if c in metrics), key=lambda c: bool(metrics[c].decided_by)):
            metric = metrics[column]
            answers = {n: table[n][window][column] for n in names if column in table[n].get(window, {})}
            compared = _family(answers, metric, families.get(metric.decided_by))
            families[column] = compared.without([n for n in compared.rows if withdraw_uncertain(metric, answers[n])])
        for column in (c for c in columns if c in families):
            _mark(found, window, column, families[column])
    return found


def _family(answers: Mapping[str, Answer], metric: Metric, deciding: Family | None) -> Family:
    """Return the family of a column.

    If another column decides: its pairs that have the same order here.
    """
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
