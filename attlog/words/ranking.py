"""Rows and their answers: where a question is looked up, in which order rows stand, who may be called best."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from attlog.result import Answer, EstimatorRow, Result
from attlog.words.names import name_in_sentence
from attlog.words.numbers import SIGNED, interval, quantity

REST = ("rest", "rest.long", "all")
AIR = ("airborne", "all", "armed")
ALL = ("all", "airborne", "rest")
"""Windows in which a question is looked up; the first in which a filter has an answer counts for all rows."""

PHASES = ("rest", "hover", "cruise", "idle")
"""Where noise is looked up, never pooled; the first with an answer leads."""

BASELINE = "gyro"
"""The estimator that nothing corrects: it is drawn beside the others and wins nothing."""


def window_of(result: Result, metric: str, windows: tuple[str, ...]) -> str:
    """The one window of a column: the first in which a filter has a value, else any row, else any answer."""
    for wanted in (_filter_rows, _all_rows):
        for window in windows:
            if any(has_value(row.metrics.get(window, {}).get(metric)) for row in wanted(result)):
                return window
    known = (w for w in windows if any(metric in row.metrics.get(w, {}) for row in result.estimators))
    return next(known, windows[0])


def _filter_rows(result: Result) -> list[EstimatorRow]:
    return [row for row in result.estimators if row.kind == "replay" and not is_baseline(row)]


def _all_rows(result: Result) -> list[EstimatorRow]:
    return result.estimators


def find_answer(row: EstimatorRow, metric: str, windows: tuple[str, ...]) -> Answer | None:
    """The row's answer in the first of the windows that has it, one with a value preferred."""
    answers = [row.metrics[w][metric] for w in windows if metric in row.metrics.get(w, {})]
    return next((a for a in answers if a.value is not None), answers[0] if answers else None)


def value_of(answer: Answer) -> float:
    """The value as a float, NaN where there is none."""
    return math.nan if answer.value is None else float(answer.value)


def has_value(answer: Answer | None) -> bool:
    """Whether there is a number to show."""
    return answer is not None and math.isfinite(value_of(answer))


def is_baseline(row: EstimatorRow) -> bool:
    """Whether this row only integrates the gyro."""
    return row.kind == "replay" and row.estimator == BASELINE


def is_ranked(result: Result, row: EstimatorRow, metric: str, window: str) -> bool:
    """Whether this row was compared with others: only then may it be called best or worst."""
    return not is_baseline(row) and row.name in result.ranked.get(window, {}).get(metric, ())


def is_best(result: Result, row: EstimatorRow, metric: str, window: str) -> bool:
    """Whether no row is significantly better than this one, and at least one significantly worse."""
    return not is_baseline(row) and row.name in result.best.get(window, {}).get(metric, ())


def count_best(result: Result, name: str) -> int:
    """How often a row is marked best, over all windows and metrics."""
    return sum(name in rows for metrics in result.best.values() for rows in metrics.values())


def rows_in_order(result: Result) -> list[EstimatorRow]:
    """Rows as people see them: what flew, the filters, the baseline, other onboard rows."""

    def place(row: EstimatorRow) -> int:
        if row.is_reference or row.name == "onboard":
            return 0
        return 1 if row.kind == "replay" and not is_baseline(row) else 2 if row.kind == "replay" else 3

    return sorted(result.estimators, key=place)


# Who has a value in a column, who was compared, who is best, who is worst: once for table, sentences and bars.

BASELINE_REMARK = "the gyro alone, shown for comparison"
SELF_COMPARED = ("noise_", "drift_rest_")
"""Columns in which a row is compared with nothing but itself."""
NOT_COMPARED = "too little data in common"


@dataclass(slots=True)
class RankedValue:
    """One row with an answer that has a value. ``ranked``: it was compared with others."""

    row: EstimatorRow
    answer: Answer
    ranked: bool

    @property
    def name(self) -> str:
        """What the row is called in a sentence."""
        return name_in_sentence(self.row)

    @property
    def value(self) -> float:
        """The value."""
        return value_of(self.answer)

    @property
    def size(self) -> float:
        """How far from perfect: drift and lag without their sign."""
        return abs(self.value)

    @property
    def replay(self) -> bool:
        """Whether it is a filter that was run again."""
        return self.row.kind == "replay"

    @property
    def shown(self) -> bool:
        """Whether a card has a bar for it: filters and the onboard attitude; other onboard rows stand in the table."""
        return self.replay or self.row.name == "onboard"

    @property
    def text(self) -> str:
        """The value with its unit, as the table writes it."""
        return quantity(self.value, self.answer.unit)

    @property
    def interval(self) -> str:
        """The interval in brackets with a blank before it; empty where there is none."""
        text = interval(self.answer.ci95, self.answer.unit)
        return f" ({text})" if text else ""

    @property
    def ends(self) -> tuple[float, float]:
        """The interval, the value twice where there is none."""
        low, high = self.answer.ci95 if self.answer.ci95 is not None else (self.value, self.value)
        return low, high

    @property
    def significant(self) -> bool:
        """Whether the interval excludes zero."""
        return self.answer.ci95 is not None and not self.ends[0] <= 0.0 <= self.ends[1]


@dataclass(frozen=True, slots=True)
class MissingValue:
    """One row without a value: why."""

    row: EstimatorRow
    code: str
    reason: str


@dataclass(slots=True)
class ColumnRanking:
    """One metric in one window: rows with a value, the least first, and rows without.

    ``best`` are the rows that no row is significantly better than, empty where that is
    everybody (too close to rank) or where one row stands alone; ``worst`` is the one
    that is worst. The baseline and the onboard attitude are among ``judged`` and never in these.
    ``total``: how many filters the table has, the baseline left out.
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
        """The rows that were compared, the least first."""
        return [j for j in self.judged if j.ranked]

    @property
    def filters(self) -> list[RankedValue]:
        """Replayed rows with a value, the baseline left out."""
        return [j for j in self.judged if j.replay and not is_baseline(j.row)]

    @property
    def compared(self) -> str:
        """How many rows were compared: ``7 filters``, ``5 ranked filters`` where the table has others too."""
        return f"{len(self.ranked)} {'filters' if self.total == len(self.ranked) else 'ranked filters'}"

    @property
    def onboard(self) -> RankedValue | None:
        """The onboard attitude, unless this column compares all rows with it."""
        by_itself = self.metric.startswith(SELF_COMPARED)
        return next((j for j in self.judged if j.row.name == "onboard" and (by_itself or not j.row.is_reference)), None)

    def of(self, row: EstimatorRow) -> RankedValue | None:
        """The value of a row, None without."""
        return next((j for j in self.judged if j.row.name == row.name), None)


def rank_column(result: Result, metric: str, windows: tuple[str, ...]) -> ColumnRanking:
    """The column of a metric in the first of the windows in which a filter has a value."""
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
    # ranked pair by pair on the time that both share: a row that is worse there may have a smaller value over all
    largest = max((j.size for j in found.ranked), default=0.0)
    found.worst = next((j for j in found.ranked if j.row.name in worst and j.size == largest), None)
    return found


def reason_unranked(judged: RankedValue) -> str:
    """Why a value is not ranked."""
    if is_baseline(judged.row):
        return BASELINE_REMARK
    if judged.row.status != "ok":
        return judged.row.reason or judged.row.status.replace("_", " ")
    return judged.answer.reason or NOT_COMPARED


# Which heading reference the drift in the air is quoted against.

DRIFT_AIR = "drift_air_deg_per_min"


CODE_TOO_UNCERTAIN = "too_uncertain"
"""The code of an answer that leaves so much open that it tells nothing."""
CODE_TOO_SHORT = "record_too_short"
"""The code of a heading reference that is there for less time than a drift takes."""
HEADING_REFERENCE_ORDER = ("truth", "smoother", "gnss_yaw", "onboard", "mag", "yaw_estimator", "course")
"""The order in which a heading reference is quoted; with truth no other is."""


def quoted_heading_reference(result: Result) -> str:
    """The heading reference that drift in the air is quoted against, whatever it ranks.

    The first of QUOTED by which any replayed row has a value; truth also where it tells nothing.
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
