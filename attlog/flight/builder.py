"""What the readers of all firmwares share: from columns to streams on one clock.

A reader first collects inertial candidates with their stamps in int64 microseconds,
chooses one, and only then knows t = 0. :class:`LogBuilder` carries what is found on
the way: problems, choices and the zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import guarded
from attlog.core.limits import LAST_TIME_US, READ_BYTES
from attlog.core.timestamps import Stamps, ValidRecords, plausible_records
from attlog.flight import limits
from attlog.flight.limits import Quantity
from attlog.flight.model import Array, Attitude, Problem, Severity, Stream, TimeLine
from attlog.flight.timestamps import isolated_timestamps
from attlog.formats.table import Messages, Table

T = TypeVar("T")
U = TypeVar("U")

VALUE_CODES = ("values_out_of_range", "rate_impossible")


@dataclass(slots=True)
class LogBuilder:
    """A log in the making: its messages, and what the reader has found out so far."""

    messages: Messages
    problems: list[Problem] = field(default_factory=list)
    choices: dict[str, str] = field(default_factory=dict)
    t0_us: int = 0

    def problem(
        self,
        code: str,
        severity: Severity,
        text: str,
        t: float | None = None,
        offset: int | None = None,
        count: int = 1,
    ) -> None:
        """Note something the user must know."""
        self.problems.append(Problem(code, severity, text.strip(), t, offset, count))

    def attempt(self, what: str, build: Callable[[], T], otherwise: U) -> T | U:
        """What ``build`` finds, ``otherwise`` where a damaged definition makes its message unreadable.

        Damage in a log hits format definitions too: fields are then missing, renamed or
        of another type. One such message must not take the others with it, nor may
        anything else that nobody thought of (``attlog/barrier.py``).
        """

        def tried() -> T | U:
            try:
                return build()
            except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
                reason = str(error.args[0]) if error.args else type(error).__name__
                self.problem("unreadable_message", "warning", f"{what} cannot be used: {reason.rstrip('.')[:200]}.")
                return otherwise

        def missing(text: str) -> U:
            self.problem("part_failed", "error", text)
            return otherwise

        found = guarded(what, tried, missing)
        if self.messages.size > READ_BYTES:  # copies of gigabytes would stay until the whole flight is read
            self.messages.forget()
        return found

    def seconds(self, t_us: Stamps) -> Array:
        """Boot-clock microseconds as seconds on the log's clock (exact difference first)."""
        seconds: Array = (np.asarray(t_us, np.int64) - self.t0_us) * np.float64(1e-6)
        return seconds

    def take_values(self, other: LogBuilder) -> None:
        """What another builder found wrong with values; its times were told by another stream of the same records."""
        self.problems += [p for p in other.problems if p.code in VALUE_CODES]

    def within(self, x: Array, quantity: Quantity, source: str) -> Array:
        """The values ``x`` (n,) or (n, k), NaN where they are impossible, which is counted and told."""
        beyond = quantity.outside(x)
        count = int(np.count_nonzero(beyond))
        if count == 0:
            return x
        text = f"{source}: left out {count:,} of {x.size:,} values of {quantity.name}, outside {quantity.limits}"
        self.problem("values_out_of_range", "warning", f"{text} ({quantity.why}).", count=count)
        return np.where(beyond, np.nan, x)

    def near(self, t_us: Stamps) -> NDArray[np.bool_]:
        """Which stamps (n,) may belong to this flight: events, texts and parameters days away from it do not."""
        t = np.asarray(t_us, np.int64)
        near: NDArray[np.bool_] = (t >= 0) & (t <= LAST_TIME_US) & (np.abs(t - self.t0_us) <= 1e6 * limits.LONGEST_S)
        return near

    def is_near(self, t_us: int) -> bool:
        """:meth:`near` for one stamp."""
        return 0 <= t_us <= LAST_TIME_US and abs(t_us - self.t0_us) <= 1e6 * limits.LONGEST_S

    def keep(
        self,
        t_us: Stamps,
        source: str,
        good: NDArray[np.bool_] | None = None,
        *,
        wrong: str = "with values that no sensor can give",
        fastest_hz: float = limits.FUSED_HZ,
    ) -> NDArray[np.int64]:
        """Indices of the records with plausible stamps (and ``good`` values); what is left out becomes problems.

        ``wrong`` says what is the matter with the others. None is left where they follow each
        other faster than ``fastest_hz``: their stamps are then no microseconds.
        """
        index = np.arange(len(t_us)) if good is None else np.flatnonzero(good)
        values = len(t_us) - len(index)
        if values:
            self.problem(
                "values_out_of_range",
                "warning",
                f"{source}: left out {values:,} of {len(t_us):,} records, {wrong}.",
                count=values,
            )
        whole = np.asarray(t_us, np.int64)
        kept = plausible_records(whole[index], partial(isolated_timestamps, self.messages), whole)
        self._report_false_stamps(kept, source, len(t_us))
        index = index[kept.index]
        if self.t0_us:
            near = self.near(np.asarray(t_us, np.int64)[index])
            if not near.all():
                far = int(np.count_nonzero(~near))
                text = (
                    f"{source}: left out {far:,} of {len(t_us):,} records, whose times are days away from the flight."
                )
                self.problem("false_times", "warning", text, count=far)
                index = index[near]
        rate = burst_rate(np.asarray(t_us, np.int64)[index])
        if rate > fastest_hz:
            text = f"{source}: its {len(index):,} records follow each other at {rate:,.0f} Hz; more than "
            text += f"{fastest_hz:,.0f} Hz is not possible. Their stamps are false, and none is used."
            self.problem("rate_impossible", "warning", text, count=len(index))
            return np.zeros(0, np.int64)
        return index

    def _report_false_stamps(self, kept: ValidRecords, source: str, records: int) -> None:
        """A problem for each reason why stamps of a message, of so many records, are not used."""
        reasons: tuple[tuple[str, Severity, int, str], ...] = (
            ("duplicate_times", "note", kept.duplicates, "which repeat a time stamp"),
            ("time_backward", "warning", kept.backward, "which go back in time"),
            ("unset_times", "warning", kept.unset, "whose time stamp was never set (0)"),
            ("false_times", "warning", kept.false, ""),
        )
        for code, severity, count, why in reasons:
            if count:
                left_out = f"{source}: left out {count:,} of {records:,} records"
                text = f"{left_out}, {why}." if why else f"{left_out}: nothing else in the log has such times."
                self.problem(code, severity, text, count=count)

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
        sampling: Literal["interval", "instant"] = "instant",
        delay: float = 0.0,
        t_sample_us: Stamps | None = None,
        allow_nan: bool = False,
    ) -> Stream | None:
        """A clean stream of ``x`` (n,) or (n, k), None if no record is left.

        Records with values that are missing or not ``within`` a quantity's limits go. Where
        ``allow_nan`` such values become NaN instead, and a record without any value goes silently.
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
        index = chosen[self.keep(np.asarray(t_us)[chosen], source, good, wrong=wrong, fastest_hz=fastest_hz)]
        if len(index) == 0:
            return None
        t = self.seconds(np.asarray(t_us)[index])
        sampled = None if t_sample_us is None else self.sample_times(np.asarray(t_us)[index], t_sample_us[index])
        return Stream(t, x[index], unit, frame, source, sampling, delay, sampled)

    def battery(self, t_us: Stamps, x: Array, source: str) -> Stream | None:
        """Battery from ``x`` (n, 2), voltage in V and current in A, NaN where not measured."""
        volts, amperes = x[:, :1], x[:, 1:2]
        clean = [self.within(volts, limits.VOLTAGE, source), self.within(amperes, limits.CURRENT, source)]
        fastest = limits.AIDING_HZ
        return self.stream(t_us, np.hstack(clean), "V, A", source, fastest_hz=fastest, allow_nan=True)

    def sample_times(self, t_us: Stamps, t_sample_us: Stamps) -> Array | None:
        """Times of measurement in s, None where the log's column is unset or tells nothing new.

        A sample lies at most one second before its stamp. Single unset ones get the
        usual age; a repeated sample time is moved on by a microsecond to stay rising.
        """
        t_us, t_sample_us = np.asarray(t_us, np.int64), np.asarray(t_sample_us, np.int64)
        age = t_us - t_sample_us
        known = (age >= 0) & (age < 1_000_000)
        if len(age) == 0 or np.mean(known) < 0.9 or not age[known].any():
            return None
        sampled = np.where(known, t_sample_us, t_us - int(np.median(age[known])))
        order = np.arange(len(sampled))
        return self.seconds(np.maximum.accumulate(sampled - order) + order)

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
        """A clean attitude of quaternions ``q`` (n, 4), None if no record holds one.

        ``counter`` (n,) steps where the estimator reset its attitude; ``reset_times_us``
        are resets that the log tells elsewhere, each put on the largest of the three
        steps around it (the logger's order and rate leave one sample of doubt).
        """
        if np.shape(q)[1:] != (4,):
            raise ValueError(f"{source} does not hold four numbers of a quaternion")
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
        index = chosen[self.keep(np.asarray(t_us)[chosen], source, good[chosen], wrong=wrong)]
        if len(index) == 0:
            return None
        stamps = np.asarray(t_us, np.int64)[index]
        # Twice: the second time takes out what rounding left of the first, and nobody has to do it again.
        unit = rotation.normalize(rotation.normalize(np.asarray(q, np.float64)[index]))
        resets: set[int] = set()
        if counter is not None:
            resets |= {int(i) + 1 for i in np.flatnonzero(np.diff(np.asarray(counter)[index].astype(np.int64)))}
        resets |= self.reset_steps(stamps, unit, reset_times_us, resets)
        sampled = None if t_sample_us is None else self.sample_times(stamps, np.asarray(t_sample_us)[index])
        return Attitude(
            self.seconds(stamps), unit, source, sampled, np.array(sorted(resets), np.int64), has_trim, step_deg, True
        )

    def positions(self, t_us: Stamps, x: Array, at: Array) -> Array | None:
        """Positions ``x`` (n, 3) at the times ``at`` (m,) s of an attitude of the same records; None without two."""
        t = self.seconds(t_us)
        order = np.argsort(t, kind="stable")
        order = order[rotation.finite_rows(x[order])]
        return np.column_stack([np.interp(at, t[order], axis) for axis in x[order].T]) if len(order) > 1 else None

    def reset_steps(self, t_us: Stamps, q: Array, times_us: Iterable[int], known: set[int]) -> set[int]:
        """Indices of the steps that resets at the given times made; none where one is known already."""
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

    def texts(self, at: Callable[[int], int] | None = None) -> list[tuple[float, int, str]]:
        """The autopilot's messages (t, level, text); ``at`` gives the time of a place in the file for those without."""
        found = []
        for text in self.messages.texts:
            t_us = text.t_us if text.t_us is not None else self.t0_us if at is None else at(text.offset)
            if self.is_near(t_us):
                found.append((float(self.seconds(np.array(t_us))), text.level, text.text))
        return found

    def time_line(self, t_us: Stamps, values: list[Any], source: str) -> TimeLine | None:
        """A time line that keeps only changes; None without entries."""
        stamps = np.asarray(t_us, np.int64)
        sane = self.near(stamps)
        if len(values) == 0 or not sane.any():
            return None
        order = np.argsort(stamps, kind="stable")
        order = order[sane[order]]
        ordered = [values[i] for i in order]
        changed = [i for i, value in enumerate(ordered) if i == 0 or value != ordered[i - 1]]
        t = self.seconds(np.asarray(t_us, np.int64)[order])
        return TimeLine(t[changed], [ordered[i] for i in changed], source)


def burst_rate(t_us: Stamps) -> float:
    """Records per second while they follow each other within a second, 0 where there are too few to tell."""
    steps = np.diff(t_us)
    close = steps[steps <= 1_000_000]
    span = float(close.sum())
    return 1e6 * len(close) / span if len(t_us) >= limits.ENOUGH_FOR_A_RATE and span > 0 else 0.0


def columns(table: Table, *names: str) -> Array:
    """Columns (n, k) of a table as float64 in the format's own units; array fields are widened."""
    parts = [table.value(name) for name in names]
    if len(parts) == 1 and parts[0].ndim == 2:
        return np.ascontiguousarray(parts[0])
    return np.column_stack(parts) if parts else np.zeros((len(table), 0))


def finite_within(x: Array, limit: float) -> NDArray[np.bool_]:
    """Which rows (n,) of x (n, k) are finite and within +-limit."""
    inside = np.ones(len(x), bool)
    with np.errstate(invalid="ignore"):
        for column in x.T:  # many times faster than ``all`` of each row
            inside &= (column >= -limit) & (column <= limit)
    return inside


def on_earth(place: Array) -> NDArray[np.bool_]:
    """Which rows of ``place`` (n, 2 or more) begin with a latitude and a longitude in deg."""
    return finite_within(place[:, :1], limits.LATITUDE.high) & finite_within(place[:, 1:2], limits.LONGITUDE.high)


def angle_quantisation_deg(angles_deg: Array) -> float:
    """The quantisation of logged angles in degrees: 0.01 where all lie on that grid, else 0."""
    angles = np.asarray(angles_deg, np.float64)
    angles = angles[np.isfinite(angles)]
    if len(angles) < 10:
        return 0.0
    hundredths = angles * 100.0
    on_grid = np.abs(hundredths - np.round(hundredths)) < 1e-3
    return 0.01 if np.mean(on_grid) > 0.99 else 0.0
