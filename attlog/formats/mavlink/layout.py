"""Layouts of MAVLink messages, from pymavlink's ``ardupilotmega`` dialect (which contains ``common``)."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from attlog.formats.mavlink.walk import Catalogue
from attlog.formats.table import Field

# Column of a tlog with the receiver's time of the packet (Unix us). It has no checksum: behind damage it may be wrong.
STAMP_COLUMN = "_t_us"

# numpy type by struct letter of the dialect's ``native_format``
_NATIVE_TYPES = {
    "b": "i1",
    "B": "u1",
    "h": "<i2",
    "H": "<u2",
    "i": "<i4",
    "I": "<u4",
    "q": "<i8",
    "Q": "<u8",
    "f": "<f4",
    "d": "<f8",
}


@cache
def dialect() -> dict[int, Any]:
    """Return the message classes of the dialect by id."""
    from pymavlink.dialects.v20 import ardupilotmega

    messages: dict[int, Any] = ardupilotmega.mavlink_map
    return messages


@cache
def message_catalogue() -> Catalogue:
    """Return CRC seed and payload size of every message of the dialect."""
    messages = dialect()
    seeds = np.full(max(messages) + 1, -1, np.int16)
    sizes = np.zeros(len(seeds), np.int16)
    for number, message in messages.items():
        seeds[number] = message.crc_extra
        sizes[number] = message.unpacker.size
    return Catalogue(seeds, sizes)


@cache
def message_layout(number: int) -> tuple[str, dict[str, Field], np.dtype[Any]]:
    """Return name, fields (declaration order) and payload as structured type of a message."""
    message = dialect()[number]
    fields: dict[str, Field] = {}
    letters = message.native_format.decode()[1:]
    for name, letter, count, array in zip(
        message.ordered_fieldnames, letters, message.lengths, message.array_lengths, strict=True
    ):
        if letter == "c":
            dtype = np.dtype(f"S{array or 1}")
        else:
            dtype = np.dtype((_NATIVE_TYPES[letter], (count,))) if array else np.dtype(_NATIVE_TYPES[letter])
        fields[name] = Field(name, dtype, message.fieldunits_by_name.get(name))
    record = np.dtype([(f.name, f.dtype) for f in fields.values()])
    return message.msgname, {name: fields[name] for name in message.fieldnames}, record
