"""Was anything else logged at this time? What contradicts a false time is the rest of the log.

One message alone cannot tell a false time from a pause: a logger that stops and goes on leaves the same gap. But a
logger never writes one message only, so records at whose times no other message has any were not logged then.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from attlog.flight.clock.timing import LATEST_US, Stamps, stamps_of
from attlog.formats.base import Messages, Table

NEAR_US = 10_000_000
"""Messages are logged together when a logger goes on after a pause; slow ones follow within this time."""
FEWEST = 3
"""Messages with times, the judged one among them, that a log must have for one to contradict another."""


def times_alone(messages: Messages, t_us: Stamps) -> NDArray[np.bool_]:
    """For each time (n,) in us whether at most one message of the log (the one judged) has a record near it.

    All False where the log has too few messages with times of their own, and in telemetry, whose checksums leave no
    false time.
    """
    near = np.zeros(len(t_us), np.int64)
    told = 0
    for stamps in _clocks(messages):
        told += 1
        place = np.searchsorted(stamps, t_us)
        after = np.append(stamps, np.iinfo(np.int64).max)[place] - t_us
        before = t_us - np.append(stamps[:1] - 2 * NEAR_US, stamps)[place]
        near += (after <= NEAR_US) | (before <= NEAR_US)
    return near <= 1 if told >= FEWEST else np.zeros(len(t_us), np.bool_)


def _clocks(messages: Messages) -> Iterator[Stamps]:
    """The rising times that the records of each message carry themselves."""
    if messages.format in ("tlog", "mavlink"):
        return
    for table in messages.values():
        stamps = _own(messages.format, table)
        if stamps is None:
            continue
        stamps = stamps[(stamps >= 0) & (stamps <= LATEST_US)]
        if len(stamps):
            yield stamps if bool(np.all(stamps[1:] >= stamps[:-1])) else np.sort(stamps)


def _own(log_format: str, table: Table) -> Stamps | None:
    if log_format in ("dataflash", "dataflash_text"):
        from attlog.flight.ardupilot.clock import own_time

        return own_time(table)
    column = "timestamp" if log_format == "ulog" else "_t_us"
    try:
        return stamps_of(table, column) if column in table else None
    except ValueError:
        return None
