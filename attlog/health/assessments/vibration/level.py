"""How strongly did each IMU vibrate in flight, by the firmware's own measure, and did its accelerometer clip?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog, Imu
from attlog.flight.vibration.advice import level_missing, measures_differences
from attlog.flight.vibration.model import LIMITS, Burst, OnboardVibration
from attlog.health.assessments.model import Assessment, HealthCase, Verdict, unknown
from attlog.health.sensors.vibration import more_power, onset
from attlog.health.sound import crashed
from attlog.segments.model import Segments
from attlog.segments.spans import Span, complement, inside, intersect

Array = NDArray[np.float64]

TAKE_OFF_S, LANDING_S = 1.0, 2.0
"""At the ends of a flight: the low-pass of the level still holds the ground, and a touch-down is a blow."""
LEAST_S = 10
"""Fewer seconds of flight have no percentiles."""
FULL_RATE_HZ = 150.0
"""PX4 makes its level of samples at 200 to 250 Hz; a slower stream shows less of it."""
FLOOR_HZ = 5.0
"""The first low-pass of ArduPilot's VIBE: what is slower is motion, not vibration."""
FEW_CLIPS, MANY_CLIPS, LASTING_S = 10, 100, 3
"""ardupilot.org, "Measuring Vibration": below 100 is likely fine, a number that keeps growing is not."""


def flown(segments: Segments | None, log: FlightLog) -> list[Span]:
    """When vibration counts: in flight but for take-off and touch-down, never as a wreck; armed for what cannot fly."""
    if segments is None:
        return []
    spans = segments.spans("airborne" if log.kind.flies else "armed")
    spans = [(a + TAKE_OFF_S, b - LANDING_S) for a, b in spans if b - a > TAKE_OFF_S + LANDING_S]
    wrecks = crashed(segments)
    return intersect(spans, complement(wrecks, -1e9, 1e9)) if wrecks else spans


def vibration_level(case: HealthCase) -> list[Assessment]:
    """The level of every IMU in percentiles over flight, and clipped samples of those that clip."""
    within = flown(case.segments, case.log)
    clips = clipping(case.log, within)
    seen = measured(case.log)
    if not seen:
        return [unknown("", "vibration_level", level_missing(case.log)), *clips]
    longest = max(len(in_flight(one, within)[0]) for one in seen)
    if longest < LEAST_S:
        why = f"Vibration can be judged from {LEAST_S} s of sound flight on; this log holds {longest} s."
        return [unknown("", "vibration_level", why), *clips]
    return [*(_level(case.log, one, within) for one in seen), *clips]


def measured(log: FlightLog) -> list[OnboardVibration]:
    """The autopilot's own levels, else what its definition gives from samples that are fast enough."""
    if log.vibrations:
        return log.vibrations
    if raw := [b for b in log.bursts if b.sensor == "accelerometer" and not b.filtered]:
        return [of_bursts([b for b in raw if b.unit == unit]) for unit in sorted({b.unit for b in raw})]
    imu = log.replay_imu
    if imu is not None and measures_differences(log) and imu.filtered == "none" and imu.acc.rate >= FULL_RATE_HZ:
        return [of_samples(imu)]
    return []


def of_bursts(bursts: list[Burst]) -> OnboardVibration:
    """ArduPilot's level (m/s^2) of the worst axis, one for each burst of one unit: the root of the mean square of what
    a low-pass of 5 Hz leaves. The 2 Hz low-pass of the firmware becomes the mean over the burst."""
    levels = [float(np.sqrt(np.mean(fast(b.x, b.rate) ** 2, axis=0)).max()) for b in bursts]
    t = np.array([b.t + len(b.x) / b.rate for b in bursts])
    return OnboardVibration(bursts[0].unit, "rest", bursts[0].source, t, np.array(levels))


def fast(x: NDArray[np.float32], rate: float) -> Array:
    """What the firmware's first-order low-pass of 5 Hz leaves of x (n, k), by its transfer function over the burst."""
    flat = x.astype(np.float64) - x.mean(axis=0)
    a = 1.0 / (1.0 + rate / (2.0 * np.pi * FLOOR_HZ))
    z = np.exp(-2j * np.pi * np.fft.rfftfreq(len(flat)))
    passed = 1.0 - a / (1.0 - (1.0 - a) * z)
    left: Array = np.fft.irfft(np.fft.rfft(flat, axis=0) * passed[:, None], len(flat), axis=0)
    return left


def of_samples(imu: Imu) -> OnboardVibration:
    """PX4's level of a stream at full rate: the length of the difference of successive samples, its mean over 1 s."""
    t, acc = imu.acc.t_best, imu.acc.x
    step = np.linalg.norm(np.diff(acc, axis=0), axis=1)
    dt = np.diff(t)
    good = (dt > 0) & (dt < 3.0 / imu.acc.rate) & np.isfinite(step)
    starts, level = seconds_of(t[1:][good], step[good])
    return OnboardVibration(imu.index, "difference", imu.acc.source, starts + 1.0, level)


def seconds_of(t: Array, x: Array) -> tuple[Array, Array]:
    """Starts (m,) in s and means (m,) of finite x (n,) at rising t (n,) over the seconds that hold any."""
    good = np.isfinite(x)
    t, x = t[good], x[good]
    if len(t) == 0:
        return np.zeros(0), np.zeros(0)
    second = np.floor(t).astype(np.int64)
    first = np.flatnonzero(np.diff(second, prepend=second[0] - 1))
    count = np.diff(np.append(first, len(t)))
    return second[first].astype(np.float64), np.add.reduceat(x, first) / count


def in_flight(one: OnboardVibration, within: list[Span]) -> tuple[Array, Array]:
    """Starts (m,) in s and mean level (m,) in m/s^2 of the seconds of flight."""
    mine = inside(one.t, within)
    return seconds_of(one.t[mine], one.level[mine])


def _level(log: FlightLog, one: OnboardVibration, within: list[Span]) -> Assessment:
    limits = LIMITS[one.measure]
    named = f"{limits.warning:g} m/s^2" + (f" and {limits.fault:g}" if np.isfinite(limits.fault) else "")
    threshold = f"below {named} in {100 * limits.share:.0f} % of the flight"
    sensor = f"IMU.{one.unit}"
    t, level = in_flight(one, within)
    if len(t) < LEAST_S:
        why = f"{one.source} holds {len(t)} s of sound flight, and {LEAST_S} are needed for percentiles."
        return unknown(sensor, "vibration_level", why, threshold, limits.source)
    half, most, judged = (float(np.quantile(level, q)) for q in (0.5, 0.8, limits.share))
    worst = int(np.argmax(level))
    verdict: Verdict = "fault" if judged > limits.fault else "warning" if judged > limits.warning else "ok"
    text = (
        f"IMU {one.unit} vibrates by {half:.1f} m/s^2 (median); 80 % of the time below {most:.1f}, "
        f"in the worst second {level[worst]:.1f}."
    )
    found = Assessment(
        sensor, "vibration_level", verdict, text, round(judged, 2), "m/s^2", interval_of(level, limits.share),
        n=len(level), seconds=float(len(level)), threshold=threshold, source=limits.source,
    )  # fmt: skip
    found.evidence = [f"{one.source}; the worst second begins at {t[worst]:.0f} s."]
    since = onset(level)
    if since is not None and not more_power(log.throttle, t, since):
        before, after = float(np.median(level[:since])), float(np.median(level[since:]))
        found.t, found.verdict = float(t[since]), "fault" if verdict == "fault" else "warning"
        found.evidence.append(f"From {t[since]:.0f} s on it is {after:.1f} m/s^2 instead of {before:.1f}.")
    if found.verdict != "ok":
        found.action = "Balance the propellers, look for loose parts and soften the autopilot's mounting."
        found.why_no_setting = "No parameter removes vibration from the accelerometer."
    return found


def interval_of(level: Array, share: float) -> tuple[float, float]:
    """95 % interval of a quantile by its order statistics (binomial); seconds count as independent."""
    n = len(level)
    half = 1.96 * np.sqrt(n * share * (1.0 - share))
    ordered = np.sort(level)
    low, high = (int(np.clip(round(n * share + s * half), 0, n - 1)) for s in (-1.0, 1.0))
    return round(float(ordered[low]), 2), round(float(ordered[high]), 2)


def clipping(log: FlightLog, within: list[Span]) -> list[Assessment]:
    """Accelerometers that reached the end of their range in sound flight; nothing of those that did not."""
    found = []
    limit = f"up to {FEW_CLIPS} samples; fault above {MANY_CLIPS} in {LASTING_S} seconds and more"
    for one in (c for c in log.clippings if c.sensor == "accelerometer" and c.whole):
        mine = inside(one.t, within) & (one.new > 0)
        count, seconds = int(one.new[mine].sum()), len(np.unique(np.floor(one.t[mine])))
        if count <= FEW_CLIPS:
            continue
        lasting = count > MANY_CLIPS and seconds >= LASTING_S
        first, last = float(one.t[mine][0]), float(one.t[mine][-1])
        text = f"The accelerometer of IMU {one.unit} clipped {count:,} samples in {seconds} s of flight."
        found.append(
            Assessment(
                f"IMU.{one.unit}",
                "clipping",
                "fault" if lasting else "warning",
                text,
                float(count),
                "samples",
                n=count,
                seconds=float(seconds),
                t=first,
                threshold=limit,
                source="ardupilot.org, Measuring Vibration",
                action="Balance the propellers and soften the autopilot's mounting before the next flight.",
                why_no_setting="No parameter brings clipped samples back.",
                evidence=[f"{one.source}: from {first:.0f} to {last:.0f} s."],
            )
        )
    return found


def levels(case: HealthCase) -> list[dict[str, object]]:
    """For a figure, one dictionary for each IMU: ``unit``, ``source``, ``measure``, ``t`` (m,) s and ``level`` (m,)
    m/s^2 second by second in flight, at most 1500, ``warning`` and ``fault`` m/s^2 (None without)."""
    within = flown(case.segments, case.log)
    found: list[dict[str, object]] = []
    for one in measured(case.log):
        t, level = in_flight(one, within)
        if len(t) == 0:
            continue
        step = -(-len(t) // MOST_POINTS)
        groups = np.arange(0, len(t), step)
        limits = LIMITS[one.measure]
        found.append({
            "unit": one.unit, "source": one.source, "measure": one.measure,
            "t": t[groups], "level": np.maximum.reduceat(level, groups),
            "warning": limits.warning, "fault": limits.fault if np.isfinite(limits.fault) else None,
        })  # fmt: skip
    return found


MOST_POINTS = 1500
"""Of a figure; longer flights keep the highest of neighbouring seconds."""
