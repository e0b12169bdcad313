"""All configurations on one log: their answers, and each beside the first."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from attlog import __version__
from attlog.analysis import evaluate, prepare
from attlog.base.errors import BUG, exit_code, message
from attlog.compare.configurations.configuration import parse
from attlog.compare.configurations.run import ConfiguredFilter
from attlog.compare.differences.comparison import ConfigurationAnswer, LogDifference, LogLine
from attlog.compare.differences.paired import PairedDifference, Scale, paired
from attlog.compare.differences.questions import ComparedMetric
from attlog.compare.differences.same_flight import FlightTrack, track_of
from attlog.metrics.ranking import best as ranking
from attlog.present.heading import DRIFT_AIR, QUOTED
from attlog.present.table.rows import has_value
from attlog.result import TIMED_OUT, Answer, EstimatorRow, Result, nothing_ran


@dataclass(frozen=True, slots=True)
class Plan:
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


def measured(log: Path, name: str, plan: Plan) -> LogComparison:
    """One log measured; whatever goes wrong with it, a bug too, stands in its line."""
    try:
        return _measured(log, name, plan)
    except Exception as error:
        return failed(log, name, error)


def failed(log: Path, name: str, error: Exception) -> LogComparison:
    """The line of a log that could not be measured."""
    import traceback

    code = exit_code(error)
    text = message(error, __version__).removeprefix("attlog: ")
    line = LogLine(name, str(log), code=code, reason=text.removeprefix(f"{log}: "))
    return LogComparison(line, trace="".join(traceback.format_exception(error)) if code == BUG else "")


def _measured(log: Path, name: str, plan: Plan) -> LogComparison:
    runs = [ConfiguredFilter(parse(text, called)) for called, text in plan.configurations]
    case = prepare(log, plan.options)
    result = evaluate(case, runs, only={question.metric for question in plan.questions})
    facts = result.log
    track = track_of(case.log, name, str(facts.get("sha256") or ""))
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
    return read_off(
        LogComparison(line, late=late, track=track, nothing_ran=nothing_ran(result.estimators)),
        result,
        [rows[called] for called, _ in plan.configurations],
        plan.questions,
    )


def read_off(
    found: LogComparison, result: Result, rows: Sequence[EstimatorRow], questions: Iterable[ComparedMetric]
) -> LogComparison:
    """The cells and differences of some rows of a result that was just evaluated (its answers still have units)."""
    first = rows[0]
    for question in questions:
        metric, window = place(question, rows)
        answers = {row.name: row.metrics.get(window, {}).get(metric) for row in rows}
        found.cells[question.id] = {row.name: _cell(row, answers[row.name], window) for row in rows}
        better = result.definitions.get(metric, {}).get("better", "low")
        found.beside[question.id] = {
            row.name: _differences(
                found.line.name, first, row, answers[first.name], answers[row.name], better, window, question.scale
            )
            for row in rows[1:]
        }
    return found


def place(question: ComparedMetric, rows: Sequence[EstimatorRow]) -> tuple[str, str]:
    """Metric and window in which the most rows have a value, of equal ones the first; of drifts in the air the
    heading reference that a report would quote."""
    metrics = [question.metric]
    if question.metric == DRIFT_AIR:
        metrics = [f"{DRIFT_AIR}.{reference}" for reference in QUOTED]
    places = [(m, w) for m in metrics for w in question.windows]

    def filled(place: tuple[str, str]) -> int:
        return sum(has_value(row.metrics.get(place[1], {}).get(place[0])) for row in rows)

    return max(places, key=filled)


def _cell(row: EstimatorRow, answer: Answer | None, window: str) -> ConfigurationAnswer:
    if answer is None:
        return ConfigurationAnswer(
            None, window=window, status=row.status, reason=row.reason or "not asked in this window"
        )
    return ConfigurationAnswer(
        answer.value, answer.ci95, answer.n, window, row.status, row.reason or answer.reason or ""
    )


def _differences(
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
    return _shown(log, found, ranking.floor(a, b), window)


def _shown(log: str, found: PairedDifference, floor: float, window: str) -> LogDifference:
    value, ci95 = found.value, found.ci95
    if found.scale == "ratio":
        value = math.exp(value)
        ci95 = None if ci95 is None else (math.exp(ci95[0]), math.exp(ci95[1]))
        floor = math.log1p(floor / found.first) if found.first > 0.0 else 0.0
    return LogDifference(
        log, value, ci95, found.p, found.n, found.first, found.second, found.error, floor, found.direction, window
    )
