"""The autopilot's clock of MAVLink messages, also of those that carry none.

Most messages hold ``time_boot_ms`` or ``time_usec``. The others (SIM_STATE, AHRS2,
HEARTBEAT) have only the receiver's packet stamp, which the messages with both
clocks map to the boot clock; radio delay and clock changes of the computer are
followed by a running median. Where the stamps do not advance as the boot clock does
(bursts of a radio link, stamps that stand still or have another unit), a packet's
place in the file between messages with a clock tells its time better.
"""

from __future__ import annotations

import numpy as np

from attlog.flight import physics
from attlog.flight.clock.timing import Stamps
from attlog.formats.base import Messages, Table
from attlog.formats.mavlink.reader import CLOCK_MESSAGES, STAMP

UNIX_US = 10**15
"""A time_usec above this is Unix time (2001), not time since boot."""
UNSTEADY = 0.5
"""Stamps that advance by another time between clock packets than the boot clock does, by more than this share of the
mean step, are no clock: 0.01 to 0.25 in logs by wire and by good links, 0.6 by radio links that send in bursts."""
HALF_MS = 500
"""A clock of whole milliseconds is early by half of one, on average."""
WINDOW = 21
"""Clock packets whose median gives the difference between packet and boot clock."""


class PacketClock:
    """Boot times in us of the packets of one autopilot (``system``, ``component``)."""

    def __init__(self, messages: Messages, instance: int) -> None:
        offsets, boot, packet = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for name in CLOCK_MESSAGES:
            table = messages.tables.get((name, instance))
            if table is None or "time_boot_ms" not in table:
                continue
            time = of_milliseconds(table)
            set_ = table["time_boot_ms"] > 0
            offsets.append(table.offsets[set_])
            boot.append(time[set_])
            packet.append((table[STAMP] if STAMP in table else table.offsets)[set_])
        joined = np.concatenate(offsets)
        order = np.argsort(joined, kind="stable")
        self.offsets = joined[order]
        self.boot = np.concatenate(boot)[order]
        stamped = np.concatenate(packet)[order]
        self.ahead = running_median(stamped - self.boot) if len(order) else self.boot
        self.is_steady = steady(stamped, self.boot)
        """Whether the packet stamps advance as the boot clock does."""
        self.unix = unix_minus_boot(messages, instance)

    def of(self, table: Table) -> Stamps:
        """Stamps (n,) of a table: its own clock, else the packet's."""
        if "time_boot_ms" in table:
            return of_milliseconds(table)
        if "time_usec" in table:
            time = table["time_usec"].astype(np.int64)
            if self.unix is not None:
                time = np.where(time > UNIX_US, time - self.unix, time)
            if len(time) and np.median(time) > 0 and np.median(time) < UNIX_US:
                return time
        return self.by_packet(table)

    def by_packet(self, table: Table) -> Stamps:
        """Boot times from packet stamps, where these are missing or no clock from the place between clock messages."""
        if len(self.boot) == 0:
            return np.zeros(len(table), np.int64)
        if STAMP in table and self.is_steady:
            k = np.clip(np.searchsorted(self.offsets, table.offsets), 0, len(self.offsets) - 1)
            return rising(table[STAMP] - self.ahead[k])
        return np.interp(table.offsets, self.offsets, self.boot).astype(np.int64)


def steady(packet: Stamps, boot: Stamps) -> bool:
    """Whether packet stamps (n,) advance as the boot times (n,) of the same packets do; too few are taken as such."""
    if len(boot) < WINDOW:
        return True
    steps = np.abs(np.diff(boot))
    return float(np.median(np.abs(np.diff(packet) - np.diff(boot)))) <= UNSTEADY * float(steps.mean())


def of_milliseconds(table: Table) -> Stamps:
    """Boot times (n,) in us of ``time_boot_ms``, which counts whole milliseconds that have passed: half of one more."""
    return table["time_boot_ms"].astype(np.int64) * 1000 + HALF_MS


def rising(t_us: Stamps) -> Stamps:
    """The stamps without the small backward steps that an estimated clock difference makes; real ones stay.

    Each is at least 1 us after the one before; those that rise by themselves stay as they are.
    """
    count = np.arange(len(t_us))
    least: Stamps = np.maximum.accumulate(t_us - count) + count
    return np.where(least - t_us < 1_000_000, least, t_us)


def running_median(x: Stamps) -> Stamps:
    """The median of WINDOW neighbours of every entry (fewer at the ends)."""
    half = WINDOW // 2
    if len(x) <= half:
        return np.full(len(x), int(np.median(x)), np.int64)
    padded = np.concatenate([x[half:0:-1], x, x[-2 : -half - 2 : -1]])
    medians: Stamps = np.median(np.lib.stride_tricks.sliding_window_view(padded, WINDOW), axis=1).astype(np.int64)
    return medians


def unix_minus_boot(messages: Messages, instance: int) -> int | None:
    """Unix time minus boot time in us (SYSTEM_TIME), None where the autopilot never knew the date."""
    table = messages.tables.get(("SYSTEM_TIME", instance))
    if table is None:
        return None
    unix, boot = table["time_unix_usec"].astype(np.int64), table["time_boot_ms"].astype(np.int64) * 1000
    known = (unix > UNIX_US) & (unix < physics.UTC_US.high) & (boot > 0)
    return int(np.median(unix[known] - boot[known])) if known.any() else None
