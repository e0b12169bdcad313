"""Find the records of a ULog: chains of data records in whole blocks, and single records among damage.

A data record is ``u16 size, 'D', u16 id, payload``; the next record begins at its end. ULog has no checksums, so a
record is validated by its header, the records behind it, and their times.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from attlog.core.timestamps import Offsets, is_near, rise_nearby
from attlog.formats.file_bytes import gather, offset_type
from attlog.formats.ulog.layout import (
    FILE_HEADER,
    MAGIC,
    MAX_HEAD_BYTES,
    SYNC,
    SYNC_MARK,
    TopicLayout,
    is_odd_definition,
    is_record,
)

Bytes = NDArray[np.uint8]
Identifiers = NDArray[np.uint16]
Segments = list[tuple[Offsets, Identifiers]]  # starts and ids of successive data records, in file order

DATA = ord("D")
KNOWN_KINDS = np.zeros(256, bool)
KNOWN_KINDS[list(b"ABCDFILMOPQRS")] = True
# Bytes before the payload of a data record: size, type, id.
DATA_HEADER_BYTES = 5
# Bytes compared at once after the sizes changed, four times as many each time: sizes change often at the beginning.
FIRST_BLOCK_BYTES, MAX_BLOCK_BYTES = 1 << 12, 1 << 20
# Records sorted by id together; bounds the memory of sorting.
MAX_SORTED_RECORDS = 1 << 17
# Valid records in a row from which reading goes on behind damage.
ANCHOR_RECORDS = 3
# Bytes searched at once behind damage: most damage is short, some is whole flash blocks.
FIRST_SEARCH_BYTES, MAX_SEARCH_BYTES = 1 << 12, 1 << 20


def identifier_at(raw: memoryview, start: int) -> int:
    """Return the id of the data record at a position."""
    identifier: int = raw[start + 3] | raw[start + 4] << 8
    return identifier


class Sizes:
    """Payload sizes (with the id) of data records, by id. 0 for unknown ids."""

    def __init__(self) -> None:
        self.smallest = np.zeros(65536, np.uint16)
        self.spread = np.zeros(65536, np.uint16)
        self._known: list[int] = []

    def set(self, identifier: int, smallest: int, largest: int) -> bool:
        """Allow sizes for an id; return True for a change."""
        is_new = (self.smallest[identifier], self.spread[identifier]) != (smallest, largest - smallest)
        if is_new:
            self._known.append(identifier)
        self.smallest[identifier] = smallest
        self.spread[identifier] = largest - smallest
        return is_new

    def fits(self, identifier: int, size: int) -> bool:
        """Return whether a record of this id may have this size."""
        smallest = int(self.smallest[identifier])
        return 0 < smallest <= size <= smallest + int(self.spread[identifier])

    def forget(self) -> None:
        """Clear all ids."""
        self.smallest[self._known] = 0
        self.spread[self._known] = 0
        self._known.clear()


class DataChain:
    """Chain of successive data records, found block by block; call :meth:`forget` when the sizes change."""

    def __init__(self, data: Bytes, sizes: Sizes) -> None:
        self._data, self._sizes, self._width = data, sizes, offset_type(len(data))
        self.forget()

    def forget(self) -> None:
        """Drop the block."""
        self._begin = self._end = 0
        self._block = FIRST_BLOCK_BYTES

    def follow(self, position: int, stop: int) -> tuple[Offsets, Identifiers]:
        """Return starts and ids of contiguous records from ``position`` to ``stop``, at most to the block's end."""
        if not self._begin <= position < self._end:
            self._look(position)
        first = int(self._starts.searchsorted(position))
        if first == len(self._starts) or self._starts[first] != position:
            return self._starts[:0].astype(self._width), self._ids[:0]
        last = int(self._breaks[self._breaks.searchsorted(first)]) + 1
        if self._ends[last - 1] > stop:
            last = first + int(self._ends[first:last].searchsorted(stop, side="right"))
        return self._starts[first:last].astype(self._width), self._ids[first:last]

    def _look(self, position: int) -> None:
        """Find data record candidates in the next block, and breaks between them."""
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
        """Mark the breaks that consist of a synchronisation mark."""
        over = np.zeros(len(breaks), bool)
        if len(breaks) > 1:
            marks = self._ends[breaks[:-1]]
            over[:-1] = self._starts[breaks[:-1] + 1] - marks == len(SYNC_MARK)
            for k in over.nonzero()[0].tolist():
                over[k] = self._data[marks[k] : marks[k] + len(SYNC_MARK)].tobytes() == SYNC_MARK
        return over


def _u16_at(block: Bytes, at: Offsets) -> NDArray[np.uint16]:
    found = block.take(at + 1).astype(np.uint16)
    found <<= 8
    found |= block.take(at)
    return found


class Framing:
    """Validation of records by their bytes, sizes, and the times of ``recent`` records."""

    def __init__(self, data: Bytes, sizes: Sizes) -> None:
        self.data, self.raw, self.size, self.sizes = data, data.data, len(data), sizes
        self.forget()

    def forget(self) -> None:
        """Reset for another power-up with its own definitions."""
        self.checked = -1  # a place whose record was found to be valid
        self.recent: list[int] = []
        self._time_places: dict[int, int | None] = {}

    def subscribe(self, identifier: int, layout: TopicLayout) -> None:
        """Set the layout of records of an id."""
        self._time_places[identifier] = layout.time_at
        self.sizes.set(identifier, layout.size + 2, layout.full_size + 2)

    def time_at(self, start: int) -> int | None:
        """Return the stamp of a data record, None without one."""
        place = self._time_places.get(identifier_at(self.raw, start))
        return None if place is None else int(struct.unpack_from("<Q", self.raw, start + DATA_HEADER_BYTES + place)[0])

    def end(self, start: int) -> int:
        """Return the end of the record at ``start``, by its size field."""
        return start + 3 + (self.raw[start] | self.raw[start + 1] << 8)

    def is_header(self, position: int) -> bool:
        """Return whether a file header begins at ``position``."""
        return self.raw[position] == MAGIC[0] and self.raw[position : position + len(MAGIC)] == MAGIC

    def is_strict(self, position: int, end: int) -> bool:
        """Return whether a record other than data is valid for its type."""
        if position == self.checked:
            return True
        return is_record(self.raw[position + 2], self._head(position, end), end - position - 3)

    def _head(self, position: int, end: int) -> bytes:
        return bytes(self.raw[position + 3 : min(end, position + 3 + MAX_HEAD_BYTES)])

    def is_cut_off(self, position: int, stop: int) -> bool:
        """Return whether a record at ``position`` extends beyond ``stop``."""
        return position + 3 > stop or (self.end(position) > stop and self._begins_well(position))

    def leads_on(self, position: int, stop: int, records: int, *, odd: bool = False) -> bool:
        """Return whether ``records`` valid records follow, or the section ends.

        ``odd``: accept definitions under unusual names, as behind a valid record.
        """
        for _ in range(records):
            if position >= stop - 2 or self.is_header(position):
                return True
            kind, end = self.raw[position + 2], self.end(position)
            if end > stop:
                return self._begins_well(position)
            size = end - position - 3
            if kind == DATA:
                if end < position + DATA_HEADER_BYTES:
                    return False
                identifier = identifier_at(self.raw, position)
                if self.sizes.smallest[identifier] and not self.sizes.fits(identifier, size):
                    return False
            elif is_record(kind, self._head(position, end), size):
                self.checked = position
            elif not odd or not is_odd_definition(kind, self._head(position, end), size):
                return False
            position = end
        return True

    def anchor(self, position: int, stop: int) -> int:
        """Return the first position from ``position`` on with ANCHOR_RECORDS valid records, else ``stop``."""
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
        return self.raw[position + 2] != DATA or is_near(self.time_at(position), map(self.time_at, self.recent))

    def _begins_well(self, position: int) -> bool:
        size, kind = self.end(position) - position - 3, self.raw[position + 2]
        if kind != DATA:
            return bool(KNOWN_KINDS[kind]) and size > 0
        return position + DATA_HEADER_BYTES > self.size or self.sizes.fits(identifier_at(self.raw, position), size)

    def _candidates(self, begin: int, end: int) -> list[int]:
        """Return the positions at which a record could begin, by kind, size and id."""
        last = min(end, self.size - DATA_HEADER_BYTES)
        if last <= begin:
            return []
        window = self.data[begin : last + DATA_HEADER_BYTES - 1]
        count = last - begin
        size = window[:count].astype(np.int32) | window[1 : count + 1].astype(np.int32) << 8
        kind = window[2 : count + 2]
        identifier = window[3 : count + 3].astype(np.int32) | window[4 : count + 4].astype(np.int32) << 8
        smallest = self.sizes.smallest[identifier].astype(np.int32)
        data = (kind == DATA) & (smallest > 0) & (size >= smallest)
        data &= size <= smallest + self.sizes.spread[identifier]
        small = ((kind == ord("R")) | (kind == ord("O"))) & (size == 2) | (kind == ord("S")) & (size == len(SYNC))
        other = KNOWN_KINDS[kind] & (size > 2) & (kind != DATA) & (kind != ord("S"))
        header = (window[:count] == MAGIC[0]) & (window[1 : count + 1] == MAGIC[1]) & (kind == MAGIC[2])
        found = np.flatnonzero(data | small | other | header)
        return (found + begin).tolist()


def times_rise(data: Bytes, starts: Offsets, layout: TopicLayout) -> bool:
    """Return whether records read by a layout have rising times within half a day; False without stamps."""
    if layout.time_at is None:
        return False
    return rise_nearby(gather(data[DATA_HEADER_BYTES + layout.time_at :], starts, np.dtype("<u8")))
