"""Clipping and vibration: what flight did to the accelerometers, from when to when."""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.flight.model import FlightLog, Stream
from attlog.flight.vibration.model import LIMITS
from attlog.segments.model import Segments
from attlog.segments.spans import Span, inside, merge
from attlog.segments.vibration import levels
from attlog.story.event import Event, Weight, figures
from attlog.story.words import CLIPS, Text, matching, quoted

STRONG_M_S2, STRONG_S = 15.0, 5
ONBOARD_M_S2, LEAST = 60.0, 10
FEW, SOME = 3, 10
"""Clipped samples up to so many are chance, and no warning."""
LANDING_S, BLOW_S = 1.0, 0.1
"""Before the end of a flight: what a touch-down, or the blow of a crash, does to a range is no clipping in flight."""
FAST_HZ = 40.0


def events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """Clipping of the accelerometers and vibration in flight, and the texts that are told in them."""
    found, told = [], []
    if any(problem.code == "imu_mostly_refused" for problem in log.problems):
        return [], []  # what is no measurement of a vehicle clips no sensor
    within = driven(segments)
    clip, texts = _clipping(log, within)
    if clip is not None:
        found.append(clip)
        told += texts
    crashes = [e.t for e in segments.endings if e.is_crash]
    shaken = _vibration(
        log, [(a, min([b, *(t - LANDING_S for t in crashes if a < t)])) for a, b in segments.spans("airborne")]
    )
    return [*found, *([shaken] if shaken is not None else [])], told


def driven(segments: Segments) -> list[Span]:
    """When clipping counts: in flight but for the touch-down, and while something that never flew was driven."""
    flights = segments.spans("airborne")
    crashes = [e.t for e in segments.endings if e.is_crash]
    if flights:
        return [(a, b - (BLOW_S if any(abs(b - t) < 0.5 for t in crashes) else LANDING_S)) for a, b in flights]
    return merge(segments.spans("armed"))


def _clipping(log: FlightLog, within: list[Span]) -> tuple[Event | None, list[Text]]:
    """The flags of the selected unit tell the time, the counters of every unit the number."""
    first: list[float] = []
    last: list[float] = []
    counts: dict[str, int] = {}
    for clipping in log.clippings:
        if clipping.sensor != "accelerometer":
            continue
        mine = inside(clipping.t, within) & (clipping.new > 0)
        if mine.any():
            counts[clipping.source] = int(clipping.new[mine].sum())
            first.append(float(clipping.t[mine][0]))
            last.append(float(clipping.t[mine][-1]))
    if not counts or max(counts.values()) <= FEW:
        return None, []
    flags = [c for c in log.clippings if not c.whole and c.source in counts]
    t = float(flags[0].t[inside(flags[0].t, within) & (flags[0].new > 0)][0]) if flags else min(first)
    most = max(counts.values())
    said = [x for x in matching(log, CLIPS) if -1.0 <= x[0] - t <= max(last) - t + 5.0]
    text = f"The accelerometer clipped from {t:.1f} s to {max(last):.1f} s: {most:,} samples."
    evidence = [*(f"{source}: {n:,} samples" for source, n in counts.items()), *(quoted(x) for x in said[:1])]
    weight: Weight = "warning" if most > SOME else "note"
    return Event("clipping", t, weight, text, max(last), float(most), "samples", evidence), said


def _sound(own: Stream | None, flown: list[Span]) -> bool:
    """Whether the autopilot's own measure of the worst axis is as it should be in flight."""
    if own is None:
        return False
    x = own.x[inside(own.t, flown) & rotation.finite(own.x)].max(axis=1, initial=0.0)
    limits = LIMITS["rest"]
    return len(x) >= LEAST and bool(np.quantile(x, limits.share) <= limits.warning)


def _vibration(log: FlightLog, flown: list[Span]) -> Event | None:
    """Vibration in flight above 15 m/s^2 (rms of the worst axis), or above 60 by the autopilot's own measure.

    None where that measure, made of every sample, stays below its limit: the logged ones fold and count motion.
    """
    imu = log.replay_imu
    if imu is None or _sound(log.onboard_vibration, flown):
        return None
    t, x = levels(imu, flown)
    strong = x.max(axis=1) > STRONG_M_S2 if len(t) else np.zeros(0, bool)
    if np.count_nonzero(strong) >= STRONG_S:
        size = float(np.median(x[strong].max(axis=1)))
        a, b = float(t[strong][0]), float(t[strong][-1]) + 1.0
        source = f"{imu.acc.source}: {figures(size)} m/s² rms"
    elif log.onboard_vibration is not None:
        own = log.onboard_vibration
        mine = inside(own.t, flown)
        high = mine & rotation.finite(own.x) & (np.nan_to_num(own.x).max(axis=1, initial=0.0) > ONBOARD_M_S2)
        if np.count_nonzero(high) < 3:
            return None
        size = float(np.median(own.x[high].max(axis=1)))
        a, b = float(own.t[high][0]), float(own.t[high][-1])
        source = f"{own.source}: {figures(size)} m/s²"
    else:
        return None
    text = f"Strong vibration from {a:.0f} to {b:.0f} s: {figures(size)} m/s²."
    return Event("vibration", a, "warning", text, b, round(size, 1), "m/s²", [source])
