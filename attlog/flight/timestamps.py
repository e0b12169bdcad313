"""Which records of a message have a plausible time.

Stamps stay int64 microseconds of the autopilot's boot clock until the zero of the
log is known: float seconds of a Unix-epoch clock would lose the microseconds.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core import intervals
from attlog.core.limits import MAX_TIME_JUMP_S
from attlog.flight import limits
from attlog.formats.table import Messages, Table

Stamps = NDArray[np.int64]
LATEST_US = int(limits.CLOCK_US.high)

ISOLATED_US = 10_000_000
"""A gap that sets records apart from the others of their message."""
MAX_ISOLATED = 64
"""Records in a row that may be false: what a torn write or a damaged sector changes."""
MAX_REPEAT_US = 1_000_000
"""A repeated value is kept once in this time."""
MIN_UNSET = 3
"""So many stamps of 0 were never set: they tell no order and no duration."""


def read_stamps(table: Table, column: str, us: int = 1) -> Stamps:
    """A column of times in units of ``us`` microseconds as stamps (n,); what is no time is negative.

    ValueError where the log's own definitions make text, or several numbers per record, of it.
    """
    told = table[column]
    if told.ndim != 1 or told.dtype.kind not in "iuf":
        raise ValueError(f"{table.name}.{column} is no time")
    if told.dtype.kind == "f":  # no integer means "not a number", and what a cast makes of it differs by processor
        told = np.where((told >= 0) & (told <= LATEST_US), told, -1)
    stamps: Stamps = told.astype(np.int64)
    if us != 1:
        stamps = np.where((stamps >= 0) & (stamps <= LATEST_US // us), stamps * us, -1)
    return stamps


def valid_stamp(t_us: int) -> int:
    """A stamp in us, 0 where it is none."""
    return int(t_us) if 0 <= t_us <= LATEST_US else 0


IsolationTest = Callable[[Stamps], NDArray[np.bool_]]
"""For each time whether nothing else in the log has a record near it."""


@dataclass(frozen=True, slots=True)
class ValidRecords:
    """``index`` (k,) of the records with strictly rising, plausible stamps, and why the others went."""

    index: NDArray[np.int64]
    duplicates: int = 0
    backward: int = 0
    false: int = 0
    unset: int = 0

    @property
    def dropped(self) -> int:
        """All records left out."""
        return self.duplicates + self.backward + self.false + self.unset


def plausible_records(t_us: Stamps, alone: IsolationTest | None = None, whole: Stamps | None = None) -> ValidRecords:
    """The records (n,) whose stamps rise strictly and are contradicted by nothing.

    Later records with an equal stamp are duplicates (two tasks log one message), several of 0 are unset.
    Of stamps that go back, the longest rising subsequence stays, so that one record
    with a false late time does not take the good ones after it with it. Records half a
    day from most others are false. So are a few behind a gap at whose times, says
    ``alone``, nothing else was logged; after a pause of the whole log they stay.
    ``whole``: the stamps of the message with those records that are left out already.
    """
    t = np.asarray(t_us, np.int64)
    if len(t) == 0:
        return ValidRecords(np.zeros(0, np.int64))
    unset = int(np.count_nonzero(t == 0))
    if unset < MIN_UNSET:
        unset = 0
    index = np.flatnonzero((t >= (1 if unset else 0)) & (t <= LATEST_US))
    index = index[_within_half_a_day(t[index])]
    false = len(t) - len(index) - unset
    duplicates = backward = 0
    steps = np.diff(t[index])
    if (steps <= 0).any():
        keep = np.concatenate([[True], steps != 0])
        duplicates += int((~keep).sum())
        index = index[keep]
        if (np.diff(t[index]) <= 0).any():
            chain = longest_rising(t[index])
            lost = np.delete(index, chain)
            index = index[chain]
            # equal to a kept one: the same record twice
            near = index[np.minimum(np.searchsorted(t[index], t[lost]), len(index) - 1)]
            again = int((t[near] == t[lost]).sum())
            duplicates += again
            backward += len(lost) - again
    lone = np.zeros(0, np.int64) if alone is None else _contradicted(t[index], alone, t if whole is None else whole)
    return ValidRecords(np.delete(index, lone), duplicates, backward, false + len(lone), unset)


def _within_half_a_day(t: Stamps) -> NDArray[np.int64]:
    """The positions of the largest group of times in which none is further than that from the next."""
    jump = int(MAX_TIME_JUMP_S * 1e6)
    if len(t) == 0 or int(t.max()) - int(t.min()) <= jump:
        return np.arange(len(t))
    order = np.argsort(t, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(t[order]) > jump) + 1)
    return np.sort(max(groups, key=len))


def longest_rising(t: Stamps) -> NDArray[np.int64]:
    """Indices of the longest strictly rising subsequence (patience sorting, n log n)."""
    tails: list[int] = []  # smallest last value of a rising subsequence of each length
    at: list[int] = []
    before: list[int] = []
    highest = -1
    for i, value in enumerate(t.tolist()):
        if value > highest or not tails:  # nearly always: the next value continues the longest one
            before.append(at[-1] if at else -1)
            tails.append(value)
            at.append(i)
            highest = value
            continue
        k = bisect_left(tails, value)
        before.append(at[k - 1] if k else -1)
        tails[k] = value
        at[k] = i
        highest = tails[-1]
    chain = np.empty(len(at), np.int64)
    i = at[-1]
    for k in range(len(at) - 1, -1, -1):
        chain[k] = i
        i = before[i]
    return chain


def _contradicted(t: Stamps, alone: IsolationTest, whole: Stamps) -> NDArray[np.int64]:
    """The positions among rising times (n,) of the few that a gap sets apart and that have nothing else beside it."""
    cuts = np.flatnonzero(np.diff(t) > ISOLATED_US) + 1
    edges = np.concatenate([[0], cuts, [len(t)]])
    sizes = np.diff(edges)
    few = np.flatnonzero(sizes <= min(MAX_ISOLATED, int(sizes.max()) - 1))
    if len(few) == 0 or sizes.max() < 3:  # no gap, or a slow message
        return np.zeros(0, np.int64)
    first, last = t[edges[few]], t[edges[few + 1] - 1]
    # records of the same message beside them that were left out for their values: no gap in truth
    every = np.sort(whole)
    beside = np.searchsorted(every, last + ISOLATED_US, side="right") - np.searchsorted(every, first - ISOLATED_US)
    false = few[(beside <= sizes[few]) & alone(first) & alone(last)]
    return np.concatenate([np.zeros(0, np.int64), *(np.arange(edges[k], edges[k + 1]) for k in false)])


def changed_records(x: NDArray[np.float64], t_us: Stamps) -> NDArray[np.bool_]:
    """Which records (n,) hold a new measurement where a slow sensor is repeated at a faster rate.

    ``x`` (n,) or (n, k). A value that does not change may be measured anew: one record
    of each second stays, so that a sensor that stands still is not taken for absent.
    """
    new = np.ones(len(t_us), bool)
    if len(t_us) > 1:
        t = np.asarray(t_us, np.int64)
        changed = np.diff(np.asarray(x).reshape(len(t), -1), axis=0) != 0
        new[1:] = changed.any(axis=1)
        since = t - t[np.maximum.accumulate(np.where(new, np.arange(len(t)), 0))]
        new[1:] |= since[1:] // MAX_REPEAT_US > since[:-1] // MAX_REPEAT_US
    return new


def gap_indices(t: NDArray[np.float64]) -> NDArray[np.int64]:
    """Indices i where sample i comes after a gap."""
    return np.flatnonzero(np.diff(t) > intervals.gap_limit_of_times(t)) + 1 if len(t) > 2 else np.zeros(0, np.int64)


# Was anything else logged at this time? What contradicts a false time is the rest of the log.
#
# One message alone cannot tell a false time from a pause: a logger that stops and goes on leaves the same gap. But a
# logger never writes one message only, so records at whose times no other message has any were not logged then.

CORROBORATION_US = 10_000_000
"""Messages are logged together when a logger goes on after a pause; slow ones follow within this time."""
MIN_CLOCKS = 3
"""Messages with times, the judged one among them, that a log must have for one to contradict another."""


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
        stamps = stamps[(stamps >= 0) & (stamps <= LATEST_US)]
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

TIMESTAMP_COLUMN = {"ulog": "timestamp"}
"""The column in which each record tells its time, whatever the others of its message tell."""


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

        _, instance = choose_system(messages, messages.path, system)
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

BOOT_CLOCK_COLUMNS = (("TimeUS", 1.0), ("timestamp", 1.0), ("time_boot_ms", 1e3), ("TimeMS", 1e3))
"""Columns of boot clocks, and their units in us."""
MAX_TABLE_S = 7 * 86_400.0
"""A table that spans more than a week has a false stamp."""
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

GPS_EPOCH_S = 315_964_800
"""1980-01-06 00:00 UTC as Unix time."""
LEAP_SECONDS = ((1_230_768_000, 15), (1_341_100_800, 16), (1_435_708_800, 17), (1_483_228_800, 18))
"""(Unix time of the start, GPS minus UTC in s), IERS Bulletin C; none was added since 2017."""


def gps_time_us(week: NDArray[np.int64], milliseconds: NDArray[np.int64]) -> NDArray[np.int64]:
    """Unix time in us of GPS week and milliseconds of the week; 0 where the week is unset or impossible."""
    known = (week > 0) & (week < 5000) & (milliseconds >= 0) & (milliseconds < 604_800_000)
    gps_us = (GPS_EPOCH_S + np.where(known, week, 0) * 604_800) * 1_000_000 + np.where(known, milliseconds, 0) * 1000
    leap = np.full(len(week), LEAP_SECONDS[0][1])
    for start, seconds in LEAP_SECONDS:  # in the middle of a GPS week, as on 2015-07-01
        leap = np.where(gps_us >= (start + seconds) * 1_000_000, seconds, leap)
    return np.where(known, gps_us - leap * 1_000_000, 0)


# Which time a record has, and whether to believe it.
