"""Reads PX4's sdlog2 logs of 2013 to 2016 (``.px4log``, sometimes ``.bin``).

Framing and formats are those of DataFlash. A TIME record with ``StartTime`` (us
since boot) opens a group; all records up to the next TIME have that time, which
every table shows as the column :data:`TIME`. Source: PX4 Firmware v1.4,
src/modules/sdlog2/sdlog2_messages.h.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import LogUnusable
from attlog.formats.clock import boots_of_timeline, false_times
from attlog.formats.dataflash.tables import build_tables, has_integer, has_text, read_params, report_unreadable
from attlog.formats.dataflash.walk import formats_in_head, index_records
from attlog.formats.file_bytes import decode_text, read_file_bytes
from attlog.formats.table import DamageLog, Field, Messages, ReaderBarrier, Remark, Table

TIME = "_t_us"
"""Column with the boot time (us) of the group that a record belongs to, -1 before the first TIME record."""

_TIME = re.compile(rb"TIME *Q")  # name and letters of its FMT record, which hardly any other file has


def is_sdlog2(head: bytes) -> bool:
    """Whether these first bytes of a file have DataFlash framing and define a TIME that only holds the start time."""
    return (
        b"TIME" in head
        and _TIME.search(head) is not None
        and any(fmt.name == "TIME" and fmt.letters == "Q" for fmt in formats_in_head(head))
    )


def read(path: str | Path, *, data: NDArray[np.uint8] | None = None) -> Messages:
    """The messages of an sdlog2 log, columns decoded on demand; all instances are 0 (IMU1 is a name of its own).

    LogUnusable if the file has no TIME record, since nothing else tells time.
    """
    path = Path(path)
    data = read_file_bytes(path) if data is None else data
    index = index_records(data)
    remarks: list[Remark] = []
    around = ReaderBarrier(remarks).around
    tables = build_tables(data, index, by_instance=False, guard=around)
    clock = tables.get(("TIME", 0))
    if clock is None or not has_integer(clock, "StartTime"):
        blank = not any(fmt.columns for fmt in index.layouts[1:])
        why = (
            "its formats name no columns" if blank else "it has no TIME record with StartTime, so no record has a time"
        )
        raise LogUnusable(f"{path}: this sdlog2 log cannot be decoded: {why}.")
    report_unreadable(index)
    at, time = clock.offsets, _possible(clock, index.losses)
    messages = Messages(
        path,
        "px4log",
        len(data),
        {key: _timed(table, at, time) for key, table in tables.items()},
        remarks=remarks,
        damage=index.losses.listed,
        damage_bytes=index.losses.bytes,
        damage_places=index.losses.places,
    )
    known = time >= 0
    timeline = at[known], time[known]
    with around("PARM", "parameters", None):
        messages.params = read_params(messages, timeline)
    version = messages.first("VER")
    if version is not None:
        messages.info["VER"] = {
            name: decode_text(version[name][0]) for name in version.fields if name != TIME and has_text(version, name)
        }
    messages.boots = boots_of_timeline(timeline, len(data))
    return messages


def _possible(clock: Table, losses: DamageLog) -> NDArray[np.int64]:
    """Start times (n,) of the groups in us; -1, and counted as lost, where the clock of the group is false."""
    time = clock["StartTime"].astype(np.int64)
    false = false_times(time)
    for offset in clock.offsets[false].tolist():
        losses.add(offset, 0, "the time of a group of records, far from those before and behind it", "next TIME record")
    time[false] = -1
    return time


def _timed(table: Table, at: NDArray[np.int64], time: NDArray[np.int64]) -> Table:
    """The same table with the group's time as first column."""
    others = {name: field for name, field in table.fields.items() if name != TIME}
    fields = {TIME: Field(TIME, np.dtype(np.int64), "us"), **others}
    return Table(table.name, table.instance, fields, table.offsets, _with_time(table, at, time))


def _with_time(
    table: Table, at: NDArray[np.int64], time: NDArray[np.int64]
) -> Callable[[str, NDArray[np.int64]], NDArray[Any]]:
    every = np.concatenate([[-1], time])

    def decode(column: str, offsets: NDArray[np.int64]) -> NDArray[Any]:
        if column == TIME:
            return every[np.searchsorted(at, offsets, side="right")]
        if len(offsets) == len(table):
            return table[column]
        return table.rows(np.searchsorted(table.offsets, offsets))[column]

    return decode
