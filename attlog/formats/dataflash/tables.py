"""Tables of DataFlash records, units of columns, and the parameters, texts and times in them."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache, cached_property, partial
from itertools import pairwise, repeat
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import counted
from attlog.core.limits import LAST_TIME_US, MAX_INSTANCES, MAX_PARAM_CHANGES, MAX_TEXT_LENGTH, MAX_TEXTS
from attlog.core.timestamps import Offsets, Timeline, false_times, merge_timelines, times_before
from attlog.formats.dataflash.layout import HEADER_BYTES, LETTER_DTYPES, LETTER_SCALES, MessageFormat
from attlog.formats.dataflash.walk import RecordIndex
from attlog.formats.file_bytes import RecordColumns, decode_text, decode_texts, gather, offsets_by_kind
from attlog.formats.table import DamageLog, Field, Messages, ParamChange, Table, Text

# By layout: unit ids, and a function that returns the unit of every column.
Units = dict[int, tuple[str, Callable[[], tuple[str | None, ...]]]]

# One-byte columns that number sensors or cores in logs without FMTU (ArduPilot 3.x, 4.0).
INSTANCE_COLUMNS = ("I", "Instance", "Inst", "C", "IMU")


def format_fields(fmt: MessageFormat, units: tuple[str | None, ...] = ()) -> tuple[dict[str, Field], np.dtype[Any]]:
    """Return the fields of a format, and its record as structured type."""
    fields: dict[str, Field] = {}
    places: dict[str, int] = {}
    place = HEADER_BYTES
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


class _ColumnLayout:
    """The columns of a format, made on first access."""

    def __init__(
        self, data: NDArray[np.uint8], fmt: MessageFormat, units: Callable[[], tuple[str | None, ...]]
    ) -> None:
        self._data, self._fmt, self._units = data, fmt, units

    @cached_property
    def _found(self) -> tuple[dict[str, Field], np.dtype[Any]]:
        return format_fields(self._fmt, self._units())

    def fields(self) -> dict[str, Field]:
        return self._found[0]

    def table(self, instance: int, offsets: Offsets, losses: DamageLog) -> Table:
        decode = RecordColumns(lambda at: gather(self._data, at, self._found[1]))
        return Table(self._fmt.name, instance, self.fields, offsets, decode, losses)


def build_tables(
    data: NDArray[np.uint8], index: RecordIndex, units: Units | None = None, by_instance: bool = True
) -> dict[tuple[str, int], Table]:
    """Return the tables by (name, instance), in file order."""
    units, losses = units or {}, index.losses
    found_of = dict(offsets_by_kind([(index.offsets, index.layout.view(np.uint16))]))
    parts: dict[tuple[str, int], list[Table]] = {}
    for k, fmt in enumerate(index.layouts):
        offsets = found_of.get(k)
        if offsets is None or not fmt.readable:
            continue
        try:
            for part in _split_by_instance(data, fmt, offsets, units.get(k, ("", tuple)), by_instance, losses):
                parts.setdefault((fmt.name, part.instance), []).append(part)
        except Exception as error:
            losses.caught(error, fmt.name, "its records", fmt.offset)
    tables = {key: found[0] for key, found in parts.items()}
    for key, found in parts.items():
        if len(found) > 1:
            del tables[key]
            with losses.around(key[0], "its layouts", int(found[0].offsets[0])):
                tables[key] = MixedTable(found, losses)
    return dict(sorted(tables.items(), key=lambda item: int(item[1].offsets[0])))


def _split_by_instance(
    data: NDArray[np.uint8],
    fmt: MessageFormat,
    offsets: Offsets,
    described: tuple[str, Callable[[], tuple[str | None, ...]]],
    by_instance: bool,
    losses: DamageLog,
) -> list[Table]:
    """Split the records of one layout into a table for each instance."""
    ids, texts = described
    layout = _ColumnLayout(data, fmt, texts)
    column = instance_column(fmt, ids) if by_instance else None
    split = None
    if column is not None:
        k = fmt.columns.index(column)
        split = split_by_number(gather(data[fmt.place(k) :], offsets, LETTER_DTYPES[fmt.letters[k]]))
    if split is None:
        return [layout.table(0, offsets, losses)]
    return [layout.table(number, offsets[mine], losses) for number, mine in split]


def split_by_number(number: NDArray[np.integer[Any]]) -> list[tuple[int, NDArray[np.int64]]] | None:
    """Return each instance and the positions of its records. None for too many instances."""
    if (number == number[:1]).all():  # usual
        return [(n, np.arange(len(number))) for n in number[:1].tolist()]
    order = number.argsort(kind="stable")
    sorted_numbers = number[order]
    edges = np.flatnonzero(sorted_numbers[1:] != sorted_numbers[:-1]) + 1
    if len(edges) >= MAX_INSTANCES:
        return None
    bounds = [0, *edges.tolist(), len(order)]
    return [(n, order[a:b]) for n, (a, b) in zip(sorted_numbers[bounds[:-1]].tolist(), pairwise(bounds), strict=True)]


def instance_column(fmt: MessageFormat, unit_ids: str) -> str | None:
    """Return the column that numbers the instance, None without one."""
    for letter, column, unit in zip(fmt.letters, fmt.columns, unit_ids, strict=False):
        if unit == "#" and LETTER_DTYPES[letter].kind in "iu" and column:
            return column
    for letter, column in zip(fmt.letters, fmt.columns, strict=False):
        if letter in "bB" and column in INSTANCE_COLUMNS:
            return column
    return None


class MixedTable(Table):
    """Table of a message whose layout changes in the file, as in joined logs of two firmware versions.

    Columns that differ in type or scale, or are missing in some layouts, are float64 of the printed values, with NaN
    if missing. :meth:`rows` within one layout returns that layout's plain table.
    """

    def __init__(self, parts: list[Table], losses: DamageLog | None = None) -> None:
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
        # part and place of each record in file order
        self._part = np.repeat(np.arange(len(parts)), [len(p) for p in parts])[order]
        self._place = np.concatenate([np.arange(len(p)) for p in parts])[order]
        super().__init__(parts[0].name, parts[0].instance, fields, every[order], self._mixed, losses)

    def _mixed(self, column: str, offsets: Offsets) -> NDArray[Any]:
        """Decode a column of all records; only the table's own offsets are supported."""
        dtype = self.fields[column].dtype
        blank = np.nan if dtype.kind == "f" else 0
        result = np.full((len(offsets), *dtype.shape), b"" if dtype.kind == "S" else blank, dtype.base)
        by_part = np.split(np.argsort(self._part, kind="stable"), np.bincount(self._part).cumsum()[:-1])
        for part, mine in zip(self._parts, by_part, strict=True):
            if column not in part.fields:
                continue
            field = part.fields[column]
            if (field.dtype.kind == "S", field.dtype.shape) != (dtype.kind == "S", dtype.shape):
                continue  # another meaning of the name
            as_stored = dtype.kind == "S" or (field.dtype, field.scale) == (dtype, self.fields[column].scale)
            result[mine] = part[column] if as_stored else part.value(column)
        return result

    def forget(self) -> None:
        """Release the columns, also of each layout."""
        super().forget()
        for part in self._parts:
            part.forget()

    def rows(self, select: NDArray[Any] | slice) -> Table:
        """Return selected records; a plain table if they share one layout."""
        which, place = self._part[select], self._place[select]
        chosen = [(part, np.sort(place[which == k])) for k, part in enumerate(self._parts)]
        parts = [part.rows(mine) for part, mine in chosen if len(mine)] or [self._parts[0].rows(slice(0))]
        return parts[0] if len(parts) == 1 else MixedTable(parts, self._losses)


def report_unreadable(index: RecordIndex) -> None:
    """Report records of formats whose letters contradict their length, by which they are framed."""
    if all(fmt.readable for fmt in index.layouts):
        return
    counts = np.bincount(index.layout, minlength=len(index.layouts)).tolist()
    for fmt, count in zip(index.layouts, counts, strict=True):
        if count and not fmt.readable:
            why = (
                f"the format {fmt.letters!r} does not have {counted(fmt.length, 'byte')}"
                if fmt.letters
                else "no format is read"
            )
            lost = f"{counted(count, f'{fmt.name} record')}: {why}"
            index.losses.add_kind(
                fmt.offset, count * fmt.length, lost, "framing goes on by the declared length", counted=True
            )


# Syslog severity of all texts; MSG records have none.
INFO_SEVERITY = 6


def read_params(messages: Messages, timeline: Timeline) -> list[ParamChange]:
    """Return the parameters in PARM records; a logged default is an entry before the value."""
    table = messages.first("PARM")
    if table is None or not has_text(table, "Name") or not has_number(table, "Value"):
        return []
    table = table.rows(slice(MAX_PARAM_CHANGES))
    names = decode_texts(table["Name"])
    values = table["Value"].tolist()
    times, offsets = _record_times(table, timeline), table.offsets.tolist()
    changes = map(ParamChange._make, zip(names, values, times, repeat(False), offsets, repeat(False), strict=False))
    if not has_number(table, "Default"):
        return list(changes)
    logged: list[float] = table["Default"].tolist()
    defaults = map(ParamChange._make, zip(names, logged, times, repeat(True), offsets, repeat(False), strict=False))
    pairs = zip(defaults, changes, strict=True)
    return [c for default, change in pairs for c in ((default, change) if isfinite(default.value) else (change,))]


def read_texts(messages: Messages, timeline: Timeline) -> list[Text]:
    """Return the texts in MSG records: banner and events."""
    table = messages.first("MSG")
    if table is None or not has_text(table, "Message"):
        return []
    table = table.rows(slice(MAX_TEXTS))
    rows = zip(table["Message"].tolist(), _record_times(table, timeline), table.offsets.tolist(), strict=True)
    return [Text(decode_text(raw)[:MAX_TEXT_LENGTH], INFO_SEVERITY, t_us, offset) for raw, t_us, offset in rows]


def has_text(table: Table, column: str) -> bool:
    """Return whether a table has a column of texts. Damaged or foreign formats may use any type."""
    return column in table.fields and table.fields[column].dtype.kind == "S"


def has_number(table: Table, column: str) -> bool:
    """Return whether a table has a column of numbers."""
    return column in table.fields and table.fields[column].dtype.kind in "iuf"


def has_integer(table: Table, column: str) -> bool:
    """Return whether a table has a column of integers."""
    return column in table.fields and table.fields[column].dtype.kind in "iu"


def _record_times(table: Table, timeline: Timeline) -> list[int | None]:
    """Return the stamp of each record, or that of the timed record before it."""
    if "TimeUS" in table.fields and table.fields["TimeUS"].dtype.kind in "iu":
        return [t if 0 <= t <= LAST_TIME_US else None for t in table["TimeUS"].tolist()]
    return times_before(table.offsets, timeline)


_UNIT_PREFIXES = {1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n", 1e3: "k"}


def read_units(data: NDArray[np.uint8], index: RecordIndex) -> Units:
    """Return unit ids and units of columns by layout."""
    describes = np.array([f.name in ("FMTU", "UNIT", "MULT") for f in index.layouts])
    chosen = describes[index.layout].nonzero()[0]
    some = RecordIndex(index.layouts, index.offsets[chosen], index.layout[chosen], np.zeros(0, np.int64), index.losses)
    tables = build_tables(data, some, by_instance=False)
    described = tables.get(("FMTU", 0))
    if described is None or not has_integer(described, "FmtType"):
        return {}
    if not (has_text(described, "UnitIds") and has_text(described, "MultIds")):
        return {}
    names = {i: decode_text(t) for i, t in _id_values(tables.get(("UNIT", 0)), "Label", has_text)}
    factors = {i: float(m) for i, m in _id_values(tables.get(("MULT", 0)), "Mult", has_number)}
    by_type: dict[int, list[int]] = {}
    for k, fmt in enumerate(index.layouts):
        by_type.setdefault(fmt.type, []).append(k)
    since = {kind: [index.layouts[k].offset for k in mine] for kind, mine in by_type.items()}

    @cache  # the same few combinations in every message
    def text_of(letter: str, u: str, m: str) -> str | None:
        return _unit_text(names.get(u, ""), u, factors.get(m, 0.0), m, LETTER_SCALES.get(letter, 1.0))

    def texts_of(letters: str, ids: str, mults: str) -> tuple[str | None, ...]:
        return tuple(map(text_of, letters, ids, mults.ljust(len(ids), "-")))

    result: Units = {}
    rows = zip(
        described["FmtType"].tolist(),
        decode_texts(described["UnitIds"]),
        decode_texts(described["MultIds"]),
        described.offsets.tolist(),
        strict=True,
    )
    for kind, ids, mults, offset in rows:
        mine = by_type.get(kind)
        if mine:
            fmt_at = mine[max(bisect_left(since[kind], offset) - 1, 0)]
            result[fmt_at] = (ids, partial(texts_of, index.layouts[fmt_at].letters, ids, mults))
    return result


def _id_values(table: Table | None, column: str, is_fit: Callable[[Table, str], bool]) -> list[tuple[str, Any]]:
    """Return the values of UNIT or MULT records by id, empty if the columns have unexpected types."""
    if table is None or not is_fit(table, column) or not has_integer(table, "Id"):
        return []
    ids = [chr(int(i) & 0xFF) for i in table["Id"].tolist()]
    return list(zip(ids, table[column].tolist(), strict=True))


def _unit_text(name: str, unit_id: str, factor: float, mult_id: str, scale: float) -> str | None:
    """Return the unit of the printed number, None if unknown.

    The stored value times the multiplier is in unit ``name``. The printed number is in ``name`` if the multiplier
    equals the letter's scale (c with B = 0.01, L with G = 1e-7), or is 1 with a scaled letter. A remaining factor
    becomes an SI prefix or a number.
    """
    if unit_id in "-?#" or mult_id == "?" or not name or not 0.0 <= factor < np.inf:
        return None
    if mult_id == "-" or factor == 0.0 or (scale != 1.0 and factor == 1.0):
        return name
    rest = float(f"{factor / scale:.6g}")
    if rest == 1.0:
        return name
    return _UNIT_PREFIXES[rest] + name if rest in _UNIT_PREFIXES else f"{rest:g} {name}"


def time_column(fmt: MessageFormat) -> tuple[str, int] | None:
    """Return a format's clock column and its unit in us, None without one."""
    letters = dict(zip(fmt.columns, fmt.letters, strict=False))
    if letters.get("TimeUS") in ("Q", "q"):
        return "TimeUS", 1
    # in GPS records of 3.1 and 3.2 TimeMS is the time of the GPS week, T the boot clock
    column = "T" if "Week" in letters or "GWk" in letters else "TimeMS"
    return (column, 1000) if letters.get(column) in ("I", "i") else None


def record_timeline(data: NDArray[np.uint8], index: RecordIndex) -> tuple[Offsets, NDArray[np.int64]]:
    """Return offset and time of every timed record in file order, and release ``index.stamps``."""
    stamps, index.stamps = index.stamps, np.zeros(0, np.int64)
    columns = [time_column(fmt) if fmt.readable else None for fmt in index.layouts]
    timed = np.array([column is not None for column in columns])[index.layout]
    at, time = index.offsets[timed], stamps[timed]
    elsewhere = {}
    for k, (fmt, column) in enumerate(zip(index.layouts, columns, strict=True)):
        if column is not None:
            place, factor = fmt.place(fmt.columns.index(column[0])), column[1]
            if (place, factor) != (HEADER_BYTES, 1):
                elsewhere[k] = place, factor
    if elsewhere:
        kinds = index.layout[timed]
        for k, (place, factor) in elsewhere.items():
            mine = (kinds == k).nonzero()[0]
            dtype = np.dtype("<i8" if factor == 1 else "<u4")
            time[mine] = gather(data, at[mine] + np.int64(place), dtype).astype(np.int64) * factor
    return at, time


def table_timeline(messages: Messages, formats: Mapping[str, MessageFormat]) -> Timeline:
    """Return the timeline of a text log's tables; ``formats`` by message name."""
    found = []
    for (name, _), table in messages.items():
        if column := time_column(formats[name]):
            with suppress(KeyError):  # reported among the remarks
                counts, factor = table[column[0]], column[1]
                found.append((table.offsets, np.where(counts <= LAST_TIME_US // factor, counts * factor, -1)))
    at, time = merge_timelines(found)
    possible = (time >= 0) & (time <= LAST_TIME_US)
    return at[possible], time[possible]


def drop_false_times(index: RecordIndex, at: Offsets, time: NDArray[np.int64]) -> tuple[Offsets, NDArray[np.int64]]:
    """Remove records with false times from timeline and index, and report them as damage.

    DataFlash has no checksum: a false time is the only sign of changed bytes within a record.
    """
    far = false_times(time)
    if len(far) == 0:
        return at, time
    records = index.offsets.searchsorted(at[far])
    impossible = (time[far] < 0) | (time[far] > LAST_TIME_US)
    false = np.zeros(len(index.offsets), np.bool_)
    false[records[impossible]] = True
    flagged = np.bincount(index.layout[records], minlength=len(index.layouts))
    every = np.bincount(index.layout, minlength=len(index.layouts))
    # a message with many false times has another clock and is kept
    damaged = (flagged < 3) | (flagged < 0.1 * every)
    false[records[damaged[index.layout[records]]]] = True
    kept = np.ones(len(at), np.bool_)
    kept[at.searchsorted(index.offsets[false])] = False
    for offset, layout in zip(index.offsets[false].tolist(), index.layout[false].tolist(), strict=True):
        fmt = index.layouts[layout]
        lost = f"a {fmt.name} record whose time is far from that of its neighbours"
        index.losses.add(offset, fmt.length, lost, f"next record at {offset + fmt.length}")
    index.offsets, index.layout = index.offsets[~false], index.layout[~false]
    return at[kept], time[kept]
