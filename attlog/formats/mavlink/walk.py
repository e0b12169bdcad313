"""Does a file consist of MAVLink packets?"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.jit import IOut1
from attlog.core.limits import MAX_SENDERS
from attlog.core.timestamps import Offsets
from attlog.formats import file_bytes
from attlog.formats.file_bytes import (
    I16,
    I32,
    U8,
    I32Out,
    U8Out,
    U16Table,
    compiled_if_cheap,
    copy_record,
    gather,
    offset_type,
)
from attlog.formats.table import DamageLog

MAVLINK_1, MAVLINK_2 = 0xFE, 0xFD
"""Marker bytes of MAVLink 1 and 2."""
STAMP_BYTES = 8
"""Bytes of receive time before each packet of a tlog."""
MAX_DAMAGED_START = 2048
"""Bytes before the first whole packet that are tolerated."""


def is_tlog(head: bytes) -> bool:
    """Packets behind the receiver's time."""
    return _has_packets(head, STAMP_BYTES)


def is_capture(head: bytes) -> bool:
    """Packets and nothing else."""
    return _has_packets(head, 0)


def _has_packets(head: bytes, stamp: int) -> bool:
    """Whether MAVLink packets follow each other, each behind ``stamp`` bytes of receive time.

    Images of firmware hold the start byte everywhere; four packets whose lengths
    fit, or a short file that is made of packets only, are no accident.
    """
    if _packets_in_row(head, 0, stamp) >= 1 and len(head) < 2048:
        return True
    return any(_packets_in_row(head, start, stamp) >= 4 for start in range(min(len(head), MAX_DAMAGED_START)))


def _packets_in_row(head: bytes, position: int, stamp: int) -> int:
    """Packets in a row from ``position`` on, at most 8; 0 where the row ends in something else."""
    count = 0
    while count < 8 and position + stamp + 3 <= len(head):
        at = position + stamp
        if head[at] not in (MAVLINK_1, MAVLINK_2):
            return 0
        position = at + head[at + 1] + (8 if head[at] == MAVLINK_1 else 12 + 13 * (head[at + 2] & 1))
        count += position <= len(head)
    return count


# MAVLink's checksum, CRC-16/MCRF4XX: reflected polynomial 0x1021, first state 0xffff.
#
# One table of single bytes; the others are made of it, for several bytes a step.

_POLYNOMIAL = 0x8408  # 0x1021 with its bits reversed


@cache
def byte_table() -> NDArray[np.uint16]:
    """The state after one more byte (256), by the lower byte of the state xor that byte."""
    state = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        state = np.where(state & 1, (state >> 1) ^ _POLYNOMIAL, state >> 1).astype(np.uint16)
    return state


@cache
def word_table() -> NDArray[np.uint16]:
    """The state after two more bytes (65536), by state xor those bytes as little-endian word."""
    byte = byte_table()
    state = np.arange(65536, dtype=np.uint16)
    for _ in range(2):
        state = (state >> 8) ^ byte[state & 0xFF]
    return state


def slicing_tables() -> NDArray[np.uint16]:
    """The state after one byte followed by 0 to 7 zero bytes, from a zero state: (8, 256)."""
    tables = [byte_table()]
    for _ in range(7):
        tables.append((tables[-1] >> 8) ^ byte_table()[tables[-1] & 0xFF])
    return np.stack(tables)


def crc_of_padded_rows(rows: NDArray[np.uint8], pad: NDArray[np.int64]) -> NDArray[np.uint16]:
    """CRC-16/MCRF4XX of rows (n, k), k even, whose first ``pad`` (sorted) bytes do not count; changes ``rows``.

    A state of zero does not change by zero bytes, so rows of many lengths go
    together when the padding is zero and the start value 0xffff is put on the
    first two bytes.
    """
    edges = [0, *(np.flatnonzero(np.diff(pad)) + 1).tolist(), len(rows)]
    for begin, stop in pairwise(edges):
        skipped = int(pad[begin]) if stop > begin else 0
        rows[begin:stop, :skipped] = 0
        rows[begin:stop, skipped : skipped + 2] ^= 0xFF
    crc, table = np.zeros(len(rows), np.uint16), word_table()
    for column in np.ascontiguousarray(rows.view("<u2").T):
        column ^= crc
        # every u16 is a valid index; wrap only spares numpy the check
        table.take(column, out=crc, mode="wrap")
    return crc


def crc_of_rows(rows: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """CRC-16/MCRF4XX, the checksum of MAVLink, of each row of (n, k) bytes, k > 1."""
    pad = rows.shape[1] % 2
    padded = np.zeros((len(rows), rows.shape[1] + pad), np.uint8)
    padded[:, pad:] = rows
    return crc_of_padded_rows(padded, np.full(len(rows), pad))


# MAVLink packets with a right checksum, found by a compiled walk over the bytes.
#
# Does what the numpy pass of :mod:`attlog.formats.mavlink.walk` does, five times as
# fast; used for large files where its machine code is at hand. The checksum takes eight
# bytes a step (slicing-by-8; Kounavis and Berry 2005).

MIN_COMPILED_BYTES = 12 << 20
"""Below this many bytes loading compiled code costs more than it saves (25 ms against 3 ms per MB)."""

_WALKED_PACKETS = 1 << 16


def is_walk_worthwhile(data: NDArray[np.uint8]) -> bool:
    """Whether :func:`compiled_packets` can be used and is worth it."""
    return (
        file_bytes.is_compiled_worthwhile("mavlink", len(data), MIN_COMPILED_BYTES)
        and compiled_if_cheap(walk_packets) is not None
    )


def walk_all_packets(
    data: NDArray[np.uint8], seeds: NDArray[np.int16], sizes: NDArray[np.int16]
) -> tuple[Offsets, Offsets, NDArray[np.int32]]:
    """Marker offsets, end offsets and message ids of all packets of known messages, in file order.

    ``seeds`` (CRC extra, -1 unknown) and ``sizes`` (payload bytes) by message id. A
    packet inside an accepted one is payload.
    """
    walk, tables, width = (walk_packets.compiled(), slicing_tables(), offset_type(len(data)))
    starts, ends, ids = (
        np.empty(_WALKED_PACKETS, np.int64),
        np.empty(_WALKED_PACKETS, np.int64),
        np.empty(_WALKED_PACKETS, np.int32),
    )
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
        position = int(end)
    return n


@jit.loop("the reader's copying of payloads")
def copy_payloads(data: U8, offsets: I32, size: int, out: U8Out) -> int:
    """The payloads of packets (rows of ``size`` bytes), what the sender left out or the file has no room for zero."""
    for i in range(len(offsets)):
        at, place = np.int64(offsets[i]), i * size
        if at < 0 or at + 2 > len(data):
            return i
        begin = at + (10 if data[at] == 0xFD else 6)
        here = min(int(data[at + 1]), size, int(len(data) - begin))
        copy_record(data, begin, max(here, 0), out, place)
        for k in range(max(here, 0), size):
            out[place + k] = 0
    return len(offsets)


# Where the MAVLink packets of a tlog or a raw capture are, found by their checksums in one vectorised pass.
#
# Every ``fe`` (MAVLink 1) or ``fd`` (MAVLink 2) byte may begin a packet; one whose
# checksum over header, payload and the message's seed (CRC extra) is right, is one.
# So damage needs no resynchronisation: nothing before or behind a packet matters.
# Source: MAVLink guide, "Packet Serialization"; CRC-16/MCRF4XX.

SIGNED_FLAG = 0x01  # incompatibility flag of MAVLink 2: a signature of 13 bytes follows the checksum
SIGNATURE_BYTES = 13
_SEARCH_BYTES = 1 << 21  # bytes whose packets are sought at once, bounds the memory
_PADDING_BYTES = 16  # packets of up to this many bytes difference share one checksum pass
_CRC_BATCH_BYTES = 1 << 18  # bytes whose checksums are taken at once, stays in cache


@dataclass(slots=True)
class Packets:
    """The packets of a file in file order: offset of the marker byte, message id and sender.

    ``stamped`` tells a tlog (each packet behind its receiver time) from a raw capture.
    """

    offsets: Offsets
    ids: NDArray[np.int32]
    senders: NDArray[np.uint16]  # system * 256 + component
    stamped: bool
    unknown: Counter[int] = field(default_factory=Counter)
    losses: DamageLog = field(default_factory=DamageLog)


@dataclass(frozen=True, slots=True)
class Catalogue:
    """What is known of the messages, arrays by message id: CRC extra (-1 unknown) and full payload size."""

    seeds: NDArray[np.int16]
    sizes: NDArray[np.int16]

    def knows(self, number: int) -> bool:
        """True for a message of the dialect."""
        return number < len(self.seeds) and self.seeds[number] >= 0


def _marker_offsets(data: NDArray[np.uint8], value: int, smallest: int, start: int) -> NDArray[np.int64]:
    """The offsets of a marker byte from ``start`` on, for one chunk, behind which the smallest packet still fits."""
    stop = min(start + _SEARCH_BYTES, len(data) - smallest + 1)
    return np.flatnonzero(data[start : max(stop, start)] == value) + start


@dataclass(slots=True)
class _Headers:
    """The headers of known messages that marker bytes would begin, taken at their word."""

    at: NDArray[np.int64]
    covered: NDArray[np.int64]  # bytes from behind the marker to before the checksum
    end: NDArray[np.int64]
    ids: NDArray[np.int32]

    def chosen(self, select: NDArray[Any]) -> _Headers:
        """The selected ones."""
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
    """True for the headers whose checksum is right."""
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
    """True for packets that do not begin inside an accepted one (a tunnelled packet is payload)."""
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
    """Begin, end and message id of the packets with a right checksum, in file order."""
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


def index_packets(data: NDArray[np.uint8], catalogue: Catalogue) -> Packets:
    """All packets of known messages with a right checksum.

    Packets of unknown messages cannot be checked. They count as such where a
    whole chain of them fills the space between two checked packets; any other
    bytes are damage.
    """
    if is_walk_worthwhile(data):
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
    """Leaves out the packets of those who sent least, where more seem to send than any network has."""
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
    """Fills in what lies between the packets: unknown messages, wrong checksums or other damage."""
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
    """Begin, end and message id of unchecked packets that fill a hole exactly; empty if there is no such chain."""
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
