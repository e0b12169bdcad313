"""Inertial units: candidates from several messages, the best per unit, and the one to replay."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.timestamps import Stamps, plausible_records
from attlog.flight import limits
from attlog.flight.advice import LoggingAdvice
from attlog.flight.builder import LogBuilder, finite_within
from attlog.flight.model import Array, Imu, Problem, Stream, logged_rate

REPLAY_MIN_SAMPLES = 20
"""Fewer samples are no flight."""
REPLAY_MIN_HZ = 10.0
"""Below this no attitude can be replayed: rotation between samples is lost."""
MIN_NONZERO_SHARE = 0.01
"""A unit with fewer records that are not zero was never read (a simulator or driver that fills it with zeros)."""
REFUSED_CODES = ("values_out_of_range", "time_backward", "false_times", "rate_impossible")
IMPLAUSIBLE_MOTION = (
    f"where gyro or accelerometer are missing or outside what a sensor can give ({limits.GYRO.limits}, "
    f"{limits.ACC.limits})"
)
LEFT_OUT_CODES = (*REFUSED_CODES, "duplicate_times", "unset_times", "imu_all_zero", "unreadable_message")
"""Why records that are in the log cannot be replayed."""
MAX_SILENT_SHARE = 0.05
"""Of the samples of one sensor so many may have none of the other beside them before it is told."""
MAX_REPEATED_SHARE = 0.9
"""Two tasks may log each record, and a message may repeat a slower one; where so many repeat a stamp or have none, the
stamps are no clock."""
MIN_COVERED_SHARE = 0.02
"""A message that covers less than this of the time that another one of the same unit covers is not preferred to it."""
MAX_REFUSED_SHARE = 0.5
"""A unit of which more records than this are refused shows no motion with the few that are left."""
MAX_MISSED_S, MAX_MISSED_SHARE = 5.0, 0.05
"""What another unit saw beyond the one that is replayed is told where it is longer than both of these."""
LOW_RATE_HZ = 45.0
"""Below the 50 Hz of a default log vibration is aliased and lags carry a low-rate mark."""


def is_replayable_rate(rate: float) -> bool:
    """Whether a replay can be made of so many samples a second: judged as sentences show it, 9.96 Hz are 10.0."""
    return round(rate, 1) >= REPLAY_MIN_HZ


@dataclass(slots=True)
class ImuCandidate:
    """Gyro (n, 3) rad/s and specific force (n, 3) m/s^2 of one unit from one message, stamps in us.

    ``rank`` is the place in the preference order of the firmware, 0 best. ``usable`` is
    False where the source is too slow for what it is. ``refused`` is the part of its
    records that hold values that no sensor gives, or false times.
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
        """From the first record to the last."""
        return 1e-6 * float(self.t_us[-1] - self.t_us[0]) if len(self.t_us) else 0.0

    def rows(self, index: NDArray[np.int64]) -> ImuCandidate:
        """The same source with the selected samples only, given by rising ``index`` (m,)."""
        if len(index) == len(self.t_us):
            return self
        self.t_us, self.gyro, self.acc = self.t_us[index], self.gyro[index], self.acc[index]
        self.temperature = None if self.temperature is None else self.temperature[index]
        self.dt = None if self.dt is None else self.dt[index]
        return self


def validate_candidate(builder: LogBuilder, candidate: ImuCandidate) -> ImuCandidate | None:
    """The candidate with plausible stamps and physical values only, None if nothing is left.

    What is left out is noted with the candidate and told only if it is chosen.
    """
    own = LogBuilder(builder.messages)
    if candidate.gyro.shape[1:] != (3,) or candidate.acc.shape[1:] != (3,):
        text, count = f"{candidate.source} does not hold three axes.", len(candidate.t_us)
        builder.problem("unreadable_message", "warning", text, count=count)
        return None
    good = finite_within(candidate.gyro, limits.GYRO.high) & finite_within(candidate.acc, limits.ACC.high)
    index = own.keep(candidate.t_us, candidate.source, good, wrong=IMPLAUSIBLE_MOTION, fastest_hz=candidate.fastest_hz)
    candidate.problems += own.problems
    wrong = sum(p.count for p in own.problems if p.code in REFUSED_CODES)
    alike = sum(p.count for p in own.problems if p.code in ("duplicate_times", "unset_times"))
    wrong += alike if alike > MAX_REPEATED_SHARE * len(candidate.t_us) else 0
    candidate.refused = wrong / max(len(candidate.t_us), 1)
    measured = np.zeros(len(index), bool)
    for column in (*candidate.gyro.T, *candidate.acc.T):
        measured |= column[index] != 0
    if len(index) and np.mean(measured) < MIN_NONZERO_SHARE:
        text = f"{candidate.source}: its gyro and accelerometer values are zero; this unit is not used."
        builder.problem("imu_all_zero", "warning", text, count=len(index))
        return None
    if len(index):
        return candidate.rows(index)
    builder.problems += candidate.problems
    return None


def validate_candidates(builder: LogBuilder, found: list[ImuCandidate]) -> list[ImuCandidate]:
    """Every candidate that :func:`validate` leaves something of."""
    clean = [builder.attempt(c.source, partial(validate_candidate, builder, c), None) for c in found]
    return [c for c in clean if c is not None]


def best_per_unit(builder: LogBuilder, candidates: list[ImuCandidate]) -> list[ImuCandidate]:
    """One candidate per unit: the best rank among usable ones, else the fastest. Its problems are told.

    Where none is usable those of all are told: a better message may be in the log, and useless.
    """
    chosen = []
    for index in sorted({c.index for c in candidates}):
        mine = [c for c in candidates if c.index == index]
        usable = [c for c in mine if c.usable and is_replayable_rate(c.rate)]
        longest = max((c.seconds for c in usable), default=0.0)
        usable = [c for c in usable if c.seconds >= MIN_COVERED_SHARE * longest]
        chosen.append(min(usable, key=lambda c: c.rank) if usable else max(mine, key=lambda c: c.rate))
        for told in [chosen[-1]] if usable else mine:
            builder.problems += told.problems
    return chosen


def _left_out(builder: LogBuilder, more_than: int = 0) -> str:
    """What the most gyro and accelerometer records of this log were left out for; empty where that were not more.

    Called before anything else of the flight is read.
    """
    losses = [p for p in builder.problems if p.code in LEFT_OUT_CODES and p.count > more_than]
    losses = losses or [p for p in builder.problems if p.code == "unreadable_message"]
    return max(losses, key=lambda p: p.count).text if losses else ""


def _unreadable(builder: LogBuilder) -> str:
    """Where most of a file is damaged, the first place; no setting would have logged more that can be read."""
    log = builder.messages
    if not log.damage or 2 * log.damage_bytes < log.size:
        return ""
    return f"Most of the file is damaged: {log.damage[0].lost} at byte {log.damage[0].offset}."


def choose_imu(
    builder: LogBuilder,
    units: list[ImuCandidate],
    flew: int | None,
    why: str,
    asked: int | None,
    logging: LoggingAdvice,
) -> int | None:
    """Position of the unit to replay in ``units``, None (and a problem) where none can be.

    ``flew`` is the index of the unit that the autopilot used, ``asked`` what the user
    wants; ``logging`` knows the settings that would log more.
    """
    if not units:
        refused = any(p.code in ("no_clock", *LEFT_OUT_CODES) for p in builder.problems)
        text = (
            f"No record of the gyro and accelerometer in this log can be used. {_left_out(builder)}"
            if refused
            else "This log holds no continuous gyro and accelerometer data of one unit. "
            + (_unreadable(builder) or logging.advice("imu"))
        )
        builder.problem("no_imu", "error", text)
        return None
    wanted, reason = _asked_unit(builder, units, asked) if asked is not None else _flown_unit(units, flew, why)
    if wanted is None:
        return None
    if asked is None and not is_replayable_rate(units[wanted].rate):
        wanted, reason = _faster_unit(builder, units, wanted, logging) or (wanted, reason)
    if not _replayable(builder, units[wanted], logging):
        return None
    beside = [p for k, other in enumerate(units) if k != wanted for p in other.problems if p.code == "imu_decimated"]
    builder.problems = [replace(p, severity="note") if p in beside else p for p in builder.problems]
    if asked is None:
        _report_wider_logging(builder, units, wanted)
    builder.choices["imu"] = as_sentence(reason)
    return wanted


def _asked_unit(builder: LogBuilder, units: list[ImuCandidate], asked: int) -> tuple[int | None, str]:
    """Position of the unit that the user asked for, None (and a problem) where the log does not hold it; the reason."""
    named = [k for k, u in enumerate(units) if u.index == asked]
    if not named:
        have = ", ".join(str(u.index) for u in units)
        builder.problem("imu_not_in_log", "error", f"There is no IMU {asked} in this log; it holds IMU {have}.")
    return (named[0] if named else None), "asked for"


def _flown_unit(units: list[ImuCandidate], flew: int | None, why: str) -> tuple[int | None, str]:
    """Position of the unit that flew, else of the first, and why it is the one."""
    used = [k for k, u in enumerate(units) if u.index == flew]
    return (used[0], why) if used else (0, "the first in the log; nothing shows which one was used")


def _faster_unit(
    builder: LogBuilder, units: list[ImuCandidate], slow: int, logging: LoggingAdvice
) -> tuple[int, str] | None:
    """Position of a unit that is logged fast enough where the one that flew is not, and why; None without one."""
    fast = [k for k, u in enumerate(units) if is_replayable_rate(u.rate) and u.usable]
    if not fast:
        return None
    builder.problem(
        "imu_that_flew_too_slow",
        "warning",
        f"The IMU that flew ({units[slow].source}) is logged at {units[slow].rate:.1f} Hz; "
        f"{units[fast[0]].source} is replayed instead. {logging.advice('imu', units[slow].rate)}",
    )
    return fast[0], "the only one logged fast enough"


def _replayable(builder: LogBuilder, unit: ImuCandidate, logging: LoggingAdvice) -> bool:
    """Whether a unit has enough good samples at a sufficient rate; a problem says what it lacks."""
    if len(unit.t_us) < REPLAY_MIN_SAMPLES:
        builder.problem(
            "imu_too_short",
            "error",
            f"{unit.source} is too short: {len(unit.t_us)} of the {REPLAY_MIN_SAMPLES} samples that a replay needs. "
            f"{_left_out(builder, len(unit.t_us))}",
        )
        return False
    if unit.refused > MAX_REFUSED_SHARE:
        builder.problem(
            "imu_mostly_refused",
            "error",
            f"{unit.source}: {100 * unit.refused:.0f} % of its records hold values that no sensor can give or false "
            f"times; what is left shows no flight. {_left_out(builder)}",
        )
        return False
    if not is_replayable_rate(unit.rate):
        builder.problem(
            "imu_rate_too_low",
            "error",
            f"{unit.source} is logged at {unit.rate:.1f} Hz; a replay needs at least {REPLAY_MIN_HZ:.0f} Hz. "
            f"{_left_out(builder, len(unit.t_us)) or logging.advice('imu', unit.rate)}",
        )
        return False
    if unit.rate < LOW_RATE_HZ:
        builder.problem(
            "imu_low_rate",
            "warning",
            f"{unit.source} is logged at {unit.rate:.1f} Hz: vibration is aliased and steps are coarse. "
            f"{logging.advice('fast_imu', unit.rate)}",
        )
    return True


def _report_wider_logging(builder: LogBuilder, units: list[ImuCandidate], wanted: int) -> None:
    """A warning where another unit was logged before the one to replay begins, or after it ends."""
    mine = units[wanted]
    first, last = int(mine.t_us[0]), int(mine.t_us[-1])
    for other in units:
        if (
            other is mine
            or not other.usable
            or not is_replayable_rate(other.rate)
            or len(other.t_us) < REPLAY_MIN_SAMPLES
        ):
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
    """A reason as a sentence."""
    return reason[0].upper() + reason[1:] + "."


def build_imu(builder: LogBuilder, candidate: ImuCandidate) -> Imu:
    """The candidate as a part of the flight log; call it when t = 0 is known."""
    t = builder.seconds(candidate.t_us)
    unit = Imu(
        candidate.index,
        Stream(t, candidate.gyro, "rad/s", "FRD", candidate.source, candidate.sampling, candidate.gyro_delay),
        Stream(
            t,
            candidate.acc,
            "m/s^2",
            "FRD",
            candidate.acc_source or candidate.source,
            candidate.sampling,
            candidate.acc_delay,
        ),
        candidate.calibrated,
        candidate.filtered,
        candidate.device,
        None,
        candidate.dt,
        candidate.note,
        candidate.acc_device,
    )
    if candidate.temperature is not None and candidate.temperature.shape == t.shape:
        celsius = builder.within(candidate.temperature, limits.TEMPERATURE, candidate.source)
        if np.isfinite(celsius).any():
            unit.temperature = Stream(t, celsius[:, None], "degC", "", candidate.source)
    return unit


def resample_vectors(t_us: Stamps, at_us: Stamps, x: Array) -> Array:
    """x (m, 3) at ``at_us`` (m,) interpolated to ``t_us`` (n,); NaN outside and across gaps of 20 ms or 5 intervals."""
    out = np.full((len(t_us), 3), np.nan)
    index = plausible_records(at_us).index
    at_us, x = np.asarray(at_us, np.int64)[index], x[index]
    if len(at_us) < 2:
        return out
    rel = (np.asarray(t_us, np.int64) - at_us[0]).astype(np.float64)
    base = (np.asarray(at_us, np.int64) - at_us[0]).astype(np.float64)
    for axis in range(3):
        out[:, axis] = np.interp(rel, base, x[:, axis], left=np.nan, right=np.nan)
    i = np.clip(np.searchsorted(base, rel, side="left"), 1, len(base) - 1)
    too_wide = base[i] - base[i - 1] > max(20e3, 5 * float(np.median(np.diff(base))))
    out[too_wide & (rel != base[i]) & (rel != base[i - 1])] = np.nan
    return out


def longest_held(t_us: Stamps, units: list[int]) -> int | None:
    """The unit that flew for the longest time (the last one as long as the median of the others), None without."""
    if not units:
        return None
    lengths: list[int] = np.diff(np.asarray(t_us, np.int64)).tolist()
    lengths.append(int(np.median(lengths)) if lengths else 1)
    held: dict[int, int] = {}
    for unit, length in zip(units, lengths, strict=True):
        held[unit] = held.get(unit, 0) + max(length, 1)
    return max(held, key=lambda u: held[u])


def drop_unpaired(candidate: ImuCandidate) -> ImuCandidate:
    """The candidate without the samples for which the other sensor had no value to interpolate.

    More than a few at the ends, where one sensor was logged before the other, are told.
    """
    known = rotation.finite_rows(candidate.acc)
    missing, n = int(np.count_nonzero(~known)), len(candidate.acc)
    if missing > MAX_SILENT_SHARE * n:
        text = (
            f"{candidate.source}: left out {missing:,} of {n:,} records, for which {candidate.acc_source} has no value."
        )
        candidate.problems.append(Problem("values_out_of_range", "warning", text, count=missing))
    return candidate.rows(np.flatnonzero(known))


def low_pass_delay(cutoff_hz: float | None) -> float:
    """Delay in s of a second-order low-pass (Butterworth) at low frequency: sqrt(2) / (2 pi f); 0 where it is off."""
    return math.sqrt(2.0) / (2.0 * math.pi * cutoff_hz) if cutoff_hz and cutoff_hz > 0 else 0.0
