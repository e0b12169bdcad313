"""Where the MAVLink packets of a tlog or a raw capture are, found by their checksums in one vectorised pass.

Every ``fe`` (MAVLink 1) or ``fd`` (MAVLink 2) byte may begin a packet; one whose
checksum over header, payload and the message's seed (CRC extra) is right, is one.
So damage needs no resynchronisation: nothing before or behind a packet matters.
Source: MAVLink guide, "Packet Serialization"; CRC-16/MCRF4XX.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.base.limits import MAX_SENDERS
from attlog.formats.base import Offsets
from attlog.formats.losses import Losses
from attlog.formats.mapping import gather, offset_type
from attlog.formats.mavlink.compiled import compiled_packets, pays
from attlog.formats.mavlink.crc import crc_of_padded_rows, crc_of_rows
from attlog.formats.mavlink.detect import STAMP_LENGTH, V1, V2

SIGNED = 0x01  # incompatibility flag of MAVLink 2: a signature of 13 bytes follows the checksum
SIGNATURE_LENGTH = 13
_CHUNK = 1 << 21  # bytes whose packets are sought at once, bounds the memory
_PADDING = 16  # packets of up to this many bytes difference share one checksum pass
_BATCH = 1 << 18  # bytes whose checksums are taken at once, stays in cache


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
    losses: Losses = field(default_factory=Losses)


@dataclass(frozen=True, slots=True)
class Catalogue:
    """What is known of the messages, arrays by message id: CRC extra (-1 unknown) and full payload size."""

    seeds: NDArray[np.int16]
    sizes: NDArray[np.int16]

    def knows(self, number: int) -> bool:
        """True for a message of the dialect."""
        return number < len(self.seeds) and self.seeds[number] >= 0


def _markers(data: NDArray[np.uint8], value: int, smallest: int, start: int) -> NDArray[np.int64]:
    """The offsets of a marker byte from ``start`` on, for one chunk, behind which the smallest packet still fits."""
    stop = min(start + _CHUNK, len(data) - smallest + 1)
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
    at = _markers(data, V1, 8, start)
    limit = np.full(256, -1, np.int16)
    limit[: len(catalogue.seeds)] = np.where(catalogue.seeds >= 0, catalogue.sizes, -1)[:256]
    ids = data[at + 5]
    length = data[at + 1]
    possible = np.flatnonzero(length <= limit[ids])
    at, ids, covered = at[possible], ids[possible], length[possible].astype(np.int64) + 5
    headers = _Headers(at, covered, at + covered + 3, ids.astype(np.int32))
    return headers.chosen(headers.end <= len(data))


def _headers_v2(data: NDArray[np.uint8], catalogue: Catalogue, start: int) -> _Headers:
    at = _markers(data, V2, 12, start)
    at = at[data[at + 2] <= SIGNED]  # other incompatibility flags are not defined
    ids = (gather(data, at + 6, np.dtype("<u4")) >> 8).astype(np.int32)  # behind the component: 24 bits
    listed = np.flatnonzero(ids < len(catalogue.seeds))
    known = listed[catalogue.seeds[ids[listed]] >= 0]
    at, ids = at[known], ids[known]
    covered = data[at + 1].astype(np.int64) + 9
    headers = _Headers(at, covered, at + covered + 3 + SIGNATURE_LENGTH * data[at + 2].astype(np.int64), ids)
    return headers.chosen(headers.end <= len(data))


def _checked(data: NDArray[np.uint8], headers: _Headers, catalogue: Catalogue) -> NDArray[np.bool_]:
    """True for the headers whose checksum is right."""
    good = np.zeros(len(headers.at), np.bool_)
    if len(good) == 0:
        return good
    sent = gather(data, headers.at + 1 + headers.covered, np.dtype("<u2"))
    seeds = catalogue.seeds[headers.ids].astype(np.uint8)
    widths = (headers.covered + _PADDING) // _PADDING * _PADDING  # room for the covered bytes and the seed
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
        width = int(sorted_widths[begin]) if stop > begin else _PADDING
        step = max(_BATCH // width, 1)
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


def searched(data: NDArray[np.uint8], catalogue: Catalogue) -> tuple[Offsets, Offsets, NDArray[np.int32]]:
    """Begin, end and message id of the packets with a right checksum, in file order."""
    width = offset_type(len(data))
    starts: list[Offsets] = []
    ends: list[Offsets] = []
    numbers: list[NDArray[np.int32]] = []
    for first in range(0, max(len(data), 1), _CHUNK):
        found = []
        for headers in (_headers_v1(data, catalogue, first), _headers_v2(data, catalogue, first)):
            found.append(headers.chosen(_checked(data, headers, catalogue)))
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
    if pays(data):
        start, end, ids = compiled_packets(data, catalogue.seeds, catalogue.sizes)
    else:
        start, end, ids = searched(data, catalogue)
    gaps = start[1:] - end[:-1]
    if len(gaps):
        stamped = bool(np.count_nonzero(gaps == STAMP_LENGTH) > np.count_nonzero(gaps == 0))
    else:
        stamped = len(start) > 0 and int(start[0]) >= STAMP_LENGTH
    if stamped and start[0] < STAMP_LENGTH:  # a file that begins inside a receiver time
        start, end, ids = start[1:], end[1:], ids[1:]
    place = np.where(data.take(start) == V2, np.uint8(5), np.uint8(3))
    senders = gather(data, start + place, np.dtype(">u2")).astype(np.uint16)
    packets = Packets(start, ids, senders, stamped)
    _account(data, packets, end, catalogue)
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


def _account(data: NDArray[np.uint8], packets: Packets, end: Offsets, catalogue: Catalogue) -> None:
    """Fills in what lies between the packets: unknown messages, wrong checksums or other damage."""
    size = len(data)
    stamp = STAMP_LENGTH if packets.stamped else 0
    # where each packet should begin, and where it does; in front of the first and behind the last one too
    begins = np.concatenate([np.zeros(1, end.dtype), end])
    stops = np.append(packets.offsets - stamp, end.dtype.type(size))
    torn = (stops[:-1] < begins[:-1]).nonzero()[0]
    stops[torn] += stamp  # less than a receiver time between two packets is what damage left of one
    holes = (stops != begins).nonzero()[0]
    wrong: dict[int, list[tuple[int, int]]] = {}
    for begin, stop in zip(begins[holes].tolist(), stops[holes].tolist(), strict=True):
        chain = _chain(data, begin, stop, stamp)
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


def _chain(data: NDArray[np.uint8], begin: int, stop: int, stamp: int) -> list[tuple[int, int, int]]:
    """Begin, end and message id of unchecked packets that fill a hole exactly; empty if there is no such chain."""
    found = []
    at = begin
    while at < stop:
        head = data[at + stamp : min(at + stamp + 10, stop)].tobytes()
        if len(head) >= 8 and head[0] == V1:
            after, number = at + stamp + 8 + head[1], head[5]
        elif len(head) == 10 and head[0] == V2 and head[2] <= SIGNED:
            after = at + stamp + 12 + head[1] + SIGNATURE_LENGTH * head[2]
            number = int.from_bytes(head[7:10], "little")
        else:
            return []
        found.append((at, after, number))
        at = after
    return found if at == stop else []
