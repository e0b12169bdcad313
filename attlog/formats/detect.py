"""Which flight log format some first bytes belong to."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator

from attlog.formats.ulog.records import MAGIC

SYNC = b"\xa3\x95"
_FMT_LENGTH = 89
_LETTERS = b"abBhHiIfdngNZcCeELMqQ\0 "
_PRINTABLE = bytes([0, *range(32, 127)])
_TEXT_FORMAT = re.compile(rb"(?:^|[\r\n])\s*FMT, *\d+, *\d+, *\w+")
PACKET_START = (0xFE, 0xFD)
DAMAGED_START = 2048
"""Bytes before the first whole packet that are tolerated."""


def format_of(head: bytes) -> str | None:
    """``ulog dataflash px4log dataflash_text tlog mavlink`` or None, from the first bytes of a file."""
    if head.startswith(MAGIC):
        return "ulog"
    if _is_dataflash(head):
        return "px4log" if _is_sdlog2(head) else "dataflash"
    if _is_text(head):
        return "dataflash_text"
    if _has_packets(head, 8):
        return "tlog"
    if _has_packets(head, 0):
        return "mavlink"
    return None


def _formats(head: bytes) -> Iterator[tuple[str, str, str]]:
    """Name, letters and columns of the FMT records in binary DataFlash framing."""
    at = head.find(SYNC + b"\x80")
    while at >= 0 and at + _FMT_LENGTH <= len(head):
        name, letters, columns = struct.unpack_from("4s16s64s", head, at + 5)
        if not letters.translate(None, _LETTERS) and not (name + columns).translate(None, _PRINTABLE):
            texts = [t.rstrip(b"\0 ").decode("ascii") for t in (name, letters, columns)]
            if texts[0]:
                yield texts[0], texts[1], texts[2]
        at = head.find(SYNC + b"\x80", at + 3)


def _is_dataflash(head: bytes) -> bool:
    """A format definition, or (the start is lost) many record marks at the start."""
    if head[:2] == SYNC and len(head) < _FMT_LENGTH:
        return True
    if any(True for _ in _formats(head)):
        return True
    return head.count(SYNC) >= max(5, len(head) // 400)


def _is_sdlog2(head: bytes) -> bool:
    """PX4's sdlog2 (2013 to 2016): a TIME record that only holds the start time."""
    return any(name == "TIME" and letters == "Q" for name, letters, _ in _formats(head))


def _is_text(head: bytes) -> bool:
    if b"\0" in head[:4096]:
        return False
    return _TEXT_FORMAT.search(head) is not None


def _has_packets(head: bytes, stamp: int) -> bool:
    """Whether MAVLink packets follow each other, each behind ``stamp`` bytes of receive time.

    Images of firmware hold the start byte everywhere; four packets whose lengths
    fit, or a short file that is made of packets only, are no accident.
    """
    if _row(head, 0, stamp) >= 1 and len(head) < 2048:
        return True
    return any(_row(head, start, stamp) >= 4 for start in range(min(len(head), DAMAGED_START)))


def _row(head: bytes, position: int, stamp: int) -> int:
    """Packets in a row from ``position`` on, at most 8; 0 where the row ends in something else."""
    count = 0
    while count < 8 and position + stamp + 3 <= len(head):
        at = position + stamp
        if head[at] not in PACKET_START:
            return 0
        position = at + head[at + 1] + (8 if head[at] == 0xFE else 12 + 13 * (head[at + 2] & 1))
        count += position <= len(head)
    return count
