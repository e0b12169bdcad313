"""MAVLink packets with a right checksum, found by a compiled walk over the bytes.

Does what the numpy pass of :mod:`attlog.formats.mavlink.index` does, five times as
fast; used for large files where its machine code is at hand. The checksum takes eight
bytes a step (slicing-by-8; Kounavis and Berry 2005).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.formats import compiled
from attlog.formats.base import Offsets
from attlog.formats.compiled import at_any_cost, if_cheap, kernel_of
from attlog.formats.mapping import SOURCE as COPYING
from attlog.formats.mapping import copy_one, offset_type
from attlog.formats.mavlink.crc import slicing_tables

WORTH_COMPILED = 12 << 20
"""Below this many bytes loading compiled code costs more than it saves (25 ms against 3 ms per MB)."""

_BLOCK = 1 << 16


def pays(data: NDArray[np.uint8]) -> bool:
    """Whether :func:`compiled_packets` can be used and is worth it."""
    return compiled.pays("mavlink", len(data), WORTH_COMPILED) and if_cheap(WALK) is not None


def compiled_packets(
    data: NDArray[np.uint8], seeds: NDArray[np.int16], sizes: NDArray[np.int16]
) -> tuple[Offsets, Offsets, NDArray[np.int32]]:
    """Marker offsets, end offsets and message ids of all packets of known messages, in file order.

    ``seeds`` (CRC extra, -1 unknown) and ``sizes`` (payload bytes) by message id. A
    packet inside an accepted one is payload.
    """
    walk, tables, width = if_cheap(WALK) or at_any_cost(WALK), slicing_tables(), offset_type(len(data))
    starts, ends, ids = np.empty(_BLOCK, np.int64), np.empty(_BLOCK, np.int64), np.empty(_BLOCK, np.int32)
    blocks = []
    position, n = 0, _BLOCK
    while n == _BLOCK:
        n = walk(data, position, seeds, sizes, tables, starts, ends, ids)
        blocks.append((starts[:n].astype(width), ends[:n].astype(width), ids[:n].copy()))
        position = int(ends[n - 1])
    found_starts, found_ends, found_ids = (np.concatenate(columns) for columns in zip(*blocks, strict=True))
    return found_starts, found_ends, found_ids


def walk(data, position, seeds, sizes, tables, starts, ends, ids):  # type: ignore[no-untyped-def]
    """Find packets from ``position`` on, at most as many as fit the arrays; returns how many."""
    n = 0
    while n < len(starts) and position + 8 <= len(data):
        marker = data[position]
        if marker == 0xFE:
            number = np.int64(data[position + 5])
            covered = np.int64(data[position + 1]) + 5
            end = position + covered + 3
            fits = number < len(seeds) and covered - 5 <= sizes[number]
        elif marker == 0xFD and position + 12 <= len(data) and data[position + 2] <= 1:
            number = np.int64(data[position + 7]) | np.int64(data[position + 8]) << 8
            number |= np.int64(data[position + 9]) << 16
            covered = np.int64(data[position + 1]) + 9
            end = position + covered + 3 + 13 * np.int64(data[position + 2])
            fits = number < len(seeds)
        else:
            position += 1
            continue
        if not fits or end > len(data) or seeds[number] < 0:
            position += 1
            continue
        at, stop, crc = position + 1, position + 1 + covered, np.int64(0xFFFF)
        while at + 8 <= stop:
            crc ^= np.int64(data[at]) | np.int64(data[at + 1]) << 8
            crc = np.int64(
                tables[7, crc & 0xFF]
                ^ tables[6, crc >> 8]
                ^ tables[5, data[at + 2]]
                ^ tables[4, data[at + 3]]
                ^ tables[3, data[at + 4]]
                ^ tables[2, data[at + 5]]
                ^ tables[1, data[at + 6]]
                ^ tables[0, data[at + 7]]
            )
            at += 8
        while at < stop:
            crc = (crc >> 8) ^ np.int64(tables[0, (crc ^ data[at]) & 0xFF])
            at += 1
        crc = (crc >> 8) ^ np.int64(tables[0, (crc ^ seeds[number]) & 0xFF])
        if crc != np.int64(data[stop]) | np.int64(data[stop + 1]) << 8:
            position += 1
            continue
        starts[n], ends[n], ids[n] = position, end, number
        n += 1
        position = end
    return n


WALK = kernel_of(
    walk, "i8((u1[::1]), i8, i2[::1], i2[::1], u2[:, ::1], i8[::1], i8[::1], i4[::1])", "formats/mavlink/compiled.py"
)


def payload(data, offsets, size, out):  # type: ignore[no-untyped-def]
    """The payloads of packets (rows of ``size`` bytes), what the sender left out or the file has no room for zero."""
    for i in range(len(offsets)):
        at, place = np.int64(offsets[i]), i * size
        if at < 0 or at + 2 > len(data):
            return i
        begin = at + (10 if data[at] == 0xFD else 6)
        here = min(min(np.int64(data[at + 1]), size), len(data) - begin)
        copy_one(data, begin, max(here, 0), out, place)
        for k in range(max(here, 0), size):
            out[place + k] = 0
    return len(offsets)


PAYLOAD = kernel_of(payload, "i8((u1[::1]), (i4[::1]), i8, u1[::1])", "formats/mavlink/compiled.py", COPYING)
