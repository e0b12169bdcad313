"""Which of a log's numbers are beyond what was allowed? Gates, judged on a result.

A gate asks one metric in one window of every row that it means (:mod:`attlog.compare.gates.rows`) for one or more
limits (:mod:`attlog.compare.gates.limits`). It fails a row that failed or diverged, whatever its numbers; it fails an
answer that is not there, unless it is optional, in which case that is skipped and never passed; and it fails where it
means no row. A strict set of gates also fails every row that failed or diverged and that no gate asks. Gates of sensors
ask assessments instead of rows (:mod:`attlog.compare.gates.sensors`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from attlog.compare.gates import limits as gate_limits
from attlog.compare.gates import rows as gate_rows
from attlog.compare.gates import sensors
from attlog.compare.gates import text as gate_words
from attlog.compare.gates.baseline import Baseline, BaselineResult
from attlog.compare.gates.limits import GateLimit
from attlog.compare.gates.outcome import Cause, GateOutcome, Status, worst_first
from attlog.compare.gates.rows import LOST
from attlog.compare.gates.sensors import SensorGate
from attlog.metrics.answer import Answer
from attlog.result import EstimatorRow, Result
from attlog.result.answers import as_written

STATUS = "status"
"""What the check of a strict set is called."""


@dataclass(frozen=True, slots=True)
class Gate:
    """One line of a gate file: every one of ``limits`` on a metric, for the rows that ``filters`` name.

    ``window`` None: the first of the metric's windows that has an answer. ``filters`` None: every estimator row but
    ``gyro`` and ``accel_mag``. ``baseline``: the file or folder that limits to a baseline look into.
    """

    metric: str
    limits: tuple[GateLimit, ...]
    window: str | None = None
    filters: tuple[str, ...] | None = None
    optional: bool = False
    baseline: Path | None = None


@dataclass(frozen=True, slots=True)
class Gates:
    """The gates of a file. ``strict``: rows that failed or diverged count also where no gate asks them.

    ``health``: gates of what the assessments of the sensors say.
    """

    gates: tuple[Gate, ...] = ()
    strict: bool = True
    health: tuple[SensorGate, ...] = ()


def judge(gates: Gates, result: Result, baselines: Mapping[Path, Baseline] | None = None) -> list[GateOutcome]:
    """What the gates say of one result: worst first.

    ``baselines``: of :func:`attlog.compare.gates.baseline.read_all`, for gates that look into one.
    """
    rows = result.estimators
    found: list[GateOutcome] = []
    for gate in gates.gates:
        baseline = (baselines or {}).get(gate.baseline) if gate.baseline is not None else None
        beside = "no baseline was given" if baseline is None else baseline.of(result.log)
        meant, unmatched = gate_rows.selected(rows, gate.filters)
        if gate.filters is None and not meant:
            unmatched = ["*"]
        for limit in gate.limits:
            for pattern in unmatched:
                names = [row.name for row in rows]
                text = gate_words.no_filter(names) if gate.filters is None else gate_words.no_row(pattern, names)
                found.append(_without_value(gate, limit, pattern, "no_row", text))
            found += [_of_limit(gate, limit, row, rows, beside) for row in meant]
    found += [outcome for gate in gates.health for outcome in sensors.judged(gate, result.health)]
    if gates.strict:
        found += [_of_row(row) for row in gate_rows.selected(rows, None)[0]]
    return worst_first(found)


def _of_limit(
    gate: Gate, limit: GateLimit, row: EstimatorRow, rows: list[EstimatorRow], beside: BaselineResult | str
) -> GateOutcome:
    """One limit on one row."""
    name = row.name
    if row.status in LOST:
        return _without_value(gate, limit, name, "row", gate_words.lost(row))
    window, answer = gate_rows.answer(row, gate.metric, gate_rows.windows(gate.metric, gate.window))
    why = gate_words.unanswered(row, gate.metric, gate.window, answer)
    if answer is None or why:
        return _without_value(gate, limit, name, "unanswered", why, window)
    known = gate_rows.definition(gate.metric)
    other, why = _other(limit, gate, gate.metric, row, rows, beside, window)
    if why:
        return _without_value(gate, limit, name, "unanswered", f"{name}: {why}", window)
    if limit.against == "baseline" and other is not None:  # of which only the written digits are known
        answer, other = as_written(answer), as_written(other)
    decided = None
    if limit.against == "baseline" and known.decided_by:
        mine = gate_rows.answer(row, known.decided_by, (window,))[1]
        theirs, _ = _other(limit, gate, known.decided_by, row, rows, beside, window)
        decided = None if mine is None or theirs is None else (as_written(theirs), as_written(mine))
    alike = limit.against != "baseline" or (isinstance(beside, BaselineResult) and beside.same_log)
    verdict = gate_limits.judged(limit, gate.metric, known.better, answer, other, same_log=alike, decided=decided)
    return GateOutcome(
        name,
        _check(gate, limit),
        gate.metric,
        window,
        "passed" if verdict.passed else "failed",
        None if verdict.passed else "limit",
        answer.value,
        answer.unit,
        verdict.allowed,
        verdict.excess,
        gate_words.measured(name, gate.metric, window, answer, limit, other, verdict),
        verdict.excused,
    )


def _other(
    limit: GateLimit,
    gate: Gate,
    metric: str,
    row: EstimatorRow,
    rows: list[EstimatorRow],
    beside: BaselineResult | str,
    window: str,
) -> tuple[Answer | None, str]:
    """What a relative limit compares with; (None, "") for an absolute one."""
    if limit.against == "onboard":
        return gate_rows.of_onboard(rows, metric, window)
    if limit.against == "baseline":
        place = gate.baseline.name if gate.baseline is not None else ""
        baseline = beside if isinstance(beside, str) else beside.result
        return gate_rows.of_baseline(baseline, place, row, metric, window)
    return None, ""


def _without_value(gate: Gate, limit: GateLimit, row: str, cause: Cause, why: str, window: str = "") -> GateOutcome:
    """No number that could pass: failed, or skipped where nothing was answered and the gate is optional."""
    skipped = gate.optional and cause == "unanswered"
    return GateOutcome(
        row,
        _check(gate, limit),
        gate.metric,
        window or gate.window or "",
        "skipped" if skipped else "failed",
        cause,
        None,
        "",
        None,
        math.inf,
        why,
    )


def _of_row(row: EstimatorRow) -> GateOutcome:
    """Whether a row ran to its end."""
    name, lost = row.name, row.status in LOST
    sentence = gate_words.lost(row) if lost else f"{name}: {row.status}"
    status: Status = "failed" if lost else "passed"
    excess = math.inf if lost else 0.0
    return GateOutcome(name, STATUS, STATUS, "", status, "row" if lost else None, None, "", None, excess, sentence)


def _check(gate: Gate, limit: GateLimit) -> str:
    window = f"@{gate.window}" if gate.window else ""
    return f"{gate.metric}{window} {limit}"
