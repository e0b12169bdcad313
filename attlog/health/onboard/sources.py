"""Do the onboard attitudes agree with each other? A second source far off means that one of them is wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, Attitude, FlightLog
from attlog.health.model import Check, not_judged
from attlog.segments.model import Segments

TILT_DEG, HEADING_DEG = (10.0, 30.0), (20.0, 60.0)
"""Where a warning, and where a fault: a backup estimator is coarse, but no compass is 20 deg off for half a flight."""
STEEP_DEG = 60.0
"""Heading means nothing beyond this tilt."""
SHARE, LASTING, SETTLED_S = 0.2, 0.9, 15.0
"""Off for a fifth of the time; since the moment after which it is off most of the time; not while it starts."""
SAMPLES = 20


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """How far each other onboard attitude is off for a fifth of the flight, and since when."""
    flew = log.onboard_attitude
    others = {n: a for n, a in log.attitudes.items() if n != log.onboard}
    if flew is None or not others:
        return []
    limit = f"ok up to {TILT_DEG[0]:.0f} deg of tilt and {HEADING_DEG[0]:.0f} of heading"
    limit += f", fault above {TILT_DEG[1]:.0f} and {HEADING_DEG[1]:.0f}"
    seen = {n: d for n, a in others.items() if (d := difference(flew, a, segments)) is not None}
    if not seen:
        return [
            not_judged(
                "second source",
                f"No other onboard attitude shares enough time with {log.onboard} after its first {SETTLED_S:.0f} s.",
                limit,
            )
        ]
    off = {n: d for n, d in seen.items() if d.since is not None}
    if not off:
        text = f"{listed([*seen, str(log.onboard)])} show the same tilt and heading."
        return [Check("second source", "ok", text, 0.0, "deg", limit)]
    worst = max(off.values(), key=lambda d: max(d.tilt / TILT_DEG[0], d.heading / HEADING_DEG[0]))
    same = [n for n, d in off.items() if abs(d.tilt - worst.tilt) < 1.0 and abs(d.heading - worst.heading) < 3.0]
    verdict = "fault" if worst.tilt > TILT_DEG[1] or worst.heading > HEADING_DEG[1] else "warning"
    sizes = [(worst.heading, HEADING_DEG[0], "heading"), (worst.tilt, TILT_DEG[0], "tilt")]
    shown = " and ".join(f"{size:.0f} deg in {what}" for size, least, what in sizes if size > least)
    differ = "differ" if len(same) > 1 else "differs"
    text = f"From {worst.since:.0f} s on {listed(same)} {differ} from {log.onboard} by {shown} (median)."
    heading_counts = worst.heading / HEADING_DEG[0] > worst.tilt / TILT_DEG[0]
    value = worst.heading if heading_counts else worst.tilt
    return [Check("second source", verdict, text, round(value, 1), "deg", limit, t=worst.since)]


def listed(names: list[str]) -> str:
    """Names as a part of a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


@dataclass(frozen=True, slots=True)
class SourceDifference:
    """Median tilt and heading difference in deg while beyond the limits: ``since`` s, None where it never is long."""

    tilt: float
    heading: float
    since: float | None


def difference(flew: Attitude, other: Attitude, segments: Segments) -> SourceDifference | None:
    """How far two attitudes differ, in flight where there is flight; None without common time."""
    t = flew.t if flew.t_sample is None else flew.t_sample
    step = max(1, len(t) // 4000)
    t, own = t[::step], flew.q[::step]
    q = rotation.slerp(other.t if other.t_sample is None else other.t_sample, other.q, t)
    use = rotation.finite(q) & (t > t[0] + SETTLED_S)
    flown = use & segments.mask(t, "airborne")
    use = flown if flown.sum() >= SAMPLES else use
    if use.sum() < SAMPLES:
        return None
    t, q, own = t[use], q[use], own[use]
    down = np.array([0.0, 0.0, 1.0])
    one, two = rotation.rotate_inverse(own, down), rotation.rotate_inverse(q, down)
    tilt = np.degrees(np.arccos(np.clip(np.sum(one * two, axis=1), -1.0, 1.0)))
    heading = np.abs(np.degrees(heading_between(own, q)))
    heading[np.degrees(rotation.inclination_angle(own)) > STEEP_DEG] = 0.0
    off = (tilt > TILT_DEG[0]) | (heading > HEADING_DEG[0])
    if off.mean() < SHARE:
        return SourceDifference(float(np.median(tilt)), float(np.median(heading)), None)
    share_after = np.cumsum(off[::-1])[::-1] / np.arange(len(off), 0, -1)
    lasting = np.flatnonzero(off & (share_after > LASTING))
    since = float(t[lasting[0]]) if len(lasting) else float(t[np.argmax(off)])
    return SourceDifference(float(np.median(tilt[off])), float(np.median(heading[off])), since)


def heading_between(a: Array, b: Array) -> Array:
    """The rotation (n,) in rad about the vertical that is left between attitudes (n, 4)."""
    step = rotation.multiply(b, rotation.conjugate(a))
    angle: Array = np.asarray(rotation.wrap(2.0 * np.arctan2(step[:, 3], step[:, 0])), np.float64)
    return angle
