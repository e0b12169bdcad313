"""Find the MAVLink packets of a tlog or raw capture by their checksums.

Every ``fe`` (MAVLink 1) or ``fd`` (MAVLink 2) byte may begin a packet; one whose checksum over header, payload and the
message's seed (CRC extra) is right, is one. So damage needs no resynchronisation. Source: MAVLink guide, "Packet
Serialization"; CRC-16/MCRF4XX.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.brief import counted
from attlog.core.jit import Cells, IOut1
from attlog.core.limits import MAX_SENDERS
from attlog.core.timestamps import Offsets
from attlog.formats.file_bytes import ERASED, KEPT_ERASED_BYTES, gather, offset_type
from attlog.formats.mavlink.layout import MAVLINK_1, MAVLINK_2, STAMP_BYTES, Catalogue, byte_table
from attlog.formats.table import OTHER_DIALECT, DamageLog

# MAVLink 2's incompatibility flag of a signature behind the checksum.
SIGNED_FLAG, SIGNATURE_BYTES = 0x01, 13
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
    start, end, ids = walk_all_packets(data, catalogue)
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
    lost = f"{counted(packets_lost, 'packet')} of {senders - MAX_SENDERS} senders beyond the {MAX_SENDERS} with most"
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
        if stop - begin > KEPT_ERASED_BYTES and not np.isin(data[begin:stop], list(ERASED), invert=True).any():
            lost = counted(stop - begin, "erased byte")
        else:
            lost = f"{counted(stop - begin, 'byte')} without a packet of right checksum"
        packets.losses.add(begin, stop - begin, lost, resumed)
    for number, found in wrong.items():
        length = sum(after - offset for offset, after in found)
        lost = f"{counted(len(found), 'packet')} of message {number} with a wrong checksum "
        lost += OTHER_DIALECT
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


def slicing_tables() -> NDArray[np.uint16]:
    """Return the CRC tables (8, 256) of eight bytes a step (slicing-by-8; Kounavis and Berry 2005)."""
    tables = [byte_table()]
    for _ in range(7):
        tables.append((tables[-1] >> 8) ^ byte_table()[tables[-1] & 0xFF])
    return np.stack(tables)


def walk_all_packets(data: NDArray[np.uint8], catalogue: Catalogue) -> tuple[Offsets, Offsets, NDArray[np.int32]]:
    """Return begin, end and message id of all packets with a right checksum, in file order.

    A packet inside an accepted one is its payload.
    """
    tables, width = slicing_tables(), offset_type(len(data))
    starts, ends = np.empty(_WALKED_PACKETS, np.int64), np.empty(_WALKED_PACKETS, np.int64)
    ids = np.empty(_WALKED_PACKETS, np.int32)
    blocks = []
    position, n = 0, _WALKED_PACKETS
    while n == _WALKED_PACKETS:
        n = walk_packets(data, position, catalogue.seeds, catalogue.sizes, tables, starts, ends, ids)
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
