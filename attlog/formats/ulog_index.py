"""Follow chains of ULog data records: the one pass over all bytes of a log.

A data record is ``u16 size, 'D', u16 id, payload``, and the next record begins
where it ends. Both followers return the starts of consecutive data records from
a position on and stop at anything else. :class:`NumpyChain` looks for the type
byte in a block at once and keeps the places where the size fits the id;
:class:`NumbaChain` walks from record to record and is chosen for large logs where
numba is loaded already, since importing it costs more than it saves on one log.
"""

from __future__ import annotations

import sys
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]

BLOCK = 1 << 20
WORTH_COMPILED = 32 << 20
"""Below this many bytes loading compiled code costs more than it saves."""
HEADER = 5
"""Bytes before the payload of a data record: size, type, id."""


class Sizes:
    """Payload sizes (with the id) that a data record may have, by id."""

    def __init__(self) -> None:
        self.smallest = np.zeros(65536, np.uint16)
        self.spread = np.zeros(65536, np.uint16)

    def set(self, identifier: int, smallest: int, largest: int) -> None:
        """Allow the sizes from ``smallest`` to ``largest`` for an id."""
        self.smallest[identifier] = smallest
        self.spread[identifier] = largest - smallest


class Chain(Protocol):
    """Finds data records; ``forget`` must be called when the sizes change."""

    def follow(self, position: int, stop: int) -> Offsets:
        """Starts of the unbroken run of data records from ``position`` on, all ending at or before ``stop``."""

    def forget(self) -> None:
        """Drop what was concluded from the sizes before."""


class NumpyChain:
    """Runs of data records by whole-block comparison."""

    def __init__(self, data: Bytes, sizes: Sizes) -> None:
        self._data = data
        self._sizes = sizes
        self.forget()

    def forget(self) -> None:
        """Look at the block anew."""
        self._begin = self._end = 0
        self._starts = self._breaks = np.zeros(0, np.int64)

    def follow(self, position: int, stop: int) -> Offsets:
        """Starts of the unbroken run of data records that lies in one block."""
        if not self._begin <= position < self._end:
            self._look(position)
        first = int(np.searchsorted(self._starts, position))
        if first == len(self._starts) or self._starts[first] != position:
            return self._starts[:0]
        last = int(self._breaks[np.searchsorted(self._breaks, first)])
        run = self._starts[first : last + 1]
        end = int(run[-1]) + 3 + self._size(int(run[-1]))
        return run if end <= stop else run[: np.searchsorted(run[1:], stop, side="right")]

    def _size(self, start: int) -> int:
        return int(self._data[start]) | int(self._data[start + 1]) << 8

    def _look(self, position: int) -> None:
        """All places in the next block that look like a data record, and where their chain breaks."""
        data, sizes = self._data, self._sizes
        self._begin, self._end = position, min(position + BLOCK, len(data))
        last_start = min(self._end, len(data) - HEADER + 1)
        starts = np.flatnonzero(data[position + 2 : max(last_start, position) + 2] == ord("D"))
        starts += position
        starts = starts[: np.searchsorted(starts, last_start)]
        size = _u16(data, starts)
        identifier = _u16(data, starts + 3)
        smallest = sizes.smallest[identifier]
        fits = (size - smallest <= sizes.spread[identifier]) & (smallest > 0)
        starts, size = starts[fits], size[fits]
        ends = starts + 3 + size
        inside = ends <= len(data)
        starts, ends = starts[inside], ends[inside]
        self._starts = starts
        broken = np.ones(len(starts), bool)
        np.not_equal(ends[:-1], starts[1:], out=broken[:-1])
        self._breaks = np.flatnonzero(broken)


def _u16(data: Bytes, at: Offsets) -> NDArray[np.uint16]:
    return data[at] | (data[at + 1].astype(np.uint16) << 8)


class NumbaChain:
    """Runs of data records by a compiled walk."""

    def __init__(self, data: Bytes, sizes: Sizes) -> None:
        self._data = data
        self._sizes = sizes
        self._walk = numba_chain()
        self._found = np.empty(BLOCK // 8, np.int64)

    def forget(self) -> None:
        """Nothing is kept between calls."""

    def follow(self, position: int, stop: int) -> Offsets:
        """Starts of the unbroken run of data records, at most one block of them."""
        n = self._walk(self._data, position, stop, self._sizes.smallest, self._sizes.spread, self._found)
        return self._found[:n].copy()


@cache
def numba_chain() -> Any:
    """The compiled walk; its machine code is cached beside the module or in numba's cache folder."""
    import numba
    from numba import types

    data = types.Array(types.uint8, 1, "C", readonly=True)
    sizes = types.Array(types.uint16, 1, "C")
    signature = types.int64(data, types.int64, types.int64, sizes, sizes, types.int64[::1])

    def walk(data, position, stop, smallest, spread, found):  # type: ignore[no-untyped-def]
        n = 0
        while n < len(found) and position + 5 <= stop:
            if data[position + 2] != 68:
                break
            identifier = data[position + 3] | data[position + 4] << 8
            size = np.int64(data[position]) | np.int64(data[position + 1]) << 8
            more = size - np.int64(smallest[identifier])
            if smallest[identifier] == 0 or more < 0 or more > spread[identifier] or position + 3 + size > stop:
                break
            found[n] = position
            n += 1
            position += 3 + size
        return n

    try:
        return numba.njit(signature, error_model="numpy", nogil=True, cache=True)(walk)
    except RuntimeError:  # no folder is writable: numba refuses to cache, compiling for this process still works
        return numba.njit(signature, error_model="numpy", nogil=True)(walk)


def chain(data: Bytes, sizes: Sizes) -> Chain:
    """The follower that is faster now: compiled where numba is loaded, else numpy."""
    compiled = "numba" in sys.modules and len(data) >= WORTH_COMPILED
    return NumbaChain(data, sizes) if compiled else NumpyChain(data, sizes)
