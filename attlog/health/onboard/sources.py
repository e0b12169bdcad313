"""Do the onboard attitudes agree with each other? A second source far off means that one of them is wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, Attitude, FlightLog
from attlog.health.model import Check, not_judged
from attlog.health.sound import before_crashes
from attlog.reference import trim
from attlog.reference.model import Reference
from attlog.reference.smoothed import differences_deg
from attlog.segments.model import Segments

TILT_DEG, HEADING_DEG = (10.0, 30.0), (20.0, 60.0)
"""Where a warning, and where a fault: a backup estimator is coarse, but no compass is 20 deg off for half a flight."""
STEEP_DEG = 60.0
"""Heading means nothing beyond this tilt."""
SHARE, LASTING, SETTLED_S = 0.2, 0.9, 15.0
"""Off for a fifth of the time; since the moment after which it is off most of the time; not while it starts."""
ENDS_S = 5.0
"""A difference that ends so long before the attitude has an end of its own."""
SAMPLES = 20
STANDS_DEG, MOVES_DEG = 0.01, 2.0
"""A source that stands while the onboard attitude moves is an estimator that never ran, such as AHRS3 without EKF3."""
CLEARLY = 0.4
"""One of two is wrong where the other has so much of its error at most."""


def checks(log: FlightLog, segments: Segments, reference: Reference | None = None) -> list[Check]:
    """How far each other onboard attitude is off for a fifth of the flight, since when, and which of them is wrong.

    ``reference``: truth or a smoother that can tell; nobody else can.
    """
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
    name = max(off, key=lambda n: max(off[n].tilt / TILT_DEG[0], off[n].heading / HEADING_DEG[0]))
    worst = off[name]
    same = [n for n, d in off.items() if abs(d.tilt - worst.tilt) < 1.0 and abs(d.heading - worst.heading) < 3.0]
    verdict = "fault" if worst.tilt > TILT_DEG[1] or worst.heading > HEADING_DEG[1] else "warning"
    sizes = [(worst.heading, HEADING_DEG[0], "heading"), (worst.tilt, TILT_DEG[0], "tilt")]
    shown = " and ".join(f"{size:.0f} deg in {what}" for size, least, what in sizes if size > least)
    differ = "differ" if len(same) > 1 else "differs"
    since = worst.since or 0.0
    text = f"{when(worst, flew)} {listed(same)} {differ} from {log.onboard} by {shown}"
    about = "tilt" if worst.tilt > TILT_DEG[0] else "heading"
    size = worst.heading if worst.heading / HEADING_DEG[0] > worst.tilt / TILT_DEG[0] else worst.tilt
    errors = against(reference, log, name, about, since)
    who = said_wrong(errors, str(log.onboard), listed(same), reference)
    if errors is not None and who and errors[0] < errors[1]:
        verdict = "warning"  # what flew is right
    if not who and about == "heading" and reference is not None and reference.wrong_heading:
        who = f"GNSS acceleration contradicts {log.onboard}"
    text += f"; {who}." if who else "; which is right cannot be determined."
    t, t_end = worst.since, worst.until
    return [Check("second source", verdict, text, round(size, 1), "deg", limit, t=t, t_end=t_end, about=about)]


def against(
    reference: Reference | None, log: FlightLog, name: str, about: str, since: float
) -> tuple[float, float] | None:
    """Median errors in deg of the attitude that flew and of another from ``since`` s on; None where nobody can tell."""
    if reference is None or reference.kind not in ("truth", "smoother"):
        return None
    if about == "heading" and reference.heading_by != "own":
        return None
    found = []
    for attitude in (log.onboard_attitude, log.attitudes[name]):
        assert attitude is not None
        late = attitude.t >= since
        t, q = attitude.t[late], attitude.q[late]
        if reference.trim is not None and not attitude.has_trim:
            q = trim.apply(q, reference.trim)
        tilt, heading = differences_deg(reference, t, q)
        size = np.abs(tilt if about == "tilt" else heading)
        size = size[np.isfinite(size)]
        if len(size) < SAMPLES:
            return None
        found.append(float(np.median(size)))
    return found[0], found[1]


def said_wrong(errors: tuple[float, float] | None, flew: str, others: str, reference: Reference | None) -> str:
    """Who is wrong, by whom; empty where the reference lies near neither or both."""
    if errors is None or reference is None or min(errors) > CLEARLY * max(errors):
        return ""
    whom = "the truth" if reference.kind == "truth" else "the smoother"
    wrong, right = (flew, others) if errors[0] > errors[1] else (others, flew)
    verb = "is" if wrong == flew or " and " not in others else "are"
    return f"{wrong} {verb} wrong by {whom}, {right} off by {min(errors):.0f} deg"


def when(off: SourceDifference, flew: Attitude) -> str:
    """When two attitudes differ: from its begin on, from then to then, or now and then."""
    if not off.lasts:
        return f"In {100 * off.share:.0f} % of the time from {off.since or 0.0:.0f} s to {off.until:.0f} s"
    ends = flew.t[-1] - off.until > ENDS_S
    return f"From {off.since or 0.0:.0f} s {f'to {off.until:.0f} s' if ends else 'on'}"


def listed(names: list[str]) -> str:
    """Names as a part of a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


@dataclass(frozen=True, slots=True)
class SourceDifference:
    """Median tilt and heading difference in deg while beyond the limits, which it is from ``since`` s (None: never
    long) to ``until`` s: most of that time if it ``lasts``, else for that ``share`` of it."""

    tilt: float
    heading: float
    since: float | None
    until: float = 0.0
    share: float = 0.0
    lasts: bool = True


def _spread_deg(q: Array) -> float:
    """The largest angle between the first and any other of attitudes (n, 4), deg."""
    return float(np.degrees(np.max(rotation.total_angle(rotation.error(q, q[:1])))))


def difference(flew: Attitude, other: Attitude, segments: Segments) -> SourceDifference | None:
    """How far two attitudes differ, in flight where there is flight; None without common time."""
    t = flew.t if flew.t_sample is None else flew.t_sample
    step = max(1, len(t) // 4000)
    t, own = t[::step], flew.q[::step]
    q = rotation.slerp(other.t if other.t_sample is None else other.t_sample, other.q, t)
    use = rotation.finite(q) & (t > t[0] + SETTLED_S) & before_crashes(segments, t)
    flown = use & segments.mask(t, "airborne")
    use = flown if flown.sum() >= SAMPLES else use
    if use.sum() < SAMPLES:
        return None
    t, q, own = t[use], q[use], own[use]
    if _spread_deg(q) < STANDS_DEG and _spread_deg(own) > MOVES_DEG:
        return None
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
    beyond = np.flatnonzero(off)
    first, last = lasting[0] if len(lasting) else beyond[0], beyond[-1]
    share = float(np.mean(off[first : last + 1]))
    sizes = float(np.median(tilt[off])), float(np.median(heading[off]))
    return SourceDifference(*sizes, float(t[first]), float(t[last]), share, share > LASTING)


def heading_between(a: Array, b: Array) -> Array:
    """The rotation (n,) in rad about the vertical that is left between attitudes (n, 4)."""
    step = rotation.multiply(b, rotation.conjugate(a))
    angle: Array = np.asarray(rotation.wrap(2.0 * np.arctan2(step[:, 3], step[:, 0])), np.float64)
    return angle
