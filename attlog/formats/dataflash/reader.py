"""Read ArduPilot's DataFlash logs, binary (``.bin``) and text (``.log``).

Layout: ArduPilot, libraries/AP_Logger/LogStructure.h. An FMT record describes every type, since 3.6 also FMTU (one unit
and one multiplier id per column, defined by UNIT and MULT). Deliberate differences from pymavlink's reader: formats
are valid from their place in the file on, records with invalid framing are left out and counted, times are as logged.
Text logs (ArduPilot 3.x, libraries/DataFlash) have lines ``NAME, value, value``: values are already scaled, modes are
names, and a banner may precede the first FMT line. Lines with an unreadable number are left out.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import LogUnusable
from attlog.core.limits import (
    MAX_CELL_BYTES,
    MAX_LETTERS,
    MAX_NAME_LENGTH,
    MAX_TEXT_FORMATS,
    MAX_TEXT_LENGTH,
    MAX_TEXTS,
)
from attlog.core.timestamps import Offsets, restarts
from attlog.formats.dataflash.layout import (
    FMT_FORMAT,
    FMT_LENGTH,
    FMT_MARK,
    HEADER_BYTES,
    LETTER_DTYPES,
    MessageFormat,
    column_names,
)
from attlog.formats.dataflash.tables import (
    INFO_SEVERITY,
    Units,
    build_tables,
    drop_false_times,
    instance_column,
    read_params,
    read_texts,
    read_units,
    record_timeline,
    report_unreadable,
    split_by_number,
    table_timeline,
    time_column,
)
from attlog.formats.dataflash.walk import RecordIndex, index_records
from attlog.formats.file_bytes import decode_text, gather, read_file_bytes
from attlog.formats.table import Boot, DamageLog, Field, Messages, Table, Text, boots_at, boots_of_timeline

__all__ = ["read_binary"]


# Name and letters of the message with all times in PX4 logs of 2013 to 2016.
SDLOG2_CLOCK = ("TIME", "Q")


def read_binary(path: str | Path, *, data: NDArray[np.uint8] | None = None) -> Messages:
    """Return a DataFlash binary log; ``data`` are its bytes if mapped.

    Instances come from the column that FMTU marks ``#``, else from
    :data:`attlog.formats.dataflash.tables.INSTANCE_COLUMNS`; the older ``IMU2`` or ``MAG2`` stay names of their own.
    ``Field.scale`` belongs to the letters c C e E L. ``Field.unit`` is the unit of the printed number: the rest of
    FMTU's multiplier becomes a prefix or a factor in the text (``mGauss``, ``us``, ``100 m``). LogUnusable if no format
    is defined, for example in a file that starts in the middle.
    """
    path = Path(path)
    data = read_file_bytes(path) if data is None else data
    index = index_records(data)
    if len(index.layouts) < 2 or not np.any(index.layout > 0):
        if data[: len(FMT_MARK)].tobytes() == FMT_MARK and len(data) <= 256 * FMT_LENGTH:
            raise LogUnusable(f"{path}: the file ends after {len(data):,} bytes, before any data; copy it again")
        raise LogUnusable(
            f"{path}: no FMT record describes any data, so nothing can be decoded; a log must contain its beginning."
        )
    if any((fmt.name, fmt.letters) == SDLOG2_CLOCK for fmt in index.layouts):
        raise LogUnusable(f"{path}: a log of PX4's sdlog2 (2013 to 2016), which attlog no longer reads")
    at, time = record_timeline(data, index)
    at, time = drop_false_times(index, at, time)
    boots = _find_boots(data, index, at, time)
    clock = (at[:0].copy(), time[:0].copy()) if _carry_their_time(index.layouts) else (at, time)
    del at, time  # before the tables, which take as much memory
    losses = index.losses
    units: Units = {}
    with losses.around("FMTU", "units and instances", None):
        units = read_units(data, index)
    tables = build_tables(data, index, units)
    report_unreadable(index)
    messages = Messages(path, "dataflash", len(data), tables, losses=losses, boots=boots)
    messages.params = lambda log: losses.list_or_empty("PARM", "parameters", lambda: read_params(log, clock))
    messages.texts = lambda log: losses.list_or_empty("MSG", "texts", lambda: read_texts(log, clock))
    version = messages.first("VER")
    if version is not None:
        with losses.around("VER", "versions", int(version.offsets[0])):
            first = {name: version[name][0] for name in version.fields}
            messages.info["VER"] = {
                name: decode_text(value) if isinstance(value, bytes) else value.tolist()
                for name, value in first.items()
            }
    return messages


def _carry_their_time(layouts: list[MessageFormat]) -> bool:
    """Return whether parameters and texts have their own stamps."""
    return all(
        time_column(fmt) == ("TimeUS", 1) and "q" not in fmt.letters
        for fmt in layouts
        if fmt.name in ("PARM", "MSG") and fmt.readable
    )


def _find_boots(data: NDArray[np.uint8], index: RecordIndex, at: Offsets, time: NDArray[np.int64]) -> list[Boot]:
    """Return the power-ups of the file.

    A boot begins where the clock restarts or a new block of formats begins.
    """
    starts = {0}
    for k in restarts(time):
        # records without stamp (formats, parameters) precede the first stamp of a boot
        first = int(np.searchsorted(index.offsets, at[k - 1])) + 1
        starts.add(int(index.offsets[first]))
    defined = index.offsets[index.layout == 0]
    own = defined[gather(data, defined + HEADER_BYTES, np.dtype("u1")) == index.layouts[0].type]
    starts.update(own[1:].tolist())
    # an FMT block and the first earlier time show the same restart if no timed record lies between them
    joined = [0]
    for edge in sorted(starts)[1:]:
        timed = np.searchsorted(at, [joined[-1], edge])
        if timed[1] > timed[0]:
            joined.append(edge)
    return boots_at(joined[1:], len(data))


_TEXT_LETTERS = "nNZMa"  # M is the name of a mode; arrays are printed in a form of their own
# Every quantifier is possessive, so that a line is matched in one pass.
_DIGITS_PATTERN = rb"\d{1,320}+(?:\.\d{0,320}+)?+(?:e[-+]?+\d{1,4}+)?+|\.\d{1,320}+"
_NUMBER_PATTERN = rb"[ \t]*+[-+]?+(?>" + _DIGITS_PATTERN + rb"|nan|inf(?:inity)?+)[ \t]*+"
_INTEGER_PATTERN = rb"[ \t]*+[-+]?+\d{1,18}+[ \t]*+"  # fits int64
_ANY_PATTERN = rb"[^,]*+"


def read_text(path: str | Path, *, data: NDArray[np.uint8] | None = None) -> Messages:
    """Return a text log, columns split and converted on demand.

    ``data`` are its bytes if mapped. ``info["banner"]`` holds the lines before the first FMT line. Numbers are int64 or
    float64 as printed, text is bytes, at most :data:`attlog.core.limits.MAX_CELL_BYTES`. Memory: the file once, 16
    bytes per line, and the decoded columns. LogUnusable without an FMT line.
    """
    path = Path(path)
    data = read_file_bytes(path) if data is None else data
    lines = _SortedLines(data.tobytes())
    if not lines.formats:
        raise LogUnusable(f"{path}: no FMT line describes the values, so the text cannot be read as a log.")
    losses = lines.losses
    messages = Messages(path, "dataflash_text", len(data), lines.tables(), losses=losses)
    messages.info["banner"] = lines.banner
    timeline = table_timeline(messages, lines.formats)
    messages.params = losses.list_or_empty("PARM", "parameters", lambda: read_params(messages, timeline))
    banner = [Text(line, INFO_SEVERITY, None, 0) for line in lines.banner]
    texts = losses.list_or_empty("MSG", "texts", lambda: read_texts(messages, timeline))
    messages.texts = [*banner, *texts][:MAX_TEXTS]
    messages.boots = boots_of_timeline(timeline, len(data))
    return messages


def parse_fmt_line(line: bytes) -> MessageFormat | None:
    """Parse an FMT line, None if invalid.

    Some converters insert further values before the column list, which begins with the last value behind a blank.
    """
    cells = line.split(b",", 5)
    try:
        kind, length = int(cells[1]), int(cells[2])
        name, letters = cells[3].strip().decode("ascii"), cells[4].strip().decode("ascii")
    except (IndexError, ValueError):
        return None
    if kind == FMT_FORMAT.type:
        return FMT_FORMAT
    if not name or not name.isprintable() or len(name) > MAX_NAME_LENGTH or len(letters) > MAX_LETTERS:
        return None
    listed = cells[5].decode("latin-1") if len(cells) > 5 else ""
    listed = listed.rpartition(", ")[2] if ", " in listed.strip() else listed
    columns = column_names(c.strip(' "\r') for c in listed.split(",", MAX_LETTERS)) if listed.strip() else ()
    usable = (c if c.isprintable() and len(c) <= MAX_NAME_LENGTH else "" for c in columns[: len(letters)])
    return MessageFormat(kind, length, name, letters, tuple(usable), 0)


class _SortedLines:
    """The lines of a file by message: offset, and length without trailing blanks."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.formats: dict[str, MessageFormat] = {}
        self.banner: list[str] = []
        self.losses = DamageLog()
        self._found: dict[str, tuple[array[int], array[int]]] = {}
        self._sort()

    def _sort(self) -> None:
        patterns: dict[bytes, re.Pattern[bytes]] = {}
        waiting: dict[bytes, MessageFormat] = {}  # a pattern takes the time of a thousand lines
        found: dict[bytes, tuple[array[int], array[int]]] = {}
        offset = 0
        for line in BytesIO(self.raw):
            name = line.partition(b",")[0]
            pattern = patterns.get(name)
            if pattern is None and name in waiting:
                pattern = patterns[name] = _line_pattern(waiting.pop(name))
            if pattern is not None:
                text = line.rstrip()
                if pattern.fullmatch(text):
                    offsets, lengths = found[name]
                    offsets.append(offset)
                    lengths.append(len(text))
                else:
                    self._lose(offset, line, f"line of {name.decode('latin-1')} that is cut or mixed with another")
            elif name == b"FMT":
                fmt = parse_fmt_line(line)
                if fmt is None:
                    self._lose(offset, line, "unreadable FMT line")
                elif len(self.formats) >= MAX_TEXT_FORMATS and fmt.name not in self.formats:
                    self._lose(offset, line, f"format beyond the {MAX_TEXT_FORMATS} that a log can have")
                elif fmt.name not in self.formats and all(letter in LETTER_DTYPES for letter in fmt.letters):
                    self.formats[fmt.name] = fmt
                    if fmt.name != "FMT":
                        waiting[fmt.name.encode()] = fmt
                        found[fmt.name.encode()] = (array("q"), array("q"))
            elif line.strip():
                if self.formats or len(self.banner) >= MAX_TEXTS:
                    self._lose(offset, line, "line of a message without FMT")
                else:
                    self.banner.append(decode_text(line[: 4 * MAX_TEXT_LENGTH].strip())[:MAX_TEXT_LENGTH])
            offset += len(line)
        self._found = {name.decode(): rows for name, rows in found.items()}

    def _lose(self, offset: int, line: bytes, lost: str) -> None:
        self.losses.add(offset, len(line), lost, "next line")

    def tables(self) -> dict[tuple[str, int], Table]:
        """Return the tables by (name, instance), in file order."""
        tables: dict[tuple[str, int], Table] = {}
        for name, (offsets, lengths) in self._found.items():
            if offsets:
                with self.losses.around(name, "its lines", offsets[0]):
                    at, length = np.frombuffer(offsets, np.int64), np.frombuffer(lengths, np.int64)
                    tables.update(self._of_message(name, at, length))
        return dict(sorted(tables.items(), key=lambda item: int(item[1].offsets[0])))

    def _of_message(self, name: str, at: NDArray[np.int64], length: NDArray[np.int64]) -> dict[tuple[str, int], Table]:
        fmt = self.formats[name]
        fields = _line_fields(fmt)
        decode = _line_decoder(fmt, at, length, self.raw)
        whole = Table(name, 0, fields, at, decode, self.losses)
        column = instance_column(fmt, "")
        split = None if column is None else split_by_number(whole[column])
        if split is None:
            return {(name, 0): whole}
        return {(name, number): Table(name, number, fields, at[mine], decode, self.losses) for number, mine in split}


def _line_pattern(fmt: MessageFormat) -> re.Pattern[bytes]:
    """Return the pattern of a line; extra values are allowed, and a last text may contain commas."""
    whole = re.escape(fmt.name.encode())
    for cell, alike in groupby(map(_cell_pattern, fmt.letters)):  # short patterns compile faster
        whole += rb"(?:,%b){%d}+" % (cell, len(list(alike)))
    return re.compile(whole + rb"(?:,.*+)?+", re.IGNORECASE)


def _cell_pattern(letter: str) -> bytes:
    """Return the pattern of a value: an integer for unscaled integers, else a decimal number."""
    if letter in _TEXT_LETTERS:
        return _ANY_PATTERN
    return _INTEGER_PATTERN if _is_integer_letter(letter) else _NUMBER_PATTERN


def _is_integer_letter(letter: str) -> bool:
    return letter in "bBhHiIqQ"


def _letter_dtype(letter: str) -> np.dtype[Any]:
    """Return the type of a printed value."""
    if letter in _TEXT_LETTERS:
        return np.dtype("S64")
    return np.dtype(np.int64 if _is_integer_letter(letter) else np.float64)


def _line_fields(fmt: MessageFormat) -> dict[str, Field]:
    pairs = zip(fmt.letters, fmt.columns, strict=False)
    return {column: Field(column, _letter_dtype(letter)) for letter, column in pairs if column}


def _line_decoder(
    fmt: MessageFormat, at: NDArray[np.int64], length: NDArray[np.int64], raw: bytes
) -> Callable[[str, NDArray[np.int64]], NDArray[Any]]:
    """Return a function that converts one column of the lines at some offsets."""
    last = len(fmt.letters) - 1

    def decode(column: str, offsets: NDArray[np.int64]) -> NDArray[Any]:
        k = fmt.columns.index(column)
        # the last text of a line keeps its commas
        splits = last + 1 if k == last and fmt.letters[k] in _TEXT_LETTERS else k + 2
        lengths = length if len(offsets) == len(at) else length[np.searchsorted(at, offsets)]
        spans = zip(offsets.tolist(), (offsets + lengths).tolist(), strict=True)
        cells = [raw[begin:end].split(b",", splits)[k + 1].strip() for begin, end in spans]
        if fmt.letters[k] in _TEXT_LETTERS:
            cells = [cell[:MAX_CELL_BYTES] for cell in cells]
            return np.array(cells, f"S{max(map(len, cells), default=1) or 1}")
        convert: Callable[[bytes], float] = int if _is_integer_letter(fmt.letters[k]) else float
        return np.fromiter(map(convert, cells), _letter_dtype(fmt.letters[k]), len(cells))

    return decode
