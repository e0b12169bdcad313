"""Common result of all readers: lazy columns, parameters, texts, and a log of damage.

A reader indexes the file in one pass and decodes a column on access. All readers return the same :class:`Messages`, so
the flight layer is independent of file formats.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import counted
from attlog.core.errors import RAISE_VARIABLE, AttlogError, bug_sentence
from attlog.core.limits import MAX_DAMAGE
from attlog.core.timestamps import Offsets, Timeline, restarts

T = TypeVar("T")
# Code of the remark on a part that failed because of a bug; no sound log may have one.
PART_FAILED = "part_failed"


class ParamChange(NamedTuple):
    """A parameter value in the log; ``t_us`` is None before the first data.

    ``firmware_only``: a default of the firmware, in place of which the airframe has its own. A tuple, because logs hold
    thousands and these are made four times as fast.
    """

    name: str
    value: float | int
    t_us: int | None = None
    is_default: bool = False
    offset: int = 0
    firmware_only: bool = False


@dataclass(frozen=True, slots=True)
class Text:
    """A message of the autopilot. ``level``: syslog severity 0 (emergency) to 7 (debug)."""

    text: str
    level: int
    t_us: int | None = None
    offset: int = 0


@dataclass(frozen=True, slots=True)
class Boot:
    """Power-up in a file: byte offsets ``start`` to before ``end``."""

    start: int
    end: int


def boots_at(edges: Iterable[int], size: int) -> list[Boot]:
    """Return the power-ups of a file of ``size`` bytes, which begin at 0 and at ``edges``."""
    return [Boot(a, b) for a, b in pairwise([0, *edges, size])]


def boots_of_timeline(timeline: Timeline, size: int) -> list[Boot]:
    """Return the power-ups of a file, split at restarts of the clock."""
    at, time = timeline
    return boots_at(at[restarts(time)].tolist(), size)


@dataclass(frozen=True, slots=True)
class Damage:
    """Damaged place of a file, with the loss and the place where reading resumed, both as text."""

    offset: int
    length: int
    lost: str
    resumed: str


# End of a loss that another definition of a message explains as well as damage.
OTHER_DIALECT = "(damaged, or of another dialect)"


@dataclass(frozen=True, slots=True)
class Remark:
    """Message of a reader about omitted content and its reason."""

    code: str
    text: str
    offset: int | None = None
    count: int = 1


class DamageLog:
    """Log of damaged places, omitted parts, and unexpected errors while reading a file.

    All places are counted (``places``, ``bytes``), the first ones :attr:`listed`. Records of a whole kind are added by
    :meth:`add_kind` and take precedence in the list.
    """

    def __init__(self) -> None:
        self.places = 0
        self.bytes = 0
        self.remarks: list[Remark] = []
        self._first: list[Damage] = []
        self._single: list[Damage] = []
        self._kinds: list[Damage] = []
        self._failed: set[str] = set()

    def add(self, offset: int, length: int, lost: str, resumed: str) -> None:
        """Add one place with unusable bytes."""
        self.places += 1
        self.bytes += length
        if len(self._single) < MAX_DAMAGE:
            self._single.append(Damage(offset, length, lost, resumed))

    def add_kind(self, offset: int, length: int, lost: str, resumed: str, counted: bool = False) -> None:
        """Add all records of a kind at the first one's place. ``counted``: their bytes are already counted."""
        self.places += 1
        self.bytes += 0 if counted else length
        if len(self._kinds) < MAX_DAMAGE:
            self._kinds.append(Damage(offset, length, lost, resumed))

    def add_cause(self, damage: Damage) -> None:
        """Add the cause of other damage; it is listed first."""
        self.places += 1
        self._first.append(damage)

    def add_remark(self, code: str, text: str, offset: int | None = None, count: int = 1) -> None:
        """Add a remark on omitted content."""
        self.remarks.append(Remark(code, text, offset, count))

    def add_limit(self, text: str, offset: int | None = None, count: int = 1) -> None:
        """Add a remark on an exceeded limit of :mod:`attlog.core.limits`."""
        self.add_remark("log_limit", text, offset, count)

    @property
    def listed(self) -> list[Damage]:
        """The places in file order, at most MAX_DAMAGE."""
        single = self._single[: MAX_DAMAGE - len(self._kinds)]
        return [*self._first, *sorted([*single, *self._kinds], key=lambda d: d.offset)][:MAX_DAMAGE]

    @contextmanager
    def around(self, message: str, what: str, offset: int | None) -> Iterator[None]:
        """Run a block that reads ``what`` of a message; unexpected errors in it become a remark."""
        try:
            yield
        except Exception as error:
            self.caught(error, message, what, offset)

    def caught(self, error: Exception, message: str, what: str, offset: int | None) -> None:
        """Turn an error into one remark per message.

        The traceback is logged at level debug. Expected errors, MemoryError, and all errors under test are raised.
        """
        if isinstance(error, (AttlogError, MemoryError)) or os.environ.get(RAISE_VARIABLE):
            raise error
        import logging  # hardly any log needs it

        logging.getLogger("attlog.formats").debug("%s, %s, byte %s", message, what, offset, exc_info=error)
        if message not in self._failed:
            self._failed.add(message)
            at = "" if offset is None else f" from byte {offset} on"
            self.add_remark(PART_FAILED, bug_sentence(f"{message}{at}", error), offset)

    def list_or_empty(self, message: str, what: str, make: Callable[[], list[T]]) -> list[T]:
        """Return ``make()``, empty after an unexpected error."""
        with self.around(message, what, None):
            return make()
        return []


class Field(NamedTuple):
    """Column of a message as declared by the format.

    ``dtype`` is the stored type (sub-arrays such as ``64S1`` for text). ``scale`` converts the stored number to the
    printed one (0.01 for DataFlash ``c``), ``unit`` is that of the printed number, None if unknown.
    """

    name: str
    dtype: np.dtype[Any]
    unit: str | None = None
    scale: float = 1.0


class FieldError(KeyError, ValueError):
    """A field that is missing or not of the kind that its message has; the text is for the user."""


class Table:
    """All records of one message and instance, columns on demand.

    ``table["GyrX"]`` is the column with its stored dtype, ``table.value("Roll")`` the column as float64 with the
    format's scaling (as printed by the official library). ``offsets`` (n,) are the byte offsets of the records, int32
    if the file is small enough; slices of a table stay lazy.
    """

    def __init__(
        self,
        name: str,
        instance: int,
        fields: dict[str, Field] | Callable[[], dict[str, Field]],
        offsets: Offsets,
        decode: Callable[[str, Offsets], NDArray[Any]],
        losses: DamageLog | None = None,
    ) -> None:
        self.name = name
        self.instance = instance
        self.offsets = offsets
        self._fields = fields
        self._decode = decode
        self._losses = losses
        self._columns: dict[str, NDArray[Any]] = {}

    @property
    def fields(self) -> dict[str, Field]:
        """The columns by name, in stored order."""
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
        return (
            f"<Table {self.name}:{self.instance} {counted(len(self), 'record')}, {counted(len(self.fields), 'field')}>"
        )

    def __getitem__(self, column: str) -> NDArray[Any]:
        """Return the column as stored, (n,) or (n, k).

        ``q[2]`` is one element of an array field. Arrays of one element become (n,), because (n, 1) would broadcast
        with (n,) to (n, n). KeyError if the message has no such field.
        """
        if column not in self._columns:
            if column not in self.fields:
                element = self._element(column)
                if element is not None:
                    whole = self[element[0]]
                    return whole if whole.ndim == 1 else whole[:, element[1]]
                raise FieldError(f"{self.name} has no field {column!r}; it has {', '.join(self.fields)}")
            try:
                stored = self._decode(column, self.offsets)
                self._columns[column] = stored[:, 0] if stored.shape[1:] == (1,) else stored
            except Exception as error:
                self._caught(error, column)
                self._fields = {name: field for name, field in self.fields.items() if name != column}
                raise FieldError(f"{self.name}: {column} cannot be decoded") from None
        return self._columns[column]

    def _caught(self, error: Exception, what: str) -> None:
        if self._losses is None:
            raise error
        self._losses.caught(error, self.name, what, int(self.offsets[0]) if len(self.offsets) else None)

    def value(self, column: str) -> NDArray[np.float64]:
        """Return the column as float64 in the unit that the format prints."""
        stored = self[column]
        element = None if column in self.fields else self._element(column)
        scale = self.fields[element[0] if element else column].scale
        with np.errstate(invalid="ignore"):  # damaged bytes can be signalling NaN
            as_float = stored.astype(np.float64)
        return as_float if scale == 1.0 else as_float * scale

    def _element(self, column: str) -> tuple[str, int] | None:
        """Return field and position of ``name[i]``, or None."""
        name, _, index = column.removesuffix("]").rpartition("[")
        known = self.fields.get(name) if column not in self.fields else None
        if known is None or not index.isdecimal() or len(known.dtype.shape) != 1 or int(index) >= known.dtype.shape[0]:
            return None
        return name, int(index)

    def forget(self) -> None:
        """Release the decoded columns and the copy of their records."""
        self._columns.clear()
        forget = getattr(self._decode, "forget", None)
        if forget is not None:
            forget()

    def rows(self, select: NDArray[Any] | slice) -> Table:
        """Return the table with selected records (mask, indices or slice)."""
        return Table(self.name, self.instance, self._fields, self.offsets[select], self._decode, self._losses)


class LazyList(Generic[T]):
    """Descriptor of a list attribute that is built from the log on first access.

    The building function takes the log as argument: a closure over it would form a reference cycle and keep its bytes.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._place = f"_{name}"

    @overload
    def __get__(self, log: None, owner: type) -> Callable[[Any], list[T]]: ...

    @overload
    def __get__(self, log: object, owner: type) -> list[T]: ...

    def __get__(self, log: object | None, owner: type) -> list[T] | Callable[[Any], list[T]]:
        if log is None:
            return lambda _: []  # the default of the dataclass
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
    """Opened log: ``(name, instance) -> Table``, with parameters, texts and information.

    ``format`` is ``ulog``, ``dataflash``, ``dataflash_text``, ``tlog``, ``mavlink`` or ``ros``. ``info``: versions,
    hardware and other metadata of the format. ``losses``: content that could not be read. For MAVLink the instance is
    ``system * 256 + component``.
    """

    path: Path
    format: str
    size: int
    tables: dict[tuple[str, int], Table]
    params: LazyList[ParamChange] = LazyList()
    texts: LazyList[Text] = LazyList()
    info: dict[str, Any] = field(default_factory=dict)
    losses: DamageLog = field(default_factory=DamageLog)
    dropouts_ms: list[int] = field(default_factory=list)
    boots: list[Boot] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"Messages({str(self.path)!r}, {self.format}, {len(self.tables)} tables)"

    def __getitem__(self, key: tuple[str, int]) -> Table:
        return self.tables[key]

    def __iter__(self) -> Iterator[tuple[str, int]]:
        return iter(self.tables)

    def __len__(self) -> int:
        return len(self.tables)

    @property
    def damage(self) -> list[Damage]:
        """The first damaged places."""
        return self.losses.listed

    @property
    def damage_places(self) -> int:
        """Number of all damaged places."""
        return self.losses.places

    @property
    def damage_bytes(self) -> int:
        """Unusable bytes of all damaged places."""
        return self.losses.bytes

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on omitted content."""
        return self.losses.remarks

    def forget(self) -> None:
        """Release all decoded columns."""
        for table in self.tables.values():
            table.forget()

    def names(self) -> list[str]:
        """Return the message names, each once, in file order."""
        return list(dict.fromkeys(name for name, _ in self.tables))

    def instances(self, name: str) -> list[int]:
        """Return the instances of one message, ascending."""
        return sorted(i for n, i in self.tables if n == name)

    def first(self, name: str) -> Table | None:
        """Return the lowest instance of a message, None if absent."""
        found = self.instances(name)
        return self.tables[name, found[0]] if found else None

    def boot(self, index: int) -> Messages:
        """Return the log restricted to one power-up. IndexError without such a boot."""
        if len(self.boots) <= 1 and index == 0:
            return self
        return self.between(self.boots[index])

    def between(self, b: Boot) -> Messages:
        """Return the log restricted to a part of the file."""
        parts = {
            key: table.rows((table.offsets >= b.start) & (table.offsets < b.end)) for key, table in self.tables.items()
        }
        return Messages(
            self.path,
            self.format,
            self.size,
            {key: part for key, part in parts.items() if len(part)},
            lambda _: [p for p in self.params if b.start <= p.offset < b.end],
            lambda _: [x for x in self.texts if b.start <= x.offset < b.end],
            self.info,
            self.losses,
            self.dropouts_ms,
            [b],
        )
