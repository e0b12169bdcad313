"""Hover: in the air, hardly turning, hardly tilted, hardly moving."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import FlightLog
from attlog.segments import motion, spans
from attlog.segments.flags import FlagSpans
from attlog.segments.model import Segment
from attlog.segments.windows import Windows, join

SECONDS, RATE_DPS, TILT_DEG, SPEED_M_S = 3.0, 10.0, 20.0, 1.0
"""A tilt limit of 10 deg loses two thirds of a hover in wind."""


def find(log: FlightLog, windows: Windows, airborne: FlagSpans) -> list[Segment]:
    """Spans of at least 3 s with rate < 10 deg/s rms, tilt < 20 deg and speed < 1 m/s where it is known."""
    if not airborne.spans or not log.kind.hovers:
        return []
    wholly = ~spans.overlaps(windows.t0, windows.t1, spans.complement(airborne.spans, -np.inf, np.inf))
    slow = windows.rate_rms < RATE_DPS
    tilt = motion.tilt_deg(log, windows.middle)
    speed = motion.speed_m_s(log, windows.middle)
    passed = wholly & slow & ~(tilt >= TILT_DEG) & ~(speed >= SPEED_M_S)
    limits = [f"rate under {RATE_DPS:.0f} deg/s"]
    limits += [f"tilt under {TILT_DEG:.0f} deg"] if np.isfinite(tilt).any() else ["tilt unknown"]
    limits += [f"speed under {SPEED_M_S:.0f} m/s"] if np.isfinite(speed).any() else ["speed unknown"]
    return [Segment("hover", a, b, ", ".join(limits)) for a, b in join(windows, passed) if b - a >= SECONDS]
