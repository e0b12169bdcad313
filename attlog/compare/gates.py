"""Judge the numbers of a result against limits.

A gate compares one metric in one window with one or more limits, for each selected row. It fails for a row that failed
or diverged, for a missing answer, and if it selects no row. An optional gate skips a missing answer and never passes
it. A strict set of gates also fails every failed or diverged row that no gate selects. Sensor gates judge the checks of
``attlog health`` in the same way: an unknown or missing check fails unless the gate has ``unknown = "pass"``.

Sizes are compared: the absolute value where zero is ideal, the distance from one where one is ideal (gains). A limit
relative to a baseline is exceeded where the size is beyond it **and** the difference is significant: its 95 % interval
is worse than zero (for a limit below the baseline: beyond the limit). The interval is

- on the same log that of the paired evidence (:mod:`attlog.compare.paired`); a percentile takes the relative interval
  of its RMSE (``Metric.decided_by``);
- on two logs, and for metrics without units of evidence, that of independent answers (Zou2008, as in
  :mod:`attlog.compare.diff`);
- where there is none, the size alone decides, except for "not worse than the baseline" on two logs.

"Not worse than the baseline" allows a negligible step (:class:`attlog.compare.diff.Tolerances`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Literal

from attlog.compare.baseline import Baseline, BaselineResult
from attlog.compare.comparison import select_questions
from attlog.compare.diff import Tolerances, difference_interval
from attlog.compare.paired import paired
from attlog.metrics import definitions, ranking
from attlog.metrics.metric import Answer
from attlog.metrics.rerun import METRIC_GROUPS
from attlog.result import Check, EstimatorRow, Result
from attlog.result.document import as_written
from attlog.segments.model import WINDOWS
from attlog.words.numbers import quantity, unit_sign

Status = Literal["passed", "failed", "skipped"]
Cause = Literal["row", "limit", "unanswered", "no_row"]
LimitKind = Literal[
    "min", "max", "max_ratio_to_onboard", "max_above_onboard", "max_ratio_to_baseline", "max_above_baseline", "baseline"
]
# Keys of limits in a file. ``baseline`` alone means not worse than the baseline.
LIMIT_KINDS: tuple[LimitKind, ...] = (
    "min",
    "max",
    "max_ratio_to_onboard",
    "max_above_onboard",
    "max_ratio_to_baseline",
    "max_above_baseline",
    "baseline",
)
# Outcomes in order: worst first.
STATUS_ORDER = ("failed", "skipped", "passed")
CAUSE_ORDER = ("row", "limit", "unanswered", "no_row", None)
# Relative rounding error of a value equal to its limit.
ROUNDING_SHARE = 1e-9
# Name of the check that a strict set adds.
STATUS_CHECK = "status"
# Estimators drawn for comparison, whose errors are no fault: they diverge on any long flight.
BASELINE_ESTIMATORS = ("gyro", "accel_mag")
# Metrics of the onboard filter run again, which other rows do not have.
RERUN_METRICS = frozenset(m.name for group in METRIC_GROUPS for m in group.metrics)
LOST_STATUSES = ("failed", "diverged")
WILDCARDS = frozenset("*?[")
# Sensor name in the outcome of a gate whose check is missing in the log.
NO_SENSOR = "sensors"
# Verdicts of a sensor, the best first; a gate allows one of the first two.
VERDICTS = ("ok", "warning", "fault")
AnswerOrReason = tuple[Answer | None, str]


@dataclass(frozen=True, slots=True)
class GateOutcome:
    """Outcome of one limit on one row or sensor.

    ``check``: gate and limit as in the file (``lag_ms@airborne max=5``). ``cause`` of a failure or skip: ``row`` failed
    or diverged, ``no_row`` selected, ``limit`` exceeded, metric ``unanswered``. ``excess``: ratio to the limit (1 at
    it). ``excused``: passed beyond a limit relative to the baseline, because the difference is not significant.
    """

    row: str
    check: str
    metric: str
    window: str
    status: Status
    sentence: str
    cause: Cause | None = None
    value: float | None = None
    unit: str = ""
    allowed: float | None = None
    excess: float = math.inf
    excused: bool = False


def worst_first(outcomes: Iterable[GateOutcome]) -> list[GateOutcome]:
    """Sort outcomes: failed, skipped, passed; then by cause and excess."""
    return sorted(outcomes, key=lambda o: (STATUS_ORDER.index(o.status), CAUSE_ORDER.index(o.cause), -o.excess))


@dataclass(frozen=True, slots=True)
class GateLimit:
    """One limit: in the metric's unit, as a ratio, or 0 for ``baseline``."""

    kind: LimitKind
    value: float

    @property
    def against(self) -> Literal["", "onboard", "baseline"]:
        """Return the reference of a relative limit, empty for an absolute one."""
        return "onboard" if self.kind.endswith("onboard") else "baseline" if self.kind.endswith("baseline") else ""

    def __str__(self) -> str:
        return "not worse than baseline" if self.kind == "baseline" else f"{self.kind}={self.value:g}"


@dataclass(frozen=True, slots=True)
class Gate:
    """Limits on a metric for selected rows.

    ``window`` None: the first of the metric's windows with an answer. ``filters`` None: every estimator row but
    ``gyro`` and ``accel_mag``, and the re-run for metrics of :mod:`attlog.metrics.rerun`. ``baseline``: file or
    folder for relative limits.
    """

    metric: str
    limits: tuple[GateLimit, ...]
    window: str | None = None
    filters: tuple[str, ...] | None = None
    optional: bool = False
    baseline: Path | None = None

    def check(self, limit: GateLimit) -> str:
        """Format gate and limit as in the file."""
        return f"{self.metric}{f'@{self.window}' if self.window else ''} {limit}"


@dataclass(frozen=True, slots=True)
class SensorGate:
    """Limits on the value of a sensor's check, and the worst verdict allowed.

    ``sensors``: names or patterns, None for all. ``unknown_passes``: an unknown verdict is skipped.
    """

    question: str
    limits: tuple[GateLimit, ...] = ()
    worst: str | None = None
    sensors: tuple[str, ...] | None = None
    unknown_passes: bool = False

    def check(self, limit: GateLimit | str) -> str:
        """Format gate and limit: ``health.compass_offset max=5``, ``health.notch verdict=warning``."""
        return f"health.{self.question} {limit if isinstance(limit, GateLimit) else f'verdict={limit}'}"


@dataclass(frozen=True, slots=True)
class Gates:
    """Gates of a file.

    ``strict``: failed and diverged rows count even if no gate selects them. ``health``: gates of sensors.
    """

    gates: tuple[Gate, ...] = ()
    strict: bool = True
    health: tuple[SensorGate, ...] = ()


def judge_gates(gates: Gates, result: Result, baselines: Mapping[Path, Baseline] | None = None) -> list[GateOutcome]:
    """Judge one result by all gates, worst outcome first."""
    rows = result.estimators
    names = [row.name for row in rows]
    found: list[GateOutcome] = []
    for gate in gates.gates:
        baseline = (baselines or {}).get(gate.baseline) if gate.baseline is not None else None
        beside = "no baseline was given" if baseline is None else baseline.of(result.log)
        meant, unmatched = select_rows(rows, gate.filters)
        if gate.filters is None and gate.metric in RERUN_METRICS:
            meant = [row for row in rows if row.kind == "rerun"]
        if gate.filters is None and not meant:
            unmatched = ["*"]
        for limit in gate.limits:
            for pattern in unmatched:
                text = f"no row is called {pattern}; the rows are {', '.join(names) or 'none'}"
                if gate.filters is None:
                    held = f"the rows are {', '.join(names)}; name them under filters if they are meant"
                    text = f"the result has no filter to be judged: {held if names else 'it has no row'}"
                found.append(_without_value(gate, limit, pattern, "no_row", text))
            found += [_limit_outcome(gate, limit, row, rows, beside) for row in meant]
    found += [outcome for gate in gates.health for outcome in judge_sensors(gate, result.checks)]
    if gates.strict:
        found += map(_row_outcome, select_rows(rows, None)[0])
    return worst_first(found)


def select_rows(rows: Sequence[EstimatorRow], filters: Iterable[str] | None) -> tuple[list[EstimatorRow], list[str]]:
    """Return the rows that match patterns, in table order, and patterns without a match.

    A pattern matches a row's whole name or the part before ``/imuN``. Onboard attitudes, baselines and the reference
    are selected by name only: a pattern that begins with a wildcard leaves them out. Without patterns all other rows
    match.
    """
    if filters is None:
        return [row for row in rows if not _by_name_only(row)], []
    wanted = list(filters)
    matching = {id(row): [p for p in wanted if _matches(row, p)] for row in rows}
    return [row for row in rows if matching[id(row)]], [p for p in wanted if not any(p in m for m in matching.values())]


def _by_name_only(row: EstimatorRow) -> bool:
    return row.kind != "replay" or row.estimator in BASELINE_ESTIMATORS or row.is_reference


def _matches(row: EstimatorRow, pattern: str) -> bool:
    if _by_name_only(row) and pattern[:1] in WILDCARDS:
        return False
    return fnmatchcase(row.name, pattern) or fnmatchcase(row.name.partition("/imu")[0], pattern)


def _limit_outcome(
    gate: Gate, limit: GateLimit, row: EstimatorRow, rows: Sequence[EstimatorRow], beside: BaselineResult | str
) -> GateOutcome:
    """Judge one limit on one row."""
    if row.status in LOST_STATUSES:
        return _without_value(gate, limit, row.name, "row", lost_row_text(row))
    window, answer = first_answer(row, gate.metric, gate_windows(gate.metric, gate.window))
    why = unanswered_text(row, gate.metric, gate.window, answer)
    if answer is None or why:
        return _without_value(gate, limit, row.name, "unanswered", why, window)
    known = definitions()[gate.metric]
    other, why = _compared_answer(limit, gate, gate.metric, row, rows, beside, window)
    if why:
        return _without_value(gate, limit, row.name, "unanswered", f"{row.name}: {why}", window)
    decided = None
    if limit.against == "baseline" and other is not None:  # the baseline has only the digits of its file
        answer, other = as_written(answer), as_written(other)
        if known.decided_by:
            mine = first_answer(row, known.decided_by, (window,))[1]
            theirs, _ = _compared_answer(limit, gate, known.decided_by, row, rows, beside, window)
            decided = None if mine is None or theirs is None else (as_written(theirs), as_written(mine))
    same_log = limit.against != "baseline" or (isinstance(beside, BaselineResult) and beside.same_log)
    verdict = judge_limit(limit, gate.metric, known.better, answer, other, same_log=same_log, decided=decided)
    return GateOutcome(
        row.name,
        gate.check(limit),
        gate.metric,
        window,
        "passed" if verdict.passed else "failed",
        value_and_limit_text(row.name, gate.metric, window, answer, limit, other, verdict),
        None if verdict.passed else "limit",
        answer.value,
        answer.unit,
        verdict.allowed,
        verdict.excess,
        verdict.excused,
    )


def _without_value(gate: Gate, limit: GateLimit, row: str, cause: Cause, why: str, window: str = "") -> GateOutcome:
    """Return the outcome of a missing number: failed, or skipped if optional."""
    status: Status = "skipped" if gate.optional and cause == "unanswered" else "failed"
    where = window or gate.window or ""
    return GateOutcome(row, gate.check(limit), gate.metric, where, status, why, cause)


def _row_outcome(row: EstimatorRow) -> GateOutcome:
    """Return the outcome of a row's status: failed if the row failed or diverged."""
    if row.status in LOST_STATUSES:
        return GateOutcome(row.name, STATUS_CHECK, STATUS_CHECK, "", "failed", lost_row_text(row), "row")
    return GateOutcome(row.name, STATUS_CHECK, STATUS_CHECK, "", "passed", f"{row.name}: {row.status}", excess=0.0)


def gate_windows(metric: str, window: str | None) -> tuple[str, ...]:
    """Return the windows to search: the named one, else the metric's."""
    return (window,) if window is not None else select_questions((metric,))[0].windows


def first_answer(row: EstimatorRow, metric: str, windows: Iterable[str]) -> tuple[str, Answer | None]:
    """Return the window and answer with a value, else the first answer."""
    known = [(w, found) for w in windows if (found := row.metrics.get(w, {}).get(metric)) is not None]
    return next(((w, a) for w, a in known if a.value is not None), known[0] if known else ("", None))


def _compared_answer(
    limit: GateLimit,
    gate: Gate,
    metric: str,
    row: EstimatorRow,
    rows: Sequence[EstimatorRow],
    beside: BaselineResult | str,
    window: str,
) -> AnswerOrReason:
    """Return the answer that a relative limit compares with, else None."""
    if limit.against == "onboard":
        return onboard_answer(rows, metric, window)
    if limit.against == "baseline":
        place = gate.baseline.name if gate.baseline is not None else ""
        return baseline_answer(beside if isinstance(beside, str) else beside.result, place, row, metric, window)
    return None, ""


def onboard_answer(rows: Sequence[EstimatorRow], metric: str, window: str) -> AnswerOrReason:
    """Return the answer of the onboard attitude."""
    row = next((r for r in rows if r.name == "onboard"), None)
    if row is None:
        return None, "the log has no onboard attitude to compare with"
    if row.is_reference:
        return None, "the onboard attitude is the reference itself, there is nothing to compare it with"
    if row.status in LOST_STATUSES:
        return None, f"nothing can be compared with onboard: {lost_row_text(row)}"
    return _value_of(row, metric, window, "onboard")


def baseline_answer(baseline: Result | str, name: str, row: EstimatorRow, metric: str, window: str) -> AnswerOrReason:
    """Return the answer of the same row in the baseline, or why there is none.

    The row has the same name, or is the only one of the same filter. ``baseline`` may be a reason itself.
    """
    if isinstance(baseline, str):
        return None, baseline
    rows = baseline.estimators
    same = [r for r in rows if r.name == row.name] or [r for r in rows if _row_identity(r) == _row_identity(row)]
    if len(same) != 1:
        return None, f"the baseline {name} has {'several rows like' if same else 'no row'} {row.name}"
    return _value_of(same[0], metric, window, f"the baseline {name}")


def _row_identity(row: EstimatorRow) -> tuple[str, str, str]:
    """Return the identity of a row across settings: kind, filter, IMU."""
    return row.kind, row.estimator or row.name, row.name.partition("/imu")[2]


def _value_of(row: EstimatorRow, metric: str, window: str, whose: str) -> AnswerOrReason:
    found = first_answer(row, metric, (window,))[1]
    if found is not None and found.value is not None:
        return found, ""
    return None, f"no {metric} ({window}) of {whose}{f': {found.reason}' if found is not None else ''}"


@dataclass(frozen=True, slots=True)
class LimitVerdict:
    """Verdict on an answer and a limit.

    ``allowed``: largest (or smallest) size that passes. ``excess``: ratio to it. ``size``, ``other``: sizes compared.
    ``excused``: beyond the limit, but not significantly.
    """

    passed: bool
    allowed: float
    excess: float
    size: float
    other: float | None = None
    excused: bool = False


def judge_limit(
    limit: GateLimit,
    metric: str,
    better: str,
    answer: Answer,
    other: Answer | None = None,
    *,
    same_log: bool = True,
    decided: tuple[Answer, Answer] | None = None,
) -> LimitVerdict:
    """Judge an answer with a value against one limit.

    ``other``: answer of the onboard attitude or the baseline. ``decided``: (other, own) answers of the metric whose
    paired interval is used instead.
    """
    if other is None:
        size = abs(float(answer.value or 0.0)) if better == "zero" else float(answer.value or 0.0)
        low, high = (limit.value, size) if limit.kind == "min" else (size, limit.value)
        excess = low / high if high > 0.0 else math.inf if low > high else 1.0
        return LimitVerdict(low <= high + ROUNDING_SHARE * abs(high), limit.value, excess, size)
    size, before = (ranking.distance(a, better)[1] for a in (answer, other))
    if limit.kind == "baseline":
        allowed = before + max(Tolerances().of(metric, answer.unit, before), ranking.floor(other, answer))
    else:
        allowed = limit.value * before if "ratio" in limit.kind else before + limit.value
    beyond = size > allowed * (1.0 + ROUNDING_SHARE)
    least = smallest_size(answer, other, better, same_log, decided) if limit.against == "baseline" else None
    unknown = least is None and limit.kind == "baseline" and not same_log
    failed = beyond and not unknown and (least is None or least > min(before, allowed))
    excess = size / allowed if allowed > 0.0 else math.inf if size > 0.0 else 0.0
    return LimitVerdict(not failed, allowed, excess, size, before, beyond and not failed)


def smallest_size(
    answer: Answer, other: Answer, better: str, same_log: bool, decided: tuple[Answer, Answer] | None = None
) -> float | None:
    """Return the lower 95 % bound of the size, None without an interval."""
    near, size, _ = ranking.distance(answer, better)
    _, before, far = ranking.distance(other, better)
    if same_log and answer.units is not None and other.units is not None:
        found = paired(other, answer, better)
        if found.ci95 is not None:
            return before * found.ci95[0] if found.scale == "ratio" else before + found.ci95[0]
    if same_log and decided is not None and decided[0].units is not None and decided[1].units is not None:
        found = paired(*decided, better)
        if found.ci95 is not None and found.value and found.scale == "ratio":
            return size * found.ci95[0] / found.value
    if answer.ci95 is None or other.ci95 is None:
        return None
    span = difference_interval(before, (before, far), size, (near, size))
    return None if span is None else before + span[0]


def judge_sensors(gate: SensorGate, checks: Iterable[Check]) -> list[GateOutcome]:
    """Judge each sensor and limit of a gate."""
    patterns = gate.sensors or ("*",)
    asked = [a for a in checks if a.question == gate.question and any(fnmatchcase(a.sensor, p) for p in patterns)]
    limits: list[GateLimit | str] = [*gate.limits, *([] if gate.worst is None else [gate.worst])]
    if not asked:
        named = "" if gate.sensors is None else f" for {' or '.join(gate.sensors)}"
        why = f"the log has no answer to {gate.question}{named}"
        return [_sensor_unanswered(gate, check, ", ".join(gate.sensors or (NO_SENSOR,)), why) for check in limits]
    return [outcome for found in asked for outcome in _sensor_outcomes(gate, limits, found)]


def _sensor_outcomes(gate: SensorGate, limits: Iterable[GateLimit | str], found: Check) -> Iterator[GateOutcome]:
    sensor = found.sensor or NO_SENSOR
    for check in limits:
        if found.verdict == "unknown":
            yield _sensor_unanswered(gate, check, sensor, f"{sensor}: {gate.question} is unknown: {found.text}")
            continue
        if isinstance(check, str):
            beyond = VERDICTS.index(found.verdict) - VERDICTS.index(check)
            failed, excess, allowed = beyond > 0, 1.0 + beyond, None
            text = f"{sensor}: {gate.question} is {found.verdict}, at worst {check}: {found.text}"
        elif found.value is None:
            yield _sensor_unanswered(gate, check, sensor, f"{sensor}: {gate.question} has no value: {found.text}")
            continue
        else:
            size = abs(found.value) if check.kind == "max" else found.value
            verdict = judge_limit(check, gate.question, "", Answer(size, found.unit))
            failed, excess, allowed = not verdict.passed, verdict.excess, check.value
            unit = unit_suffix(found.unit)
            shown = beyond_limit_text(found.value, check.value, quantity(found.value, found.unit), unit)
            word = "most" if check.kind == "max" else "least"
            text = f"{sensor}: {gate.question} {shown}, at {word} {check.value:g}{unit}"
        yield GateOutcome(
            sensor,
            gate.check(check),
            gate.question,
            "",
            "failed" if failed else "passed",
            text,
            "limit" if failed else None,
            found.value,
            found.unit,
            allowed,
            excess,
        )


def _sensor_unanswered(gate: SensorGate, check: GateLimit | str, sensor: str, why: str) -> GateOutcome:
    status: Status = "skipped" if gate.unknown_passes else "failed"
    name = gate.check(check)
    return GateOutcome(sensor, name, gate.question, "", status, why, "unanswered")


def lost_row_text(row: EstimatorRow) -> str:
    """Return the sentence on a row that failed or diverged."""
    return f"{row.name} {row.status}{f': {row.reason}' if row.reason else ''}"


def unanswered_text(row: EstimatorRow, metric: str, window: str | None, answer: Answer | None) -> str:
    """Return why a metric cannot be judged; empty where it has a value."""
    name, place = row.name, f" ({answer.window if answer is not None else window or 'any window'})"
    if row.status == "not_judged":
        return f"{name} cannot be judged: {row.reason}"
    if answer is not None:
        return "" if answer.value is not None else f"{name}: no {metric}{place}: {answer.reason}"
    if row.is_reference:
        return f"{name} is what the others are compared with: it has no {metric}{place}"
    if window is not None and window not in row.metrics:
        how = "" if window in WINDOWS else f"; analyse with --window {window}"
        return f"{name}: the result has no window {window}{how}"
    return f"{name}: {metric} means nothing there{place}"


def value_and_limit_text(
    row: str, metric: str, window: str, answer: Answer, limit: GateLimit, other: Answer | None, verdict: LimitVerdict
) -> str:
    """Format a value beside its limit."""
    unit, sign, shown = answer.unit, unit_suffix(answer.unit), quantity(answer.value, answer.unit)
    if limit.kind in ("min", "max"):
        word = "least" if limit.kind == "min" else "most"
        value = beyond_limit_text(float(answer.value or 0.0), limit.value, shown, sign)
        return f"{row}: {metric} {value} ({window}), at {word} {limit.value:g}{sign}"
    what, before = "onboard" if limit.against == "onboard" else "the baseline", verdict.other or 0.0
    text = f"{row}: {metric} {shown} ({window}), {what} {quantity(None if other is None else other.value, unit)}"
    if "ratio" in limit.kind:
        ratio = "nothing to divide by"
        if before:
            times = verdict.size / before
            ratio = beyond_limit_text(times, limit.value, f"{times:.2f}", "") + " times"
        text += f": {ratio}, at most {limit.value:g} times"
    elif "above" in limit.kind:
        more = verdict.size - before
        text += f": {beyond_limit_text(more, limit.value, f'{more:+.3g}{sign}', sign)}, at most {limit.value:+g}{sign}"
    else:
        text += ": not to be worse" if verdict.passed else ": worse"
    return text + (" (no significant difference)" if verdict.excused else "")


def beyond_limit_text(value: float, limit: float, text: str, unit: str) -> str:
    """Format a value; near the limit with enough digits to show its side."""
    size = abs(value)
    if size == limit or abs(size - limit) > 0.1 * limit:
        return text

    def side(x: float) -> int:
        return (x > limit) - (x < limit)

    digits = next((d for d in range(2, 15) if side(float(f"{size:.{d}g}")) == side(size)), 15)
    return f"{value:.{digits}g}{unit}"


def unit_suffix(unit: str) -> str:
    """Format a unit as it follows a number."""
    sign = unit_sign(unit)
    return sign if not sign or sign.startswith("°") else f" {sign}"
