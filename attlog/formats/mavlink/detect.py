"""Does a file consist of MAVLink packets?"""

from __future__ import annotations

V1, V2 = 0xFE, 0xFD
"""Marker bytes of MAVLink 1 and 2."""
STAMP_LENGTH = 8
"""Bytes of receive time before each packet of a tlog."""
DAMAGED_START = 2048
"""Bytes before the first whole packet that are tolerated."""


def is_tlog(head: bytes) -> bool:
    """Packets behind the receiver's time."""
    return _has_packets(head, STAMP_LENGTH)


def is_capture(head: bytes) -> bool:
    """Packets and nothing else."""
    return _has_packets(head, 0)


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
        if head[at] not in (V1, V2):
            return 0
        position = at + head[at + 1] + (8 if head[at] == V1 else 12 + 13 * (head[at + 2] & 1))
        count += position <= len(head)
    return count
