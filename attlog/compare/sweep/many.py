"""What many settings of one filter are worth on one log: only the metrics that are asked for, each setting once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

from attlog import estimators, metrics
from attlog.analysis import replay
from attlog.base.errors import UsageError, suggestion
from attlog.compare.configurations.configuration import Configuration
from attlog.compare.configurations.input_changes import prepared
from attlog.compare.sweep.grid import Setting, text_of
from attlog.flight.calibration.recorrection import units_with
from attlog.flight.model import Imu, Mag
from attlog.flight.parameters.file import read_file
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case
from attlog.metrics.errors import rmse
from attlog.metrics.ranking.best import MIN_COVERAGE_PCT
from attlog.metrics.trials import still
from attlog.present.table.columns import NOISE_TITLES
from attlog.reference.model import Row

AT_A_TIME = 32
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
        title = (
            metrics.definitions()[self.metric]
            .title.replace("Inclination", "Tilt")
            .replace(", root mean square", " RMS")
        )
        return title if self.window == "all" else f"{title}, {self.window}"


def wanted(texts: Iterable[str]) -> list[SweptMetric]:
    """The metrics that texts such as ``inclination_rmse_deg``, ``noise_tilt_deg@hover`` name.

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
        raise UsageError("\n".join(wrong) or "no metric; give one such as inclination_rmse_deg")
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
            given = read_file(configuration.params)
            facts = replace(facts, given={**facts.given, **given})
            imu, mag = units_with(case.log, configuration.params.name, given, imu, mag)
        before = {name: value for name, value in configuration.before.items() if name != "params"}
        if before:
            imu, mag = prepared(before, case.log, imu, mag)
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
            _window(case, metric)
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
        new = {text_of(s): s for s in settings if text_of(s) not in self._known}
        waiting = list(new.items())
        for begin in range(0, len(waiting), AT_A_TIME):
            some = waiting[begin : begin + AT_A_TIME]
            rows = self._samples.rows([s for _, s in some])
            for text, _ in reversed(some):
                row = rows.pop()
                self._known[text] = self._settled(row)
                self.case.done_with(row)
        return [self._known[text_of(s)] for s in settings]

    def why_not_best(self, setting: Setting) -> str:
        """Why a setting may win nothing although it has a value: gravity does not correct it. Runs the filter again."""
        return still.why_uncorrected(self.case, self._samples.rows([setting])[0]) or ""

    def _settled(self, row: Row) -> SettingResult:
        seen = self.case.looked_at_with([row])
        found: dict[SweptMetric, Answer] = {}
        for window in dict.fromkeys(w.window for w in self.asked):
            answers: dict[str, Answer] = {}
            here = [w for w in self.asked if w.window == window]
            for question in self._questions:
                only = {"only": {w.metric for w in here}} if question is rmse else {}
                answers |= question.compute(seen, row, window, **only)
            for metric in here:
                nothing = f"{metric.metric} means nothing in window {window}"
                found[metric] = answers.get(metric.metric) or missing("not_applicable", nothing, metric.unit, window)
        why = _unsound(row) or (still.why_uncorrected(seen, row) or "" if self.guarded else "")
        return SettingResult(found, row.status, why)


def _unsound(row: Row) -> str:
    """Why a row may be best in nothing, "" where it may."""
    if row.status != "ok":
        return row.reason or row.status
    if row.coverage_pct is not None and row.coverage_pct < MIN_COVERAGE_PCT:
        return f"scored on {row.coverage_pct:.0f} % of its time only"
    return ""


def _window(case: Case, metric: SweptMetric) -> None:
    try:
        case.segments.spans(metric.window)
    except ValueError as error:
        raise UsageError(f"{metric.name}: {error}") from None
