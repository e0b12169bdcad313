"""A table across logs in words and in numbers: for the terminal, a paper, a spreadsheet."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from attlog.fleet.pages.across_logs import Across, Column, Log, Spread, grouped, spread
from attlog.present.names import CODES
from attlog.present.numbers import number, unit_sign

ABOUT = ("log", "date", "vehicle", "firmware")
LOGS = "logs"
NO_VALUE = "–"


@dataclass(slots=True)
class Words:
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


def words(found: Across, by: str | None, columns: Sequence[Column], *, units: bool = False) -> Words:
    """The table of some of the columns; with ``by`` a line for each group. ``units``: they stand in the headings."""
    heads = [
        f"{title} [{unit_sign(c.unit)}]" if units and unit_sign(c.unit) else title
        for title, c in zip(titles(columns), columns, strict=True)
    ]
    if by is not None:
        table = Words([by, LOGS, *heads])
        for name, logs in grouped(found.logs, by).items():
            table.body.append([name, str(len(logs)), *(_middle(_spread(logs, c), c) for c in columns)])
        if len(table.body) > 1:
            table.foot.append(["all", str(len(found.logs)), *(_middle(_spread(found.logs, c), c) for c in columns)])
        return table
    table = Words([*ABOUT[:2], *heads])
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
