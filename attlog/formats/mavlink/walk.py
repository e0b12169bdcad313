"""Find the MAVLink packets of a tlog or raw capture by their checksums.

Every ``fe`` (MAVLink 1) or ``fd`` (MAVLink 2) byte may begin a packet; one whose checksum over header, payload and the
message's seed (CRC extra) is right, is one. So damage needs no resynchronisation. Source: MAVLink guide, "Packet
Serialization"; CRC-16/MCRF4XX.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.jit import Cells, IOut1
from attlog.core.limits import MAX_SENDERS
from attlog.core.timestamps import Offsets
from attlog.formats.file_bytes import gather, offset_type
from attlog.formats.mavlink.layout import (
    MAVLINK_1,
    MAVLINK_2,
    STAMP_BYTES,
    Catalogue,
    byte_table,
    crc_of_padded_rows,
    crc_of_rows,
)
from attlog.formats.table import DamageLog

# MAVLink 2's incompatibility flag of a signature behind the checksum.
SIGNED_FLAG, SIGNATURE_BYTES = 0x01, 13
_SEARCH_BYTES = 1 << 21  # bytes searched at once; bounds the memory
_PADDING_BYTES = 16  # packets within this difference of length share a checksum pass
_CRC_BATCH_BYTES = 1 << 18  # bytes of a checksum pass; stays in cache
# Smaller files are searched by numpy (5 ms per MB): loading compiled code takes 25 ms and saves 4 ms per MB.
MIN_COMPILED_BYTES = 12 << 20
_WALKED_PACKETS = 1 << 16  # packets of one call

U8 = Annotated[NDArray[np.uint8], Cells("u1", 1)]
I16 = Annotated[NDArray[np.int16], Cells("i2", 1)]
U16Table = Annotated[NDArray[np.uint16], Cells("u2", 2)]
I32Out = Annotated[NDArray[np.int32], Cells("i4", 1, True)]


@dataclass(slots=True)
class Packets:
    """The packets of a file: offset of the marker, message, sender.

    ``stamped`` for a tlog (each packet behind its receiver time), not for a raw capture.
    """

    offsets: Offsets
    ids: NDArray[np.int32]
    senders: NDArray[np.uint16]  # system * 256 + component
    stamped: bool
    unknown: Counter[int] = field(default_factory=Counter)
    losses: DamageLog = field(default_factory=DamageLog)


def index_packets(data: NDArray[np.uint8], catalogue: Catalogue) -> Packets:
    """Return all packets of known messages with a right checksum.

    Packets of unknown messages cannot be checked. They count as such where a chain of them fills the space between two
    checked packets; other bytes are damage.
    """
    if _is_compiled(len(data)):
        start, end, ids = walk_all_packets(data, catalogue.seeds, catalogue.sizes)
    else:
        start, end, ids = search_packets(data, catalogue)
    gaps = start[1:] - end[:-1]
    if len(gaps):
        stamped = bool(np.count_nonzero(gaps == STAMP_BYTES) > np.count_nonzero(gaps == 0))
    else:
        stamped = len(start) > 0 and int(start[0]) >= STAMP_BYTES
    if stamped and start[0] < STAMP_BYTES:  # a file that begins inside a receiver time
        start, end, ids = start[1:], end[1:], ids[1:]
    place = np.where(data.take(start) == MAVLINK_2, np.uint8(5), np.uint8(3))
    senders = gather(data, start + place, np.dtype(">u2")).astype(np.uint16)
    packets = Packets(start, ids, senders, stamped)
    _account_for_holes(data, packets, end, catalogue)
    _drop_rare_senders(packets, end)
    return packets


def _drop_rare_senders(packets: Packets, end: Offsets) -> None:
    """Leave out the rarest senders beyond the limit of a network."""
    counts = np.bincount(packets.senders)
    senders = np.count_nonzero(counts)
    if senders <= MAX_SENDERS:
        return
    wanted = np.zeros(len(counts), np.bool_)
    wanted[np.argsort(-counts, kind="stable")[:MAX_SENDERS]] = True
    kept = wanted[packets.senders]
    packets_lost = len(kept) - int(np.count_nonzero(kept))
    lost = f"{packets_lost} packets of {senders - MAX_SENDERS} senders beyond the {MAX_SENDERS} with most"
    length = int((end[~kept] - packets.offsets[~kept]).sum())
    packets.losses.add_kind(int(packets.offsets[~kept][0]), length, lost, "next packet")
    packets.offsets, packets.ids, packets.senders = packets.offsets[kept], packets.ids[kept], packets.senders[kept]


def _account_for_holes(data: NDArray[np.uint8], packets: Packets, end: Offsets, catalogue: Catalogue) -> None:
    """Report what lies between the packets: unknown messages, wrong checksums or other damage."""
    size = len(data)
    stamp = STAMP_BYTES if packets.stamped else 0
    # where each packet should begin, and where it does; in front of the first and behind the last one too
    begins = np.concatenate([np.zeros(1, end.dtype), end])
    stops = np.append(packets.offsets - stamp, end.dtype.type(size))
    torn = (stops[:-1] < begins[:-1]).nonzero()[0]
    stops[torn] += stamp  # less than a receiver time between two packets is what damage left of one
    holes = (stops != begins).nonzero()[0]
    wrong: dict[int, list[tuple[int, int]]] = {}
    for begin, stop in zip(begins[holes].tolist(), stops[holes].tolist(), strict=True):
        chain = _unchecked_chain(data, begin, stop, stamp)
        for offset, after, number in chain:
            if catalogue.knows(number):
                wrong.setdefault(number, []).append((offset, after))
            else:
                packets.unknown[number] += 1
        if chain:
            continue
        resumed = "end of file" if stop == size else f"next packet at {stop}"
        packets.losses.add(begin, stop - begin, f"{stop - begin} bytes without a packet of right checksum", resumed)
    for number, found in wrong.items():
        length = sum(after - offset for offset, after in found)
        lost = f"{len(found)} packets of message {number} with a wrong checksum (damaged, or of another dialect)"
        packets.losses.add_kind(found[0][0], length, lost, "next packet")


def _unchecked_chain(data: NDArray[np.uint8], begin: int, stop: int, stamp: int) -> list[tuple[int, int, int]]:
    """Return unchecked packets that fill a hole exactly, else none. Begin, end and message id of each."""
    found = []
    at = begin
    while at < stop:
        head = data[at + stamp : min(at + stamp + 10, stop)].tobytes()
        if len(head) >= 8 and head[0] == MAVLINK_1:
            after, number = at + stamp + 8 + head[1], head[5]
        elif len(head) == 10 and head[0] == MAVLINK_2 and head[2] <= SIGNED_FLAG:
            after = at + stamp + 12 + head[1] + SIGNATURE_BYTES * head[2]
            number = int.from_bytes(head[7:10], "little")
        else:
            return []
        found.append((at, after, number))
        at = after
    return found if at == stop else []


def _marker_offsets(data: NDArray[np.uint8], value: int, smallest: int, start: int) -> NDArray[np.int64]:
    """Return the offsets of a marker byte in one chunk."""
    stop = min(start + _SEARCH_BYTES, len(data) - smallest + 1)
    return np.flatnonzero(data[start : max(stop, start)] == value) + start


@dataclass(slots=True)
class _Headers:
    """Headers of known messages that marker bytes would begin."""

    at: NDArray[np.int64]
    covered: NDArray[np.int64]  # bytes from behind the marker to before the checksum
    end: NDArray[np.int64]
    ids: NDArray[np.int32]

    def chosen(self, select: NDArray[Any]) -> _Headers:
        """Select headers."""
        return _Headers(self.at[select], self.covered[select], self.end[select], self.ids[select])


def _headers_v1(data: NDArray[np.uint8], catalogue: Catalogue, start: int) -> _Headers:
    at = _marker_offsets(data, MAVLINK_1, 8, start)
    limit = np.full(256, -1, np.int16)
    limit[: len(catalogue.seeds)] = np.where(catalogue.seeds >= 0, catalogue.sizes, -1)[:256]
    ids = data[at + 5]
    length = data[at + 1]
    possible = np.flatnonzero(length <= limit[ids])
    at, ids, covered = at[possible], ids[possible], length[possible].astype(np.int64) + 5
    headers = _Headers(at, covered, at + covered + 3, ids.astype(np.int32))
    return headers.chosen(headers.end <= len(data))


def _headers_v2(data: NDArray[np.uint8], catalogue: Catalogue, start: int) -> _Headers:
    at = _marker_offsets(data, MAVLINK_2, 12, start)
    at = at[data[at + 2] <= SIGNED_FLAG]  # other incompatibility flags are not defined
    ids = (gather(data, at + 6, np.dtype("<u4")) >> 8).astype(np.int32)  # behind the component: 24 bits
    listed = np.flatnonzero(ids < len(catalogue.seeds))
    known = listed[catalogue.seeds[ids[listed]] >= 0]
    at, ids = at[known], ids[known]
    covered = data[at + 1].astype(np.int64) + 9
    headers = _Headers(at, covered, at + covered + 3 + SIGNATURE_BYTES * data[at + 2].astype(np.int64), ids)
    return headers.chosen(headers.end <= len(data))


def _checksum_right(data: NDArray[np.uint8], headers: _Headers, catalogue: Catalogue) -> NDArray[np.bool_]:
    """Select the headers with a right checksum."""
    good = np.zeros(len(headers.at), np.bool_)
    if len(good) == 0:
        return good
    sent = gather(data, headers.at + 1 + headers.covered, np.dtype("<u2"))
    seeds = catalogue.seeds[headers.ids].astype(np.uint8)
    widths = (
        (headers.covered + _PADDING_BYTES) // _PADDING_BYTES * _PADDING_BYTES
    )  # room for the covered bytes and the seed
    early = headers.at + headers.covered + 2 < widths  # padding would reach before the beginning of the file
    for k in np.flatnonzero(early).tolist():
        begin = int(headers.at[k]) + 1
        covered = np.append(data[begin : begin + int(headers.covered[k])], seeds[k])
        good[k] = crc_of_rows(covered[np.newaxis])[0] == sent[k]
    order = np.argsort(headers.covered.astype(np.uint16), kind="stable")
    order = order[~early[order]]
    sorted_widths = widths[order]
    edges = [0, *(np.flatnonzero(np.diff(sorted_widths)) + 1).tolist(), len(order)]
    for begin, stop in pairwise(edges):
        width = int(sorted_widths[begin]) if stop > begin else _PADDING_BYTES
        step = max(_CRC_BATCH_BYTES // width, 1)
        for k in range(begin, stop, step):
            mine = order[k : min(k + step, stop)]
            covered = headers.covered[mine]
            rows = gather(data, headers.at[mine] + covered + 2 - width, np.dtype((np.uint8, (width,))))
            rows[:, -1] = seeds[mine]
            good[mine] = crc_of_padded_rows(rows, width - 1 - covered) == sent[mine]
    return good


def _without_embedded(start: Offsets, end: Offsets) -> NDArray[np.bool_]:
    """Select packets that do not begin inside an accepted one. A tunnelled packet is payload."""
    keep = np.ones(len(start), np.bool_)
    reach = np.maximum.accumulate(end) if len(end) else end
    inside = np.flatnonzero(start[1:] < reach[:-1]) + 1
    for k in inside.tolist():
        # the last packet kept before this one decides, not the furthest candidate
        before = k - 1
        while before >= 0 and not keep[before]:
            before -= 1
        limit = int(end[before]) if before >= 0 else -1
        keep[k] = start[k] >= limit
    return keep


def search_packets(data: NDArray[np.uint8], catalogue: Catalogue) -> tuple[Offsets, Offsets, NDArray[np.int32]]:
    """Return begin, end and message id of valid packets, in file order."""
    width = offset_type(len(data))
    starts: list[Offsets] = []
    ends: list[Offsets] = []
    numbers: list[NDArray[np.int32]] = []
    for first in range(0, max(len(data), 1), _SEARCH_BYTES):
        found = []
        for headers in (_headers_v1(data, catalogue, first), _headers_v2(data, catalogue, first)):
            found.append(headers.chosen(_checksum_right(data, headers, catalogue)))
        start = np.concatenate([h.at for h in found])
        order = np.argsort(start, kind="stable")
        starts.append(start[order].astype(width))
        ends.append(np.concatenate([h.end for h in found])[order].astype(width))
        numbers.append(np.concatenate([h.ids for h in found])[order])
    begin, end, ids = np.concatenate(starts), np.concatenate(ends), np.concatenate(numbers)
    kept = _without_embedded(begin, end)
    return (begin, end, ids) if kept.all() else (begin[kept], end[kept], ids[kept])


# Compiled search, five times as fast. The checksum takes eight bytes a step (slicing-by-8; Kounavis and Berry 2005).


def _is_compiled(size: int) -> bool:
    """Return whether the compiled walk is at hand and the file large enough for it."""
    if size < MIN_COMPILED_BYTES or not jit.jit_wanted():
        return False
    from attlog.core.jit.compile import at_hand  # small files are read without

    return at_hand(walk_packets) is not None


def slicing_tables() -> NDArray[np.uint16]:
    """Return the CRC tables (8, 256) of eight bytes a step."""
    tables = [byte_table()]
    for _ in range(7):
        tables.append((tables[-1] >> 8) ^ byte_table()[tables[-1] & 0xFF])
    return np.stack(tables)


def walk_all_packets(
    data: NDArray[np.uint8], seeds: NDArray[np.int16], sizes: NDArray[np.int16]
) -> tuple[Offsets, Offsets, NDArray[np.int32]]:
    """Return the result of :func:`search_packets` by the compiled walk.

    ``seeds`` (CRC extra, -1 unknown) and ``sizes`` (payload bytes) by message id.
    """
    walk, tables, width = walk_packets.compiled(), slicing_tables(), offset_type(len(data))
    starts, ends = np.empty(_WALKED_PACKETS, np.int64), np.empty(_WALKED_PACKETS, np.int64)
    ids = np.empty(_WALKED_PACKETS, np.int32)
    blocks = []
    position, n = 0, _WALKED_PACKETS
    while n == _WALKED_PACKETS:
        n = walk(data, position, seeds, sizes, tables, starts, ends, ids)
        blocks.append((starts[:n].astype(width), ends[:n].astype(width), ids[:n].copy()))
        position = int(ends[n - 1])
    found_starts, found_ends, found_ids = (np.concatenate(columns) for columns in zip(*blocks, strict=True))
    return found_starts, found_ends, found_ids


@jit.loop("the reader's walk over packets")
def walk_packets(
    data: U8, position: int, seeds: I16, sizes: I16, tables: U16Table, starts: IOut1, ends: IOut1, ids: I32Out
) -> int:
    """Find packets from ``position`` on; return their number."""
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
        position = int(end)
    return n
