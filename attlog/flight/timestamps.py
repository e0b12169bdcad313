"""Read the time stamps of records: own clocks, clocks of other messages, length of power-ups, GPS time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from attlog.core.limits import LAST_TIME_US
from attlog.core.timestamps import Stamps
from attlog.formats.table import Messages, Table


def read_stamps(table: Table, column: str, us: int = 1) -> Stamps:
    """A column of times in units of ``us`` microseconds as stamps (n,); what is no time is negative.

    ValueError where the log's own definitions make text, or several numbers per record, of it.
    """
    told = table[column]
    if told.ndim != 1 or told.dtype.kind not in "iuf":
        raise ValueError(f"{table.name}.{column} is no time")
    if told.dtype.kind == "f":  # no integer means "not a number", and what a cast makes of it differs by processor
        told = np.where((told >= 0) & (told <= LAST_TIME_US), told, -1)
    stamps: Stamps = told.astype(np.int64)
    if us != 1:
        stamps = np.where((stamps >= 0) & (stamps <= LAST_TIME_US // us), stamps * us, -1)
    return stamps


def valid_stamp(t_us: int) -> int:
    """A stamp in us, 0 where it is none."""
    return int(t_us) if 0 <= t_us <= LAST_TIME_US else 0


# Was anything else logged at this time? What contradicts a false time is the rest of the log.
#
# One message alone cannot tell a false time from a pause: a logger that stops and goes on leaves the same gap. But a
# logger never writes one message only, so records at whose times no other message has any were not logged then.

# Messages are logged together when a logger goes on after a pause; slow ones follow within this time.
CORROBORATION_US = 10_000_000
# Messages with times, the judged one among them, that a log must have for one to contradict another.
MIN_CLOCKS = 3


def isolated_timestamps(messages: Messages, t_us: Stamps) -> NDArray[np.bool_]:
    """For each time (n,) in us whether at most one message of the log (the one judged) has a record near it.

    All False where the log has too few messages with times of their own, and in telemetry, whose checksums leave no
    false time.
    """
    near = np.zeros(len(t_us), np.int64)
    told = 0
    for stamps in _message_clocks(messages):
        told += 1
        place = np.searchsorted(stamps, t_us)
        after = np.append(stamps, np.iinfo(np.int64).max)[place] - t_us
        before = t_us - np.append(stamps[:1] - 2 * CORROBORATION_US, stamps)[place]
        near += (after <= CORROBORATION_US) | (before <= CORROBORATION_US)
    return near <= 1 if told >= MIN_CLOCKS else np.zeros(len(t_us), np.bool_)


def _message_clocks(messages: Messages) -> Iterator[Stamps]:
    """The rising times that the records of each message carry themselves."""
    if messages.format in ("tlog", "mavlink"):
        return
    for table in messages.values():
        stamps = _own_stamps(messages.format, table)
        if stamps is None:
            continue
        stamps = stamps[(stamps >= 0) & (stamps <= LAST_TIME_US)]
        if len(stamps):
            yield stamps if bool(np.all(stamps[1:] >= stamps[:-1])) else np.sort(stamps)


def _own_stamps(log_format: str, table: Table) -> Stamps | None:
    if log_format in ("dataflash", "dataflash_text"):
        from attlog.flight.ardupilot.imu import own_time

        return own_time(table)
    column = "timestamp" if log_format == "ulog" else "_t_us"
    try:
        return read_stamps(table, column) if column in table else None
    except ValueError:
        return None


# The autopilot's clock of any record of a log, whatever the format calls its time.

# The column in which each record tells its time, whatever the others of its message tell.
TIMESTAMP_COLUMN = {"ulog": "timestamp"}


def table_time_span(messages: Messages, system: int | None = None) -> Callable[[Table], tuple[int, int] | None]:
    """A function from a table to the first and last boot time of :func:`clock_of`; no column is kept for it."""
    stamps = record_clock(messages, system)

    def ends(table: Table) -> tuple[int, int] | None:
        alone = messages.format in TIMESTAMP_COLUMN and len(table) > 2
        told = stamps(table.rows(np.array([0, len(table) - 1])) if alone else table)
        table.forget()
        return None if told is None or len(told) == 0 else (int(told[0]), int(told[-1]))

    return ends


def record_clock(messages: Messages, system: int | None = None) -> Callable[[Table], Stamps | None]:
    """A function from a table to the boot times (n,) of its records in us, None where they have none that are numbers.

    ``system`` is the MAVLink vehicle whose boot clock counts; packets of others get
    the times at which they were received, on the same clock.
    """
    if messages.format in ("dataflash", "dataflash_text"):
        from attlog.flight.ardupilot.imu import RecordClock

        dataflash = RecordClock(messages)
        return dataflash.of if dataflash.known else lambda table: None
    if messages.format in ("tlog", "mavlink"):
        from attlog.flight.mavlink import PacketClock, choose_system

        instance = choose_system(messages, messages.path, system)
        packets = PacketClock(messages, instance)
        return lambda table: packets.of(table) if table.instance == instance else packets.by_packet(table)
    column = TIMESTAMP_COLUMN.get(messages.format, "_t_us")

    def of(table: Table) -> Stamps | None:
        try:
            return read_stamps(table, column) if column in table else None
        except ValueError:
            return None

    return of


# The pieces of time in a file: how long each lasts, by all of its messages, and which was taken.

# Columns of boot clocks, and their units in us.
BOOT_CLOCK_COLUMNS = (("TimeUS", 1.0), ("timestamp", 1.0), ("time_boot_ms", 1e3), ("TimeMS", 1e3))
# A table that spans more than a week has a false stamp.
MAX_TABLE_S = 7 * 86_400.0
MAX_LISTED_BOOTS = 4


def logged_seconds(messages: Messages) -> float:
    """From the first to the last stamp of any message in s; 0 where nothing carries a time."""
    spans = []
    for (name, _), table in messages.items():
        column, us = next(((c, us) for c, us in BOOT_CLOCK_COLUMNS if c in table), ("", 1.0))
        if not column or len(table) == 0 or (name == "GPS" and column == "TimeMS"):  # that is the time of the week
            continue
        t = np.asarray(table[column], np.float64).ravel() * us * 1e-6
        t = t[np.isfinite(t) & (t > 0.0)]
        if len(t) and np.ptp(t) < MAX_TABLE_S:
            spans.append((float(t.min()), float(t.max())))
    if not spans:
        return 0.0
    middle = float(np.median([a for a, _ in spans]))
    near = [(a, b) for a, b in spans if abs(a - middle) < MAX_TABLE_S]
    return max(b for _, b in near) - min(a for a, _ in near)


def describe_other_boots(messages: Messages, chosen: int) -> str:
    """The power-ups that were not taken, each with its length: "Number 1 lasts 12 s, number 2 3 s"."""
    numbers = [k for k in range(len(messages.boots)) if k != chosen]
    told = [f"number {k} lasts {logged_seconds(messages.boot(k)):.0f} s" for k in numbers[:MAX_LISTED_BOOTS]]
    more = f" and {len(numbers) - MAX_LISTED_BOOTS} more" if len(numbers) > MAX_LISTED_BOOTS else ""
    text = ", ".join(told) + more
    return text[:1].upper() + text[1:]


# GPS time as Unix time.

# 1980-01-06 00:00 UTC as Unix time.
GPS_EPOCH_S = 315_964_800
# (Unix time of the start, GPS minus UTC in s), IERS Bulletin C; none was added since 2017.
LEAP_SECONDS = ((1_230_768_000, 15), (1_341_100_800, 16), (1_435_708_800, 17), (1_483_228_800, 18))


def gps_time_us(week: NDArray[np.int64], milliseconds: NDArray[np.int64]) -> NDArray[np.int64]:
    """Unix time in us of GPS week and milliseconds of the week; 0 where the week is unset or impossible."""
    known = (week > 0) & (week < 5000) & (milliseconds >= 0) & (milliseconds < 604_800_000)
    gps_us = (GPS_EPOCH_S + np.where(known, week, 0) * 604_800) * 1_000_000 + np.where(known, milliseconds, 0) * 1000
    leap = np.full(len(week), LEAP_SECONDS[0][1])
    for start, seconds in LEAP_SECONDS:  # in the middle of a GPS week, as on 2015-07-01
        leap = np.where(gps_us >= (start + seconds) * 1_000_000, seconds, leap)
    return np.where(known, gps_us - leap * 1_000_000, 0)


# Which time a record has, and whether to believe it.
