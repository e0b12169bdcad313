"""Faults of motors, propellers and thrust in the flight of a multirotor, by its outputs and its motion.

A controller that cannot turn the vehicle drives one motor to its ceiling and the opposite one to its floor. If the
vehicle still tips towards the driven motor, that one gives no thrust. Limits are from docs/story.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median
from attlog.core.spans import Span, between, inside, merge
from attlog.flight.drive import Esc, Geometry, MotorOutputs, row_numbers
from attlog.flight.model import FlightLog, Stream
from attlog.flight.vehicle import VehicleKind
from attlog.segments.flight_signs import true_runs
from attlog.segments.heights import height_stream
from attlog.segments.model import Segments
from attlog.story.flight_events import KILLED, LANDED, matching_texts
from attlog.story.motor_speeds import MIN_CURRENT_A, STOPPED_SHARE, currents_in, match_motors, motor_stops, speeds_in

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class DriveFault:
    """Fault of motors, thrust or control from ``t`` to ``t_end`` s.

    ``text``: a sentence whose part before the colon suffices alone. ``motor``: number from 1, None where no motor is
    named; ``position``: as "rear left". ``part``: what failed, as motor, output, thrust. ``cause``: what may have.
    ``action``: empty for the usual one of the kind.
    """

    kind: str
    part: str
    t: float
    t_end: float
    text: str
    value: float | None = None
    unit: str = ""
    motor: int | None = None
    position: str = ""
    cause: str = ""
    evidence: list[str] = field(default_factory=list)
    action: str = ""


@dataclass(frozen=True, slots=True)
class DriveStudy:
    """Faults by question, in time order, and why a question has no answer; a question in neither is sound.

    ``numbers``: the sound questions' result as a sentence.
    """

    faults: dict[str, list[DriveFault]] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    numbers: dict[str, str] = field(default_factory=dict)

    @property
    def all_faults(self) -> list[DriveFault]:
        """The faults of all questions in time order."""
        return sorted((fault for some in self.faults.values() for fault in some), key=lambda fault: fault.t)


# Time from lift-off in which ground contact disturbs, for faults of one motor and for the others.
MOTOR_MARGIN_S, MARGIN_S = 0.5, 2.0
# Time for which a vehicle without an impact is followed after it turned over.
AFTER_OVERTURN_S = 2.0
# Time before a loss of control or impact within which a fault is its cause.
CAUSE_S = 5.0


def flown_spans(segments: Segments, margin_s: float) -> list[Span]:
    """Return the flights from ``margin_s`` after lift-off, with the loss of control, up to the first impact."""
    flown = merge((s.t0, s.t1) for kind in ("airborne", "loss_of_control") for s in segments.of(kind))
    crashes = [e for e in segments.crash_events if e.is_crash]
    found = []
    for a, b in flown:
        impacts = [e.t for e in crashes if e.kind == "impact" and a <= e.t]
        over = [e.t_end + AFTER_OVERTURN_S for e in crashes if e.kind != "impact" and a <= e.t]
        end = min([b, *impacts, *(over if not impacts else [])])
        if end > a + margin_s:
            found.append((a + margin_s, end))
    return found


def first_loss(segments: Segments) -> float:
    """Return the time of the first crash event, infinity without one."""
    return min((e.t for e in segments.crash_events if e.is_crash), default=np.inf)


# --- motion ------------------------------------------------------------------------------------------------------

# Averaging of height for the climb rate.
CLIMB_MEAN_S = 1.0


@dataclass
class Motion:
    """Motion of the vehicle on demand: rates, tilt, height."""

    log: FlightLog

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        """Times (n,) s and body rates (n, 3) deg/s of the replayed or first IMU."""
        imu = self.log.replay_imu or next(iter(self.log.imus), None)
        if imu is None:
            return np.zeros(0), np.zeros((0, 3))
        t, x = imu.gyro.t_best, imu.gyro.x
        good = np.isfinite(t) & rotation.finite_rows(x)
        if not good.all():
            t, x = t[good], x[good]
        return t, np.degrees(x)

    @cached_property
    def rate_hz(self) -> float:
        """Sampling rate of the rates, 0 without any."""
        t = self.rates[0]
        return 0.0 if len(t) < 2 else 1.0 / max(float(median(np.diff(t))), 1e-9)

    def push_rate(self, lever: Array, t0: float, t1: float) -> tuple[Array, Array]:
        """Return times and the rate (n,) deg/s in the direction in which a motor pushes, from t0 to t1 s."""
        t, rate = self.rates
        part = between(t, t0, t1)
        return t[part], rate[part, :2] @ lever

    def yaw_rate(self, t0: float, t1: float) -> float:
        """Return the mean yaw rate in deg/s from t0 to t1 s, NaN without samples."""
        t, rate = self.rates
        part = between(t, t0, t1)
        return float(np.mean(rate[part, 2])) if part.stop > part.start else np.nan

    @cached_property
    def tilts(self) -> tuple[Array, Array]:
        """Times (n,) s and tilts (n,) deg of the onboard attitude, else the truth."""
        attitude = self.log.onboard_attitude or self.log.truth
        if attitude is None or len(attitude.t) < 2:
            return np.zeros(0), np.zeros(0)
        return attitude.t, np.degrees(rotation.tilt_angle(attitude.q))

    def tilt_at(self, t: Array) -> Array:
        """Return the tilt (m,) deg at times; NaN without an attitude."""
        at, tilt = self.tilts
        return np.interp(t, at, tilt) if len(at) else np.full(len(t), np.nan)

    @cached_property
    def heights(self) -> tuple[Array, Array]:
        """Times (n,) s and means over 1 s of the height (n,) m by the barometer, else another source."""
        stream = height_stream(self.log)
        if stream is None or len(stream.t) < 3:
            return np.zeros(0), np.zeros(0)
        t, x = stream.t, stream.x.reshape(len(stream.t), -1)[:, 0]
        good = np.isfinite(x) & np.concatenate([[True], np.diff(t) > 0])
        t, x = t[good], x[good]
        if len(t) < 3:
            return np.zeros(0), np.zeros(0)
        total = np.concatenate([[0.0], np.cumsum(x)])
        low = np.searchsorted(t, t - 0.5 * CLIMB_MEAN_S, side="left")
        high = np.searchsorted(t, t + 0.5 * CLIMB_MEAN_S, side="right")
        return t, (total[high] - total[low]) / (high - low)

    def height_at(self, t: float) -> float:
        """Return the height in m at a time, NaN where it is not logged."""
        at, x = self.heights
        return float(np.interp(t, at, x)) if len(at) and at[0] <= t <= at[-1] else np.nan

    def climb_at(self, t: float) -> float:
        """Return the climb rate in m/s over the second around a time."""
        at, _ = self.heights
        a, b = max(t - 0.5 * CLIMB_MEAN_S, at[0]), min(t + 0.5 * CLIMB_MEAN_S, at[-1])
        return (self.height_at(b) - self.height_at(a)) / (b - a) if b > a else np.nan


def runs_in_a_row(mask: Mask, row: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Return index ranges [a, b) of neighbouring true records without a gap between them."""
    for a, b in true_runs(mask):
        edges = [a, *(a + 1 + np.flatnonzero(np.diff(row[a:b]))).tolist(), b]
        yield from pairwise(edges)


# --- one motor without thrust ------------------------------------------------------------------------------------

# Least records and time in a row, and least rate of the outputs: for one motor, and for runs of 1.5 s and more.
MIN_RUN_RECORDS, MIN_RUN_S, MIN_OUTPUT_HZ, MIN_LONG_HZ = 3, 0.19, 4.9, 1.9
# The driven motor exceeds its opposite by this, and that one is at the floor.
MIN_DIFFERENCE, FLOOR = 0.8, (-0.05, 0.12)
MAX_START_TILT_DEG = 60.0
# Rate against the push: it falls by this, and to this.
MIN_FALL_DPS, WORSE_DPS = 100.0, -100.0
# Rate that does not answer for so long: share of samples, their limit, the least, and its greatest rise.
DEAF_S, DEAF_SHARE, DEAF_DPS, DEAF_LEAST_DPS, DEAF_RISE_DPS2 = 0.5, 0.95, 10.0, -60.0, 150.0
# Where most of the fall came before the run, within so many s: least time without an answer, longer than a motor's lag.
FALL_BEFORE_S, UNANSWERED_S = 0.3, 0.3
# Means of the side motors of a quadrotor: at the floor it is a command, both at the ceiling it is lift.
SIDE_MIN, SIDE_BELOW_CEILING = 0.15, 0.03
NO_THRUST_CAUSE = "A failed motor, propeller, ESC or connector."
# A motor that never worked since lift-off may stand elsewhere; below this height a leg may have touched the ground.
ORDER_CAUSE = "Or motor order or propellers do not match the frame type."
NEAR_GROUND_M, GROUND_CAUSE = 2.0, "Or it touched the ground and tipped over."


def motor_without_thrust(
    log: FlightLog, outputs: MotorOutputs, geometry: Geometry, motion: Motion, spans: Sequence[Span]
) -> DriveFault | None:
    """Return the first motor that gave no thrust although driven at its ceiling, with its opposite at the floor.

    Later runs do not count: past 90 deg of tilt the demand turns round.
    """
    row, mask = outputs.in_a_row(), inside(outputs.t, spans)
    found: list[tuple[float, DriveFault]] = []
    for i in range(outputs.motors):
        j = geometry.opposite(i)
        if j is None:
            continue
        x, other = outputs.x[:, i], outputs.x[:, j]
        driven = mask & (x - other >= MIN_DIFFERENCE) & (other >= FLOOR[0]) & (other <= FLOOR[1])
        for a, b in runs_in_a_row(driven, row):
            t0, t1 = float(outputs.t[a]), float(outputs.t[b - 1])
            if (
                b - a < MIN_RUN_RECORDS
                or t1 - t0 < MIN_RUN_S
                or not motion.tilt_at(np.array([t0]))[0] < MAX_START_TILT_DEG
            ):
                continue
            if outputs.motors > 4 and _mean_push(outputs.x[a:b], geometry, i) < MIN_DIFFERENCE:
                continue
            sides = [np.mean(outputs.x[a:b, k]) for k in range(outputs.motors) if k not in (i, j)]
            limit = outputs.ceiling - SIDE_BELOW_CEILING
            if outputs.motors == 4 and not all(SIDE_MIN <= side <= limit for side in sides):
                continue
            _, before = motion.push_rate(geometry.lever[i], t0 - FALL_BEFORE_S, t0)
            worst = tipping_rate(*motion.push_rate(geometry.lever[i], t0, t1 + outputs.period), before)
            if worst is not None:
                found.append((t0, _no_thrust_fault(log, outputs, geometry, motion, i, j, a, b, worst)))
                break
    return min(found, key=lambda pair: pair[0])[1] if found else None


def _mean_push(x: Array, geometry: Geometry, motor: int) -> float:
    """Return the mean roll and pitch of outputs (n, motors) along a motor's push; a yaw command of a hexa has none."""
    return float(np.nan_to_num(x).mean(axis=0) @ (geometry.lever @ geometry.lever[motor]))


def _with_other_causes(fault: DriveFault, segments: Segments, spans: Sequence[Span]) -> DriveFault:
    """Return a motor without thrust in words that also hold for other causes near lift-off and ground.

    ``spans``: flights from MOTOR_MARGIN_S after lift-off.
    """
    air, causes = segments.air, []
    if any(a <= fault.t < a - MOTOR_MARGIN_S + MARGIN_S for a, _ in spans):
        causes.append(ORDER_CAUSE)
    if air is not None and air.levels and air.levels[0].above[air.grid.index(fault.t)] < NEAR_GROUND_M:
        causes.append(GROUND_CAUSE)
    if not causes:
        return fault
    text = fault.text.replace("gave no thrust", "did not lift its side", 1)
    return replace(fault, text=text, cause=" ".join([fault.cause, *causes]))


def tipping_rate(t: Array, s: Array, before: Array) -> float | None:
    """Return the lowest rate in deg/s of a vehicle that tips towards a driven motor, None where the motor pushes.

    ``s`` (n,) deg/s at ``t`` (n,) s: positive the way the motor pushes. ``before``: the rates just before.
    """
    if len(t) < 3:
        return None
    lowest = float(s.min())
    if lowest <= WORSE_DPS and s[0] - lowest >= MIN_FALL_DPS:
        return lowest
    seconds, fell = t[-1] - t[0], float(np.max(before, initial=s[0])) - lowest
    deaf = seconds >= DEAF_S and lowest <= DEAF_LEAST_DPS
    unanswered = seconds >= UNANSWERED_S and lowest <= WORSE_DPS and fell >= MIN_FALL_DPS
    if not (deaf or unanswered) or np.mean(s <= DEAF_DPS) < DEAF_SHARE:
        return None
    return lowest if float(np.polyfit(t - t[0], s, 1)[0]) <= DEAF_RISE_DPS2 else None


def _no_thrust_fault(
    log: FlightLog,
    outputs: MotorOutputs,
    geometry: Geometry,
    motion: Motion,
    i: int,
    j: int,
    a: int,
    b: int,
    worst: float,
) -> DriveFault:
    t0, t1 = float(outputs.t[a]), float(outputs.t[b - 1])
    name = outputs.title(i)
    level, other = (100.0 * float(np.mean(outputs.x[a:b, k])) for k in (i, j))
    text = (
        f"{name.capitalize()} gave no thrust from {t0:.1f} s: at {level:.0f} % output, motor {j + 1} opposite at "
        f"{max(other, 0.0):.0f} %. It tipped towards motor {i + 1} at {-worst:.0f}°/s."
    )
    evidence = [
        f"{outputs.source}: motor {i + 1} {level:.0f} %, motor {j + 1} {max(other, 0.0):.0f} % ({t0:.1f} to {t1:.1f} s)"
    ]
    turned = motion.yaw_rate(t1 - 0.1, t1 + 0.1) - motion.yaw_rate(t0 - 0.3, t0)
    ran_away = np.isfinite(turned) and turned * geometry.spin[i] > 0
    if ran_away:
        evidence.append(f"Yaw turned by {turned:+.0f}°/s, as if motor {j + 1} ran at full speed instead")
    evidence += [f"report at {r.t:.1f} s: {r.text}" for r in outputs.reports if abs(r.t - t0) <= CAUSE_S][:2]
    cause = NO_THRUST_CAUSE + (f" Or motor {j + 1} ran at full speed uncommanded." if ran_away else "")
    where = outputs.position(i)
    return DriveFault("motor_no_thrust", "motor", t0, t1, text, round(-worst), "°/s", i + 1, where, cause, evidence)


# --- speed controllers -------------------------------------------------------------------------------------------

# Time from a driven motor without thrust, or from a stop to the loss of control, in s.
STOP_NEAR_S, STOP_TO_LOSS_S = 1.0, 3.0
# Least output of a motor that is to turn, and rise of it that shows the controller at work, over so many s before.
MIN_COMMAND, MIN_RISE, BEFORE_S = 0.1, 0.2, 1.0
# Least share of records in which every output is on.
MIN_ON_SHARE = 0.9
STOPPED_CAUSE = "The motor, its ESC or a connector: it stood still."
BLOCKED_CAUSE = "The motor stood still and drew current: it is blocked, or its ESC lost synchronisation."
PROPELLER_CAUSE = "The propeller, lost, broken or slipping: the motor turned."


def with_speed(
    fault: DriveFault, escs: Sequence[Esc], outputs: MotorOutputs, matched: Sequence[int | None]
) -> DriveFault:
    """Return a motor without thrust with what its controller measured: a standing motor or a turning one.

    Where controllers are not matched the slowest one is its own if it stopped, and no motor stopped if it turns.
    """
    speeds = speeds_in(escs, fault.t + 0.5 * (fault.t_end - fault.t), fault.t_end + STOP_NEAR_S)
    if len(escs) < 3 or not np.isfinite(speeds).all():
        return fault
    own = next((k for k, motor in enumerate(matched) if motor is not None and motor + 1 == fault.motor), None)
    least = int(np.argmin(speeds))
    if own is None:
        if len(escs) < outputs.motors:
            return fault
        stopped = speeds[least] < STOPPED_SHARE * median(np.delete(speeds, least))
        own = least if stopped else int(np.argmax(speeds))
    others = float(median(np.delete(speeds, own)))
    drawn = currents_in(escs, fault.t, fault.t_end + STOP_NEAR_S)
    ampere = f", {drawn[own]:.1f} A" if np.isfinite(drawn[own]) else ""
    line = f"{escs[own].name}: {speeds[own]:,.0f} rpm{ampere}, median of the others {others:,.0f} rpm"
    evidence = [*fault.evidence, line]
    cause = fault.cause
    if speeds[own] < STOPPED_SHARE * others:
        blocked = np.isfinite(drawn[own]) and drawn[own] >= max(MIN_CURRENT_A, median(np.delete(drawn, own)))
        cause = cause.replace(NO_THRUST_CAUSE, BLOCKED_CAUSE if blocked else STOPPED_CAUSE)
    elif speeds[own] > others:  # driven at its ceiling
        cause = cause.replace(NO_THRUST_CAUSE, PROPELLER_CAUSE)
    return replace(fault, cause=cause, evidence=evidence)


def stopped_motor(
    escs: Sequence[Esc], outputs: MotorOutputs, matched: Sequence[int | None], spans: Sequence[Span], loss: float
) -> DriveFault | None:
    """Return the first motor that stood still although driven, None without one.

    A speed of 0 alone may be telemetry: the current, the controller's response or a loss of control must confirm it.
    A motor whose output is off has to stop; a controller without known motor may be that motor's. A vehicle of four
    motors or fewer does not fly on without one.
    """
    for stop in motor_stops(escs, [(a, min(b, loss)) for a, b in spans if a < loss]):
        motor = matched[stop.esc]
        responds, level = False, np.nan
        sent = outputs.x[between(outputs.t, stop.t, stop.t_end)]
        if motor is None and not (len(sent) and (np.mean(sent > OFF, axis=0) > MIN_ON_SHARE).all()):  # NaN is off
            continue
        if motor is not None:
            x = outputs.x[:, motor]
            now, before = (x[between(outputs.t, *s)] for s in ((stop.t, stop.t_end), (stop.t - BEFORE_S, stop.t)))
            if not len(now) or not median(now) >= MIN_COMMAND:
                continue
            level = 100.0 * float(np.mean(now))
            responds = len(before) > 0 and float(np.max(now) - median(before)) >= MIN_RISE
        loses_control = loss - stop.t <= STOP_TO_LOSS_S
        if not (stop.without_current or responds or loses_control):
            continue
        if outputs.motors <= 4 and stop.t_end - stop.t > STOP_TO_LOSS_S and not loses_control:  # it flew on
            continue
        name = "A motor" if motor is None else outputs.title(motor).capitalize()
        driven = "" if motor is None else f" at {level:.0f} % output"
        text = f"{name} stopped at {stop.t:.1f} s: {escs[stop.esc].name} measured 0 rpm{driven}, the others "
        text += f"{stop.others:,.0f} rpm."
        confirmed = (
            (stop.without_current, "no current"),
            (responds, "its output rose"),
            (loses_control, f"loss of control at {loss:.1f} s"),
        )
        evidence = [f"{escs[stop.esc].name} and " + ", ".join(word for holds, word in confirmed if holds)]
        number, where = (None, "") if motor is None else (motor + 1, outputs.position(motor))
        fault = DriveFault("motor_no_thrust", "motor", stop.t, stop.t_end, text, motor=number, position=where)
        return replace(fault, cause=STOPPED_CAUSE, evidence=evidence)
    return None


# --- an output off or frozen -------------------------------------------------------------------------------------

# An output off in flight: below the floor by this for this time, while another drives.
OFF, OFF_S, OTHER_DRIVES = -0.1, 0.3, 0.35
# A frozen output: range, time, records, and the movement of another one meanwhile.
FROZEN_RANGE, FROZEN_S, FROZEN_RECORDS, OTHER_MOVES = 0.001, 0.8, 8, 0.1
# With less movement it is frozen where chance repeats the value so often in fewer than one of 1e6 flights: a motor
# seldom keeps its value while the others change theirs.
OTHER_STIRS, FROZEN_CHANCE = 0.02, 1e-6
# A frozen output lies this far within floor and ceiling.
FROZEN_MIN, FROZEN_BELOW_CEILING = 0.03, 0.02
OUTPUT_CAUSE = "The output was disabled or reassigned, or the mixer stopped."


def outputs_off(outputs: MotorOutputs, spans: Sequence[Span], loss: float) -> list[DriveFault]:
    """Return outputs that were off or frozen in flight before a loss of control, in time order."""
    row = outputs.in_a_row()
    mask = inside(outputs.t, [(a, min(b, loss)) for a, b in spans if a < loss])
    found = []
    for i in range(outputs.motors):
        others = np.delete(outputs.x, i, axis=1)
        x = outputs.x[:, i]
        if not (x > OFF).any():  # never driven in this log: no motor, or not of this vehicle
            continue
        off = ~(x > OFF) & (np.max(np.where(np.isfinite(others), others, -np.inf), axis=1) >= OTHER_DRIVES)
        for a, b in runs_in_a_row(mask & off, row):
            t0, t1 = float(outputs.t[a]), float(outputs.t[b - 1])
            if t1 - t0 >= OFF_S:
                found.append(_output_fault(outputs, "off", i, t0, t1, float(np.nanmax(x[a:b], initial=-np.inf))))
                break
        span = next(_frozen_runs(outputs, mask, row, i), None)
        if span is not None:
            a, b = span
            found.append(_output_fault(outputs, "frozen", i, float(outputs.t[a]), float(outputs.t[b - 1]), float(x[a])))
    return sorted(found, key=lambda fault: fault.t)


def _frozen_runs(outputs: MotorOutputs, mask: Mask, row: NDArray[np.int64], i: int) -> Iterator[tuple[int, int]]:
    """Return index ranges in which output ``i`` does not move and another one does.

    An output that does not move in the whole flight is none of a motor.
    """
    x, ceiling = outputs.x[:, i], outputs.ceiling
    flown = x[mask & np.isfinite(x)]
    if not len(flown) or np.ptp(flown) <= FROZEN_RANGE:
        return
    still = np.zeros(len(x), bool)
    still[1:] = np.abs(np.diff(x)) <= FROZEN_RANGE
    within = mask & (x >= FROZEN_MIN) & (x <= ceiling - FROZEN_BELOW_CEILING)
    moved = np.abs(np.diff(np.delete(outputs.x, i, axis=1), axis=0)) > FROZEN_RANGE  # NaN is not
    stirred = within.copy()  # all but one of the others changed since the record before, if at all
    stirred[1:] &= within[:-1] & (np.diff(row) == 0) & (moved.sum(axis=1) >= max(outputs.motors - 2, 1))
    for a, b in runs_in_a_row(within & still, row):
        a = max(a - 1, 0) if within[max(a - 1, 0)] and row[max(a - 1, 0)] == row[a] else a
        if b - a < FROZEN_RECORDS or outputs.t[b - 1] - outputs.t[a] < FROZEN_S or np.ptp(x[a:b]) > FROZEN_RANGE:
            continue
        most = float(np.nanmax(np.ptp(np.delete(outputs.x[a:b], i, axis=1), axis=0), initial=0.0))
        rest = stirred.copy()
        rest[a + 1 : b] = False
        keeps = (np.count_nonzero(rest & still) + 1) / (np.count_nonzero(rest) + 1)  # share of records that repeat
        chance = outputs.x.size * keeps ** np.count_nonzero(stirred[a + 1 : b])
        if most >= OTHER_MOVES or (most >= OTHER_STIRS and chance < FROZEN_CHANCE):
            yield a, b


def _output_fault(outputs: MotorOutputs, word: str, i: int, t0: float, t1: float, level: float) -> DriveFault:
    name = outputs.title(i)
    held = "" if word == "off" else f" at {100.0 * level:.0f} %"
    others = "drove" if word == "off" else "moved"
    text = f"Output of {name} {word}{held} from {t0:.1f} s: {t1 - t0:.1f} s in flight, while others {others}."
    evidence = [f"{outputs.source}.{outputs.names[i]}"]
    evidence += [
        sentence for t, sentence in outputs.changes if abs(t - t0) <= CAUSE_S and f"motor {i + 1} " in sentence
    ]
    reports = [r for r in outputs.reports if r.motor in (0, i + 1) and abs(r.t - t0) <= CAUSE_S][:2]
    evidence += [f"report at {r.t:.1f} s: {r.text}" for r in reports]
    cause = OUTPUT_CAUSE + (" Or the autopilot stopped a failed motor." if reports else "")
    value = None if word == "off" else round(100.0 * level, 1)
    unit = "" if value is None else "%"
    kind, where = f"motor_{word}", outputs.position(i)
    return DriveFault(kind, "motor output", t0, t1, text, value, unit, i + 1, where, cause, evidence)


# --- all outputs off ---------------------------------------------------------------------------------------------

# Output up to which PX4's motors stand still; ArduPilot's floor turns them, so that they stand below OFF.
PX4_STOPPED = 0.005
# Largest mean specific force of a fall in m/s^2: drag carries up to half the weight.
FALL_M_S2 = 5.0
# Time from a detected landing, or from a kill switch or disarming, to the stop of the motors.
STOPPED_S = 1.0
ALL_OFF_CAUSE = "The land detector took low thrust for a landing."
ALL_OFF_ACTION = "Compare minimum and hover throttle before the next flight."


def all_off(log: FlightLog, outputs: MotorOutputs, spans: Sequence[Span], loss: float) -> list[DriveFault]:
    """Return the stop of all motors of an armed vehicle that fell and was lost within 5 s.

    A stop by the pilot's kill switch or by disarming is none.
    """
    limit = PX4_STOPPED if log.firmware.name == "PX4" else OFF
    still = ~(outputs.x > limit).any(axis=1) & inside(outputs.t, [(a, min(b, loss)) for a, b in spans if a < loss])
    armed, killed = log.state.armed, [t for t, _, _ in matching_texts(log, KILLED)]
    for a, b in runs_in_a_row(still, outputs.in_a_row()):
        t0, t1 = float(outputs.t[a]), float(outputs.t[b - 1])
        if t1 - t0 < OFF_S or loss - t0 > CAUSE_S or any(abs(t - t0) <= STOPPED_S for t in killed):
            continue
        if (armed is not None and not armed.at(t0 + OFF_S)) or not _fell(log, t0, t1):
            continue
        landed = _detected_landing(log, t0)
        why = "" if landed is None else f": the autopilot had detected a landing at {landed:.1f} s"
        text = f"All motors were off from {t0:.1f} s in the air{why}."
        evidence = [f"{outputs.source}: no output above {100.0 * limit:.0f} %; the accelerometer shows a fall"]
        fault = DriveFault("motors_off", "motor outputs", t0, t1, text, evidence=evidence)
        return [fault if landed is None else replace(fault, cause=ALL_OFF_CAUSE, action=_landed_action(log))]
    return []


def _landed_action(log: FlightLog) -> str:
    """Return what to do about a landing that was detected in the air: PX4's minimum thrust, with its logged value."""
    least = log.param("MPC_THR_MIN")
    return ALL_OFF_ACTION if least is None else f"Set MPC_THR_MIN ({least:.2g}) well below hover thrust."


def _fell(log: FlightLog, t0: float, t1: float) -> bool:
    """Return whether the IMU with most samples shows a fall between two times."""
    parts = [imu.acc.x[between(imu.acc.t_best, t0 + 0.5 * OFF_S, t1)] for imu in log.imus]
    force = max(parts, key=len, default=np.zeros((0, 3)))
    return len(force) > 1 and float(median(np.linalg.norm(force, axis=1))) < FALL_M_S2


def _detected_landing(log: FlightLog, t: float) -> float | None:
    """Return the time of the landing that the autopilot detected just before ``t`` s, None without one."""
    line = log.state.landed
    found = [] if line is None else [float(at) for at, on in zip(line.t, line.value, strict=True) if on]
    found += [at for at, _, _ in matching_texts(log, LANDED)]
    return max((at for at in found if -OFF_S <= t - at <= STOPPED_S), default=None)


# --- no thrust left ----------------------------------------------------------------------------------------------

# Demand at its limit (0.95 in 32 bits lies below), or a motor this near its ceiling with this mean of all.
FULL_DEMAND, NEAR_CEILING, MIN_MEAN = 0.949, 0.02, 0.75
# A run goes on this far below those limits, where this share of the 2 s around reaches them: a limit is no sharp line.
NOISE, MIN_FULL_SHARE, SHARE_S = 0.03, 0.4, 2.0
MAX_FULL_TILT_DEG, MIN_FULL_S, MIN_DROP_M = 40.0, 1.5, 2.0
# A fall that is being arrested gains climb rate; a last part up to this share of the run may, as in ground contact.
MAX_GAINED_M_S, MAX_ARRESTED_SHARE = 0.3, 0.2
# Seconds of hover, and the multiple of their demand above which full throttle had thrust to spare.
HOVER_CLIMB_M_S, HOVER_TILT_DEG, MIN_HOVER_S, MAX_SPARE = 1.0, 12.0, 5, 3.0
# A motor at its ceiling for this share of the run is named, with others lower by this as the weak one.
MIN_LIMIT_SHARE, MIN_ONE_SIDED = 0.6, 0.15
WEAK_CAUSE = "A weak motor or propeller there, or a load off centre."
SPARE_THRUST = (
    "It sank {:.1f} m at full throttle from {:.1f} s, but hover takes {:.0f} %: "
    "lost thrust, sinking air or a wrong attitude."
)
HEAVY_CAUSE = "Too heavy for its motors and propellers, or the battery is weak."


def thrust_runs_out(
    outputs: MotorOutputs | None, demand: Stream | None, motion: Motion, spans: Sequence[Span]
) -> list[DriveFault]:
    """Return spans at full throttle in which the vehicle sinks all the same."""
    t = outputs.t if outputs is not None else demand.t if demand is not None else np.zeros(0)
    if not len(t) or not len(motion.heights[0]):
        return []
    near, full = (_at_limit(t, outputs, demand, noise) for noise in (NOISE, 0.0))
    total = np.concatenate([[0.0], np.cumsum(full)])
    low, high = (np.searchsorted(t, t + side * 0.5 * SHARE_S) for side in (-1.0, 1.0))
    near &= total[high] - total[low] >= MIN_FULL_SHARE * (high - low)
    near &= inside(t, spans) & ~(motion.tilt_at(t) >= MAX_FULL_TILT_DEG)
    found = []
    for a, b in runs_in_a_row(near, row_numbers(t)):
        sinks = _sinking_part(t[a:b], motion)
        drop = np.nan if sinks is None else motion.height_at(sinks[0]) - motion.height_at(sinks[1])
        if sinks is not None and sinks[1] - sinks[0] >= MIN_FULL_S and drop >= MIN_DROP_M:
            first, last = np.searchsorted(t, [sinks[0], sinks[1] + 1e-6]).tolist()
            found.append(_thrust_fault(outputs, first, last, sinks[0], sinks[1], drop))
    return found


def _hover_demand(demand: Stream | None, motion: Motion, spans: Sequence[Span]) -> float | None:
    """Return the median demand in level seconds without climb, None for too few."""
    if demand is None or len(demand.t) < 2:
        return None
    middle = np.concatenate([np.zeros(0), *(np.arange(a + 0.5, b, 1.0) for a, b in spans)])
    climb = np.array([motion.climb_at(float(x)) for x in middle])
    level = (np.abs(climb) < HOVER_CLIMB_M_S) & (motion.tilt_at(middle) < HOVER_TILT_DEG)
    if np.count_nonzero(level) < MIN_HOVER_S:
        return None
    return float(median(np.interp(middle[level], demand.t, np.nan_to_num(demand.x[:, 0]))))


def _sinking_part(t: Array, motion: Motion) -> Span | None:
    """Return the part of a run (n,) s up to its last record without a gain of climb; None for an early gain."""
    climb = np.array([motion.climb_at(float(x)) for x in t])
    kept = np.flatnonzero(climb <= climb[0] + MAX_GAINED_M_S)
    if not len(kept):
        return None
    last = float(t[kept[-1]])
    return (float(t[0]), last) if t[-1] - last <= MAX_ARRESTED_SHARE * (t[-1] - t[0]) else None


def _at_limit(t: Array, outputs: MotorOutputs | None, demand: Stream | None, noise: float) -> Mask:
    """Mark the times (n,) s at which demand or motors lie within ``noise`` of their limit."""
    full = np.zeros(len(t), bool)
    if demand is not None and len(demand.t) > 1:
        full |= np.interp(t, demand.t, np.nan_to_num(demand.x[:, 0])) >= FULL_DEMAND - noise
    if outputs is not None:
        x, ceiling = np.nan_to_num(outputs.x), outputs.ceiling
        high = x.max(axis=1) >= ceiling - NEAR_CEILING - noise
        full |= high & (x.mean(axis=1) >= (MIN_MEAN - noise) * ceiling)
    return full


def _thrust_fault(outputs: MotorOutputs | None, a: int, b: int, t0: float, t1: float, drop: float) -> DriveFault:
    first, then, motor, cause, evidence = "", "", None, HEAVY_CAUSE, []
    if outputs is not None:
        x = np.nan_to_num(outputs.x[a:b])  # NaN is off
        share = np.mean(x >= outputs.ceiling - NEAR_CEILING, axis=0)
        level = 100.0 * np.mean(x, axis=0) / outputs.ceiling
        evidence = [f"{outputs.source}: " + ", ".join(f"motor {k + 1} {v:.0f} %" for k, v in enumerate(level))]
        evidence += [
            f"report at {r.t:.1f} s: {r.text}" for r in outputs.reports if t0 - CAUSE_S <= r.t <= t1 + CAUSE_S
        ][:2]
        k = int(np.argmax(share))
        rest = float(np.mean(np.delete(level, k)))
        if share[k] >= MIN_LIMIT_SHARE and level[k] - rest >= 100.0 * MIN_ONE_SIDED:
            motor, cause = k + 1, WEAK_CAUSE
            first, then = f", {outputs.title(k)} at its limit", f" The others were at {rest:.0f} %."
        else:
            then = f" All motors were at {np.mean(level):.0f} % of their limit."
    text = f"No thrust reserve from {t0:.1f} s{first}: it sank {drop:.1f} m in {t1 - t0:.1f} s at full throttle.{then}"
    where = "" if outputs is None or motor is None else outputs.position(motor - 1)
    return DriveFault("no_thrust_left", "thrust", t0, t1, text, round(drop, 1), "m", motor, where, cause, evidence)


# --- yaw answers backwards ---------------------------------------------------------------------------------------

MIN_YAW_DEMAND, MIN_YAW_S, MAX_YAW_TILT_DEG, MIN_AGAINST_DPS = 0.4, 3.0, 45.0, 15.0
YAW_CAUSE = "Propellers or motor order do not match the frame type."


def yaw_backwards(outputs: MotorOutputs, geometry: Geometry, motion: Motion, spans: Sequence[Span]) -> list[DriveFault]:
    """Return spans in which the vehicle turns against the commanded yaw torque."""
    x = np.nan_to_num(outputs.x)
    spin = geometry.spin
    if not ((spin > 0).any() and (spin < 0).any()):
        return []
    torque = x[:, spin > 0].mean(axis=1) - x[:, spin < 0].mean(axis=1)  # of counter-clockwise propellers: to the right
    calm = inside(outputs.t, spans) & ~(motion.tilt_at(outputs.t) >= MAX_YAW_TILT_DEG)
    found = []
    for sign in (1.0, -1.0):
        for a, b in runs_in_a_row(calm & (sign * torque >= MIN_YAW_DEMAND), outputs.in_a_row()):
            t0, t1 = float(outputs.t[a]), float(outputs.t[b - 1])
            if t1 - t0 < MIN_YAW_S:
                continue
            turned = motion.yaw_rate(t0, t1)
            if -sign * turned >= MIN_AGAINST_DPS:
                to, from_ = ("right", "left") if sign > 0 else ("left", "right")
                how = f"motors pushed {to}, it turned {from_} at {abs(turned):.0f}°/s"
                text = f"Yaw response was reversed from {t0:.1f} s: {how}."
                evidence = [f"{outputs.source}: mean of + less - spins {float(np.mean(torque[a:b])):+.2f}"]
                size = round(abs(turned), 1)
                fault = DriveFault("yaw_backwards", "propellers", t0, t1, text, size, "°/s")
                found.append(replace(fault, cause=YAW_CAUSE, evidence=evidence))
    return sorted(found, key=lambda fault: fault.t)


# --- all ---------------------------------------------------------------------------------------------------------

QUESTIONS = ("motor_thrust", "motor_outputs", "thrust_reserve", "yaw_response")
NO_OUTPUTS = "No usable motor outputs are logged (RCOU, actuator_motors, actuator_outputs or SERVO_OUTPUT_RAW)."
NO_FLIGHT_OUTPUTS = "No motor outputs are logged in flight."
SHORT_FLIGHT = f"The flight is shorter than {MARGIN_S:.0f} s."
NO_ATTITUDE = "No attitude is logged."
TOO_SLOW = "{} logged at {:.1f} Hz; 2 Hz is needed."
NO_GEOMETRY = "The positions of the motors are unknown: the log holds no parameters of a known frame."


@cached_per_log
def study_motors(log: FlightLog, segments: Segments) -> DriveStudy:
    """Return the faults of motors and thrust in the flights of a multirotor; nothing for other vehicles."""
    if log.kind is not VehicleKind.MULTIROTOR:
        return DriveStudy()
    spans, margins = flown_spans(segments, MOTOR_MARGIN_S), flown_spans(segments, MARGIN_S)
    if "airborne" in segments.unknown:
        return DriveStudy(missing=dict.fromkeys(QUESTIONS, "Nothing in the log shows whether it flew."))
    if not spans:
        return DriveStudy()
    study, motion, outputs = DriveStudy(), Motion(log), log.power.outputs
    _judge_thrust(log, study, motion, margins)
    if outputs is None:
        study.missing.update({q: NO_OUTPUTS for q in QUESTIONS if q != "thrust_reserve"})
        return study
    if not _is_logged(outputs.t, spans):
        study.missing.update({q: NO_FLIGHT_OUTPUTS for q in QUESTIONS if q != "thrust_reserve"})
        return study
    rate = 1.0 / outputs.period
    slow, hz = rate < MIN_OUTPUT_HZ, f"Motor outputs are logged at {rate:.1f} Hz; 5 Hz is needed."
    px4 = log.firmware.name == "PX4"
    wanted = "PWM_MIN and PWM_MAX" if px4 else "MOT_PWM_MIN and MOT_PWM_MAX, or RC3_MIN and RC3_MAX"
    unscaled = f"The log holds no output limits: {wanted}."
    if not outputs.scaled:
        study.missing.update({q: unscaled for q in QUESTIONS if q != "thrust_reserve"})
    else:
        loss = first_loss(segments)
        off = [*all_off(log, outputs, spans, loss), *outputs_off(outputs, spans, loss)]
        if slow and not off:
            study.missing["motor_outputs"] = hz
        else:
            study.faults["motor_outputs"] = sorted(off, key=lambda fault: fault.t)
        geometry = outputs.geometry
        for question in ("motor_thrust", "yaw_response"):
            if geometry is None:
                study.missing[question] = NO_GEOMETRY
            elif slow and question == "motor_thrust":
                study.missing[question] = hz
            elif rate < MIN_LONG_HZ:
                study.missing[question] = TOO_SLOW.format("Motor outputs are", rate)
            elif not len(motion.rates[0]):
                study.missing[question] = "No gyro is logged."
            elif not len(motion.tilts[0]):
                study.missing[question] = NO_ATTITUDE
            elif not margins and question == "yaw_response":
                study.missing[question] = SHORT_FLIGHT
        escs = log.power.escs
        before = [(a, min(b, loss)) for a, b in spans if a < loss]
        matched = match_motors(escs, outputs, before)
        stopped = stopped_motor(escs, outputs, matched, spans, loss)
        one = None
        if geometry is not None and "motor_thrust" not in study.missing:
            one = motor_without_thrust(log, outputs, geometry, motion, spans)
            study.faults["motor_thrust"] = []
        if one is not None:
            study.faults["motor_thrust"] = [
                with_speed(_with_other_causes(one, segments, spans), escs, outputs, matched)
            ]
        elif stopped is not None:
            study.missing.pop("motor_thrust", None)
            study.faults["motor_thrust"] = [stopped]
        if geometry is not None and "yaw_response" not in study.missing:
            # A quadrotor that lost a motor turns against its yaw torque.
            lost = min(
                (f.t for q in ("motor_thrust", "motor_outputs") for f in study.faults.get(q, ())), default=np.inf
            )
            sound = [(a, min(b, lost)) for a, b in margins if a < lost]
            study.faults["yaw_response"] = yaw_backwards(outputs, geometry, motion, sound)
    return study


def _is_logged(t: Array, spans: Sequence[Span]) -> bool:
    """Return whether records at ``t`` (n,) s lie in the flights."""
    return bool(np.count_nonzero(inside(t, spans)) >= MIN_RUN_RECORDS)


def _judge_thrust(log: FlightLog, study: DriveStudy, motion: Motion, spans: Sequence[Span]) -> None:
    outputs, demand = log.power.outputs, log.power.throttle
    outputs = outputs if outputs is not None and _is_logged(outputs.t, spans) else None
    demand = demand if demand is not None and _is_logged(demand.t, spans) else None
    rates = [1.0 / float(median(np.diff(x.t))) for x in (outputs, demand) if x is not None]
    outputs = outputs if outputs is not None and 1.0 / outputs.period >= MIN_LONG_HZ else None
    if not spans:
        study.missing["thrust_reserve"] = SHORT_FLIGHT
    elif not rates:
        study.missing["thrust_reserve"] = "Neither throttle nor motor outputs are logged in flight."
    elif max(rates) < MIN_LONG_HZ:
        study.missing["thrust_reserve"] = TOO_SLOW.format("Throttle and motor outputs are", max(rates))
    elif not len(motion.heights[0]):
        study.missing["thrust_reserve"] = "No height is logged."
    elif not len(motion.tilts[0]):
        study.missing["thrust_reserve"] = NO_ATTITUDE
    else:
        found = thrust_runs_out(outputs, demand, motion, spans)
        hover = _hover_demand(demand, motion, spans) if found else None
        if hover is not None and hover * MAX_SPARE < FULL_DEMAND:
            drop, t = found[0].value, found[0].t
            study.missing["thrust_reserve"] = SPARE_THRUST.format(drop, t, 100.0 * hover)
        else:
            study.faults["thrust_reserve"] = found
