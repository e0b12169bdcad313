"""Read logs with the official library of their format (pyulog, pymavlink, rosbags) and list differences to attlog."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from attlog import formats
from attlog.formats import Messages, Table
from attlog.formats.file_bytes import decode_text
from attlog.formats.mavlink.layout import STAMP_COLUMN
from attlog.formats.ros.cdr import RECORDER_COLUMN
from attlog.formats.ros.reader import is_wanted, table_name

Key = tuple[str, int]
Columns = dict[Key, dict[str, Any]]


def differences(path: Path, theirs: Columns | None = None) -> list[str]:
    """Return one sentence per message, field or value that differs between attlog and the official library."""
    log = formats.open(path)
    theirs = read_reference(path) if theirs is None else theirs
    ours = {key: _as_reference(log, key) for key in _keys(log)}
    found = [f"{name}:{instance}: only the library reads it" for name, instance in theirs.keys() - ours.keys()]
    found += [f"{name}:{instance}: only attlog reads it" for name, instance in ours.keys() - theirs.keys()]
    for key in ours.keys() & theirs.keys():
        mine, other = ours[key], theirs[key]
        where = f"{key[0]}:{key[1]}"
        found += [f"{where}.{column}: only one reader has this field" for column in mine.keys() ^ other.keys()]
        for column in mine.keys() & other.keys():
            a, b = mine[column], other[column]
            if len(a) != len(b):
                found.append(f"{where}.{column}: {len(a)} records, {len(b)} by the library")
            elif unequal := int(np.count_nonzero(~_equal(a, b, log.format))):
                found.append(f"{where}.{column}: {unequal} of {len(a)} values differ")
    return sorted(found)


def read_reference(path: Path) -> Columns:
    """Return all columns by message and instance as the official library reads them."""
    log_format = formats.recognise(path)
    if log_format == "ulog":
        return _read_pyulog(path)
    if log_format == "ros":
        return _read_rosbags(path)
    if log_format in ("tlog", "mavlink"):
        return _gathered(_mavlink_packets(path.read_bytes(), 8 if log_format == "tlog" else 0))
    from pymavlink.DFReader import DFReader_binary, DFReader_text

    reader = (DFReader_binary if log_format == "dataflash" else DFReader_text)(str(path))
    try:
        return _gathered(
            (message.get_type(), 0, message)
            for message in iter(reader.recv_msg, None)
            if message.get_type() != "FMT"  # its own layout is built into the library
        )
    finally:
        reader.filehandle.close()


def _read_pyulog(path: Path) -> Columns:
    from pyulog import ULog

    return {
        (data.name, data.multi_id): {n: x for n, x in data.data.items() if "_padding" not in n.rpartition(".")[2]}
        for data in ULog(str(path)).data_list
    }


def _mavlink_packets(data: bytes, stamp: int) -> Iterator[tuple[str, int, Any]]:
    """Hand pymavlink's parser one packet at a time without the receiver's ``stamp`` bytes before each.

    The parser derives the bytes it needs from the version of the packet before: too many where a short MAVLink 1
    packet follows one of MAVLink 2. The first three bytes determine the length.
    """
    from pymavlink.dialects.v20 import ardupilotmega

    parser = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    at = stamp
    while at < len(data):
        held = parser.buf_len()
        need = 3 - held if held < 3 else max(parser.bytes_needed(), 1)
        message = parser.parse_char(data[at : at + need])
        at += need
        if message is None or (message.get_type() == "BAD_DATA" and parser.buf_len()):
            continue
        at += stamp
        if not message.get_type().startswith(("BAD_DATA", "UNKNOWN")):
            yield message.get_type(), message.get_srcSystem() * 256 + message.get_srcComponent(), message


def _gathered(rows: Iterable[tuple[str, int, Any]]) -> Columns:
    """Return columns of pymavlink's messages."""
    columns: dict[Key, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for name, instance, message in rows:
        for field in message.get_fieldnames():
            if field and (name, field) != ("FILE", "Data"):  # FILE.Data is cut at its first zero by the library
                columns[name, instance][field].append(getattr(message, field))
    return {key: {n: _array(values) for n, values in table.items()} for key, table in columns.items()}


def _array(values: list[Any]) -> Any:
    if all(isinstance(v, int) for v in values) and max(values) > np.iinfo(np.int64).max:
        return np.array(values, np.uint64)  # beside small ones numpy makes floats of them, which round
    if all(isinstance(v, int | float) for v in values) or np.ndim(values[0]):
        return np.array(values)
    texts = np.empty(len(values), object)
    texts[:] = [v.strip() if isinstance(v, str) else v for v in values]
    return texts


def _read_rosbags(path: Path) -> Columns:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    found: dict[Key, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
        kept = [c for c in bag.connections if is_wanted(c.topic, c.msgtype)]
        for connection, _, raw in bag.messages(kept) if kept else ():
            for column, value in _numbers(bag.deserialize(raw, connection.msgtype), ""):
                found[table_name(connection.topic, connection.msgtype), 0][column].append(value)
    return {key: {c: np.array(values) for c, values in columns.items()} for key, columns in found.items()}


def _numbers(message: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the numbers of a ROS message by their flattened field names; capital names are constants."""
    for name in (field.name for field in fields(message)):
        value = getattr(message, name)
        if name.isupper() or isinstance(value, str):
            continue
        if is_dataclass(value):
            yield from _numbers(value, f"{prefix}{name}.")
        elif isinstance(value, list):
            for k, item in enumerate(value):
                if not isinstance(item, str):
                    yield from _numbers(item, f"{prefix}{name}[{k}].")
        else:
            yield prefix + name, value


def _keys(log: Messages) -> list[Key]:
    """Return the messages of a log; pymavlink does not split DataFlash messages by instance."""
    return [(name, 0) for name in log.names() if name != "FMT"] if log.format.startswith("dataflash") else list(log)


def _as_reference(log: Messages, key: Key) -> dict[str, Any]:
    """Return our columns with the names, types and texts of the official library."""
    if log.format == "ulog":
        return _split_elements(log[key])
    spell: Callable[[bytes], str] = decode_text
    tables = [log[key[0], i] for i in log.instances(key[0])]
    if log.format in ("tlog", "mavlink", "ros"):
        tables = [log[key]]
        spell = lambda raw: raw.decode("ascii", "replace")  # noqa: E731
    order = np.argsort(np.concatenate([t.offsets for t in tables]), kind="stable")
    columns: dict[str, Any] = {}
    for name, field in tables[0].fields.items():
        if name in (STAMP_COLUMN, RECORDER_COLUMN) or (key[0], name) == ("FILE", "Data"):
            continue
        stored = field.dtype.shape or field.dtype.kind == "S" or field.scale == 1.0
        column = np.concatenate([t[name] if stored else t.value(name) for t in tables])[order]
        columns[name] = _array([spell(raw) for raw in column.tolist()]) if column.dtype.kind == "S" else column
    return columns


def _split_elements(table: Table) -> dict[str, Any]:
    """Return columns named as by pyulog: one per array element, texts as small integers."""
    found: dict[str, Any] = {}
    for name, field in table.fields.items():
        column = table[name]
        if field.dtype.kind == "S":
            column = np.frombuffer(column.tobytes(), np.int8).reshape(len(column), field.dtype.itemsize)
        if column.ndim == 2 and column.shape[1] > 1:
            found |= {f"{name}[{i}]": column[:, i] for i in range(column.shape[1])}
        else:
            found[f"{name}[0]" if field.dtype.shape else name] = column.reshape(len(column))
    return found


def _equal(ours: Any, theirs: Any, log_format: str) -> Any:
    """Compare value by value; scaled DataFlash numbers may differ in the last digit, as pymavlink divides."""
    if ours.dtype == object or theirs.dtype == object:
        return np.array([np.array_equal(a, b) for a, b in zip(ours, theirs, strict=True)], bool)
    if not log_format.startswith("dataflash"):
        theirs = theirs.astype(ours.dtype)
        raw = [np.ascontiguousarray(x).view(np.uint8).reshape(len(x), -1) for x in (ours, theirs)]
        return (raw[0] == raw[1]).all(axis=1)
    a, b = ours.astype(np.float64), theirs.astype(np.float64)
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    near = np.isfinite(a) & np.isfinite(b) & ~same
    with np.errstate(over="ignore"):
        same[near] = np.abs(a[near] - b[near]) <= np.spacing(np.abs(b[near]))
    return same if same.ndim == 1 else same.all(axis=1)
