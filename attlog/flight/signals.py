"""Any numeric field of any message by name, on the log's clock: ``BAT[0].Volt``, ``vehicle_attitude.q[0]``."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

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


@dataclass(frozen=True, slots=True)
class Signal:
    """Numeric field of a message; ``n``: its records, ``unit``: of the printed number, empty if the log has none.

    ``name`` is ``MESSAGE.field``, with ``[instance]`` behind the message where the log has several instances of it, in
    telemetry behind messages of others than the vehicle.
    """

    name: str
    message: str
    instance: int
    field: str
    unit: str
    n: int


class Signals:
    """Numeric fields of a log, by name."""

    def __init__(self, log: FlightLog) -> None:
        if log.messages is None:
            raise UsageError(f"{log.path}: the messages of this log are no longer held; read it again")
        self.log, self.messages = log, log.messages
        self._clocks: dict[tuple[str, int], tuple[Array, NDArray[np.int64]]] = {}

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

    def has(self, name: str) -> bool:
        """Return whether the log has a signal."""
        return self._found(name) is not None

    def unit(self, name: str) -> str:
        """Return the unit of a signal, empty if the log has none. UsageError for an unknown name."""
        table, column = self._place(name)
        return self._unit(table.fields.get(column) or table.fields[column.rpartition("[")[0]])

    def read(self, name: str) -> tuple[Array, Array]:
        """Return rising times (n,) s on the log's clock and values (n,) in the unit that the format prints.

        ``MESSAGE.field``, ``MESSAGE[instance].field``; without an instance the vehicle's own, else the lowest. Records
        without a plausible time are left out. UsageError for an unknown name, with similar ones.
        """
        table, column = self._place(name)
        t, kept = self._clock(table)
        return t, table.value(column)[kept]

    def release(self) -> None:
        """Release all decoded columns and times."""
        self.messages.forget()
        self._clocks.clear()

    def _of_table(self, table: Table) -> Iterator[Signal]:
        if table.name in NO_SIGNALS or len(table) == 0:
            return
        several = len(self.messages.instances(table.name)) > 1
        numbered = several if self.own is None else table.instance != self.own
        message = f"{table.name}[{table.instance}]" if numbered else table.name
        for column, spec in table.fields.items():
            for part in _numbers(column, spec):
                yield Signal(f"{message}.{part}", table.name, table.instance, part, self._unit(spec), len(table))

    def _unit(self, spec: Field) -> str:
        unit = spec.unit or ""
        if not unit and self.log.format == "ulog":
            return next((u for end, u in UNIT_ENDINGS.items() if spec.name.endswith(end)), "")
        return UNIT_WORDS.get(unit, unit)

    def _found(self, name: str) -> tuple[Table, str] | None:
        """Return table and column of a signal, None for an unknown name."""
        match = NAME.fullmatch(name)
        if match is None:
            return None
        own = self.instances(match["message"]) if match["instance"] is None else [int(match["instance"])]
        table = self.messages.tables.get((match["message"], own[0])) if own else None
        return (table, match["field"]) if table is not None and _is_signal(table, match["field"]) else None

    def _place(self, name: str) -> tuple[Table, str]:
        """Return table and column of a signal. UsageError for an unknown name, with similar ones."""
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
