"""ULogs as pyulog reads them: one column per array element, texts as small integers, padding shown."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.file_bytes import first_bytes, read_file_bytes
from attlog.formats.oracle import Columns, Key, Oracle
from attlog.formats.table import Messages
from attlog.formats.ulog.encrypted import ENCRYPTED_HEADER, decrypt, is_encrypted


def read(path: Path) -> Columns:
    """All topics by name and multi id."""
    from pyulog import ULog

    whole: str | io.BytesIO = str(path)
    if is_encrypted(first_bytes(path, ENCRYPTED_HEADER.size)):
        whole = io.BytesIO(decrypt(path, read_file_bytes(path)).tobytes())
    return {(data.name, data.multi_id): dict(data.data) for data in ULog(whole).data_list}


def keys(log: Messages) -> list[Key]:
    """The topics of our reading."""
    return list(log)


def ours(log: Messages, key: Key) -> dict[str, NDArray[Any]] | None:
    """Our columns of a topic taken apart into single numbers."""
    name, multi = key
    if multi is None or (name, multi) not in log:
        return None
    table = log[name, multi]
    found: dict[str, NDArray[Any]] = {}
    for field, described in table.fields.items():
        column = table[field]
        if described.dtype.kind == "S":
            width = described.dtype.itemsize
            raw = np.frombuffer(column.tobytes(), np.int8).reshape(len(column), width)
            found |= {f"{field}[{i}]": raw[:, i] for i in range(width)} if width > 1 else {field: raw[:, 0]}
        elif column.ndim == 2:
            found |= {f"{field}[{i}]": column[:, i] for i in range(column.shape[1])}
        else:
            found[f"{field}[0]" if described.dtype.shape else field] = column
    return found


def why_not_ours(column: str) -> str | None:
    """Padding is no data."""
    return "padding" if column.rpartition(".")[2].startswith("_padding") else None


ORACLE = Oracle("pyulog", read, keys, ours, why_not_ours)
