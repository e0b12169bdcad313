"""Checks of IMU rate, gaps and jitter, clocks, frozen sensors, and sensor faults."""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from attlog.core import rotation
from attlog.core.sorting import median, quantile
from attlog.core.spans import Span, inside, intersect, seconds
from attlog.core.timestamps import gap_indices
from attlog.flight import compass
from attlog.flight.frozen import equal_runs, turned_deg
from attlog.flight.imu import LOW_RATE_HZ, REPLAY_MIN_HZ, is_replayable_rate
from attlog.flight.model import FIX_3D, Array, FlightLog, Imu, Stream
from attlog.health.check import Check, HealthCase, Verdict, as_sentence, graded, unknown
from attlog.health.regression import robust_fit
from attlog.reference.sensor_faults import FRAME, GYRO, IRON, LATE
from attlog.segments import model
from attlog.segments.flight_signs import true_runs
from attlog.segments.model import Segments
from attlog.segments.rest import flag_spans

# Minimum rate for verdict ok: rotation between samples is small enough for every estimator.
FULL_HZ = 95.0
RATE_LIMIT = "ok from 95, replay from 10"
# Minimum pause of the logger; minimum pause where arming is not logged; margin to flight.
PAUSE_S, LONG_PAUSE_S, FLIGHT_MARGIN_S = 2.0, 5.0, 1.0
# Minimum pause where arming is not logged and LOG_DISARMED 0 stops the logger.
UNLOGGED_PAUSE_S = 1.0
LINK_CAUSE = "The radio link lost packets."
LINK_JITTER_CAUSE = "The radio link delayed or lost packets, or the autopilot sent them unevenly."
# Maximum delay of a pause after disarming, and maximum armed share within it.
ARMED_MARGIN_S, ARMED_SHARE = 1.0, 0.1
# Limits: number and share of time of gaps for verdict ok, share for a fault.
FEW_GAPS, FEW_GAPS_PCT, MANY_GAPS_PCT = 3, 1.0, 20.0
GAP_LIMIT = f"ok: fewer than {FEW_GAPS} above 50 ms while armed, and {FEW_GAPS_PCT:.0f} % of the time; "
GAP_LIMIT += f"fault: above {MANY_GAPS_PCT:.0f} %"
# Limits (warning, fault) of the relative standard deviation of intervals; typical loggers have 10 %.
JITTER_PCT = (15.0, 60.0)


def timing_checks(case: HealthCase) -> list[Check]:
    """Check rate, gaps and jitter of the IMU in use."""
    log = case.log
    if not log.imus:
        return [Check("rate", "fault", "There is no usable gyro and accelerometer data.", 0.0, "Hz", ">= 10 Hz")]
    imu = log.imus[log.imu or 0]
    t, source = imu.gyro.t, imu.gyro.source
    if len(t) < 3:
        return [Check("rate", "fault", f"{source}: too short, {len(t)} of 3 samples.", 0.0, "Hz", ">= 10 Hz")]
    breaks = gap_indices(t) - 1
    found = [rate_check(source, imu.gyro.rate), gap_check(t, breaks, log, case.segments)]
    # Decimated IMU data is already reported.
    thinned = any(p.code == "imu_decimated" and p.source == source for p in log.problems)
    if thinned:
        return found
    jitter = jitter_check(np.delete(np.diff(t), breaks))
    if jitter.is_trouble and log.settings.kind == "telemetry":
        jitter.cause = LINK_JITTER_CAUSE
    return [*found, jitter]


def rate_check(source: str, rate: float) -> Check:
    """Check whether the IMU is logged fast enough."""
    verdict: Verdict = "warning"
    if rate >= FULL_HZ:
        verdict, what = "ok", "fast enough for every figure"
    elif not is_replayable_rate(rate):
        verdict, what = "fault", f"too slow for a replay, which needs {REPLAY_MIN_HZ:.0f} Hz"
    elif rate < LOW_RATE_HZ:
        what = "usable, but vibration is aliased"
    else:
        what = "usable; lags are coarser than at 100 Hz and more"
    return Check("rate", verdict, f"{source}: {rate:.1f} Hz, {what}.", round(rate, 2), "Hz", RATE_LIMIT)


def gap_check(t: np.ndarray, breaks: np.ndarray, log: FlightLog, segments: Segments) -> Check:
    """Check for gaps in IMU times (n,) s; ``breaks``: indices before gaps.

    Gaps between disarming and arming, or long ones on the ground, are pauses of the logger.
    """
    made = partial(Check, "gaps", unit="s", threshold=GAP_LIMIT)
    if len(breaks) == 0:
        return made("ok", "No gap in the inertial data.", value=0.0)
    begin, end = t[breaks], t[breaks + 1]
    paused = np.array([is_pause(a, b, log, segments) for a, b in zip(begin.tolist(), end.tolist(), strict=True)])
    rest = f"The logger paused {'once' if paused.sum() == 1 else f'{paused.sum()} times'} on the ground, "
    rest += f"{float((end - begin)[paused].sum()):.0f} s in all."
    if paused.all():
        return made("ok", rest, value=0.0)
    lost = (end - begin)[~paused]
    total = float(lost.sum())
    share = 100.0 * total / float(t[-1] - t[0])
    rate = 1.0 / float(median(np.diff(t)))
    if log.settings.kind == "telemetry" and not is_replayable_rate(rate):
        why = f"Telemetry at {rate:.0f} Hz: slow messages and lost packets look alike ({share:.0f} % of the time)."
        return unknown("gaps", why, GAP_LIMIT)
    text = f"{len(lost)} gap{'s' if len(lost) > 1 else ''} in the inertial data, {total:.2f} s in all ({share:.1f} %)"
    text += f", of {median(lost):.2f} s (median), the longest {lost.max():.2f} s" if len(lost) > 1 else ""
    few = len(lost) < FEW_GAPS and share < FEW_GAPS_PCT
    verdict: Verdict = "ok" if few else "fault" if share > MANY_GAPS_PCT else "warning"
    check = made(verdict, f"{text}.", value=round(total, 2), t=float(begin[~paused][0]), count=len(lost))
    check.evidence = [rest] if paused.any() else []
    onboard, others = log.onboard_attitude, 0
    if onboard is not None and onboard.rate > 0:  # gaps in which it is logged do not come from the logger
        there = np.searchsorted(onboard.t, end[~paused]) - np.searchsorted(onboard.t, begin[~paused])
        others = int(np.count_nonzero(there >= np.maximum(2.0, 0.5 * onboard.rate * lost)))
    if log.settings.kind == "telemetry":
        check.cause = LINK_CAUSE
    elif others:
        check.evidence.append(f"{log.onboard} goes on in {others} of them.")
        check.cause = "The IMU, its driver or the rate of its messages: others go on in the gaps."
    elif float(lost.max()) > LONG_PAUSE_S:
        check.about = "stopped"
    return check


def is_pause(t0: float, t1: float, log: FlightLog, segments: Segments) -> bool:
    """Return whether a gap is a pause: disarmed, or without logged arming long enough.

    A long gap without flight at either end also counts, because the record of disarming is often lost.
    """
    if log.state.armed is None or not log.state.armed.value:
        return t1 - t0 > (UNLOGGED_PAUSE_S if log.param("LOG_DISARMED") == 0 else LONG_PAUSE_S)
    flown = any(a < t1 + FLIGHT_MARGIN_S and t0 - FLIGHT_MARGIN_S < b for a, b in segments.spans("airborne"))
    if t1 - t0 > LONG_PAUSE_S and "airborne" not in segments.unknown and not flown:
        return True
    armed = sum(b - a for a, b in flag_spans(log.state.armed, True, t0, t1))
    return t1 - t0 > PAUSE_S and armed < ARMED_SHARE * (t1 - t0) + ARMED_MARGIN_S


def jitter_check(dt: np.ndarray) -> Check:
    """Check the standard deviation of the sample intervals."""
    jitter = 100.0 * float(dt.std() / median(dt)) if median(dt) > 0 else float("inf")
    text = f"Intervals {median(dt) * 1e3:.2f} ms, standard deviation {jitter:.1f} %."
    limit = f"ok up to {JITTER_PCT[0]:.0f} %, fault above {JITTER_PCT[1]:.0f} %"
    return Check("jitter", graded(jitter, *JITTER_PCT), text, round(jitter, 2), "%", limit)


# Clocks: Universal Time and ArduPilot's main loop against the log's own.

# Least time and largest scatter of Universal Time by GNSS.
MIN_UTC_S, MAX_UTC_SCATTER_S = 30.0, 0.05
# Smallest error of a clock that counts. GNSS messages are up to 0.1 s late at either end; crystals are within 1e-4.
CLOCK_OFF, UTC_LATE_S = 0.002, 0.1
# Smallest error of the main loop that is reported, and the largest that is one.
LOOP_OFF, MAX_LOOP_OFF = 0.02, 0.12
CLOCK_LIMIT = f"ok within {100 * CLOCK_OFF:.1f} % of Universal Time"
LOOP_LIMIT = f"ok up to {100 * LOOP_OFF:.0f} % slow"
# Least records, and least blocks of dates.
MIN_RECORDS, MIN_DATES = 60, 6
# Intervals at which ArduPilot's main loop logs the IMU, and the range about the median of those that count.
NOMINAL_S, USUAL_SHARE = (0.01, 0.02, 0.04, 0.1), 0.15


class ClockRate(NamedTuple):
    """Seconds of another clock in a second of the log's, over ``seconds``.

    ``by``: its source. ``interval_ms``: nominal interval of IMU records by the main loop's schedule.
    """

    rate: float
    seconds: float
    by: str
    interval_ms: float = 0.0


def is_clock_off(utc: ClockRate) -> bool:
    """Return whether a log's clock differs from Universal Time by more than late messages explain."""
    return abs(utc.rate - 1.0) > max(CLOCK_OFF, UTC_LATE_S / utc.seconds)


def utc_rate(log: FlightLog) -> ClockRate | None:
    """Return Universal Time per logged second by the receiver with the longest record; None for simulated time."""
    found: list[ClockRate] = []
    if log.simulated or log.settings.kind == "telemetry":
        return None
    for receiver in log.gnss:
        if receiver.utc_us is None:
            continue
        t = receiver.t if receiver.received is None else receiver.received
        good = (receiver.utc_us > 0) & (receiver.fix >= FIX_3D) & np.isfinite(t)
        t, utc = t[good], receiver.utc_us[good]
        if len(t) < MIN_DATES or t[-1] - t[0] < MIN_UTC_S:
            continue
        utc = 1e-6 * (utc - utc[0])
        fresh = np.append(True, np.diff(utc) > 0.0)
        t, utc = t[fresh], utc[fresh]
        fit = robust_fit(t, np.column_stack([t - t.mean(), np.ones(len(t))])[:, None, :], (utc - t)[:, None])
        if fit is not None and fit.scatter <= MAX_UTC_SCATTER_S and len(t) >= MIN_DATES:
            found.append(ClockRate(1.0 + float(fit.x[0]), float(t[-1] - t[0]), receiver.source))
    return max(found, key=lambda one: one.seconds, default=None)


def loop_rate(log: FlightLog, imu: Imu) -> ClockRate | None:
    """Return the nominal interval over the mean one of a DataFlash log's IMU, which the main loop times."""
    if log.firmware.name != "ArduPilot" or log.simulated or log.settings.kind == "telemetry":
        return None
    dt = np.diff(imu.gyro.t)
    if len(dt) < MIN_RECORDS:
        return None
    usual = float(median(dt))
    near = dt[np.abs(dt - usual) <= USUAL_SHARE * usual]
    if usual <= 0.0 or len(near) < MIN_RECORDS:
        return None
    mean = float(near.mean())
    nominal = min(NOMINAL_S, key=lambda s: abs(math.log(s / mean)))
    return ClockRate(nominal / mean, float(near.sum()), "main loop", 1e3 * nominal)


def clock_check(utc: ClockRate | None, loop: ClockRate | None) -> Check:
    """Check the log's clock against Universal Time, else against a main loop that would run too fast."""
    if utc is not None:
        off = utc.rate - 1.0
        check = Check("log_clock", "ok", "", unit="%", threshold=CLOCK_LIMIT, seconds=round(utc.seconds, 1))
        check.value, check.sensor = round(-100.0 * off, 3), utc.by
        check.text = f"The log's clock agrees with Universal Time within {max(100 * abs(off), 0.01):.2f} %."
        if is_clock_off(utc):
            check.verdict = "fault"
            check.text = f"The log's clock runs {100 * abs(off):.2f} % {'slow' if off > 0 else 'fast'}: "
            check.text += f"{utc.rate:.4f} s of Universal Time pass in a logged second."
            check.action = f"Multiply durations of this log by {utc.rate:.4f}, and divide rates of change by it."
            check.why_no_setting = "No parameter sets the autopilot's clock."
        return check
    if loop is not None and LOOP_OFF < loop.rate - 1.0 <= MAX_LOOP_OFF:
        text = f"IMU records come every {loop.interval_ms / loop.rate:.1f} ms instead of {loop.interval_ms:.0f}: "
        text += f"the log's clock seems {100 * (loop.rate - 1.0):.0f} % slow."
        return Check("log_clock", "warning", text, round(100.0 * (1.0 - loop.rate), 2), "%", CLOCK_LIMIT)
    why = f"No steady GNSS time of {MIN_UTC_S:.0f} s with a fix, logged aboard a real vehicle."
    return unknown("log_clock", why, CLOCK_LIMIT)


def loop_check(log: FlightLog, imu: Imu, loop: ClockRate, slowed: list[str]) -> Check:
    """Check the rate of the main loop by the interval of IMU records.

    ``slowed``: sentences on an onboard attitude that turns as much less than the gyro.
    """
    if abs(loop.rate - 1.0) > MAX_LOOP_OFF:
        return unknown("main_loop", "The interval of IMU records fits no usual rate of the main loop.", LOOP_LIMIT)
    off = loop.rate - 1.0
    nominal = log.param("SCHED_LOOP_RATE")
    text = f"IMU records come every {loop.interval_ms / loop.rate:.1f} ms"
    text += f" instead of {loop.interval_ms:.0f}: the main loop is not slow." if off > LOOP_OFF else ", as they should."
    check = Check("main_loop", "ok", text, round(100.0 * off, 2), "%", LOOP_LIMIT, sensor=imu.gyro.source)
    if off < -LOOP_OFF:
        at = f" at {nominal * loop.rate:.0f} of {nominal:.0f} Hz" if isinstance(nominal, int | float) else ""
        check.text = f"The main loop runs {100 * abs(off):.1f} % slow{at}: "
        check.text += f"IMU records come every {loop.interval_ms / loop.rate:.1f} ms instead of {loop.interval_ms:.0f}."
        check.evidence, check.verdict = slowed, "fault" if slowed else "warning"
        check.action = "Reduce the processor load: log less, use fewer sensors, or lower the loop rate."
    return check


# Processor: long main loops, load and memory in flight.

# Share of long main loops that ArduPilot's documentation calls the limit.
MAX_LONG_PCT = 15.0
# PX4's limits in % where COM_CPU_MAX and COM_RAM_MAX are not logged: the default of the former, and the use of memory
# from which earlier firmware shows an overload; the time above COM_CPU_MAX after which PX4 does not arm.
MAX_LOAD_PCT, MAX_MEMORY_PCT, OVERLOADED_S = 95.0, 99.0, 2.0
# MAVLink's limit of SYS_STATUS.load.
MAX_LOOP_LOAD_PCT = 100.0
PROCESSOR_LIMIT = "note: 15 % long main loops (ArduPilot); COM_CPU_MAX for 2 s, COM_RAM_MAX (PX4)"
PROCESSOR_SOURCE = "ardupilot.org, Diagnosing problems using Logs; docs.px4.io, COM_CPU_MAX, COM_RAM_MAX"
PROCESSOR_ACTION = "Reduce the processor load: log less, use fewer sensors and filters, or lower the loop rate."


def processor_checks(case: HealthCase) -> list[Check]:
    """Check the processor's load in flight; nothing without a flight or a record."""
    log, flights = case.log, case.segments.spans("airborne")
    logged = [s for s in (log.processor.loops, log.processor.load, log.processor.memory) if s is not None]
    if not logged or not flights:
        return []
    loops, load, memory = (
        _flown_rows(s, flights) for s in (log.processor.loops, log.processor.load, log.processor.memory)
    )
    if not any(map(len, (loops, load, memory))):
        return [unknown("processor", f"No record of {logged[0].source} lies in flight.", PROCESSOR_LIMIT)]
    check = Check("processor", "ok", "", unit="%", threshold=PROCESSOR_LIMIT, source=PROCESSOR_SOURCE)
    check.sensor, check.action = logged[0].source, ""
    parts, over = [], False
    if len(loops):
        long, every, slowest = float(loops[:, 1].sum()), float(loops[:, 2].sum()), float(loops[:, 3].max())
        share = 100.0 * long / max(every, 1.0)
        check.value, check.n, over = round(share, 1), len(loops), share > MAX_LONG_PCT
        parts.append(f"{share:.1f} % of main loops took too long in flight, the slowest {1e3 * slowest:.1f} ms")
    if len(load):
        middle, most = 100.0 * float(median(load[:, 1])), 100.0 * float(load[:, 1].max())
        check.value = round(middle, 1) if check.value is None else check.value
        over |= is_overloaded(log, load)
        parts.append(f"processor load {middle:.0f} %, at most {most:.0f} %")
    if len(memory):
        used, limit = 100.0 * float(memory[:, 1].max()), _limit(log, "COM_RAM_MAX", MAX_MEMORY_PCT)
        over |= used > limit
        parts.append(f"memory {used:.0f} %")
    check.text = as_sentence("; ".join(parts))
    if over:
        check.verdict, check.action = "warning", PROCESSOR_ACTION
    return [check]


def is_overloaded(log: FlightLog, load: Array) -> bool:
    """Return whether the load (n, 2) of times and shares exceeds the firmware's limit.

    ArduPilot has none for its own log: 1 is a full loop. PX4's holds for 2 s.
    """
    if log.firmware.name != "PX4":
        return log.settings.kind == "telemetry" and bool((100.0 * load[:, 1] >= MAX_LOOP_LOAD_PCT).any())
    above = 100.0 * load[:, 1] > _limit(log, "COM_CPU_MAX", MAX_LOAD_PCT)
    return any(load[b - 1, 0] - load[a, 0] >= OVERLOADED_S for a, b in true_runs(above))


def _limit(log: FlightLog, name: str, usual: float) -> float:
    """Return a limit in % by its parameter, the usual one where it is not logged or switched off."""
    value = log.param(name)
    return value if value is not None and value > 0.0 else usual


def _flown_rows(stream: Stream | None, flights: list[Span]) -> Array:
    """Return times and values (n, 1 + k) of the records whose whole interval lies in flight."""
    if stream is None or len(stream.t) < 2:
        return np.zeros((0, 2))
    period = float(median(np.diff(stream.t)))
    mask = inside(stream.t, [(a + period, b) for a, b in flights if b - a > period])
    rows: Array = np.column_stack([stream.t, stream.x])[mask]
    return rows[np.isfinite(rows).all(axis=1)]


# Frozen sensors: constant values while the vehicle moves, from a stopped sensor, driver or bus.

# Minimum duration of constant values. IMU noise changes every sample, barometer noise most samples; a compass with 1 mG
# resolution may be constant for some time.
FROZEN_IMU_S, FROZEN_MAG_S, FROZEN_BARO_S = 1.0, 5.0, 5.0
# Minimum number of equal records.
MIN_FROZEN_RECORDS = 20
# Evidence of motion: standard deviation of the gyro, rotation of attitude or field, or climb by GNSS. Vibration is no
# evidence: engines run on the ground.
MOVING_DPS, TURNED_DEG, CLIMBED_M = 3.0, 5.0, 10.0
# Maximum share of the log with a frozen gyro for a replay.
UNUSABLE_PCT = 5.0
FROZEN_LIMIT = f"ok: no value stays for {FROZEN_IMU_S:.0f} s (compass {FROZEN_MAG_S:.0f} s, "
FROZEN_LIMIT += f"barometer {FROZEN_BARO_S:.0f} s) while the vehicle moves"
DOWN = np.array([0.0, 0.0, 1.0])


def frozen_checks(case: HealthCase) -> list[Check]:
    """Check gyro, and other sensors together, for constant values in motion."""
    log, imu = case.log, case.log.replay_imu
    if imu is None:
        return []
    gyro, lost = _frozen_gyro(log)
    acc = [s for s in frozen_spans(imu.acc, FROZEN_IMU_S) if np.degrees(_spread(imu.gyro, s)) >= MOVING_DPS]
    mag, baro = frozen_compass(log), _frozen_barometer(log, case.segments)
    others = {
        f"{source}: {_frozen_text(sensor, spans)}": spans
        for sensor, source, spans in (
            ("accelerometer", imu.acc.source, acc),
            ("compass", log.mags[log.mag or 0].field.source if mag else "", mag),
            ("barometer", log.baro[0].source if baro else "", baro),
        )
        if spans
    }
    spans = [*acc, *mag, *baro]
    text = f"{imu.gyro.source}: {_frozen_text('gyro', gyro)}." if gyro else "The gyro never freezes in motion."
    first = Check("frozen_gyro", "fault" if gyro else "ok", text, round(lost, 1), "%", FROZEN_LIMIT)
    text = f"{'; '.join(others)}." if others else "No other sensor freezes while the vehicle moves."
    verdict: Verdict = "fault" if acc else "warning" if others else "ok"
    longest = max((b - a for a, b in spans), default=0.0)
    second = Check("frozen_sensors", verdict, text, round(longest, 1), "s", FROZEN_LIMIT)
    for check, stopped in ((first, gyro), (second, spans)):
        if stopped:
            check.t, check.count = min(a for a, _ in stopped), len(stopped)
    return [first, second]


def _frozen_gyro(log: FlightLog) -> tuple[list[Span], float]:
    """Return spans with a frozen gyro while the vehicle turned, and their share of the log in %."""
    imu = log.replay_imu
    if imu is None:
        return [], 0.0
    stopped = [s for s in frozen_spans(imu.gyro, FROZEN_IMU_S) if _turned_deg(log, s) >= TURNED_DEG]
    return stopped, 100.0 * seconds(stopped) / max(log.seconds, 1e-9)


def frozen_gyro_reason(log: FlightLog) -> str:
    """Return why a frozen gyro makes a replay invalid; empty where valid."""
    _, lost = _frozen_gyro(log)
    return f"the gyro is frozen for {lost:.0f} % of the record while the vehicle moves" if lost > UNUSABLE_PCT else ""


def frozen_spans(stream: Stream, least_s: float) -> list[Span]:
    """Return spans (t0, t1) s of at least ``least_s`` with constant finite values."""
    if len(stream.t) < MIN_FROZEN_RECORDS:
        return []
    x = stream.x.reshape(len(stream.t), -1)
    t, x = model.select_good(rotation.finite_rows(x), stream.t, x)
    return [(float(t[a]), float(t[b - 1])) for a, b in equal_runs(t, x, MIN_FROZEN_RECORDS, least_s)]


def frozen_compass(log: FlightLog) -> list[Span]:
    """Return spans with a frozen compass in use while the gyro turned; not dead ones."""
    imu = log.replay_imu
    if log.mag is None or imu is None:
        return []
    frozen = frozen_spans(log.mags[log.mag].field, FROZEN_MAG_S)
    return [s for s in frozen if turned_deg(imu.gyro, *s) > compass.MIN_TURN_DEG]


def _frozen_barometer(log: FlightLog, segments: Segments) -> list[Span]:
    """Return spans with a frozen first barometer in a climb.

    Not in a hover, where simulated barometers without noise may be constant.
    """
    if not log.baro:
        return []
    found = []
    for span in intersect(frozen_spans(log.baro[0], FROZEN_BARO_S), segments.spans("airborne")):
        heights = [g.alt[slice(*np.searchsorted(g.t, span))] for g in log.gnss]
        known = [h[np.isfinite(h)] for h in heights]
        if any(len(h) and np.ptp(h) >= CLIMBED_M for h in known):
            found.append(span)
    return found


def _turned_deg(log: FlightLog, span: Span) -> float:
    """Return the 80th percentile in deg of the angle of down to its median in a span.

    Without attitude, of the magnetic field. A quantile, because an alignment at the start is no turn.
    """
    attitude = log.onboard_attitude
    if attitude is not None:
        x = rotation.rotate_inverse(attitude.q[slice(*np.searchsorted(attitude.t, span))], DOWN)
    elif log.mag is not None:
        field = log.mags[log.mag].field
        x = field.x[slice(*np.searchsorted(field.t, span))]
        x = x[rotation.finite_rows(x)]
    else:
        return 0.0
    middle = median(x, axis=0) if len(x) else np.zeros(3)
    size = np.sqrt(np.sum(x**2, axis=1) * np.sum(middle**2))
    if len(x) < MIN_FROZEN_RECORDS or not size.all():
        return 0.0
    return float(np.degrees(quantile(np.arccos(np.clip(x @ middle / size, -1.0, 1.0)), 0.8)))


def _spread(stream: Stream, span: Span) -> float:
    """Return the largest standard deviation of any axis in a span."""
    first, last = np.searchsorted(stream.t, span)
    inside: Array = stream.x[first:last]
    return float(np.nanmax(np.std(inside, axis=0), initial=0.0)) if len(inside) > 1 else 0.0


def _frozen_text(what: str, spans: list[Span]) -> str:
    if len(spans) == 1:
        return f"the {what} is frozen from {spans[0][0]:.1f} s to {spans[0][1]:.1f} s while the vehicle moves"
    return f"the {what} is frozen {len(spans)} times, {seconds(spans):.1f} s in all, while the vehicle moves"


# Sensor faults found during the choice of the reference.

SENSOR_FAULT_LIMITS = {
    GYRO: "ok: fewer than 5 samples 20 times further from their neighbours than usual; fault above 20 deg/min of them",
    IRON: "ok: the dip is within 25 deg of the earth's",
    FRAME: "ok: the dip by the accelerometer's level is within 25 deg of the earth's, or both levels are off; and in "
    "flight no other axes fit twice as well, no offset above 1.7 m/s^2",
    LATE: "ok: no time shift of the accelerometer fits the GNSS velocity nine times better (squared)",
}


def sensor_fault_checks(case: HealthCase) -> list[Check]:
    """Return a check for each sensor fault found with the reference."""
    faults = {} if case.rates is None else case.rates.faults.sensors
    return [
        Check(
            name.replace(" ", "_"),
            "fault" if fault.misleads else "warning",
            as_sentence(fault.why),
            fault.value,
            fault.unit,
            SENSOR_FAULT_LIMITS[name],
            t=fault.t,
            count=fault.count,
        )
        for name, fault in faults.items()
        if name in SENSOR_FAULT_LIMITS
    ]
