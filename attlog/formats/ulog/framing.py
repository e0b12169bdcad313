"""Is there a record at this byte? The questions that finding records among damage comes down to.

ULog has no checksums: a place is judged by whether its record and the ones behind
it are well formed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from attlog.formats.ulog.index import HEADER, Bytes, Sizes, identifier_at
from attlog.formats.ulog.records import ENOUGH, FILE_HEADER, MAGIC, SYNC, is_odd_definition, is_record

DATA = ord("D")
ANCHOR_RECORDS = 3
"""Records in a row that must make sense before reading goes on behind damage."""
FIRST_SEARCH, LONGEST_SEARCH = 1 << 12, 1 << 20
"""Bytes looked at together behind damage: most damage are short, some are whole flash blocks."""
KINDS = np.zeros(256, bool)
KINDS[list(b"ABCDFILMOPQRS")] = True
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
        return bytes(self.raw[position + 3 : min(end, position + 3 + ENOUGH)])

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
            if kind == DATA:
                if end < position + HEADER:
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
        length = FIRST_SEARCH
        while position < stop:
            end = min(position + length, stop)
            for candidate in self._candidates(position, end):
                if self._is_anchor(candidate, stop):
                    return candidate
            position, length = end, min(length * 4, LONGEST_SEARCH)
        return stop

    def _is_anchor(self, position: int, stop: int) -> bool:
        if self.is_header(position):
            return position + FILE_HEADER <= stop
        if self.end(position) > stop or not self.leads_on(position, stop, ANCHOR_RECORDS):
            return False
        return self.raw[position + 2] != DATA or self._is_timely(position)

    def _begins_well(self, position: int) -> bool:
        size, kind = self.end(position) - position - 3, self.raw[position + 2]
        if kind != DATA:
            return bool(KINDS[kind]) and size > 0
        return position + HEADER > self.size or self._size_fits(identifier_at(self.raw, position), size)

    def _size_fits(self, identifier: int, size: int) -> bool:
        smallest = int(self.sizes.smallest[identifier])
        return smallest > 0 and smallest <= size <= smallest + int(self.sizes.spread[identifier])

    def _candidates(self, begin: int, end: int) -> list[int]:
        """Places whose first bytes could be a record that can be checked."""
        last = min(end, self.size - HEADER)
        if last <= begin:
            return []
        window = self.data[begin : last + HEADER - 1]
        count = last - begin
        size = window[:count].astype(np.int32) | window[1 : count + 1].astype(np.int32) << 8
        kind = window[2 : count + 2]
        identifier = window[3 : count + 3].astype(np.int32) | window[4 : count + 4].astype(np.int32) << 8
        smallest = self.sizes.smallest[identifier].astype(np.int32)
        data = (kind == DATA) & (smallest > 0) & (size >= smallest)
        data &= size <= smallest + self.sizes.spread[identifier]
        small = ((kind == ord("R")) | (kind == ord("O"))) & (size == 2) | (kind == ord("S")) & (size == len(SYNC))
        other = KINDS[kind] & (size > 2) & (kind != DATA) & (kind != ord("S"))
        header = (window[:count] == MAGIC[0]) & (window[1 : count + 1] == MAGIC[1]) & (kind == MAGIC[2])
        found = np.flatnonzero(data | small | other | header)
        return (found + begin).tolist()
