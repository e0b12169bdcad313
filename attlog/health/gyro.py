"""Gyro: dead, range, bias at rest and in flight, and steps of the bias; its scale: :mod:`attlog.health.gyro_scale`.

Steps of the bias are found best by the likelihood of a smoother with GNSS, else by the mean rates of truth or of the
onboard attitude minus the gyro's over intervals.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.kinematics import body_rates
from attlog.core.sorting import median
from attlog.core.spans import between
from attlog.flight.model import Array, FlightLog, Imu
from attlog.health.check import Check, HealthCase, Verdict, graded, unknown
from attlog.health.flown import before_crashes, flight_spans, still_spans
from attlog.health.imu import SensorBias, axes_text, dead_reason, smoothed_gyro_bias, stream_blocks, usable_imus
from attlog.health.imu_checks import difference_in_flight
from attlog.health.regression import BLOCK_S, RobustFit, interval_text, robust_fit
from attlog.health.timing import frozen_gyro_reason
from attlog.reference.model import GyroJump, Reference
from attlog.segments import increments
from attlog.segments.model import Segments

# Interval of mean rates: short against turns, long enough that noise, vibration and delays do not lower the slope (0.98
# at 0.1 s, 1.00 here, for gyros with correct scale). Maximum interval, and maximum rotation in it.
INTERVAL_S, MAX_INTERVAL_S, MAX_INTERVAL_RAD = 0.3, 0.7, 1.0
# Minimum intervals and flight time.
MIN_INTERVALS, MIN_FLIGHT_S = 60, 20.0
# Limits of a bias step: estimators absorb the first unnoticed, the second not within a flight.
STEP_DPS, STEP_FAR_DPS = 0.5, 3.0
# Significance of a step; 6 sigma because the best of many times is selected.
STEP_SIGMAS, STEP_FLOOR_DPS = 6.0, 0.03
# Minimum blocks of 5 s before and after a step.
STEP_BLOCKS = 3
STEP_LIMIT = f"ok: no step above {STEP_DPS} deg/s and {STEP_SIGMAS:.0f} sigma; fault above {STEP_FAR_DPS:.0f} deg/s"


def step_checks(case: HealthCase) -> list[Check]:
    """Check steps of the bias of the replayed gyro in flight."""
    imu = case.log.replay_imu
    if imu is None or not case.segments.spans("airborne"):
        return []
    if case.reference is not None and case.reference.gyro_jumps is not None:
        step = _smoother_step_check(imu, case.reference.gyro_jumps)
    else:
        step = _reference_step_check(imu, case.segments, case.rates)
    step.sensor = imu.gyro.source
    if step.is_trouble:
        step.why_no_setting, step.action = NO_BIAS_SETTING, case.log.remedy("bus")
    return [step]


def _reference_step_check(imu: Imu, segments: Segments, reference: Reference | None) -> Check:
    """Check for a bias step by the rates of an attitude."""
    why = "No attitude that is not made of this gyro can be trusted."
    if reference is not None and reference.kind in ("truth", "onboard") and not reference.faults.gyro:
        t, g, a = interval_rates(imu, reference)
        use = segments.mask(t, "airborne") & (t < reference.scoring.end)
        t, g, a = t[use], g[use], a[use]
        if len(t) >= MIN_INTERVALS and len(t) * INTERVAL_S >= MIN_FLIGHT_S:
            columns = np.concatenate([g, np.ones((len(g), 1))], axis=1)
            found = [robust_fit(t, columns[:, None, :], a[:, k : k + 1]) for k in range(3)]
            return _step_check(imu, reference, t, columns, a, found)
        why = f"{len(t)} intervals of {INTERVAL_S} s in flight can be compared; "
        why += f"{MIN_INTERVALS} and {MIN_FLIGHT_S:.0f} s are needed."
    return unknown("gyro_bias_step", why, STEP_LIMIT)


def interval_rates(imu: Imu, reference: Reference) -> tuple[Array, Array, Array]:
    """Return begin (n,) s and mean rates (n, 3) rad/s of gyro and attitude.

    Over intervals without gaps and resets.
    """
    if len(reference.t) < 3 or len(imu.gyro.t) < 3 or reference.rate <= 0:
        return np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
    step = max(1, round(INTERVAL_S * reference.rate))
    rates = body_rates(reference.t, reference.q, reference.segment, step, step, MAX_INTERVAL_S)
    gyro = increments.gyro_increments(imu).mean_rates(rates.start, rates.end)
    good = rotation.finite_rows(gyro) & (rates.start >= reference.scoring.start)
    good &= rotation.length(gyro) * (rates.end - rates.start) < MAX_INTERVAL_RAD
    return rates.start[good], gyro[good], rates.rate[good]


def _smoother_step_check(imu: Imu, jumps: tuple[GyroJump, ...]) -> Check:
    """Check the bias steps that the smoother found by likelihood."""
    if not jumps:
        text = f"The smoother finds no step of the bias of {imu.gyro.source}."
        return Check("gyro_bias_step", "ok", text, threshold=STEP_LIMIT)
    jump = jumps[0]
    axis = int(np.argmax(np.abs(jump.size_dps)))
    size, sigma = jump.size_dps[axis], math.hypot(jump.sigma_dps[axis], STEP_FLOOR_DPS)
    return _step_found(imu, size, sigma, axis, jump.t, "by the smoother, which models it")


def _step_found(imu: Imu, size: float, sigma: float, axis: int, t: float, by: str) -> Check:
    """Return the check of a bias step in deg/s about an axis at ``t`` s."""
    text = f"The bias of {imu.gyro.source} steps by {size:+.2f} deg/s about {'xyz'[axis]} "
    text += f"({interval_text(size, sigma, 2)}, 95 %) at {t:.0f} s {by}."
    verdict = graded(abs(size), STEP_DPS, STEP_FAR_DPS)
    check = Check("gyro_bias_step", verdict, text, unit="deg/s", threshold=STEP_LIMIT, t=round(t, 1))
    return check.measure(size, sigma, 2)


def _step_check(
    imu: Imu, reference: Reference, t: Array, columns: Array, a: Array, found: list[RobustFit | None]
) -> Check:
    """Check the most significant bias step between two parts of the flight.

    About z only truth is used: a compass pulls an onboard heading by degrees per second, as a bias does.
    """
    solved = [one for one in found if one is not None]
    if len(solved) < 3:
        return unknown("gyro_bias_step", "The flight turns too little about one axis.", STEP_LIMIT)
    left = np.degrees(columns @ np.column_stack([one.x for one in solved]) - a)
    numbers, begin = np.unique((t // BLOCK_S).astype(np.int64), return_index=True)
    bias = np.array([median(part, axis=0) for part in np.split(left, begin[1:])])
    if len(bias) < 2 * STEP_BLOCKS:
        why = f"{len(bias)} blocks of {BLOCK_S:.0f} s; {2 * STEP_BLOCKS} are needed."
        return unknown("gyro_bias_step", why, STEP_LIMIT)
    size, sigma, axis, at = largest_step(bias if reference.kind == "truth" else bias[:, :2])
    if abs(size) <= max(STEP_DPS, STEP_SIGMAS * sigma):
        text = f"The bias of {imu.gyro.source} steps by less than {max(STEP_DPS, abs(size)):.1f} deg/s about "
        text += f"{'x, y and z' if reference.kind == 'truth' else 'x and y'} in flight."
        return Check("gyro_bias_step", "ok", text, round(size, 2), "deg/s", STEP_LIMIT)
    when = _step_time(t, left[:, axis], float(numbers[at]) * BLOCK_S)
    check = _step_found(imu, size, sigma, axis, when, f"against {reference.source}")
    check.n, check.seconds = len(t), round(len(t) * INTERVAL_S, 1)
    return check


def largest_step(bias: Array) -> tuple[float, float, int, int]:
    """Return size, error, axis and first block of the most significant step.

    ``bias`` (n, axes): block means. Size is the difference of medians before and after. The scatter is from neighbour
    differences, which one step hardly changes.
    """
    scatter = 1.4826 * median(np.abs(np.diff(bias, axis=0)), axis=0) / math.sqrt(2.0)
    n, found = len(bias), []
    parts = np.arange(STEP_BLOCKS, n - STEP_BLOCKS + 1)
    for axis, x in enumerate(bias.T):
        # The part of the variance that one step at each block explains.
        explained = np.cumsum(x - x.mean())[STEP_BLOCKS - 1 : n - STEP_BLOCKS] ** 2 / (parts * (n - parts))
        at = int(parts[np.argmax(explained)])
        sigma = math.hypot(1.25 * float(scatter[axis]) * math.sqrt(1.0 / at + 1.0 / (n - at)), STEP_FLOOR_DPS)
        found.append((float(median(x[at:]) - median(x[:at])), sigma, axis, at))
    return max(found, key=lambda one: abs(one[0]) / one[1])


def _step_time(t: Array, left: Array, near: float) -> float:
    """Return the time near ``near`` s at which the residual's mean changes most."""
    around: NDArray[np.int64] = np.flatnonzero(np.abs(t - near) <= 2.0 * BLOCK_S)
    if len(around) < 8:
        return near
    x = left[around] - left[around].mean()
    k = int(np.argmax(np.abs(np.cumsum(x)[2:-3]))) + 2
    return float(t[around[k + 1]])


# Dead sensor, range, and bias at rest and in flight.

# Bias limits in deg/s (warning, fault); estimators learn such biases within seconds.
BIAS_DPS = (1.0, 3.0)
BIAS_SOURCE = "what estimators learn within seconds"
# Bias above which a comparison of filters is meaningless.
UNUSABLE_DPS = 10.0
# Resolution of the gyro in old logs.
BIAS_FLOOR_DPS = 0.01
BIAS_LIMIT = f"ok up to {BIAS_DPS[0]:.0f} deg/s, fault above {BIAS_DPS[1]:.0f} deg/s; the same for its change"
# Significance of a bias change from rest to flight, in joint sigmas.
CHANGE_SIGMAS = 4.0
# Minimum samples at rest for a median.
MIN_REST_SAMPLES = 10
NO_BIAS_SETTING = "Gyro offsets are measured while the vehicle stands still, not in a log."
STAND_ADVICE = "Log 10 s standing still before take-off."
# Ranges of autopilot gyros; 2000 deg/s is the usual one.
RANGES_DPS = (125.0, 250.0, 500.0, 1000.0, 2000.0)
RANGE_LIMIT = "warning from 1999 deg/s, or where it stays at 125, 250, 500 or 1000 deg/s: the range of the sensor"
# Relative tolerance of a sample at the end of the range.
AT_LIMIT = 0.0005
# Minimum consecutive samples at the end of a smaller range.
FLAT_SAMPLES = 3


def gyro_checks(case: HealthCase) -> list[Check]:
    """Check whether the gyro in use is dead, else its range."""
    log = case.log
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    if why := dead_reason(imu.gyro.x, imu.gyro.source, "gyro"):
        return [Check("gyro_dead", "fault", why, threshold="every axis must change", sensor=imu.gyro.source)]
    whole = before_crashes(case.segments, imu.gyro.t)
    rates = np.degrees(np.abs(imu.gyro.x[whole] if whole.any() else imu.gyro.x).max(axis=1))
    peak, clipped = float(rates.max()), count_at_limit(rates)
    samples = "1 sample is" if clipped == 1 else f"{clipped} samples are"
    text = f"Largest rate {peak:.0f} deg/s" + (f"; {samples} at the sensor's limit." if clipped else ".")
    verdict: Verdict = "warning" if clipped else "ok"
    return [Check("gyro_range", verdict, text, round(peak, 1), "deg/s", RANGE_LIMIT, sensor=imu.gyro.source)]


def count_at_limit(rate: Array) -> int:
    """Count the rates (n,) deg/s at the end of the sensor's range: flat at a known range, or beyond all."""
    peak = float(rate.max(initial=0.0))
    if peak >= RANGES_DPS[-1] * (1.0 - AT_LIMIT):
        return int((rate >= RANGES_DPS[-1] * (1.0 - AT_LIMIT)).sum())
    for full in RANGES_DPS[:-1]:
        if abs(peak / full - 1.0) <= AT_LIMIT:
            there = rate >= full * (1.0 - AT_LIMIT)
            in_a_row = np.convolve(there, np.ones(FLAT_SAMPLES, int), "valid").max(initial=0) >= FLAT_SAMPLES
            return int(there.sum()) if in_a_row else 0
    return 0


def gyro_bias_checks(case: HealthCase) -> list[Check]:
    """Check the bias of each gyro at rest and in flight."""
    units = usable_imus(case)
    found = [one for imu in units if (one := _bias_check(case, imu)) is not None]
    imu = case.log.imus[case.log.imu or 0] if case.log.imus else None
    if imu is None or dead_reason(imu.gyro.x, "", "") or imu.gyro.source in {check.sensor for check in found}:
        return found
    short = _rest_bias(imu, case.segments)
    if short is None:
        why = "The vehicle never stands still in this log, and no smoother estimates the bias in flight."
        short = unknown("gyro_bias", why, BIAS_LIMIT)
        short.action = STAND_ADVICE
    short.sensor, short.source = imu.gyro.source, BIAS_SOURCE
    return [short, *found]


def unusable_gyro(log: FlightLog, segments: Segments, reference: Reference) -> str:
    """Return why a gyro is unusable for a comparison of filters; empty where usable."""
    imu = log.replay_imu
    if reference.faults.gyro:
        return f"{reference.faults.gyro[0].lower()}{reference.faults.gyro[1:].rstrip('.')}"
    rest = None if imu is None else _rest_bias(imu, segments)
    if rest is not None and rest.value is not None and abs(rest.value) >= UNUSABLE_DPS:
        return f"the gyro reads {rest.value:.0f} deg/s while the vehicle stands still"
    return frozen_gyro_reason(log)


def _rest_bias(imu: Imu, segments: Segments) -> Check | None:
    """Check the median rate at rest, else idling, and its change between rests."""
    for kind, where in (("rest", "Standing still"), ("idle", "On the ground with motors on")):
        mask = segments.mask(imu.gyro.t, kind) & rotation.finite_rows(imu.gyro.x)
        if mask.sum() < MIN_REST_SAMPLES:
            continue
        x, y, z = (float(v) for v in np.degrees(median(imu.gyro.x[mask], axis=0)))
        largest = max(x, y, z, key=abs)
        text = f"{where} the gyro reads {x:.2f}, {y:.2f}, {z:.2f} deg/s about x, y, z."
        verdict = graded(abs(largest), *BIAS_DPS)
        moved = _moved_bias(imu, segments) if kind == "rest" and verdict != "fault" else None
        return moved or Check("gyro_bias", verdict, text, round(largest, 3), "deg/s", BIAS_LIMIT)
    return None


def _moved_bias(imu: Imu, segments: Segments) -> Check | None:
    """Check for a bias change between rests, hidden in their common median."""
    good = rotation.finite_rows(imu.gyro.x)
    t, x = imu.gyro.t[good], imu.gyro.x[good]
    rests = [(a, b, x[between(t, a, b)]) for a, b in segments.spans("rest")]
    known = [(a, b, np.degrees(median(x, axis=0))) for a, b, x in rests if len(x) >= MIN_REST_SAMPLES]
    if len(known) < 2:
        return None
    readings = np.array([x for _, _, x in known])
    axis = int(np.argmax(np.ptp(readings, axis=0)))
    low, high = sorted((int(np.argmin(readings[:, axis])), int(np.argmax(readings[:, axis]))))
    change = float(np.ptp(readings[:, axis]))
    if change <= BIAS_DPS[0]:
        return None
    before, after = (", ".join(f"{v:.2f}" for v in readings[k]) for k in (low, high))
    text = (
        f"Standing still the gyro reads {before} deg/s about x, y, z until {known[low][1]:.0f} s, and {after} from "
        f"{known[high][0]:.0f} s on: its bias moved by {change:.2f} deg/s about {'xyz'[axis]}."
    )
    largest = float(readings.ravel()[np.argmax(np.abs(readings))])
    verdict = graded(max(change, abs(largest)), *BIAS_DPS)
    return Check("gyro_bias", verdict, text, round(largest, 3), "deg/s", BIAS_LIMIT, t=known[high][0])


def _bias_check(case: HealthCase, imu: Imu) -> Check | None:
    """Check the bias of one gyro at rest, else in flight; None where unknown."""
    spans, where = still_spans(case.segments)
    rest, air = stream_blocks(imu.gyro, spans), _bias_in_flight(case, imu)
    if rest is not None and 1.96 * float(np.degrees(rest.sigma(0.0).max())) > BIAS_DPS[0]:
        rest = None
    if rest is not None:
        mean, sigma = np.degrees(rest.middle), np.degrees(rest.sigma(np.radians(BIAS_FLOOR_DPS)))
        n, seconds = rest.samples, rest.seconds
    elif air is not None:
        mean, sigma, n, seconds, where = air.mean, air.sigma, air.n, air.seconds, "in flight"
    else:
        return None
    largest = int(np.argmax(np.abs(mean)))
    change = 0.0
    if rest is not None and air is not None:
        moved = np.abs(air.mean - np.degrees(rest.middle))
        sure = moved > CHANGE_SIGMAS * np.hypot(air.sigma, np.degrees(rest.sigma(0.0)))
        change = float(np.max(np.where(sure, moved, 0.0)))
    verdict = graded(max(float(np.abs(mean).max()), change), *BIAS_DPS)
    text = f"{imu.gyro.source} reads {axes_text(mean)} deg/s {where} (± {1.96 * float(sigma.max()):.2f}, 95 %)."
    check = Check("gyro_bias", verdict, text, unit="deg/s", threshold=BIAS_LIMIT, sensor=imu.gyro.source)
    check.n, check.seconds, check.source = n, round(seconds, 1), BIAS_SOURCE
    check.measure(float(mean[largest]), float(sigma[largest]), 3).measure_axes(mean, sigma, 3)
    if rest is not None and air is not None:
        in_flight = f"{axes_text(air.mean)} deg/s by {air.by} (± {1.96 * air.sigma.max():.2f})"
        check.evidence = [f"In flight it reads {in_flight}."]
    if imu is case.log.replay_imu and (short := _rest_bias(imu, case.segments)) is not None:
        check.verdict = max(short.verdict, graded(change, *BIAS_DPS), key=("ok", "warning", "fault").index)
        if short.t is not None:
            check.text, check.t, check.evidence = short.text, short.t, [text, *check.evidence]
    if check.is_trouble:
        check.why_no_setting, check.action = NO_BIAS_SETTING, case.log.remedy("gyro_bias")
    return check


def _bias_in_flight(case: HealthCase, imu: Imu) -> SensorBias | None:
    """Return the gyro bias in flight: the smoother's, plus the difference of another IMU."""
    found, replayed = smoothed_gyro_bias(case), case.log.replay_imu
    if found is None or not found.sure or replayed is None or not flight_spans(case.segments):
        return None
    if imu is replayed:
        return found
    more = difference_in_flight(case, "gyro", replayed, imu)
    if more is None:
        return None
    sigma = np.hypot(found.sigma, np.degrees(more.sigma(0.0)))
    if 1.96 * float(sigma.max()) > BIAS_DPS[0]:
        return None
    return SensorBias(found.mean + np.degrees(more.middle), sigma, found.known, found.n, found.seconds, found.by)
