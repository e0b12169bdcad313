"""What changed between two runs: of one log by two versions, or of two flights with two firmwares.

Of the same log (same SHA-256) every difference comes from what was run, so that it counts where it exceeds its
tolerance. Of two logs it counts only where its interval excludes zero as well: with v1 in [l1, u1] and v2 in [l2, u2]
the difference lies between v2 - v1 - sqrt((v2 - l2)^2 + (u1 - v1)^2) and v2 - v1 + sqrt((u2 - v2)^2 + (v1 - l1)^2)
(Zou2008, independent estimates).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from attlog.compare.diff.changes import ABSENT, Interval, NumberChange, RunDifference, TextChange, Verdict
from attlog.compare.diff.order import sorted_changes
from attlog.compare.diff.tolerance import Tolerances
from attlog.result import MEASURED_TIMES, Answer, EstimatorRow, Result


def units_of(*results: Result) -> dict[str, str]:
    """The unit of every metric that any of the results defines, without what is measured anew in each run."""
    found = {name: str(d.get("unit", "")) for r in results for name, d in r.definitions.items()}
    return {name: unit for name, unit in found.items() if name not in MEASURED_TIMES}


def difference(name: str, old: Result, new: Result, tolerances: Tolerances, window: str | None = None) -> RunDifference:
    """What differs between two results; ``window`` limits the numbers to one."""
    sha = [r.log.get("sha256") for r in (old, new)]
    found = RunDifference(name, same_log=sha[0] is not None and sha[0] == sha[1])
    found.statements = _statements(old, new)
    found.verdicts = _changed(*({v.title: v.sentence for v in r.verdicts} for r in (old, new)))
    found.made_by = _changed({"attlog": old.attlog.get("version")}, {"attlog": new.attlog.get("version")})
    about = ("name", "firmware", "vehicle", "format")
    found.log = [] if found.same_log else _changed(*(_flat({k: r.log.get(k) for k in about}) for r in (old, new)))
    found.config = _changed(_flat(old.config), _flat(new.config))
    found.parameters = _parameters(old, new)
    rows = [{row.name: row for row in r.estimators} for r in (old, new)]
    found.rows_vanished = [n for n in rows[0] if n not in rows[1]]
    found.rows_appeared = [n for n in rows[1] if n not in rows[0]]
    better = {m: str(d.get("better", "low")) for r in (old, new) for m, d in r.definitions.items()}
    for row in (n for n in rows[0] if n in rows[1]):
        a, b = rows[0][row], rows[1][row]
        found.gains += _changed(*({f"{row}: {k}": p.value for k, p in r.parameters.items()} for r in (a, b)))
        found.status += _changed({row: a.status}, {row: b.status})
        for moved in _moved(a, b, tolerances, found.same_log, better, window):
            if moved is None:
                found.equal += 1
            else:
                found.moved.append(moved)
    found.moved = sorted_changes(found.moved)
    return found


def _statements(old: Result, new: Result) -> list[TextChange]:
    """What a report says otherwise: its headline (older results have none), its findings but notes."""
    sides = []
    for result in (old, new):
        headline = {"headline": result.headline} if old.headline and new.headline else {}
        findings = {f"finding: {f.kind}": f.text for f in reversed(result.findings) if f.is_trouble}
        sides.append((headline, findings))
    return [change for a, b in zip(*sides, strict=True) for change in _changed(a, b)]


def _parameters(old: Result, new: Result) -> list[TextChange] | None:
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
    return sorted(_changed(*sides), key=lambda c: ABSENT in (c.old, c.new))


def _moved(
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
            if _value(a) is None and _value(b) is None:
                continue
            if a is not None and b is not None and (a.value, a.ci95) == (b.value, b.ci95):
                yield None
            else:
                yield _compared(old.name, window, metric, a, b, tolerances, same_log, better.get(metric, "low"))


def _compared(
    row: str,
    window: str,
    metric: str,
    old: Answer | None,
    new: Answer | None,
    tolerances: Tolerances,
    same_log: bool,
    better: str,
) -> NumberChange:
    a, b = _value(old), _value(new)
    unit = next((x.unit for x in (new, old) if x is not None), "")
    ends = (None if old is None else old.ci95, None if new is None else new.ci95)
    if a is None or b is None:
        gone = new if b is None else old
        reason = "" if gone is None else gone.reason or ""
        kind: Verdict = "vanished" if b is None else "appeared"
        return NumberChange(row, window, metric, unit, a, b, *ends, None, None, None, kind, reason=reason)
    change = b - a
    limit = tolerances.of(metric, unit, a)
    span = None if same_log else interval(a, ends[0], b, ends[1])
    verdict: Verdict = "beyond" if abs(change) > limit * (1.0 + 1e-9) else "within"
    if verdict == "beyond" and not same_log:
        by_hand = tolerances.rule(metric) is not None
        significant = by_hand if span is None else not span[0] <= 0.0 <= span[1]
        verdict = "beyond" if significant else "not_significant"
    sizes = distance(a, better), distance(b, better)
    closer = None if sizes[0] == sizes[1] else sizes[1] < sizes[0]
    return NumberChange(row, window, metric, unit, a, b, *ends, change, span, limit, verdict, closer)


def interval(a: float, a_ci95: Interval | None, b: float, b_ci95: Interval | None) -> Interval | None:
    """The 95 % interval of b - a of independent values; None where one has none."""
    if a_ci95 is None or b_ci95 is None:
        return None
    down = math.hypot(b - b_ci95[0], a_ci95[1] - a)
    up = math.hypot(b_ci95[1] - b, a - a_ci95[0])
    return b - a - down, b - a + up


def distance(value: float, better: str) -> float:
    """How far a value is from perfect: the smaller the better, whatever ``better`` says."""
    if better == "high":
        return -value
    return value if better == "low" else abs(value - 1.0) if better == "one" else abs(value)


def _value(answer: Answer | None) -> float | None:
    return None if answer is None else answer.value


def _changed(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[TextChange]:
    """Entries that differ, those of one side only included, in the order of names."""
    names = sorted(old.keys() | new.keys())
    pairs = [(n, old.get(n, ABSENT), new.get(n, ABSENT)) for n in names]
    return [TextChange(n, a, b) for n, a, b in pairs if a != b]


def _flat(value: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Entries of nested objects under dotted names; None counts as absent."""
    found: dict[str, Any] = {}
    for name, entry in value.items():
        if isinstance(entry, Mapping):
            found |= _flat(entry, f"{before}{name}.")
        elif entry is not None:
            found[before + name] = entry
    return found
