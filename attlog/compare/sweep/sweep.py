"""A grid of settings on one log or on many: the best, which others do not differ significantly, what one for all costs.

The best on a log is the setting whose value is nearest to perfect. Others are compared with it pair by pair on their
common units of evidence (:mod:`attlog.compare.differences.paired`); those that stand among the claims of which at
most 5 % are false (Benjamini1995) are significantly worse, all others do not differ from the best.

Over several logs the best single setting is the one with the smallest mean of the values' sizes over the logs: the
setting that Laidig2021 calls TAGP, beside each log's own optimum. It is compared with
the others by the random-effects mean of the logs' paired differences (:mod:`attlog.compare.differences.pooled`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.compare.differences.paired import RATIOS, PairedDifference, paired
from attlog.compare.differences.pooled import pool
from attlog.compare.sweep.grid import Setting, SettingGrid
from attlog.compare.sweep.many import SettingResult, SettingsOnLog, SweptMetric
from attlog.metrics.answer import Answer
from attlog.metrics.ranking.best import distance
from attlog.metrics.statistics import pairs

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SettingDifference:
    """A setting beside the best: ``ratio`` of their values (or ``difference`` in the metric's unit) with its interval.

    ``worse``: significantly so. ``why``: the sentence where they cannot be compared.
    """

    scale: str
    value: float | None
    ci95: tuple[float, float] | None
    worse: bool
    why: str = ""


@dataclass(slots=True)
class SweepColumn:
    """One metric of a sweep: settings by number, the last being the default gains without the grid.

    ``values`` (settings, logs) as measured, NaN where there is none; ``own`` the best setting of each log (None
    where no setting has a value), ``own_near`` those that do not differ significantly; ``score`` (settings,) the mean
    size over the ``used`` logs, NaN where one of them has no value; ``single`` the best of all, ``beside`` the others
    next to it. ``left_out``: why a log does not count, by its number: no setting may be best on it.
    """

    metric: SweptMetric
    values: Array
    own: list[int | None]
    own_near: list[list[int]]
    score: Array
    single: int | None
    beside: list[SettingDifference]
    used: list[int]
    left_out: dict[int, str]

    @property
    def near(self) -> list[int]:
        """Settings of the grid that do not differ significantly from the single best, with it."""
        compared = [k for k, b in enumerate(self.beside[:-1]) if not b.worse and math.isfinite(self.score[k])]
        return sorted({*compared, *([] if self.single is None else [self.single])})


@dataclass(slots=True)
class Sweep:
    """A grid over logs. ``cells`` [setting][log]; ``logs`` their names; the first column decides."""

    filter: str
    grid: SettingGrid
    settings: list[Setting]
    logs: list[str]
    cells: list[list[SettingResult]]
    columns: list[SweepColumn]

    @property
    def base(self) -> int:
        """The number of the default gains."""
        return len(self.settings) - 1


def sweep(filter_name: str, grid: SettingGrid, logs: Iterable[SettingsOnLog]) -> Sweep:
    """Run a grid over logs, one or more, each with the same metrics asked for. Errors as in ``replay.batch``.

    But for the first, each log is released before the next is asked for.
    """
    settings: list[Setting] = [*grid, {}]
    coming = iter(logs)
    first = next(coming)
    names, by_log = [first.name], [first(settings)]
    for log in coming:
        names.append(log.name)
        by_log.append(log(settings))
        del log
    cells = [[of_log[k] for of_log in by_log] for k in range(len(settings))]
    _unsound_winners(settings, cells, first)
    columns = [column(metric, cells) for metric in first.asked]
    return Sweep(filter_name, grid, settings, names, cells, columns)


def column(metric: SweptMetric, cells: Sequence[Sequence[SettingResult]]) -> SweepColumn:
    """The best of each log and of all, from the cells [setting][log]; the last setting, the base, wins nothing."""
    sizes = np.array([[size(cell, metric) for cell in row] for row in cells])
    values = np.array([[_number(cell.answers[metric]) for cell in row] for row in cells])
    own = [lowest(sizes[:-1, j]) for j in range(sizes.shape[1])]
    own_near = [
        []
        if best is None
        else [
            k
            for k, b in enumerate(_differences_on_log(metric, [row[j] for row in cells], best)[:-1])
            if not b.worse and math.isfinite(sizes[k, j])
        ]
        for j, best in enumerate(own)
    ]
    used = usable(sizes)
    score = np.mean(sizes[:, used], axis=1) if used else np.full(len(cells), math.nan)
    single = lowest(score[:-1])
    beside = [] if single is None else _differences(metric, [[row[j] for j in used] for row in cells], single)
    nothing = SettingDifference("ratio", None, None, False, "no setting has a value on every log")
    left_out = {j: _why(metric, [row[j] for row in cells]) for j in range(sizes.shape[1]) if j not in used}
    return SweepColumn(metric, values, own, own_near, score, single, beside or [nothing] * len(cells), used, left_out)


def usable(sizes: Array) -> list[int]:
    """The logs on which some setting of the grid may be best, of sizes (settings, logs)."""
    return np.flatnonzero(np.isfinite(sizes[:-1]).any(axis=0)).tolist()


def _why(metric: SweptMetric, cells: Sequence[SettingResult]) -> str:
    """Why no setting may be best on a log: what most of them say."""
    said = [cell.unsound or cell.answers[metric].reason or "no value" for cell in cells]
    return max(said, key=said.count)


def size(cell: SettingResult, metric: SweptMetric) -> float:
    """How far a setting is from perfect on a log; NaN where it may not be best."""
    return distance(cell.answers[metric], metric.better)[1] if cell.fit(metric) else math.nan


def lowest(sizes: Array) -> int | None:
    """The number of the smallest of sizes (k,), None where none is known."""
    return None if not np.isfinite(sizes).any() else int(np.nanargmin(sizes))


def _differences(metric: SweptMetric, cells: Sequence[Sequence[SettingResult]], best: int) -> list[SettingDifference]:
    """Every setting next to the best, over all logs."""
    if len(cells[best]) == 1:
        return _differences_on_log(metric, [row[0] for row in cells], best)
    found: list[tuple[SettingDifference, float]] = []
    for row in cells:
        found.append(over_logs(metric, cells[best], row))
    return _significant(found)


def over_logs(
    metric: SweptMetric, first: Sequence[SettingResult], second: Sequence[SettingResult]
) -> tuple[SettingDifference, float]:
    """The second setting next to the first over the same logs, and the p of their being equal."""
    compared = [whole(metric, a, b) for a, b in zip(first, second, strict=True)]
    known = [c for c in compared if not isinstance(c, str)]
    if len(known) < len(compared) or not known:
        why = next((c for c in compared if isinstance(c, str)), "no log")
        return SettingDifference("ratio", None, None, False, why), 1.0
    scale = "ratio" if all(c[0] == "ratio" for c in known) else "difference"
    values = [c[1] if c[0] == scale else c[3] for c in known]
    together = pool(values, [c[2] if c[0] == scale else None for c in known])
    return _shown(scale, together.value, together.ci95), 1.0 if together.p is None else together.p


def whole(
    metric: SweptMetric, best: SettingResult, other: SettingResult
) -> tuple[str, float, float | None, float] | str:
    """Scale, difference on it, its standard error and the difference of sizes on one log; why they have none.

    Where a log is too short to pair its units the difference stands without an error: the logs then weigh the same.
    """
    p = _pair(metric, best, other)
    if isinstance(p, str) and not other.fit(metric):
        return p
    a, b = size(best, metric), size(other, metric)
    if not isinstance(p, str):
        return p.scale, p.value, p.error, b - a
    kind = None if (units := best.answers[metric].units) is None else units.kind
    if kind in RATIOS and min(a, b) > 0.0:
        return "ratio", math.log(b / a), None, b - a
    return "difference", b - a, None, b - a


def _differences_on_log(metric: SweptMetric, cells: Sequence[SettingResult], best: int) -> list[SettingDifference]:
    """Every setting next to the best of one log."""
    found: list[tuple[SettingDifference, float]] = []
    for cell in cells:
        p = _pair(metric, cells[best], cell)
        if isinstance(p, str):
            found.append((SettingDifference("ratio", None, None, False, p), 1.0))
        else:
            found.append((_shown(p.scale, p.value, p.ci95), 1.0 if p.p is None or p.direction == "same" else p.p))
    return _significant(found)


def _pair(metric: SweptMetric, best: SettingResult, other: SettingResult) -> PairedDifference | str:
    if not other.fit(metric):
        return other.unsound or other.answers[metric].reason or "no value"
    return paired(best.answers[metric], other.answers[metric], metric.better)


def _shown(scale: str, value: float, ci95: tuple[float, float] | None) -> SettingDifference:
    """Logarithms of ratios become ratios."""
    if scale != "ratio":
        return SettingDifference(scale, value, ci95, False)
    return SettingDifference(
        scale, math.exp(value), None if ci95 is None else (math.exp(ci95[0]), math.exp(ci95[1])), False
    )


def _significant(found: Sequence[tuple[SettingDifference, float]]) -> list[SettingDifference]:
    """The claims that stand together: worse, with the interval of the difference on that side."""
    stand = pairs.significant(np.array([p for _, p in found]))
    neutral = {"ratio": 1.0}
    differences = []
    for (b, _), stands in zip(found, stand.tolist(), strict=True):
        worse = b.value is not None and b.ci95 is not None and b.ci95[0] > neutral.get(b.scale, 0.0)
        differences.append(SettingDifference(b.scale, b.value, b.ci95, bool(stands and worse), b.why))
    return differences


def _unsound_winners(settings: Sequence[Setting], cells: Sequence[Sequence[SettingResult]], log: SettingsOnLog) -> None:
    """Settings that gravity does not correct win nothing: asked of those that would, until none of them does."""
    checked: set[int] = set()
    while True:
        columns = [column_of_sizes(metric, cells) for metric in log.asked]
        leaders = {k for best in columns for k in best} - checked
        if not leaders:
            return
        for k in leaders:
            checked.add(k)
            why = log.why_not_best(settings[k])
            for cell in cells[k] if why else ():
                cell.unsound = why


def column_of_sizes(metric: SweptMetric, cells: Sequence[Sequence[SettingResult]]) -> list[int]:
    """The settings that would be best, of a log or of all."""
    sizes = np.array([[size(cell, metric) for cell in row] for row in cells])[:-1]
    used = np.isfinite(sizes).any(axis=0)
    found = [
        lowest(np.mean(sizes[:, used], axis=1)) if used.any() else None,
        *(lowest(sizes[:, j]) for j in range(sizes.shape[1])),
    ]
    return [k for k in found if k is not None]


def _number(answer: Answer) -> float:
    return math.nan if answer.value is None else answer.value
