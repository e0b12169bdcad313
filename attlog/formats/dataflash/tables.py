"""Tables of DataFlash records: one per message and instance, columns decoded on demand."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.base.limits import MAX_INSTANCES
from attlog.formats.barrier import unguarded
from attlog.formats.base import Field, Guard, Offsets, Table
from attlog.formats.dataflash.index import HEADER_LENGTH, LETTER_DTYPES, LETTER_SCALES, MessageFormat, RecordIndex
from attlog.formats.grouping import by_kind
from attlog.formats.mapping import Records, gather

Units = dict[int, tuple[str, Callable[[], tuple[str | None, ...]]]]
"""By layout its unit ids, and the unit text of every column when somebody asks."""

INSTANCE_COLUMNS = ("I", "Instance", "Inst", "C", "IMU")
"""Names of one-byte columns that number sensors or estimator cores, for logs without FMTU (ArduPilot 3.x, 4.0)."""


def fields_of(fmt: MessageFormat, units: tuple[str | None, ...] = ()) -> tuple[dict[str, Field], np.dtype[Any]]:
    """The fields of a format by name, and its whole record as structured type."""
    fields: dict[str, Field] = {}
    places: dict[str, int] = {}
    place = HEADER_LENGTH
    for k, (letter, column) in enumerate(zip(fmt.letters, fmt.columns, strict=False)):
        dtype = LETTER_DTYPES[letter]
        if column:
            # FILE.Data is file content, in which zeros count
            kind = np.dtype("(64,)u1") if (fmt.name, letter) == ("FILE", "Z") else dtype
            fields[column] = Field(column, kind, units[k] if k < len(units) else None, LETTER_SCALES.get(letter, 1.0))
            places[column] = place
        place += dtype.itemsize
    record = np.dtype(
        {
            "names": list(fields),
            "formats": [f.dtype for f in fields.values()],
            "offsets": list(places.values()),
            "itemsize": fmt.length,
        }
    )
    return fields, record


class _Described:
    """What a format says of its columns, found out when the first of its tables is asked."""

    def __init__(
        self, data: NDArray[np.uint8], fmt: MessageFormat, units: Callable[[], tuple[str | None, ...]]
    ) -> None:
        self._data, self._fmt, self._units = data, fmt, units

    @cached_property
    def _found(self) -> tuple[dict[str, Field], np.dtype[Any]]:
        return fields_of(self._fmt, self._units())

    def fields(self) -> dict[str, Field]:
        return self._found[0]

    def table(self, instance: int, offsets: Offsets, guard: Guard) -> Table:
        decode = Records(lambda at: gather(self._data, at, self._found[1]))
        return Table(self._fmt.name, instance, self.fields, offsets, decode, guard)


def build_tables(
    data: NDArray[np.uint8],
    index: RecordIndex,
    units: Units | None = None,
    by_instance: bool = True,
    guard: Guard = unguarded,
) -> dict[tuple[str, int], Table]:
    """The tables of an index by (name, instance), in the order in which their first records stand in the file.

    ``guard`` goes around each message.
    """
    units = units or {}
    found_of = dict(by_kind([(index.offsets, index.layout.view(np.uint16))]))
    parts: dict[tuple[str, int], list[Table]] = {}
    for k, fmt in enumerate(index.layouts):
        offsets = found_of.get(k)
        if offsets is None or not fmt.readable:
            continue
        try:
            for part in _parts(data, fmt, offsets, units.get(k, ("", tuple)), by_instance, guard):
                parts.setdefault((fmt.name, part.instance), []).append(part)
        except Exception as error:  # the guard is asked only now: entering it for each message costs more than they do
            with guard(fmt.name, "its records", fmt.offset):
                raise error
    tables = {key: found[0] for key, found in parts.items()}
    for key, found in parts.items():
        if len(found) > 1:
            del tables[key]
            with guard(key[0], "its layouts", int(found[0].offsets[0])):
                tables[key] = MixedTable(found, guard)
    return dict(sorted(tables.items(), key=lambda item: int(item[1].offsets[0])))


def _parts(
    data: NDArray[np.uint8],
    fmt: MessageFormat,
    offsets: Offsets,
    described: tuple[str, Callable[[], tuple[str | None, ...]]],
    by_instance: bool,
    guard: Guard,
) -> list[Table]:
    """The records of one layout, a table for each instance."""
    ids, texts = described
    layout = _Described(data, fmt, texts)
    column = instance_column(fmt, ids) if by_instance else None
    split = None
    if column is not None:
        k = fmt.columns.index(column)
        split = by_instance_number(gather(data[fmt.place(k) :], offsets, LETTER_DTYPES[fmt.letters[k]]))
    if split is None:
        return [layout.table(0, offsets, guard)]
    return [layout.table(number, offsets[mine], guard) for number, mine in split]


def by_instance_number(number: NDArray[np.integer[Any]]) -> list[tuple[int, NDArray[np.int64]]] | None:
    """Each instance, ascending, and the positions of its records, ascending; None if so many numbers number nothing."""
    if (number == number[:1]).all():  # most messages have one
        return [(n, np.arange(len(number))) for n in number[:1].tolist()]
    order = number.argsort(kind="stable")
    sorted_numbers = number[order]
    edges = np.flatnonzero(sorted_numbers[1:] != sorted_numbers[:-1]) + 1
    if len(edges) >= MAX_INSTANCES:
        return None
    bounds = [0, *edges.tolist(), len(order)]
    return [(n, order[a:b]) for n, (a, b) in zip(sorted_numbers[bounds[:-1]].tolist(), pairwise(bounds), strict=True)]


def instance_column(fmt: MessageFormat, unit_ids: str) -> str | None:
    """The column that tells the instance, None if there is none."""
    return _instance_column(fmt.letters, fmt.columns, unit_ids)


@lru_cache(1 << 10)
def _instance_column(letters: str, columns: tuple[str, ...], unit_ids: str) -> str | None:
    for letter, column, unit in zip(letters, columns, unit_ids, strict=False):
        if unit == "#" and LETTER_DTYPES[letter].kind in "iu" and column:
            return column
    for letter, column in zip(letters, columns, strict=False):
        if letter in "bB" and column in INSTANCE_COLUMNS:
            return column
    return None


class MixedTable(Table):
    """Records of one message whose layout changed inside the file, as in joined logs of two firmwares.

    A column that not all layouts have, or have with another type or scale, reads
    as float64 of the printed values, NaN where it does not exist. ``rows`` within
    one layout gives that layout's plain table.
    """

    def __init__(self, parts: list[Table], guard: Guard = unguarded) -> None:
        self._parts = parts
        fields: dict[str, Field] = {}
        for part in parts:
            for name, field in part.fields.items():
                known = fields.setdefault(name, field)
                if known.dtype.kind == field.dtype.kind == "S" and field.dtype.itemsize > known.dtype.itemsize:
                    fields[name] = field
        for name, field in fields.items():
            same = all(
                name in p and (p.fields[name].dtype, p.fields[name].scale) == (field.dtype, field.scale) for p in parts
            )
            if not same and field.dtype.kind in "iuf" and field.dtype.shape == ():
                fields[name] = Field(name, np.dtype(np.float64), field.unit)
        every = np.concatenate([p.offsets for p in parts])
        order = np.argsort(every, kind="stable")
        # of each record in file order: which part holds it, and at which place
        self._part = np.repeat(np.arange(len(parts)), [len(p) for p in parts])[order]
        self._place = np.concatenate([np.arange(len(p)) for p in parts])[order]
        super().__init__(parts[0].name, parts[0].instance, fields, every[order], self._mixed, guard)

    def _mixed(self, column: str, offsets: Offsets) -> NDArray[Any]:
        """A column of all records; a table only ever decodes its own offsets."""
        dtype = self.fields[column].dtype
        blank = np.nan if dtype.kind == "f" else 0
        result = np.full((len(offsets), *dtype.shape), b"" if dtype.kind == "S" else blank, dtype.base)
        by_part = np.split(np.argsort(self._part, kind="stable"), np.bincount(self._part).cumsum()[:-1])
        for part, mine in zip(self._parts, by_part, strict=True):
            if column not in part.fields:
                continue
            field = part.fields[column]
            if (field.dtype.kind == "S", field.dtype.shape) != (dtype.kind == "S", dtype.shape):
                continue  # the same name for something else
            as_stored = dtype.kind == "S" or (field.dtype, field.scale) == (dtype, self.fields[column].scale)
            result[mine] = part[column] if as_stored else part.value(column)
        return result

    def forget(self) -> None:
        """Let go of the columns, also of those of each layout."""
        super().forget()
        for part in self._parts:
            part.forget()

    def rows(self, select: NDArray[Any] | slice) -> Table:
        """The same message, only the selected records; a plain table if they share one layout."""
        which, place = self._part[select], self._place[select]
        chosen = [(part, np.sort(place[which == k])) for k, part in enumerate(self._parts)]
        parts = [part.rows(mine) for part, mine in chosen if len(mine)] or [self._parts[0].rows(slice(0))]
        return parts[0] if len(parts) == 1 else MixedTable(parts, self._around or unguarded)


def tell_unreadable(index: RecordIndex) -> None:
    """Adds to the losses what formats cost whose letters do not give their length; framing goes on by the length."""
    if all(fmt.readable for fmt in index.layouts):
        return
    counts = np.bincount(index.layout, minlength=len(index.layouts)).tolist()
    for fmt, count in zip(index.layouts, counts, strict=True):
        if count and not fmt.readable:
            why = f"the format {fmt.letters!r} does not have {fmt.length} bytes" if fmt.letters else "no format is read"
            lost = f"{count} {fmt.name} records: {why}"
            index.losses.add_kind(
                fmt.offset, count * fmt.length, lost, "framing goes on by the declared length", counted=True
            )
