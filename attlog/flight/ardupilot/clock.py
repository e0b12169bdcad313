"""The boot clock of DataFlash records in every era.

``TimeUS`` since 3.3; before that ``TimeMS``, except in GPS records, whose TimeMS
is the time of the GPS week and ``T`` the boot clock. Records without time (EV,
MODE, MSG of 3.x) get the time of the record before them in the file. In 3.1 and
older no record but GPS carries a time: all others get theirs from their place in
the file between GPS records, as pymavlink does, good to about one GPS interval.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from attlog.flight.clock.timing import Stamps, stamps_of
from attlog.formats.base import Messages, Table


def own_time(table: Table) -> Stamps | None:
    """The stamps (n,) in us that the records carry themselves, None where they carry none (or text in its place)."""
    column, us = "TimeUS", 1
    if column not in table:
        column, us = "T" if ("Week" in table or "GWk" in table) and "T" in table else "TimeMS", 1000
    if column not in table and table.name == "GPS":
        column = "Time"  # of the GPS week, in 3.0
    if column not in table:
        return None
    try:
        return stamps_of(table, column, us)
    except ValueError:
        return None


class Clock:
    """Times of any record of a log by its place in the file."""

    def __init__(self, messages: Messages) -> None:
        self.messages = messages
        self._offsets: Stamps | None = None
        self._times: Stamps = np.zeros(0, np.int64)

    @cached_property
    def known(self) -> bool:
        """Whether any record carries a time."""
        return bool(self._timed)

    @cached_property
    def interpolates(self) -> bool:
        """Whether GPS records alone carry a time (3.1 and older)."""
        return self.known and all(table.name == "GPS" for table, _ in self._timed)

    @cached_property
    def _timed(self) -> list[tuple[Table, Stamps]]:
        """The tables that carry a time, with their stamps."""
        return [(t, own) for t in self.messages.values() if (own := own_time(t)) is not None]

    def of_samples(self, table: Table) -> Stamps | None:
        """Stamps (n,) in us that are good enough for a stream: the records' own or interpolated; else None."""
        own = own_time(table)
        return self.at(table.offsets) if own is None and self.interpolates else own

    def of(self, table: Table) -> Stamps:
        """Stamps (n,) in us: the records' own, else what their place in the file tells."""
        own = own_time(table)
        return self.at(table.offsets) if own is None else own

    def at(self, offsets: Stamps) -> Stamps:
        """The time of the last timed record before each place in the file, between GPS records where only they
        carry a time; 0 in a log without any."""
        if self._offsets is None:
            parts = [(t.offsets, own) for t, own in self._timed]
            joined = np.concatenate([p[0] for p in parts]) if parts else np.zeros(0, np.int64)
            order = np.argsort(joined, kind="stable")
            self._offsets = joined[order]
            self._times = np.concatenate([p[1] for p in parts])[order] if parts else self._times
        if len(self._offsets) == 0:
            return np.zeros(len(offsets), np.int64)
        if self.interpolates:
            return between(offsets, self._offsets, self._times)
        k = np.searchsorted(self._offsets, offsets) - 1
        return self._times[np.maximum(k, 0)]


def between(offsets: Stamps, known: Stamps, times: Stamps) -> Stamps:
    """Stamps (n,) in us at places in a file, from those (m,) at ``known`` places; beyond both ends at the mean pace."""
    valid = times >= 0
    known, times = known[valid], times[valid]
    if len(known) < 2 or times[-1] <= times[0]:
        return np.full(len(offsets), times[0] if len(times) else 0, np.int64)
    pace = (times[-1] - times[0]) / (known[-1] - known[0])
    inside = np.interp(offsets, known, times.astype(np.float64))
    outside = np.minimum(offsets - known[0], 0) + np.maximum(offsets - known[-1], 0)
    stamps: Stamps = np.maximum(np.round(inside + pace * outside), 0).astype(np.int64)
    return stamps
