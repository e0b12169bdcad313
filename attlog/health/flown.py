"""When what sensors show is that of a vehicle in use: before the first crash, upright, not carried."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.spans import Span, inside, merge
from attlog.flight.model import Array, FlightLog
from attlog.segments.model import Segments

CRASH_KINDS = ("impact", "loss_of_control", "wreck")
UPSIDE_DOWN_DEG = 90.0
MIN_USE_S = 10.0
"""So much time in flight, else armed, tells of a vehicle in use; a log with less is taken as a whole."""


def crash_spans(segments: Segments) -> list[Span]:
    """When the vehicle was a wreck: from each crash until it flew again, or to the end."""
    return merge((s.t0, max(s.t1, s.t0 + 1e-6)) for kind in CRASH_KINDS for s in segments.of(kind))


def before_crashes(segments: Segments, t: Array) -> NDArray[np.bool_]:
    """Which times (n,) lie outside wrecks."""
    return ~inside(t, crash_spans(segments))


def samples_in_use(
    log: FlightLog, segments: Segments, t: Array, kinds: tuple[str, ...] = ("airborne", "armed")
) -> NDArray[np.bool_]:
    """Which times (n,) s tell of the field around the vehicle as it flies: upright, no wreck, and in the first of
    ``kinds`` that lasts for long.

    A log with none of them tells what it can.
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
