"""Follow chains of ULog data records: the one pass over all bytes of a log.

A data record is ``u16 size, 'D', u16 id, payload``, and the next record begins
where it ends. Both followers return the starts of consecutive data records from
a position on and stop at anything else. :class:`NumpyChain` looks for the type
byte in a block at once and keeps the places where the size fits the id;
:class:`NumbaChain` walks from record to record and is chosen for large logs where
its machine code is at hand, since compiling it costs more than it saves on one log.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Offsets
from attlog.formats.compiled import at_any_cost, if_cheap, kernel_of, pays
from attlog.formats.mapping import offset_type

Bytes = NDArray[np.uint8]
Identifiers = NDArray[np.uint16]
Segments = list[tuple[Offsets, Identifiers]]
"""Starts and ids of data records that follow each other, in file order."""

BLOCK = 1 << 20
FIRST_BLOCK = 1 << 12
"""Bytes compared at once after the sizes changed, four times as many each time until BLOCK: they may change again."""
FEW = 8
"""Records that are walked one by one before a block is compared."""
SEGMENT = 1 << 14
"""Records that a compiled walk takes at once: what it writes stays in the processor's cache until it is copied."""
WORTH_COMPILED = 32 << 20
"""Below this many bytes loading compiled code costs more than it saves."""
DATA = ord("D")
SYNC_MARK = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
"""A record of its own, which the logger writes now and then so that the places behind damage are found."""
HEADER = 5
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
        self._block = FIRST_BLOCK
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
        while len(starts) < FEW and position + HEADER <= stop and raw[position + 2] == DATA:
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
        self._block = min(4 * self._block, BLOCK)
        length = self._end - position
        block = self._data[position : self._end + HEADER - 1]
        if len(block) < length + HEADER - 1:
            block = np.concatenate([block, np.zeros(length + HEADER - 1 - len(block), np.uint8)])
        at = (block[2 : length + 2] == DATA).nonzero()[0]
        size, ids = _numbers(block, at), _numbers(block, at + 3)
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


def _numbers(block: Bytes, at: Offsets) -> NDArray[np.uint16]:
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
        self._walk = if_cheap(WALK) or at_any_cost(WALK)
        self._starts, self._ids = np.empty(SEGMENT, np.int64), np.empty(SEGMENT, np.uint16)

    def forget(self) -> None:
        """Nothing is kept between calls."""

    def follow(self, position: int, stop: int) -> tuple[Offsets, Identifiers]:
        """Starts and ids of the segment, at most one buffer of them; passes over synchronisation marks."""
        sizes, starts, ids = self._sizes, self._starts, self._ids
        n = self._walk(self._data, position, stop, sizes.smallest, sizes.spread, starts, ids)
        return starts[:n].astype(self._width), ids[:n].copy()


# Places are unsigned in this loop: a signed one could count from the end, and asking costs a third of the time.


def walk(data, position, stop, smallest, spread, starts, ids):  # type: ignore[no-untyped-def]
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
    return np.int64(n)


SOURCE = "formats/ulog/index.py"
WALK = kernel_of(walk, "i8((u1[::1]), i8, i8, u2[::1], u2[::1], i8[::1], u2[::1])", SOURCE)


def chain(data: Bytes, sizes: Sizes) -> Chain:
    """The follower that is faster now: compiled where that is at hand, else numpy."""
    is_worth = pays("ulog", len(data), WORTH_COMPILED) and if_cheap(WALK) is not None
    return NumbaChain(data, sizes) if is_worth else NumpyChain(data, sizes)
