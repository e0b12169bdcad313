"""An earlier run to compare with: one result, a file with one result a line, or the folder of a batch.

Only heads are read to know which log a result is of; a document is read when it is asked for, so that a folder of ten
thousand costs no memory.
"""

from __future__ import annotations

import functools
import json
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

from attlog.compare.comparison import select_questions
from attlog.compare.diff import Tolerances, difference_interval
from attlog.compare.paired import paired
from attlog.core.errors import UsageError
from attlog.metrics import Metric, definitions, ranking
from attlog.metrics.metric import Answer
from attlog.result import Answer as result_Answer
from attlog.result import Assessment, EstimatorRow, Result
from attlog.result.document import SCHEMA_NAME, as_written
from attlog.segments.model import WINDOWS
from attlog.words.numbers import quantity, unit_sign

RESULT_HEAD_BYTES = 64 * 1024
"""Bytes in which a result tells its log, unless its configuration is longer."""
LOG_PATTERN = re.compile(rb'"log":\s*\{\s*"name":\s*("(?:[^"\\]|\\.)*"),\s*"sha256":\s*"([0-9a-f]{64})"')


@dataclass(frozen=True, slots=True)
class DocumentPlace:
    """Where a document stands: a whole file, or the line of one that begins at a byte."""

    path: Path
    start: int = 0
    length: int = -1


@dataclass(frozen=True, slots=True)
class BaselineResult:
    """The result that belongs to a log. ``same_log``: of the same bytes, so that evidence can be paired."""

    result: Result
    same_log: bool


@dataclass(slots=True)
class Baseline:
    """Results by the SHA-256 and by the name of their log; ``only``: there is just one, which is compared with all."""

    name: str
    by_sha256: dict[str, DocumentPlace] = field(default_factory=dict)
    by_name: dict[str, DocumentPlace] = field(default_factory=dict)
    only: DocumentPlace | None = None
    last: tuple[DocumentPlace, Result] | None = None

    def of(self, log: Mapping[str, Any]) -> BaselineResult | str:
        """The result of the same log, else that of a log of the same name, else the only one; or why there is none."""
        same = self.by_sha256.get(str(log.get("sha256")))
        place = same or self.by_name.get(str(log.get("name"))) or self.only
        if place is None:
            return f"the baseline {self.name} has no result of this log"
        try:
            if self.last is None or self.last[0] != place:
                self.last = place, _result_at(place)
        except (OSError, UsageError) as error:
            return f"the baseline {self.name} cannot be read: {error}"
        return BaselineResult(self.last[1], same is not None)


def read_baseline(path: Path) -> Baseline:
    """What a file or folder holds. UsageError where it cannot be read or holds no result."""
    try:
        places = (
            [DocumentPlace(p) for p in sorted(path.rglob("*.json"))] if os.path.isdir(path) else _places_in_file(path)
        )
        found = Baseline(path.name)
        count = 0
        for place in places:
            about = _log_of_place(place)
            if about is None:
                continue
            count += 1
            found.by_name.setdefault(about[0], place)
            if about[1] is not None:
                found.by_sha256.setdefault(about[1], place)
            found.only = place if count == 1 else None
    except OSError as error:
        raise UsageError(f"baseline {path}: cannot be read ({error.strerror or error})") from error
    if not count:
        what = "a folder without a result of attlog (*.json)" if os.path.isdir(path) else "no result of attlog"
        raise UsageError(f"baseline {path}: is {what}")
    if os.path.isdir(path):
        found.only = None
    return found


def read_baselines(paths: Iterable[Path | None]) -> dict[Path, Baseline]:
    """Every baseline that gates look into, each read once. UsageError tells all that cannot be used."""
    found, wrong = {}, []
    for path in dict.fromkeys(p for p in paths if p is not None):
        try:
            found[path] = read_baseline(path)
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    return found


def _places_in_file(path: Path) -> list[DocumentPlace]:
    """The documents of a file: itself, or its lines where it has one a line."""
    starts: list[DocumentPlace] = []
    at = 0
    with open(path, "rb") as file:
        for line in file:
            if not starts and not _is_document(line):
                return [DocumentPlace(path)]
            starts.append(DocumentPlace(path, at, len(line)))
            at += len(line)
    return [place for place in starts if place.length > 1]


def _is_document(line: bytes) -> bool:
    return line.startswith(b"{") and line.rstrip().endswith(b"}")


def _log_of_place(place: DocumentPlace) -> tuple[str, str | None] | None:
    """Name and SHA-256 of the log that a document is of; None for what is no result."""
    with open(place.path, "rb") as file:
        file.seek(place.start)
        head = file.read(RESULT_HEAD_BYTES if place.length < 0 else min(RESULT_HEAD_BYTES, place.length))
    if SCHEMA_NAME.encode() not in head[:200]:
        return None
    found = LOG_PATTERN.search(head)
    if found is not None:
        return str(json.loads(found[1])), found[2].decode()
    try:
        log = _result_at(place).log
    except UsageError:
        return None
    return str(log.get("name")), log.get("sha256")


def _result_at(place: DocumentPlace) -> Result:
    """The result at a place. UsageError for what is none that this version reads."""
    with open(place.path, "rb") as file:
        file.seek(place.start)
        return Result.read(file.read(place.length), place.path.name)


# What a gate said: passed, failed or skipped, why, and how far beyond the limit; the worst first.

Status = Literal["passed", "failed", "skipped"]
Cause = Literal["row", "limit", "unanswered", "no_row"]
STATUS_ORDER = ("failed", "skipped", "passed")
CAUSE_ORDER = ("row", "limit", "unanswered", "no_row", None)
"""Causes of a failure, the worst first."""


@dataclass(frozen=True, slots=True)
class GateOutcome:
    """What one limit of a gate said of one row, or of one sensor.

    ``check`` names gate and limit as in the file (``lag_ms@airborne max=5``), the same for every log. ``cause`` of what
    did not pass: the ``row`` is lost, ``no_row`` is meant, the ``limit`` is exceeded, the metric is ``unanswered``.
    ``excess``: how many times beyond the limit (1 at the limit), for the order. ``sentence`` tells it all. ``excused``:
    passed though beyond a limit to the baseline, because the evidence does not tell it from that.
    """

    row: str
    check: str
    metric: str
    window: str
    status: Status
    cause: Cause | None
    value: float | None
    unit: str
    allowed: float | None
    excess: float
    sentence: str
    excused: bool = False


def worst_first(outcomes: Iterable[GateOutcome]) -> list[GateOutcome]:
    """Failed before skipped before passed; lost rows first, then by how far beyond the limit."""
    return sorted(outcomes, key=lambda o: (STATUS_ORDER.index(o.status), CAUSE_ORDER.index(o.cause), -o.excess))


# Is an answer beyond a limit? Absolute limits and those beside the onboard attitude by the value; those beside a
# baseline so that noise fails no build.
#
# Sizes are compared: where good is zero the absolute value, where good is one (gains) and another answer stands
# beside it
# the distance from one. A limit beside a baseline is exceeded where the size is beyond it **and** the evidence tells
# it
# from the baseline: the 95 % interval of the difference lies on the worse side of zero (of a limit that asks for less
# than the baseline: beyond the limit). The interval is
#
# - on the same log that of the pairs of evidence (:mod:`attlog.compare.paired`); a percentile takes the
# width of its RMSE's interval (``Metric.decided_by``);
# - of two logs, and for metrics without units of evidence, that of independent answers (Zou2008, as
#   :mod:`attlog.compare.diff` does for two flights);
# - without any interval the size alone decides, but not for "not worse than the baseline" of two logs.
#
# "Not worse than the baseline" allows what :mod:`attlog.compare.diff` calls negligible.

LimitKind = Literal[
    "min", "max", "max_ratio_to_onboard", "max_above_onboard", "max_ratio_to_baseline", "max_above_baseline", "baseline"
]
LIMIT_KINDS: tuple[LimitKind, ...] = (
    "min",
    "max",
    "max_ratio_to_onboard",
    "max_above_onboard",
    "max_ratio_to_baseline",
    "max_above_baseline",
    "baseline",
)
"""As they are called in a file; ``baseline`` alone means not worse than it."""
ROUNDING_SHARE = 1e-9
"""A value that differs from its limit by this share is equal to it."""


@dataclass(frozen=True, slots=True)
class GateLimit:
    """One limit. ``value`` in the metric's unit, as a ratio, or 0 for not worse than the baseline."""

    kind: LimitKind
    value: float

    @property
    def against(self) -> Literal["", "onboard", "baseline"]:
        """What the answer is compared with, if with anything."""
        return "onboard" if self.kind.endswith("onboard") else "baseline" if self.kind.endswith("baseline") else ""

    def __str__(self) -> str:
        return "not worse than baseline" if self.kind == "baseline" else f"{self.kind}={self.value:g}"


@dataclass(frozen=True, slots=True)
class LimitVerdict:
    """Whether an answer keeps a limit. ``allowed``: the size up to (or from) which it does; ``excess``: times beyond.

    ``size``, ``other``: the sizes that were compared. ``at_least``: the smallest size that the evidence allows beside
    the other answer, None without one; ``excused``: beyond the limit, but not significantly.
    """

    passed: bool
    allowed: float
    excess: float
    size: float
    other: float | None = None
    at_least: float | None = None
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
    """An answer with a value against one limit.

    ``other``: the onboard attitude's or the baseline's answer, with a value. ``decided``: (other, own) answers of the
    metric whose pairing holds for this one too.
    """
    if other is None:
        size = abs(float(answer.value or 0.0)) if better == "zero" else float(answer.value or 0.0)
        return _judge_absolute(limit, size)
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
    return LimitVerdict(not failed, allowed, excess, size, before, least, beyond and not failed)


def _judge_absolute(limit: GateLimit, size: float) -> LimitVerdict:
    low, high = (limit.value, size) if limit.kind == "min" else (size, limit.value)
    excess = low / high if high > 0.0 else math.inf if low > high else 1.0
    return LimitVerdict(low <= high + ROUNDING_SHARE * abs(high), limit.value, excess, size)


def smallest_size(
    answer: Answer, other: Answer, better: str, same_log: bool, decided: tuple[Answer, Answer] | None = None
) -> float | None:
    """The smallest size (95 %) that an answer can have beside another one's; None where nothing tells it."""
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


# What a gate says of a row, in one sentence.


def no_row_text(pattern: str, names: Sequence[str]) -> str:
    """A pattern that means no row."""
    return f"no row is called {pattern}; the rows are {', '.join(names) if names else 'none'}"


def no_filter_text(names: Sequence[str]) -> str:
    """A gate that names no rows, on a log where it means none."""
    held = f"the rows are {', '.join(names)}; name them under filters if they are meant" if names else "it has no row"
    return f"the result has no filter to be judged: {held}"


def lost_row_text(row: EstimatorRow) -> str:
    """A row that failed or diverged."""
    return f"{row.name} {row.status}{f': {row.reason}' if row.reason else ''}"


def unanswered_text(row: EstimatorRow, metric: str, window: str | None, answer: Answer | None) -> str:
    """Why nothing can be judged; empty where there is a value that can."""
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
    """A value beside its limit."""
    unit, sign, shown = answer.unit, unit_suffix(answer.unit), quantity(answer.value, answer.unit)
    if limit.kind in ("min", "max"):
        word = "least" if limit.kind == "min" else "most"
        value = beyond_limit_text(float(answer.value or 0.0), limit.value, shown, sign)
        return f"{row}: {metric} {value} ({window}), at {word} {limit.value:g}{sign}"
    what = "onboard" if limit.against == "onboard" else "the baseline"
    text = f"{row}: {metric} {shown} ({window}), {what} {quantity(None if other is None else other.value, unit)}"
    if "ratio" in limit.kind:
        text += f": {_ratio_text(verdict.size, verdict.other, limit.value)}, at most {limit.value:g} times"
    elif "above" in limit.kind:
        more = verdict.size - (verdict.other or 0.0)
        text += f": {beyond_limit_text(more, limit.value, f'{more:+.3g}{sign}', sign)}, at most {limit.value:+g}{sign}"
    else:
        text += ": not to be worse" if verdict.passed else ": worse"
    return text + (" (no significant difference)" if verdict.excused else "")


def _ratio_text(size: float, other: float | None, limit: float) -> str:
    if not other:
        return "nothing to divide by"
    return beyond_limit_text(size / other, limit, f"{size / other:.2f}", "") + " times"


def beyond_limit_text(value: float, limit: float, text: str, unit: str) -> str:
    """The text of a value; with as many digits as it takes to see on which side of the limit its size lies."""
    size = abs(value)
    if size == limit or abs(size - limit) > 0.1 * limit:
        return text
    digits = next(
        (d for d in range(2, 15) if _side_of_limit(float(f"{size:.{d}g}"), limit) == _side_of_limit(size, limit)), 15
    )
    return f"{value:.{digits}g}{unit}"


def _side_of_limit(value: float, limit: float) -> int:
    return (value > limit) - (value < limit)


def unit_suffix(unit: str) -> str:
    """A unit as it stands behind a number."""
    sign = unit_sign(unit)
    return sign if not sign or sign.startswith("°") else f" {sign}"


# Which rows does a gate mean, in which window does it look, and which numbers does it compare?

BASELINE_ESTIMATORS = ("gyro", "accel_mag")
"""Estimators that are drawn beside the others and are not meant to be good: they diverge on any long flight."""
WILDCARDS = frozenset("*?[")
LOST_STATUSES = ("failed", "diverged")
"""States of a row that no gate lets pass."""
AnswerOrReason = tuple[Answer | None, str]
"""An answer with a value, or why there is none."""


def select_rows(rows: Sequence[EstimatorRow], filters: Iterable[str] | None) -> tuple[list[EstimatorRow], list[str]]:
    """The rows that patterns name, each once, in the order of the table; and the patterns that name none.

    A pattern means a row's whole name or what stands before ``/imuN`` in it. Onboard attitudes, baselines and the
    reference are meant by name only: a pattern that begins with a wildcard leaves them out. Without patterns every
    estimator row but those.
    """
    if filters is None:
        return [row for row in rows if not _by_name_only(row)], []
    wanted = list(filters)
    names = {id(row): [p for p in wanted if _matches(row, p)] for row in rows}
    found = [row for row in rows if names[id(row)]]
    return found, [p for p in wanted if not any(p in fitting for fitting in names.values())]


def gate_windows(metric: str, window: str | None) -> tuple[str, ...]:
    """Where to look for a metric: in the window named, else in its own ones, of which the first with a value counts."""
    return (window,) if window is not None else select_questions((metric,))[0].windows


def _by_name_only(row: EstimatorRow) -> bool:
    return row.kind != "replay" or row.estimator in BASELINE_ESTIMATORS or row.is_reference


def _matches(row: EstimatorRow, pattern: str) -> bool:
    if _by_name_only(row) and pattern[:1] in WILDCARDS:
        return False
    return fnmatchcase(row.name, pattern) or fnmatchcase(row.name.partition("/imu")[0], pattern)


@functools.cache
def _all_definitions() -> dict[str, Metric]:
    return definitions()


def metric_definition(metric: str) -> Metric:
    """What a metric is. KeyError for one that does not exist."""
    return _all_definitions()[metric]


def first_answer(row: EstimatorRow, metric: str, windows: Iterable[str]) -> tuple[str, Answer | None]:
    """Window and answer: the first window with a value, else the first that knows the metric; ("", None) without."""
    known = [(w, found) for w in windows if (found := row.metrics.get(w, {}).get(metric)) is not None]
    return next(((w, a) for w, a in known if a.value is not None), known[0] if known else ("", None))


def onboard_answer(rows: Sequence[EstimatorRow], metric: str, window: str) -> AnswerOrReason:
    """The answer of the onboard attitude."""
    row = next((r for r in rows if r.name == "onboard"), None)
    if row is None:
        return None, "the log has no onboard attitude to compare with"
    if row.is_reference:
        return None, "the onboard attitude is the reference itself, there is nothing to compare it with"
    if row.status in LOST_STATUSES:
        return None, f"nothing can be compared with onboard: {lost_row_text(row)}"
    return _with_value(row, metric, window, "onboard")


def baseline_answer(baseline: Result | str, name: str, row: EstimatorRow, metric: str, window: str) -> AnswerOrReason:
    """The answer of the same row in the baseline called ``name``; ``baseline`` may be the reason why there is none.

    The same row bears the same name; else it is the only one of the same filter, whose settings may be others.
    """
    if isinstance(baseline, str):
        return None, baseline
    rows = baseline.estimators
    same = [r for r in rows if r.name == row.name] or [r for r in rows if _row_identity(r) == _row_identity(row)]
    if len(same) != 1:
        return None, f"the baseline {name} has {'several rows like' if same else 'no row'} {row.name}"
    return _with_value(same[0], metric, window, f"the baseline {name}")


def _row_identity(row: EstimatorRow) -> tuple[str, str, str]:
    """What a row is but for its settings: kind, filter, and the IMU that it runs on."""
    return row.kind, row.estimator or row.name, row.name.partition("/imu")[2]


def _with_value(row: EstimatorRow, metric: str, window: str, whose: str) -> AnswerOrReason:
    found = first_answer(row, metric, (window,))[1]
    if found is not None and found.value is not None:
        return found, ""
    return None, f"no {metric} ({window}) of {whose}{f': {found.reason}' if found is not None else ''}"


# Do the assessments of a log's sensors keep what a gate allows? Verdicts no worse than one, values within limits.
#
# A question that the log cannot answer, or that nobody asked, fails its gate, unless the gate says that unknown
# passes:
# then it is skipped, and never counted as passed.

NO_SENSOR = "sensors"
"""In place of a sensor where a log has no assessment that a gate means."""
ALLOWED_VERDICTS = ("ok", "warning")
"""Worst verdicts that a gate can allow, the better first; a fault is the third."""


@dataclass(frozen=True, slots=True)
class SensorGate:
    """A line of ``[gates.health]``: limits on the value of a question, and the worst verdict allowed.

    ``sensors``: names or patterns of the sensors that are meant, None for all. ``unknown_passes``: what cannot be
    told is skipped.
    """

    question: str
    limits: tuple[GateLimit, ...] = ()
    worst: str | None = None
    sensors: tuple[str, ...] | None = None
    unknown_passes: bool = False


def judge_sensors(gate: SensorGate, health: Iterable[Assessment]) -> list[GateOutcome]:
    """What a gate says of the assessments of a log: an outcome for each sensor and limit."""
    asked = [a for a in health if a.question == gate.question and _names_sensor(gate.sensors, a.sensor)]
    checks: list[GateLimit | str] = [*gate.limits, *([] if gate.worst is None else [gate.worst])]
    if not asked:
        named = "" if gate.sensors is None else f" for {' or '.join(gate.sensors)}"
        why = f"the log has no answer to {gate.question}{named}"
        return [_sensor_unanswered(gate, check, ", ".join(gate.sensors or (NO_SENSOR,)), why) for check in checks]
    return [outcome for assessment in asked for outcome in _sensor_outcomes(gate, checks, assessment)]


def _names_sensor(patterns: Sequence[str] | None, sensor: str) -> bool:
    return patterns is None or any(fnmatchcase(sensor, pattern) for pattern in patterns)


def _sensor_outcomes(gate: SensorGate, checks: Iterable[GateLimit | str], found: Assessment) -> Iterator[GateOutcome]:
    sensor = found.sensor or NO_SENSOR
    for check in checks:
        if found.verdict == "unknown":
            yield _sensor_unanswered(gate, check, sensor, f"{sensor}: {gate.question} is unknown: {found.text}")
        elif isinstance(check, str):
            yield _verdict_outcome(gate, check, sensor, found)
        elif found.value is None:
            yield _sensor_unanswered(gate, check, sensor, f"{sensor}: {gate.question} has no value: {found.text}")
        else:
            yield _value_outcome(gate, check, sensor, found, found.value)


def _verdict_outcome(gate: SensorGate, worst: str, sensor: str, found: Assessment) -> GateOutcome:
    place = {verdict: k for k, verdict in enumerate((*ALLOWED_VERDICTS, "fault"))}
    beyond = place[found.verdict] - place[worst]
    text = f"{sensor}: {gate.question} is {found.verdict}, at worst {worst}: {found.text}"
    return _sensor_outcome(gate, worst, sensor, found, beyond > 0, 1.0 + beyond, text)


def _value_outcome(gate: SensorGate, limit: GateLimit, sensor: str, found: Assessment, value: float) -> GateOutcome:
    size = abs(value) if limit.kind == "max" else value
    verdict = judge_limit(limit, gate.question, "", result_Answer(size, found.unit))
    word = "most" if limit.kind == "max" else "least"
    unit = unit_suffix(found.unit)
    shown = beyond_limit_text(value, limit.value, quantity(value, found.unit), unit)
    text = f"{sensor}: {gate.question} {shown}, at {word} {limit.value:g}{unit}"
    return _sensor_outcome(gate, limit, sensor, found, not verdict.passed, verdict.excess, text)


def _sensor_outcome(
    gate: SensorGate, check: GateLimit | str, sensor: str, found: Assessment, failed: bool, excess: float, text: str
) -> GateOutcome:
    allowed = check.value if isinstance(check, GateLimit) else None
    status: Status = "failed" if failed else "passed"
    cause: Cause | None = "limit" if failed else None
    return GateOutcome(
        sensor,
        sensor_check_name(gate, check),
        gate.question,
        "",
        status,
        cause,
        found.value,
        found.unit,
        allowed,
        excess,
        text,
    )


def _sensor_unanswered(gate: SensorGate, check: GateLimit | str, sensor: str, why: str) -> GateOutcome:
    status: Status = "skipped" if gate.unknown_passes else "failed"
    return GateOutcome(
        sensor, sensor_check_name(gate, check), gate.question, "", status, "unanswered", None, "", None, math.inf, why
    )


def sensor_check_name(gate: SensorGate, check: GateLimit | str) -> str:
    """A check as in the file: ``health.compass_offset max=5``, ``health.notch verdict=warning``."""
    return f"health.{gate.question} {check if isinstance(check, GateLimit) else f'verdict={check}'}"


# Which of a log's numbers are beyond what was allowed? Gates, judged on a result.
#
# A gate asks one metric in one window of every row that it means (:mod:`attlog.compare.gates`) for one or more
# limits (:mod:`attlog.compare.gates`). It fails a row that failed or diverged, whatever its numbers; it fails
# an
# answer that is not there, unless it is optional, in which case that is skipped and never passed; and it fails where
# it
# means no row. A strict set of gates also fails every row that failed or diverged and that no gate asks. Gates of
# sensors
# ask assessments instead of rows (:mod:`attlog.compare.gates`).

STATUS_CHECK = "status"
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


def judge_gates(gates: Gates, result: Result, baselines: Mapping[Path, Baseline] | None = None) -> list[GateOutcome]:
    """What the gates say of one result: worst first.

    ``baselines``: of :func:`attlog.compare.gates.read_baselines`, for gates that look into one.
    """
    rows = result.estimators
    found: list[GateOutcome] = []
    for gate in gates.gates:
        baseline = (baselines or {}).get(gate.baseline) if gate.baseline is not None else None
        beside = "no baseline was given" if baseline is None else baseline.of(result.log)
        meant, unmatched = select_rows(rows, gate.filters)
        if gate.filters is None and not meant:
            unmatched = ["*"]
        for limit in gate.limits:
            for pattern in unmatched:
                names = [row.name for row in rows]
                text = no_filter_text(names) if gate.filters is None else no_row_text(pattern, names)
                found.append(_without_value(gate, limit, pattern, "no_row", text))
            found += [_limit_outcome(gate, limit, row, rows, beside) for row in meant]
    found += [outcome for gate in gates.health for outcome in judge_sensors(gate, result.health)]
    if gates.strict:
        found += [_row_outcome(row) for row in select_rows(rows, None)[0]]
    return worst_first(found)


def _limit_outcome(
    gate: Gate, limit: GateLimit, row: EstimatorRow, rows: list[EstimatorRow], beside: BaselineResult | str
) -> GateOutcome:
    """One limit on one row."""
    name = row.name
    if row.status in LOST_STATUSES:
        return _without_value(gate, limit, name, "row", lost_row_text(row))
    window, answer = first_answer(row, gate.metric, gate_windows(gate.metric, gate.window))
    why = unanswered_text(row, gate.metric, gate.window, answer)
    if answer is None or why:
        return _without_value(gate, limit, name, "unanswered", why, window)
    known = metric_definition(gate.metric)
    other, why = _compared_answer(limit, gate, gate.metric, row, rows, beside, window)
    if why:
        return _without_value(gate, limit, name, "unanswered", f"{name}: {why}", window)
    if limit.against == "baseline" and other is not None:  # of which only the written digits are known
        answer, other = as_written(answer), as_written(other)
    decided = None
    if limit.against == "baseline" and known.decided_by:
        mine = first_answer(row, known.decided_by, (window,))[1]
        theirs, _ = _compared_answer(limit, gate, known.decided_by, row, rows, beside, window)
        decided = None if mine is None or theirs is None else (as_written(theirs), as_written(mine))
    alike = limit.against != "baseline" or (isinstance(beside, BaselineResult) and beside.same_log)
    verdict = judge_limit(limit, gate.metric, known.better, answer, other, same_log=alike, decided=decided)
    return GateOutcome(
        name,
        _check_name(gate, limit),
        gate.metric,
        window,
        "passed" if verdict.passed else "failed",
        None if verdict.passed else "limit",
        answer.value,
        answer.unit,
        verdict.allowed,
        verdict.excess,
        value_and_limit_text(name, gate.metric, window, answer, limit, other, verdict),
        verdict.excused,
    )


def _compared_answer(
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
        return onboard_answer(rows, metric, window)
    if limit.against == "baseline":
        place = gate.baseline.name if gate.baseline is not None else ""
        baseline = beside if isinstance(beside, str) else beside.result
        return baseline_answer(baseline, place, row, metric, window)
    return None, ""


def _without_value(gate: Gate, limit: GateLimit, row: str, cause: Cause, why: str, window: str = "") -> GateOutcome:
    """No number that could pass: failed, or skipped where nothing was answered and the gate is optional."""
    skipped = gate.optional and cause == "unanswered"
    return GateOutcome(
        row,
        _check_name(gate, limit),
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


def _row_outcome(row: EstimatorRow) -> GateOutcome:
    """Whether a row ran to its end."""
    name, lost = row.name, row.status in LOST_STATUSES
    sentence = lost_row_text(row) if lost else f"{name}: {row.status}"
    status: Status = "failed" if lost else "passed"
    excess = math.inf if lost else 0.0
    return GateOutcome(
        name, STATUS_CHECK, STATUS_CHECK, "", status, "row" if lost else None, None, "", None, excess, sentence
    )


def _check_name(gate: Gate, limit: GateLimit) -> str:
    window = f"@{gate.window}" if gate.window else ""
    return f"{gate.metric}{window} {limit}"
