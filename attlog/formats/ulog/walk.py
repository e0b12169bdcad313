"""Follow chains of ULog data records: the one pass over all bytes of a log.

A data record is ``u16 size, 'D', u16 id, payload``, and the next record begins
where it ends. Both followers return the starts of consecutive data records from
a position on and stop at anything else. :class:`NumpyChain` looks for the type
byte in a block at once and keeps the places where the size fits the id;
:class:`NumbaChain` walks from record to record and is chosen for large logs where
its machine code is at hand, since compiling it costs more than it saves on one log.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.jit import IOut1
from attlog.core.timestamps import Offsets, is_near, rise_nearby
from attlog.formats.file_bytes import U8, U16, U16Out, compiled_if_cheap, gather, is_compiled_worthwhile, offset_type
from attlog.formats.ulog.layout import (
    FILE_HEADER,
    MAGIC,
    MAX_HEAD_BYTES,
    SYNC,
    TopicLayout,
    is_odd_definition,
    is_record,
)

Bytes = NDArray[np.uint8]
Identifiers = NDArray[np.uint16]
Segments = list[tuple[Offsets, Identifiers]]
"""Starts and ids of data records that follow each other, in file order."""

MAX_BLOCK_BYTES = 1 << 20
FIRST_BLOCK_BYTES = 1 << 12
"""Bytes compared at once after the sizes changed, four times as many each time until BLOCK: they may change again."""
RECORDS_BEFORE_BLOCK = 8
"""Records that are walked one by one before a block is compared."""
MAX_SEGMENT_RECORDS = 1 << 14
"""Records that a compiled walk takes at once: what it writes stays in the processor's cache until it is copied."""
MIN_COMPILED_BYTES = 32 << 20
"""Below this many bytes loading compiled code costs more than it saves."""
DATA = ord("D")
SYNC_MARK = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
"""A record of its own, which the logger writes now and then so that the places behind damage are found."""
DATA_HEADER_BYTES = 5
"""Bytes before the payload of a data record: size, type, id."""


def identifier_at(raw: memoryview, start: int) -> int:
    """The id of the data record that starts here."""
    identifier: int = raw[start + 3] | raw[start + 4] << 8
    return identifier


class Sizes:
    """Payload sizes (with the id) that a data record may have, by id; 0 where the id is unknown."""

    def __init__(self) -> None:
        self.smallest = np.zeros(65536, np.uint16)
        self.spread = np.zeros(65536, np.uint16)
        self._known: list[int] = []

    def set(self, identifier: int, smallest: int, largest: int) -> bool:
        """Allow the sizes from ``smallest`` to ``largest`` for an id; returns whether that is news."""
        is_new = (self.smallest[identifier], self.spread[identifier]) != (smallest, largest - smallest)
        if is_new:
            self._known.append(identifier)
        self.smallest[identifier] = smallest
        self.spread[identifier] = largest - smallest
        return is_new

    def forget(self) -> None:
        """No id is known."""
        self.smallest[self._known] = 0
        self.spread[self._known] = 0
        self._known.clear()


class Chain(Protocol):
    """Finds data records; ``forget`` must be called when the sizes change.

    ``group`` is how many records should be sorted by id together: it bounds the memory that sorting takes.
    """

    group: int

    def follow(self, position: int, stop: int) -> tuple[Offsets, Identifiers]:
        """Starts and ids of a segment of consecutive data records from ``position`` on that ends before ``stop``."""

    def forget(self) -> None:
        """Drop what was concluded from the sizes before."""


class NumpyChain:
    """Segments of data records by whole-block comparison."""

    group = 1 << 17

    def __init__(self, data: Bytes, sizes: Sizes) -> None:
        self._data, self._sizes, self._width = data, sizes, offset_type(len(data))
        self.forget()

    def forget(self) -> None:
        """Look at the block anew."""
        self._begin = self._end = 0
        self._block = FIRST_BLOCK_BYTES
        self._knows_few = False

    def follow(self, position: int, stop: int) -> tuple[Offsets, Identifiers]:
        """Starts and ids of the unbroken segment that lies in one block."""
        if not self._begin <= position < self._end:
            if not self._knows_few:
                self._knows_few = True
                return self._few(position, stop)
            self._look(position)
        first = int(self._starts.searchsorted(position))
        if first == len(self._starts) or self._starts[first] != position:
            return self._starts[:0].astype(self._width), self._ids[:0]
        last = int(self._breaks[self._breaks.searchsorted(first)]) + 1
        if self._ends[last - 1] > stop:
            last = first + int(self._ends[first:last].searchsorted(stop, side="right"))
        return self._starts[first:last].astype(self._width), self._ids[first:last]

    def _few(self, position: int, stop: int) -> tuple[Offsets, Identifiers]:
        """The first records after the sizes changed, one by one."""
        raw, smallest, spread = self._data.data, self._sizes.smallest, self._sizes.spread
        starts: list[int] = []
        ids: list[int] = []
        while len(starts) < RECORDS_BEFORE_BLOCK and position + DATA_HEADER_BYTES <= stop and raw[position + 2] == DATA:
            size, identifier = raw[position] | raw[position + 1] << 8, identifier_at(raw, position)
            least = int(smallest[identifier])
            if not 0 < least <= size <= least + int(spread[identifier]) or position + 3 + size > stop:
                break
            starts.append(position)
            ids.append(identifier)
            position += 3 + size
        return np.array(starts, self._width), np.array(ids, np.uint16)

    def _look(self, position: int) -> None:
        """All places in the next block that look like a data record, and where their chain breaks."""
        self._begin, self._end = position, min(position + self._block, len(self._data))
        self._block = min(4 * self._block, MAX_BLOCK_BYTES)
        length = self._end - position
        block = self._data[position : self._end + DATA_HEADER_BYTES - 1]
        if len(block) < length + DATA_HEADER_BYTES - 1:
            block = np.concatenate([block, np.zeros(length + DATA_HEADER_BYTES - 1 - len(block), np.uint8)])
        at = (block[2 : length + 2] == DATA).nonzero()[0]
        size, ids = _u16_at(block, at), _u16_at(block, at + 3)
        smallest = self._sizes.smallest.take(ids)
        fits = size - smallest <= self._sizes.spread.take(ids)
        fits &= smallest > 0
        kept = fits.nonzero()[0]
        starts, size = at.take(kept), size.take(kept)
        starts += position
        ends = starts + size
        ends += 3
        inside = len(ends) if not len(ends) or ends[-1] <= len(self._data) else int((ends <= len(self._data)).argmin())
        self._starts, self._ends, self._ids = starts[:inside], ends[:inside], ids.take(kept[:inside])
        broken = np.ones(inside, bool)
        np.not_equal(self._ends[:-1], self._starts[1:], out=broken[:-1])
        breaks = broken.nonzero()[0]
        self._breaks = breaks[~self._leads_over_a_mark(breaks)]

    def _leads_over_a_mark(self, breaks: Offsets) -> NDArray[np.bool_]:
        """Which breaks are synchronisation marks with the next record behind them."""
        over = np.zeros(len(breaks), bool)
        if len(breaks) > 1:
            marks = self._ends[breaks[:-1]]
            over[:-1] = self._starts[breaks[:-1] + 1] - marks == len(SYNC_MARK)
            for k in over.nonzero()[0].tolist():
                over[k] = self._data[marks[k] : marks[k] + len(SYNC_MARK)].tobytes() == SYNC_MARK
        return over


def _u16_at(block: Bytes, at: Offsets) -> NDArray[np.uint16]:
    """The u16 at each place."""
    found = block.take(at + 1).astype(np.uint16)
    found <<= 8
    found |= block.take(at)
    return found


class NumbaChain:
    """Segments of data records by a compiled walk."""

    group = 1 << 22

    def __init__(self, data: Bytes, sizes: Sizes) -> None:
        self._data, self._sizes, self._width = data, sizes, offset_type(len(data))
        self._walk = walk_data_records.compiled()
        self._starts, self._ids = np.empty(MAX_SEGMENT_RECORDS, np.int64), np.empty(MAX_SEGMENT_RECORDS, np.uint16)

    def forget(self) -> None:
        """Nothing is kept between calls."""

    def follow(self, position: int, stop: int) -> tuple[Offsets, Identifiers]:
        """Starts and ids of the segment, at most one buffer of them; passes over synchronisation marks."""
        sizes, starts, ids = self._sizes, self._starts, self._ids
        n = self._walk(self._data, position, stop, sizes.smallest, sizes.spread, starts, ids)
        return starts[:n].astype(self._width), ids[:n].copy()


# Places are unsigned in this loop: a signed one could count from the end, and asking costs a third of the time.


@jit.loop("the reader's walk over messages")
def walk_data_records(
    data: U8, position: int, stop: int, smallest: U16, spread: U16, starts: IOut1, ids: U16Out
) -> int:
    """Starts and ids of consecutive data records from ``position`` on; returns how many."""
    n, room = np.uint64(0), np.uint64(len(starts))
    at, end = np.uint64(position), np.uint64(stop)
    while n < room and at + np.uint64(5) <= end:
        size = np.uint64(data[at]) | np.uint64(data[at + np.uint64(1)]) << np.uint64(8)
        kind = data[at + np.uint64(2)]
        first = np.uint64(data[at + np.uint64(3)])
        if kind == 68:
            identifier = first | np.uint64(data[at + np.uint64(4)]) << np.uint64(8)
            least = np.uint64(smallest[identifier])
            behind = at + np.uint64(3) + size
            if least == 0 or size < least or size > least + np.uint64(spread[identifier]) or behind > end:
                break
            starts[n] = at
            ids[n] = identifier
            n += np.uint64(1)
            at = behind
        else:
            mark = at + np.uint64(11)
            if kind != 83 or n == 0 or size != 8 or first != 0x2F or mark > end or data[mark - np.uint64(1)] != 0x12:
                break
            at = mark
    return np.int64(n)  # type: ignore[return-value]


def fastest_chain(data: Bytes, sizes: Sizes) -> Chain:
    """The follower that is faster now: compiled where that is at hand, else numpy."""
    is_worth = (
        is_compiled_worthwhile("ulog", len(data), MIN_COMPILED_BYTES)
        and compiled_if_cheap(walk_data_records) is not None
    )
    return NumbaChain(data, sizes) if is_worth else NumpyChain(data, sizes)


# Is there a record at this byte? The questions that finding records among damage comes down to.
#
# ULog has no checksums: a place is judged by whether its record and the ones behind
# it are well formed.

DATA_KIND = ord("D")
ANCHOR_RECORDS = 3
"""Records in a row that must make sense before reading goes on behind damage."""
FIRST_SEARCH_BYTES, MAX_SEARCH_BYTES = 1 << 12, 1 << 20
"""Bytes looked at together behind damage: most damage are short, some are whole flash blocks."""
KNOWN_KINDS = np.zeros(256, bool)
KNOWN_KINDS[list(b"ABCDFILMOPQRS")] = True
"""Record types that the format knows."""


class Framing:
    """Judges places of a log by its bytes and by the sizes that subscribed records have.

    ``is_timely`` tells whether the time of the data record at a place is near those before.
    """

    def __init__(self, data: Bytes, sizes: Sizes, is_timely: Callable[[int], bool]) -> None:
        self.data, self.raw, self.size, self.sizes = data, data.data, len(data), sizes
        self._is_timely = is_timely
        self.checked = -1

    def end(self, start: int) -> int:
        """Where the record that starts here says it ends."""
        return start + 3 + (self.raw[start] | self.raw[start + 1] << 8)

    def is_header(self, position: int) -> bool:
        """Whether a file header stands here: another log begins."""
        return self.raw[position] == MAGIC[0] and self.raw[position : position + len(MAGIC)] == MAGIC

    def is_strict(self, position: int, end: int) -> bool:
        """Whether the record that is not data looks exactly as its type demands."""
        if position == self.checked:
            return True
        return is_record(self.raw[position + 2], self._head(position, end), end - position - 3)

    def _head(self, position: int, end: int) -> bytes:
        return bytes(self.raw[position + 3 : min(end, position + 3 + MAX_HEAD_BYTES)])

    def is_cut_off(self, position: int, stop: int) -> bool:
        """Whether the beginning of a record stands here whose end is missing."""
        return position + 3 > stop or (self.end(position) > stop and self._begins_well(position))

    def leads_on(self, position: int, stop: int, records: int, *, odd: bool = False) -> bool:
        """Whether ``records`` well-formed records follow, or the end of the section comes before.

        ``odd``: behind a good record definitions under names that no logger gives will do too.
        """
        for _ in range(records):
            if position >= stop - 2 or self.is_header(position):
                return True
            kind, end = self.raw[position + 2], self.end(position)
            if end > stop:
                return self._begins_well(position)
            if kind == DATA_KIND:
                if end < position + DATA_HEADER_BYTES:
                    return False
                identifier = identifier_at(self.raw, position)
                if self.sizes.smallest[identifier] and not self._size_fits(identifier, end - position - 3):
                    return False
            elif is_record(kind, self._head(position, end), end - position - 3):
                self.checked = position
            elif not odd or not is_odd_definition(kind, self._head(position, end), end - position - 3):
                return False
            position = end
        return True

    def anchor(self, position: int, stop: int) -> int:
        """The first place from ``position`` on where records make sense again, else ``stop``."""
        length = FIRST_SEARCH_BYTES
        while position < stop:
            end = min(position + length, stop)
            for candidate in self._candidates(position, end):
                if self._is_anchor(candidate, stop):
                    return candidate
            position, length = end, min(length * 4, MAX_SEARCH_BYTES)
        return stop

    def _is_anchor(self, position: int, stop: int) -> bool:
        if self.is_header(position):
            return position + FILE_HEADER <= stop
        if self.end(position) > stop or not self.leads_on(position, stop, ANCHOR_RECORDS):
            return False
        return self.raw[position + 2] != DATA_KIND or self._is_timely(position)

    def _begins_well(self, position: int) -> bool:
        size, kind = self.end(position) - position - 3, self.raw[position + 2]
        if kind != DATA_KIND:
            return bool(KNOWN_KINDS[kind]) and size > 0
        return position + DATA_HEADER_BYTES > self.size or self._size_fits(identifier_at(self.raw, position), size)

    def _size_fits(self, identifier: int, size: int) -> bool:
        smallest = int(self.sizes.smallest[identifier])
        return smallest > 0 and smallest <= size <= smallest + int(self.sizes.spread[identifier])

    def _candidates(self, begin: int, end: int) -> list[int]:
        """Places whose first bytes could be a record that can be checked."""
        last = min(end, self.size - DATA_HEADER_BYTES)
        if last <= begin:
            return []
        window = self.data[begin : last + DATA_HEADER_BYTES - 1]
        count = last - begin
        size = window[:count].astype(np.int32) | window[1 : count + 1].astype(np.int32) << 8
        kind = window[2 : count + 2]
        identifier = window[3 : count + 3].astype(np.int32) | window[4 : count + 4].astype(np.int32) << 8
        smallest = self.sizes.smallest[identifier].astype(np.int32)
        data = (kind == DATA_KIND) & (smallest > 0) & (size >= smallest)
        data &= size <= smallest + self.sizes.spread[identifier]
        small = ((kind == ord("R")) | (kind == ord("O"))) & (size == 2) | (kind == ord("S")) & (size == len(SYNC))
        other = KNOWN_KINDS[kind] & (size > 2) & (kind != DATA_KIND) & (kind != ord("S"))
        header = (window[:count] == MAGIC[0]) & (window[1 : count + 1] == MAGIC[1]) & (kind == MAGIC[2])
        found = np.flatnonzero(data | small | other | header)
        return (found + begin).tolist()


# The boot clock of ULog records: the u64 ``timestamp`` (us) that most topics carry, and which times are believed.
#
# ULog has no checksums, so a time far from its neighbours is the best sign of bytes that are no record.


class RecordClock:
    """Times of data records while a log is walked, by the place of the stamp that each subscribed topic has."""

    def __init__(self, raw: memoryview) -> None:
        self._raw = raw
        self._places: dict[int, int | None] = {}

    def forget(self) -> None:
        """Another log with its own definitions begins."""
        self._places.clear()

    def subscribe(self, identifier: int, layout: TopicLayout) -> None:
        """Records of this id have this layout from now on."""
        self._places[identifier] = layout.time_at

    def time_at(self, start: int) -> int | None:
        """The stamp of the data record that starts here, None if its topic has none."""
        place = self._places.get(identifier_at(self._raw, start))
        return None if place is None else int(struct.unpack_from("<Q", self._raw, start + DATA_HEADER_BYTES + place)[0])

    def is_timely(self, start: int, recent: list[int]) -> bool:
        """Whether the data record's time is near one of those that start at ``recent``; True where nothing tells."""
        now = self.time_at(start)
        return is_near(now, map(self.time_at, recent))


def times_rise(data: Bytes, starts: Offsets, layout: TopicLayout) -> bool:
    """Whether records, read by this layout, have times that rise and stay near each other; False without stamp."""
    if layout.time_at is None:
        return False
    return rise_nearby(gather(data[DATA_HEADER_BYTES + layout.time_at :], starts, np.dtype("<u8")))
