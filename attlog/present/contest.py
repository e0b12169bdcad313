"""Who has a value in a column, who was compared, who is best, who is worst: once for table, sentences and bars."""

from __future__ import annotations

from dataclasses import dataclass, field

from attlog.present.names import name_in_sentence
from attlog.present.numbers import SIGNED, interval, quantity
from attlog.present.table.rows import has_value, is_baseline, is_best, is_ranked, value_of, window_of
from attlog.result import Answer, EstimatorRow, Result

THE_BASELINE = "the gyro alone, shown for comparison"
BY_ITSELF = ("noise_", "drift_rest_")
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
        by_itself = self.metric.startswith(BY_ITSELF)
        return next((j for j in self.judged if j.row.name == "onboard" and (by_itself or not j.row.is_reference)), None)

    def of(self, row: EstimatorRow) -> RankedValue | None:
        """The value of a row, None without."""
        return next((j for j in self.judged if j.row.name == row.name), None)


def contest(result: Result, metric: str, windows: tuple[str, ...]) -> ColumnRanking:
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


def why_unranked(judged: RankedValue) -> str:
    """Why a value is not ranked."""
    if is_baseline(judged.row):
        return THE_BASELINE
    if judged.row.status != "ok":
        return judged.row.reason or judged.row.status.replace("_", " ")
    return judged.answer.reason or NOT_COMPARED
