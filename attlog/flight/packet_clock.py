"""Boot clock of telemetry packets, without stale ones.

Most messages hold ``time_boot_ms`` or ``time_usec``. The others (SIM_STATE, AHRS2, HEARTBEAT) have only the receiver's
packet stamp, which messages with both clocks map to the boot clock; a running median follows radio delay and the
computer's clock. Where the stamps do not advance as the boot clock does (bursts of a radio link, constant stamps,
another unit), a packet's place in the file between messages with a clock gives a better time.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from attlog.core.sorting import median
from attlog.core.timestamps import Stamps
from attlog.flight import limits
from attlog.formats.mavlink.layout import STAMP_COLUMN
from attlog.formats.mavlink.reader import CLOCK_MESSAGES
from attlog.formats.table import Messages, Table, boots_at

# A time_usec above this is Unix time (2001), not time since boot.
UNIX_US = 10**15
# Largest median difference of steps of packet stamps and boot clock, as a share of the mean step, with which packet
# stamps are used as a clock. It is 0.01 to 0.25 by wire and good links, 0.6 by radio links that send in bursts.
MAX_UNSTEADY_SHARE = 0.5
# Mean truncation of a clock in whole milliseconds.
HALF_MILLISECOND_US = 500
# Length of the running median of packet clock minus boot clock, in clock packets.
MEDIAN_PACKETS = 21
# Largest backward step of an estimated time that is removed; larger ones are real.
MAX_BACKWARD_US = 1_000_000


# Jump of the boot clock over stale packets: minimum, and maximum share by which the packet stamps move in it; more such
# jumps in a file are no stale packets.
MIN_STALE_US, MAX_RECEIVED_SHARE, MAX_STALE_JUMPS = 30_000_000, 0.1, 3
# A time_usec of 32 bits turns over after 71.6 min; turns are added where this share of the records then lies so close
# to the boot clock at the same place of the file.
COUNTER_TURN_US = 1 << 32
MAX_TURNED_ERROR_US, MIN_TURNED_SHARE = 60_000_000, 0.9


def without_stale_packets(messages: Messages, instance: int, inertial: Container[str]) -> tuple[Messages, str]:
    """Return the messages without packets from before a jump of the boot clock, and a sentence on those.

    A link may deliver old packets first: then the boot clock jumps while the receiver's clock runs on. Of the parts the
    one with most packets of the ``inertial`` messages is kept, without these the one with most clock packets. The
    sentence is empty where none is stale.
    """
    clock = PacketClock(messages, instance)
    if not clock.is_stamped or len(clock.boot) < 2:
        return messages, ""
    jumped, received = np.diff(clock.boot), np.diff(clock.received)
    at = np.flatnonzero((jumped > MIN_STALE_US) & (received < MAX_RECEIVED_SHARE * jumped))
    if not 0 < len(at) <= MAX_STALE_JUMPS:
        return messages, ""
    parts = boots_at(clock.offsets[at + 1].tolist(), messages.size)
    offsets = [table.offsets for (name, i), table in messages.items() if i == instance and name in inertial]
    counts = [
        sum(int(np.count_nonzero((x >= p.start) & (x < p.end))) for x in offsets or [clock.offsets]) for p in parts
    ]
    part = parts[int(np.argmax(counts))]
    mine = (clock.offsets >= part.start) & (clock.offsets < part.end)
    if not np.ptp(clock.received[mine]) > MAX_RECEIVED_SHARE * np.ptp(clock.boot[mine]):
        return messages, ""  # stamps that stand still, or of another unit, show no stale packet
    when = "an older" if part is parts[-1] else "another"
    seconds = f"{1e-6 * jumped[at].max():,.0f} s"
    text = f"Packets of {when} time are left out: the boot clock jumps by {seconds} while the receiver's runs on."
    return messages.between(part), text


class PacketClock:
    """Boot clock in us for the packets of one autopilot.

    ``offsets``, ``boot`` (n,): byte offsets and boot times of clock packets. ``received`` (n,): their packet stamps, if
    the file ``is_stamped``. ``ahead`` (n,): packet clock minus boot clock. ``is_steady``: packet stamps are usable as a
    clock. ``unix``: Unix time minus boot time, None if unknown.
    """

    def __init__(self, messages: Messages, instance: int) -> None:
        offsets, boot, packet = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        self.is_stamped = True
        for name in CLOCK_MESSAGES:
            table = messages.tables.get((name, instance))
            if table is None or "time_boot_ms" not in table:
                continue
            known = table["time_boot_ms"] > 0
            offsets.append(table.offsets[known])
            boot.append(boot_stamps(table)[known])
            self.is_stamped &= STAMP_COLUMN in table
            packet.append((table[STAMP_COLUMN] if STAMP_COLUMN in table else table.offsets)[known])
        joined = np.concatenate(offsets)
        order = np.argsort(joined, kind="stable")
        self.offsets = joined[order]
        self.boot = np.concatenate(boot)[order]
        self.received = np.concatenate(packet)[order]
        self.ahead = running_median(self.received - self.boot) if len(order) else self.boot
        self.is_steady = is_steady(self.received, self.boot)
        self.unix = unix_minus_boot(messages, instance)

    def of(self, table: Table) -> Stamps:
        """Return boot times (n,) of a table in us, by its own clock or by packets."""
        if "time_boot_ms" in table:
            return boot_stamps(table)
        if "time_usec" in table:
            time = table["time_usec"].astype(np.int64)
            if self.unix is not None:
                time = np.where(time > UNIX_US, time - self.unix, time)
            if len(time) and 0 < median(time) < UNIX_US:
                return self._with_turns(time, table)
        return self.by_packet(table)

    def _with_turns(self, time: Stamps, table: Table) -> Stamps:
        """Return stamps (n,) of a 32-bit counter with the turns that bring them to the boot clock."""
        if len(self.boot) == 0 or time.max() >= COUNTER_TURN_US:
            return time
        near = np.interp(table.offsets, self.offsets, self.boot)
        turned: Stamps = time + COUNTER_TURN_US * np.rint((near - time) / COUNTER_TURN_US).astype(np.int64)
        good = np.mean(np.abs(turned - near) <= MAX_TURNED_ERROR_US) >= MIN_TURNED_SHARE
        return turned if good else time

    def by_packet(self, table: Table) -> Stamps:
        """Return boot times (n,) by packet stamps, or interpolated by byte offset if these are unsteady."""
        if len(self.boot) == 0:
            return np.zeros(len(table), np.int64)
        if STAMP_COLUMN in table and self.is_steady:
            k = np.clip(np.searchsorted(self.offsets, table.offsets), 0, len(self.offsets) - 1)
            return force_rising(table[STAMP_COLUMN] - self.ahead[k])
        return np.interp(table.offsets, self.offsets, self.boot).astype(np.int64)


def is_steady(packet: Stamps, boot: Stamps) -> bool:
    """Return whether packet stamps (n,) advance like the boot times (n,), True for too few."""
    if len(boot) < MEDIAN_PACKETS:
        return True
    steps = np.abs(np.diff(boot))
    return float(median(np.abs(np.diff(packet) - np.diff(boot)))) <= MAX_UNSTEADY_SHARE * float(steps.mean())


def boot_stamps(table: Table) -> Stamps:
    """Return boot times (n,) in us from the truncated milliseconds in ``time_boot_ms``."""
    return table["time_boot_ms"].astype(np.int64) * 1000 + HALF_MILLISECOND_US


def force_rising(t_us: Stamps) -> Stamps:
    """Return stamps at least 1 us apart, by moving stamps behind backward steps below MAX_BACKWARD_US."""
    count = np.arange(len(t_us))
    least: Stamps = np.maximum.accumulate(t_us - count) + count
    return np.where(least - t_us < MAX_BACKWARD_US, least, t_us)


def running_median(x: Stamps) -> Stamps:
    """Return the running median over MEDIAN_PACKETS entries, with reflected ends."""
    half = MEDIAN_PACKETS // 2
    if len(x) <= half:
        return np.full(len(x), int(median(x)), np.int64)
    padded = np.concatenate([x[half:0:-1], x, x[-2 : -half - 2 : -1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, MEDIAN_PACKETS)
    medians: Stamps = median(windows, axis=1).astype(np.int64)
    return medians


def unix_minus_boot(messages: Messages, instance: int) -> int | None:
    """Return Unix time minus boot time in us (SYSTEM_TIME), None without a valid date."""
    table = messages.tables.get(("SYSTEM_TIME", instance))
    if table is None:
        return None
    unix, boot = table["time_unix_usec"].astype(np.int64), table["time_boot_ms"].astype(np.int64) * 1000
    known = (unix > UNIX_US) & (unix < limits.UTC_US.high) & (boot > 0)
    return int(median(unix[known] - boot[known])) if known.any() else None
