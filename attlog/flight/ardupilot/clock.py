"""The boot clock of DataFlash records in every era.

``TimeUS`` since 3.3; before that ``TimeMS``, except in GPS records, whose TimeMS
is the time of the GPS week and ``T`` the boot clock. Records without time (EV,
MODE, MSG of 3.x) get the time of the record before them in the file.
"""

from __future__ import annotations

import numpy as np

from attlog.flight.clock.timing import Stamps, stamps_of
from attlog.formats.base import Messages, Table


def own_time(table: Table) -> Stamps | None:
    """The stamps (n,) in us that the records carry themselves, None where they carry none (or text in its place)."""
    column, us = "TimeUS", 1
    if column not in table:
        column, us = "T" if ("Week" in table or "GWk" in table) and "T" in table else "TimeMS", 1000
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

    @property
    def known(self) -> bool:
        """Whether any record carries a time."""
        return any("TimeUS" in t or "TimeMS" in t or "T" in t for t in self.messages.values())

    def of(self, table: Table) -> Stamps:
        """Stamps (n,) in us: the records' own, else those of the timed records before them."""
        own = own_time(table)
        return self.at(table.offsets) if own is None else own

    def at(self, offsets: Stamps) -> Stamps:
        """The time of the last timed record before each place in the file; 0 in a log without any time."""
        if self._offsets is None:
            parts = [(t.offsets, own) for t in self.messages.values() if (own := own_time(t)) is not None]
            joined = np.concatenate([p[0] for p in parts]) if parts else np.zeros(0, np.int64)
            order = np.argsort(joined, kind="stable")
            self._offsets = joined[order]
            self._times = np.concatenate([p[1] for p in parts])[order] if parts else self._times
        if len(self._offsets) == 0:
            return np.zeros(len(offsets), np.int64)
        k = np.searchsorted(self._offsets, offsets) - 1
        return self._times[np.maximum(k, 0)]
