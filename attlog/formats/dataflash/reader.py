"""Reads and writes ArduPilot's DataFlash binary logs (``.bin``).

Layout: ArduPilot, libraries/AP_Logger/LogStructure.h. Every type is described by
an FMT record, from 3.6 on also by FMTU (one unit and one multiplier id per
column, spelled out by UNIT and MULT). Deliberate differences from pymavlink's
reader: formats hold from their place in the file on, records that do not frame
are left out and counted, times are the logged ones.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.errors import LogUnusable
from attlog.formats.base import Boot, Messages, ParamChange, Table, Text
from attlog.formats.clock import restarts, times_before
from attlog.formats.dataflash.clock import drop_false_times, timeline
from attlog.formats.dataflash.index import HEADER_LENGTH, Index, index_records
from attlog.formats.dataflash.tables import build_tables, unreadable
from attlog.formats.dataflash.units import units_of
from attlog.formats.dataflash.writer import write
from attlog.formats.mapping import Offsets, gather, map_bytes, text_of
from attlog.limits import MAX_PARAM_CHANGES, MAX_TEXT_LENGTH, MAX_TEXTS

__all__ = ["read", "write"]

INFO = 6  # syslog severity; MSG records carry none


def read(path: str | Path) -> Messages:
    """The messages of a DataFlash binary log, columns decoded on demand.

    Instances come from the column that FMTU marks ``#``, else from
    :data:`attlog.formats.dataflash.tables.INSTANCE_COLUMNS`; the older ``IMU2`` or ``MAG2`` stay names of their own.
    ``Field.scale`` belongs to the letters c C e E L. ``Field.unit`` is the unit of
    the printed number: what is left of FMTU's multiplier after that scale becomes
    a prefix or a factor in the text (``mGauss``, ``us``, ``100 m``). LogUnusable
    if no format is defined, for example in a file that starts in the middle.
    """
    path = Path(path)
    data = map_bytes(path)
    index = index_records(data)
    if len(index.layouts) < 2 or not np.any(index.layout > 0):
        raise LogUnusable(
            f"{path}: no FMT record describes any data, so nothing can be decoded; a log must contain its beginning."
        )
    at, time = timeline(data, index)
    at, time = drop_false_times(index, at, time)
    units = units_of(data, index)
    tables = build_tables(data, index, units)
    messages = Messages(path, "dataflash", len(data), tables, damage=index.damage, damage_bytes=index.damage_bytes)
    messages.damage += unreadable(index)
    messages.params = _params(messages, at, time)
    messages.texts = _texts(messages, at, time)
    messages.boots = _boots(data, index, at, time)
    version = messages.first("VER")
    if version is not None:
        messages.info["VER"] = {name: _plain(version[name][0]) for name in version.fields}
    return messages


def _plain(value: Any) -> Any:
    """A numpy scalar as the Python value that JSON knows."""
    return text_of(value) if isinstance(value, bytes) else value.item()


def _boots(data: NDArray[np.uint8], index: Index, at: Offsets, time: NDArray[np.int64]) -> list[Boot]:
    """The power-ups in the file: a boot starts where the clock falls for good or a new block of formats begins."""
    starts = {0}
    for k in restarts(time):
        # the new boot's untimed records (formats, parameters) stand before its first time
        first = int(np.searchsorted(index.offsets, at[k - 1])) + 1
        starts.add(int(index.offsets[first]))
    defined = index.offsets[index.layout == 0]
    own = defined[gather(data, defined + HEADER_LENGTH, np.dtype("u1")) == index.layouts[0].type]
    starts.update(own[1:].tolist())
    edges = [*sorted(starts), len(data)]
    # two hints of the same restart (FMT block, then the first earlier time) leave no timed record between them
    joined = [0]
    for edge in edges[1:-1]:
        timed = np.searchsorted(at, [joined[-1], edge])
        if timed[1] > timed[0]:
            joined.append(edge)
    return [Boot(a, b) for a, b in pairwise([*joined, len(data)])]


def _times_of(table: Table, at: Offsets, time: NDArray[np.int64]) -> list[int | None]:
    """The time of each record, from its own stamp or else from the record before it."""
    if "TimeUS" in table and table.fields["TimeUS"].dtype.kind in "iu":
        return table["TimeUS"].tolist()
    return times_before(table.offsets, at, time)


def _params(messages: Messages, at: Offsets, time: NDArray[np.int64]) -> list[ParamChange]:
    """PARM records; the default, where it is logged, stands before the value as its own entry."""
    table = messages.first("PARM")
    if table is None or not {"Name", "Value"} <= table.fields.keys():
        return []
    table = table.rows(slice(MAX_PARAM_CHANGES))
    names = [text_of(name) for name in table["Name"].tolist()]
    values = table["Value"].tolist()
    defaults = table["Default"].tolist() if "Default" in table else [np.nan] * len(values)
    result = []
    rows = zip(names, values, defaults, _times_of(table, at, time), table.offsets.tolist(), strict=True)
    for name, value, default, t_us, offset in rows:
        if np.isfinite(default):
            result.append(ParamChange(name, default, t_us, True, offset))
        result.append(ParamChange(name, value, t_us, False, offset))
    return result


def _texts(messages: Messages, at: Offsets, time: NDArray[np.int64]) -> list[Text]:
    """MSG records: banner and events."""
    table = messages.first("MSG")
    if table is None or "Message" not in table:
        return []
    table = table.rows(slice(MAX_TEXTS))
    rows = zip(table["Message"].tolist(), _times_of(table, at, time), table.offsets.tolist(), strict=True)
    return [Text(text_of(raw)[:MAX_TEXT_LENGTH], INFO, t_us, offset) for raw, t_us, offset in rows]
