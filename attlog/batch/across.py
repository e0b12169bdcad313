"""Numbers across logs: a line for each log or group of logs, a column for each row of the comparison.

For the terminal, a paper, a spreadsheet.
"""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

from attlog.batch.index_row import Entry, numbers
from attlog.batch.order import natural
from attlog.core.errors import UsageError
from attlog.result import MEASURED_TIMES
from attlog.words.names import CODES
from attlog.words.numbers import number, unit_sign
from attlog.words.ranking import AIR, PHASES, REST
from attlog.words.table import AXIS_COLUMNS, DRIFT_REST, ERRORS, STEPS

ALL = ("all", "airborne", "rest")
WINDOWS = {c.metric: c.windows for c in (*ERRORS, *STEPS, DRIFT_REST, *AXIS_COLUMNS)}
AGAINST_REFERENCE = ("tilt_", "heading_", "total_", "lag_", "step_", "distortion_", "overshoot_", "settling_")
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
        for answer in numbers(entry.row["answers"], names):
            place = (answer.metric, answer.window, answer.row)
            log.found[place] = float(answer.value) if answer.value is not None else str(answer.code)
            windows.add(answer.window)
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


ABOUT = ("log", "date", "vehicle", "firmware")
LOGS = "logs"
NO_VALUE = "–"


@dataclass(slots=True)
class TableText:
    """A table as people read it: ``body`` a line for each log or group, ``foot`` what is in their middle."""

    head: list[str]
    body: list[list[str]] = field(default_factory=list)
    foot: list[list[str]] = field(default_factory=list)


def titles(columns: Sequence[Column]) -> list[str]:
    """What columns are called: by their row, and by their metric where there are several."""
    several = len({c.metric for c in columns}) > 1
    windows = {(c.metric, c.window) for c in columns}
    twice = len(windows) > len({metric for metric, _ in windows})
    return [f"{c.metric}{f'@{c.window}' if twice else ''} {c.row}" if several or twice else c.row for c in columns]


def words(found: Across, by: str | None, columns: Sequence[Column], *, units: bool = False) -> TableText:
    """The table of some of the columns; with ``by`` a line for each group. ``units``: they stand in the headings."""
    heads = [
        f"{title} [{unit_sign(c.unit)}]" if units and unit_sign(c.unit) else title
        for title, c in zip(titles(columns), columns, strict=True)
    ]
    if by is not None:
        table = TableText([by, LOGS, *heads])
        for name, logs in grouped(found.logs, by).items():
            table.body.append([name, str(len(logs)), *(_middle(_spread(logs, c), c) for c in columns)])
        if len(table.body) > 1:
            table.foot.append(["all", str(len(found.logs)), *(_middle(_spread(found.logs, c), c) for c in columns)])
        return table
    table = TableText([*ABOUT[:2], *heads])
    table.body = [[*about(log, found.logs)[:2], *(_cell(log, c) for c in columns)] for log in found.logs]
    spreads = [_spread(found.logs, c) for c in columns]
    for label, value in (("median", "median"), ("25 %", "low"), ("75 %", "high")):
        cells = [
            NO_VALUE if s is None else number(getattr(s, value), c.unit) for s, c in zip(spreads, columns, strict=True)
        ]
        table.foot.append([label, "", *cells])
    table.foot.append([LOGS, "", *("0" if s is None else str(s.n) for s in spreads)])
    return table


def about(log: Log, logs: Iterable[Log]) -> list[str]:
    """Which log a line is of, in the order of ABOUT; with its batch where several are shown."""
    several = len({x.batch for x in logs}) > 1
    name = f"{log.batch}/{log.name}" if several and log.batch else log.name
    flight = log.flight
    return [
        name,
        str(flight.get("date_utc") or "")[:10],
        str(flight.get("vehicle") or ""),
        str(flight.get("firmware") or ""),
    ]


def values(found: Across, by: str | None) -> tuple[list[str], list[list[Any]]]:
    """The same as numbers for other programs: headings and lines, None where there is no value."""
    heads = titles(found.columns)
    if by is not None:
        head = [by, LOGS, *(f"{title} {what}" for title in heads for what in ("n", "q25", "median", "q75"))]
        return head, [
            [name, len(logs), *(x for c in found.columns for x in _numbers(_spread(logs, c)))]
            for name, logs in grouped(found.logs, by).items()
        ]
    head = [*ABOUT, "sha256", *heads]
    return head, [
        [*(text or None for text in about(log, found.logs)), log.flight.get("sha256"), *map(log.value, found.columns)]
        for log in found.logs
    ]


def _numbers(s: Spread | None) -> tuple[float | None, ...]:
    return (0, None, None, None) if s is None else (s.n, s.low, s.median, s.high)


def _spread(logs: Iterable[Log], column: Column) -> Spread | None:
    return spread(log.value(column) for log in logs)


def _middle(s: Spread | None, column: Column) -> str:
    if s is None:
        return NO_VALUE
    middle = number(s.median, column.unit)
    return middle if s.n == 1 else f"{middle} ({number(s.low, column.unit)} to {number(s.high, column.unit)})"


def _cell(log: Log, column: Column) -> str:
    found = log.found.get((column.metric, column.window, column.row))
    if isinstance(found, float):
        return number(found, column.unit)
    return NO_VALUE if found is None else CODES.get(found, ("", found))[1]
