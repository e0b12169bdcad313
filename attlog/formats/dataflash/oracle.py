"""DataFlash logs, binary and text, as pymavlink's DFReader reads them; PX4's sdlog2 has the same framing."""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

from attlog.formats.file_bytes import decode_text
from attlog.formats.oracle import Columns, Key, Oracle, as_printed, gathered
from attlog.formats.table import Messages

NOT_COMPARED = {("FMT", "Columns"), ("FMT", "Format"), ("FILE", "Data")}
"""Binary content and the description of FMT itself, which the library builds in."""
OUR_OWN = {"_t_us"}
"""Columns that attlog adds: the group's time in sdlog2 logs."""


def read_binary(path: Path) -> Columns:
    """All messages by name."""
    from pymavlink.DFReader import DFReader_binary

    return _read(DFReader_binary(str(path)))


def read_text(path: Path) -> Columns:
    """All messages by name, without FMT lines."""
    from pymavlink.DFReader import DFReader_text

    return {key: columns for key, columns in _read(DFReader_text(str(path))).items() if key[0] != "FMT"}


def _read(reader: Any) -> Columns:
    try:
        found = gathered((m.get_type(), None, m) for m in iter(reader.recv_msg, None))
    finally:
        reader.filehandle.close()
    return {key: _compared(key, columns) for key, columns in found.items()}


def _compared(key: Key, columns: dict[str, Any]) -> dict[str, Any]:
    return {c: values for c, values in columns.items() if (key[0], c) not in NOT_COMPARED and c not in OUR_OWN}


def keys(log: Messages, without: str = "") -> list[Key]:
    """The messages of our reading; the library does not split by instance."""
    return [(name, None) for name in log.names() if name != without]


def ours(log: Messages, key: Key) -> dict[str, Any] | None:
    """Our columns of all instances of a message, in file order."""
    columns = as_printed([log[key[0], i] for i in log.instances(key[0])], decode_text)
    return None if columns is None else _compared(key, columns)


def redefined(log: Messages) -> dict[str, str]:
    """Messages of which a type, layout or name changes inside the file (logs of two boots in one)."""
    table = log.tables.get(("FMT", 0))
    if table is None or not {"Type", "Name", "Length", "Format"} <= table.fields.keys():
        return {}
    rows = set(zip(*(table[c].tolist() for c in ("Type", "Name", "Length", "Format")), strict=True))
    types, names = Counter(row[0] for row in rows), Counter(row[1] for row in rows)
    why = (
        "defined anew inside the file; pymavlink applies the last definition to all records, "
        "attlog each from its place on"
    )
    return {decode_text(row[1]): why for row in rows if types[row[0]] > 1 or names[row[1]] > 1}


BINARY = Oracle("pymavlink", read_binary, keys, ours, why_not_comparable=redefined)
TEXT = Oracle("pymavlink", read_text, partial(keys, without="FMT"), ours)
