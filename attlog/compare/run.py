"""Run configurations over logs, in one or several processes, to one comparison."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from attlog import __version__
from attlog.compare.comparison import (
    OWN_REFERENCE,
    Comparison,
    ConfigurationSummary,
    Contrast,
    LogLine,
    Question,
    SettingAnswer,
    commonest_reason,
    select_questions,
)
from attlog.compare.filter_input import ConfiguredFilter, change_remarks, require_reproduction
from attlog.compare.paired import Difference, paired, pool
from attlog.compare.same_flight import FlightTrack, find_repeats, flight_track
from attlog.compare.setting import Configuration, labels, numbers_text, parse_configuration
from attlog.compare.wording import comparison_sentences
from attlog.core.errors import EXIT_BUG, UsageError, error_message, exit_code
from attlog.core.machine import versions
from attlog.core.workers import Died, in_processes
from attlog.metrics import definitions
from attlog.metrics.heading import GNSS_HEADING_NAME
from attlog.metrics.metric import named
from attlog.pipeline import evaluate, prepare
from attlog.pipeline.config import Config
from attlog.result import TIMED_OUT, Answer, EstimatorRow, nothing_ran
from attlog.words.ranking import DRIFT_AIR, HEADING_REFERENCE_ORDER, has_value

__all__ = ["compare", "log_names"]

EXAMPLE = "attlog compare LOG... mahony:kp=0.3 mahony:kp=0.6"


@dataclass(frozen=True, slots=True)
class ComparisonPlan:
    """Configurations as (name, text), questions and options; equal for every log, picklable."""

    configurations: tuple[tuple[str, str], ...]
    questions: tuple[Question, ...]
    options: dict[str, Any]
    anyway: bool = False


@dataclass(slots=True)
class LogComparison:
    """Comparison on one log, or its line with a reason.

    ``cells``, ``differences``: by question and configuration. ``overruns``: sentences on filters from files that
    exceeded their time. ``track``: identifies records of the same flight. ``nothing_ran``: why the first configuration
    failed where all did. ``remarks``: sentences on parameters.
    """

    line: LogLine
    cells: dict[str, dict[str, SettingAnswer]] = field(default_factory=dict)
    differences: dict[str, dict[str, Difference]] = field(default_factory=dict)
    trace: str = ""
    overruns: tuple[str, ...] = ()
    track: FlightTrack | None = None
    nothing_ran: str = ""
    remarks: tuple[str, ...] = ()


def compare(
    logs: Sequence[Path],
    configurations: Sequence[Configuration],
    config: Config | None = None,
    *,
    metrics: Sequence[str] = (),
    anyway: bool = False,
    jobs: int = 1,
    command: str = "",
    progress: Callable[[LogComparison], None] | None = None,
) -> Comparison:
    """Compare configurations with the first of them, on every log and over all logs.

    ``config``: options of ``attlog analyze``, its window among them. ``metrics``: questions other than the main ones
    (``all`` for every metric). An unusable log is a line with its reason. Logs of one flight count once where logs are
    pooled. ``anyway``: continue where a re-run onboard filter does not follow the flown attitude. ``progress`` is
    called with each finished log. UsageError for fewer than two configurations or an unknown metric.
    """
    if len(configurations) < 2:
        raise UsageError(f"a comparison needs two configurations or more: {EXAMPLE}")
    config = config or Config()
    questions = select_questions(metrics, config.window, flown=any(c.is_flown for c in configurations))
    names = log_names(logs)
    plan = ComparisonPlan(tuple((c.name, c.text) for c in configurations), tuple(questions), config.resolved(), anyway)
    work: dict[str, tuple[Any, ...]] = {name: (log, name, plan) for log, name in zip(logs, names, strict=True)}
    found: dict[str, LogComparison] = {}
    for name, one in _each_log(work, jobs):
        found[name] = one
        if progress is not None:
            progress(one)
    ordered = [found[name] for name in names]
    repeats = find_repeats([one.track for one in ordered if one.track is not None])
    for one in ordered:
        one.line.same_as = repeats.get(one.line.name, "")
    return gather(configurations, ordered, questions, attlog=versions(), command=command, config=config.resolved())


def _each_log(work: dict[str, tuple[Any, ...]], jobs: int) -> Iterator[tuple[str, LogComparison]]:
    if jobs == 1 or len(work) == 1:
        yield from ((name, compare_on_log(*arguments)) for name, arguments in work.items())
        return
    for name, one in in_processes(compare_on_log, work, jobs):
        yield name, failed_log(work[name][0], name, one) if isinstance(one, Died) else one


def log_names(logs: Sequence[Path]) -> list[str]:
    """Return unique names of logs.

    The file name, with its folder where two logs share it, numbered if still equal.
    """
    plain = [log.name for log in logs]
    names = [log.name if plain.count(log.name) == 1 else f"{log.parent.name}/{log.name}" for log in logs]
    return [n if names.count(n) == 1 else f"{n}-{names[: k + 1].count(n)}" for k, n in enumerate(names)]


def compare_on_log(log: Path, name: str, plan: ComparisonPlan) -> LogComparison:
    """Compare on one log; every error, bugs included, becomes its line's reason."""
    try:
        return _compare_on_log(log, name, plan)
    except Exception as error:
        return failed_log(log, name, error)


def failed_log(log: Path, name: str, error: Exception) -> LogComparison:
    """Return the line of a log that could not be compared."""
    import traceback

    code = exit_code(error)
    text = error_message(error, __version__).removeprefix("attlog: ")
    line = LogLine(name, str(log), code=code, reason=text.removeprefix(f"{log}: "))
    return LogComparison(line, trace="".join(traceback.format_exception(error)) if code == EXIT_BUG else "")


def _compare_on_log(log: Path, name: str, plan: ComparisonPlan) -> LogComparison:
    runs = [ConfiguredFilter(parse_configuration(text, called)) for called, text in plan.configurations]
    case = prepare(log, plan.options)
    case.log.messages = None  # of figures alone; the inputs of a flown filter still hold the file
    remarks: list[str] = []
    for c in (run.configuration for run in runs if run.configuration.is_flown):
        followed = require_reproduction(case, c.row.estimator.name, anyway=plan.anyway)
        remarks += change_remarks(case, c, "" if followed is None else followed.start)
    result = evaluate(case, runs, only={question.metric for question in plan.questions})
    facts = result.log
    sha256 = str(facts.get("sha256") or "")
    line = LogLine(
        name,
        str(log),
        sha256,
        str(facts.get("vehicle") or ""),
        " ".join(str(facts.get("firmware", {}).get(k) or "") for k in ("name", "version")).strip(),
        facts.get("duration_s"),
        f"{result.reference.choice} ({result.reference.source})" if result.reference else "",
    )
    found = LogComparison(
        line,
        overruns=tuple(finding.text for finding in result.findings if finding.kind == TIMED_OUT),
        track=flight_track(case.log, name, sha256),
        nothing_ran=nothing_ran(result.estimators),
        remarks=tuple(dict.fromkeys(remarks)),
    )
    by_name = {row.name: row for row in result.estimators}
    rows = [by_name[called] for called, _ in plan.configurations]
    line.mode = next((row.mode for row in rows if row.mode), "")
    flown = {run.name for run in runs if run.configuration.is_flown} if case.reference.kind == "onboard" else set()
    for question in plan.questions:
        metric, window = answer_place(question, rows)
        answers = [row.metrics.get(window, {}).get(metric) for row in rows]
        pairs = list(zip(rows, answers, strict=True))
        found.cells[question.id] = {row.name: _setting_answer(row, answer, window) for row, answer in pairs}
        found.differences[question.id] = {
            row.name: replace(row_difference(question, pairs[0], (row, answer), flown), log=name, window=window)
            for row, answer in pairs[1:]
        }
    return found


def answer_place(question: Question, rows: Sequence[EstimatorRow]) -> tuple[str, str]:
    """Return the metric and window in which most rows have a value, else the first.

    A drift in the air uses the heading reference that a report quotes.
    """
    metrics = [question.metric]
    if question.metric == DRIFT_AIR:
        metrics = [f"{DRIFT_AIR}.{reference}" for reference in HEADING_REFERENCE_ORDER]
    places = [(m, w) for m in metrics for w in question.windows]
    return max(places, key=lambda p: sum(has_value(row.metrics.get(p[1], {}).get(p[0])) for row in rows))


def _setting_answer(row: EstimatorRow, answer: Answer | None, window: str) -> SettingAnswer:
    if answer is None:
        reason = row.reason or "not asked in this window"
        return SettingAnswer(None, window=window, status=row.status, reason=reason)
    reason = row.reason or answer.reason or ""
    return SettingAnswer(answer.value, answer.ci95, answer.n, window, row.status, reason)


def row_difference(
    question: Question,
    first: tuple[EstimatorRow, Answer | None],
    second: tuple[EstimatorRow, Answer | None],
    flown: Collection[str] = (),
) -> Difference:
    """Return the difference of a row's answer to the first's, or the reason.

    ``flown``: rows of the filter whose own attitude is the reference.
    """
    nothing = Difference(question.scale)
    for row, _ in (first, second):
        if row.status != "ok":
            return replace(nothing, reason=f"{row.name}: {row.status.replace('_', ' ')}, {row.reason}")
    if flown and question.needs_reference and {first[0].name, second[0].name} & {*flown}:
        return replace(nothing, reason=OWN_REFERENCE)
    a, b = first[1], second[1]
    if a is None or b is None:
        return replace(nothing, reason="not asked in this window")
    for row, answer in ((first[0], a), (second[0], b)):
        # By GNSS acceleration all rows share its errors, which cancel between two rows.
        if answer.value is not None and not answer.ranked and question.metric != GNSS_HEADING_NAME:
            return replace(nothing, reason=f"{row.name}: {answer.reason}")
    found = paired(a, b, question.better)
    if found.value is not None and found.scale != question.scale:
        return replace(nothing, reason="nothing to pair on this log")
    return replace(found, scale=question.scale)


def gather(
    configurations: Sequence[Configuration],
    logs: Sequence[LogComparison],
    questions: Sequence[Question],
    *,
    attlog: dict[str, str],
    command: str = "",
    config: dict[str, Any] | None = None,
) -> Comparison:
    """Combine logs to one comparison; a failed log is a line with its reason."""
    called = labels(configurations)
    found = Comparison(attlog, command, config or {})
    for c in configurations:
        parameters = {k: f"{v:g}" if isinstance(v, float) else str(v) for k, v in c.row.params.items()}
        before = {k: numbers_text(v) for k, v in c.before.items()}
        found.configurations.append(ConfigurationSummary(c.name, called[c.name], c.text, parameters, before))
    found.logs = [log.line for log in logs]
    usable = [log for log in logs if log.line.code == 0]
    for asked in questions:
        cells = {log.line.name: log.cells[asked.id] for log in usable}
        answers = [answer for by_name in cells.values() for answer in by_name.values()]
        if all(answer.value is None for answer in answers):
            reasons = (answer.reason for answer in answers)
            found.unanswered[asked.id] = commonest_reason(reasons) or "no log could be used"
            continue
        question = replace(asked, cells=cells, contrasts=[])
        for c in configurations[1:]:
            each = [log.differences[asked.id][c.name] for log in usable]
            once = [d for log, d in zip(usable, each, strict=True) if not log.line.same_as]
            question.contrasts.append(Contrast(c.name, each, pool(once, asked.scale)))
        found.questions.append(question)
        found.definitions[asked.id] = named(definitions().values(), asked.metric).definition
    found.verdicts = comparison_sentences(found)
    return found
