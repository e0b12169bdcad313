"""Reads ArduPilot's DataFlash binary logs (``.bin``).

Layout: ArduPilot, libraries/AP_Logger/LogStructure.h. Every type is described by
an FMT record, from 3.6 on also by FMTU (one unit and one multiplier id per
column, spelled out by UNIT and MULT). Deliberate differences from pymavlink's
reader: formats hold from their place in the file on, records that do not frame
are left out and counted, times are the logged ones.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import LogUnusable
from attlog.formats.barrier import Barrier
from attlog.formats.base import Boot, Messages, Offsets, Remark
from attlog.formats.clock import Timeline, boots_between, restarts
from attlog.formats.dataflash.clock import drop_false_times, time_column, timeline
from attlog.formats.dataflash.content import params, texts
from attlog.formats.dataflash.index import HEADER_LENGTH, MessageFormat, RecordIndex, index_records
from attlog.formats.dataflash.tables import Units, build_tables, tell_unreadable
from attlog.formats.dataflash.units import units_of
from attlog.formats.mapping import gather, map_bytes, text_of

__all__ = ["read"]

T = TypeVar("T")


def read(path: str | Path, *, data: NDArray[np.uint8] | None = None) -> Messages:
    """The messages of a DataFlash binary log, columns decoded on demand; ``data`` are its bytes if mapped already.

    Instances come from the column that FMTU marks ``#``, else from
    :data:`attlog.formats.dataflash.tables.INSTANCE_COLUMNS`; the older ``IMU2`` or ``MAG2`` stay names of their own.
    ``Field.scale`` belongs to the letters c C e E L. ``Field.unit`` is the unit of
    the printed number: what is left of FMTU's multiplier after that scale becomes
    a prefix or a factor in the text (``mGauss``, ``us``, ``100 m``). LogUnusable
    if no format is defined, for example in a file that starts in the middle.
    """
    path = Path(path)
    data = map_bytes(path) if data is None else data
    index = index_records(data)
    if len(index.layouts) < 2 or not np.any(index.layout > 0):
        raise LogUnusable(
            f"{path}: no FMT record describes any data, so nothing can be decoded; a log must contain its beginning."
        )
    at, time = timeline(data, index)
    at, time = drop_false_times(index, at, time)
    boots = _boots(data, index, at, time)
    clock = (at[:0].copy(), time[:0].copy()) if _tell_their_time(index.layouts) else (at, time)
    del at, time  # the sorting that follows takes as much
    remarks: list[Remark] = []
    around = Barrier(remarks).around
    units: Units = {}
    with around("FMTU", "units and instances", None):
        units = units_of(data, index)
    tables = build_tables(data, index, units, guard=around)
    tell_unreadable(index)
    messages = Messages(
        path,
        "dataflash",
        len(data),
        tables,
        remarks=remarks,
        boots=boots,
        damage=index.losses.listed,
        damage_bytes=index.losses.bytes,
        damage_places=index.losses.places,
    )

    def told(message: str, what: str, of: Callable[[Messages, Timeline], list[T]], log: Messages) -> list[T]:
        with around(message, what, None):
            return of(log, clock)
        return []

    messages.params = partial(told, "PARM", "parameters", params)
    messages.texts = partial(told, "MSG", "texts", texts)
    version = messages.first("VER")
    if version is not None:
        with around("VER", "versions", int(version.offsets[0])):
            messages.info["VER"] = {name: _plain(version[name][0]) for name in version.fields}
    return messages


def _plain(value: Any) -> Any:
    """A value of numpy as the Python value that JSON knows."""
    return text_of(value) if isinstance(value, bytes) else value.tolist()


def _tell_their_time(layouts: list[MessageFormat]) -> bool:
    """Whether parameters and texts carry their time, so that no other record's is needed for them."""
    return all(
        time_column(fmt) == ("TimeUS", 1) and "q" not in fmt.letters
        for fmt in layouts
        if fmt.name in ("PARM", "MSG") and fmt.readable
    )


def _boots(data: NDArray[np.uint8], index: RecordIndex, at: Offsets, time: NDArray[np.int64]) -> list[Boot]:
    """The power-ups in the file: a boot starts where the clock falls for good or a new block of formats begins."""
    starts = {0}
    for k in restarts(time):
        # the new boot's untimed records (formats, parameters) stand before its first time
        first = int(np.searchsorted(index.offsets, at[k - 1])) + 1
        starts.add(int(index.offsets[first]))
    defined = index.offsets[index.layout == 0]
    own = defined[gather(data, defined + HEADER_LENGTH, np.dtype("u1")) == index.layouts[0].type]
    starts.update(own[1:].tolist())
    # two hints of the same restart (FMT block, then the first earlier time) leave no timed record between them
    joined = [0]
    for edge in sorted(starts)[1:]:
        timed = np.searchsorted(at, [joined[-1], edge])
        if timed[1] > timed[0]:
            joined.append(edge)
    return boots_between(joined[1:], len(data))
