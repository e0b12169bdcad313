"""Reads and writes ArduPilot's DataFlash binary logs (``.bin``).

Layout: ArduPilot, libraries/AP_Logger/LogStructure.h. Every type is described by
an FMT record, from 3.6 on also by FMTU (one unit and one multiplier id per
column, spelled out by UNIT and MULT). Deliberate differences from pymavlink's
reader: formats hold from their place in the file on, records that do not frame
are left out and counted, times are the logged ones.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.errors import LogUnusable
from attlog.formats.base import Boot, Damage, Field, Messages, ParamChange, Table, Text
from attlog.formats.clock import restarts, times_before
from attlog.formats.dataflash_index import HEADER_LENGTH, LETTER_DTYPES, LETTER_SCALES, Format, Index, index_records
from attlog.formats.dataflash_write import write
from attlog.formats.mapping import Records, gather, map_bytes, text_of
from attlog.limits import MAX_DAMAGE, MAX_PARAM_CHANGES, MAX_TEXT_LENGTH, MAX_TEXTS, MAX_TIME_JUMP_S

__all__ = ["INFO", "build_tables", "instance_column", "read", "time_column", "timeline", "unreadable", "write"]

INFO = 6  # syslog severity; MSG records carry none

INSTANCE_COLUMNS = ("I", "Instance", "Inst", "C", "IMU")
"""Names of one-byte columns that number sensors or estimator cores, for logs without FMTU (ArduPilot 3.x, 4.0)."""

FALSE_TIME_US = 5_000_000
"""A single record further than this from two neighbours that agree is false; no undamaged log has one beyond 0.1 s."""

LAST_TIME_US = 1 << 56
"""Boot clocks and even Unix clocks stay below; random bytes hardly ever do."""

_PREFIXES = {1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n", 1e3: "k"}


def read(path: str | Path) -> Messages:
    """The messages of a DataFlash binary log, columns decoded on demand.

    Instances come from the column that FMTU marks ``#``, else from
    :data:`INSTANCE_COLUMNS`; the older ``IMU2`` or ``MAG2`` stay names of their own.
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
    at, time = _drop_false_times(index, at, time)
    units = _units(data, index)
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


# --- tables -----------------------------------------------------------------------------------------------------


def fields_of(fmt: Format, units: tuple[str | None, ...] = ()) -> tuple[dict[str, Field], np.dtype[Any]]:
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


def _decoder(data: NDArray[np.uint8], record: np.dtype[Any]) -> Records:
    return Records(lambda offsets: gather(data, offsets, record))


def build_tables(
    data: NDArray[np.uint8],
    index: Index,
    units: dict[int, tuple[str, tuple[str | None, ...]]] | None = None,
    by_instance: bool = True,
) -> dict[tuple[str, int], Table]:
    """The tables of an index by (name, instance), in the order in which their first records stand in the file.

    ``units`` gives for a layout its unit ids and the unit of each column.
    """
    units = units or {}
    order = np.argsort(index.layout, kind="stable")
    bounds = np.searchsorted(index.layout[order], np.arange(len(index.layouts) + 1))
    parts: dict[tuple[str, int], list[Table]] = {}
    for k, fmt in enumerate(index.layouts):
        offsets = index.offsets[order[bounds[k] : bounds[k + 1]]]
        if len(offsets) == 0 or not fmt.readable:
            continue
        ids, texts = units.get(k, ("", ()))
        fields, record = fields_of(fmt, texts)
        whole = Table(fmt.name, 0, fields, offsets, _decoder(data, record))
        column = instance_column(fmt, ids) if by_instance else None
        if column is None:
            parts.setdefault((fmt.name, 0), []).append(whole)
            continue
        place = fmt.place(fmt.columns.index(column))
        number = gather(data, offsets + place, fields[column].dtype)
        for instance in _distinct(number):
            part = Table(fmt.name, instance, fields, offsets[number == instance], _decoder(data, record))
            parts.setdefault((fmt.name, instance), []).append(part)
    tables = {key: found[0] if len(found) == 1 else MixedTable(found) for key, found in parts.items()}
    return dict(sorted(tables.items(), key=lambda item: int(item[1].offsets[0])))


def _distinct(number: NDArray[np.integer[Any]]) -> list[int]:
    """The different values, ascending; bytes are counted instead of sorted."""
    if number.dtype == np.uint8:
        return np.flatnonzero(np.bincount(number, minlength=256)).tolist()
    return np.unique(number).tolist()


def instance_column(fmt: Format, unit_ids: str) -> str | None:
    """The column that tells the instance, None if there is none."""
    for letter, column, unit in zip(fmt.letters, fmt.columns, unit_ids, strict=False):
        if unit == "#" and LETTER_DTYPES[letter].kind in "iu" and column:
            return column
    for letter, column in zip(fmt.letters, fmt.columns, strict=False):
        if letter in "bB" and column in INSTANCE_COLUMNS:
            return column
    return None


class MixedTable(Table):
    """Records of one message whose layout changed inside the file, as in joined logs of two firmwares.

    A column that not all layouts have, or have with another type or scale, reads
    as float64 of the printed values, NaN where it does not exist. ``rows`` within
    one layout gives that layout's plain table.
    """

    def __init__(self, parts: list[Table]) -> None:
        self._parts = parts
        fields: dict[str, Field] = {}
        for part in parts:
            for name, field in part.fields.items():
                known = fields.setdefault(name, field)
                if known.dtype.kind == field.dtype.kind == "S" and field.dtype.itemsize > known.dtype.itemsize:
                    fields[name] = field
        for name, field in fields.items():
            same = all(name in p and (p.fields[name].dtype, p.fields[name].scale) == (field.dtype, field.scale)
                       for p in parts)  # fmt: skip
            if not same and field.dtype.kind in "iuf" and field.dtype.shape == ():
                fields[name] = Field(name, np.dtype(np.float64), field.unit)
        offsets = np.sort(np.concatenate([p.offsets for p in parts]))
        super().__init__(parts[0].name, parts[0].instance, fields, offsets, self._mixed)

    def _mixed(self, column: str, offsets: NDArray[np.int64]) -> NDArray[Any]:
        dtype = self.fields[column].dtype
        blank = np.nan if dtype.kind == "f" else 0
        result = np.full((len(offsets), *dtype.shape), b"" if dtype.kind == "S" else blank, dtype.base)
        for part in self._parts:
            if column not in part:
                continue
            field = part.fields[column]
            if (field.dtype.kind == "S", field.dtype.shape) != (dtype.kind == "S", dtype.shape):
                continue  # the same name for something else
            mine = np.isin(offsets, part.offsets, assume_unique=True)
            inside = part.rows(np.isin(part.offsets, offsets, assume_unique=True))
            as_stored = dtype.kind == "S" or (field.dtype, field.scale) == (dtype, self.fields[column].scale)
            result[mine] = inside[column] if as_stored else inside.value(column)
        return result

    def rows(self, select: NDArray[Any] | slice) -> Table:
        """The same message, only the selected records; a plain table if they share one layout."""
        offsets = self.offsets[select]
        parts = [p.rows(np.isin(p.offsets, offsets, assume_unique=True)) for p in self._parts]
        parts = [p for p in parts if len(p)] or parts[:1]
        return parts[0] if len(parts) == 1 else MixedTable(parts)


def unreadable(index: Index) -> list[Damage]:
    """What is lost to formats whose letters do not give their length."""
    counts = np.bincount(index.layout, minlength=len(index.layouts))
    return [
        Damage(fmt.offset, int(count) * fmt.length,
               f"{count} {fmt.name} records: the format {fmt.letters!r} does not have {fmt.length} bytes",
               "framing goes on by the declared length")
        for fmt, count in zip(index.layouts, counts.tolist(), strict=True)
        if count and not fmt.readable
    ]  # fmt: skip


# --- units ------------------------------------------------------------------------------------------------------


def _units(data: NDArray[np.uint8], index: Index) -> dict[int, tuple[str, tuple[str | None, ...]]]:
    """For each layout that FMTU describes: its unit ids, and the unit text of every column."""
    small = {"FMTU", "UNIT", "MULT"}
    chosen = np.isin(index.layout, [k for k, f in enumerate(index.layouts) if f.name in small])
    some = Index(index.layouts, index.offsets[chosen], index.layout[chosen])
    tables = build_tables(data, some, by_instance=False)
    described = tables.get(("FMTU", 0))
    if described is None or not {"FmtType", "UnitIds", "MultIds"} <= described.fields.keys():
        return {}
    names = {chr(i & 0xFF): text_of(t) for i, t in _pairs(tables.get(("UNIT", 0)), "Label")}
    factors = {chr(i & 0xFF): float(m) for i, m in _pairs(tables.get(("MULT", 0)), "Mult")}
    by_type: dict[int, list[int]] = {}
    for k, fmt in enumerate(index.layouts):
        by_type.setdefault(fmt.type, []).append(k)
    unit_text = cache(_unit_text)  # the same few combinations in every message
    result = {}
    rows = zip(*(described[c].tolist() for c in ("FmtType", "UnitIds", "MultIds")), described.offsets, strict=True)
    for kind, unit_ids, mult_ids, offset in rows:
        mine = by_type.get(kind)
        if not mine:
            continue
        fmt_at = max((k for k in mine if index.layouts[k].offset < offset), default=mine[0])
        ids, mults = text_of(unit_ids), text_of(mult_ids)
        letters = index.layouts[fmt_at].letters
        texts = tuple(
            unit_text(names.get(u, ""), u, factors.get(m, 0.0), m, LETTER_SCALES.get(letter, 1.0))
            for letter, u, m in zip(letters, ids, mults.ljust(len(ids), "-"), strict=False)
        )
        result[fmt_at] = (ids, texts)
    return result


def _pairs(table: Table | None, column: str) -> list[tuple[int, Any]]:
    """Id and value of UNIT or MULT records."""
    if table is None or not {"Id", column} <= table.fields.keys():
        return []
    return list(zip(table["Id"].tolist(), table[column].tolist(), strict=True))


def _unit_text(name: str, unit_id: str, factor: float, mult_id: str, scale: float) -> str | None:
    """The unit of the printed number, None if the log does not tell.

    Logged value times multiplier is in ``name``. The letter's scale is often part
    of the multiplier already (c with B = 0.01, L with G = 1e-7) or the multiplier
    is left at 1 beside a scaled letter: both mean that the printed number is in
    ``name``. What remains becomes an SI prefix or a factor.
    """
    if unit_id in "-?#" or mult_id == "?" or not name:
        return None
    if mult_id == "-" or factor == 0.0 or (scale != 1.0 and factor == 1.0):
        return name
    rest = float(f"{factor / scale:.6g}")
    if rest == 1.0:
        return name
    return _PREFIXES[rest] + name if rest in _PREFIXES else f"{rest:g} {name}"


# --- time -------------------------------------------------------------------------------------------------------


def time_column(fmt: Format) -> tuple[str, int] | None:
    """Column of a format's boot clock and microseconds per count, None if it has none."""
    letters = dict(zip(fmt.columns, fmt.letters, strict=False))
    if letters.get("TimeUS") in ("Q", "q"):
        return "TimeUS", 1
    # in GPS records of 3.1 and 3.2, TimeMS is the time of the GPS week and T the boot clock
    column = "T" if "Week" in letters or "GWk" in letters else "TimeMS"
    return (column, 1000) if letters.get(column) in ("I", "i") else None


def timeline(data: NDArray[np.uint8], index: Index) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Offset and boot time (us) of every record that carries its time, in file order."""
    columns = [time_column(fmt) if fmt.readable else None for fmt in index.layouts]
    at = []
    time = []
    for dtype, factor in ((np.dtype("<i8"), 1), (np.dtype("<u4"), 1000)):
        place = np.array(
            [
                fmt.place(fmt.columns.index(column[0])) if column and column[1] == factor else 0
                for fmt, column in zip(index.layouts, columns, strict=True)
            ],
            np.uint8,
        )
        if place.any():
            places = place[index.layout]
            timed = np.flatnonzero(places)
            at.append(index.offsets[timed])
            time.append(gather(data, at[-1] + places[timed], dtype).astype(np.int64) * factor)
    if not at:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    if len(at) == 1:
        return at[0], time[0]
    order = np.argsort(np.concatenate(at), kind="stable")
    return np.concatenate(at)[order], np.concatenate(time)[order]


def _drop_false_times(
    index: Index, at: NDArray[np.int64], time: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The timeline without single records whose time is far from both neighbours; they leave the index as damage.

    DataFlash has no checksum, so this is the one sign of a record whose bytes were changed.
    """
    if len(time) < 3:
        return at, time
    step = np.abs(np.diff(time)) > FALSE_TIME_US
    far = np.concatenate([[step[0] and not step[1]], step[:-1] & step[1:], [step[-1] and not step[-2]]])
    far[1:-1] &= np.abs(time[2:] - time[:-2]) <= FALSE_TIME_US
    far[[0, -1]] &= np.abs(time[[0, -1]] - time[[1, -2]]) > MAX_TIME_JUMP_S * 1e6  # a hole may stand at the ends
    far |= (time < 0) | (time > LAST_TIME_US)
    if not far.any():
        return at, time
    false = np.isin(index.offsets, at[far])
    for offset, layout in zip(index.offsets[false].tolist(), index.layout[false].tolist(), strict=True):
        fmt = index.layouts[layout]
        index.damage_bytes += fmt.length
        if len(index.damage) < MAX_DAMAGE:
            lost = f"a {fmt.name} record whose time is far from that of its neighbours"
            index.damage.append(Damage(offset, fmt.length, lost, f"next record at {offset + fmt.length}"))
    index.damage.sort(key=lambda d: d.offset)
    index.offsets, index.layout = index.offsets[~false], index.layout[~false]
    return at[~far], time[~far]


def _boots(data: NDArray[np.uint8], index: Index, at: NDArray[np.int64], time: NDArray[np.int64]) -> list[Boot]:
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


# --- parameters and texts ---------------------------------------------------------------------------------------


def _times_of(table: Table, at: NDArray[np.int64], time: NDArray[np.int64]) -> list[int | None]:
    """The time of each record, from its own stamp or else from the record before it."""
    if "TimeUS" in table:
        return table["TimeUS"].tolist()
    return times_before(table.offsets, at, time)


def _params(messages: Messages, at: NDArray[np.int64], time: NDArray[np.int64]) -> list[ParamChange]:
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


def _texts(messages: Messages, at: NDArray[np.int64], time: NDArray[np.int64]) -> list[Text]:
    """MSG records: banner and events."""
    table = messages.first("MSG")
    if table is None or "Message" not in table:
        return []
    table = table.rows(slice(MAX_TEXTS))
    rows = zip(table["Message"].tolist(), _times_of(table, at, time), table.offsets.tolist(), strict=True)
    return [Text(text_of(raw)[:MAX_TEXT_LENGTH], INFO, t_us, offset) for raw, t_us, offset in rows]
