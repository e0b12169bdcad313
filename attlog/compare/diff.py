"""What can differ between two results: numbers, settings, texts; and all of it together."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any, Literal

from attlog.compare.comparison import MAIN_QUESTIONS
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, UsageError, suggestion
from attlog.result import MEASURED_TIMES, SCHEMA_NAME, Answer, EstimatorRow, Result
from attlog.words.answers import QUESTIONS

Verdict = Literal["beyond", "within", "not_significant", "appeared", "vanished"]
Interval = tuple[float, float]
ABSENT_VALUE = "(absent)"


@dataclass(frozen=True, slots=True)
class NumberChange:
    """A number that differs. ``closer``: the newer value is the better one; None where neither is.

    ``verdict``: ``beyond`` the tolerance, ``within``, ``not_significant`` (two flights whose intervals overlap, or
    without interval), ``appeared``, ``vanished`` (``reason`` says why there is no value). ``interval`` is that of the
    difference of two flights.
    """

    row: str
    window: str
    metric: str
    unit: str
    old: float | None
    new: float | None
    old_ci95: Interval | None
    new_ci95: Interval | None
    difference: float | None
    interval: Interval | None
    tolerance: float | None
    verdict: Verdict
    closer: bool | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class TextChange:
    """A setting, text or state that differs; ``(absent)`` where one side does not have it."""

    name: str
    old: Any
    new: Any


@dataclass(slots=True)
class RunDifference:
    """Two results side by side.

    ``statements``: headline and findings above notes that differ; ``verdicts``: sentences; ``made_by``: versions
    of attlog; ``log``: firmware, vehicle and what else describes the flight; ``config``: options; ``parameters``: of
    the log, first those that both have (none of two kinds of autopilot), None where a side was written before results
    held them; ``gains``: filter parameters; ``status``: of rows; ``moved``: numbers that differ, sorted by
    :mod:`attlog.compare.diff`.
    """

    name: str
    same_log: bool
    statements: list[TextChange] = field(default_factory=list)
    verdicts: list[TextChange] = field(default_factory=list)
    made_by: list[TextChange] = field(default_factory=list)
    log: list[TextChange] = field(default_factory=list)
    config: list[TextChange] = field(default_factory=list)
    parameters: list[TextChange] | None = None
    gains: list[TextChange] = field(default_factory=list)
    rows_appeared: list[str] = field(default_factory=list)
    rows_vanished: list[str] = field(default_factory=list)
    status: list[TextChange] = field(default_factory=list)
    moved: list[NumberChange] = field(default_factory=list)
    equal: int = 0

    @property
    def beyond(self) -> list[NumberChange]:
        """The numbers that count as different."""
        gone = ("appeared", "vanished") if self.same_log else ()
        return [m for m in self.moved if m.verdict == "beyond" or m.verdict in gone]

    @property
    def count(self) -> int:
        """How many differences count: numbers, rows, states of rows."""
        return len(self.beyond) + len(self.rows_appeared) + len(self.rows_vanished) + len(self.status)


# How far may a number move before it counts as another one?

NEGLIGIBLE = {
    "deg": 0.01,
    "ms": 0.5,
    "deg/min": 0.1,
    "deg/s": 0.01,
    "1/s": 0.02,
    "%": 0.5,
    "s": 0.1,
    "1": 0.005,
    "deg/h": 0.5,
    "deg/sqrt(h)": 0.005,
    "deg/sqrt_h": 0.005,
}
"""Differences up to this, by unit, mean nothing to anybody who flies."""
NEGLIGIBLE_SHARE = 0.02
"""Nor does this share of the older value."""
NUMBER_PATTERN = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)", re.S)


@dataclass(frozen=True, slots=True)
class ToleranceRule:
    """What one option says: the metrics that its pattern names may move by ``size`` in their unit, or by ``share``."""

    pattern: str
    size: float | None
    share: float | None


@dataclass(frozen=True, slots=True)
class Tolerances:
    """The rules of the user, of which the last that fits a metric counts; without one SMALLEST or SHARE, the larger."""

    rules: tuple[ToleranceRule, ...] = ()

    def rule(self, metric: str) -> ToleranceRule | None:
        """The rule that was given for a metric, None where there is none."""
        return next((r for r in reversed(self.rules) if fnmatchcase(metric, r.pattern)), None)

    def of(self, metric: str, unit: str, old: float) -> float:
        """How far a metric may move from ``old``, in its unit."""
        rule = self.rule(metric)
        if rule is None:
            return max(NEGLIGIBLE.get(unit, 0.0), NEGLIGIBLE_SHARE * abs(old))
        return rule.size if rule.size is not None else (rule.share or 0.0) * abs(old)


def parse_tolerances(texts: Iterable[str], units: Mapping[str, str]) -> Tolerances:
    """The rules of texts such as ``lag_ms=2``, ``noise_tilt_deg=0.01deg``, ``noise_*=5%`` (or ``5pct``).

    ``units``: metric id -> its unit. A percent sign means a share of the older value, also of a metric in percent.
    UsageError tells everything that is wrong in them.
    """
    rules, wrong = [], []
    for text in texts:
        try:
            rules.append(_parse_rule(text, units))
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    return Tolerances(tuple(rules))


def _parse_rule(text: str, units: Mapping[str, str]) -> ToleranceRule:
    pattern, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not pattern:
        raise UsageError(f"--tolerance {text}: give METRIC=VALUE, such as lag_ms=2 or noise_*=5%")
    meant = [name for name in units if fnmatchcase(name, pattern)]
    if not meant:
        measured = pattern in MEASURED_TIMES
        why = (
            "is measured anew in each run and not compared" if measured else "is no metric" + suggestion(pattern, units)
        )
        raise UsageError(f"--tolerance {text}: {pattern} {why}")
    found = NUMBER_PATTERN.fullmatch(value)
    number = float(found[1]) if found else math.nan
    if found is None or not (math.isfinite(number) and number >= 0.0):
        raise UsageError(
            f"--tolerance {text}: {value or 'nothing'} is no size; give a number from 0 on, or a share as 5%"
        )
    unit = found[2].strip()
    if unit in ("%", "pct"):
        return ToleranceRule(pattern, None, number / 100.0)
    others = sorted({units[name] for name in meant} - {unit})
    if unit and others:
        raise UsageError(f"--tolerance {text}: {pattern} is in {' or '.join(others)}, not in {unit}")
    return ToleranceRule(pattern, number, None)


# Changes by their meaning: question by question, the numbers of the report first, worse before better.

OTHER_QUESTION = "Other numbers"
QUESTION_ORDER = ("Accuracy", "Noise", "Step response", "Yaw drift", OTHER_QUESTION)
VERDICT_ORDER = ("beyond", "vanished", "appeared", "not_significant", "within")


@cache
def metric_titles() -> dict[str, tuple[str, str]]:
    """Metric id -> its question and its title."""
    from attlog.metrics import groups
    from attlog.metrics.cost import COST

    return {m.name: (q.topic or OTHER_QUESTION, m.title) for q in (*groups(), COST) for m in q.metrics}


def metric_question(metric: str) -> str:
    """The question that a metric answers; an air drift's id ends with its heading reference."""
    return _question_and_title(metric)[0]


def metric_title(metric: str) -> str:
    """What a metric is called, its id where nobody knows it."""
    return _question_and_title(metric)[1]


def _question_and_title(metric: str) -> tuple[str, str]:
    known = metric_titles()
    return known.get(metric) or known.get(metric.rpartition(".")[0], (OTHER_QUESTION, metric))


def is_main_number(m: NumberChange) -> bool:
    """Whether a comparison asks for this number in this window."""
    known = metric_titles()
    metric = m.metric if m.metric in known else m.metric.rpartition(".")[0]
    return any(metric == name and m.window == windows[0] for name, windows in MAIN_QUESTIONS)


def sorted_changes(moved: Iterable[NumberChange]) -> list[NumberChange]:
    """What is beyond its tolerance first, by question, there the numbers that a comparison asks for.

    Worse stands before better, the most tolerances before fewer.
    """
    return sorted(moved, key=_change_order)


def _change_order(m: NumberChange) -> tuple[bool, int, bool, int, float, int]:
    side = 0 if m.closer is False else 1 if m.verdict in ("vanished", "appeared") else 3 if m.closer else 2
    quiet = m.verdict in ("not_significant", "within")
    return (
        quiet,
        QUESTION_ORDER.index(metric_question(m.metric)),
        not is_main_number(m),
        side,
        -in_tolerances(m),
        VERDICT_ORDER.index(m.verdict),
    )


def in_tolerances(m: NumberChange) -> float:
    """A difference in tolerances."""
    if m.difference is None or m.tolerance is None:
        return 0.0
    return abs(m.difference) / m.tolerance if m.tolerance > 0.0 else math.inf


# What changed between two runs: of one log by two versions, or of two flights with two firmwares.
#
# Of the same log (same SHA-256) every difference comes from what was run, so that it counts where it exceeds its
# tolerance. Of two logs it counts only where its interval excludes zero as well: with v1 in [l1, u1] and v2 in [l2,
# u2]
# the difference lies between v2 - v1 - sqrt((v2 - l2)^2 + (u1 - v1)^2) and v2 - v1 + sqrt((u2 - v2)^2 + (v1 - l1)^2)
# (Zou2008, independent estimates).


def metric_units(*results: Result) -> dict[str, str]:
    """The unit of every metric that any of the results defines, without what is measured anew in each run."""
    found = {name: str(d.get("unit", "")) for r in results for name, d in r.definitions.items()}
    return {name: unit for name, unit in found.items() if name not in MEASURED_TIMES}


def compare_results(
    name: str, old: Result, new: Result, tolerances: Tolerances, window: str | None = None
) -> RunDifference:
    """What differs between two results; ``window`` limits the numbers to one."""
    sha = [r.log.get("sha256") for r in (old, new)]
    found = RunDifference(name, same_log=sha[0] is not None and sha[0] == sha[1])
    found.statements = _changed_statements(old, new)
    found.verdicts = _changed_entries(
        *({QUESTIONS[v.question].capitalize(): v.sentence for v in r.verdicts} for r in (old, new))
    )
    found.made_by = _changed_entries({"attlog": old.attlog.get("version")}, {"attlog": new.attlog.get("version")})
    about = ("name", "firmware", "vehicle", "format")
    found.log = (
        [] if found.same_log else _changed_entries(*(_flatten({k: r.log.get(k) for k in about}) for r in (old, new)))
    )
    found.config = _changed_entries(_flatten(old.config), _flatten(new.config))
    found.parameters = _changed_parameters(old, new)
    rows = [{row.name: row for row in r.estimators} for r in (old, new)]
    found.rows_vanished = [n for n in rows[0] if n not in rows[1]]
    found.rows_appeared = [n for n in rows[1] if n not in rows[0]]
    better = {m: str(d.get("better", "low")) for r in (old, new) for m, d in r.definitions.items()}
    for row in (n for n in rows[0] if n in rows[1]):
        a, b = rows[0][row], rows[1][row]
        found.gains += _changed_entries(*({f"{row}: {k}": p.value for k, p in r.parameters.items()} for r in (a, b)))
        found.status += _changed_entries({row: a.status}, {row: b.status})
        for moved in _changed_numbers(a, b, tolerances, found.same_log, better, window):
            if moved is None:
                found.equal += 1
            else:
                found.moved.append(moved)
    found.moved = sorted_changes(found.moved)
    return found


def _changed_statements(old: Result, new: Result) -> list[TextChange]:
    """What a report says otherwise: its headline (older results have none), its findings but notes."""
    sides = []
    for result in (old, new):
        headline = {"headline": result.headline} if old.headline and new.headline else {}
        findings = {f"finding: {f.kind}": f.text for f in reversed(result.findings) if f.is_trouble}
        sides.append((headline, findings))
    return [change for a, b in zip(*sides, strict=True) for change in _changed_entries(a, b)]


def _changed_parameters(old: Result, new: Result) -> list[TextChange] | None:
    """Parameters that differ, first those that both have; none of two kinds of autopilot, None where a side has none.

    A result whose log tells defaults lists what differs from them: all else has its default, which is that of the
    other result where that tells it.
    """
    params = [r.log.get("params") for r in (old, new)]
    if not all(isinstance(side, dict) for side in params):
        return None
    if len({str(dict(r.log.get("firmware") or {}).get("name")) for r in (old, new)}) > 1:
        return []
    sides = [dict(side or {}) for side in params]
    told: list[dict[str, Any]] = [dict(r.log.get("params_changed") or {}) for r in (old, new)]
    for mine, beside, known, others in zip(sides, sides[::-1], told, told[::-1], strict=True):
        if known:
            absent = [name for name in beside if name not in mine]
            mine |= {name: others[name][1] if name in others else beside[name] for name in absent}
    return sorted(_changed_entries(*sides), key=lambda c: ABSENT_VALUE in (c.old, c.new))


def _changed_numbers(
    old: EstimatorRow,
    new: EstimatorRow,
    tolerances: Tolerances,
    same_log: bool,
    better: Mapping[str, str],
    only: str | None,
) -> Iterator[NumberChange | None]:
    """The numbers of a row that differ, None for each that does not."""
    for window in dict.fromkeys([*old.metrics, *new.metrics]):
        if only is not None and window != only:
            continue
        sides = old.metrics.get(window, {}), new.metrics.get(window, {})
        for metric in dict.fromkeys([*sides[0], *sides[1]]):
            if metric in MEASURED_TIMES:
                continue
            a, b = sides[0].get(metric), sides[1].get(metric)
            if _answer_value(a) is None and _answer_value(b) is None:
                continue
            if a is not None and b is not None and (a.value, a.ci95) == (b.value, b.ci95):
                yield None
            else:
                yield _number_change(old.name, window, metric, a, b, tolerances, same_log, better.get(metric, "low"))


def _number_change(
    row: str,
    window: str,
    metric: str,
    old: Answer | None,
    new: Answer | None,
    tolerances: Tolerances,
    same_log: bool,
    better: str,
) -> NumberChange:
    a, b = _answer_value(old), _answer_value(new)
    unit = next((x.unit for x in (new, old) if x is not None), "")
    ends = (None if old is None else old.ci95, None if new is None else new.ci95)
    if a is None or b is None:
        gone = new if b is None else old
        reason = "" if gone is None else gone.reason or ""
        kind: Verdict = "vanished" if b is None else "appeared"
        return NumberChange(row, window, metric, unit, a, b, *ends, None, None, None, kind, reason=reason)
    change = b - a
    limit = tolerances.of(metric, unit, a)
    span = None if same_log else difference_interval(a, ends[0], b, ends[1])
    verdict: Verdict = "beyond" if abs(change) > limit * (1.0 + 1e-9) else "within"
    if verdict == "beyond" and not same_log:
        by_hand = tolerances.rule(metric) is not None
        significant = by_hand if span is None else not span[0] <= 0.0 <= span[1]
        verdict = "beyond" if significant else "not_significant"
    sizes = distance_from_perfect(a, better), distance_from_perfect(b, better)
    closer = None if sizes[0] == sizes[1] else sizes[1] < sizes[0]
    return NumberChange(row, window, metric, unit, a, b, *ends, change, span, limit, verdict, closer)


def difference_interval(a: float, a_ci95: Interval | None, b: float, b_ci95: Interval | None) -> Interval | None:
    """The 95 % interval of b - a of independent values; None where one has none."""
    if a_ci95 is None or b_ci95 is None:
        return None
    down = math.hypot(b - b_ci95[0], a_ci95[1] - a)
    up = math.hypot(b_ci95[1] - b, a - a_ci95[0])
    return b - a - down, b - a + up


def distance_from_perfect(value: float, better: str) -> float:
    """How far a value is from perfect: the smaller the better, whatever ``better`` says."""
    if better == "high":
        return -value
    return value if better == "low" else abs(value - 1.0) if better == "one" else abs(value)


def _answer_value(answer: Answer | None) -> float | None:
    return None if answer is None else answer.value


def _changed_entries(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[TextChange]:
    """Entries that differ, those of one side only included, in the order of names."""
    names = sorted(old.keys() | new.keys())
    pairs = [(n, old.get(n, ABSENT_VALUE), new.get(n, ABSENT_VALUE)) for n in names]
    return [TextChange(n, a, b) for n, a, b in pairs if a != b]


def _flatten(value: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Entries of nested objects under dotted names; None counts as absent."""
    found: dict[str, Any] = {}
    for name, entry in value.items():
        if isinstance(entry, Mapping):
            found |= _flatten(entry, f"{before}{name}.")
        elif entry is not None:
            found[before + name] = entry
    return found


# Which results belong together: two files, or the files of two folders by name, else by the log they are of.

SCHEMA_BYTES = 200
"""A result says so within its first bytes."""


@dataclass(slots=True)
class ResultPairs:
    """Results by the name that both sides share; None where one side has none. ``wrong``: files that cannot be used."""

    pairs: dict[str, tuple[Result | None, Result | None]] = field(default_factory=dict)
    wrong: list[AttlogError] = field(default_factory=list)


def pair_results(old: Path, new: Path) -> ResultPairs:
    """The results in two files or two folders. LogUnreadable, LogUnusable for a file or folder that has none.

    UsageError for a file beside a folder. In folders a broken file is left out and named in ``wrong``.
    """
    if os.path.isdir(old) != os.path.isdir(new) and os.path.exists(old) and os.path.exists(new):
        raise UsageError(f"{old} and {new}: give two files or two folders")
    if not os.path.isdir(old):
        return ResultPairs({new.name: (load_result(old), load_result(new))})
    answer = ResultPairs()
    sides = [_folder_results(folder, answer.wrong) for folder in (old, new)]
    names = {name: name for name in sides[0] if name in sides[1]}
    for name in (n for n in sides[0] if n not in names):
        log = sides[0][name].log.get("sha256")
        same = [n for n in sides[1] if n not in names.values() and sides[1][n].log.get("sha256") == log and log]
        names |= {name: same[0]} if len(same) == 1 else {}
    answer.pairs = {name: (sides[0][name], sides[1][names[name]] if name in names else None) for name in sides[0]}
    answer.pairs |= {name: (None, r) for name, r in sides[1].items() if name not in names.values()}
    return answer


def load_result(path: Path) -> Result:
    """A result. LogUnreadable if the file cannot be opened, LogUnusable if it is no result."""
    try:
        return Result.load(path)
    except UsageError as error:
        raise LogUnusable(str(error)) from None


def _folder_results(folder: Path, wrong: list[AttlogError]) -> dict[str, Result]:
    """The results below a folder by their path in it; other JSON files are not meant."""
    meant = [p for p in sorted(folder.rglob("*.json")) if os.path.isfile(p) and _is_result_file(p)]
    if not meant:
        raise LogUnreadable(f"{folder}: is a folder without a result of attlog analyze (*.json)")
    results: dict[str, Result] = {}
    for path in meant:
        try:
            results[path.relative_to(folder).as_posix()] = load_result(path)
        except AttlogError as error:
            wrong.append(error)
    return results


def _is_result_file(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return SCHEMA_NAME.encode() in file.read(SCHEMA_BYTES)
    except OSError:
        return True  # reading it says what is wrong
