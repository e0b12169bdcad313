"""Layout of MAVLink packets: recognition, checksum, and messages of pymavlink's ``ardupilotmega`` dialect.

The dialect contains ``common``, which PX4 uses.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.table import Field

# Marker bytes of MAVLink 1 and 2.
MAVLINK_1, MAVLINK_2 = 0xFE, 0xFD
# Bytes of receive time before each packet of a tlog.
STAMP_BYTES = 8
# Bytes tolerated before the first whole packet; behind more damage the checksums of packets are checked as well.
MAX_DAMAGED_START = 2048
# Packets in a row by which a file is recognised.
PACKETS_IN_ROW = 4
_MARKERS = re.compile(b"[\xfd\xfe]")
# Column of a tlog with the receiver's time of the packet (Unix us). It has no checksum: behind damage it may be wrong.
STAMP_COLUMN = "_t_us"
_POLYNOMIAL = 0x8408  # 0x1021 with its bits reversed
# numpy type by struct letter of the dialect's ``native_format``
_NATIVE_TYPES = dict(zip("bBhHiIqQfd", "i1 u1 <i2 <u2 <i4 <u4 <i8 <u8 <f4 <f8".split(), strict=True))


def is_tlog(head: bytes) -> bool:
    """Return whether a file begins with MAVLink packets, each behind a receiver time."""
    return _has_packets(head, STAMP_BYTES)


def is_capture(head: bytes) -> bool:
    """Return whether a file begins with MAVLink packets without receiver times."""
    return _has_packets(head, 0)


def _has_packets(head: bytes, stamp: int) -> bool:
    """Return whether MAVLink packets follow each other, each behind ``stamp`` bytes.

    Required are four packets with matching lengths, or a short file of packets only, because other files, such as
    firmware images, contain the marker byte too.
    """
    if _packets_in_row(head, 0, stamp) >= 1 and len(head) < 2048:
        return True
    if any(_packets_in_row(head, start, stamp) >= PACKETS_IN_ROW for start in range(min(len(head), MAX_DAMAGED_START))):
        return True
    later = (m.start() for m in _MARKERS.finditer(head, MAX_DAMAGED_START))
    return any(
        _packets_in_row(head, at - stamp, stamp) >= PACKETS_IN_ROW and _checksums_right(head, at, stamp) for at in later
    )


def _checksums_right(head: bytes, at: int, stamp: int) -> bool:
    """Return whether PACKETS_IN_ROW packets from the marker at ``at`` on are known messages with right checksums."""
    data, catalogue = np.frombuffer(head, np.uint8), message_catalogue()
    for _ in range(PACKETS_IN_ROW):
        first = head[at] == MAVLINK_1
        end = at + head[at + 1] + (6 if first else 10)
        number = head[at + 5] if first else int.from_bytes(head[at + 7 : at + 10], "little")
        if end + 2 > len(head) or not catalogue.knows(number):
            return False
        covered = np.append(data[at + 1 : end], catalogue.seeds[number].astype(np.uint8))
        if int(crc_of_rows(covered[np.newaxis])[0]) != int.from_bytes(head[end : end + 2], "little"):
            return False
        at = end + 2 + (0 if first else 13 * (head[at + 2] & 1)) + stamp
    return True


def _packets_in_row(head: bytes, position: int, stamp: int) -> int:
    """Count packets in a row, at most 8; 0 for other bytes."""
    count = 0
    while count < 8 and position + stamp + 3 <= len(head):
        at = position + stamp
        if head[at] not in (MAVLINK_1, MAVLINK_2):
            return 0
        position = at + head[at + 1] + (8 if head[at] == MAVLINK_1 else 12 + 13 * (head[at + 2] & 1))
        count += position <= len(head)
    return count


# CRC-16/MCRF4XX: reflected polynomial 0x1021, first state 0xffff.


@cache
def byte_table() -> NDArray[np.uint16]:
    """Return the CRC state after one more byte (256), by the lower byte of the state xor that byte."""
    state = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        state = np.where(state & 1, (state >> 1) ^ _POLYNOMIAL, state >> 1).astype(np.uint16)
    return state


def crc_of_rows(rows: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Return the CRC of each row of (n, k) bytes."""
    crc = np.full(len(rows), 0xFFFF, np.uint16)
    for column in rows.T:
        crc = (crc >> 8) ^ byte_table()[(crc ^ column) & 0xFF]
    return crc


@dataclass(frozen=True, slots=True)
class Catalogue:
    """CRC extra (-1 unknown) and full payload size of messages, arrays by id."""

    seeds: NDArray[np.int16]
    sizes: NDArray[np.int16]

    def knows(self, number: int) -> bool:
        """Return whether a message is in the dialect."""
        return number < len(self.seeds) and self.seeds[number] >= 0


@cache
def dialect() -> dict[int, Any]:
    """Return the message classes of the dialect by id."""
    from pymavlink.dialects.v20 import ardupilotmega

    messages: dict[int, Any] = ardupilotmega.mavlink_map
    return messages


@cache
def instance_fields() -> dict[str, str]:
    """Return the fields that tell sensors, ports or values of one message apart, by message: BATTERY_STATUS, ``id``."""
    fields = {message.msgname: getattr(message, "instance_field", None) for message in dialect().values()}
    return {name: field for name, field in fields.items() if field}


@cache
def message_catalogue() -> Catalogue:
    """Return the catalogue of the dialect."""
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
