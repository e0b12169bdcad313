"""Which core or instance of the onboard estimator was the better one, and was it the one in use?"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, FlightLog
from attlog.health.assessments.model import Assessment, HealthCase, unknown
from attlog.health.assessments.onboard import in_flight
from attlog.health.onboard.sources import CLEARLY
from attlog.reference import trim
from attlog.reference.model import Reference
from attlog.reference.smoothed import differences_deg
from attlog.segments.spans import Span, inside

QUESTION = "lanes"
LANE = re.compile(r"(XKQ|NKQ|XKF1|NKF1|estimator_attitude)\.(\d+)$")
TILT_DEG, HEADING_DEG = 3.0, 10.0
"""A lane errs by less than this on sound flights; IMUs of one board are mounted within 1 deg of each other."""
FEWEST, MOST = 20, 4000
LIMIT = f"ok: the lane in use errs by less than {TILT_DEG:.0f} deg in tilt and {HEADING_DEG:.0f} deg in heading, "
LIMIT += f"or by less than {1 / CLEARLY:.1f} times the best"
SOURCE = "flights with truth"


@dataclass(frozen=True, slots=True)
class LaneError:
    """Median errors of a lane in deg against the reference in flight, NaN where that cannot tell; ``n`` samples."""

    lane: int
    tilt: float
    heading: float
    n: int


def assessments(case: HealthCase) -> list[Assessment]:
    """One answer for all lanes; nothing where only one ran or nothing flew."""
    log, flown = case.log, in_flight.flown(case)
    lanes = lanes_of(log)
    if len(lanes) < 2 or log.lane is None or not flown:
        return []
    used = in_use(log, flown)
    switches = _switches(log, flown)
    reference = case.reference
    if reference is None or reference.kind not in ("truth", "smoother"):
        apart = _apart(log, lanes, flown)
        why = (
            f"No truth and no smoother judges the {len(lanes)} lanes; in flight they differ by {apart:.1f} deg at most."
        )
        told = unknown(log.lane.source, QUESTION, why, LIMIT, SOURCE)
        told.evidence = [switches]
        return [told]
    errors = [e for number, name in sorted(lanes.items()) if (e := _error(log, reference, number, name, flown))]
    mine = next((e for e in errors if e.lane == used), None)
    if mine is None or len(errors) < 2:
        return [
            unknown(log.lane.source, QUESTION, "The lanes share too little time with the reference.", LIMIT, SOURCE)
        ]
    told = _judged(log.lane.source, mine, errors, reference)
    told.evidence = [_words(e) for e in errors] + [switches]
    return [told]


def lanes_of(log: FlightLog) -> dict[int, str]:
    """The name of the attitude of each lane by its number; of several families that of the attitude that flew."""
    found: dict[str, dict[int, str]] = {}
    for name in log.attitudes:
        matched = LANE.match(name)
        if matched:
            found.setdefault(matched.group(1), {})[int(matched.group(2))] = name
    family = "NK" if log.lane is not None and log.lane.source.startswith("NK") else "XK"
    for name in (f"{family}Q", f"{family}F1", "estimator_attitude"):
        if len(found.get(name, {})) > 1:
            return found[name]
    return {}


def in_use(log: FlightLog, flown: list[Span]) -> int:
    """The lane that flew longest in flight."""
    assert log.lane is not None
    at = np.concatenate([np.arange(a, b, 0.5) for a, b in flown])
    k = np.maximum(np.searchsorted(log.lane.t, at, side="right") - 1, 0)
    numbers, counts = np.unique(np.asarray(log.lane.value)[k], return_counts=True)
    return int(numbers[np.argmax(counts)])


def _switches(log: FlightLog, flown: list[Span]) -> str:
    """How often the lane changed in flight, in words."""
    assert log.lane is not None
    times = [t for t, ok in zip(log.lane.t[1:].tolist(), inside(log.lane.t[1:], flown), strict=True) if ok]
    if not times:
        return f"Lane {in_use(log, flown)} flew without a switch."
    if len(times) == 1:
        return f"The lane changed once in flight, at {times[0]:.1f} s."
    return f"The lane changed {len(times)} times in flight, first at {times[0]:.1f} s."


def _judged(source: str, mine: LaneError, errors: list[LaneError], reference: Reference) -> Assessment:
    whom = "the truth" if reference.kind == "truth" else "the smoother"
    told = Assessment(source, QUESTION, "ok", "", threshold=LIMIT, source=SOURCE, n=mine.n)
    for what, limit in (("tilt", TILT_DEG), ("heading", HEADING_DEG)):
        own = float(getattr(mine, what))
        best = min(errors, key=lambda e: np.nan_to_num(getattr(e, what), nan=np.inf))
        least = float(getattr(best, what))
        if own > limit and least < CLEARLY * own:
            told.verdict, told.value, told.unit = "warning", round(own, 1), "deg"
            told.text = (
                f"Lane {mine.lane} flew {own:.1f} deg off {whom} in {what}; lane {best.lane} errs by {least:.1f} deg."
            )
            told.why_no_setting = "No parameter chooses the better lane: find what misleads the lane in use."
            return told
    told.text = f"Lane {mine.lane} flew and errs by {mine.tilt:.1f} deg in tilt against {whom}; none is clearly better."
    told.value, told.unit = round(mine.tilt, 2), "deg"
    return told


def _words(e: LaneError) -> str:
    heading = f" and {e.heading:.1f} deg in heading" if np.isfinite(e.heading) else ""
    return f"Lane {e.lane} errs by {e.tilt:.1f} deg in tilt{heading} (median of {e.n} samples in flight)."


def _error(log: FlightLog, reference: Reference, number: int, name: str, flown: list[Span]) -> LaneError | None:
    attitude = log.attitudes[name]
    t, q = _thinned(log, name, flown)
    if reference.trim is not None and not attitude.has_trim:
        q = trim.apply(q, reference.trim)
    tilt, heading = differences_deg(reference, t, q)
    known = np.isfinite(tilt)
    if known.sum() < FEWEST:
        return None
    own = reference.heading_by == "own"
    size = float(np.median(np.abs(heading[known]))) if own else float("nan")
    return LaneError(number, float(np.median(tilt[known])), size, int(known.sum()))


def _thinned(log: FlightLog, name: str, flown: list[Span]) -> tuple[Array, Array]:
    """Times (n,) s and attitudes (n, 4) of a lane in flight."""
    attitude = log.attitudes[name]
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    use = np.flatnonzero(inside(t, flown) & rotation.finite(attitude.q))
    use = use[:: max(1, len(use) // MOST)]
    return t[use], attitude.q[use]


def _apart(log: FlightLog, lanes: dict[int, str], flown: list[Span]) -> float:
    """The largest median angle in deg between the first lane and any other in flight."""
    first, *others = [name for _, name in sorted(lanes.items())]
    t, q = _thinned(log, first, flown)
    found = [0.0]
    for name in others:
        other = log.attitudes[name]
        own = rotation.slerp(other.t if other.t_sample is None else other.t_sample, other.q, t)
        dot = np.abs(np.sum(own * q, axis=1))
        angle = np.degrees(2.0 * np.arccos(np.clip(dot[np.isfinite(dot)], 0.0, 1.0)))
        found += [float(np.median(angle))] if len(angle) else []
    return max(found)
