"""Differences between onboard attitudes: other sources, and estimator lanes."""

from __future__ import annotations

import re
from functools import partial
from typing import NamedTuple

import numpy as np

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.core.spans import Span, inside
from attlog.flight.model import Array, Attitude, FlightLog, TimeLine
from attlog.health.check import Check, HealthCase, Verdict, unknown
from attlog.health.flown import before_crashes, driven_spans
from attlog.reference import alignment
from attlog.reference.model import Reference
from attlog.reference.smoother import differences_deg
from attlog.segments.model import Segments

# Limits (warning, fault) of tilt and heading differences; backup estimators are coarse.
TILT_DEG, HEADING_DEG = (10.0, 30.0), (20.0, 60.0)
SOURCE_LIMIT = f"ok up to {TILT_DEG[0]:.0f} deg of tilt and {HEADING_DEG[0]:.0f} of heading"
SOURCE_LIMIT += f", fault above {TILT_DEG[1]:.0f} and {HEADING_DEG[1]:.0f}"
# Maximum tilt for a heading.
MAX_HEADING_TILT_DEG = 60.0
# Minimum share of time beyond the limits for a difference, and for a lasting one; time excluded after the start.
OFF_SHARE, LASTING_SHARE, SETTLED_S = 0.2, 0.9, 15.0
# Minimum time from the end of a difference to the end of the attitude for the end to be reported.
END_MARGIN_S = 5.0
# Sources within this of the largest difference are reported together.
SAME_TILT_DEG, SAME_HEADING_DEG = 1.0, 3.0
# Minimum samples for a median, and maximum, for speed.
MIN_SAMPLES, MAX_SAMPLES = 20, 4000
# Maximum ratio of the smaller to the larger error of two sources for a decision.
CLEARLY_BETTER = 0.4
REFERENCE_NAMES = {"truth": "the truth", "smoother": "the smoother"}


class SourceDifference(NamedTuple):
    """Median tilt and heading difference in deg of two attitudes while beyond the limits.

    From ``since`` (None: never for long) to ``until`` s, for a ``share`` of that time; ``lasts``: for most of it.
    """

    tilt: float
    heading: float
    since: float | None
    until: float = 0.0
    share: float = 0.0
    lasts: bool = True


COMPARE_ADVICE = "Turn and tilt the vehicle by hand: both attitudes must agree before the next flight."


def source_checks(case: HealthCase) -> list[Check]:
    """Check differences of other onboard attitudes, and which one is wrong."""
    log, segments, reference = case.log, case.segments, case.reference
    flew, name_flew = log.onboard_attitude, str(log.onboard)
    others = {n: a for n, a in log.attitudes.items() if n != log.onboard}
    if flew is None or not others:
        return []
    seen = {n: d for n, a in others.items() if (d := source_difference(flew, a, segments)) is not None}
    if not seen:
        why = f"No other onboard attitude shares enough time with {name_flew} after its first {SETTLED_S:.0f} s."
        return [unknown("second_source", why, SOURCE_LIMIT)]
    off = {n: d for n, d in seen.items() if d.since is not None}
    if not off:
        text = f"{names_text([*seen, name_flew])} show the same tilt and heading."
        return [Check("second_source", "ok", text, 0.0, "deg", SOURCE_LIMIT)]
    name = max(off, key=lambda n: max(off[n].tilt / TILT_DEG[0], off[n].heading / HEADING_DEG[0]))
    worst = off[name]
    same = [
        n
        for n, d in off.items()
        if abs(d.tilt - worst.tilt) < SAME_TILT_DEG and abs(d.heading - worst.heading) < SAME_HEADING_DEG
    ]
    far = worst.tilt > TILT_DEG[1] or worst.heading > HEADING_DEG[1]
    verdict: Verdict = "fault" if far else "warning"
    sizes = [(worst.heading, HEADING_DEG[0], "heading"), (worst.tilt, TILT_DEG[0], "tilt")]
    shown = " and ".join(f"{size:.0f} deg in {what}" for size, least, what in sizes if size > least)
    differ = "differ" if len(same) > 1 else "differs"
    text = f"{difference_time_text(worst, flew)} {names_text(same)} {differ} from {name_flew} by {shown}"
    about = "tilt" if worst.tilt > TILT_DEG[0] else "heading"
    size = worst.heading if worst.heading / HEADING_DEG[0] > worst.tilt / TILT_DEG[0] else worst.tilt
    errors = errors_of_both(reference, log, name, about, worst.since or 0.0)
    who = wrong_source_text(errors, name_flew, names_text(same), reference)
    if errors is not None and who and errors[0] < errors[1]:
        verdict = "warning"
    if not who and about == "heading" and reference is not None and reference.faults.onboard_heading:
        who = f"GNSS acceleration contradicts {name_flew}"
    text += f"; {who}." if who else "; which is right cannot be determined."
    check = Check("second_source", verdict, text, round(size, 1), "deg", SOURCE_LIMIT, t=worst.since, about=about)
    check.t_end, check.action = worst.until, COMPARE_ADVICE
    return [check]


def source_difference(flew: Attitude, other: Attitude, segments: Segments) -> SourceDifference | None:
    """Return the difference of two attitudes, in flight if any; None without common time."""
    t = flew.t if flew.t_sample is None else flew.t_sample
    step = max(1, len(t) // MAX_SAMPLES)
    t, own = t[::step], flew.q[::step]
    q = rotation.slerp(other.t if other.t_sample is None else other.t_sample, other.q, t)
    use = rotation.finite_rows(q) & (t > t[0] + SETTLED_S) & before_crashes(segments, t)
    flown = use & segments.mask(t, "airborne")
    use = flown if flown.sum() >= MIN_SAMPLES else use
    if use.sum() < MIN_SAMPLES:
        return None
    t, q, own = t[use], q[use], own[use]
    down = np.array([0.0, 0.0, 1.0])
    one, two = rotation.rotate_inverse(own, down), rotation.rotate_inverse(q, down)
    tilt = np.degrees(np.arccos(np.clip(np.sum(one * two, axis=1), -1.0, 1.0)))
    turn = rotation.multiply(q, rotation.conjugate(own))
    heading = np.asarray(np.abs(np.degrees(rotation.wrap(2.0 * np.arctan2(turn[:, 3], turn[:, 0])))))
    heading[np.degrees(rotation.tilt_angle(own)) > MAX_HEADING_TILT_DEG] = 0.0
    off = (tilt > TILT_DEG[0]) | (heading > HEADING_DEG[0])
    if off.mean() < OFF_SHARE:
        return SourceDifference(float(median(tilt)), float(median(heading)), None)
    share_after = np.cumsum(off[::-1])[::-1] / np.arange(len(off), 0, -1)
    lasting = np.flatnonzero(off & (share_after > LASTING_SHARE))
    beyond = np.flatnonzero(off)
    first, last = lasting[0] if len(lasting) else beyond[0], beyond[-1]
    share = float(np.mean(off[first : last + 1]))
    sizes = float(median(tilt[off])), float(median(heading[off]))
    return SourceDifference(*sizes, float(t[first]), float(t[last]), share, share > LASTING_SHARE)


def errors_of_both(
    reference: Reference | None, log: FlightLog, name: str, about: str, since: float
) -> tuple[float, float] | None:
    """Return median errors in deg of the attitude in use and another from ``since`` s on.

    None without a reference.
    """
    if reference is None or reference.kind not in REFERENCE_NAMES:
        return None
    found = []
    for attitude in (log.onboard_attitude, log.attitudes[name]):
        assert attitude is not None
        late = attitude.t >= since
        errors = median_errors_deg(reference, attitude, attitude.t[late], attitude.q[late])
        size = np.nan if errors is None else errors[about != "tilt"]
        if not np.isfinite(size):
            return None
        found.append(float(size))
    return found[0], found[1]


def median_errors_deg(reference: Reference, attitude: Attitude, t: Array, q: Array) -> tuple[float, float, int] | None:
    """Return median tilt and heading errors in deg of ``q`` (n, 4) at ``t`` s, and the number of samples.

    With the reference's trim. The heading is NaN without one of the reference's own; None from too few samples.
    """
    trim = reference.alignment.trim
    q = q if trim is None or attitude.has_trim else alignment.apply_trim(q, trim)
    tilt, heading = differences_deg(reference, t, q)
    known = np.isfinite(tilt)
    if known.sum() < MIN_SAMPLES:
        return None
    size = np.abs(heading[known & np.isfinite(heading)])
    own = reference.heading.by == "own" and len(size) >= MIN_SAMPLES
    return float(median(tilt[known])), float(median(size)) if own else np.nan, int(known.sum())


def wrong_source_text(errors: tuple[float, float] | None, flew: str, others: str, reference: Reference | None) -> str:
    """Return which source is wrong by the reference; empty where undecided."""
    if errors is None or reference is None or min(errors) > CLEARLY_BETTER * max(errors):
        return ""
    wrong, right = (flew, others) if errors[0] > errors[1] else (others, flew)
    verb = "is" if wrong == flew or " and " not in others else "are"
    return f"{wrong} {verb} wrong by {REFERENCE_NAMES[reference.kind]}, {right} off by {min(errors):.0f} deg"


def difference_time_text(off: SourceDifference, flew: Attitude) -> str:
    """Format when two attitudes differ: from a time on, between times, or at times."""
    if not off.lasts:
        return f"In {100 * off.share:.0f} % of the time from {off.since or 0.0:.0f} s to {off.until:.0f} s"
    ends = flew.t[-1] - off.until > END_MARGIN_S
    return f"From {off.since or 0.0:.0f} s {f'to {off.until:.0f} s' if ends else 'on'}"


def names_text(names: list[str]) -> str:
    """Join names for a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


# Lanes: cores or instances of the onboard estimator.

LANE_NAME = re.compile(r"(XKQ|NKQ|XKF1|NKF1|estimator_attitude)\.(\d+)$")
# Limit of a lane's error, above that of sound flights; IMUs of one board are aligned within 1 deg.
LANE_TILT_DEG, LANE_HEADING_DEG = 3.0, 10.0
LANE_LIMIT = (
    f"ok: the lane in use is within {LANE_TILT_DEG:.0f} deg in tilt and {LANE_HEADING_DEG:.0f} deg in heading, "
)
LANE_LIMIT += f"or within {1 / CLEARLY_BETTER:.1f} times the best"


class LaneError(NamedTuple):
    """Median errors of a lane in deg in flight over ``n`` samples; unknown heading is NaN."""

    lane: int
    tilt: float
    heading: float
    n: int

    def __str__(self) -> str:
        heading = f" and {self.heading:.1f} deg in heading" if np.isfinite(self.heading) else ""
        return f"Lane {self.lane} is off by {self.tilt:.1f} deg in tilt{heading} (median of {self.n} samples)."


def lane_errors(case: HealthCase) -> list[Check]:
    """Check the lane in use against the others; nothing with one lane or without flight."""
    log, flown, used = case.log, driven_spans(case), case.log.estimator.lane
    lanes = lanes_of(log)
    if len(lanes) < 2 or used is None or not flown:
        return []
    made = partial(Check, "lanes", threshold=LANE_LIMIT, sensor=used.source, source="flights with truth")
    switches, reference = _lane_switches(used, flown), case.reference
    if reference is None or reference.kind not in REFERENCE_NAMES:
        apart = _largest_lane_difference(log, lanes, flown)
        why = (
            f"No truth and no smoother judges the {len(lanes)} lanes; in flight they differ by {apart:.1f} deg at most."
        )
        return [made("unknown", why, evidence=[switches])]
    errors = [e for number, name in sorted(lanes.items()) if (e := _lane_error(log, reference, number, name, flown))]
    mine = next((e for e in errors if e.lane == lane_in_use(used, flown)), None)
    if mine is None or len(errors) < 2:
        return [made("unknown", "The lanes share too little time with the reference.")]
    made = partial(made, n=mine.n, unit="deg", evidence=[*map(str, errors), switches])
    whom = REFERENCE_NAMES[reference.kind]
    for what, limit in (("tilt", LANE_TILT_DEG), ("heading", LANE_HEADING_DEG)):
        size = {e.lane: float(getattr(e, what)) for e in errors}
        own, best = size[mine.lane], min(size, key=lambda lane: np.nan_to_num(size[lane], nan=np.inf))
        if own > limit and size[best] < CLEARLY_BETTER * own:
            text = (
                f"Lane {mine.lane} flew {own:.1f} deg off {whom} in {what}; lane {best} is off by {size[best]:.1f} deg."
            )
            why = "No parameter chooses the better lane: find what misleads the lane in use."
            return [made("warning", text, value=round(own, 1), why_no_setting=why)]
    text = f"Lane {mine.lane} flew and is off by {mine.tilt:.1f} deg in tilt against {whom}; none is clearly better."
    return [made("ok", text, value=round(mine.tilt, 2))]


def lanes_of(log: FlightLog) -> dict[int, str]:
    """Return attitude names by lane number, of the estimator family in use."""
    found: dict[str, dict[int, str]] = {}
    for name in log.attitudes:
        matched = LANE_NAME.match(name)
        if matched:
            found.setdefault(matched.group(1), {})[int(matched.group(2))] = name
    family = "NK" if log.estimator.lane is not None and log.estimator.lane.source.startswith("NK") else "XK"
    names = (f"{family}Q", f"{family}F1", "estimator_attitude")
    return next((found[name] for name in names if len(found.get(name, {})) > 1), {})


def lane_in_use(lane: TimeLine, flown: list[Span]) -> int:
    """Return the lane in use for the longest time in flight."""
    at = np.concatenate([np.arange(a, b, 0.5) for a, b in flown])
    k = np.maximum(np.searchsorted(lane.t, at, side="right") - 1, 0)
    numbers, counts = np.unique(np.asarray(lane.value)[k], return_counts=True)
    return int(numbers[np.argmax(counts)])


def _lane_switches(lane: TimeLine, flown: list[Span]) -> str:
    """Format the lane changes in flight."""
    times = lane.t[1:][inside(lane.t[1:], flown)].tolist()
    if not times:
        return f"Lane {lane_in_use(lane, flown)} flew without a switch."
    if len(times) == 1:
        return f"The lane changed once in flight, at {times[0]:.1f} s."
    return f"The lane changed {len(times)} times in flight, first at {times[0]:.1f} s."


def _lane_error(log: FlightLog, reference: Reference, number: int, name: str, flown: list[Span]) -> LaneError | None:
    errors = median_errors_deg(reference, log.attitudes[name], *_lane_attitude(log, name, flown))
    return None if errors is None else LaneError(number, *errors)


def _lane_attitude(log: FlightLog, name: str, flown: list[Span]) -> tuple[Array, Array]:
    """Return times (n,) s and attitudes (n, 4) of a lane in flight."""
    attitude = log.attitudes[name]
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    use = np.flatnonzero(inside(t, flown) & rotation.finite_rows(attitude.q))
    use = use[:: max(1, len(use) // MAX_SAMPLES)]
    return t[use], attitude.q[use]


def _largest_lane_difference(log: FlightLog, lanes: dict[int, str], flown: list[Span]) -> float:
    """Return the largest median angle in deg in flight from the first lane to another."""
    first, *others = [name for _, name in sorted(lanes.items())]
    t, q = _lane_attitude(log, first, flown)
    found = [0.0]
    for name in others:
        other = log.attitudes[name]
        own = rotation.slerp(other.t if other.t_sample is None else other.t_sample, other.q, t)
        dot = np.abs(np.sum(own * q, axis=1))
        angle = np.degrees(2.0 * np.arccos(np.clip(dot[np.isfinite(dot)], 0.0, 1.0)))
        found += [float(median(angle))] if len(angle) else []
    return max(found)
