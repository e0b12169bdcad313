"""Numbers across logs: a line for each log or for each group of logs, a column for each row of the comparison."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

from attlog.base.errors import UsageError
from attlog.fleet.pages.order import natural
from attlog.fleet.records.answers import numbers
from attlog.fleet.records.entry import Entry
from attlog.present.table.columns import AXIS_COLUMNS, DRIFT_REST, ERRORS, STEPS
from attlog.present.table.rows import AIR, PHASES, REST
from attlog.result import MEASURED_TIMES

ALL = ("all", "airborne", "rest")
WINDOWS = {c.metric: c.windows for c in (*ERRORS, *STEPS, DRIFT_REST, *AXIS_COLUMNS)}
AGAINST_REFERENCE = ("inclination_", "heading_", "total_", "lag_", "step_", "distortion_", "overshoot_", "settling_")
FAMILIES = (
    ("noise_", PHASES),
    ("drift_rest", REST),
    ("drift_air", AIR),
    ("leak_", AIR),
    *((start, AIR) for start in AGAINST_REFERENCE),
)
"""Where a metric is looked up, as on the page of one log: noise by phase, errors and steps in the air."""
ENOUGH = 0.5
"""A window counts where it has at least this share of the values of the best one."""
BY = ("firmware", "version", "vehicle", "board", "reference", "batch", "month", "year", "attlog")
"""What logs can be grouped by."""


@dataclass(frozen=True, slots=True)
class Column:
    """A row's answers to one question: ``metric`` in ``window``; ``unit`` as in the results."""

    metric: str
    window: str
    row: str
    unit: str


@dataclass(slots=True)
class Log:
    """One log: what flew, and the answers of all rows by (metric, window, row): a value, or the code of why not."""

    batch: str
    entry: str
    name: str
    flight: dict[str, Any]
    found: dict[tuple[str, str, str], float | str] = field(default_factory=dict)

    def value(self, column: Column) -> float | None:
        """The value, None where there is none."""
        found = self.found.get((column.metric, column.window, column.row))
        return found if isinstance(found, float) else None


@dataclass(slots=True)
class Across:
    """Logs and the columns asked for. ``twice``: logs of the same content, of which one counts."""

    logs: list[Log]
    columns: list[Column]
    twice: int = 0


@dataclass(slots=True)
class Spread:
    """The middle of many values: ``n`` of them, quartiles."""

    n: int
    low: float
    median: float
    high: float


def across(
    entries: Iterable[tuple[str, Entry]],
    metrics: Sequence[str],
    rows: Sequence[str] = (),
    window: str | None = None,
    by: str | None = None,
) -> Across:
    """The numbers of all logs for ``metrics`` (METRIC or METRIC@WINDOW) and rows (names or patterns; all).

    A metric without a window is looked up where the page of one log does, in one window for all logs: the first
    that has at least half as many values as the best. Of results of one log (same content) the one of the newest
    attlog counts, then the last given; with ``by`` "batch" each batch counts by itself. UsageError for a metric,
    row or window that no log has, with what comes near.
    """
    asked = [tuple(m.partition("@")[::2]) for m in metrics]
    names = {metric for metric, _ in asked}
    known: dict[str, str] = {}
    windows: set[str] = set()
    logs: list[Log] = []
    for batch, entry in entries:
        if entry.row is None:
            continue
        log = Log(batch, entry.log, entry.name, entry.row["flight"])
        known |= entry.row["answers"]["units"]
        for number in numbers(entry.row["answers"], names):
            place = (number.metric, number.window, number.row)
            log.found[place] = float(number.value) if number.value is not None else str(number.code)
            windows.add(number.window)
        logs.append(log)
    if not logs:
        return Across([], [])
    for metric in sorted(names - known.keys()):
        if metric in MEASURED_TIMES:
            raise UsageError(f"--metric {metric}: measured times differ from run to run and are kept in no table")
        raise UsageError(f"--metric {metric}: no log has it; {near(metric, known)}")
    held = list(dict.fromkeys(row for log in logs for _, _, row in log.found))
    common = Counter(
        row for log in logs for row in {row for (_, _, row), v in log.found.items() if isinstance(v, float)}
    )
    held.sort(key=lambda row: (_place(row), -common[row], row))
    chosen = matching(rows, held) if rows else held
    kept = _once(logs, by == "batch")
    columns = []
    for metric, own in asked:
        wanted = own or window
        if wanted and wanted not in windows:
            asked_by = f"--metric {metric}@{own}" if own else f"--window {window}"
            raise UsageError(f"{asked_by}: no log has this window; {near(wanted, windows)}")
        where = wanted or usual_window(metric, kept)
        columns += [
            Column(metric, where, row, known[metric])
            for row in chosen
            if any((metric, where, row) in log.found for log in kept)
        ]
    return Across(sorted(kept, key=lambda x: (natural(x.name), x.batch)), columns, len(logs) - len(kept))


def usual_window(metric: str, logs: Iterable[Log]) -> str:
    """The one window in which a metric is looked up for all logs."""
    count = Counter(w for log in logs for (m, w, _), v in log.found.items() if m == metric and isinstance(v, float))
    order = WINDOWS.get(metric) or next((windows for start, windows in FAMILIES if metric.startswith(start)), ALL)
    best = max((count[w] for w in order), default=0)
    if best:
        return next(w for w in order if count[w] >= ENOUGH * best)
    return max(count, key=lambda w: count[w], default=order[0])


def matching(patterns: Iterable[str], held: Sequence[str]) -> list[str]:
    """The rows that names or patterns mean, in their order. UsageError for one that means none."""
    found: dict[str, None] = {}
    for pattern in patterns:
        meant = [row for row in held if row == pattern] or [row for row in held if fnmatchcase(row, pattern)]
        if not meant:
            raise UsageError(f"--row {pattern}: no log has this row; {near(pattern, held)}")
        found |= dict.fromkeys(meant)
    return list(found)


def near(word: str, known: Iterable[str]) -> str:
    """What comes near a word that nobody knows, else all that there is."""
    listed = sorted(known)
    close = difflib.get_close_matches(word, listed, 3, 0.5) or [k for k in listed if word and word in k][:5]
    return f"did you mean {', '.join(close)}?" if close else f"they have {', '.join(listed)}"


def references(found: Across) -> dict[str, int]:
    """What the logs are compared with, and how many each, where a metric of the table is a difference from it."""
    if not any(c.metric.startswith(AGAINST_REFERENCE) for c in found.columns):
        return {}
    return dict(Counter(str(log.flight.get("reference") or "none") for log in found.logs).most_common())


def grouped(logs: Iterable[Log], by: str) -> dict[str, list[Log]]:
    """Logs by what flew: group -> logs, in natural order; ``unknown`` last. UsageError for what is no group."""
    if by not in BY:
        raise UsageError(f"--by {by}: use {', '.join(BY[:-1])} or {BY[-1]}")
    found: dict[str, list[Log]] = {}
    for log in logs:
        found.setdefault(_group(log, by) or "unknown", []).append(log)
    return {name: found[name] for name in sorted(found, key=lambda name: (name == "unknown", natural(name)))}


def spread(values: Iterable[float | None]) -> Spread | None:
    """Quartiles (linear between values) of those that are there; None without any."""
    held = sorted(v for v in values if v is not None)
    if not held:
        return None

    def quantile(p: float) -> float:
        at = p * (len(held) - 1)
        k = min(int(at), len(held) - 2) if len(held) > 1 else 0
        above = held[min(k + 1, len(held) - 1)]
        return held[k] + (at - k) * (above - held[k])

    return Spread(len(held), quantile(0.25), quantile(0.5), quantile(0.75))


def _group(log: Log, by: str) -> str:
    date = str(log.flight.get("date_utc") or "")
    if by in ("month", "year"):
        return date[: 7 if by == "month" else 4]
    return log.batch if by == "batch" else str(log.flight.get(by) or "")


def _once(logs: list[Log], each_batch: bool) -> list[Log]:
    """One result of each log: of the newest version, then the last given."""
    best: dict[tuple[str, str], Log] = {}
    for k, log in enumerate(logs):
        content = str(log.flight.get("sha256") or f"{k} unknown")
        key = (content, log.batch if each_batch else "")
        if key not in best or _version(log) >= _version(best[key]):
            best[key] = log
    return list(best.values())


def _version(log: Log) -> list[int]:
    return [int(part) for part in re.findall(r"\d+", str(log.flight.get("attlog") or ""))]


def _place(row: str) -> int:
    """What flew first, other attitudes of the log last."""
    return 0 if row == "onboard" else 2 if row.startswith("onboard:") else 1
