"""Bags as the package rosbags reads them, message by message."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.oracle import Columns, Key, Oracle
from attlog.formats.ros.cdr import RECORDER_COLUMN
from attlog.formats.ros.reader import is_wanted, table_name
from attlog.formats.table import Messages


def read(path: Path) -> Columns:
    """All topics that are read, by the names that our reader gives them."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    found: dict[Key, dict[str, list[Any]]] = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
        kept = [c for c in bag.connections if is_wanted(c.topic, c.msgtype)]
        for connection, _, raw in bag.messages(kept) if kept else ():
            columns = found.setdefault((table_name(connection.topic, connection.msgtype), 0), {})
            for column, value in _flat(bag.deserialize(raw, connection.msgtype), ""):
                columns.setdefault(column, []).append(value)
    return {key: {c: np.array(values) for c, values in columns.items()} for key, columns in found.items()}


def _flat(message: Any, prefix: str) -> list[tuple[str, Any]]:
    """The numbers of a message by the names of their fields."""
    found: list[tuple[str, Any]] = []
    for name in (field.name for field in fields(message)):
        value = getattr(message, name)
        if name.isupper() or isinstance(value, str):  # constants of the definition are in capitals
            continue
        if is_dataclass(value):
            found += _flat(value, f"{prefix}{name}.")
        elif isinstance(value, list):
            value = [item for item in value if not isinstance(item, str)]
            found += [pair for k, item in enumerate(value) for pair in _flat(item, f"{prefix}{name}[{k}].")]
        else:
            found.append((prefix + name, value))
    return found


def keys(log: Messages) -> list[Key]:
    """The topics of our reading."""
    return list(log)


def ours(log: Messages, key: Key) -> dict[str, NDArray[Any]] | None:
    """Our columns of a topic."""
    name, instance = key
    if instance is None or (name, instance) not in log:
        return None
    table = log[name, instance]
    return {column: table[column] for column in table.fields if column != RECORDER_COLUMN}


def why_not_ours(column: str) -> str | None:
    """Every number is compared."""
    return None


ORACLE = Oracle("rosbags", read, keys, ours, why_not_ours)
