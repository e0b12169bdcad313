"""Any numeric field of any message by name, on the log's clock: ``BAT[0].Volt``, ``vehicle_attitude.q[0]``."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import UsageError
from attlog.core.timestamps import Stamps, plausible_records
from attlog.flight import limits
from attlog.flight.model import Array, FlightLog
from attlog.flight.timestamps import isolated_timestamps, record_clock
from attlog.formats.table import Field, Messages, Table

# Columns that are the clock of their records.
CLOCK_COLUMNS = frozenset({"TimeUS", "TimeMS", "timestamp", "timestamp_sample", "_t_us", "time_boot_ms", "time_usec"})
# Messages that define the format or carry parameters and files.
NO_SIGNALS = frozenset({"FMT", "FMTU", "UNIT", "MULT", "PARM", "FILE", "PARAM_VALUE", "FILE_TRANSFER_PROTOCOL"})
# Longest array of bytes, and of other numbers, whose elements are signals: PX4 lists 40 satellites and 72 directions of
# obstacles; longer ones are payloads.
MAX_BYTE_ELEMENTS, MAX_ELEMENTS = 40, 72
# ``BAT[1].Volt``: message, instance, field.
NAME = re.compile(r"(?P<message>[^.]*?)(?:\[(?P<instance>\d{1,9})\])?\.(?P<field>.+)")
# ``[id=1]`` and ``[257,id=1]``: one of the sensors that a message of telemetry serves.
PART = re.compile(r"\[(?P<instance>\d{1,9})?,?(?P<part>[A-Za-z_]\w*=[\w-]{1,16})\]")
# Most sensors that a message is split by.
MAX_PARTS = 24
# Units as written by the formats and their usual form.
UNIT_WORDS = {
    "degheading": "deg",
    "deglatitude": "deg",
    "deglongitude": "deg",
    "m/s/s": "m/s^2",
    "cm/s/s": "cm/s^2",
    "mgauss": "mGauss",
    "satellites": "",
}
# Units of PX4's fields by the end of their name (its coding style), the longer ending first.
UNIT_ENDINGS = {
    "gyro_rad": "rad/s",
    "_per_ms": "",
    "_rad_s": "rad/s",
    "_m_s_s": "m/s^2",
    "_m_s2": "m/s^2",
    "_m_s": "m/s",
    "_mah": "mAh",
    "_rad": "rad",
    "_deg": "deg",
    "_hz": "Hz",
    "_pa": "Pa",
    "_us": "us",
    "_ms": "ms",
    "_rpm": "rpm",
    "_m": "m",
    "_v": "V",
    "_a": "A",
    "_s": "s",
}
UNIT_ENDING = re.compile(f"(?:{'|'.join(UNIT_ENDINGS)})$")


class Signal(NamedTuple):
    """Numeric field of a message; ``n``: its records, ``unit``: of the printed number, empty if the log has none.

    ``name`` is ``MESSAGE.field``, with ``[instance]`` behind the message where the log has several instances of it, in
    telemetry behind messages of others than the vehicle. A message of telemetry that serves several sensors has a
    signal for each, ``part`` (``id=1``): ``BATTERY_STATUS[id=1].current_consumed``.
    """

    name: str
    message: str
    instance: int
    field: str
    unit: str
    n: int
    part: str = ""


class Signals:
    """Numeric fields of a log, by name."""

    def __init__(self, log: FlightLog) -> None:
        if log.messages is None:
            raise UsageError(f"{log.path}: the messages of this log are no longer held; read it again")
        self.log, self.messages = log, log.messages
        self._clocks: dict[tuple[str, int], tuple[Array, NDArray[np.int64]]] = {}
        self._parts: dict[tuple[str, int], dict[str, NDArray[np.bool_]]] = {}

    @cached_property
    def own(self) -> int | None:
        """The table instance of the vehicle in telemetry, None in a log of one vehicle."""
        return vehicle_instance(self.messages)

    @cached_property
    def all(self) -> list[Signal]:
        """All signals in the order of the log."""
        return [signal for table in self.messages.values() for signal in self._of_table(table)]

    def instances(self, message: str) -> list[int]:
        """Return the instances of a message, of the vehicle alone in telemetry, ascending."""
        found = self.messages.instances(message)
        return [self.own] if self.own in found and self.own is not None else [] if self.own is not None else found

    def places(self, message: str) -> list[str]:
        """Return what follows a message's name in the names of its signals: ``[0]``, in telemetry ``[257,id=1]``."""
        tables = [self.messages[message, instance] for instance in self.instances(message)]
        return [
            f"[{t.instance},{part}]" if part else f"[{t.instance}]" for t in tables for part in self.parts(t) or [""]
        ]

    def parts(self, table: Table) -> dict[str, NDArray[np.bool_]]:
        """Return the records of each sensor of a message that serves several, empty for others."""
        key = table.name, table.instance
        if key not in self._parts:
            self._parts[key] = parts_of(table) if self.log.format in ("tlog", "mavlink") else {}
        return self._parts[key]

    def has(self, name: str) -> bool:
        """Return whether the log has a signal."""
        return self._found(name) is not None

    def unit(self, name: str) -> str:
        """Return the unit of a signal, empty if the log has none. UsageError for an unknown name."""
        table, column, _ = self._place(name)
        return self._unit(table.fields.get(column) or table.fields[column.rpartition("[")[0]])

    def read(self, signal: str | Signal) -> tuple[Array, Array]:
        """Return rising times (n,) s on the log's clock and values (n,) in the unit that the format prints.

        ``signal``: one of the log, or its name: ``MESSAGE.field``, ``MESSAGE[instance].field``; without an instance the
        vehicle's own, else the lowest, without a sensor the first. Records without a plausible time are left out.
        UsageError for an unknown name, with similar ones.
        """
        if isinstance(signal, Signal):
            table, column, part = self.messages[signal.message, signal.instance], signal.field, signal.part
        else:
            table, column, part = self._place(signal)
        t, kept = self._clock(table)
        own = self.parts(table)[part][kept] if part else slice(None)
        return t[own], table.value(column)[kept[own]]

    def release(self) -> None:
        """Release all decoded columns and times."""
        self.messages.forget()
        self._clocks.clear()
        self._parts.clear()

    def _of_table(self, table: Table) -> Iterator[Signal]:
        if table.name in NO_SIGNALS or len(table) == 0:
            return
        several = len(self.messages.instances(table.name)) > 1
        numbered = several if self.own is None else table.instance != self.own
        sender = str(table.instance) if numbered else ""
        for part, rows in (self.parts(table) or {"": np.ones(len(table), bool)}).items():
            inside = ",".join(filter(None, [sender, part]))
            message, n = f"{table.name}[{inside}]" if inside else table.name, int(np.count_nonzero(rows))
            for column, spec in table.fields.items():
                for name in _numbers(column, spec) if not part.startswith(f"{column}=") else ():
                    yield Signal(f"{message}.{name}", table.name, table.instance, name, self._unit(spec), n, part)

    def _unit(self, spec: Field) -> str:
        unit = spec.unit or ""
        if not unit and self.log.format == "ulog":
            ending = UNIT_ENDING.search(spec.name)
            return UNIT_ENDINGS[ending[0]] if ending else ""
        return UNIT_WORDS.get(unit, unit)

    def _found(self, name: str) -> tuple[Table, str, str] | None:
        """Return table, column and part of a signal, None for an unknown name."""
        whole, part = without_part(name)
        match = NAME.fullmatch(whole)
        if match is None:
            return None
        own = self.instances(match["message"]) if match["instance"] is None else [int(match["instance"])]
        table = self.messages.tables.get((match["message"], own[0])) if own else None
        if table is None or not _is_signal(table, match["field"]):
            return None
        parts = self.parts(table)
        part = part or next(iter(parts), "")
        return (table, match["field"], part) if part in parts or not part else None

    def _place(self, name: str) -> tuple[Table, str, str]:
        """Return table, column and part of a signal. UsageError for an unknown name, with similar ones."""
        found = self._found(name)
        if found is None:
            known, end = [signal.name for signal in self.all], name.rpartition(".")[2]
            near = difflib.get_close_matches(name, known, 3) or [n for n in known if n.endswith(f".{end}")][:3]
            hint = f"; did you mean {', '.join(near)}?" if near else ""
            raise UsageError(f"{self.log.path}: no signal {name}{hint}")
        return found

    @cached_property
    def _record_clock(self) -> Callable[[Table], Stamps | None]:
        return record_clock(self.messages)

    def _clock(self, table: Table) -> tuple[Array, NDArray[np.int64]]:
        """Return times (m,) s and indices (m,) of the records with plausible times."""
        key = table.name, table.instance
        if key not in self._clocks:
            stamps = self._record_clock(table)
            if stamps is None:
                self._clocks[key] = np.zeros(0), np.zeros(0, np.int64)
            else:
                kept = plausible_records(stamps, partial(isolated_timestamps, self.messages)).index
                t = 1e-6 * (stamps[kept] - self.log.t0_us)
                near = np.abs(t) <= limits.MAX_LOG_S
                self._clocks[key] = t[near], kept[near]
        return self._clocks[key]


def vehicle_instance(messages: Messages) -> int | None:
    """Return the table instance of the vehicle in telemetry, None in a log of one vehicle."""
    if messages.format not in ("tlog", "mavlink"):
        return None
    from attlog.flight.mavlink import choose_system_id

    return choose_system_id(messages, messages.path, None)


def without_part(name: str) -> tuple[str, str]:
    """Split a name into that of all its records and its sensor: ``BATTERY_STATUS.id``, ``id=1``; empty without one."""
    match = PART.search(name)
    if match is None:
        return name, ""
    instance = f"[{match['instance']}]" if match["instance"] else ""
    return f"{name[: match.start()]}{instance}{name[match.end() :]}", match["part"]


def parts_of(table: Table) -> dict[str, NDArray[np.bool_]]:
    """Return the records (n,) of each sensor of a telemetry message by ``id=0``, ``id=1``, empty if it serves one."""
    from attlog.formats.mavlink.layout import instance_fields

    column = instance_fields().get(table.name, "")
    if column not in table.fields:
        return {}
    keys, which = np.unique(table[column], return_inverse=True)
    words = [key.decode("ascii", "replace") if isinstance(key, bytes) else str(key) for key in keys.tolist()]
    if not 1 < len(keys) <= MAX_PARTS:
        return {}
    return {f"{column}={word}": which == k for k, word in enumerate(words) if PART.fullmatch(f"[{column}={word}]")}


def numeric_fields(table: Table) -> list[str]:
    """Return the names of a message's signals, of an array the first and the last: ``q[0] to q[3]``."""
    if table.name in NO_SIGNALS:
        return []
    named = [_numbers(column, spec) for column, spec in table.fields.items()]
    return [parts[0] if len(parts) == 1 else f"{parts[0]} to {parts[-1]}" for parts in named if parts]


def _is_signal(table: Table, column: str) -> bool:
    """Return whether a column, or the element of an array, holds one number per record."""
    spec = table.fields.get(column)
    if spec is not None:
        return column in _numbers(column, spec)
    return column in table and table.fields[column.rpartition("[")[0]].dtype.base.kind in "iuf"


def _numbers(column: str, spec: Field) -> list[str]:
    """Return the names of the numbers in a column: itself, its elements, none for clocks, texts and payloads."""
    base, shape = spec.dtype.base, spec.dtype.shape
    if base.kind not in "iuf" or column in CLOCK_COLUMNS or len(shape) > 1:
        return []
    if not shape or shape == (1,):
        return [column]
    longest = MAX_BYTE_ELEMENTS if base.itemsize == 1 else MAX_ELEMENTS
    return [f"{column}[{k}]" for k in range(shape[0])] if shape[0] <= longest else []
