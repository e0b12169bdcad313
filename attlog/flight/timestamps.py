"""Read the time stamps of records: own clocks, clocks of other messages, length of power-ups, GPS time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core.limits import LAST_TIME_US
from attlog.core.sorting import median, unique
from attlog.core.timestamps import Stamps
from attlog.formats.table import FieldError, Messages, Table


def read_stamps(table: Table, column: str, us: int = 1) -> Stamps:
    """Return a column of times in units of ``us`` microseconds as stamps (n,), negative for impossible times.

    ValueError if the column is text or has several numbers per record.
    """
    logged = table[column]
    if logged.ndim != 1 or logged.dtype.kind not in "iuf":
        raise FieldError(f"{table.name}.{column} is no time")
    if logged.dtype.kind == "f":  # casting NaN to an integer depends on the processor
        logged = np.where((logged >= 0) & (logged <= LAST_TIME_US), logged, -1)
    stamps: Stamps = logged.astype(np.int64)
    if us != 1:
        stamps = np.where((stamps >= 0) & (stamps <= LAST_TIME_US // us), stamps * us, -1)
    return stamps


def valid_stamp(t_us: int) -> int:
    """Return a stamp in us, 0 for an impossible one."""
    return int(t_us) if 0 <= t_us <= LAST_TIME_US else 0


# --- other messages at a time ------------------------------------------------------------------------------------

# Column with the stamp of each record, by format.
TIMESTAMP_COLUMN = {"ulog": "timestamp"}
# After a pause of the logger all messages resume within this time, slow ones included.
CORROBORATION_US = 10_000_000
# Fewest messages with times, including the tested one, for the test of isolated times.
MIN_CLOCKS = 3


def isolated_timestamps(messages: Messages, t_us: Stamps) -> NDArray[np.bool_]:
    """Mark times (n,) in us near which at most one message of the log has a record.

    A pause of the logger leaves a gap in all messages, a false time in one. All False for fewer than MIN_CLOCKS
    messages with stamps, and in telemetry, which is protected by checksums.
    """
    near = np.zeros(len(t_us), np.int64)
    logged = 0
    for stamps in _message_clocks(messages):
        logged += 1
        place = np.searchsorted(stamps, t_us)
        after = np.append(stamps, np.iinfo(np.int64).max)[place] - t_us
        before = t_us - np.append(stamps[:1] - 2 * CORROBORATION_US, stamps)[place]
        near += (after <= CORROBORATION_US) | (before <= CORROBORATION_US)
        if np.all(near > 1):  # the clocks of all other messages are not decoded
            break
    return near <= 1 if logged >= MIN_CLOCKS else np.zeros(len(t_us), np.bool_)


def _message_clocks(messages: Messages) -> Iterator[Stamps]:
    """Yield the sorted valid stamps of each message."""
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
    """Return the logged boot times (n,) of a table's records in us, None without a numeric column."""
    if log_format in ("dataflash", "dataflash_text"):
        from attlog.flight.ardupilot.imu import own_time

        return own_time(table)
    column = TIMESTAMP_COLUMN.get(log_format, "_t_us")
    try:
        return read_stamps(table, column) if column in table else None
    except ValueError:
        return None


# --- clock of any record -----------------------------------------------------------------------------------------


def table_time_span(messages: Messages, system: int | None = None) -> Callable[[Table], tuple[int, int] | None]:
    """Return a function that gives a table's first and last boot time in us.

    Decoded columns are released.
    """
    stamps = record_clock(messages, system)

    def ends(table: Table) -> tuple[int, int] | None:
        alone = messages.format in TIMESTAMP_COLUMN and len(table) > 2
        logged = stamps(table.rows(np.array([0, len(table) - 1])) if alone else table)
        table.forget()
        return None if logged is None or len(logged) == 0 else (int(logged[0]), int(logged[-1]))

    return ends


def record_clock(messages: Messages, system: int | None = None) -> Callable[[Table], Stamps | None]:
    """Return a function that gives the boot times (n,) of a table's records in us, None if unknown.

    ``system``: the MAVLink vehicle whose boot clock is used; packets of others get their time of reception on it.
    """
    if messages.format in ("dataflash", "dataflash_text"):
        from attlog.flight.ardupilot.imu import RecordClock

        dataflash = RecordClock(messages)
        return dataflash.of if dataflash.known else lambda table: None
    if messages.format in ("tlog", "mavlink"):
        from attlog.flight.mavlink import choose_system_id
        from attlog.flight.packet_clock import PacketClock

        instance = choose_system_id(messages, messages.path, system)
        packets = PacketClock(messages, instance)
        return lambda table: packets.of(table) if table.instance == instance else packets.by_packet(table)
    return partial(_own_stamps, messages.format)


# --- messages on another clock ---------------------------------------------------------------------------------

# Records of a message whose times are compared with those around them in the file, and fewest of them.
MAX_COMPARED, MIN_COMPARED = 33, 3
# Records around one, of all messages, whose median time is the log's there.
AROUND = 31
# Least difference from the log's clock: s, and share of the log's length. Loggers write some records seconds late.
MIN_APART_S, MIN_APART_SHARE = 30.0, 0.05
# Least share of a message's records with the same difference.
MIN_CLOCK_SHARE = 0.8
# Least time that a clock counts, as share of the time that passes: a value that stays is no clock.
MIN_CLOCK_RATE = 0.5
# Column with the boot time in each record and its unit in us, by format.
RECORD_CLOCKS = {
    "ulog": ("timestamp", 1),
    **dict.fromkeys(("dataflash", "dataflash_text"), ("TimeUS", 1)),
    **dict.fromkeys(("tlog", "mavlink"), ("time_boot_ms", 1000)),
}


def foreign_clocks(messages: Messages) -> dict[tuple[str, int], float]:
    """Return messages on another clock with their difference in s from the records around them in the file.

    The difference is the same for all of a message's records; a few false times are no clock.
    """
    column, us = RECORD_CLOCKS.get(messages.format, ("", 1))
    system = messages.info.get("system") if column == "time_boot_ms" else None
    found: list[tuple[tuple[str, int], NDArray[np.int64], Stamps]] = []
    for key, table in messages.items():
        if column not in table or len(table) < MIN_COMPARED or (system is not None and key[1] >> 8 != system):
            continue
        some = table.rows(unique(np.linspace(0, len(table) - 1, MAX_COMPARED).astype(np.int64)))
        try:
            stamps = read_stamps(some, column, us)
        except (KeyError, ValueError):
            continue
        known = stamps != 0  # 0 is unset
        if np.count_nonzero(known) >= MIN_COMPARED:
            found.append((key, some.offsets.astype(np.int64)[known], stamps[known]))
    if len(found) < MIN_CLOCKS:
        return {}
    offsets, seconds = (np.concatenate([row[k] for row in found]) for k in (1, 2))
    order = np.argsort(offsets, kind="stable")
    at = 1e-6 * seconds[order].astype(np.float64)
    half = AROUND // 2
    usual = median(np.lib.stride_tricks.sliding_window_view(np.pad(at, half, mode="reflect"), AROUND), axis=1)
    apart = np.empty(len(at))
    apart[order] = at - usual
    least = max(MIN_APART_S, MIN_APART_SHARE * float(usual.max() - usual.min()))
    foreign, begin = {}, 0
    for key, places, stamps in found:
        own = apart[begin : begin + len(places)]
        begin += len(places)
        ran = 1e-6 * stamps.astype(np.float64)
        if np.ptp(ran) < MIN_CLOCK_RATE * np.ptp(ran - own):
            continue
        typical = float(median(own))
        if abs(typical) > least and float(np.mean(np.abs(own - typical) < least)) > MIN_CLOCK_SHARE:
            foreign[key] = typical
    return foreign


# --- power-ups ---------------------------------------------------------------------------------------------------

# Columns of boot clocks, and their units in us.
BOOT_CLOCK_COLUMNS = (
    ("TimeUS", 1.0),
    ("timestamp", 1.0),
    ("time_boot_ms", 1e3),
    ("TimeMS", 1e3),
    ("log_time_ns", 1e-3),
)
# A table that spans more than a week has a false stamp.
MAX_TABLE_S = 7 * 86_400.0
MAX_LISTED_BOOTS = 4


def logged_seconds(messages: Messages) -> float:
    """Return the time in s from the first to the last stamp of any message, 0 without any."""
    spans = []
    for (name, _), table in messages.items():
        column, us = next(((c, us) for c, us in BOOT_CLOCK_COLUMNS if c in table), ("", 1.0))
        if not column or len(table) == 0 or (name == "GPS" and column == "TimeMS"):  # time of the GPS week
            continue
        stamps = np.asarray(table[column])
        if stamps.dtype.kind not in "iuf":  # text of a damaged definition
            continue
        t = stamps.ravel().astype(np.float64) * us * 1e-6
        t = t[np.isfinite(t) & (t > 0.0)]
        if len(t) and np.ptp(t) < MAX_TABLE_S:
            spans.append((float(t.min()), float(t.max())))
    if not spans:
        return 0.0
    middle = sorted(a for a, _ in spans)[len(spans) // 2]
    near = [(a, b) for a, b in spans if abs(a - middle) < MAX_TABLE_S]
    return max(b for _, b in near) - min(a for a, _ in near)


# Below this time a log shows nothing about its logging settings; files up to this size are looked at.
MIN_JUDGED_S, MAX_SHORT_BYTES = 2.0, 4 << 20
# Messages that define the log, and records of others above which a log without length has no times.
WITHOUT_DATA, MAX_UNTIMED_RECORDS = ("FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG"), 200


def describe_early_end(messages: Messages | None) -> str:
    """Return the sentence on a file too short to judge its logging settings, empty for others."""
    if messages is None or messages.size > MAX_SHORT_BYTES or (seconds := logged_seconds(messages)) >= MIN_JUDGED_S:
        return ""
    records = sum(len(table) for (name, _), table in messages.items() if name not in WITHOUT_DATA)
    if seconds == 0.0 and records > MAX_UNTIMED_RECORDS and messages.format.startswith("dataflash"):
        return ""  # its records have no times
    return f"The file ends after {messages.size:,} bytes with {seconds:.1f} s of data: copy it again, or log longer."


def describe_other_boots(messages: Messages, chosen: int) -> str:
    """Return the other power-ups and their lengths as text: "Number 1 lasts 12 s, number 2 lasts 3 s"."""
    numbers = [k for k in range(len(messages.boots)) if k != chosen]
    logged = [f"number {k} lasts {logged_seconds(messages.boot(k)):.0f} s" for k in numbers[:MAX_LISTED_BOOTS]]
    more = f" and {len(numbers) - MAX_LISTED_BOOTS} more" if len(numbers) > MAX_LISTED_BOOTS else ""
    text = ", ".join(logged) + more
    return text[:1].upper() + text[1:]


# --- GPS time ----------------------------------------------------------------------------------------------------

# 1980-01-06 00:00 UTC as Unix time.
GPS_EPOCH_S = 315_964_800
# (Unix time of the start, GPS minus UTC in s), IERS Bulletin C; none was added since 2017.
LEAP_SECONDS = ((1_230_768_000, 15), (1_341_100_800, 16), (1_435_708_800, 17), (1_483_228_800, 18))


def gps_time_us(week: NDArray[np.int64], milliseconds: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return Unix time in us of GPS week and milliseconds of the week, 0 for an unset or impossible week."""
    known = (week > 0) & (week < 5000) & (milliseconds >= 0) & (milliseconds < 604_800_000)
    gps_us = (GPS_EPOCH_S + np.where(known, week, 0) * 604_800) * 1_000_000 + np.where(known, milliseconds, 0) * 1000
    leap = np.full(len(week), LEAP_SECONDS[0][1])
    for start, seconds in LEAP_SECONDS:  # in the middle of a GPS week, as on 2015-07-01
        leap = np.where(gps_us >= (start + seconds) * 1_000_000, seconds, leap)
    return np.where(known, gps_us - leap * 1_000_000, 0)
