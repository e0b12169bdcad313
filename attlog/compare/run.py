"""All configurations on one log: their answers, and each beside the first."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from attlog import __version__
from attlog.compare.comparison import (
    ComparedMetric,
    Comparison,
    ConfigurationAnswer,
    ConfigurationSummary,
    Contrast,
    LogDifference,
    LogLine,
    PooledDifference,
    Question,
    select_questions,
)
from attlog.compare.filter_input import ConfiguredFilter
from attlog.compare.paired import ALPHA, Direction, PairedDifference, Scale, paired, pool
from attlog.compare.same_flight import FlightTrack, find_repeats, flight_track
from attlog.compare.setting import Configuration, labels, parse_configuration, setting_argument
from attlog.compare.wording import comparison_sentences
from attlog.core.errors import EXIT_BUG, UsageError, error_message, exit_code
from attlog.core.forks import in_processes
from attlog.core.machine import versions
from attlog.core.workers import Died
from attlog.metrics import definitions, ranking
from attlog.metrics.metric import named
from attlog.pipeline import evaluate, prepare
from attlog.pipeline.config import Config
from attlog.result import TIMED_OUT, Answer, EstimatorRow, Result, nothing_ran
from attlog.words.ranking import DRIFT_AIR, HEADING_REFERENCE_ORDER, has_value

__all__ = ["compare", "log_names"]


@dataclass(frozen=True, slots=True)
class ComparisonPlan:
    """How every log is treated: configurations as (name, text), questions, options. It pickles."""

    configurations: tuple[tuple[str, str], ...]
    questions: tuple[ComparedMetric, ...]
    options: dict[str, Any]


@dataclass(slots=True)
class LogComparison:
    """What became of one log: its line, cells by question and configuration, differences by question."""

    line: LogLine
    cells: dict[str, dict[str, ConfigurationAnswer]] = field(default_factory=dict)
    beside: dict[str, dict[str, LogDifference]] = field(default_factory=dict)
    trace: str = ""
    late: tuple[str, ...] = ()
    """Sentences on filters from files that took longer than they were given."""
    track: FlightTrack | None = None
    """What shows whether another log is of the same flight; None of a log that could not be used."""
    nothing_ran: str = ""
    """Why the first configuration failed, where all of them did."""


def compare_on_log(log: Path, name: str, plan: ComparisonPlan) -> LogComparison:
    """One log measured; whatever goes wrong with it, a bug too, stands in its line."""
    try:
        return _compare_on_log(log, name, plan)
    except Exception as error:
        return failed_log(log, name, error)


def failed_log(log: Path, name: str, error: Exception) -> LogComparison:
    """The line of a log that could not be measured."""
    import traceback

    code = exit_code(error)
    text = error_message(error, __version__).removeprefix("attlog: ")
    line = LogLine(name, str(log), code=code, reason=text.removeprefix(f"{log}: "))
    return LogComparison(line, trace="".join(traceback.format_exception(error)) if code == EXIT_BUG else "")


def _compare_on_log(log: Path, name: str, plan: ComparisonPlan) -> LogComparison:
    runs = [ConfiguredFilter(parse_configuration(text, called)) for called, text in plan.configurations]
    case = prepare(log, plan.options)
    result = evaluate(case, runs, only={question.metric for question in plan.questions})
    facts = result.log
    track = flight_track(case.log, name, str(facts.get("sha256") or ""))
    line = LogLine(
        name,
        str(log),
        str(facts.get("sha256") or ""),
        str(facts.get("vehicle") or ""),
        " ".join(str(facts.get("firmware", {}).get(k) or "") for k in ("name", "version")).strip(),
        facts.get("duration_s"),
        f"{result.reference.choice} ({result.reference.source})" if result.reference else "",
    )
    rows = {row.name: row for row in result.estimators}
    late = tuple(finding.text for finding in result.findings if finding.kind == TIMED_OUT)
    return read_result(
        LogComparison(line, late=late, track=track, nothing_ran=nothing_ran(result.estimators)),
        result,
        [rows[called] for called, _ in plan.configurations],
        plan.questions,
    )


def read_result(
    found: LogComparison, result: Result, rows: Sequence[EstimatorRow], questions: Iterable[ComparedMetric]
) -> LogComparison:
    """The cells and differences of some rows of a result that was just evaluated (its answers still have units)."""
    first = rows[0]
    for question in questions:
        metric, window = answer_place(question, rows)
        answers = {row.name: row.metrics.get(window, {}).get(metric) for row in rows}
        found.cells[question.id] = {row.name: _answer_cell(row, answers[row.name], window) for row in rows}
        better = result.definitions.get(metric, {}).get("better", "low")
        found.beside[question.id] = {
            row.name: _log_difference(
                found.line.name, first, row, answers[first.name], answers[row.name], better, window, question.scale
            )
            for row in rows[1:]
        }
    return found


def answer_place(question: ComparedMetric, rows: Sequence[EstimatorRow]) -> tuple[str, str]:
    """Metric and window in which the most rows have a value, of equal ones the first; of drifts in the air the
    heading reference that a report would quote."""
    metrics = [question.metric]
    if question.metric == DRIFT_AIR:
        metrics = [f"{DRIFT_AIR}.{reference}" for reference in HEADING_REFERENCE_ORDER]
    places = [(m, w) for m in metrics for w in question.windows]

    def filled(place: tuple[str, str]) -> int:
        return sum(has_value(row.metrics.get(place[1], {}).get(place[0])) for row in rows)

    return max(places, key=filled)


def _answer_cell(row: EstimatorRow, answer: Answer | None, window: str) -> ConfigurationAnswer:
    if answer is None:
        return ConfigurationAnswer(
            None, window=window, status=row.status, reason=row.reason or "not asked in this window"
        )
    return ConfigurationAnswer(
        answer.value, answer.ci95, answer.n, window, row.status, row.reason or answer.reason or ""
    )


def _log_difference(
    log: str,
    first: EstimatorRow,
    row: EstimatorRow,
    a: Answer | None,
    b: Answer | None,
    better: str,
    window: str,
    scale: Scale,
) -> LogDifference:
    for one in (first, row):
        if one.status != "ok":
            return LogDifference(
                log, None, window=window, reason=f"{one.name}: {one.status.replace('_', ' ')}, {one.reason}"
            )
    if a is None or b is None:
        return LogDifference(log, None, window=window, reason="not asked in this window")
    for one, answer in ((first, a), (row, b)):
        if answer.value is not None and not answer.ranked:
            return LogDifference(log, None, window=window, reason=f"{one.name}: {answer.reason}")
    found = paired(a, b, better)
    if isinstance(found, str) or found.scale != scale:
        return LogDifference(
            log, None, window=window, reason=found if isinstance(found, str) else "nothing to pair on this log"
        )
    return _on_ratio_scale(log, found, ranking.floor(a, b), window)


def _on_ratio_scale(log: str, found: PairedDifference, floor: float, window: str) -> LogDifference:
    value, ci95 = found.value, found.ci95
    if found.scale == "ratio":
        value = math.exp(value)
        ci95 = None if ci95 is None else (math.exp(ci95[0]), math.exp(ci95[1]))
        floor = math.log1p(floor / found.first) if found.first > 0.0 else 0.0
    return LogDifference(
        log, value, ci95, found.p, found.n, found.first, found.second, found.error, floor, found.direction, window
    )


# Several logs as one comparison: what was measured on each, gathered by question and pooled.


def gather(
    configurations: Sequence[Configuration],
    logs: Sequence[LogComparison],
    questions: Sequence[ComparedMetric],
    *,
    attlog: dict[str, str],
    command: str = "",
    config: dict[str, Any] | None = None,
) -> Comparison:
    """The comparison of configurations on logs; a log that failed is a line with its reason and nothing else."""
    called = labels(configurations)
    found = Comparison(attlog, command, config or {}, [_summarize(c, called[c.name]) for c in configurations])
    found.logs = [m.line for m in logs]
    usable = [m for m in logs if m.line.code == 0]
    for asked in questions:
        metric = named(definitions().values(), asked.metric)
        question = Question(
            asked.id,
            asked.metric,
            list(asked.windows),
            asked.title,
            metric.unit,
            metric.better,
            asked.scale,
            asked.main,
        )
        question.cells = {m.line.name: m.cells[asked.id] for m in usable}
        for c in configurations[1:]:
            each = [m.beside[asked.id][c.name] for m in usable]
            once = [b for m, b in zip(usable, each, strict=True) if not m.line.same_as]
            question.contrasts.append(Contrast(c.name, each, pool_differences(once, asked.scale)))
        cells = [cell for by_name in question.cells.values() for cell in by_name.values()]
        if any(cell.value is not None for cell in cells):
            found.questions.append(question)
            found.definitions[asked.id] = metric.definition
        else:
            found.unanswered[asked.id] = commonest_reason(cell.reason for cell in cells) or "no log could be used"
    found.verdicts = comparison_sentences(found)
    return found


def commonest_reason(reasons: Iterable[str]) -> str:
    """The reason given most often, empty where none is given."""
    given = [reason for reason in reasons if reason]
    return max(dict.fromkeys(given), key=given.count) if given else ""


def pool_differences(each: Sequence[LogDifference], scale: Scale) -> PooledDifference | None:
    """Differences of several logs as one; None where no log has any."""
    usable = [b for b in each if b.value is not None]
    if not usable:
        return None
    forward, back = (math.log, math.exp) if scale == "ratio" else (float, float)
    alone = usable[0]
    own = None if alone.ci95 is None else (forward(alone.ci95[0]), forward(alone.ci95[1]))
    pooled = pool([forward(b.value or 0.0) for b in usable], [b.error for b in usable], (own, alone.p))
    floor = median(b.floor for b in usable)
    ci95 = None if pooled.ci95 is None else (back(pooled.ci95[0]), back(pooled.ci95[1]))
    return PooledDifference(
        back(pooled.value),
        ci95,
        pooled.p,
        pooled.logs,
        pooled.better,
        pooled.worse,
        pooled.same,
        pooled.tau,
        pooled.i2_pct,
        pooled.method,
        floor,
        alone.direction
        if len(usable) == 1
        else pooled_direction(pooled.value, pooled.p, pooled.same == pooled.logs, floor),
    )


def pooled_direction(value: float, p: float | None, same: bool, floor: float) -> Direction:
    """Whether a pooled difference is significant: p below 5 %, and larger than what a log resolves."""
    if same:
        return "same"
    if p is None or p >= ALPHA or abs(value) <= floor:
        return "not significant"
    return "better" if value < 0.0 else "worse"


def _summarize(c: Configuration, label: str) -> ConfigurationSummary:
    parameters = {k: f"{v:g}" if isinstance(v, float) else str(v) for k, v in c.row.params.items()}
    before = {k: setting_argument(k, v).partition("=")[2] for k, v in c.before.items()}
    return ConfigurationSummary(c.name, label, c.text, parameters, before)


# Configurations over logs, one after the other or in several processes, as one comparison.


def compare(
    logs: Sequence[Path],
    configurations: Sequence[Configuration],
    config: Config | None = None,
    *,
    metrics: Sequence[str] = (),
    jobs: int = 1,
    command: str = "",
    tell: Callable[[LogComparison], None] | None = None,
) -> Comparison:
    """What each configuration is worth beside the first, on every log and over all of them.

    ``config``: options as of ``attlog analyze``, its window among them; ``metrics``: other questions than the main
    ones (``all`` for every metric). A log that cannot be used is a line with its reason, the others
    finish. Logs of one flight count once where they are pooled. ``tell`` is called with each log as it is
    done. UsageError for fewer than two configurations or an unknown metric.
    """
    if len(configurations) < 2:
        raise UsageError(
            "a comparison needs two configurations or more: attlog compare LOG... mahony:kp=0.3 mahony:kp=0.6"
        )
    config = config or Config()
    questions = select_questions(metrics, config.window)
    names = log_names(logs)
    plan = ComparisonPlan(tuple((c.name, c.text) for c in configurations), tuple(questions), config.resolved())
    found: dict[str, LogComparison] = {}
    work: dict[str, tuple[Any, ...]] = {name: (log, name, plan) for log, name in zip(logs, names, strict=True)}
    if jobs == 1 or len(logs) == 1:
        results = ((name, compare_on_log(*arguments)) for name, arguments in work.items())
    else:
        results = _in_processes(work, jobs)
    for name, one in results:
        found[name] = one
        if tell is not None:
            tell(one)
    ordered = [found[name] for name in names]
    again = find_repeats([one.track for one in ordered if one.track is not None])
    for one in ordered:
        one.line.same_as = again.get(one.line.name, "")
    return gather(configurations, ordered, questions, attlog=versions(), command=command, config=config.resolved())


def _in_processes(work: dict[str, tuple[Any, ...]], jobs: int) -> Any:
    for name, one in in_processes(compare_on_log, work, jobs):
        yield name, failed_log(work[name][0], name, one) if isinstance(one, Died) else one


def log_names(logs: Sequence[Path]) -> list[str]:
    """What each log is called: its file name, with its folder where two share it, with a number if need be."""
    plain = [log.name for log in logs]
    names = [log.name if plain.count(log.name) == 1 else f"{log.parent.name}/{log.name}" for log in logs]
    return [n if names.count(n) == 1 else f"{n}-{names[: k + 1].count(n)}" for k, n in enumerate(names)]
