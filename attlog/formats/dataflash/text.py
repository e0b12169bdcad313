"""Reads ArduPilot's text logs (``.log``): lines ``NAME, value, value``, described by FMT lines.

The values are scaled already (c, C, e, E, L), modes are names, and a banner may
stand before the first FMT line. A line counts only if every number in it can be
read; others are damage. Source: ArduPilot 3.x, libraries/DataFlash.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.errors import LogUnusable
from attlog.formats.base import Damage, Field, Messages, Table, Text
from attlog.formats.clock import boots
from attlog.formats.dataflash.clock import timeline_of_tables
from attlog.formats.dataflash.content import INFO, params, texts
from attlog.formats.dataflash.index import FMT_FORMAT, LETTER_DTYPES, Format
from attlog.formats.dataflash.tables import instance_column
from attlog.formats.mapping import map_bytes, text_of
from attlog.limits import MAX_DAMAGE, MAX_FORMATS, MAX_TEXT_LENGTH, MAX_TEXTS

_TEXT_LETTERS = "nNZMa"  # M is a mode name in text logs; arrays are printed in a form of their own
_NUMBER = rb"[ \t]*[-+]?(?:\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+|nan|inf(?:inity)?)[ \t]*"
_INTEGER = rb"[ \t]*[-+]?\d{1,18}[ \t]*"  # what int64 holds for sure
_ANY = rb"[^,]*"


def read(path: str | Path, *, data: NDArray[np.uint8] | None = None) -> Messages:
    """The messages of a text log, columns split and converted on demand; ``data`` are its bytes if mapped already.

    ``info["banner"]`` holds the lines before the first FMT line. Numbers are int64
    or float64 as printed, text is bytes. Memory: about four times the file, since
    the lines are kept. LogUnusable if there is no FMT line.
    """
    path = Path(path)
    data = map_bytes(path) if data is None else data
    lines = _Lines(data.tobytes())
    if not lines.formats:
        raise LogUnusable(f"{path}: no FMT line describes the values, so the text cannot be read as a log.")
    messages = Messages(path, "dataflash_text", len(data), lines.tables())
    messages.damage, messages.damage_bytes = lines.damage, lines.damage_bytes
    messages.info["banner"] = lines.banner
    timeline = timeline_of_tables(messages, lines.formats)
    messages.params = params(messages, timeline)
    messages.texts = [*(Text(line, INFO, None, 0) for line in lines.banner), *texts(messages, timeline)][:MAX_TEXTS]
    messages.boots = boots(timeline, len(data))
    return messages


def parse_format(line: bytes) -> Format | None:
    """The Format in an FMT line, None if it is none.

    Some converters put further values before the column list: the list is what
    begins with the last value that is set off by a blank.
    """
    cells = line.split(b",", 5)
    try:
        kind, length = int(cells[1]), int(cells[2])
        name, letters = cells[3].strip().decode("ascii"), cells[4].strip().decode("ascii")
    except (IndexError, ValueError):
        return None
    if kind == FMT_FORMAT.type:
        return FMT_FORMAT
    listed = cells[5].decode("latin-1") if len(cells) > 5 else ""
    listed = listed.rpartition(", ")[2] if ", " in listed.strip() else listed
    columns = tuple(c.strip(' "\r') for c in listed.split(",")) if listed.strip() else ()
    return Format(kind, length, name, letters, columns, 0)


class _Lines:
    """The lines of a file, sorted by message."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.formats: dict[str, Format] = {}
        self.banner: list[str] = []
        self.damage: list[Damage] = []
        self.damage_bytes = 0
        self._found: dict[str, tuple[list[int], list[bytes]]] = {}
        self._sort()

    def _sort(self) -> None:
        patterns: dict[bytes, re.Pattern[bytes]] = {}
        found: dict[bytes, tuple[list[int], list[bytes]]] = {}
        offset = 0
        for line in self.raw.split(b"\n"):
            name = line.partition(b",")[0]
            pattern = patterns.get(name)
            if pattern is not None:
                text = line.rstrip()
                if pattern.fullmatch(text):
                    offsets, kept = found[name]
                    offsets.append(offset)
                    kept.append(text)
                else:
                    self._lose(offset, line, f"line of {name.decode('latin-1')} that is cut or mixed with another")
            elif name == b"FMT":
                fmt = parse_format(line)
                if fmt is None or len(patterns) >= MAX_FORMATS:
                    self._lose(offset, line, "unreadable FMT line")
                elif fmt.name not in self.formats and all(letter in LETTER_DTYPES for letter in fmt.letters):
                    self.formats[fmt.name] = fmt
                    if fmt.name != "FMT":
                        patterns[fmt.name.encode()] = _pattern(fmt)
                        found[fmt.name.encode()] = ([], [])
            elif line.strip():
                if self.formats:
                    self._lose(offset, line, "line of a message without FMT")
                else:
                    self.banner.append(text_of(line.strip())[:MAX_TEXT_LENGTH])
            offset += len(line) + 1
        self._found = {name.decode(): rows for name, rows in found.items()}

    def _lose(self, offset: int, line: bytes, lost: str) -> None:
        self.damage_bytes += len(line) + 1
        if len(self.damage) < MAX_DAMAGE:
            self.damage.append(Damage(offset, len(line) + 1, lost, "next line"))

    def tables(self) -> dict[tuple[str, int], Table]:
        """The tables by (name, instance), in the order in which their first lines stand in the file."""
        tables: dict[tuple[str, int], Table] = {}
        for name, (offsets, lines) in self._found.items():
            if not offsets:
                continue
            fmt = self.formats[name]
            at = np.array(offsets, np.int64)
            fields = _fields(fmt)
            decode = _decoder(fmt, at, lines)
            whole = Table(name, 0, fields, at, decode)
            column = instance_column(fmt, "")
            if column is None:
                tables[name, 0] = whole
                continue
            number = whole[column]
            for instance in np.unique(number).tolist():
                tables[name, instance] = Table(name, instance, fields, at[number == instance], decode)
        return dict(sorted(tables.items(), key=lambda item: int(item[1].offsets[0])))


def _pattern(fmt: Format) -> re.Pattern[bytes]:
    """What a whole line of a message looks like; further values are allowed, a last text may contain commas."""
    cells = []
    for letter in fmt.letters:
        if letter in _TEXT_LETTERS:
            cells.append(_ANY)
        else:
            # unscaled integers are printed as such, all others in decimal
            cells.append(_INTEGER if _is_integer(letter) else _NUMBER)
    return re.compile(b",".join([re.escape(fmt.name.encode()), *cells]) + rb"(?:,.*)?", re.IGNORECASE)


def _is_integer(letter: str) -> bool:
    return letter in "bBhHiIqQ"


def _dtype(letter: str) -> np.dtype[Any]:
    """The type of a printed value."""
    if letter in _TEXT_LETTERS:
        return np.dtype("S64")
    return np.dtype(np.int64 if _is_integer(letter) else np.float64)


def _fields(fmt: Format) -> dict[str, Field]:
    pairs = zip(fmt.letters, fmt.columns, strict=False)
    return {column: Field(column, _dtype(letter)) for letter, column in pairs if column}


def _decoder(
    fmt: Format, at: NDArray[np.int64], lines: list[bytes]
) -> Callable[[str, NDArray[np.int64]], NDArray[Any]]:
    """Converts one column of the lines at some offsets."""
    last = len(fmt.letters) - 1

    def decode(column: str, offsets: NDArray[np.int64]) -> NDArray[Any]:
        k = fmt.columns.index(column)
        # the last text of a line keeps its commas
        splits = last + 1 if k == last and fmt.letters[k] in _TEXT_LETTERS else k + 2
        chosen = lines if len(offsets) == len(lines) else [lines[i] for i in np.searchsorted(at, offsets).tolist()]
        cells = [line.split(b",", splits)[k + 1].strip() for line in chosen]
        if fmt.letters[k] in _TEXT_LETTERS:
            return np.array(cells, f"S{max(map(len, cells), default=1) or 1}")
        return np.array(cells, "S").astype(_dtype(fmt.letters[k]))

    return decode
