"""Accelerometer vibration: level, onset, clipping, and rectification."""

from __future__ import annotations

from bisect import insort
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import counted
from attlog.core.kinematics import known_earth_force
from attlog.core.sorting import median, quantile, unique
from attlog.core.spans import Span, inside
from attlog.flight.model import VIBRATION_LIMITS, Array, Burst, FlightLog, Imu, OnboardVibration, Stream
from attlog.flight.notches import advise_vibration_level, measures_differences
from attlog.health.check import Check, HealthCase, Verdict, graded, unknown
from attlog.health.flown import sound_spans
from attlog.health.gravity import imu_attitude
from attlog.segments.heights import height_stream
from attlog.segments.model import Segments
from attlog.segments.rest import vibration_levels
from attlog.story.flight_events import clipping_spans

# Vibration level in flight.

# Time cut from a flight: settling of the level's low-pass after take-off, and the impact of touch-down.
TAKE_OFF_S, LANDING_S = 1.0, 2.0
# Minimum seconds of flight for percentiles.
MIN_FLIGHT_S = 10
# Minimum rate for PX4's level, which is defined on samples at 200 to 250 Hz.
FULL_RATE_HZ = 150.0
# Cut-off of the first low-pass of ArduPilot's VIBE, which separates motion from vibration.
FLOOR_HZ = 5.0
# Limits for the logged, mostly low-passed accelerometer, from real logs (docs/flight.md).
STRONG_M_S2, VERY_STRONG_M_S2 = 3.0, 15.0
# Onset: the median of the next 10 s is at least three times that of all flight before (20 s or more), and 1 m/s^2.
GROWTH, BEFORE_S, AFTER_S, MIN_GROWN_M_S2 = 3.0, 20, 10, 1.0
# Ratio of throttle above which an onset comes from motor power, not from a broken part.
MORE_POWER = 1.3
# ardupilot.org, "Measuring Vibration": below 100 is likely fine, a number that keeps growing is not.
FEW_CLIPS, MANY_CLIPS, LASTING_S = 10, 100, 3


def sound_flight(segments: Segments, log: FlightLog) -> list[Span]:
    """Return flights without take-off, touch-down and wrecks; armed spans of ground vehicles."""
    spans = segments.spans("airborne" if log.kind.flies else "armed")
    return sound_spans(segments, [(a + TAKE_OFF_S, b - LANDING_S) for a, b in spans if b - a > TAKE_OFF_S + LANDING_S])


def vibration_checks(case: HealthCase) -> list[Check]:
    """Check vibration of every IMU by the firmware's level, else by samples, and clipping."""
    log, within = case.log, sound_flight(case.segments, case.log)
    levels = [_level_check(log, one, within) for one in imu_vibrations(log)]
    if all(check.verdict == "unknown" for check in levels):
        imu, why = log.replay_imu, levels[0].text if levels else advise_vibration_level(log)
        levels = [] if imu is None else [logged_vibration(log, imu, case.segments.spans("airborne"))]
        levels = [check for check in levels if check.verdict != "unknown"] or [unknown("vibration_level", why)]
    return [*levels, *clipping_checks(log, clipping_spans(case.segments) if within else [])]


def imu_vibrations(log: FlightLog) -> list[OnboardVibration]:
    """Return the autopilot's levels, else computed by its definition from fast samples."""
    if log.vibration.levels:
        return log.vibration.levels
    if raw := [b for b in log.vibration.bursts if b.sensor == "accelerometer" and not b.filtered]:
        return [burst_levels([b for b in raw if b.unit == unit]) for unit in sorted({b.unit for b in raw})]
    imu = log.replay_imu
    if imu is not None and measures_differences(log) and imu.filtered == "none" and imu.acc.rate >= FULL_RATE_HZ:
        return [sample_levels(imu)]
    return []


def burst_levels(bursts: list[Burst]) -> OnboardVibration:
    """Return ArduPilot's vibration level in m/s^2 of the worst axis for each burst.

    RMS after removal of a 5 Hz low-pass; a mean over the burst replaces the firmware's 2 Hz low-pass.
    """
    levels = [float(np.sqrt(np.mean(high_passed(b.x, b.rate) ** 2, axis=0)).max()) for b in bursts]
    t = np.array([b.t + len(b.x) / b.rate for b in bursts])
    return OnboardVibration(bursts[0].unit, "rest", bursts[0].source, t, np.array(levels))


def high_passed(x: NDArray[np.float32], rate: float) -> Array:
    """Return ``x`` (n, k) minus its first-order 5 Hz low-pass, in the frequency domain."""
    flat = x.astype(np.float64) - x.mean(axis=0)
    a = 1.0 / (1.0 + rate / (2.0 * np.pi * FLOOR_HZ))
    z = np.exp(-2j * np.pi * np.fft.rfftfreq(len(flat)))
    passed = 1.0 - a / (1.0 - (1.0 - a) * z)
    left: Array = np.fft.irfft(np.fft.rfft(flat, axis=0) * passed[:, None], len(flat), axis=0)
    return left


def sample_levels(imu: Imu) -> OnboardVibration:
    """Return PX4's vibration level of a full-rate stream.

    Mean over 1 s of the length of sample differences.
    """
    t, acc = imu.acc.t_best, imu.acc.x
    step = np.linalg.norm(np.diff(acc, axis=0), axis=1)
    dt = np.diff(t)
    good = (dt > 0) & (dt < 3.0 / imu.acc.rate) & np.isfinite(step)
    starts, level = second_means(t[1:][good], step[good])
    return OnboardVibration(imu.index, "difference", imu.acc.source, starts + 1.0, level)


def second_means(t: Array, x: Array) -> tuple[Array, Array]:
    """Return starts (m,) s and means (m,) of finite ``x`` (n,) in each second with samples."""
    good = np.isfinite(x)
    t, x = t[good], x[good]
    if len(t) == 0:
        return np.zeros(0), np.zeros(0)
    second = np.floor(t).astype(np.int64)
    first = np.flatnonzero(np.diff(second, prepend=second[0] - 1))
    count = np.diff(np.append(first, len(t)))
    return second[first].astype(np.float64), np.add.reduceat(x, first) / count


def levels_in_flight(one: OnboardVibration, within: list[Span]) -> tuple[Array, Array]:
    """Return starts (m,) in s and mean level (m,) in m/s^2 of the seconds of flight."""
    mine = inside(one.t, within)
    return second_means(one.t[mine], one.level[mine])


def _level_check(log: FlightLog, one: OnboardVibration, within: list[Span]) -> Check:
    limits = VIBRATION_LIMITS[one.measure]
    named = f"{limits.warning:g} m/s^2" + (f" and {limits.fault:g}" if np.isfinite(limits.fault) else "")
    threshold = f"below {named} in {100 * limits.share:.0f} % of the flight"
    sensor = f"IMU.{one.unit}"
    t, level = levels_in_flight(one, within)
    if len(t) < MIN_FLIGHT_S:
        why = f"{one.source} holds {len(t)} s of flight; {MIN_FLIGHT_S} are needed for percentiles."
        if not log.kind.flies:
            why = "Vibration is judged in flight only."
        return unknown("vibration_level", why, threshold, sensor=sensor, source=limits.source)
    half, most, judged = (float(quantile(level, q)) for q in (0.5, 0.8, limits.share))
    worst = int(np.argmax(level))
    verdict = graded(judged, limits.warning, limits.fault)
    text = (
        f"IMU {one.unit} vibrates by {half:.1f} m/s^2 (median). Below {most:.1f} for 80 % of the time, "
        f"{level[worst]:.1f} in the worst second."
    )
    found = Check("vibration_level", verdict, text, round(judged, 2), "m/s^2", threshold, sensor=sensor)
    found.ci95, found.n = quantile_interval(level, limits.share), len(level)
    found.seconds, found.source = float(len(level)), limits.source
    found.evidence = [f"{one.source}; the worst second begins at {t[worst]:.0f} s."]
    since = find_onset(level)
    if since is not None and not has_more_power(log.power.throttle, t, since):
        before, after = float(median(level[:since])), float(median(level[since:]))
        found.t, found.verdict = float(t[since]), "fault" if verdict == "fault" else "warning"
        found.evidence.append(f"From {t[since]:.0f} s on it is {after:.1f} m/s^2 instead of {before:.1f}.")
    if found.verdict != "ok":
        found.action = log.remedy("vibration")
        found.why_no_setting = "No parameter removes vibration from the accelerometer."
    return found


def quantile_interval(level: Array, share: float) -> tuple[float, float]:
    """Return the 95 % interval of a quantile by binomial order statistics."""
    n = len(level)
    half = 1.96 * np.sqrt(n * share * (1.0 - share))
    ordered = np.sort(level)
    low, high = (int(np.clip(round(n * share + s * half), 0, n - 1)) for s in (-1.0, 1.0))
    return round(float(ordered[low]), 2), round(float(ordered[high]), 2)


def clipping_checks(log: FlightLog, within: list[Span]) -> list[Check]:
    """Check accelerometers that clipped in flight."""
    found = []
    limit = f"up to {FEW_CLIPS} samples; fault above {MANY_CLIPS} in {LASTING_S} seconds and more"
    for one in (c for c in log.vibration.clippings if c.sensor == "accelerometer" and c.whole):
        mine = inside(one.t, within) & (one.new > 0)
        count, seconds = int(one.new[mine].sum()), len(unique(np.floor(one.t[mine])))
        if count <= FEW_CLIPS:
            continue
        first, last = float(one.t[mine][0]), float(one.t[mine][-1])
        check = Check(
            "clipping",
            "fault" if count > MANY_CLIPS and seconds >= LASTING_S else "warning",
            f"The accelerometer of IMU {one.unit} clipped {counted(count, 'sample')} in {seconds} s of flight.",
            float(count),
            "samples",
            limit,
            t=first,
            evidence=[f"{one.source}: from {first:.0f} to {last:.0f} s."],
            sensor=f"IMU.{one.unit}",
            n=count,
            seconds=float(seconds),
            source="ardupilot.org, Measuring Vibration",
        )
        check.why_no_setting = "No parameter brings clipped samples back."
        check.action = log.remedy("vibration")
        found.append(check)
    return found


def logged_vibration(log: FlightLog, imu: Imu, flown: list[Span]) -> Check:
    """Check level and onset of vibration in logged samples in flight."""
    limit = f"ok up to {STRONG_M_S2:.0f} m/s^2 and steady, fault above {VERY_STRONG_M_S2:.0f}"
    t, x = vibration_levels(imu, flown)
    if len(t) < MIN_FLIGHT_S:
        return unknown("vibration_level", "Too little flight to measure vibration in.", limit)
    strongest = x.max(axis=1)
    typical = float(median(strongest))
    since = find_onset(strongest)
    since = None if since is None or has_more_power(log.power.throttle, t, since) else since
    made = partial(Check, "vibration_level", unit="m/s^2", threshold=limit, sensor=imu.acc.source)
    if since is None:
        axis = int(np.argmax(median(x, axis=0)))
        text = f"In flight the accelerometer vibrates by {typical:.1f} m/s^2 (1 sigma, {'xyz'[axis]} most)."
        return made(graded(typical, STRONG_M_S2, VERY_STRONG_M_S2), text, value=round(typical, 2))
    axis = int(np.argmax(median(x[since:], axis=0)))
    before, after = float(median(x[:since, axis])), float(median(x[since:, axis]))
    text = f"From {t[since]:.0f} s on the accelerometer's {'xyz'[axis]} vibrates by {after:.1f} m/s^2 instead of "
    text += f"{before:.1f}."
    peak = quantile(x[since:, axis], 0.95)
    seen = [f"95 % of the seconds from then on stay below {peak:.1f} m/s^2."]
    verdict: Verdict = "fault" if after > STRONG_M_S2 else "warning"
    return made(verdict, text, value=round(after, 2), t=float(t[since]), evidence=seen)


def find_onset(level: Array) -> int | None:
    """Return the window index from which vibration is lastingly larger, None without onset."""
    if len(level) < BEFORE_S + AFTER_S:
        return None
    k = np.arange(BEFORE_S, len(level) - AFTER_S + 1)
    before, rest = running_medians(level)[k - 1], running_medians(level[::-1])[::-1][k]
    after = median(np.lib.stride_tricks.sliding_window_view(level, AFTER_S), axis=1)[k]
    grown = (np.minimum(after, rest) > np.maximum(GROWTH * before, MIN_GROWN_M_S2)) & (level[k] > 0.5 * GROWTH * before)
    return int(k[np.argmax(grown)]) if grown.any() else None


def running_medians(x: Array) -> Array:
    """Return running medians (n,) of the first 1, 2, ... n finite numbers."""
    ordered: list[float] = []
    out = np.empty(len(x))
    for n, value in enumerate(x.tolist()):
        insort(ordered, value)
        out[n] = 0.5 * (ordered[n // 2] + ordered[(n + 1) // 2])
    return out


def has_more_power(throttle: Stream | None, t: Array, since: int) -> bool:
    """Return whether throttle rises at the onset of vibration; windows at ``t`` (m,) s."""
    if throttle is None or len(throttle.t) < 2:
        return False
    x = np.interp(t, throttle.t, np.nan_to_num(throttle.x[:, 0]))
    return float(median(x[since : since + 3])) > MORE_POWER * float(median(x[:since]))


# Mean vertical force against the barometer: a vibrating accelerometer may rectify vibration into a constant force.

# Averaging window, and limits of the change of mean force that the climb does not explain.
FORCE_WINDOW_S, CHANGED_M_S2, WRONG_M_S2 = 10.0, 0.7, 1.5
# Cut from both ends of a flight.
FORCE_EDGE_S = 2.0
# Minimum attitude rate, and minimum share of a window covered by the attitude.
MIN_ATTITUDE_HZ, MIN_COVERED_SHARE = 5.0, 0.9


def vertical_force_check(case: HealthCase) -> list[Check]:
    """Check the mean vertical force in flight against the barometer; nothing of a vehicle that does not fly."""
    imu = case.log.replay_imu
    return (
        []
        if imu is None or not case.log.kind.flies
        else [vertical_force(case.log, imu, case.segments.spans("airborne"))]
    )


def vertical_force(log: FlightLog, imu: Imu, flown: list[Span]) -> Check:
    """Check for changes of the mean vertical force in flight without a matching climb."""
    limit = f"ok up to {CHANGED_M_S2} m/s^2 over {FORCE_WINDOW_S:.0f} s, fault above {WRONG_M_S2}"
    above, onboard = height_stream(log), log.onboard_attitude
    if above is None or onboard is None or onboard.rate < MIN_ATTITUDE_HZ:
        return unknown("vertical_force", "No barometer or no attitude to compare the vertical force with.", limit)
    found = [w for span in flown for w in _force_windows(span, imu, above)]
    if len(found) < 2:
        return unknown("vertical_force", f"Less than {2 * FORCE_WINDOW_S:.0f} s of unbroken flight.", limit)
    q = imu_attitude(log, onboard)
    force = np.array([_mean_force(imu, onboard.t, q, w) for w in found])
    by_height = np.array([_mean_acceleration(above, w) for w in found])
    good = np.isfinite(force) & np.isfinite(by_height)
    if good.sum() < 2:
        return unknown("vertical_force", "No barometer or no attitude to compare the vertical force with.", limit)
    force, by_height = force[good], by_height[good]
    times = np.array([w[0] for w in found])[good]
    unexplained = force - by_height - (force[0] - by_height[0])
    worst = int(np.argmax(np.abs(unexplained)))
    size = float(abs(unexplained[worst]))
    verdict = graded(size, CHANGED_M_S2, WRONG_M_S2)
    stays = f"stays within {size:.2f} m/s^2 of what the height explains"
    text = f"The mean vertical force over {FORCE_WINDOW_S:.0f} s {stays}."
    if verdict == "ok":
        return Check("vertical_force", verdict, text, round(size, 2), "m/s^2", limit)
    since = int(np.argmax(np.abs(unexplained) > CHANGED_M_S2))
    first = f"{times[since]:.0f} to {times[since] + FORCE_WINDOW_S:.0f} s"
    text = f"The mean vertical force is up to {size:.1f} m/s^2 off what the height shows, first from {first}."
    seen = [
        f"At {times[worst]:.0f} s it is {force[worst]:.2f} m/s^2 after {force[0]:.2f} at first, while the height shows "
        f"an acceleration of {by_height[worst]:+.1f} m/s^2."
    ]
    return Check("vertical_force", verdict, text, round(size, 2), "m/s^2", limit, t=float(times[since]), evidence=seen)


def _force_windows(span: Span, imu: Imu, above: Stream) -> list[Span]:
    """Return gapless windows of 10 s in a span, without its ends."""
    t = imu.acc.t_best
    found = []
    start = span[0] + FORCE_EDGE_S
    while start + FORCE_WINDOW_S <= span[1] - FORCE_EDGE_S:
        i, j = np.searchsorted(t, [start, start + FORCE_WINDOW_S])
        a, b = np.searchsorted(above.t, [start, start + FORCE_WINDOW_S])
        if j - i > 10 and b - a > 10 and np.diff(t[i:j]).max() < 0.5 and np.diff(above.t[a:b]).max() < 1.0:
            found.append((start, start + FORCE_WINDOW_S))
        start += FORCE_WINDOW_S
    return found


def _mean_force(imu: Imu, t: Array, q: Array, window: Span) -> float:
    """Return the mean upward specific force in m/s^2 over a window, NaN without attitude."""
    use = slice(*np.searchsorted(imu.acc.t_best, window))
    known, force = known_earth_force(imu.acc.t_best[use], imu.acc.x[use], t, q)
    covered = len(known) >= MIN_COVERED_SHARE * (use.stop - use.start)
    return float(-force[:, 2].mean()) if covered else float("nan")


def _mean_acceleration(above: Stream, window: Span) -> float:
    """Return the mean upward acceleration in m/s^2 over a window by climb rates at its ends."""
    rates = []
    for at in window:
        i, j = np.searchsorted(above.t, [at - 1.5, at + 1.5])
        t, x = above.t[i:j], above.x[i:j, 0]
        good = np.isfinite(x)
        if good.sum() < 4 or np.ptp(t[good]) < 1.0:
            return float("nan")
        rates.append(float(np.polyfit(t[good] - at, x[good], 1)[0]))
    return (rates[1] - rates[0]) / (window[1] - window[0])
