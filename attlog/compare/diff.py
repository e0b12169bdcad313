"""Differences between two results, of one log or of two flights.

Of the same log (same SHA-256) a number counts where it moved by more than its tolerance. Of two logs the interval of
the difference has to exclude zero as well: of independent v1 in [l1, u1] and v2 in [l2, u2] it reaches from
v2 - v1 - sqrt((v2 - l2)^2 + (u1 - v1)^2) to v2 - v1 + sqrt((u2 - v2)^2 + (v1 - l1)^2) (Zou2008).
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any, Literal

from attlog.compare.comparison import MAIN_QUESTIONS
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, UsageError, suggestion
from attlog.metrics.metric import Answer
from attlog.metrics.ranking import distance
from attlog.result import MEASURED_TIMES, SCHEMA_NAME, EstimatorRow, Result
from attlog.words.answers import QUESTIONS

Verdict = Literal["beyond", "within", "not_significant", "appeared", "vanished"]
Interval = tuple[float, float]
ABSENT_VALUE = "(absent)"
# Negligible differences by unit, and as a share of the older value.
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
NEGLIGIBLE_SHARE = 0.02
# Relative rounding error of a difference equal to its tolerance.
ROUNDING_SHARE = 1e-9
NUMBER_PATTERN = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)", re.S)
OTHER_QUESTION = "Other numbers"
QUESTION_ORDER = ("Accuracy", "Noise", "Step response", "Yaw drift", "Innovations", OTHER_QUESTION)
VERDICT_ORDER = ("beyond", "vanished", "appeared", "not_significant", "within")
QUIET_VERDICTS = ("not_significant", "within")
# Byte range in which a result names its schema.
SCHEMA_BYTES = 200


@dataclass(frozen=True, slots=True)
class NumberChange:
    """Number that differs between two results.

    ``closer``: the newer value is nearer to its ideal; None if both are equally near. ``verdict``: ``beyond`` the
    tolerance, ``within``, ``not_significant`` (of two flights), ``appeared``, ``vanished`` (``reason``: why the value
    is missing). ``interval``: of the difference between two flights.
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

    @property
    def question(self) -> str:
        """Return the title of the metric's question."""
        return _question_and_title(self.metric)[0]

    @property
    def title(self) -> str:
        """Return the metric's title, its id where it is unknown."""
        return _question_and_title(self.metric)[1]

    @property
    def is_main(self) -> bool:
        """Return whether a comparison includes this metric and window by default."""
        known = metric_titles()
        metric = self.metric if self.metric in known else self.metric.rpartition(".")[0]
        return any(metric == name and self.window == windows[0] for name, windows in MAIN_QUESTIONS)

    @property
    def order(self) -> tuple[bool, int, bool, int, float, int]:
        """Return the sort key.

        Differences that count come first, then by question, main numbers, worse ones, and size in tolerances.
        """
        side = 0 if self.closer is False else 1 if self.verdict in ("vanished", "appeared") else 3 if self.closer else 2
        times = 0.0
        if self.difference is not None and self.tolerance is not None:
            times = abs(self.difference) / self.tolerance if self.tolerance > 0.0 else math.inf
        place = QUESTION_ORDER.index(self.question)
        return self.verdict in QUIET_VERDICTS, place, not self.is_main, side, -times, VERDICT_ORDER.index(self.verdict)


@dataclass(frozen=True, slots=True)
class TextChange:
    """Setting, text or state that differs; ``(absent)`` where one side has none."""

    name: str
    old: Any
    new: Any


@dataclass(slots=True)
class RunDifference:
    """Two results side by side.

    ``statements``: headline, and findings more severe than notes. ``verdicts``: sentences. ``made_by``: versions of
    attlog. ``log``: firmware, vehicle, format. ``config``: options. ``references``: kind and source of what was
    compared with; where they differ no value is better or worse. ``parameters`` of the log: shared ones first, none
    for two kinds of autopilot, None where a result has none. ``gains``: filter parameters. ``status``: of rows.
    ``moved``: numbers that differ, sorted.
    """

    name: str
    same_log: bool
    statements: list[TextChange] = field(default_factory=list)
    verdicts: list[TextChange] = field(default_factory=list)
    made_by: list[TextChange] = field(default_factory=list)
    log: list[TextChange] = field(default_factory=list)
    config: list[TextChange] = field(default_factory=list)
    references: list[TextChange] = field(default_factory=list)
    parameters: list[TextChange] | None = None
    gains: list[TextChange] = field(default_factory=list)
    rows_appeared: list[str] = field(default_factory=list)
    rows_vanished: list[str] = field(default_factory=list)
    status: list[TextChange] = field(default_factory=list)
    moved: list[NumberChange] = field(default_factory=list)
    equal: int = 0

    @property
    def beyond(self) -> list[NumberChange]:
        """Return the numbers that count as different."""
        gone = ("appeared", "vanished") if self.same_log else ()
        return [m for m in self.moved if m.verdict == "beyond" or m.verdict in gone]

    @property
    def count(self) -> int:
        """Return the number of differences that count: numbers, rows, states of rows."""
        return len(self.beyond) + len(self.rows_appeared) + len(self.rows_vanished) + len(self.status)


@dataclass(frozen=True, slots=True)
class ToleranceRule:
    """Tolerance of metrics: ``size`` in their unit, or ``share`` of the older value."""

    pattern: str
    size: float | None
    share: float | None


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Tolerances of the user; the last matching rule counts.

    Without a match the tolerance is NEGLIGIBLE or its share, whichever is larger.
    """

    rules: tuple[ToleranceRule, ...] = ()

    def rule(self, metric: str) -> ToleranceRule | None:
        """Return the user's rule for a metric, None without one."""
        return next((r for r in reversed(self.rules) if fnmatchcase(metric, r.pattern)), None)

    def of(self, metric: str, unit: str, old: float) -> float:
        """Return the tolerance of a metric at the older value ``old``, in its unit."""
        rule = self.rule(metric)
        if rule is None:
            return max(NEGLIGIBLE.get(unit, 0.0), NEGLIGIBLE_SHARE * abs(old))
        return rule.size if rule.size is not None else (rule.share or 0.0) * abs(old)


def parse_tolerances(texts: Iterable[str], units: Mapping[str, str]) -> Tolerances:
    """Parse tolerances such as ``lag_ms=2``, ``noise_tilt_deg=0.01deg``, ``noise_*=5%``.

    ``5pct`` equals ``5%``. ``units``: unit by metric. A percent sign means a share of the older value, also of a metric
    in percent. UsageError lists every error.
    """
    rules, wrong = [], []
    for text in texts:
        try:
            rules.append(_parse_rule(text, units))
        except UsageError as error:
            wrong.append(f"--tolerance {text}: {error}")
    if wrong:
        raise UsageError("\n".join(wrong))
    return Tolerances(tuple(rules))


def _parse_rule(text: str, units: Mapping[str, str]) -> ToleranceRule:
    pattern, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not pattern:
        raise UsageError("give METRIC=VALUE, such as lag_ms=2 or noise_*=5%")
    meant = [name for name in units if fnmatchcase(name, pattern)]
    if not meant and pattern in MEASURED_TIMES:
        raise UsageError(f"{pattern} is measured anew in each run and not compared")
    if not meant:
        raise UsageError(f"{pattern} is no metric{suggestion(pattern, units)}")
    found = NUMBER_PATTERN.fullmatch(value)
    number = float(found[1]) if found else math.nan
    if found is None or not (math.isfinite(number) and number >= 0.0):
        raise UsageError(f"{value or 'nothing'} is no size; give a number from 0 on, or a share as 5%")
    unit = found[2].strip()
    if unit in ("%", "pct"):
        return ToleranceRule(pattern, None, number / 100.0)
    others = sorted({units[name] for name in meant} - {unit})
    if unit and others:
        raise UsageError(f"{pattern} is in {' or '.join(others)}, not in {unit}")
    return ToleranceRule(pattern, number, None)


@cache
def metric_titles() -> dict[str, tuple[str, str]]:
    """Return question and title by metric."""
    from attlog.metrics import groups
    from attlog.metrics.cost import COST

    return {m.name: (group.topic or OTHER_QUESTION, m.title) for group in (*groups(), COST) for m in group.metrics}


def _question_and_title(metric: str) -> tuple[str, str]:
    """Return question and title of a metric.

    The id of a drift in the air may end with its heading reference.
    """
    known = metric_titles()
    return known.get(metric) or known.get(metric.rpartition(".")[0], (OTHER_QUESTION, metric))


def metric_units(*results: Result) -> dict[str, str]:
    """Return the unit of every metric of a result, without run times."""
    found = {name: str(d.get("unit", "")) for r in results for name, d in r.definitions.items()}
    return {name: unit for name, unit in found.items() if name not in MEASURED_TIMES}


def compare_results(
    name: str, old: Result, new: Result, tolerances: Tolerances, window: str | None = None
) -> RunDifference:
    """Compare two results; ``window`` limits the numbers to one window."""
    sha = [r.log.get("sha256") for r in (old, new)]
    found = RunDifference(name, same_log=sha[0] is not None and sha[0] == sha[1])
    found.statements = _changed_statements(old, new)
    sentences = ({QUESTIONS[v.question].capitalize(): v.sentence for v in r.verdicts} for r in (old, new))
    found.references = _changed_references(old, new)
    found.verdicts = [] if found.references else _changed_entries(*sentences)
    found.made_by = _changed_entries({"attlog": old.attlog.get("version")}, {"attlog": new.attlog.get("version")})
    about = ("name", "firmware", "vehicle", "format")
    if not found.same_log:
        found.log = _changed_entries(*(_flatten({k: r.log.get(k) for k in about}) for r in (old, new)))
    found.config = _changed_entries(_flatten(old.config), _flatten(new.config))
    found.parameters = _changed_parameters(old, new)
    rows = [{row.name: row for row in r.estimators} for r in (old, new)]
    found.rows_vanished = [n for n in rows[0] if n not in rows[1]]
    found.rows_appeared = [n for n in rows[1] if n not in rows[0]]
    better = {m: str(d.get("better", "low")) for r in (old, new) for m, d in r.definitions.items()}
    for row in (n for n in rows[0] if n in rows[1]):
        a, b = rows[0][row], rows[1][row]
        gains = ({f"{row}: {k}": p.value for k, p in r.parameters.items()} for r in (a, b))
        found.gains += _changed_entries(*gains)
        found.status += _changed_entries({row: a.status}, {row: b.status})
        for moved in _changed_numbers(a, b, tolerances, found.same_log, better, window):
            if moved is None:
                found.equal += 1
            else:
                found.moved.append(moved)
    if found.references:  # another reference measures another error
        found.moved = [replace(m, closer=None) for m in found.moved]
    found.moved.sort(key=lambda m: m.order)
    return found


def _changed_references(old: Result, new: Result) -> list[TextChange]:
    """Return the reference of two results where its kind or, in one log, its source differs."""
    kinds = [("nothing", "") if r.reference is None else (r.reference.choice, r.reference.source) for r in (old, new)]
    same_log = old.log.get("sha256") == new.log.get("sha256")
    texts = [f"{kind} ({source})" if source and same_log else kind for kind, source in kinds]
    return _changed_entries({"reference": texts[0]}, {"reference": texts[1]})


def _changed_statements(old: Result, new: Result) -> list[TextChange]:
    """Return headlines, and findings above notes, that differ."""
    sides = []
    for result in (old, new):
        headline = {"headline": result.headline} if old.headline and new.headline else {}
        findings = {f"finding: {f.kind}": f.text for f in reversed(result.findings) if f.is_trouble}
        sides.append((headline, findings))
    return [change for a, b in zip(*sides, strict=True) for change in _changed_entries(a, b)]


def _changed_parameters(old: Result, new: Result) -> list[TextChange] | None:
    """Return parameters that differ, shared ones first.

    A result whose log has defaults lists only values that differ from them. Any other parameter has the default of the
    other result, else its value.
    """
    params = [r.log.get("params") for r in (old, new)]
    if not all(isinstance(side, dict) for side in params):
        return None
    if len({str(dict(r.log.get("firmware") or {}).get("name")) for r in (old, new)}) > 1:
        return []
    sides = [dict(side or {}) for side in params]
    changed: list[dict[str, Any]] = [dict(r.log.get("params_changed") or {}) for r in (old, new)]
    for mine, beside, own, others in zip(sides, sides[::-1], changed, changed[::-1], strict=True):
        if own:
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
    """Yield the changed numbers of a row, None for each unchanged one."""
    for window in dict.fromkeys([*old.metrics, *new.metrics]):
        if only is not None and window != only:
            continue
        sides = old.metrics.get(window, {}), new.metrics.get(window, {})
        for metric in dict.fromkeys([*sides[0], *sides[1]]):
            a, b = sides[0].get(metric), sides[1].get(metric)
            if metric in MEASURED_TIMES or all(x is None or x.value is None for x in (a, b)):
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
    a, b = (None if x is None else x.value for x in (old, new))
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
    verdict: Verdict = "beyond" if abs(change) > limit * (1.0 + ROUNDING_SHARE) else "within"
    if verdict == "beyond" and not same_log:
        by_hand = tolerances.rule(metric) is not None
        significant = by_hand if span is None else not span[0] <= 0.0 <= span[1]
        verdict = "beyond" if significant else "not_significant"
    sizes = [-v if better == "high" else distance(Answer(v, "", ""), better)[1] for v in (a, b)]
    closer = None if sizes[0] == sizes[1] else sizes[1] < sizes[0]
    return NumberChange(row, window, metric, unit, a, b, *ends, change, span, limit, verdict, closer)


def difference_interval(a: float, a_ci95: Interval | None, b: float, b_ci95: Interval | None) -> Interval | None:
    """Return the 95 % interval of b - a, both independent (Zou2008), else None."""
    if a_ci95 is None or b_ci95 is None:
        return None
    down = math.hypot(b - b_ci95[0], a_ci95[1] - a)
    up = math.hypot(b_ci95[1] - b, a - a_ci95[0])
    return b - a - down, b - a + up


def _changed_entries(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[TextChange]:
    """Return entries that differ, sorted by name; absent ones included."""
    names = sorted(old.keys() | new.keys())
    pairs = [(n, old.get(n, ABSENT_VALUE), new.get(n, ABSENT_VALUE)) for n in names]
    return [TextChange(n, a, b) for n, a, b in pairs if a != b]


def _flatten(value: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Flatten nested objects to dotted names; None counts as absent."""
    found: dict[str, Any] = {}
    for name, entry in value.items():
        if isinstance(entry, Mapping):
            found |= _flatten(entry, f"{before}{name}.")
        elif entry is not None:
            found[before + name] = entry
    return found


@dataclass(slots=True)
class ResultPairs:
    """Pairs of results by shared name, None for a missing side.

    ``wrong``: unusable files.
    """

    pairs: dict[str, tuple[Result | None, Result | None]] = field(default_factory=dict)
    wrong: list[AttlogError] = field(default_factory=list)

    @property
    def alone(self) -> list[tuple[str, str]]:
        """Return logs without a partner, with their side (``old``, ``new``)."""
        return [(n, "new" if a is None else "old") for n, (a, b) in self.pairs.items() if a is None or b is None]


def pair_results(old: Path, new: Path) -> ResultPairs:
    """Pair two files, or the files of two folders.

    Files of folders are paired by name, else by their log. A broken file in a folder is left out. LogUnreadable,
    LogUnusable for a file or folder without a result, UsageError for a file against a folder.
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
    """Read a result. LogUnreadable if the file cannot be opened, else LogUnusable."""
    try:
        return Result.load(path)
    except UsageError as error:
        raise LogUnusable(str(error)) from None


def _folder_results(folder: Path, wrong: list[AttlogError]) -> dict[str, Result]:
    """Read the results in a folder by relative path; other JSON files are ignored."""
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
        return True  # the error is reported when the file is read
