"""Time in which samples count: in flight, standing still, in use; never as a wreck."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.spans import Span, complement, inside, intersect, merge
from attlog.flight.model import Array, FlightLog
from attlog.health.check import HealthCase
from attlog.segments.model import Segments

CRASH_KINDS = ("impact", "loss_of_control", "wreck")
# Cut from both ends of a flight: the ground pushes there.
EDGE_S = 1.0
# Samples of this tilt are of a vehicle on its back.
UPSIDE_DOWN_DEG = 90.0
# Shorter flight or arming is no use of the vehicle; the whole log counts instead.
MIN_USE_S = 10.0


def crash_spans(segments: Segments) -> list[Span]:
    """Return the spans as a wreck: from each crash to the next flight or the end."""
    return merge((s.t0, max(s.t1, s.t0 + 1e-6)) for kind in CRASH_KINDS for s in segments.of(kind))


def before_crashes(segments: Segments, t: Array) -> NDArray[np.bool_]:
    """Select the times (n,) outside wrecks."""
    return ~inside(t, crash_spans(segments))


def sound_spans(segments: Segments, spans: list[Span]) -> list[Span]:
    """Return the time of ``spans`` up to the first impact and outside wrecks; what flies on may be bent."""
    end = min((s.t0 for s in segments.of("impact")), default=np.inf)
    return intersect(spans, complement(crash_spans(segments), -np.inf, end))


def flight_spans(segments: Segments) -> list[Span]:
    """Return the flights without their first and last second."""
    return sound_spans(segments, cut_edges(segments.spans("airborne")))


def driven_spans(case: HealthCase) -> list[Span]:
    """Return the flights, or the time armed where the log does not show flight."""
    unknown = "airborne" in case.segments.unknown
    return sound_spans(case.segments, cut_edges(armed_spans(case.log))) if unknown else flight_spans(case.segments)


def first_crash(segments: Segments) -> float:
    """Return the time of the first crash in s, infinity without one."""
    return min((a for a, _ in crash_spans(segments)), default=np.inf)


def flight_before_crash(segments: Segments, edge_s: float = EDGE_S) -> list[Span]:
    """Return the flights up to the first crash, without their ends."""
    end = first_crash(segments)
    return cut_edges([(a, min(b, end)) for a, b in segments.spans("airborne") if a < end], edge_s)


def cut_edges(spans: list[Span], edge_s: float = EDGE_S) -> list[Span]:
    """Return spans without their first and last ``edge_s`` seconds."""
    return [(a + edge_s, b - edge_s) for a, b in spans if b - a > 2.0 * edge_s]


def armed_spans(log: FlightLog) -> list[Span]:
    """Return the spans armed up to the last estimate, fix or test ratio; none where arming is not logged."""
    armed = log.state.armed
    if armed is None or len(armed.t) == 0:
        return []
    times = [s.t for each in (log.attitudes.values(), log.gnss, log.estimator.innovation_tests) for s in each]
    last = max((float(t[-1]) for t in times if len(t)), default=log.seconds)
    ends = [*armed.t[1:].tolist(), last]
    return [(a, b) for a, b, on in zip(armed.t.tolist(), ends, armed.value, strict=True) if on and b > a]


def still_spans(segments: Segments) -> tuple[list[Span], str]:
    """Return the rests on the ground, else the time there with motors on, and its name."""
    for kind, words in (("rest", "at rest"), ("idle", "on the ground with motors on")):
        if spans := sound_spans(segments, segments.spans(kind)):
            return spans, words
    return [], ""


def held_seconds(t: Array) -> Array:
    """Return the time (n,) in s from each sample at ``t`` (n,) to the next, at most three usual steps."""
    if len(t) < 2:
        return np.zeros(len(t))
    step = np.diff(t)
    usual = float(np.median(step))
    return np.asarray(np.minimum(np.append(step, usual), 3.0 * usual))


def samples_in_use(
    log: FlightLog, segments: Segments, t: Array, kinds: tuple[str, ...] = ("airborne", "armed")
) -> NDArray[np.bool_]:
    """Select the times (n,) s upright, outside wrecks and in the first of ``kinds`` that lasts MIN_USE_S.

    Without such a kind the whole log counts.
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
