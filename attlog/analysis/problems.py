"""All findings of a log, with what an analysis itself finds wrong: failed and slow filters, broken metrics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial

from attlog import estimators
from attlog.analysis.replay import Chosen
from attlog.base.errors import AttlogError, PluginError, PluginTimeout, UsageError
from attlog.flight.model import Problem, part_of
from attlog.health import Check, answerable
from attlog.health.findings import Finding, OpenQuestion, contradiction, findings
from attlog.health.findings.finding import of_problem
from attlog.metrics.base import Case
from attlog.reference.model import Reference, Row
from attlog.result import TIMED_OUT, EstimatorRow, Result


def of_reference_and_filters(
    ref: Reference,
    lines: Iterable[EstimatorRow],
    failed: Mapping[str, AttlogError],
    chosen: Mapping[str, Chosen],
    rows: Iterable[Row],
) -> list[Problem]:
    """A reference that physics contradicts, filters that failed (``failed``: their errors) or are not compiled.

    A log that does not hold what a filter needs is no fault of either: a note.
    """
    late = {name for name, error in failed.items() if isinstance(error, PluginTimeout)}
    broken = [
        Problem(
            TIMED_OUT if line.name in late else "estimator_failed",
            "note" if isinstance(failed.get(line.name), UsageError) else "error",
            f"{line.name}: {line.reason}",
        )
        for line in lines
        if line.status == "failed"
    ]
    return [*contradiction(ref), *broken, *_slow(chosen, rows)]


def all_of(
    case: Case, result: Result, checks: Sequence[Check], rows: Sequence[Row], known: Sequence[Problem]
) -> list[Finding]:
    """Every finding of a log and its analysis, worst first; ``known``: of reference and filters."""
    own = [*known, *_unmeasured(result.estimators), *_late_field(rows)]
    unanswered = part_of(
        case.log, "What would answer open questions", partial(_unanswered, case, result), list[OpenQuestion]
    )
    return part_of(
        case.log,
        "The findings",
        lambda: findings(case.log, checks, own, unanswered, result.events, result.health),
        lambda: [of_problem(problem) for problem in (*case.log.problems, *own)],
    )


def _unanswered(case: Case, result: Result) -> list[OpenQuestion]:
    """The questions that no row answers, each with what would answer it."""
    silent = [verdict for verdict in result.verdicts if not verdict.bars]
    remedies = {a.question: a.setting for a in answerable(case.log, case)} if silent else {}
    return [OpenQuestion(verdict.title, remedies.get(verdict.question, "")) for verdict in silent]


def _unmeasured(lines: Iterable[EstimatorRow]) -> list[Problem]:
    """Metrics that ended in a bug, each once."""
    answers = [a for line in lines for window in line.metrics.values() for a in window.values()]
    sentences = dict.fromkeys(a.reason for a in answers if a.code == "part_failed" and a.reason)
    return [Problem("part_failed", "error", sentence) for sentence in sentences]


def _slow(chosen: Mapping[str, Chosen], rows: Iterable[Row]) -> list[Problem]:
    """Plug-ins that ran in plain Python, or whose process was lost in a run by which a metric tries them."""
    ran = {row.name.partition("/imu")[0] for row in rows}
    text = "its step runs in plain Python, some hundred times slower, because numba cannot compile it"
    found = []
    for name, spec in chosen.items():
        if name in ran and not isinstance(spec, PluginError):
            row = spec if isinstance(spec, estimators.EstimatorSpec) else spec.row
            try:
                why = estimators.not_compiled(row.estimator)
            except PluginError as error:
                code = TIMED_OUT if isinstance(error, PluginTimeout) else "estimator_failed"
                found.append(Problem(code, "error", f"{name}: in a later run, by which metrics try it: {error}"))
                continue
            if why:
                found.append(Problem("estimator_not_compiled", "note", f"{name}: {text} ({why})."))
    return found


def _late_field(rows: Iterable[Row]) -> list[Problem]:
    """Time in which no filter could know its heading, because the magnetometer had not spoken yet."""
    waited = max((float(s.value or 0.0) for row in rows for s in row.steps if s.name == "late_field"), default=0.0)
    text = (
        f"The magnetometer's first sample came late: for {waited:.1f} s no filter knew its heading. "
        "It is set from the first field; nothing before is scored."
    )
    return [Problem("late_field", "note", text)] if waited else []
