"""Order of rows, windows of a question, ranking of a column."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from attlog.result import Answer, EstimatorRow, Result
from attlog.words.names import name_in_sentence
from attlog.words.numbers import SIGNED, interval, quantity

REST = ("rest", "rest.long", "all")
AIR = ("airborne", "all", "armed")
# Windows of a question. The first in which a filter has an answer applies to all rows.
ALL = ("all", "airborne", "rest")

# Phases of noise, never pooled. The first with an answer is reported first.
PHASES = ("rest", "hover", "cruise", "idle")

# Estimator without corrections: drawn for comparison, never ranked.
BASELINE = "gyro"


def window_of(result: Result, metric: str, windows: tuple[str, ...]) -> str:
    """Return the window of a metric for all rows.

    The first in which a filter has a value, else any row has a value, else any row has an answer.
    """
    filters = [row for row in result.estimators if row.kind == "replay" and not is_baseline(row)]
    for rows in (filters, result.estimators):
        for window in windows:
            if any(has_value(row.metrics.get(window, {}).get(metric)) for row in rows):
                return window
    known = (w for w in windows if any(metric in row.metrics.get(w, {}) for row in result.estimators))
    return next(known, windows[0])


def find_answer(row: EstimatorRow, metric: str, windows: tuple[str, ...]) -> Answer | None:
    """Return the row's answer in the first window with a value, else any answer."""
    answers = [row.metrics[w][metric] for w in windows if metric in row.metrics.get(w, {})]
    return next((a for a in answers if a.value is not None), answers[0] if answers else None)


def value_of(answer: Answer) -> float:
    """Return the value as a float, NaN without one."""
    return math.nan if answer.value is None else float(answer.value)


def has_value(answer: Answer | None) -> bool:
    """Return whether there is a finite value."""
    return answer is not None and math.isfinite(value_of(answer))


def is_baseline(row: EstimatorRow) -> bool:
    """Return whether a row only integrates the gyro."""
    return row.kind == "replay" and row.estimator == BASELINE


def is_ranked(result: Result, row: EstimatorRow, metric: str, window: str) -> bool:
    """Return whether a row was compared with others."""
    return not is_baseline(row) and row.name in result.ranked.get(window, {}).get(metric, ())


def is_best(result: Result, row: EstimatorRow, metric: str, window: str) -> bool:
    """Return whether no row is significantly better, and at least one significantly worse."""
    return not is_baseline(row) and row.name in result.best.get(window, {}).get(metric, ())


def count_best(result: Result, name: str) -> int:
    """Return how often a row is marked best over all windows and metrics."""
    return sum(name in rows for metrics in result.best.values() for rows in metrics.values())


def rows_in_order(result: Result) -> list[EstimatorRow]:
    """Sort rows: onboard, its re-run, filters, the baseline, other onboard rows."""

    def place(row: EstimatorRow) -> int:
        if row.is_reference or row.name == "onboard":
            return 0
        if row.kind == "replay":
            return 3 if is_baseline(row) else 2
        return 1 if row.kind == "rerun" else 4

    return sorted(result.estimators, key=place)


# Ranking of a column, shared by table, sentences and bars.

BASELINE_REMARK = "the gyro alone, shown for comparison"
# Columns that need no reference.
SELF_COMPARED = ("noise_", "drift_rest_", "innovation_", "test_ratio_", "rejected_", "attitude_resets")
NOT_COMPARED = "too little data in common"
MEASURED_ONCE = "measured only once"


@dataclass(slots=True)
class RankedValue:
    """Row with a value. ``ranked``: it was compared with others."""

    row: EstimatorRow
    answer: Answer
    ranked: bool

    @property
    def name(self) -> str:
        """Name of the row in a sentence."""
        return name_in_sentence(self.row)

    @property
    def value(self) -> float:
        """The value."""
        return value_of(self.answer)

    @property
    def size(self) -> float:
        """Distance from zero, without the sign of drift and lag."""
        return abs(self.value)

    @property
    def replay(self) -> bool:
        """True for a replayed filter."""
        return self.row.kind == "replay"

    @property
    def shown(self) -> bool:
        """True for rows with a bar: filters, the onboard attitude, its re-run."""
        return self.row.kind != "onboard" or self.row.name == "onboard"

    @property
    def text(self) -> str:
        """The value with its unit."""
        return quantity(self.value, self.answer.unit)

    @property
    def interval(self) -> str:
        """The interval in brackets after a space; empty without one."""
        text = interval(self.answer.ci95, self.answer.unit)
        return f" ({text})" if text else ""

    @property
    def ends(self) -> tuple[float, float]:
        """Ends of the interval; without one the value twice."""
        low, high = self.answer.ci95 if self.answer.ci95 is not None else (self.value, self.value)
        return low, high

    @property
    def significant(self) -> bool:
        """True if the interval excludes zero."""
        return self.answer.ci95 is not None and not self.ends[0] <= 0.0 <= self.ends[1]


class MissingValue(NamedTuple):
    """A row without a value, and the reason."""

    row: EstimatorRow
    code: str
    reason: str


@dataclass(slots=True)
class ColumnRanking:
    """One metric in one window: rows with a value, smallest first, and rows without.

    ``best``: rows that no row is significantly better than, empty if that is all of them. ``worst``: the significantly
    worst row. The baseline and the onboard attitude are in ``judged``, never in ``best`` or ``worst``. ``total``:
    number of filters without the baseline.
    """

    metric: str
    window: str
    total: int
    judged: list[RankedValue] = field(default_factory=list)
    absent: list[MissingValue] = field(default_factory=list)
    best: list[RankedValue] = field(default_factory=list)
    worst: RankedValue | None = None

    @property
    def ranked(self) -> list[RankedValue]:
        """The compared rows, the least first."""
        return [j for j in self.judged if j.ranked]

    @property
    def filters(self) -> list[RankedValue]:
        """Replayed rows with a value, without the baseline."""
        return [j for j in self.judged if j.replay and not is_baseline(j.row)]

    @property
    def compared(self) -> str:
        """Number of compared rows: ``7 filters``, or ``5 ranked filters`` if there are more."""
        return f"{len(self.ranked)} {'filters' if self.total == len(self.ranked) else 'ranked filters'}"

    @property
    def onboard(self) -> RankedValue | None:
        """The onboard attitude, unless it is the reference of this column."""
        by_itself = self.metric.startswith(SELF_COMPARED)
        return next((j for j in self.judged if j.row.name == "onboard" and (by_itself or not j.row.is_reference)), None)

    def of(self, row: EstimatorRow) -> RankedValue | None:
        """Return the value of a row, None without one."""
        return next((j for j in self.judged if j.row.name == row.name), None)


def rank_column(result: Result, metric: str, windows: tuple[str, ...]) -> ColumnRanking:
    """Rank a metric in the first window in which a filter has a value."""
    window = window_of(result, metric, windows)
    every = sum(row.kind == "replay" and not is_baseline(row) for row in result.estimators)
    found = ColumnRanking(metric, window, every)
    for row in result.estimators:
        answer = row.metrics.get(window, {}).get(metric)
        if answer is None:
            continue
        if has_value(answer):
            found.judged.append(RankedValue(row, answer, is_ranked(result, row, metric, window)))
        else:
            found.absent.append(MissingValue(row, answer.code or "", answer.reason or ""))
    found.judged.sort(key=lambda j: j.size if j.answer.unit in SIGNED else j.value)
    found.best = [j for j in found.ranked if is_best(result, j.row, metric, window)]
    worst = result.worst.get(window, {}).get(metric, ())
    # rows are ranked pairwise on shared time, so a worse row may have a smaller value overall
    largest = max((j.size for j in found.ranked), default=0.0)
    found.worst = next((j for j in found.ranked if j.row.name in worst and j.size == largest), None)
    return found


def reason_unranked(judged: RankedValue) -> str:
    """Return why a value is not ranked."""
    if is_baseline(judged.row):
        return BASELINE_REMARK
    if judged.row.status != "ok":
        return judged.row.reason or judged.row.status.replace("_", " ")
    return judged.answer.reason or (MEASURED_ONCE if judged.answer.n == 1 else NOT_COMPARED)


# Heading reference for which drift in the air is reported.

DRIFT_AIR = "drift_air_deg_per_min"


# Code of an answer whose interval is too wide to exclude any value.
CODE_TOO_UNCERTAIN = "too_uncertain"
# Code of a heading reference too short for a drift.
CODE_TOO_SHORT = "record_too_short"
# Heading references, preferred ones first.
HEADING_REFERENCE_ORDER = ("truth", "smoother", "gnss_yaw", "onboard", "mag", "yaw_estimator", "course")


def quoted_heading_reference(result: Result) -> str:
    """Return the heading reference of the reported drift in the air.

    The first of HEADING_REFERENCE_ORDER with a value of a replayed row; truth even if it is too uncertain.
    """
    replayed = [row for row in result.estimators if row.kind == "replay"]
    unsure = short = ""
    for name in HEADING_REFERENCE_ORDER:
        found = [find_answer(row, f"{DRIFT_AIR}.{name}", AIR) for row in replayed]
        if any(has_value(a) for a in found):
            return name
        if any(a is not None and a.code == CODE_TOO_UNCERTAIN for a in found):
            if name == "truth":
                return name
            unsure = unsure or name
        if any(a is not None and a.code == CODE_TOO_SHORT for a in found):
            short = short or name
    return unsure or short or "onboard"
