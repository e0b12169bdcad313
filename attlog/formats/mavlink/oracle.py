"""Telemetry as pymavlink's parser reads it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from attlog.formats.mavlink.layout import STAMP_COLUMN
from attlog.formats.mavlink.walk import STAMP_BYTES
from attlog.formats.oracle import Columns, Key, Oracle, as_printed, gathered
from attlog.formats.table import Messages


def read(path: Path, stamp: int) -> Columns:
    """All known messages by name and sender, with ``stamp`` bytes before each packet."""
    from pymavlink.dialects.v20 import ardupilotmega

    parser = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    return gathered(_packets(parser, path.read_bytes(), stamp))


def _packets(parser: Any, data: bytes, stamp: int) -> Iterator[tuple[str, int | None, Any]]:
    """Give the parser one packet at a time, and skip the stamp before each.

    The parser tells how many bytes it needs from the version of the packet before, which is too many where a short
    packet of MAVLink 1 follows one of MAVLink 2: its first three bytes tell the length for sure.
    """
    at = stamp
    while at < len(data):
        held = parser.buf_len()
        need = _TELL_LENGTH - held if held < _TELL_LENGTH else max(parser.bytes_needed(), 1)
        message = parser.parse_char(data[at : at + need])
        at += need
        if message is None:
            continue
        kind = message.get_type()
        if kind == "BAD_DATA" and parser.buf_len():
            continue  # foreign bytes before a packet that has begun
        at += stamp
        if not kind.startswith(("BAD_DATA", "UNKNOWN")):
            yield kind, message.get_srcSystem() * 256 + message.get_srcComponent(), message


_TELL_LENGTH = 3
"""Marker, payload length and flags."""


def keys(log: Messages) -> list[Key]:
    """The messages of our reading by sender."""
    return list(log)


def ours(log: Messages, key: Key) -> dict[str, Any] | None:
    """Our columns of one sender's message without the receiver's time; texts as ASCII with replacement characters."""
    name, sender = key
    tables = [log[name, sender]] if sender is not None and (name, sender) in log else []
    columns = as_printed(tables, partial(bytes.decode, encoding="ascii", errors="replace"))
    return None if columns is None else {c: values for c, values in columns.items() if c != STAMP_COLUMN}


TLOG = Oracle("pymavlink", partial(read, stamp=STAMP_BYTES), keys, ours)
CAPTURE = Oracle("pymavlink", partial(read, stamp=0), keys, ours)
