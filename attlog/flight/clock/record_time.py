"""The autopilot's clock of any record of a log, whatever the format calls its time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from attlog.flight.clock.timing import Stamps, stamps_of
from attlog.formats.base import Messages, Table

OWN_TIME = {"ulog": "timestamp"}
"""The column in which each record tells its time, whatever the others of its message tell."""


def ends_of(messages: Messages, system: int | None = None) -> Callable[[Table], tuple[int, int] | None]:
    """A function from a table to the first and last boot time of :func:`clock_of`; no column is kept for it."""
    stamps = clock_of(messages, system)

    def ends(table: Table) -> tuple[int, int] | None:
        alone = messages.format in OWN_TIME and len(table) > 2
        told = stamps(table.rows(np.array([0, len(table) - 1])) if alone else table)
        table.forget()
        return None if told is None or len(told) == 0 else (int(told[0]), int(told[-1]))

    return ends


def clock_of(messages: Messages, system: int | None = None) -> Callable[[Table], Stamps | None]:
    """A function from a table to the boot times (n,) of its records in us, None where they have none that are numbers.

    ``system`` is the MAVLink vehicle whose boot clock counts; packets of others get
    the times at which they were received, on the same clock.
    """
    if messages.format in ("dataflash", "dataflash_text"):
        from attlog.flight.ardupilot.clock import Clock

        dataflash = Clock(messages)
        return dataflash.of if dataflash.known else lambda table: None
    if messages.format in ("tlog", "mavlink"):
        from attlog.flight.mavlink.clock import PacketClock
        from attlog.flight.mavlink.reader import of_system

        _, instance = of_system(messages, messages.path, system)
        packets = PacketClock(messages, instance)
        return lambda table: packets.of(table) if table.instance == instance else packets.by_packet(table)
    column = OWN_TIME.get(messages.format, "_t_us")

    def of(table: Table) -> Stamps | None:
        try:
            return stamps_of(table, column) if column in table else None
        except ValueError:
            return None

    return of
