"""Do the onboard attitudes agree with each other? A second source far off means that one of them is wrong."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from attlog.core import rotation
from attlog.core.spans import Span, inside
from attlog.flight.model import Array, Attitude, FlightLog
from attlog.health import delays
from attlog.health.check import Check, HealthCase, Verdict, unknown
from attlog.health.flown import before_crashes
from attlog.reference import alignment
from attlog.reference.model import Reference
from attlog.reference.smoother import differences_deg
from attlog.segments.model import Segments

SOURCE_TILT_DEG, SOURCE_HEADING_DEG = (10.0, 30.0), (20.0, 60.0)
"""Where a warning, and where a fault: a backup estimator is coarse, but no compass is 20 deg off for half a flight."""
MAX_HEADING_TILT_DEG = 60.0
"""Heading means nothing beyond this tilt."""
OFF_SHARE, LASTING_SHARE, SETTLED_S = 0.2, 0.9, 15.0
"""Off for a fifth of the time; since the moment after which it is off most of the time; not while it starts."""
END_MARGIN_S = 5.0
"""A difference that ends so long before the attitude has an end of its own."""
MIN_SOURCE_SAMPLES = 20
STANDS_DEG, MOVES_DEG = 0.01, 2.0
"""A source that stands while the onboard attitude moves is an estimator that never ran, such as AHRS3 without EKF3."""
CLEARLY_BETTER = 0.4
"""One of two is wrong where the other has so much of its error at most."""


def source_checks(case: HealthCase) -> list[Check]:
    """How far each other onboard attitude is off for a fifth of the flight, since when, and which of them is wrong.

    ``reference``: truth or a smoother that can tell; nobody else can.
    """
    log, segments, reference = case.log, case.segments, case.reference
    flew = log.onboard_attitude
    others = {n: a for n, a in log.attitudes.items() if n != log.onboard}
    if flew is None or not others:
        return []
    limit = f"ok up to {SOURCE_TILT_DEG[0]:.0f} deg of tilt and {SOURCE_HEADING_DEG[0]:.0f} of heading"
    limit += f", fault above {SOURCE_TILT_DEG[1]:.0f} and {SOURCE_HEADING_DEG[1]:.0f}"
    seen = {n: d for n, a in others.items() if (d := source_difference(flew, a, segments)) is not None}
    if not seen:
        return [
            unknown(
                "second_source",
                f"No other onboard attitude shares enough time with {log.onboard} after its first {SETTLED_S:.0f} s.",
                limit,
            )
        ]
    off = {n: d for n, d in seen.items() if d.since is not None}
    if not off:
        text = f"{names_text([*seen, str(log.onboard)])} show the same tilt and heading."
        return [Check("second_source", "ok", text, 0.0, "deg", limit)]
    name = max(off, key=lambda n: max(off[n].tilt / SOURCE_TILT_DEG[0], off[n].heading / SOURCE_HEADING_DEG[0]))
    worst = off[name]
    same = [n for n, d in off.items() if abs(d.tilt - worst.tilt) < 1.0 and abs(d.heading - worst.heading) < 3.0]
    verdict: Verdict = (
        "fault" if worst.tilt > SOURCE_TILT_DEG[1] or worst.heading > SOURCE_HEADING_DEG[1] else "warning"
    )
    sizes = [(worst.heading, SOURCE_HEADING_DEG[0], "heading"), (worst.tilt, SOURCE_TILT_DEG[0], "tilt")]
    shown = " and ".join(f"{size:.0f} deg in {what}" for size, least, what in sizes if size > least)
    differ = "differ" if len(same) > 1 else "differs"
    since = worst.since or 0.0
    text = f"{difference_time_text(worst, flew)} {names_text(same)} {differ} from {log.onboard} by {shown}"
    about = "tilt" if worst.tilt > SOURCE_TILT_DEG[0] else "heading"
    size = worst.heading if worst.heading / SOURCE_HEADING_DEG[0] > worst.tilt / SOURCE_TILT_DEG[0] else worst.tilt
    errors = errors_of_both(reference, log, name, about, since)
    who = wrong_source_text(errors, str(log.onboard), names_text(same), reference)
    if errors is not None and who and errors[0] < errors[1]:
        verdict = "warning"  # what flew is right
    if not who and about == "heading" and reference is not None and reference.faults.onboard_heading:
        who = f"GNSS acceleration contradicts {log.onboard}"
    text += f"; {who}." if who else "; which is right cannot be determined."
    t, t_end = worst.since, worst.until
    return [Check("second_source", verdict, text, round(size, 1), "deg", limit, t=t, t_end=t_end, about=about)]


def errors_of_both(
    reference: Reference | None, log: FlightLog, name: str, about: str, since: float
) -> tuple[float, float] | None:
    """Median errors in deg of the attitude that flew and of another from ``since`` s on; None where nobody can tell."""
    if reference is None or reference.kind not in ("truth", "smoother"):
        return None
    if about == "heading" and reference.heading.by != "own":
        return None
    found = []
    for attitude in (log.onboard_attitude, log.attitudes[name]):
        assert attitude is not None
        late = attitude.t >= since
        t, q = attitude.t[late], attitude.q[late]
        if reference.alignment.trim is not None and not attitude.has_trim:
            q = alignment.apply_trim(q, reference.alignment.trim)
        tilt, heading = differences_deg(reference, t, q)
        size = np.abs(tilt if about == "tilt" else heading)
        size = size[np.isfinite(size)]
        if len(size) < MIN_SOURCE_SAMPLES:
            return None
        found.append(float(np.median(size)))
    return found[0], found[1]


def wrong_source_text(errors: tuple[float, float] | None, flew: str, others: str, reference: Reference | None) -> str:
    """Who is wrong, by whom; empty where the reference lies near neither or both."""
    if errors is None or reference is None or min(errors) > CLEARLY_BETTER * max(errors):
        return ""
    whom = "the truth" if reference.kind == "truth" else "the smoother"
    wrong, right = (flew, others) if errors[0] > errors[1] else (others, flew)
    verb = "is" if wrong == flew or " and " not in others else "are"
    return f"{wrong} {verb} wrong by {whom}, {right} off by {min(errors):.0f} deg"


def difference_time_text(off: SourceDifference, flew: Attitude) -> str:
    """When two attitudes differ: from its begin on, from then to then, or now and then."""
    if not off.lasts:
        return f"In {100 * off.share:.0f} % of the time from {off.since or 0.0:.0f} s to {off.until:.0f} s"
    ends = flew.t[-1] - off.until > END_MARGIN_S
    return f"From {off.since or 0.0:.0f} s {f'to {off.until:.0f} s' if ends else 'on'}"


def names_text(names: list[str]) -> str:
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
    return float(np.degrees(np.max(rotation.total_angle(rotation.earth_error(q, q[:1])))))


def source_difference(flew: Attitude, other: Attitude, segments: Segments) -> SourceDifference | None:
    """How far two attitudes differ, in flight where there is flight; None without common time."""
    t = flew.t if flew.t_sample is None else flew.t_sample
    step = max(1, len(t) // 4000)
    t, own = t[::step], flew.q[::step]
    q = rotation.slerp(other.t if other.t_sample is None else other.t_sample, other.q, t)
    use = rotation.finite_rows(q) & (t > t[0] + SETTLED_S) & before_crashes(segments, t)
    flown = use & segments.mask(t, "airborne")
    use = flown if flown.sum() >= MIN_SOURCE_SAMPLES else use
    if use.sum() < MIN_SOURCE_SAMPLES:
        return None
    t, q, own = t[use], q[use], own[use]
    if _spread_deg(q) < STANDS_DEG and _spread_deg(own) > MOVES_DEG:
        return None
    down = np.array([0.0, 0.0, 1.0])
    one, two = rotation.rotate_inverse(own, down), rotation.rotate_inverse(q, down)
    tilt = np.degrees(np.arccos(np.clip(np.sum(one * two, axis=1), -1.0, 1.0)))
    heading = np.abs(np.degrees(heading_between(own, q)))
    heading[np.degrees(rotation.tilt_angle(own)) > MAX_HEADING_TILT_DEG] = 0.0
    off = (tilt > SOURCE_TILT_DEG[0]) | (heading > SOURCE_HEADING_DEG[0])
    if off.mean() < OFF_SHARE:
        return SourceDifference(float(np.median(tilt)), float(np.median(heading)), None)
    share_after = np.cumsum(off[::-1])[::-1] / np.arange(len(off), 0, -1)
    lasting = np.flatnonzero(off & (share_after > LASTING_SHARE))
    beyond = np.flatnonzero(off)
    first, last = lasting[0] if len(lasting) else beyond[0], beyond[-1]
    share = float(np.mean(off[first : last + 1]))
    sizes = float(np.median(tilt[off])), float(np.median(heading[off]))
    return SourceDifference(*sizes, float(t[first]), float(t[last]), share, share > LASTING_SHARE)


def heading_between(a: Array, b: Array) -> Array:
    """The rotation (n,) in rad about the vertical that is left between attitudes (n, 4)."""
    step = rotation.multiply(b, rotation.conjugate(a))
    angle: Array = np.asarray(rotation.wrap(2.0 * np.arctan2(step[:, 3], step[:, 0])), np.float64)
    return angle


# Which core or instance of the onboard estimator was the better one, and was it the one in use?

LANES_QUESTION = "lanes"
LANE_NAME = re.compile(r"(XKQ|NKQ|XKF1|NKF1|estimator_attitude)\.(\d+)$")
LANE_TILT_DEG, LANE_HEADING_DEG = 3.0, 10.0
"""A lane errs by less than this on sound flights; IMUs of one board are mounted within 1 deg of each other."""
MIN_LANE_SAMPLES, MAX_LANE_SAMPLES = 20, 4000
LANE_LIMIT = (
    f"ok: the lane in use errs by less than {LANE_TILT_DEG:.0f} deg in tilt and {LANE_HEADING_DEG:.0f} deg in heading, "
)
LANE_LIMIT += f"or by less than {1 / CLEARLY_BETTER:.1f} times the best"
LANE_SOURCE = "flights with truth"


@dataclass(frozen=True, slots=True)
class LaneError:
    """Median errors of a lane in deg against the reference in flight, NaN where that cannot tell; ``n`` samples."""

    lane: int
    tilt: float
    heading: float
    n: int


def lane_errors(case: HealthCase) -> list[Check]:
    """One answer for all lanes; nothing where only one ran or nothing flew."""
    log, flown = case.log, delays.flight_spans(case)
    lanes = lanes_of(log)
    if len(lanes) < 2 or log.estimator.lane is None or not flown:
        return []
    used = lane_in_use(log, flown)
    switches = _lane_switches(log, flown)
    reference = case.reference
    if reference is None or reference.kind not in ("truth", "smoother"):
        apart = _largest_lane_difference(log, lanes, flown)
        why = (
            f"No truth and no smoother judges the {len(lanes)} lanes; in flight they differ by {apart:.1f} deg at most."
        )
        told = unknown(LANES_QUESTION, why, LANE_LIMIT, sensor=log.estimator.lane.source, source=LANE_SOURCE)
        told.evidence = [switches]
        return [told]
    errors = [e for number, name in sorted(lanes.items()) if (e := _lane_error(log, reference, number, name, flown))]
    mine = next((e for e in errors if e.lane == used), None)
    if mine is None or len(errors) < 2:
        return [
            unknown(
                LANES_QUESTION,
                "The lanes share too little time with the reference.",
                LANE_LIMIT,
                sensor=log.estimator.lane.source,
                source=LANE_SOURCE,
            )
        ]
    told = _lane_assessment(log.estimator.lane.source, mine, errors, reference)
    told.evidence = [_lane_text(e) for e in errors] + [switches]
    return [told]


def lanes_of(log: FlightLog) -> dict[int, str]:
    """The name of the attitude of each lane by its number; of several families that of the attitude that flew."""
    found: dict[str, dict[int, str]] = {}
    for name in log.attitudes:
        matched = LANE_NAME.match(name)
        if matched:
            found.setdefault(matched.group(1), {})[int(matched.group(2))] = name
    family = "NK" if log.estimator.lane is not None and log.estimator.lane.source.startswith("NK") else "XK"
    for name in (f"{family}Q", f"{family}F1", "estimator_attitude"):
        if len(found.get(name, {})) > 1:
            return found[name]
    return {}


def lane_in_use(log: FlightLog, flown: list[Span]) -> int:
    """The lane that flew longest in flight."""
    assert log.estimator.lane is not None
    at = np.concatenate([np.arange(a, b, 0.5) for a, b in flown])
    k = np.maximum(np.searchsorted(log.estimator.lane.t, at, side="right") - 1, 0)
    numbers, counts = np.unique(np.asarray(log.estimator.lane.value)[k], return_counts=True)
    return int(numbers[np.argmax(counts)])


def _lane_switches(log: FlightLog, flown: list[Span]) -> str:
    """How often the lane changed in flight, in words."""
    assert log.estimator.lane is not None
    times = [
        t
        for t, ok in zip(log.estimator.lane.t[1:].tolist(), inside(log.estimator.lane.t[1:], flown), strict=True)
        if ok
    ]
    if not times:
        return f"Lane {lane_in_use(log, flown)} flew without a switch."
    if len(times) == 1:
        return f"The lane changed once in flight, at {times[0]:.1f} s."
    return f"The lane changed {len(times)} times in flight, first at {times[0]:.1f} s."


def _lane_assessment(source: str, mine: LaneError, errors: list[LaneError], reference: Reference) -> Check:
    whom = "the truth" if reference.kind == "truth" else "the smoother"
    told = Check(LANES_QUESTION, "ok", "", sensor=source, n=mine.n, threshold=LANE_LIMIT, source=LANE_SOURCE)
    for what, limit in (("tilt", LANE_TILT_DEG), ("heading", LANE_HEADING_DEG)):
        own = float(getattr(mine, what))
        best = min(errors, key=lambda e: np.nan_to_num(getattr(e, what), nan=np.inf))
        least = float(getattr(best, what))
        if own > limit and least < CLEARLY_BETTER * own:
            told.verdict, told.value, told.unit = "warning", round(own, 1), "deg"
            told.text = (
                f"Lane {mine.lane} flew {own:.1f} deg off {whom} in {what}; lane {best.lane} errs by {least:.1f} deg."
            )
            told.why_no_setting = "No parameter chooses the better lane: find what misleads the lane in use."
            return told
    told.text = f"Lane {mine.lane} flew and errs by {mine.tilt:.1f} deg in tilt against {whom}; none is clearly better."
    told.value, told.unit = round(mine.tilt, 2), "deg"
    return told


def _lane_text(e: LaneError) -> str:
    heading = f" and {e.heading:.1f} deg in heading" if np.isfinite(e.heading) else ""
    return f"Lane {e.lane} errs by {e.tilt:.1f} deg in tilt{heading} (median of {e.n} samples in flight)."


def _lane_error(log: FlightLog, reference: Reference, number: int, name: str, flown: list[Span]) -> LaneError | None:
    attitude = log.attitudes[name]
    t, q = _lane_attitude(log, name, flown)
    if reference.alignment.trim is not None and not attitude.has_trim:
        q = alignment.apply_trim(q, reference.alignment.trim)
    tilt, heading = differences_deg(reference, t, q)
    known = np.isfinite(tilt)
    if known.sum() < MIN_LANE_SAMPLES:
        return None
    own = reference.heading.by == "own"
    size = float(np.median(np.abs(heading[known]))) if own else float("nan")
    return LaneError(number, float(np.median(tilt[known])), size, int(known.sum()))


def _lane_attitude(log: FlightLog, name: str, flown: list[Span]) -> tuple[Array, Array]:
    """Times (n,) s and attitudes (n, 4) of a lane in flight."""
    attitude = log.attitudes[name]
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    use = np.flatnonzero(inside(t, flown) & rotation.finite_rows(attitude.q))
    use = use[:: max(1, len(use) // MAX_LANE_SAMPLES)]
    return t[use], attitude.q[use]


def _largest_lane_difference(log: FlightLog, lanes: dict[int, str], flown: list[Span]) -> float:
    """The largest median angle in deg between the first lane and any other in flight."""
    first, *others = [name for _, name in sorted(lanes.items())]
    t, q = _lane_attitude(log, first, flown)
    found = [0.0]
    for name in others:
        other = log.attitudes[name]
        own = rotation.slerp(other.t if other.t_sample is None else other.t_sample, other.q, t)
        dot = np.abs(np.sum(own * q, axis=1))
        angle = np.degrees(2.0 * np.arccos(np.clip(dot[np.isfinite(dot)], 0.0, 1.0)))
        found += [float(np.median(angle))] if len(angle) else []
    return max(found)
