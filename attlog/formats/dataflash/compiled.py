"""Where the records of an undamaged DataFlash file begin, by a compiled walk along their lengths.

Gives what the numpy pass of :mod:`attlog.formats.dataflash.index` gives, four times as fast, for a file whose records
follow each other from its first byte to its last and are defined before they are used. Any other file is left to that
pass. Used where the machine code is at hand and worth loading.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base.limits import MAX_FORMATS
from attlog.formats import compiled
from attlog.formats.compiled import at_any_cost, if_cheap, kernel_of
from attlog.formats.mapping import offset_type

WORTH_COMPILED = 32 << 20
"""Below this many bytes loading compiled code costs more than it saves (25 ms against 0.5 ms per MB)."""

FMT_TYPE, FMT_LENGTH = 128, 89
Found = tuple[NDArray[np.int32], NDArray[np.int16], NDArray[np.int64]]

_FIRST = 1 << 14  # records for which there is room before their mean length is known


def pays(data: NDArray[np.uint8]) -> bool:
    """Whether :class:`Follower` can be used and is worth it; it counts places in 32 bits."""
    is_worth = offset_type(len(data)) is np.int32 and compiled.pays("dataflash", len(data), WORTH_COMPILED)
    return is_worth and if_cheap(WALK) is not None


class Follower:
    """Follows records along their lengths, from the first byte of a file; layouts are numbered as they are defined."""

    def __init__(self, data: NDArray[np.uint8]) -> None:
        self.lengths, self._layouts = np.zeros(256, np.int32), np.zeros(256, np.int16)
        self._defined = np.zeros(MAX_FORMATS + 1, np.int32)
        self.lengths[FMT_TYPE] = FMT_LENGTH
        self._data, self._count = data, 0
        self._step = if_cheap(WALK) or at_any_cost(WALK)
        self._starts, self._kinds, self._stamps = _room(_FIRST)

    @property
    def found(self) -> Found:
        """Offset, layout and first 8 bytes of payload of each record so far."""
        n = self._count
        return self._starts[:n], self._kinds[:n], self._stamps[:n]

    @property
    def definitions(self) -> list[int]:
        """Offset of the FMT record of layout 1 and of each that follows, in file order."""
        places: list[int] = self._defined[1 : int(self._layouts[FMT_TYPE]) + 1].tolist()
        return places

    def follow(self, position: int) -> int:
        """Add the records from ``position`` on; returns where none of a type with a length begins.

        One with fewer than 8 bytes behind its header is not followed where the file ends behind it.
        """
        while True:
            n = self._count
            free = self._starts[n:], self._kinds[n:], self._stamps[n:]
            added = self._step(self._data, position, self.lengths, self._layouts, self._defined, *free)
            self._count += added
            if added:
                last = int(self._starts[self._count - 1])
                position = last + int(self.lengths[self._data[last + 2]])
            if added < len(free[0]):
                return position
            self._grow(position)

    def add(self, position: int, record: bytes) -> None:
        """Add one record, given its bytes."""
        if self._count == len(self._starts):
            self._grow(position)
        k = self._count
        self._starts[k], self._kinds[k] = position, self._layouts[record[2]]
        self._stamps[k] = int.from_bytes(record[3:11], "little", signed=len(record) > 10)
        self._count += 1

    def _grow(self, position: int) -> None:
        """Make room for the rest of the file, if its records are about as long as those before ``position``."""
        rest = (len(self._data) - position) * self._count // max(position, 1)
        starts, kinds, stamps = self.found
        self._starts, self._kinds, self._stamps = _room(self._count + rest + rest // 16 + _FIRST // 16 + 1)
        n = self._count
        self._starts[:n], self._kinds[:n], self._stamps[:n] = starts, kinds, stamps


def _room(records: int) -> Found:
    return np.empty(records, np.int32), np.empty(records, np.int16), np.empty(records, np.int64)


def walk(data, position, lengths, layouts, defined, starts, kinds, stamps):  # type: ignore[no-untyped-def]
    """Consecutive records of known types from ``position`` on, as many as fit the arrays; returns how many.

    Takes up what FMT records (type 128) define, unless it is what holds already: ``defined`` are their places by
    layout, ``layouts[128]`` counts them.
    """
    n, size = 0, len(data)
    while n < len(starts) and position + 11 <= size:
        if data[position] != 0xA3 or data[position + 1] != 0x95:
            break
        kind = data[position + 2]
        length = np.int64(lengths[kind])
        if length == 0 or position + length > size:
            break
        starts[n] = position
        kinds[n] = layouts[kind]
        if kind == 128:
            kinds[n] = 0
            of, k = data[position + 3], 4 if data[position + 3] != 128 else 89
            before = defined[layouts[of]]
            while k < 89 and data[position + k] == data[before + k]:
                k += 1
            if lengths[of] == 0 or k < 89:
                if layouts[128] + 1 == len(defined):
                    break
                layouts[128] += 1
                lengths[of], layouts[of], defined[layouts[128]] = data[position + 4], layouts[128], position
        stamp = np.int64(0)
        for k in range(8):
            stamp |= np.int64(data[position + 3 + k]) << (8 * k)
        stamps[n] = stamp
        n += 1
        position += length
    return n


WALK = kernel_of(
    walk, "i8((u1[::1]), i8, i4[::1], i2[::1], i4[::1], i4[::1], i2[::1], i8[::1])", "formats/dataflash/compiled.py"
)
