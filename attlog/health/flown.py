"""Spans used by checks: in flight, at rest, in use; without wrecks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.core.spans import Span, complement, inside, intersect, merge
from attlog.flight.model import Array, FlightLog
from attlog.health.check import HealthCase
from attlog.segments.model import Segments

CRASH_KINDS = ("impact", "loss_of_control", "wreck")
# Time cut from both ends of a flight, because of ground contact.
EDGE_S = 1.0
# Tilt above which a vehicle is upside down.
UPSIDE_DOWN_DEG = 90.0
# Minimum flight or armed time; with less the whole log counts.
MIN_USE_S = 10.0


def crash_spans(segments: Segments) -> list[Span]:
    """Return the spans of wrecks: from each crash to the next flight or the end."""
    return merge((s.t0, max(s.t1, s.t0 + 1e-6)) for kind in CRASH_KINDS for s in segments.of(kind))


def before_crashes(segments: Segments, t: Array) -> NDArray[np.bool_]:
    """Select the times (n,) outside wrecks."""
    return ~inside(t, crash_spans(segments))


def sound_spans(segments: Segments, spans: list[Span]) -> list[Span]:
    """Cut spans at the first impact and remove wrecks."""
    end = min((s.t0 for s in segments.of("impact")), default=np.inf)
    return intersect(spans, complement(crash_spans(segments), -np.inf, end))


def flight_spans(segments: Segments) -> list[Span]:
    """Return the flights without first and last second, before any impact."""
    return sound_spans(segments, cut_edges(segments.spans("airborne")))


def driven_spans(case: HealthCase) -> list[Span]:
    """Return the flights, or the armed spans where flight is not logged."""
    unknown = "airborne" in case.segments.unknown
    return sound_spans(case.segments, cut_edges(armed_spans(case.log))) if unknown else flight_spans(case.segments)


def first_crash(segments: Segments) -> float:
    """Return the time of the first crash in s, infinity without one."""
    return min((a for a, _ in crash_spans(segments)), default=np.inf)


def flight_before_crash(segments: Segments, edge_s: float = EDGE_S) -> list[Span]:
    """Return the flights up to the first crash, without ``edge_s`` at both ends."""
    end = first_crash(segments)
    return cut_edges([(a, min(b, end)) for a, b in segments.spans("airborne") if a < end], edge_s)


def cut_edges(spans: list[Span], edge_s: float = EDGE_S) -> list[Span]:
    """Return spans without their first and last ``edge_s`` seconds."""
    return [(a + edge_s, b - edge_s) for a, b in spans if b - a > 2.0 * edge_s]


def armed_spans(log: FlightLog) -> list[Span]:
    """Return the armed spans; an open one ends at the last estimate, fix or test ratio."""
    armed = log.state.armed
    if armed is None or len(armed.t) == 0:
        return []
    times = [s.t for each in (log.attitudes.values(), log.gnss, log.estimator.innovation_tests) for s in each]
    last = max((float(t[-1]) for t in times if len(t)), default=log.seconds)
    ends = [*armed.t[1:].tolist(), last]
    return [(a, b) for a, b, on in zip(armed.t.tolist(), ends, armed.value, strict=True) if on and b > a]


def still_spans(segments: Segments) -> tuple[list[Span], str]:
    """Return rests, else idling with motors on, and its description."""
    for kind, words in (("rest", "at rest"), ("idle", "on the ground with motors on")):
        if spans := sound_spans(segments, segments.spans(kind)):
            return spans, words
    return [], ""


def held_seconds(t: Array) -> Array:
    """Return the time (n,) in s from each sample to the next, at most three median steps."""
    if len(t) < 2:
        return np.zeros(len(t))
    step = np.diff(t)
    usual = float(median(step))
    return np.asarray(np.minimum(np.append(step, usual), 3.0 * usual))


def samples_in_use(
    log: FlightLog, segments: Segments, t: Array, kinds: tuple[str, ...] = ("airborne", "armed")
) -> NDArray[np.bool_]:
    """Mark times (n,) in use: upright, outside wrecks, in flight or armed.

    The first of ``kinds`` that lasts MIN_USE_S in total counts, else the whole log.
    """
    use = before_crashes(segments, t)
    long = [kind for kind in kinds if (segments.seconds(kind) or 0.0) > MIN_USE_S]
    if long:
        use &= segments.mask(t, long[0])
    attitude = log.onboard_attitude or log.truth
    if attitude is not None and len(attitude.t):
        near = np.clip(np.searchsorted(attitude.t, t), 0, len(attitude.t) - 1)
        use &= ~(np.degrees(rotation.tilt_angle(attitude.q)) > UPSIDE_DOWN_DEG)[near]
    return use
