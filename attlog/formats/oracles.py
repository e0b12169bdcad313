"""A log as the official libraries read it: pyulog for ULog, pymavlink for everything else.

Columns are named and scaled as the library does. Used to verify our own readers,
by users (``attlog info --verify``) and by the tests.
"""

from __future__ import annotations

import contextlib
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

STAMP = 8
"""Bytes of receive time before each packet of a tlog."""

Key = tuple[str, int | None]
Columns = dict[Key, dict[str, Any]]


@dataclass(slots=True)
class OracleLog:
    """``columns``: (message, instance) to field to values; instance None where the library does not split by it."""

    library: str
    columns: Columns


def read(path: Path, log_format: str) -> OracleLog:
    """The log as the format's official library reads it; whatever the library raises or prints on the way is its own.

    ``log_format`` as in ``Messages.format``. Printing is suppressed.
    """
    from importlib.metadata import version

    with silence():
        if log_format == "ulog":
            return OracleLog(f"pyulog {version('pyulog')}", _ulog(path))
        columns = _mavlink(path, log_format) if log_format in ("tlog", "mavlink") else _dataflash(path, log_format)
    return OracleLog(f"pymavlink {version('pymavlink')}", columns)


def _ulog(path: Path) -> Columns:
    from pyulog import ULog

    return {(data.name, data.multi_id): dict(data.data) for data in ULog(str(path)).data_list}


def _dataflash(path: Path, log_format: str) -> Columns:
    from pymavlink.DFReader import DFReader_binary, DFReader_text

    reader = (DFReader_text if log_format == "dataflash_text" else DFReader_binary)(str(path))
    try:
        rows = ((m.get_type(), None, m) for m in iter(reader.recv_msg, None))
        return _collect(rows)
    finally:
        reader.filehandle.close()


def _mavlink(path: Path, log_format: str) -> Columns:
    from pymavlink.dialects.v20 import ardupilotmega

    parser = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    return _collect(_packets(parser, path.read_bytes(), STAMP if log_format == "tlog" else 0))


def _packets(parser: Any, data: bytes, stamp: int) -> Iterator[tuple[str, int | None, Any]]:
    """Feed the parser as pymavlink's own log reader does: skip a stamp, then bytes until a packet is whole."""
    at = stamp
    while at < len(data):
        need = max(parser.bytes_needed(), 1)
        message = parser.parse_char(data[at : at + need])
        at += need
        if message is None:
            continue
        at += stamp
        if not message.get_type().startswith(("BAD_DATA", "UNKNOWN")):
            yield message.get_type(), message.get_srcSystem() * 256 + message.get_srcComponent(), message


def _collect(rows: Iterable[tuple[str, int | None, Any]]) -> Columns:
    collected: dict[Key, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for name, instance, message in rows:
        table = collected[name, instance]
        for field in message.get_fieldnames():
            table[field].append(getattr(message, field))
    return {key: {field: _array(values) for field, values in table.items()} for key, table in collected.items()}


def _array(values: list[Any]) -> Any:
    """Numbers as an array, texts and mixed values as a list of objects."""
    if all(isinstance(v, int | float) for v in values):
        return np.array(values)
    array = np.empty(len(values), object)
    for i, value in enumerate(values):
        array[i] = value
    return array


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Nothing reaches stdout or stderr, also not from compiled code (pymavlink prints a line per damaged byte)."""
    saved = [(stream, os.dup(stream)) for stream in (1, 2)]
    try:
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
            for stream, _ in saved:
                os.dup2(nowhere.fileno(), stream)
            yield
    finally:
        for stream, copy in saved:
            os.dup2(copy, stream)
            os.close(copy)
