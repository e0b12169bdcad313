"""Writes DataFlash binary logs from columns: formats, units, parameters, data merged by time, texts."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.errors import UsageError
from attlog.formats.base import ParamChange, Text
from attlog.formats.dataflash.index import (
    FMT_FORMAT,
    FMT_TYPE,
    HEADER_LENGTH,
    LETTER_DTYPES,
    LETTER_SCALES,
    Format,
)
from attlog.formats.merge import merged
from attlog.output import write_atomic

Columns = Mapping[str, NDArray[Any]]

UNITS = {
    "-": "", "?": "UNKNOWN", "#": "instance", "A": "A", "D": "deglatitude", "d": "deg", "E": "rad/s", "G": "Gauss",
    "h": "degheading", "k": "deg/s", "m": "m", "n": "m/s", "O": "degC", "o": "m/s/s", "P": "Pa", "r": "rad", "S":
    "satellites", "s": "s", "U": "deglongitude", "v": "V", "z": "Hz",
}  # fmt: skip
"""ArduPilot's unit ids (AP_Logger/LogStructure.h), as far as attlog writes them."""

MULTIPLIERS = {
    "-": 0.0, "?": 1.0, "2": 1e2, "1": 1e1, "0": 1.0, "A": 1e-1, "B": 1e-2, "C": 1e-3, "D": 1e-4, "E": 1e-5, "F": 1e-6,
    "G": 1e-7, "I": 1e-9,
}  # fmt: skip
"""ArduPilot's multiplier ids."""

_LETTERS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q", "f2": "g",
            "f4": "f", "f8": "d"}  # fmt: skip
_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,3}")


def write(
    path: Path | str,
    messages: Mapping[str, Columns],
    params: Iterable[ParamChange] = (),
    texts: Sequence[Text] = (),
    letters: Mapping[str, str] | None = None,
    units: Mapping[str, tuple[str, str]] | None = None,
) -> None:
    """Write the log; ``attlog.formats.dataflash.reader.read`` and pymavlink give the same numbers back.

    ``messages``: name (at most 4 characters) to columns, ``TimeUS`` (uint64) among them. Types
    tell the letters; ``letters[name]`` names them instead, and then columns of c C e E L are
    the printed numbers and are rounded to the letter's step. ``units[name]`` are the unit and
    multiplier ids (:data:`UNITS`, :data:`MULTIPLIERS`), one character per column. Parameters and
    texts without time take the first time of the data; texts are cut to 64 bytes as ArduPilot
    cuts them. UsageError for what the format cannot hold, OutputError if the file cannot be written.
    """
    letters, units = letters or {}, units or {}
    formats = {"PARM": Format(0, 0, "PARM", "QNff", ("TimeUS", "Name", "Value", "Default"), 0)}
    formats |= {"MSG": Format(0, 0, "MSG", "QZ", ("TimeUS", "Message"), 0)}
    if units:
        formats["UNIT"] = Format(0, 0, "UNIT", "QbZ", ("TimeUS", "Id", "Label"), 0)
        formats["MULT"] = Format(0, 0, "MULT", "Qbd", ("TimeUS", "Id", "Mult"), 0)
        formats["FMTU"] = Format(0, 0, "FMTU", "QBNN", ("TimeUS", "FmtType", "UnitIds", "MultIds"), 0)
    for name, columns in messages.items():
        if name in formats or name == "FMT":
            raise UsageError(f"{name}: this DataFlash message is written by attlog itself")
        formats[name] = _format(name, columns, letters.get(name))
    if len(formats) >= 255:
        raise UsageError(f"a DataFlash log holds at most 254 messages, these are {len(formats)}")
    types = [t for t in range(1, 256) if t != FMT_TYPE]
    formats = {name: _numbered(fmt, kind) for (name, fmt), kind in zip(formats.items(), types, strict=False)}
    starts = [int(c["TimeUS"].min()) for c in messages.values() if len(c["TimeUS"])]
    own = _own_messages(formats, list(params), texts, units, min(starts, default=0))
    head = b"".join(_fmt_record(fmt) for fmt in [FMT_FORMAT, *formats.values()])
    blocks, times, lengths = [], [], []
    for name, columns in [*own.items(), *messages.items()]:
        rows = _records(formats[name], columns)
        blocks.append(rows)
        times.append(np.asarray(columns["TimeUS"]))
        lengths.append(np.full(len(rows), rows.shape[1]))
    write_atomic(Path(path), head + merged(blocks, times, lengths))


def _format(name: str, columns: Columns, letters: str | None) -> Format:
    """The format of a message; UsageError if DataFlash cannot hold it."""
    if _NAME.fullmatch(name) is None:
        raise UsageError(f"{name}: a DataFlash message has 1 to 4 capitals, digits or _")
    if "TimeUS" not in columns or columns["TimeUS"].dtype != np.dtype("<u8"):
        raise UsageError(f"{name}: a DataFlash message needs a column TimeUS (uint64, microseconds)")
    letters = letters or "".join(_letter(name, column, values) for column, values in columns.items())
    if len(letters) != len(columns) or len(letters) > 16 or any(c not in LETTER_DTYPES for c in letters):
        raise UsageError(f"{name}: the letters {letters!r} do not fit {len(columns)} columns (at most 16)")
    if len(",".join(columns)) > 64 or any(re.fullmatch(r"\w+", column) is None for column in columns):
        raise UsageError(f"{name}: the column names need letters, digits and _, together at most 64 characters")
    return Format(0, 0, name, letters, tuple(columns), 0)


def _letter(name: str, column: str, values: NDArray[Any]) -> str:
    """The letter that stores a column as it is."""
    if values.dtype.kind == "S" and values.ndim == 1 and values.dtype.itemsize <= 64:
        return "n" if values.dtype.itemsize <= 4 else "N" if values.dtype.itemsize <= 16 else "Z"
    if values.ndim == 2 and values.shape[1] == 32 and values.dtype == np.int16:
        return "a"
    letter = _LETTERS.get(values.dtype.str[1:])
    if letter is None or values.ndim != 1:
        raise UsageError(f"{name}.{column}: DataFlash has no type for {values.dtype} of shape {values.shape}")
    return letter


def _numbered(fmt: Format, kind: int) -> Format:
    length = fmt.place(len(fmt.letters))
    if length > 255:
        raise UsageError(f"{fmt.name}: a DataFlash record holds 255 bytes, this one needs {length}")
    return Format(kind, length, fmt.name, fmt.letters, fmt.columns, 0)


def _fmt_record(fmt: Format) -> bytes:
    columns = ",".join(fmt.columns)
    return b"\xa3\x95" + struct.pack(
        "<BBB4s16s64s", FMT_TYPE, fmt.type, fmt.length, fmt.name.encode(), fmt.letters.encode(), columns.encode()
    )


def _records(fmt: Format, columns: Columns) -> NDArray[np.uint8]:
    """The records of a message as (n, length) bytes."""
    kinds = [LETTER_DTYPES[letter] for letter in fmt.letters]
    record = np.dtype([("(header)", "u1", (HEADER_LENGTH,)), *zip(fmt.columns, kinds, strict=True)])
    rows = np.zeros(len(columns["TimeUS"]), record)
    rows["(header)"] = (0xA3, 0x95, fmt.type)
    for letter, kind, (name, values) in zip(fmt.letters, kinds, columns.items(), strict=True):
        if letter in LETTER_SCALES:
            values = np.rint(np.asarray(values, np.float64) / LETTER_SCALES[letter])
            limits = np.iinfo(kind)
            if not np.all((values >= limits.min) & (values <= limits.max)):
                raise UsageError(f"{fmt.name}.{name}: a value does not fit the letter {letter}")
        rows[name] = values
    return rows.view(np.uint8).reshape(len(rows), fmt.length)


def _own_messages(
    formats: Mapping[str, Format],
    params: list[ParamChange],
    texts: Sequence[Text],
    units: Mapping[str, tuple[str, str]],
    start_us: int,
) -> dict[str, dict[str, NDArray[Any]]]:
    """PARM, MSG and the unit descriptions as columns."""
    defaults = {p.name: p.value for p in params if p.is_default}
    values = [p for p in params if not p.is_default]
    long = [p.name for p in values if len(p.name.encode()) > 16]
    if long:
        raise UsageError(f"{long[0]}: a DataFlash parameter name holds 16 characters")
    own: dict[str, dict[str, NDArray[Any]]] = {
        "PARM": {
            "TimeUS": np.array([start_us if p.t_us is None else p.t_us for p in values], np.uint64),
            "Name": np.array([p.name.encode() for p in values], "S16"),
            "Value": np.array([p.value for p in values], np.float32),
            "Default": np.array([defaults.get(p.name, np.nan) for p in values], np.float32),
        },
        "MSG": {
            "TimeUS": np.array([start_us if x.t_us is None else x.t_us for x in texts], np.uint64),
            "Message": np.array([x.text.encode()[:64] for x in texts], "S64"),
        },
    }
    if units:
        own["UNIT"] = _described(start_us, Id=[ord(u) for u in UNITS], Label=[t.encode() for t in UNITS.values()])
        own["MULT"] = _described(start_us, Id=[ord(m) for m in MULTIPLIERS], Mult=list(MULTIPLIERS.values()))
        own["FMTU"] = _described(
            start_us,
            FmtType=[formats[name].type for name in units],
            UnitIds=[ids.encode() for ids, _ in units.values()],
            MultIds=[ids.encode() for _, ids in units.values()],
        )
    return own


def _described(start_us: int, **columns: list[Any]) -> dict[str, NDArray[Any]]:
    n = len(next(iter(columns.values())))
    return {"TimeUS": np.full(n, start_us, np.uint64)} | {name: np.array(values) for name, values in columns.items()}
