"""Parameters and texts from the tables of a log, alike in binary DataFlash, its text form and sdlog2."""

from __future__ import annotations

from itertools import repeat
from math import isfinite

from attlog.base.limits import LAST_TIME_US, MAX_PARAM_CHANGES, MAX_TEXT_LENGTH, MAX_TEXTS
from attlog.formats.base import Messages, ParamChange, Table, Text
from attlog.formats.clock import Timeline, times_before
from attlog.formats.mapping import text_of, texts_of

INFO = 6
"""Syslog severity of all texts; MSG records carry none."""


def params(messages: Messages, timeline: Timeline) -> list[ParamChange]:
    """PARM records; the default, where it is logged, stands before the value as its own entry."""
    table = messages.first("PARM")
    if table is None or not is_text(table, "Name") or not is_number(table, "Value"):
        return []
    table = table.rows(slice(MAX_PARAM_CHANGES))
    names = texts_of(table["Name"])
    values = table["Value"].tolist()
    times, offsets = _times_of(table, timeline), table.offsets.tolist()
    changes = map(ParamChange._make, zip(names, values, times, repeat(False), offsets, strict=False))
    if not is_number(table, "Default"):
        return list(changes)
    told: list[float] = table["Default"].tolist()
    defaults = map(ParamChange._make, zip(names, told, times, repeat(True), offsets, strict=False))
    pairs = zip(defaults, changes, strict=True)
    return [c for default, change in pairs for c in ((default, change) if isfinite(default.value) else (change,))]


def texts(messages: Messages, timeline: Timeline) -> list[Text]:
    """MSG records: banner and events."""
    table = messages.first("MSG")
    if table is None or not is_text(table, "Message"):
        return []
    table = table.rows(slice(MAX_TEXTS))
    rows = zip(table["Message"].tolist(), _times_of(table, timeline), table.offsets.tolist(), strict=True)
    return [Text(text_of(raw)[:MAX_TEXT_LENGTH], INFO, t_us, offset) for raw, t_us, offset in rows]


def is_text(table: Table, column: str) -> bool:
    """Whether the table has this column of texts; a damaged or foreign format may call anything by its name."""
    return column in table.fields and table.fields[column].dtype.kind == "S"


def is_number(table: Table, column: str) -> bool:
    """Whether the table has this column of numbers."""
    return column in table.fields and table.fields[column].dtype.kind in "iuf"


def is_integer(table: Table, column: str) -> bool:
    """Whether the table has this column of whole numbers, such as ids and types."""
    return column in table.fields and table.fields[column].dtype.kind in "iu"


def _times_of(table: Table, timeline: Timeline) -> list[int | None]:
    """The time of each record, from its own stamp or else from the record before it."""
    if "TimeUS" in table.fields and table.fields["TimeUS"].dtype.kind in "iu":
        return [t if 0 <= t <= LAST_TIME_US else None for t in table["TimeUS"].tolist()]
    return times_before(table.offsets, timeline)
