"""The boot clock of ULog records: the u64 ``timestamp`` (us) that most topics carry, and which times are believed.

ULog has no checksums, so a time far from its neighbours is the best sign of bytes that are no record.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from attlog.base.limits import MAX_TIME_JUMP_S
from attlog.formats.base import Offsets
from attlog.formats.mapping import gather
from attlog.formats.ulog.index import HEADER, Bytes, identifier_at
from attlog.formats.ulog.layout import TopicLayout

MAX_JUMP_US = MAX_TIME_JUMP_S * 1e6


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
        return None if place is None else int(struct.unpack_from("<Q", self._raw, start + HEADER + place)[0])

    def is_timely(self, start: int, recent: list[int]) -> bool:
        """Whether the data record's time is near one of those that start at ``recent``; True where nothing tells."""
        now = self.time_at(start)
        before = [t for last in recent if (t := self.time_at(last)) is not None]
        return now is None or not before or min(abs(now - t) for t in before) < MAX_JUMP_US


def rise(data: Bytes, starts: Offsets, layout: TopicLayout) -> bool:
    """Whether records, read by this layout, have times that rise and stay near each other; False without stamp."""
    if layout.time_at is None:
        return False
    times = gather(data[HEADER + layout.time_at :], starts, np.dtype("<u8")).astype(np.float64)
    return bool((np.diff(times) >= 0).all() and times[-1] - times[0] < MAX_JUMP_US)


def far_from_most(timestamps: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Mask (n,) of the times that are far from the median."""
    times = timestamps.astype(np.float64)
    far: NDArray[np.bool_] = np.abs(times - np.median(times)) > MAX_JUMP_US
    return far
