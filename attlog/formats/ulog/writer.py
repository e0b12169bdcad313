"""Write a ULog from columns: definitions, parameters, data merged by time, texts."""

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
from attlog.formats.merge import merged
from attlog.formats.ulog.layout import BASIC
from attlog.formats.ulog.records import MAGIC
from attlog.output import write_atomic

_TYPES = {np.dtype(code): name for name, code in BASIC.items() if name != "bool"}
_NAME = re.compile(r"[A-Za-z_]\w*")
SIZE, KIND, ID = "(size)", "(kind)", "(id)"
"""Header columns; no field of a topic can have such a name."""

Columns = Mapping[str, NDArray[Any]]


def write(
    path: Path | str,
    topics: Mapping[tuple[str, int], Columns],
    params: Iterable[ParamChange] = (),
    texts: Sequence[Text] = (),
    info: Mapping[str, str | int] | None = None,
    start_us: int = 0,
) -> None:
    """Write the log; ``attlog.formats.ulog.reader.read`` and any ULog reader give the same columns back.

    ``topics``: (name, multi id) to columns, ``timestamp`` (uint64 us) among them; numbers
    (n,) or (n, k), text as numpy bytes. Records of all topics are merged by time, stable.
    ``params`` without time stand before the data, the others behind the record they follow
    in time. UsageError for what ULog cannot hold, OutputError if the file cannot be written.
    """
    params = list(params)
    head = [MAGIC, b"\x01", struct.pack("<Q", start_us), _record("B", bytes(40))]
    for name, value in (info or {}).items():
        kind, raw = (
            (f"char[{len(value.encode())}]", value.encode())
            if isinstance(value, str)
            else ("int32_t", struct.pack("<i", value))
        )
        head.append(_record("I", _key(kind, name) + raw))
    formats: dict[str, str] = {}
    for (name, _), columns in topics.items():
        described = _format(name, columns)
        if formats.setdefault(name, described) != described:
            raise UsageError(f"{name}: all instances of a topic need the same columns")
    head += [_record("F", text.encode()) for text in formats.values()]
    head += [_parameter(p) for p in params if p.t_us is None]
    head += [
        _record("A", struct.pack("<BH", multi, identifier) + name.encode())
        for identifier, (name, multi) in enumerate(topics)
    ]
    write_atomic(Path(path), b"".join(head) + _data(topics, params, texts))


def _record(kind: str, payload: bytes) -> bytes:
    if len(payload) > 0xFFFF:
        raise UsageError(f"a ULog record holds at most 65535 bytes, this one needs {len(payload)}")
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def _key(kind: str, name: str) -> bytes:
    key = f"{kind} {name}".encode()
    return struct.pack("<B", len(key)) + key


def _parameter(change: ParamChange) -> bytes:
    is_int = isinstance(change.value, int)
    payload = _key("int32_t" if is_int else "float", change.name) + struct.pack("<i" if is_int else "<f", change.value)
    return _record("Q", b"\x01" + payload) if change.is_default else _record("P", payload)


def _text(message: Text) -> bytes:
    return _record("L", struct.pack("<BQ", ord("0") + message.level, message.t_us or 0) + message.text.encode())


def _format(name: str, columns: Columns) -> str:
    if "timestamp" not in columns or columns["timestamp"].dtype != np.dtype("<u8"):
        raise UsageError(f"{name}: a ULog topic needs a column timestamp (uint64, microseconds)")
    members = []
    for column, values in columns.items():
        if _NAME.fullmatch(column) is None:
            raise UsageError(f"{name}.{column}: not a ULog field name; nested fields cannot be written")
        if values.dtype.kind == "S" and values.ndim == 1:
            members.append(f"char[{max(values.dtype.itemsize, 1)}] {column};")
            continue
        kind = "bool" if values.dtype == bool else _TYPES.get(values.dtype.newbyteorder("<"))
        if kind is None or values.ndim > 2:
            raise UsageError(f"{name}.{column}: ULog has no type for {values.dtype} of shape {values.shape}")
        members.append(f"{kind}[{values.shape[1]}] {column};" if values.ndim == 2 else f"{kind} {column};")
    return f"{name}:{''.join(members)}"


def _data(topics: Mapping[tuple[str, int], Columns], params: Sequence[ParamChange], texts: Sequence[Text]) -> bytes:
    """Data records of all topics, texts and parameter changes in the order of their times."""
    blocks = [_rows(identifier, columns) for identifier, columns in enumerate(topics.values())]
    times = [columns["timestamp"] for columns in topics.values()]
    lengths = [np.full(len(rows), rows.shape[1]) for rows in blocks]
    single = [(p.t_us, _parameter(p)) for p in params if p.t_us is not None]
    single += [(x.t_us or 0, _text(x)) for x in texts]
    if single:
        padded = np.array([record for _, record in single], np.bytes_)
        blocks.append(padded.view(np.uint8).reshape(len(single), padded.itemsize))
        times.append(np.array([t for t, _ in single], np.uint64))
        lengths.append(np.array([len(record) for _, record in single], np.int64))
    return merged(blocks, times, lengths)


def _rows(identifier: int, columns: Columns) -> NDArray[np.uint8]:
    """The topic's records with their headers as (n, length) bytes."""
    members = [(name, values.dtype.newbyteorder("<"), values.shape[1:]) for name, values in columns.items()]
    record = np.dtype([(SIZE, "<u2"), (KIND, "u1"), (ID, "<u2"), *members])
    if record.itemsize - 3 > 0xFFFF:
        raise UsageError(f"a ULog record holds at most 65535 bytes, this one needs {record.itemsize - 3}")
    rows = np.zeros(len(columns["timestamp"]), record)
    rows[SIZE], rows[KIND], rows[ID] = record.itemsize - 3, ord("D"), identifier
    for name, values in columns.items():
        rows[name] = values
    return rows.view(np.uint8).reshape(len(rows), record.itemsize)
