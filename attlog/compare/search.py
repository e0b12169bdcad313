"""Compare parameter sets of one filter: each log's best, and one set for all logs.

The best set on a log has the value nearest to ideal. All others are compared with it pair by pair
(:mod:`attlog.compare.paired`). The significantly worse ones are selected at a false discovery rate of 5 %
(Benjamini1995). Over several logs the single best has the smallest mean distance from ideal (TAGP in Laidig2021); it is
compared by the random-effects mean of the logs' paired differences.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from attlog import metrics
from attlog.compare.comparison import OWN_REFERENCE, Question, commonest_reason, parse_metrics, question_of
from attlog.compare.filter_input import FilterInput
from attlog.compare.grid import Setting, SettingGrid, setting_text
from attlog.compare.paired import RATIO_KINDS, Difference, Scale, paired, pool
from attlog.compare.setting import Configuration
from attlog.core.errors import UsageError
from attlog.metrics import following, statistics
from attlog.metrics.metric import Answer, Case, missing
from attlog.metrics.ranking import MIN_COVERAGE_PCT, distance
from attlog.pipeline.onboard_rerun import study_mode
from attlog.reference.model import Track

Array = NDArray[np.float64]

# Parameter sets in one batch; limits the attitudes held in memory.
BATCH_SIZE = 32


# Innovation that decides for a re-run onboard filter, by part of the parameter's name; the first match counts.
DECIDING_AIDS = {
    "GPS": "gnss_velocity",
    "VEL": "gnss_velocity",
    "MAG": "compass_field",
    "HDG": "compass_heading",
    "BARO": "height",
    "HGT": "height",
}
FLOWN_AIDS = ("gnss_velocity", "compass_field", "compass_heading", "height")


def flown_questions(
    cases: Sequence[Case], configuration: Configuration, axes: Iterable[str], plain: Sequence[str]
) -> tuple[list[Question], list[Question]]:
    """Return the questions that judge settings of a re-run onboard filter.

    These are the metrics ``plain``, and innovations, the deciding one first. ``plain`` is dropped where the reference
    of a log is the filter's own attitude. Innovations are those of the first log. ``axes``: parameters that are varied.
    """
    own = [aid for axis in axes for part, aid in DECIDING_AIDS.items() if part in axis]
    innovations = swept_questions(f"innovation_rms.{aid}" for aid in dict.fromkeys([*own, *FLOWN_AIDS]))
    answers = SettingsOnLog(cases[0], configuration, innovations)([{}])[0].answers
    judged = [] if any(case.reference.kind == "onboard" for case in cases) else swept_questions(plain)
    return judged, [q for q in innovations if answers[q].value is not None]


def swept_questions(texts: Iterable[str]) -> list[Question]:
    """Parse questions such as ``tilt_rmse_deg``, ``noise_tilt_deg@hover``.

    The default window is the whole log. UsageError lists every error. Metrics that run the filter again are excluded.
    """
    known = [m for q in metrics.groups() for m in q.metrics]
    return [question_of(metric, window or "all") for metric, window in parse_metrics(texts, known)]


@dataclass(slots=True)
class SettingResult:
    """Answers of one parameter set on one log.

    ``unsound``: why it may not be best, empty if it may.
    """

    answers: dict[Question, Answer]
    status: str
    unsound: str = ""

    def counts(self, question: Question) -> bool:
        """Return whether the set may be best in a question."""
        return not self.unsound and self.answers[question].value is not None

    def distance(self, question: Question) -> float:
        """Return the distance from ideal, NaN if the set may not be best."""
        return distance(self.answers[question], question.better)[1] if self.counts(question) else math.nan

    def reason(self, question: Question) -> str:
        """Return why the set may not be best."""
        return self.unsound or self.answers[question].reason or "no value"


class SettingsOnLog:
    """Parameter sets of one filter on one log, with cached results."""

    def __init__(
        self, case: Case, configuration: Configuration, questions: Sequence[Question], *, guarded: bool = False
    ) -> None:
        """Prepare the filter's input.

        ``guarded``: exclude sets that gravity does not correct; a short second run detects them.
        """
        self.case, self.questions, self.guarded = case, list(questions), guarded
        self._own_reference = configuration.is_flown and case.reference.kind == "onboard"
        self._input = FilterInput.of(case, configuration)
        for question in self.questions:
            _check_window(case, question)
        asked = {q.metric for q in self.questions}
        self._computed = [q for q in metrics.groups() if {m.name for m in q.metrics} & asked]
        self._known: dict[str, SettingResult] = {}

    @property
    def name(self) -> str:
        """Return the log's file name."""
        return self.case.log.path.name

    @property
    def mode(self) -> str:
        """Return the mode of a re-run onboard filter, else an empty text."""
        c = self._input.configuration
        return study_mode(self.case, str(self._input.imu.index), c.row.estimator.name) if c.is_flown else ""

    @property
    def values(self) -> dict[str, float | str]:
        """Return every parameter of the default gains on this log."""
        return self._input.values

    def __call__(self, settings: Sequence[Setting]) -> list[SettingResult]:
        """Return the result of each parameter set, in their order."""
        new = list({setting_text(s): s for s in settings if setting_text(s) not in self._known}.items())
        for begin in range(0, len(new), BATCH_SIZE):
            some = new[begin : begin + BATCH_SIZE]
            rows = self._input.rows([s for _, s in some])
            for text, _ in reversed(some):
                row = rows.pop()
                self._known[text] = self._result(row)
                self.case.done_with(row)
        return [self._known[setting_text(s)] for s in settings]

    def why_uncorrected(self, setting: Setting) -> str:
        """Return why gravity does not correct a set, else empty; runs it again."""
        return following.why_uncorrected(self.case, self._input.rows([setting])[0]) or ""

    def _result(self, row: Track) -> SettingResult:
        seen = self.case.with_rows([row])
        found: dict[Question, Answer] = {}
        for window in dict.fromkeys(q.window for q in self.questions):
            here = [q for q in self.questions if q.window == window]
            answers: dict[str, Answer] = {}
            for computed in self._computed:
                answers |= computed.ask(seen, row, window)
            for q in here:
                nothing, answer = f"{q.metric} means nothing in window {window}", answers.get(q.metric)
                if self._own_reference and q.needs_reference:
                    nothing, answer = OWN_REFERENCE, None
                found[q] = answer or missing("not_applicable", nothing, q.unit, window)
        why = _unsound_reason(row) or (following.why_uncorrected(seen, row) or "" if self.guarded else "")
        return SettingResult(found, row.status, why)


def _unsound_reason(row: Track) -> str:
    """Return why a row may be best in no question, else an empty text."""
    if row.status != "ok":
        return row.reason or row.status
    if row.coverage_pct is not None and row.coverage_pct < MIN_COVERAGE_PCT:
        return f"scored on {row.coverage_pct:.0f} % of its time only"
    return ""


def _check_window(case: Case, question: Question) -> None:
    try:
        case.segments.spans(question.window)
    except ValueError as error:
        raise UsageError(f"{question.name}: {error}") from None


@dataclass(slots=True)
class SweepColumn:
    """One question of a sweep; settings are indices, the last is the default gains.

    ``values`` (settings, logs): as measured, NaN for missing. ``own``: best setting of each log (None without one).
    ``own_near``: settings not significantly different from it. ``score`` (settings,): mean distance from ideal over the
    ``used`` logs, NaN where a log has no value. ``single``: best over all logs, ``differences`` to it by setting.
    ``left_out``: log index -> why no setting may be best there.
    """

    question: Question
    values: Array
    own: list[int | None]
    own_near: list[list[int]]
    score: Array
    single: int | None
    differences: list[Difference]
    used: list[int]
    left_out: dict[int, str]

    @property
    def near(self) -> list[int]:
        """Return the single best, and grid settings not significantly different from it."""
        found = {k for k in _not_worse(self.differences[:-1]) if math.isfinite(self.score[k])}
        return sorted(found | ({self.single} if self.single is not None else set()))


@dataclass(slots=True)
class Sweep:
    """Grid over logs. The first column decides.

    ``cells``: [setting][log]. ``logs``: their names. ``modes``: of re-runs on them.
    """

    filter: str
    grid: SettingGrid
    settings: list[Setting]
    logs: list[str]
    cells: list[list[SettingResult]]
    columns: list[SweepColumn]
    modes: list[str] = field(default_factory=list)

    @property
    def base(self) -> int:
        """Return the index of the default gains."""
        return len(self.settings) - 1


def sweep(filter_name: str, grid: SettingGrid, logs: Iterable[SettingsOnLog]) -> Sweep:
    """Run a grid over one or more logs. Errors as of ``replay.batch``.

    Each log but the first is released before the next is requested.
    """
    settings: list[Setting] = [*grid, {}]
    coming = iter(logs)
    first = next(coming)
    names, by_log, modes = [first.name], [first(settings)], [first.mode]
    for log in coming:
        names.append(log.name)
        by_log.append(log(settings))
        modes.append(log.mode)
        del log
    cells = [[of_log[k] for of_log in by_log] for k in range(len(settings))]
    _reject_unsound_winners(settings, cells, first)
    columns = [sweep_column(q, cells) for q in first.questions]
    return Sweep(filter_name, grid, settings, names, cells, columns, modes)


def sweep_column(question: Question, cells: Sequence[Sequence[SettingResult]]) -> SweepColumn:
    """Return each log's best setting and the overall best from cells [setting][log].

    The last setting (default gains) is never best.
    """
    sizes = np.array([[cell.distance(question) for cell in row] for row in cells])
    answers = [[cell.answers[question].value for cell in row] for row in cells]
    values = np.array([[math.nan if v is None else v for v in row] for row in answers])
    own = [argmin_or_none(sizes[:-1, j]) for j in range(sizes.shape[1])]
    own_near = []
    for j, best in enumerate(own):
        on_log = [] if best is None else _setting_differences(question, [[row[j]] for row in cells], best)[:-1]
        own_near.append([k for k in _not_worse(on_log) if math.isfinite(sizes[k, j])])
    used = np.flatnonzero(np.isfinite(sizes[:-1]).any(axis=0)).tolist()
    score = np.mean(sizes[:, used], axis=1) if used else np.full(len(cells), math.nan)
    single = argmin_or_none(score[:-1])
    nothing = Difference("ratio", reason="no setting has a value on every log")
    differences = [nothing] * len(cells)
    if single is not None:
        differences = _setting_differences(question, [[row[j] for j in used] for row in cells], single)
    left_out = {
        j: commonest_reason(row[j].reason(question) for row in cells) for j in range(sizes.shape[1]) if j not in used
    }
    return SweepColumn(question, values, own, own_near, score, single, differences, used, left_out)


def _not_worse(differences: Sequence[Difference]) -> list[int]:
    return [k for k, d in enumerate(differences) if d.direction != "worse"]


def argmin_or_none(sizes: Array) -> int | None:
    """Return the index of the smallest of sizes (k,), None where none is finite."""
    return None if not np.isfinite(sizes).any() else int(np.nanargmin(sizes))


def _setting_differences(question: Question, cells: Sequence[Sequence[SettingResult]], best: int) -> list[Difference]:
    """Return the difference of every setting to the best, with false discoveries controlled."""
    if len(cells[best]) == 1:
        found = [_paired_setting(question, cells[best][0], row[0]) for row in cells]
    else:
        found = [pooled_setting_difference(question, cells[best], row) for row in cells]
    p = [1.0 if d.p is None or d.direction == "same" else d.p for d in found]
    stand = statistics.significant(np.array(p)).tolist()
    return [
        d
        if d.direction == "same"
        else replace(d, direction="worse" if claim and d.interval_side > 0 else "not significant")
        for d, claim in zip(found, stand, strict=True)
    ]


def _paired_setting(question: Question, best: SettingResult, other: SettingResult) -> Difference:
    if not other.counts(question):
        return Difference("ratio", reason=other.reason(question))
    return paired(best.answers[question], other.answers[question], question.better)


def pooled_setting_difference(
    question: Question, first: Sequence[SettingResult], second: Sequence[SettingResult]
) -> Difference:
    """Return the difference of the second setting to the first, pooled over logs.

    A log too short to pair its units has a difference without standard error; all logs then have equal weight.
    """
    pairs = list(zip(first, second, strict=True))
    found = [_paired_setting(question, a, b) for a, b in pairs]
    lost = next((d for d, (_, b) in zip(found, pairs, strict=True) if d.value is None and not b.counts(question)), None)
    if lost is not None or not found:
        return Difference("ratio", reason=lost.reason if lost is not None else "no log")
    ratios = [
        d.scale if d.value is not None else _unpaired_scale(question, a, b)
        for d, (a, b) in zip(found, pairs, strict=True)
    ]
    scale: Scale = "ratio" if all(s == "ratio" for s in ratios) else "difference"
    same = [
        d if d.value is not None and d.scale == scale else _unpaired(question, a, b, ratio=scale == "ratio")
        for d, (a, b) in zip(found, pairs, strict=True)
    ]
    pooled = pool(same, scale)
    assert pooled is not None
    if len(same) == 1:  # the interval of one log does not cover the scatter between logs
        return replace(pooled, ci95=None, p=None)
    return pooled


def _unpaired_scale(question: Question, a: SettingResult, b: SettingResult) -> Scale:
    units = a.answers[question].units
    kind = None if units is None else units.kind
    return "ratio" if kind in RATIO_KINDS and min(a.distance(question), b.distance(question)) > 0.0 else "difference"


def _unpaired(question: Question, a: SettingResult, b: SettingResult, *, ratio: bool) -> Difference:
    first, second = a.distance(question), b.distance(question)
    found = Difference("ratio", second / first) if ratio else Difference("difference", second - first)
    return replace(found, better=int(second < first), worse=int(second > first))


def _reject_unsound_winners(
    settings: Sequence[Setting], cells: Sequence[Sequence[SettingResult]], log: SettingsOnLog
) -> None:
    """Mark leading settings as unsound where gravity does not correct them."""
    checked: set[int] = set()
    while True:
        leaders = {k for question in log.questions for k in leading_settings(question, cells)} - checked
        if not leaders:
            return
        for k in leaders:
            checked.add(k)
            why = log.why_uncorrected(settings[k])
            for cell in cells[k] if why else ():
                cell.unsound = why


def leading_settings(question: Question, cells: Sequence[Sequence[SettingResult]]) -> list[int]:
    """Return the settings that are best on a log or over all logs."""
    sizes = np.array([[cell.distance(question) for cell in row] for row in cells])[:-1]
    used = np.isfinite(sizes).any(axis=0)
    found = [argmin_or_none(np.mean(sizes[:, used], axis=1)) if used.any() else None]
    found += [argmin_or_none(sizes[:, j]) for j in range(sizes.shape[1])]
    return [k for k in found if k is not None]
