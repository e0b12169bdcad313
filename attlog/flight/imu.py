"""Choose inertial units: read candidates of all messages, keep the best per unit, select the one to replay."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.brief import counted
from attlog.core.sorting import median
from attlog.core.timestamps import Stamps, plausible_records
from attlog.flight import limits
from attlog.flight.builder import LogBuilder, finite_within
from attlog.flight.model import Array, Imu, Problem, Stream, logged_rate
from attlog.flight.timestamps import describe_early_end, valid_stamp

# Fewest samples of a replay.
REPLAY_MIN_SAMPLES = 20
# Lowest rate of a replay: below, rotation between samples is lost.
REPLAY_MIN_HZ = 10.0
# Below this rate (default logs have 50 Hz) vibration is aliased and lags are marked as low-rate.
LOW_RATE_HZ = 45.0
# A unit with a smaller share of nonzero records was never read: a simulator or driver filled it with zeros.
MIN_NONZERO_SHARE = 0.01
# Above this share of repeated or unset stamps they count as refused; below, two tasks logged each record.
MAX_REPEATED_SHARE = 0.9
# Least time covered by a preferred message, as a share of the longest message of its unit.
MIN_COVERED_SHARE = 0.02
# Above this share of refused records a unit is not replayed.
MAX_REFUSED_SHARE = 0.5
# Share of samples without the other sensor's value above which they are reported.
MAX_SILENT_SHARE = 0.05
# A longer record of another unit is reported if both are exceeded: time in s, and share of the joint time.
MAX_MISSED_S, MAX_MISSED_SHARE = 5.0, 0.05
# Longest gap across which one sensor is interpolated to the other's times: the larger of us and median intervals.
MAX_RESAMPLE_US, MAX_RESAMPLE_INTERVALS = 20e3, 5.0

REFUSED_CODES = ("values_out_of_range", "time_backward", "false_times", "rate_impossible")
# Problems that explain unused inertial records.
LEFT_OUT_CODES = (*REFUSED_CODES, "duplicate_times", "unset_times", "imu_all_zero", "unreadable_message")
IMPLAUSIBLE_MOTION = (
    f"where gyro or accelerometer are missing or outside what a sensor can give ({limits.GYRO.limits}, "
    f"{limits.ACC.limits})"
)


def is_replayable_rate(rate: float) -> bool:
    """Return whether a rate in Hz, rounded to a decimal as in messages, suffices for a replay."""
    return round(rate, 1) >= REPLAY_MIN_HZ


@dataclass(slots=True)
class ImuCandidate:
    """Gyro (n, 3) rad/s and specific force (n, 3) m/s^2 of one unit from one message, stamps in us.

    ``rank``: place in the firmware's order of preference, 0 best. ``usable``: fast enough for its kind of message.
    ``refused``: share of records with impossible values or false times.
    """

    index: int
    rank: int
    t_us: Stamps
    gyro: Array
    acc: Array
    source: str
    sampling: Literal["interval", "instant"]
    calibrated: bool = True
    filtered: str = "unknown"
    gyro_delay: float = 0.0
    acc_delay: float = 0.0
    device: str | None = None
    temperature: Array | None = None
    dt: Array | None = None
    note: str = ""
    usable: bool = True
    acc_source: str = ""
    acc_device: str | None = None
    fastest_hz: float = limits.FUSED_HZ
    refused: float = 0.0
    problems: list[Problem] = field(default_factory=list)

    @property
    def rate(self) -> float:
        """Mean rate in Hz while the logger ran."""
        return logged_rate((self.t_us - self.t_us[0]) * 1e-6) if len(self.t_us) else 0.0

    @property
    def seconds(self) -> float:
        """Time in s from the first record to the last."""
        return 1e-6 * float(self.t_us[-1] - self.t_us[0]) if len(self.t_us) else 0.0

    def rows(self, index: NDArray[np.int64]) -> ImuCandidate:
        """Keep only the samples of ascending ``index`` (m,), in place."""
        if len(index) == len(self.t_us):
            return self
        self.t_us, self.gyro, self.acc = self.t_us[index], self.gyro[index], self.acc[index]
        self.temperature = None if self.temperature is None else self.temperature[index]
        self.dt = None if self.dt is None else self.dt[index]
        return self


@dataclass(frozen=True, slots=True)
class FlownUnits:
    """IMU ``units`` in use by the autopilot from stamps ``t_us`` (n,) on, as logged in ``source``."""

    t_us: Stamps = field(default_factory=lambda: np.zeros(0, np.int64))
    units: list[int] = field(default_factory=list)
    source: str = ""


def read_candidates(
    builder: LogBuilder, sources: Iterable[tuple[str, Callable[[], list[ImuCandidate]]]]
) -> list[ImuCandidate]:
    """Return the valid candidates of every message (name and reader)."""
    found = [c for name, source in sources for c in builder.read_optional(name, source, [])]
    clean = [builder.read_optional(c.source, partial(validate_candidate, builder, c), None) for c in found]
    return [c for c in clean if c is not None]


def validate_candidate(builder: LogBuilder, candidate: ImuCandidate) -> ImuCandidate | None:
    """Remove records with implausible stamps or values; None if nothing is left.

    Losses are kept in the candidate's problems, which the log reports only if the candidate is chosen.
    """
    own = builder.quiet()
    if candidate.gyro.shape[1:] != (3,) or candidate.acc.shape[1:] != (3,):
        text, count = f"{candidate.source} does not hold three axes.", len(candidate.t_us)
        builder.problem("unreadable_message", "warning", text, count=count)
        return None
    good = finite_within(candidate.gyro, limits.GYRO.high) & finite_within(candidate.acc, limits.ACC.high)
    index = own.select_records(
        candidate.t_us, candidate.source, good, wrong=IMPLAUSIBLE_MOTION, fastest_hz=candidate.fastest_hz
    )
    candidate.problems += own.problems
    wrong = sum(p.count for p in own.problems if p.code in REFUSED_CODES)
    repeated = sum(p.count for p in own.problems if p.code in ("duplicate_times", "unset_times"))
    wrong += repeated if repeated > MAX_REPEATED_SHARE * len(candidate.t_us) else 0
    candidate.refused = wrong / max(len(candidate.t_us), 1)
    nonzero = np.zeros(len(index), bool)
    for column in (*candidate.gyro.T, *candidate.acc.T):
        nonzero |= column[index] != 0
    if len(index) and np.mean(nonzero) < MIN_NONZERO_SHARE:
        text = f"{candidate.source}: its gyro and accelerometer values are zero; this unit is not used."
        builder.problem("imu_all_zero", "warning", text, count=len(index))
        return None
    if len(index):
        return candidate.rows(index)
    builder.problems.extend(candidate.problems)
    return None


def best_per_unit(builder: LogBuilder, candidates: list[ImuCandidate]) -> list[ImuCandidate]:
    """Return one candidate per unit: the best rank among usable ones, else the fastest.

    Problems of the chosen candidate are reported; problems of all candidates if none is usable.
    """
    chosen = []
    for index in sorted({c.index for c in candidates}):
        mine = [c for c in candidates if c.index == index]
        usable = [c for c in mine if c.usable and is_replayable_rate(c.rate)]
        longest = max((c.seconds for c in usable), default=0.0)
        usable = [c for c in usable if c.seconds >= MIN_COVERED_SHARE * longest]
        chosen.append(min(usable, key=lambda c: c.rank) if usable else max(mine, key=lambda c: c.rate))
        for reported in [chosen[-1]] if usable else mine:
            builder.problems.extend(reported.problems)
    return chosen


def add_imus(
    builder: LogBuilder,
    candidates: list[ImuCandidate],
    flew: int | None,
    why: str,
    asked: int | None,
    first_stamp: Callable[[], int],
) -> None:
    """Add the units to the log, choose the one to replay, and set t = 0 to its first sample.

    ``flew``: index of the unit in use by the autopilot, for the reason ``why``. ``asked``: the user's choice.
    ``first_stamp``: t = 0 in us without any unit.
    """
    log = builder.log
    log.imu = choose_imu(builder, candidates, flew, why, asked)

    def begin() -> int:
        return int(candidates[log.imu or 0].t_us[0]) if candidates else first_stamp()

    builder.t0_us = log.t0_us = valid_stamp(builder.read_optional("The first time stamp", begin, 0))
    log.imus = [build_imu(builder, c) for c in candidates]


def choose_imu(
    builder: LogBuilder, units: list[ImuCandidate], flew: int | None, why: str, asked: int | None
) -> int | None:
    """Return the position of the unit to replay; None and a problem if no unit can be replayed."""
    if not units:
        _report_no_unit(builder)
        return None
    wanted = flew if asked is None else asked
    named = next((k for k, unit in enumerate(units) if unit.index == wanted), None)
    if asked is not None and named is None:
        have = ", ".join(str(u.index) for u in units)
        builder.problem("imu_not_in_log", "error", f"There is no IMU {asked} in this log; it holds IMU {have}.")
        return None
    unknown = "the first in the log; nothing shows which one was used"
    position, reason = named or 0, "asked for" if asked is not None else unknown if named is None else why
    if asked is None and not is_replayable_rate(units[position].rate):
        position, reason = _faster_unit(builder, units, position) or (position, reason)
    if not _is_replayable(builder, units[position]):
        return None
    others = [p for k, other in enumerate(units) if k != position for p in other.problems if p.code == "imu_decimated"]
    builder.problems[:] = [replace(p, severity="note") if p in others else p for p in builder.problems]
    if asked is None:
        _report_wider_logging(builder, units, position)
    builder.log.choices["imu"] = as_sentence(reason)
    return position


def _report_no_unit(builder: LogBuilder) -> None:
    """Add the problem of a log without inertial data: refused, damaged, or not logged."""
    messages, remedy = builder.messages, ""
    if any(p.code in ("no_clock", *LEFT_OUT_CODES) for p in builder.problems):
        text = f"No record of the gyro and accelerometer in this log can be used. {_reason_left_out(builder)}"
    else:
        text = "This log holds no continuous gyro and accelerometer data of one unit."
        if messages.damage and 2 * messages.damage_bytes >= messages.size:
            first = messages.damage[0]
            text += f" Most of the file is damaged: {first.lost} at byte {first.offset}."
        else:
            remedy = builder.log.advice("imu")
    builder.problem("no_imu", "error", text, remedy=remedy)


def _reason_left_out(builder: LogBuilder, more_than: int = 0) -> str:
    """Return the text of the problem with the largest loss of inertial records, empty up to ``more_than``."""
    losses = [p for p in builder.problems if p.code in LEFT_OUT_CODES and p.count > more_than]
    losses = losses or [p for p in builder.problems if p.code == "unreadable_message"]
    return max(losses, key=lambda p: p.count).text if losses else ""


def _faster_unit(builder: LogBuilder, units: list[ImuCandidate], slow: int) -> tuple[int, str] | None:
    """Return position and reason of a unit that is logged fast enough, and report the slow one that flew."""
    fast = [k for k, u in enumerate(units) if is_replayable_rate(u.rate) and u.usable]
    if not fast:
        return None
    builder.problem(
        "imu_that_flew_too_slow",
        "warning",
        f"The IMU that flew ({units[slow].source}) is logged at {units[slow].rate:.1f} Hz; "
        f"{units[fast[0]].source} is replayed instead.",
        remedy=builder.log.advice("imu", units[slow].rate),
    )
    return fast[0], "the only one logged fast enough"


def _is_replayable(builder: LogBuilder, unit: ImuCandidate) -> bool:
    """Return whether a unit has enough valid samples at a sufficient rate; report a shortfall."""
    log, records, remedy = builder.log, len(unit.t_us), ""
    if records < REPLAY_MIN_SAMPLES:
        code = "imu_too_short"
        text = f"{unit.source} is too short: {records} of the {REPLAY_MIN_SAMPLES} samples that a replay needs. "
        text += _reason_left_out(builder, records)
        remedy = "" if builder.messages.damage else describe_early_end(builder.messages)
    elif unit.refused > MAX_REFUSED_SHARE:
        code = "imu_mostly_refused"
        text = f"{unit.source}: {100 * unit.refused:.0f} % of its records hold values that no sensor can give or false "
        text += f"times; what is left shows no flight. {_reason_left_out(builder)}"
    elif not is_replayable_rate(unit.rate):
        code = "imu_rate_too_low"
        text = f"{unit.source} is logged at {unit.rate:.1f} Hz; a replay needs at least {REPLAY_MIN_HZ:.0f} Hz. "
        left_out = _reason_left_out(builder, records)
        text, remedy = text + left_out, "" if left_out else log.advice("imu", unit.rate)
    else:
        if unit.rate < LOW_RATE_HZ:
            text = f"{unit.source} is logged at {unit.rate:.1f} Hz: vibration is aliased and steps are coarse."
            builder.problem("imu_low_rate", "warning", text, remedy=log.advice("fast_imu", unit.rate))
        return True
    builder.problem(code, "error", text, remedy=remedy)
    return False


def _report_wider_logging(builder: LogBuilder, units: list[ImuCandidate], position: int) -> None:
    """Warn if another unit was logged well before the replayed one begins or after it ends."""
    mine = units[position]
    first, last = int(mine.t_us[0]), int(mine.t_us[-1])
    for other in units:
        short = len(other.t_us) < REPLAY_MIN_SAMPLES
        if other is mine or short or not other.usable or not is_replayable_rate(other.rate):
            continue
        begin, end = int(other.t_us[0]), int(other.t_us[-1])
        missed = 1e-6 * (max(first - begin, 0) + max(end - last, 0))
        if missed > max(MAX_MISSED_S, MAX_MISSED_SHARE * 1e-6 * (max(end, last) - min(begin, first))):
            builder.problem(
                "imu_covers_a_part",
                "warning",
                f"{mine.source} is replayed, which was logged for {1e-6 * (last - first):.1f} s; {other.source} was "
                f"logged from {1e-6 * (begin - first):.1f} s to {1e-6 * (end - first):.1f} s on the same clock. What "
                f"happened in {missed:.1f} s of it is not in this result: --imu {other.index} replays the other.",
            )
            return


def as_sentence(reason: str) -> str:
    """Return a reason as a sentence."""
    return reason[0].upper() + reason[1:] + "."


def build_imu(builder: LogBuilder, candidate: ImuCandidate) -> Imu:
    """Return the candidate on the log's clock."""
    c, t = candidate, builder.seconds(candidate.t_us)
    gyro = Stream(t, c.gyro, "rad/s", "FRD", c.source, c.sampling, c.gyro_delay)
    acc = Stream(t, c.acc, "m/s^2", "FRD", c.acc_source or c.source, c.sampling, c.acc_delay)
    unit = Imu(c.index, gyro, acc, c.calibrated, c.filtered, c.device, None, c.dt, c.note, c.acc_device)
    if c.temperature is not None and c.temperature.shape == t.shape:
        celsius = builder.within(c.temperature, limits.TEMPERATURE, c.source)
        if np.isfinite(celsius).any():
            unit.temperature = Stream(t, celsius[:, None], "degC", "", c.source)
    return unit


def resample_vectors(t_us: Stamps, at_us: Stamps, x: Array) -> Array:
    """Interpolate x (m, 3) at ``at_us`` (m,) to ``t_us`` (n,); NaN outside and across gaps."""
    out = np.full((len(t_us), 3), np.nan)
    index = plausible_records(at_us).index
    at_us, x = np.asarray(at_us, np.int64)[index], x[index]
    if len(at_us) < 2:
        return out
    wanted = (np.asarray(t_us, np.int64) - at_us[0]).astype(np.float64)
    known = (np.asarray(at_us, np.int64) - at_us[0]).astype(np.float64)
    for axis in range(3):
        out[:, axis] = np.interp(wanted, known, x[:, axis], left=np.nan, right=np.nan)
    i = np.clip(np.searchsorted(known, wanted, side="left"), 1, len(known) - 1)
    longest = max(MAX_RESAMPLE_US, MAX_RESAMPLE_INTERVALS * float(median(np.diff(known))))
    too_wide = known[i] - known[i - 1] > longest
    out[too_wide & (wanted != known[i]) & (wanted != known[i - 1])] = np.nan
    return out


def longest_held(t_us: Stamps, units: list[int]) -> int | None:
    """Return the unit that flew longest, None without any.

    The last entry counts with the median interval.
    """
    if not units:
        return None
    intervals = np.diff(np.asarray(t_us, np.int64))
    last = int(median(intervals)) if len(intervals) else 1
    held: dict[int, int] = {}
    for unit, length in zip(units, [*intervals.tolist(), last], strict=True):
        held[unit] = held.get(unit, 0) + max(length, 1)
    return max(held, key=lambda unit: held[unit])


def drop_unpaired(candidate: ImuCandidate) -> ImuCandidate:
    """Remove samples without accelerometer value; report more than MAX_SILENT_SHARE of them."""
    known = rotation.finite_rows(candidate.acc)
    missing, n = int(np.count_nonzero(~known)), len(candidate.acc)
    if missing > MAX_SILENT_SHARE * n:
        text = f"{candidate.source}: left out {missing:,} of {counted(n, 'record')}, "
        text += f"for which {candidate.acc_source} has no value."
        candidate.problems.append(Problem("values_out_of_range", "warning", text, count=missing))
    return candidate.rows(np.flatnonzero(known))


def low_pass_delay(cutoff_hz: float | None) -> float:
    """Return the low-frequency delay in s of a second-order Butterworth low-pass, 0 if disabled."""
    return math.sqrt(2.0) / (2.0 * math.pi * cutoff_hz) if cutoff_hz and cutoff_hz > 0 else 0.0
