"""Does the accelerometer in quiet time contradict a reference? Then agreement with it means nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Imu
from attlog.reference import trim
from attlog.reference.compare import interpolate
from attlog.reference.model import AlignmentStep, Reference
from attlog.segments import Segments, gaps, spans

Array = NDArray[np.float64]

FAULT_DEG = 10.0
"""A reference that disagrees with gravity at rest by more than this is wrong, or the sensor's frame is."""
SHARE, TWICE = 0.2, 2
"""Or by this share of the quiet time, in two segments and more, where the force is as large as gravity."""
G, AS_LARGE_M_S2 = 9.80665, 0.5
ALIGNED_S = 15.0
"""An onboard attitude may be wrong for so long while it starts."""
ACC_SAMPLES = 2000
"""Accelerometer samples of one segment that are enough for its mean."""
WHERE = {"rest": "at rest", "idle": "on the ground with motors on", "hover": "in hover"}


@dataclass(frozen=True, slots=True)
class QuietSegment:
    """A quiet segment: tilt in deg between the reference's down and the mean force, and the force's size in m/s^2."""

    kind: str
    t0: float
    seconds: float
    tilt: float
    force: float


def check(reference: Reference, imu: Imu | None, segments: Segments) -> tuple[str, list[AlignmentStep]]:
    """A sentence if gravity contradicts the reference, and the alignment step that tells the tilt.

    The median tilt at rest, else idling, else in hover, where the mean specific force is
    gravity's too; and single quiet segments anywhere, where the accelerometer shows its size.
    """
    if imu is None:
        return "", []
    force = gaps.rising(imu.acc.t_best, imu.acc.x)
    quiet = [q for kind in WHERE for s in segments.of(kind) if (q := _quiet(reference, *force, kind, s.t0, s.t1))]
    kind = next((k for k in WHERE if any(q.kind == k for q in quiet)), None)
    if kind is None:
        return "", []
    tilts = [q.tilt for q in quiet if q.kind == kind]
    tilt, where = float(np.median(tilts)), WHERE[kind]
    text = f"{where} {reference.source} and gravity in the accelerometer differ by this tilt (median of {len(tilts)})"
    step = AlignmentStep("gravity_check", text, tilt, "deg", f"accelerometer {where}", False)
    if tilt > FAULT_DEG:
        fault = f"{reference.source} disagrees with gravity {where} by {tilt:.0f} deg"
        return f"{fault}; it or the sensor's frame is wrong", [step]
    return _sometimes(reference, quiet), [step]


def _sometimes(reference: Reference, quiet: list[QuietSegment]) -> str:
    """The sentence where the reference is wrong in some of the quiet time while the accelerometer shows gravity."""
    begin = float(reference.t[0]) + ALIGNED_S
    sound = [q for q in quiet if q.t0 >= begin and abs(q.force - G) <= AS_LARGE_M_S2]
    wrong = [q for q in sound if q.tilt > FAULT_DEG]
    if len(wrong) < TWICE or sum(q.seconds for q in wrong) < SHARE * sum(q.seconds for q in sound):
        return ""
    worst = max(wrong, key=lambda q: q.tilt)
    return (
        f"{reference.source} is wrong by {worst.tilt:.0f} deg {WHERE[worst.kind]} at {worst.t0:.0f} s; the "
        f"accelerometer shows {worst.force:.1f} m/s^2 there; so in {len(wrong)} of {len(sound)} such times"
    )


def _quiet(reference: Reference, t: Array, force: Array, kind: str, t0: float, t1: float) -> QuietSegment | None:
    """The mean specific force over a segment, turned to earth by the reference; None without both."""
    inside = spans.between(t, t0, t1)
    some = slice(inside.start, inside.stop, max(1, (inside.stop - inside.start) // ACC_SAMPLES))
    q, _ = interpolate(reference.t, reference.q, reference.segment, t[some])
    force, good = force[some], rotation.finite(q)
    if not good.any():
        return None
    if reference.trim is not None:
        q = trim.apply(q, -reference.trim)
    mean = np.mean(rotation.rotate(q[good], force[good]), axis=0)
    size = float(np.sqrt(np.sum(mean**2)))
    if size == 0.0:
        return None
    tilt = float(np.degrees(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2])))
    return QuietSegment(kind, t0, t1 - t0, tilt, size)
