"""Write DataFlash binary logs from columns: formats, units, parameters, data merged by time, texts."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import UsageError
from attlog.core.files import write_atomic
from attlog.core.own_files import SIMULATED_LOG, FileKind
from attlog.formats.dataflash.layout import (
    FMT_FORMAT,
    FMT_TYPE,
    HEADER_BYTES,
    LETTER_DTYPES,
    LETTER_SCALES,
    MessageFormat,
)
from attlog.formats.dataflash.tables import instance_column
from attlog.formats.recording import Columns, MessageLayout, Recording, fit_to_type, merge_records, require_only

# ArduPilot's unit ids (AP_Logger/LogStructure.h), and its multipliers.
UNIT_NAMES = {"-": ""} | dict(
    pair.split("=")
    for pair in (
        "?=UNKNOWN A=A a=Ah d=deg b=B B=B/s k=deg/s D=deglatitude e=deg/s/s E=rad/s G=Gauss h=degheading i=A.s J=W.s "
        "l=l L=rad/s/s m=m n=m/s o=m/s/s O=degC %=% S=satellites s=s q=rpm r=rad U=deglongitude u=ppm v=V P=Pa w=Ohm "
        "W=Watt X=W.h y=l/s Y=us z=Hz #=instance"
    ).split()
)
MULTIPLIERS = {"-": 0.0, "?": 1.0, "!": 3.6, "/": 3600.0, "I": 1e-9} | {
    letter: float(f"1e{power}") for letter, power in zip("210ABCDEFG", range(2, -8, -1), strict=True)
}

# Messages of a recording's parameters, texts and layouts: letters, columns, units, multipliers.
OWN_MESSAGES = {
    "PARM": ("QNff", ("TimeUS", "Name", "Value", "Default"), "s---", "F---"),
    "MSG": ("QZ", ("TimeUS", "Message"), "s-", "F-"),
    "UNIT": ("QbZ", ("TimeUS", "Id", "Label"), "s--", "F--"),
    "MULT": ("Qbd", ("TimeUS", "Id", "Mult"), "s--", "F--"),
    "FMTU": ("QBNN", ("TimeUS", "FmtType", "UnitIds", "MultIds"), "s---", "F---"),
}

_LETTER_OF_DTYPE = {LETTER_DTYPES[letter].str[1:]: letter for letter in "bBhHiIqQgfd"}
_MESSAGE_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,3}")


def write_dataflash(path: Path | str, recording: Recording, kind: FileKind = SIMULATED_LOG) -> None:
    """Write a DataFlash log, which attlog and pymavlink read back with equal numbers.

    The clock column is ``TimeUS`` (uint64). Types choose the letters where the layout does not; where one layout has
    units, FMTU, UNIT and MULT describe all messages. A message with several instances has a column that numbers them
    (unit ``#`` or one of ``tables.INSTANCE_COLUMNS``). Texts are cut to 64 bytes as ArduPilot does and lose their
    level, which DataFlash does not hold; a default needs its parameter. UsageError for what the format cannot hold,
    OutputError if the file cannot be written.
    """
    start = recording.checked("TimeUS")
    require_only("info", recording.info, ())
    with_units = any(layout.units for layout in recording.layouts.values())
    formats = {
        name: MessageFormat(0, 0, name, letters, columns, 0)
        for name, (letters, columns, _, _) in OWN_MESSAGES.items()
        if with_units or name in ("PARM", "MSG")
    }
    for (name, instance), columns in recording.messages.items():
        if name in OWN_MESSAGES or name == "FMT":
            raise UsageError(f"{name}: this DataFlash message is written by attlog itself")
        layout = recording.layouts.get(name, MessageLayout())
        fmt = _format(name, columns, layout)
        if (known := formats.setdefault(name, fmt)) != fmt:
            raise UsageError(f"{name}: all instances need the same columns ({known.columns} and {fmt.columns})")
        _check_instance(fmt, layout.units, instance, columns)
    if len(formats) >= 255:
        raise UsageError(f"a DataFlash log holds at most 254 messages, these are {len(formats)}")
    types = [t for t in range(1, 256) if t != FMT_TYPE]
    formats = {name: _numbered(fmt, kind) for (name, fmt), kind in zip(formats.items(), types, strict=False)}
    head = b"".join(_fmt_record(fmt) for fmt in [FMT_FORMAT, *formats.values()])
    blocks, times, lengths = [], [], []
    own = _parameters(recording, start) | _texts(recording, start)
    if with_units:
        own |= _units(formats, recording.layouts, start)
    for name, columns in [*own.items(), *((name, c) for (name, _), c in recording.messages.items())]:
        rows = _records(formats[name], columns)
        blocks.append(rows)
        times.append(np.asarray(columns["TimeUS"]))
        lengths.append(np.full(len(rows), rows.shape[1]))
    write_atomic(Path(path), head + merge_records(blocks, times, lengths), kind)


def _format(name: str, columns: Columns, layout: MessageLayout) -> MessageFormat:
    """Return the format of a message; UsageError if DataFlash cannot hold it."""
    if _MESSAGE_NAME.fullmatch(name) is None:
        raise UsageError(f"{name}: a DataFlash message has 1 to 4 capitals, digits or _")
    if columns["TimeUS"].dtype != np.dtype("<u8"):
        raise UsageError(f"{name}: a DataFlash message needs a column TimeUS (uint64, microseconds)")
    if layout.nested:
        raise UsageError(f"{name}: DataFlash has no nested types")
    letters = layout.letters or "".join(_letter(name, column, values) for column, values in columns.items())
    if len(letters) != len(columns) or len(letters) > 16 or any(c not in LETTER_DTYPES for c in letters):
        raise UsageError(f"{name}: the letters {letters!r} do not fit {len(columns)} columns (at most 16)")
    if letters[list(columns).index("TimeUS")] != "Q":
        raise UsageError(f"{name}: the letter of TimeUS is Q")
    if len(",".join(columns)) > 64 or any(re.fullmatch(r"\w+", column) is None for column in columns):
        raise UsageError(f"{name}: the column names need letters, digits and _, together at most 64 characters")
    for ids, known, what in ((layout.units, UNIT_NAMES, "units"), (layout.multipliers, MULTIPLIERS, "multipliers")):
        if (layout.units or ids) and (len(ids) != len(columns) or any(i not in known for i in ids)):
            raise UsageError(f"{name}: the {what} {ids!r} are not {len(columns)} known ids, one per column")
    return MessageFormat(0, 0, name, letters, tuple(columns), 0)


def _check_instance(fmt: MessageFormat, units: str, instance: int, columns: Columns) -> None:
    """Raise UsageError unless the records of an instance carry its number."""
    column = instance_column(fmt, units)
    if column is None and instance != 0:
        raise UsageError(f"{fmt.name}: instance {instance} needs a column with its number, such as I")
    if column is not None and not bool(np.all(np.asarray(columns[column]) == instance)):
        raise UsageError(f"{fmt.name}.{column}: numbers the instance, and not all of it is {instance}")


def _letter(name: str, column: str, values: NDArray[Any]) -> str:
    """Return the letter that stores a column as it is."""
    if values.dtype.kind == "S" and values.ndim == 1 and values.dtype.itemsize <= 64:
        return "n" if values.dtype.itemsize <= 4 else "N" if values.dtype.itemsize <= 16 else "Z"
    if values.ndim == 2 and values.shape[1] == 32 and values.dtype == np.int16:
        return "a"
    letter = _LETTER_OF_DTYPE.get(values.dtype.str[1:])
    if letter is None or values.ndim != 1:
        raise UsageError(f"{name}.{column}: DataFlash has no type for {values.dtype} of shape {values.shape}")
    return letter


def _numbered(fmt: MessageFormat, kind: int) -> MessageFormat:
    length = fmt.place(len(fmt.letters))
    if length > 255:
        raise UsageError(f"{fmt.name}: a DataFlash record holds 255 bytes, this one needs {length}")
    return MessageFormat(kind, length, fmt.name, fmt.letters, fmt.columns, 0)


def _fmt_record(fmt: MessageFormat) -> bytes:
    columns = ",".join(fmt.columns)
    return b"\xa3\x95" + struct.pack(
        "<BBB4s16s64s", FMT_TYPE, fmt.type, fmt.length, fmt.name.encode(), fmt.letters.encode(), columns.encode()
    )


def _records(fmt: MessageFormat, columns: Columns) -> NDArray[np.uint8]:
    """Return the records of a message as (n, length) bytes."""
    kinds = [LETTER_DTYPES[letter] for letter in fmt.letters]
    record = np.dtype([("(header)", "u1", (HEADER_BYTES,)), *zip(fmt.columns, kinds, strict=True)])
    rows = np.zeros(len(columns["TimeUS"]), record)
    rows["(header)"] = (0xA3, 0x95, fmt.type)
    for letter, kind, (name, values) in zip(fmt.letters, kinds, columns.items(), strict=True):
        if letter in LETTER_SCALES:
            values = np.asarray(values, np.float64) / LETTER_SCALES[letter]
        rows[name] = fit_to_type(values, kind, f"{fmt.name}.{name} (letter {letter})")
    return rows.view(np.uint8).reshape(len(rows), fmt.length)


def _parameters(recording: Recording, start: int) -> dict[str, Columns]:
    """Return PARM columns with the default beside the value."""
    defaults = {p.name: p.value for p in recording.params if p.is_default}
    values = [p for p in recording.params if not p.is_default]
    require_only("default without its parameter", defaults, {p.name for p in values})
    names = [p.name.encode() for p in values]
    if any(len(name) > 16 for name in names):
        raise UsageError(f"{max(names, key=len).decode()}: a DataFlash parameter name holds 16 characters")
    columns = {
        "TimeUS": np.array([start if p.t_us is None else p.t_us for p in values], np.uint64),
        "Name": np.array(names, "S16"),
        "Value": np.array([p.value for p in values], np.float32),
        "Default": np.array([defaults.get(p.name, np.nan) for p in values], np.float32),
    }
    return {"PARM": columns}


def _texts(recording: Recording, start: int) -> dict[str, Columns]:
    columns = {
        "TimeUS": np.array([start if x.t_us is None else x.t_us for x in recording.texts], np.uint64),
        "Message": np.array([x.text.encode()[:64] for x in recording.texts], "S64"),
    }
    return {"MSG": columns}


def _units(
    formats: Mapping[str, MessageFormat], layouts: Mapping[str, MessageLayout], start: int
) -> dict[str, Columns]:
    """Return UNIT, MULT, and FMTU of the messages with units."""
    own = {name: MessageLayout(units=units, multipliers=ids) for name, (_, _, units, ids) in OWN_MESSAGES.items()}
    described = {name: layout for name, layout in (own | dict(layouts)).items() if layout.units}
    return {
        "UNIT": _constant_rows(start, Id=[ord(u) for u in UNIT_NAMES], Label=[t.encode() for t in UNIT_NAMES.values()]),
        "MULT": _constant_rows(start, Id=[ord(m) for m in MULTIPLIERS], Mult=list(MULTIPLIERS.values())),
        "FMTU": _constant_rows(
            start,
            FmtType=[formats[name].type for name in described],
            UnitIds=[layout.units.encode() for layout in described.values()],
            MultIds=[layout.multipliers.encode() for layout in described.values()],
        ),
    }


def _constant_rows(start: int, **columns: list[Any]) -> dict[str, NDArray[Any]]:
    n = len(next(iter(columns.values())))
    return {"TimeUS": np.full(n, start, np.uint64)} | {name: np.array(values) for name, values in columns.items()}
