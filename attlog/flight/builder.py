"""Build a flight log: turn table columns into streams on one clock, without impossible times and values.

A reader collects inertial candidates with stamps in int64 microseconds, chooses one, and only then knows t = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.brief import counted
from attlog.core.errors import call_guarded
from attlog.core.limits import LAST_TIME_US, RELEASED_BYTES
from attlog.core.sorting import median
from attlog.core.timestamps import Stamps, ValidRecords, plausible_records
from attlog.flight import limits
from attlog.flight.limits import Quantity
from attlog.flight.model import Array, Attitude, Clipping, Firmware, FlightLog, Problem, Severity, Stream, TimeLine
from attlog.flight.timestamps import isolated_timestamps, read_stamps
from attlog.formats.table import FieldError, Messages, Table

T = TypeVar("T")
U = TypeVar("U")

# Problems of values, as opposed to those of times.
VALUE_CODES = ("values_out_of_range", "rate_impossible")
# Largest time from the measurement of a sample to its stamp.
MAX_SAMPLE_AGE_US = 1_000_000
# Least share of records with a plausible sample age for a column of sample times to be used.
MIN_SAMPLED_SHARE = 0.9
# Shortest interval to which a step of a clipping counter is attributed: close records may share a stamp.
MIN_COUNTED_S = 1.0
# Quantisation of angles logged as integers, in deg.
ANGLE_STEP_DEG = 0.01


class Part(NamedTuple):
    """Part of a flight log: dotted field ("" for none), name in messages, and reader."""

    field: str
    what: str
    read: Callable[[Any], Any]


@dataclass(slots=True)
class LogBuilder:
    """Flight log under construction and the messages it is read from."""

    messages: Messages
    t0_us: int = 0
    log: FlightLog = field(init=False)

    def __post_init__(self) -> None:
        self.log = self._empty_log()

    def _empty_log(self) -> FlightLog:
        messages = self.messages
        empty = FlightLog(messages.path, messages.format, messages.size, self.t0_us, Firmware(""), "")
        empty.messages = messages
        return empty

    @property
    def problems(self) -> list[Problem]:
        """The problems of the log."""
        return self.log.problems

    def quiet(self) -> LogBuilder:
        """Return a builder on the same clock with its own list of problems."""
        other = copy(self)
        other.log = self._empty_log()
        return other

    def problem(
        self,
        code: str,
        severity: Severity,
        text: str,
        t: float | None = None,
        offset: int | None = None,
        count: int = 1,
        *,
        remedy: str = "",
        source: str = "",
    ) -> None:
        """Add a problem to the log."""
        found = Problem(code, severity, text.strip(), t, offset, count, remedy=remedy.strip(), source=source)
        self.problems.append(found)

    # Parts of the log.

    def table(self, name: str, instance: int = 0) -> Table | None:
        """Return a message's table, None without records."""
        return self.messages.tables.get((name, instance))

    def stamps(self, table: Table) -> Stamps:
        """Return the stamps (n,) of a table in us of the boot clock."""
        return read_stamps(table, "timestamp")

    def read_optional(self, what: str, read: Callable[[], T], otherwise: U) -> T | U:
        """Return ``read()``; on a damaged message or a bug report a problem and return ``otherwise``.

        A damaged definition leaves fields missing, renamed or of another type.
        """

        def tried() -> T | U:
            try:
                return read()
            except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
                # A library's own words explain nothing to who reads the page.
                reason = str(error.args[0]) if isinstance(error, FieldError) else "its fields are not as expected"
                self.problem("unreadable_message", "warning", f"{what} cannot be used: {reason.rstrip('.')[:200]}.")
                return otherwise

        def missing(text: str) -> U:
            self.problem("part_failed", "error", text)
            return otherwise

        found = call_guarded(what, tried, missing)
        if self.messages.size > RELEASED_BYTES:  # releases decoded columns, which can take gigabytes
            self.messages.forget()
        return found

    def read_parts(self, parts: Iterable[Part]) -> None:
        """Read parts of the log in order; a part that cannot be read keeps its default."""
        for part in parts:
            group, _, name = part.field.rpartition(".")
            holder = getattr(self.log, group) if group else self.log
            default = getattr(holder, name) if name else None
            found = self.read_optional(part.what, partial(part.read, self), default)
            if name:
                setattr(holder, name, found)

    # Times.

    def seconds(self, t_us: Stamps) -> Array:
        """Convert stamps in us to seconds of the log; the difference is exact in integers."""
        seconds: Array = (np.asarray(t_us, np.int64) - self.t0_us) * np.float64(1e-6)
        return seconds

    def near(self, t_us: Stamps) -> NDArray[np.bool_]:
        """Mark the valid stamps (n,) within LONGEST_S (three days) of t = 0."""
        t = np.asarray(t_us, np.int64)
        near: NDArray[np.bool_] = (t >= 0) & (t <= LAST_TIME_US) & (np.abs(t - self.t0_us) <= 1e6 * limits.MAX_LOG_S)
        return near

    def is_near(self, t_us: int) -> bool:
        """Return :meth:`near` for a single stamp."""
        return 0 <= t_us <= LAST_TIME_US and abs(t_us - self.t0_us) <= 1e6 * limits.MAX_LOG_S

    def near_rows(self, table: Table) -> tuple[Table, Array]:
        """Return the rows of a table that are :meth:`near`, and their times (n,) in s."""
        stamps = self.stamps(table)
        near = self.near(stamps)
        return table.rows(near), self.seconds(stamps[near])

    def sample_times(self, t_us: Stamps, t_sample_us: Stamps) -> Array | None:
        """Return times of measurement in s, None if the column is unset or equals the stamps.

        Unset times are replaced by the stamp minus the median age. Repeated times are moved by 1 us to stay rising.
        """
        t_us, t_sample_us = np.asarray(t_us, np.int64), np.asarray(t_sample_us, np.int64)
        age = t_us - t_sample_us
        known = (age >= 0) & (age < MAX_SAMPLE_AGE_US)
        if len(age) == 0 or np.mean(known) < MIN_SAMPLED_SHARE or not age[known].any():
            return None
        sampled = np.where(known, t_sample_us, t_us - int(median(age[known])))
        order = np.arange(len(sampled))
        return self.seconds(np.maximum.accumulate(sampled - order) + order)

    # Records and values that are left out.

    def within(self, x: Array, quantity: Quantity, source: str) -> Array:
        """Replace impossible values of ``x`` (n,) or (n, k) by NaN and report them."""
        beyond = quantity.outside(x)
        count = int(np.count_nonzero(beyond))
        if count == 0:
            return x
        text = (
            f"{source}: left out {count:,} of {counted(x.size, 'value')} of {quantity.name}, outside {quantity.limits}"
        )
        severity: Severity = "note" if quantity.minor else "warning"
        self.problem("values_out_of_range", severity, f"{text} ({quantity.why}).", count=count)
        return np.where(beyond, np.nan, x)

    def clipping(self, sensor: str, unit: int, source: str, table: Table, column: str) -> Clipping:
        """Return the increments of a counter of clipped samples, summed over axes.

        A decrease is a restart. Increments above the sensor's sampling rate are reported and set to 0.
        """
        stamps, counts = self.stamps(table), table[column].astype(np.int64).reshape(len(table), -1)
        new = np.maximum(np.diff(counts, axis=0, prepend=counts[:1]), 0).sum(axis=1)
        elapsed_s = np.maximum(1e-6 * np.diff(stamps, prepend=stamps[:1]), MIN_COUNTED_S)
        impossible = new > counts.shape[1] * limits.CLIPPED_HZ * elapsed_s
        if impossible.any():
            count = int(np.count_nonzero(impossible))
            text = f"{source}: left out {count:,} of {len(new):,} counts, higher than a sensor can sample."
            self.problem("values_out_of_range", "warning", text, count=count)
        return Clipping(sensor, unit, source, self.seconds(stamps), np.where(impossible, 0, new), True)

    def add_value_problems(self, other: LogBuilder) -> None:
        """Add the value problems of another builder.

        Its time problems are already reported by another stream of the same records.
        """
        self.problems.extend(p for p in other.problems if p.code in VALUE_CODES)

    def select_records(
        self,
        t_us: Stamps,
        source: str,
        good: NDArray[np.bool_] | None = None,
        *,
        wrong: str = "with values that no sensor can give",
        fastest_hz: float = limits.FUSED_HZ,
    ) -> NDArray[np.int64]:
        """Return the indices of records with plausible stamps and ``good`` values; report the others.

        ``wrong``: the fault of records that are not good. Above ``fastest_hz`` the stamps have another unit, and no
        record is selected.
        """
        index = np.arange(len(t_us)) if good is None else np.flatnonzero(good)
        values = len(t_us) - len(index)
        if values:
            text = f"{source}: left out {values:,} of {counted(len(t_us), 'record')}, {wrong}."
            self.problem("values_out_of_range", "warning", text, count=values)
        whole = np.asarray(t_us, np.int64)
        kept = plausible_records(whole[index], partial(isolated_timestamps, self.messages), whole)
        self._report_false_stamps(kept, source, len(t_us))
        index = index[kept.index]
        if self.t0_us or (len(index) and whole[index[-1]] - whole[index[0]] > 1e6 * limits.MAX_LOG_S):
            # Before t = 0 is known, a flight's length around the middle record.
            middle = whole[index[len(index) // 2]] if len(index) else 0
            near = self.near(whole[index]) if self.t0_us else np.abs(whole[index] - middle) <= 0.5e6 * limits.MAX_LOG_S
            if not near.all():
                far = int(np.count_nonzero(~near))
                text = f"{source}: left out {far:,} of {counted(len(t_us), 'record')}, "
                text += "whose times are days away from the flight."
                self.problem("false_times", "warning", text, count=far)
                index = index[near]
        rate = burst_rate(whole[index])
        if rate > fastest_hz:
            text = f"{source}: its {len(index):,} records follow each other at {rate:,.0f} Hz; more than "
            text += f"{fastest_hz:,.0f} Hz is not possible. Their stamps are false, and none is used."
            self.problem("rate_impossible", "warning", text, count=len(index))
            return np.zeros(0, np.int64)
        return index

    def _report_false_stamps(self, kept: ValidRecords, source: str, records: int) -> None:
        """Add a problem for each cause of rejected stamps."""
        reasons: tuple[tuple[str, Severity, int, str], ...] = (
            ("duplicate_times", "note", kept.duplicates, "which repeat a time stamp"),
            ("time_backward", "warning", kept.backward, "which go back in time"),
            ("unset_times", "warning", kept.unset, "whose time stamp was never set (0)"),
            ("false_times", "warning", kept.false, ""),
        )
        for code, severity, count, why in reasons:
            if count:
                left_out = f"{source}: left out {count:,} of {counted(records, 'record')}"
                text = f"{left_out}, {why}." if why else f"{left_out}: nothing else in the log has such times."
                self.problem(code, severity, text, count=count)

    # Streams, attitudes, time lines, texts.

    def stream(
        self,
        t_us: Stamps,
        x: Array,
        unit: str,
        source: str,
        *,
        frame: str = "",
        within: Quantity | None = None,
        fastest_hz: float = limits.FUSED_HZ,
        t_sample_us: Stamps | None = None,
        allow_nan: bool = False,
    ) -> Stream | None:
        """Return a clean stream of ``x`` (n,) or (n, k), None if no record is left.

        Records with values that are missing or outside ``within`` are left out and reported. With ``allow_nan`` such
        values become NaN, and records without any value are left out silently.
        """
        x = np.asarray(x, np.float64).reshape(len(t_us), -1)
        wrong, good = "with missing values", None
        if allow_nan:
            x = x if within is None else self.within(x, within, source)
            chosen = np.flatnonzero(~np.isnan(x).all(axis=1))
        else:
            chosen, finite = np.arange(len(x)), rotation.finite_rows(x)
            good = np.asarray(finite if within is None else finite & ~within.outside(x).any(axis=1))
            if within is not None:
                wrong = f"where {within.name} is missing or outside {within.limits} ({within.why})"
        index = self.select_records(np.asarray(t_us)[chosen], source, good, wrong=wrong, fastest_hz=fastest_hz)
        index = chosen[index]
        if len(index) == 0:
            return None
        t = self.seconds(np.asarray(t_us)[index])
        sampled = None if t_sample_us is None else self.sample_times(np.asarray(t_us)[index], t_sample_us[index])
        return Stream(t, x[index], unit, frame, source, t_sample=sampled)

    def column_stream(
        self,
        table: Table | None,
        names: tuple[str, ...],
        unit: str,
        source: str,
        within: Quantity | None,
        *,
        scale: float = 1.0,
        frame: str = "",
        allow_nan: bool = False,
    ) -> Stream | None:
        """Return columns of a table times ``scale`` as stream, None if the table or a column is missing."""
        if table is None or not all(name in table for name in names):
            return None
        x = columns(table, *names) * scale
        return self.stream(self.stamps(table), x, unit, source, frame=frame, within=within, allow_nan=allow_nan)

    def battery_stream(self, t_us: Stamps, x: Array, source: str) -> Stream | None:
        """Return the battery stream of ``x`` (n, 2), voltage in V and current in A, NaN if not measured."""
        volts, amperes = x[:, :1], x[:, 1:2]
        clean = [self.within(volts, limits.VOLTAGE, source), self.within(amperes, limits.CURRENT, source)]
        fastest = limits.AIDING_HZ
        return self.stream(t_us, np.hstack(clean), "V, A", source, fastest_hz=fastest, allow_nan=True)

    def attitude(
        self,
        t_us: Stamps,
        q: Array,
        source: str,
        *,
        t_sample_us: Stamps | None = None,
        counter: NDArray[Any] | None = None,
        reset_times_us: Iterable[int] = (),
        has_trim: bool = False,
        step_deg: float = 0.0,
    ) -> Attitude | None:
        """Return a clean attitude of quaternions ``q`` (n, 4), None without any.

        ``counter`` (n,) changes when the estimator resets its attitude. ``reset_times_us``: resets from other
        messages, each assigned to the largest of the three steps around it. ValueError for another shape.
        """
        if np.shape(q)[1:] != (4,):
            raise FieldError(f"{source} does not hold four numbers of a quaternion")
        norm = np.sqrt(np.sum(np.asarray(q, np.float64) ** 2, axis=1))
        unset = norm == 0
        if unset.all():
            if len(unset):
                text = f"{source}: all {len(unset):,} records hold zeros in place of an attitude; it is not used."
                self.problem("attitude_unset", "warning", text, count=len(unset))
            return None
        with np.errstate(invalid="ignore"):
            good = (norm > limits.QUATERNION_NORM.low) & (norm < limits.QUATERNION_NORM.high)
        chosen = np.flatnonzero(~unset)
        wrong = f"with quaternions or angles that are none (norm outside {limits.QUATERNION_NORM.limits})"
        index = chosen[self.select_records(np.asarray(t_us)[chosen], source, good[chosen], wrong=wrong)]
        if len(index) == 0:
            return None
        stamps = np.asarray(t_us, np.int64)[index]
        # The second pass removes the rounding error of the first.
        unit = rotation.normalize(rotation.normalize(np.asarray(q, np.float64)[index]))
        resets: set[int] = set()
        if counter is not None:
            resets |= {int(i) + 1 for i in np.flatnonzero(np.diff(np.asarray(counter)[index].astype(np.int64)))}
        resets |= _reset_steps(stamps, unit, reset_times_us, resets)
        sampled = None if t_sample_us is None else self.sample_times(stamps, np.asarray(t_sample_us)[index])
        order = np.array(sorted(resets), np.int64)
        return Attitude(self.seconds(stamps), unit, source, sampled, order, has_trim, step_deg, normal=True)

    def positions(self, t_us: Stamps, x: Array, at: Array) -> Array | None:
        """Interpolate positions ``x`` (n, 3) to times ``at`` (m,) s, None for fewer than two positions."""
        t = self.seconds(t_us)
        order = np.argsort(t, kind="stable")
        order = order[rotation.finite_rows(x[order])]
        return np.column_stack([np.interp(at, t[order], axis) for axis in x[order].T]) if len(order) > 1 else None

    def texts(self, at: Callable[[int], int] | None = None) -> list[tuple[float, int, str]]:
        """Return the autopilot's messages (t, level, text); ``at`` maps a place in the file to a stamp."""
        found = []
        for text in self.messages.texts:
            t_us = text.t_us if text.t_us is not None else self.t0_us if at is None else at(text.offset)
            if self.is_near(t_us):
                found.append((float(self.seconds(np.array(t_us))), text.level, text.text))
        return found

    def time_line(self, t_us: Stamps, values: list[Any], source: str) -> TimeLine | None:
        """Return the changes of ``values`` as time line, None without valid stamps."""
        stamps = np.asarray(t_us, np.int64)
        sane = self.near(stamps)
        if len(values) == 0 or not sane.any():
            return None
        order = np.argsort(stamps, kind="stable")
        order = order[sane[order]]
        ordered = [values[i] for i in order]
        changed = [i for i, value in enumerate(ordered) if i == 0 or value != ordered[i - 1]]
        t = self.seconds(stamps[order])
        return TimeLine(t[changed], [ordered[i] for i in changed], source)


def _reset_steps(t_us: Stamps, q: Array, times_us: Iterable[int], known: set[int]) -> set[int]:
    """Return the indices of attitude steps that belong to resets at ``times_us``.

    Each is the largest of the three steps around its time, because order and rate of logging shift it by a sample.
    Times next to a ``known`` reset are skipped.
    """
    found: set[int] = set()
    if len(t_us) < 2:
        return found
    steps = rotation.total_angle(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]))
    for time in times_us:
        if not t_us[0] < time <= t_us[-1]:
            continue
        i = int(np.searchsorted(t_us, time))
        around = [k for k in (i - 1, i, i + 1) if 1 <= k < len(t_us)]
        if around and not known & set(around):
            found.add(max(around, key=lambda k: steps[k - 1]))
    return found


def burst_rate(t_us: Stamps) -> float:
    """Return the mean rate in Hz over intervals of up to 1 s, 0 for too few records unless no sensor is as fast."""
    steps = np.diff(t_us)
    close = steps[steps <= 1_000_000]
    span = float(close.sum())
    rate = 1e6 * len(close) / span if span > 0 else 0.0
    few = len(t_us) < limits.ENOUGH_FOR_A_RATE and (rate <= limits.RAW_HZ or len(close) < len(steps))
    return 0.0 if few else rate


def columns(table: Table, *names: str) -> Array:
    """Return columns of a table as (n, k) float64 in printed units; array fields add a column per element."""
    parts = [table.value(name) for name in names]
    if len(parts) == 1 and parts[0].ndim == 2:
        return np.ascontiguousarray(parts[0])
    return np.column_stack(parts) if parts else np.zeros((len(table), 0))


def optional_column(table: Table, name: str) -> Array:
    """Return a column (n,) as float64, all NaN if the table lacks it."""
    return table.value(name).astype(np.float64) if name in table else np.full(len(table), np.nan)


def finite_within(x: Array, limit: float) -> NDArray[np.bool_]:
    """Mark the rows (n,) of x (n, k) that are finite and within +-limit."""
    inside = np.ones(len(x), bool)
    with np.errstate(invalid="ignore"):
        for column in x.T:  # many times faster than ``all`` of each row
            inside &= (column >= -limit) & (column <= limit)
    return inside


def from_euler(angles: Array, limit: float) -> Array:
    """Return quaternions (n, 4) of Euler angles (n, 3) rad, NaN if an angle is outside +-limit."""
    good = finite_within(angles, limit)
    q = np.full((len(angles), 4), np.nan)
    q[good] = rotation.from_euler(*angles[good].T)
    return q


def angle_step_deg(angles_deg: Array) -> float:
    """Return ANGLE_STEP_DEG if 99 % of logged angles are multiples of it, else 0."""
    angles = np.asarray(angles_deg, np.float64)
    angles = angles[np.isfinite(angles)]
    if len(angles) < 10:
        return 0.0
    steps = angles / ANGLE_STEP_DEG
    return ANGLE_STEP_DEG if np.mean(np.abs(steps - np.round(steps)) < 1e-3) > 0.99 else 0.0
