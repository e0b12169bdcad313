"""What many settings of one filter are worth on one log: only the metrics that are asked for, each setting once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from attlog import estimators, metrics
from attlog.compare.filter_input import prepare_input
from attlog.compare.grid import Setting, SettingGrid, setting_text
from attlog.compare.paired import RATIO_KINDS, PairedDifference, paired, pool
from attlog.compare.setting import Configuration
from attlog.core.errors import UsageError, suggestion
from attlog.flight.model import Imu, Mag
from attlog.flight.parameters import read_parameter_file
from attlog.flight.recalibration import recorrected_units
from attlog.metrics import accuracy, following, statistics
from attlog.metrics.metric import Answer, Case, missing
from attlog.metrics.ranking import MIN_COVERAGE_PCT, distance
from attlog.pipeline import replay
from attlog.reference.model import Row
from attlog.words.table import NOISE_TITLES

BATCH_SIZE = 32
"""Settings that are run together: whole kernels, and the attitudes of so many are held at once."""


@dataclass(frozen=True, slots=True)
class SweptMetric:
    """A metric in a window. ``better`` as the metric's own."""

    metric: str
    window: str
    unit: str
    better: str

    @property
    def name(self) -> str:
        """As it is asked for: ``METRIC`` or ``METRIC@WINDOW``."""
        return self.metric if self.window == "all" else f"{self.metric}@{self.window}"

    @property
    def title(self) -> str:
        """What it is called in words: ``Noise added in hover``, ``Heading error, root mean square``."""
        if self.metric == "noise_tilt_deg":
            return NOISE_TITLES.get("rest" if self.window == "all" else self.window, f"Noise, {self.window}")
        title = metrics.definitions()[self.metric].title.replace(", root mean square", " RMS")
        return title if self.window == "all" else f"{title}, {self.window}"


def parse_metrics(texts: Iterable[str]) -> list[SweptMetric]:
    """The metrics that texts such as ``tilt_rmse_deg``, ``noise_tilt_deg@hover`` name.

    Without a window: all of the log, which for noise is its rest. UsageError tells everything wrong in them.
    """
    known = {m.name: m for q in metrics.questions() if q is not metrics.measured() for m in q.METRICS}
    found: dict[SweptMetric, None] = {}
    wrong = []
    for text in texts:
        name, _, window = (part.strip() for part in text.partition("@"))
        meant = [m for n, m in known.items() if fnmatchcase(n, name)]
        if not meant:
            wrong.append(f"{text}: there is no metric {name}{suggestion(name, known)}")
        if "@" in text and not window:
            wrong.append(f"{text}: no window after @; give one such as {name}@hover")
        found |= dict.fromkeys(SweptMetric(m.name, window or "all", m.unit, m.better) for m in meant)
    if wrong or not found:
        raise UsageError("\n".join(wrong) or "no metric; give one such as tilt_rmse_deg")
    return list(found)


@dataclass(slots=True)
class SettingResult:
    """A setting on a log: its answers by metric, and why it may not be best ("" where it may)."""

    answers: dict[SweptMetric, Answer]
    status: str
    unsound: str = ""

    def fit(self, metric: SweptMetric) -> bool:
        """Whether it may be best in a metric: it has a value there, was sound and was scored on half of the time."""
        return not self.unsound and self.answers[metric].value is not None


@dataclass(frozen=True, slots=True)
class FilterInput:
    """What a configuration's filter sees of a log: prepared once for all settings."""

    case: Case
    row: estimators.EstimatorSpec
    imu: Imu
    mag: Mag | None
    facts: estimators.LogFacts
    aids: estimators.Aids

    @classmethod
    def of(cls, case: Case, configuration: Configuration) -> FilterInput:
        """The samples of the unit that is replayed, with what the configuration does to them before the filter."""
        suffix, imu = next(iter(case.imus.items()))
        mag = None if case.log.mag is None else case.log.mags[case.log.mag]
        facts = replay.facts(case, suffix)
        if configuration.params is not None:
            given = read_parameter_file(configuration.params)
            facts = replace(facts, given={**facts.given, **given})
            imu, mag = recorrected_units(case.log, configuration.params.name, given, imu, mag)
        before = {name: value for name, value in configuration.before.items() if name != "params"}
        if before:
            imu, mag = prepare_input(before, case.log, imu, mag)
        return cls(case, configuration.row, imu, mag, facts, replay.aids_of(case, suffix))

    def rows(self, settings: Sequence[Setting]) -> list[Row]:
        """The rows of settings that are laid over the configuration's own."""
        return replay.batch(self.case, self.imu, self.mag, self.row, settings, self.facts, self.aids)


class SettingsOnLog:
    """Settings of one filter on one log. What was asked before is remembered, so that a search never runs twice."""

    def __init__(
        self, case: Case, configuration: Configuration, asked: Sequence[SweptMetric], *, guarded: bool = False
    ) -> None:
        """``guarded``: each setting is asked whether gravity corrects it, which costs a short run, or wins nothing."""
        self.case, self.asked, self.guarded = case, list(asked), guarded
        self._samples = FilterInput.of(case, configuration)
        for metric in self.asked:
            _check_window(case, metric)
        self._known: dict[str, SettingResult] = {}
        self._questions = [
            q for q in metrics.questions() if {m.name for m in q.METRICS} & {w.metric for w in self.asked}
        ]

    @property
    def name(self) -> str:
        """The log's file name."""
        return self.case.log.path.name

    @property
    def values(self) -> dict[str, float | str]:
        """Every parameter of the default gains on this log."""
        return {name: value for name, (value, _) in self._samples.row.resolved(self._samples.facts).items()}

    def __call__(self, settings: Sequence[Setting]) -> list[SettingResult]:
        """What each setting is worth, in their order."""
        new = {setting_text(s): s for s in settings if setting_text(s) not in self._known}
        waiting = list(new.items())
        for begin in range(0, len(waiting), BATCH_SIZE):
            some = waiting[begin : begin + BATCH_SIZE]
            rows = self._samples.rows([s for _, s in some])
            for text, _ in reversed(some):
                row = rows.pop()
                self._known[text] = self._settled(row)
                self.case.done_with(row)
        return [self._known[setting_text(s)] for s in settings]

    def why_not_best(self, setting: Setting) -> str:
        """Why a setting may win nothing although it has a value: gravity does not correct it. Runs the filter again."""
        return following.why_uncorrected(self.case, self._samples.rows([setting])[0]) or ""

    def _settled(self, row: Row) -> SettingResult:
        seen = self.case.looked_at_with([row])
        found: dict[SweptMetric, Answer] = {}
        for window in dict.fromkeys(w.window for w in self.asked):
            answers: dict[str, Answer] = {}
            here = [w for w in self.asked if w.window == window]
            for question in self._questions:
                only = {"only": {w.metric for w in here}} if question is accuracy else {}
                answers |= question.compute(seen, row, window, **only)
            for metric in here:
                nothing = f"{metric.metric} means nothing in window {window}"
                found[metric] = answers.get(metric.metric) or missing("not_applicable", nothing, metric.unit, window)
        why = _unsound_reason(row) or (following.why_uncorrected(seen, row) or "" if self.guarded else "")
        return SettingResult(found, row.status, why)


def _unsound_reason(row: Row) -> str:
    """Why a row may be best in nothing, "" where it may."""
    if row.status != "ok":
        return row.reason or row.status
    if row.coverage_pct is not None and row.coverage_pct < MIN_COVERAGE_PCT:
        return f"scored on {row.coverage_pct:.0f} % of its time only"
    return ""


def _check_window(case: Case, metric: SweptMetric) -> None:
    try:
        case.segments.spans(metric.window)
    except ValueError as error:
        raise UsageError(f"{metric.name}: {error}") from None


# A grid of settings on one log or on many: the best, which others do not differ significantly, what one for all
# costs.
#
# The best on a log is the setting whose value is nearest to perfect. Others are compared with it pair by pair on
# their
# common units of evidence (:mod:`attlog.compare.paired`); those that stand among the claims of which at
# most 5 % are false (Benjamini1995) are significantly worse, all others do not differ from the best.
#
# Over several logs the best single setting is the one with the smallest mean of the values' sizes over the logs: the
# setting that Laidig2021 calls TAGP, beside each log's own optimum. It is compared with
# the others by the random-effects mean of the logs' paired differences (:mod:`attlog.compare.paired`).

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
    _reject_unsound_winners(settings, cells, first)
    columns = [sweep_column(metric, cells) for metric in first.asked]
    return Sweep(filter_name, grid, settings, names, cells, columns)


def sweep_column(metric: SweptMetric, cells: Sequence[Sequence[SettingResult]]) -> SweepColumn:
    """The best of each log and of all, from the cells [setting][log]; the last setting, the base, wins nothing."""
    sizes = np.array([[distance_or_nan(cell, metric) for cell in row] for row in cells])
    values = np.array([[_value_or_nan(cell.answers[metric]) for cell in row] for row in cells])
    own = [argmin_or_none(sizes[:-1, j]) for j in range(sizes.shape[1])]
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
    used = usable_logs(sizes)
    score = np.mean(sizes[:, used], axis=1) if used else np.full(len(cells), math.nan)
    single = argmin_or_none(score[:-1])
    beside = [] if single is None else _setting_differences(metric, [[row[j] for j in used] for row in cells], single)
    nothing = SettingDifference("ratio", None, None, False, "no setting has a value on every log")
    left_out = {j: _left_out_reason(metric, [row[j] for row in cells]) for j in range(sizes.shape[1]) if j not in used}
    return SweepColumn(metric, values, own, own_near, score, single, beside or [nothing] * len(cells), used, left_out)


def usable_logs(sizes: Array) -> list[int]:
    """The logs on which some setting of the grid may be best, of sizes (settings, logs)."""
    return np.flatnonzero(np.isfinite(sizes[:-1]).any(axis=0)).tolist()


def _left_out_reason(metric: SweptMetric, cells: Sequence[SettingResult]) -> str:
    """Why no setting may be best on a log: what most of them say."""
    said = [cell.unsound or cell.answers[metric].reason or "no value" for cell in cells]
    return max(said, key=said.count)


def distance_or_nan(cell: SettingResult, metric: SweptMetric) -> float:
    """How far a setting is from perfect on a log; NaN where it may not be best."""
    return distance(cell.answers[metric], metric.better)[1] if cell.fit(metric) else math.nan


def argmin_or_none(sizes: Array) -> int | None:
    """The number of the smallest of sizes (k,), None where none is known."""
    return None if not np.isfinite(sizes).any() else int(np.nanargmin(sizes))


def _setting_differences(
    metric: SweptMetric, cells: Sequence[Sequence[SettingResult]], best: int
) -> list[SettingDifference]:
    """Every setting next to the best, over all logs."""
    if len(cells[best]) == 1:
        return _differences_on_log(metric, [row[0] for row in cells], best)
    found: list[tuple[SettingDifference, float]] = []
    for row in cells:
        found.append(pooled_setting_difference(metric, cells[best], row))
    return _control_false_claims(found)


def pooled_setting_difference(
    metric: SweptMetric, first: Sequence[SettingResult], second: Sequence[SettingResult]
) -> tuple[SettingDifference, float]:
    """The second setting next to the first over the same logs, and the p of their being equal."""
    compared = [log_setting_difference(metric, a, b) for a, b in zip(first, second, strict=True)]
    known = [c for c in compared if not isinstance(c, str)]
    if len(known) < len(compared) or not known:
        why = next((c for c in compared if isinstance(c, str)), "no log")
        return SettingDifference("ratio", None, None, False, why), 1.0
    scale = "ratio" if all(c[0] == "ratio" for c in known) else "difference"
    values = [c[1] if c[0] == scale else c[3] for c in known]
    together = pool(values, [c[2] if c[0] == scale else None for c in known])
    return _on_setting_scale(scale, together.value, together.ci95), 1.0 if together.p is None else together.p


def log_setting_difference(
    metric: SweptMetric, best: SettingResult, other: SettingResult
) -> tuple[str, float, float | None, float] | str:
    """Scale, difference on it, its standard error and the difference of sizes on one log; why they have none.

    Where a log is too short to pair its units the difference stands without an error: the logs then weigh the same.
    """
    p = _paired_setting(metric, best, other)
    if isinstance(p, str) and not other.fit(metric):
        return p
    a, b = distance_or_nan(best, metric), distance_or_nan(other, metric)
    if not isinstance(p, str):
        return p.scale, p.value, p.error, b - a
    kind = None if (units := best.answers[metric].units) is None else units.kind
    if kind in RATIO_KINDS and min(a, b) > 0.0:
        return "ratio", math.log(b / a), None, b - a
    return "difference", b - a, None, b - a


def _differences_on_log(metric: SweptMetric, cells: Sequence[SettingResult], best: int) -> list[SettingDifference]:
    """Every setting next to the best of one log."""
    found: list[tuple[SettingDifference, float]] = []
    for cell in cells:
        p = _paired_setting(metric, cells[best], cell)
        if isinstance(p, str):
            found.append((SettingDifference("ratio", None, None, False, p), 1.0))
        else:
            found.append(
                (_on_setting_scale(p.scale, p.value, p.ci95), 1.0 if p.p is None or p.direction == "same" else p.p)
            )
    return _control_false_claims(found)


def _paired_setting(metric: SweptMetric, best: SettingResult, other: SettingResult) -> PairedDifference | str:
    if not other.fit(metric):
        return other.unsound or other.answers[metric].reason or "no value"
    return paired(best.answers[metric], other.answers[metric], metric.better)


def _on_setting_scale(scale: str, value: float, ci95: tuple[float, float] | None) -> SettingDifference:
    """Logarithms of ratios become ratios."""
    if scale != "ratio":
        return SettingDifference(scale, value, ci95, False)
    return SettingDifference(
        scale, math.exp(value), None if ci95 is None else (math.exp(ci95[0]), math.exp(ci95[1])), False
    )


def _control_false_claims(found: Sequence[tuple[SettingDifference, float]]) -> list[SettingDifference]:
    """The claims that stand together: worse, with the interval of the difference on that side."""
    stand = statistics.significant(np.array([p for _, p in found]))
    neutral = {"ratio": 1.0}
    differences = []
    for (b, _), stands in zip(found, stand.tolist(), strict=True):
        worse = b.value is not None and b.ci95 is not None and b.ci95[0] > neutral.get(b.scale, 0.0)
        differences.append(SettingDifference(b.scale, b.value, b.ci95, bool(stands and worse), b.why))
    return differences


def _reject_unsound_winners(
    settings: Sequence[Setting], cells: Sequence[Sequence[SettingResult]], log: SettingsOnLog
) -> None:
    """Settings that gravity does not correct win nothing: asked of those that would, until none of them does."""
    checked: set[int] = set()
    while True:
        columns = [leading_settings(metric, cells) for metric in log.asked]
        leaders = {k for best in columns for k in best} - checked
        if not leaders:
            return
        for k in leaders:
            checked.add(k)
            why = log.why_not_best(settings[k])
            for cell in cells[k] if why else ():
                cell.unsound = why


def leading_settings(metric: SweptMetric, cells: Sequence[Sequence[SettingResult]]) -> list[int]:
    """The settings that would be best, of a log or of all."""
    sizes = np.array([[distance_or_nan(cell, metric) for cell in row] for row in cells])[:-1]
    used = np.isfinite(sizes).any(axis=0)
    found = [
        argmin_or_none(np.mean(sizes[:, used], axis=1)) if used.any() else None,
        *(argmin_or_none(sizes[:, j]) for j in range(sizes.shape[1])),
    ]
    return [k for k in found if k is not None]


def _value_or_nan(answer: Answer) -> float:
    return math.nan if answer.value is None else answer.value
