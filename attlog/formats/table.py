"""What every reader returns: lazy columns, parameters, texts and a list of damage.

A reader maps the file, makes one index pass and decodes a column when somebody
asks for it. All readers return the same :class:`Messages`, so that the flight
layer never knows how a byte was stored.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import RAISE_VARIABLE, AttlogError, bug_sentence
from attlog.core.limits import MAX_DAMAGE
from attlog.core.timestamps import Offsets, Timeline, restarts

# A message, what of it is read and where: around what may fail, see table.
Guard = Callable[[str, str, int | None], AbstractContextManager[None]]


@dataclass(frozen=True, slots=True)
class Field:
    """One column of a message as the format declares it.

    ``dtype`` is the stored type (numpy notation; sub-arrays such as ``64S1`` for
    text). ``scale`` turns the stored number into the printed one (0.01 for
    DataFlash ``c``), ``unit`` is what the format says of the printed number, None
    where it says nothing.
    """

    name: str
    dtype: np.dtype[Any]
    unit: str | None = None
    scale: float = 1.0


class Table:
    """All records of one message and instance, in file order, columns on demand.

    ``table["GyrX"]`` is the column with its stored dtype, ``table.value("Roll")``
    the same as float64 with the format's own scaling applied (what the format's
    official library prints). ``offsets`` (n,) are the byte offsets of the records in
    the file, int32 where that holds them; slices of a table stay lazy.
    """

    def __init__(
        self,
        name: str,
        instance: int,
        fields: dict[str, Field] | Callable[[], dict[str, Field]],
        offsets: Offsets,
        decode: Callable[[str, Offsets], NDArray[Any]],
        guard: Guard | None = None,
    ) -> None:
        self.name = name
        self.instance = instance
        self.offsets = offsets
        self._fields = fields
        self._decode = decode
        self._around = guard
        self._columns: dict[str, NDArray[Any]] = {}

    @property
    def fields(self) -> dict[str, Field]:
        """The columns by name, in stored order; a reader may leave finding them to the first who asks."""
        if callable(self._fields):
            try:
                self._fields = self._fields()
            except Exception as error:
                self._fields = {}
                self._caught(error, "its fields")
        return self._fields

    def __len__(self) -> int:
        return len(self.offsets)

    def __contains__(self, column: object) -> bool:
        return column in self.fields or (isinstance(column, str) and self._element(column) is not None)

    def __repr__(self) -> str:
        return f"<Table {self.name}:{self.instance} {len(self)} records, {len(self.fields)} fields>"

    def __getitem__(self, column: str) -> NDArray[Any]:
        """The column as stored, (n,) or (n, k) for array fields; ``q[2]`` is one element of an array field.

        An array of one element is a number: beside columns (n,), one of (n, 1) would grow to n times n values.
        KeyError if the message has no such field.
        """
        if column not in self._columns:
            element = self._element(column)
            if element is not None:
                whole = self[element[0]]
                return whole if whole.ndim == 1 else whole[:, element[1]]
            if column not in self.fields:
                raise KeyError(f"{self.name} has no field {column!r}; it has {', '.join(self.fields)}")
            try:
                stored = self._decode(column, self.offsets)
                self._columns[column] = stored[:, 0] if stored.shape[1:] == (1,) else stored
            except Exception as error:
                self._caught(error, column)
                self._fields = {name: field for name, field in self.fields.items() if name != column}
                raise KeyError(f"{self.name}: {column} cannot be decoded") from None
        return self._columns[column]

    def _caught(self, error: Exception, what: str) -> None:
        """What the barrier makes of an error; it is asked only now because columns are read by the thousand."""
        if self._around is None:
            raise error
        with self._around(self.name, what, int(self.offsets[0]) if len(self.offsets) else None):
            raise error

    def value(self, column: str) -> NDArray[np.float64]:
        """The column as float64 in the unit that the format prints."""
        stored = self[column]
        element = None if column in self.fields else self._element(column)
        scale = self.fields[element[0] if element else column].scale
        with np.errstate(invalid="ignore"):  # damaged bytes can be signalling NaN, which stay NaN
            as_float = stored.astype(np.float64)
        return as_float if scale == 1.0 else as_float * scale

    def _element(self, column: str) -> tuple[str, int] | None:
        """Field and position that ``name[i]`` means, None if it names no element of an array field."""
        name, _, index = column.removesuffix("]").rpartition("[")
        known = self.fields.get(name) if column not in self.fields else None
        if known is None or not index.isdecimal() or len(known.dtype.shape) != 1 or int(index) >= known.dtype.shape[0]:
            return None
        return name, int(index)

    def forget(self) -> None:
        """Let go of the columns and of the copy of the records behind them; both are made anew when asked."""
        self._columns.clear()
        forget = getattr(self._decode, "forget", None)  # of one that keeps a copy of records for its next column
        if forget is not None:
            forget()

    def rows(self, select: NDArray[Any] | slice) -> Table:
        """The same message, only the selected records (mask, indices or slice)."""
        return Table(self.name, self.instance, self._fields, self.offsets[select], self._decode, self._around)


class ParamChange(NamedTuple):
    """A parameter value as the log states it. ``t_us`` is None for values from before the first data.

    A tuple because logs state thousands, and these are made four times as fast.
    """

    name: str
    value: float | int
    t_us: int | None = None
    is_default: bool = False
    offset: int = 0


@dataclass(frozen=True, slots=True)
class Text:
    """A message of the autopilot. ``level``: syslog severity 0 (emergency) to 7 (debug)."""

    text: str
    level: int
    t_us: int | None = None
    offset: int = 0


@dataclass(frozen=True, slots=True)
class Damage:
    """A place where the file is broken: what was lost there and how reading went on."""

    offset: int
    length: int
    lost: str
    resumed: str


@dataclass(frozen=True, slots=True)
class Remark:
    """What a reader has to say of a log beside the damage, a whole sentence: what it left out, and why."""

    code: str
    text: str
    offset: int | None = None
    count: int = 1


@dataclass(frozen=True, slots=True)
class Boot:
    """One power-up inside a file: records from ``start`` to before ``end`` (byte offsets)."""

    start: int
    end: int


def boots_at(edges: Iterable[int], size: int) -> list[Boot]:
    """Return the power-ups of a file of ``size`` bytes; all but the first begin at ``edges``, ascending."""
    return [Boot(a, b) for a, b in pairwise([0, *edges, size])]


def boots_of_timeline(timeline: Timeline, size: int) -> list[Boot]:
    """Return the power-ups of a file, each from the first record after a restart of the clock."""
    at, time = timeline
    return boots_at(at[restarts(time)].tolist(), size)


T = TypeVar("T")


class LazyList(Generic[T]):
    """A list of a log that may be given as a function that makes it: the first who asks has it called with the log.

    Columns are decoded when somebody asks for them, and so are parameters, of which a log states thousands. A function
    that knew the log itself would keep it, and all its bytes, until the collector of cycles comes by.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._place = f"_{name}"

    @overload
    def __get__(self, log: None, owner: type) -> Callable[[Any], list[T]]: ...

    @overload
    def __get__(self, log: object, owner: type) -> list[T]: ...

    def __get__(self, log: object | None, owner: type) -> list[T] | Callable[[Any], list[T]]:
        if log is None:
            return lambda _: []  # what a dataclass takes for the default; ``list`` would list the log's own messages
        found = getattr(log, self._place)
        if callable(found):
            found = found(log)
            setattr(log, self._place, found)
        values: list[T] = found
        return values

    def __set__(self, log: object, values: list[T] | Callable[[Any], list[T]]) -> None:
        setattr(log, self._place, values)


@dataclass
class Messages(Mapping[tuple[str, int], Table]):
    """An opened log: ``(name, instance) -> Table`` plus what stands beside the data.

    ``format`` is ``ulog``, ``dataflash``, ``dataflash_text``, ``tlog``, ``mavlink``
    or ``ros``. ``info`` holds the format's own statements (versions, hardware).
    ``damage`` lists the first damaged places, ``damage_places`` and ``damage_bytes`` count all of them.
    ``remarks`` tell what was left out, and why.
    For MAVLink the instance is ``system * 256 + component``.
    """

    path: Path
    format: str
    size: int
    tables: dict[tuple[str, int], Table]
    params: LazyList[ParamChange] = LazyList()
    texts: LazyList[Text] = LazyList()
    info: dict[str, Any] = field(default_factory=dict)
    damage: list[Damage] = field(default_factory=list)
    damage_bytes: int = 0
    dropouts_ms: list[int] = field(default_factory=list)
    boots: list[Boot] = field(default_factory=list)
    damage_places: int = 0
    remarks: list[Remark] = field(default_factory=list)

    def __getitem__(self, key: tuple[str, int]) -> Table:
        return self.tables[key]

    def __iter__(self) -> Iterator[tuple[str, int]]:
        return iter(self.tables)

    def __len__(self) -> int:
        return len(self.tables)

    def forget(self) -> None:
        """Let go of all that was decoded: of a log of gigabytes more than what a flight keeps of it."""
        for table in self.tables.values():
            table.forget()

    def names(self) -> list[str]:
        """Message names, each once, in file order."""
        return list(dict.fromkeys(name for name, _ in self.tables))

    def instances(self, name: str) -> list[int]:
        """Instances of one message, ascending; empty if the log has none."""
        return sorted(i for n, i in self.tables if n == name)

    def first(self, name: str) -> Table | None:
        """The lowest instance of a message, None if absent."""
        found = self.instances(name)
        return self.tables[name, found[0]] if found else None

    def boot(self, index: int) -> Messages:
        """The same log restricted to one power-up. IndexError if there is no such boot."""
        if len(self.boots) <= 1 and index == 0:
            return self
        b = self.boots[index]
        tables: dict[tuple[str, int], Table] = {}
        for key, table in self.tables.items():
            part = table.rows((table.offsets >= b.start) & (table.offsets < b.end))
            if len(part):
                tables[key] = part
        return Messages(
            self.path,
            self.format,
            self.size,
            tables,
            lambda _: [p for p in self.params if b.start <= p.offset < b.end],
            lambda _: [x for x in self.texts if b.start <= x.offset < b.end],
            self.info,
            self.damage,
            self.damage_bytes,
            self.dropouts_ms,
            [b],
            self.damage_places,
            self.remarks,
        )


# What of a file cannot be used: every place is counted, the first ones are kept one by one.


class DamageLog:
    """Damaged places while a reader finds them: ``places`` and ``bytes`` of all, :attr:`listed` the first in the file.

    A reader that reads forwards tells them in file order; what it says of a whole kind of record (a few per file)
    goes through :meth:`add_kind` and always stands in the list.
    """

    def __init__(self) -> None:
        self.places = 0
        self.bytes = 0
        self._one_by_one: list[Damage] = []
        self._kinds: list[Damage] = []

    def add(self, offset: int, length: int, lost: str, resumed: str) -> None:
        """One place with so many unusable bytes."""
        self.places += 1
        self.bytes += length
        if len(self._one_by_one) < MAX_DAMAGE:
            self._one_by_one.append(Damage(offset, length, lost, resumed))

    def add_kind(self, offset: int, length: int, lost: str, resumed: str, counted: bool = False) -> None:
        """All records of a kind at once, by the place of the first; ``counted``: their bytes are counted already."""
        self.places += 1
        self.bytes += 0 if counted else length
        if len(self._kinds) < MAX_DAMAGE:
            self._kinds.append(Damage(offset, length, lost, resumed))

    @property
    def listed(self) -> list[Damage]:
        """The places in file order, at most :data:`attlog.core.limits.MAX_DAMAGE`."""
        one_by_one = self._one_by_one[: MAX_DAMAGE - len(self._kinds)]
        return sorted([*one_by_one, *self._kinds], key=lambda d: d.offset)


# The last barrier around one message type of a reader, see :mod:`attlog.core.errors`: the rest of the log goes on.
#
# What nobody expected becomes a remark with the message, the kind of error and its place, and a traceback at log
# level
# debug.

# Code of the remarks made here; no log that is sound may have one.
PART_FAILED = "part_failed"


class ReaderBarrier:
    """Collects what failed into ``remarks``, one for each message type however often it fails."""

    def __init__(self, remarks: list[Remark]) -> None:
        self._remarks = remarks
        self._failed: set[str] = set()

    @contextmanager
    def around(self, message: str, what: str, offset: int | None) -> Iterator[None]:
        """Run the body; an unexpected error in it ends here. ``what`` of the message it reads, ``offset`` where."""
        try:
            yield
        except Exception as error:
            self.caught(error, message, what, offset)

    def caught(self, error: Exception, message: str, what: str, offset: int | None) -> None:
        """The same for an error at hand; raises it where it was meant, or is no message's fault, or under test."""
        if isinstance(error, (AttlogError, MemoryError)) or os.environ.get(RAISE_VARIABLE):
            raise error
        import logging  # nearly no log needs it

        logging.getLogger("attlog.formats").debug("%s, %s, byte %s", message, what, offset, exc_info=error)
        if message not in self._failed:
            self._failed.add(message)
            at = "" if offset is None else f" from byte {offset} on"
            self._remarks.append(Remark(PART_FAILED, bug_sentence(f"{message}{at}", error), offset))


def unguarded(message: str, what: str, offset: int | None) -> AbstractContextManager[None]:
    """No barrier: for what is read on behalf of a reader that has its own around it."""
    return nullcontext()
