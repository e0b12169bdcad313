"""Write a ULog from columns: definitions, parameters, data merged by time, texts."""

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
from attlog.formats.recording import Columns, Key, Recording, merge_records, require_only
from attlog.formats.table import ParamChange, Text
from attlog.formats.ulog.layout import AIRFRAME_DEFAULT, BASIC_TYPES, FIRMWARE_DEFAULT, MAGIC

_TYPES = {np.dtype(code): name for name, code in BASIC_TYPES.items() if name != "bool"} | {np.dtype(bool): "bool"}
_FIELD_NAME = re.compile(r"[A-Za-z_]\w*")
_MEMBER_NAME = re.compile(r"([A-Za-z_]\w*)(?:\[(\d+)\])?")
# Header columns under names that no field can have.
SIZE_FIELD, KIND_FIELD, ID_FIELD = "(size)", "(kind)", "(id)"


def write_ulog(path: Path | str, recording: Recording, kind: FileKind = SIMULATED_LOG) -> None:
    """Write a ULog, which ULog readers read back with equal columns.

    The clock column is ``timestamp`` (uint64 us), the instance the multi id. Columns ``member[0].field`` become a
    nested type. Records of all topics are merged by time, stable. Parameters without time come before the data, the
    others behind the record they follow in time. UsageError for what ULog cannot hold, OutputError if the file cannot
    be written.
    """
    start = recording.checked("timestamp")
    head = [MAGIC, b"\x01", struct.pack("<Q", start), _record("B", bytes(40))]
    head += [_info(name, value) for name, value in recording.info.items()]
    formats: dict[str, str] = {}
    for (name, multi), columns in recording.messages.items():
        if _FIELD_NAME.fullmatch(name) is None or not 0 <= multi <= 255:
            raise UsageError(f"{name!r}, instance {multi}: a ULog topic is a word with a multi id of 0 to 255")
        _define(name, columns, recording, formats)
    head += [_record("F", text.encode()) for text in formats.values()]
    head += [_parameter(p) for p in recording.params if p.t_us is None]
    head += [
        _record("A", struct.pack("<BH", multi, identifier) + name.encode())
        for identifier, (name, multi) in enumerate(recording.messages)
    ]
    write_atomic(Path(path), b"".join(head) + _data(recording, start), kind)


def _record(kind: str, payload: bytes) -> bytes:
    if len(payload) > 0xFFFF:
        raise UsageError(f"a ULog record holds at most 65535 bytes, this one needs {len(payload)}")
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def _key(kind: str, name: str) -> bytes:
    key = f"{kind} {name}".encode()
    if len(key) > 255:
        raise UsageError(f"{name[:40]}: a ULog key holds 255 bytes with its type, this one needs {len(key)}")
    return struct.pack("<B", len(key)) + key


def _int32(name: str, value: int) -> bytes:
    if not -(2**31) <= value < 2**31:
        raise UsageError(f"{name}: {value} does not fit 32 bits")
    return struct.pack("<i", value)


def _info(name: str, value: str | int) -> bytes:
    if isinstance(value, str):
        return _record("I", _key(f"char[{len(value.encode())}]", name) + value.encode())
    return _record("I", _key("int32_t", name) + _int32(name, value))


def _parameter(change: ParamChange) -> bytes:
    value = change.value
    if isinstance(value, int):
        payload = _key("int32_t", change.name) + _int32(change.name, value)
    else:
        payload = _key("float", change.name) + np.float32(value).tobytes()
    if not change.is_default:
        return _record("P", payload)
    kind = FIRMWARE_DEFAULT if change.firmware_only else FIRMWARE_DEFAULT | AIRFRAME_DEFAULT
    return _record("Q", bytes([kind]) + payload)


def _text(message: Text, start: int) -> bytes:
    if not 0 <= message.level <= 7:
        raise UsageError(f"{message.text[:40]!r}: a level is 0 to 7, this is {message.level}")
    when = start if message.t_us is None else message.t_us
    return _record("L", struct.pack("<BQ", ord("0") + message.level, when) + message.text.encode())


def _define(name: str, columns: Columns, recording: Recording, formats: dict[str, str]) -> None:
    """Add the formats of a topic, those of its nested members first."""
    layout = recording.layouts.get(name)
    if layout is not None and (layout.letters or layout.units or layout.multipliers):
        raise UsageError(f"{name}: ULog stores columns by their types, it has no letters, units or multipliers")
    if columns["timestamp"].dtype != np.dtype("<u8"):
        raise UsageError(f"{name}: a ULog topic needs a column timestamp (uint64, microseconds)")
    names = {} if layout is None else layout.nested
    require_only("nested type of", names, {_MEMBER_NAME.sub(r"\1", c.partition(".")[0]) for c in columns if "." in c})
    _describe(name, columns, names, formats)


def _describe(name: str, columns: Columns, names: Mapping[str, str], formats: dict[str, str]) -> None:
    members: list[str] = []
    nested: dict[str, dict[int | None, dict[str, NDArray[Any]]]] = {}
    for column, values in columns.items():
        outer, _, inner = column.partition(".")
        if not inner:
            members.append(_simple(name, column, values))
            continue
        match = _MEMBER_NAME.fullmatch(outer)
        if match is None:
            raise UsageError(f"{name}.{column}: not a ULog field name")
        if match[1] not in nested:
            members.append(match[1])
        elif members[-1] != match[1]:
            raise UsageError(f"{name}.{column}: the columns of a nested member must follow each other")
        nested.setdefault(match[1], {}).setdefault(None if match[2] is None else int(match[2]), {})[inner] = values
    for member, elements in nested.items():
        kind = names.get(member, f"{name}_{member}")
        if list(elements) not in ([None], list(range(len(elements)))):
            raise UsageError(f"{name}.{member}: nested elements are numbered 0, 1, 2 ...")
        for inside in elements.values():
            _describe(kind, inside, {}, formats)
        count = "" if None in elements else f"[{len(elements)}]"
        members[members.index(member)] = f"{kind}{count} {member};"
    described = f"{name}:{''.join(members)}"
    if formats.setdefault(name, described) != described:
        raise UsageError(f"{name}: all instances and elements need the same columns")


def _simple(name: str, column: str, values: NDArray[Any]) -> str:
    if _FIELD_NAME.fullmatch(column) is None:
        raise UsageError(f"{name}.{column}: not a ULog field name")
    if values.dtype.kind == "S" and values.ndim == 1:
        return f"char[{max(values.dtype.itemsize, 1)}] {column};"
    kind = _TYPES.get(values.dtype.newbyteorder("<"))
    if kind is None or values.ndim > 2:
        raise UsageError(f"{name}.{column}: ULog has no type for {values.dtype} of shape {values.shape}")
    return f"{kind}[{values.shape[1]}] {column};" if values.ndim == 2 else f"{kind} {column};"


def _data(recording: Recording, start: int) -> bytes:
    """Return data, texts and parameter changes in order of time."""
    blocks = [_rows(k, key, columns) for k, (key, columns) in enumerate(recording.messages.items())]
    times = [columns["timestamp"] for columns in recording.messages.values()]
    lengths = [np.full(len(rows), rows.shape[1]) for rows in blocks]
    single = [(p.t_us, _parameter(p)) for p in recording.params if p.t_us is not None]
    single += [(start if x.t_us is None else x.t_us, _text(x, start)) for x in recording.texts]
    for t_us, record in single:
        blocks.append(np.frombuffer(record, np.uint8)[np.newaxis])
        times.append(np.array([t_us], np.uint64))
        lengths.append(np.array([len(record)], np.int64))
    return merge_records(blocks, times, lengths)


def _rows(identifier: int, key: Key, columns: Columns) -> NDArray[np.uint8]:
    """Return the topic's records with their headers as (n, length) bytes."""
    members = [(name, values.dtype.newbyteorder("<"), values.shape[1:]) for name, values in columns.items()]
    record = np.dtype([(SIZE_FIELD, "<u2"), (KIND_FIELD, "u1"), (ID_FIELD, "<u2"), *members])
    if record.itemsize - 3 > 0xFFFF:
        raise UsageError(f"{key[0]}: a ULog record holds at most 65535 bytes, this one needs {record.itemsize - 3}")
    rows = np.zeros(len(columns["timestamp"]), record)
    rows[SIZE_FIELD], rows[KIND_FIELD], rows[ID_FIELD] = record.itemsize - 3, ord("D"), identifier
    for name, values in columns.items():
        rows[name] = values
    return rows.view(np.uint8).reshape(len(rows), record.itemsize)
