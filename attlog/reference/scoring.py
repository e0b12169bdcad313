"""What of a log is scored: the start, restarts, the end, coverage, convergence, divergence."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.reference.model import Errors, Reference
from attlog.segments import Segments, gaps, spans
from attlog.segments.spans import Span

Array = NDArray[np.float64]

START_S = 15.0
SHORT_S = 30.0
"""Where the record is shorter than this, a third of it is left out instead of 15 s (METRICS 2.6)."""

DIVERGED_DEG, DIVERGED_S = 30.0, 2.0
"""METRICS 2.7."""
CONVERGED_S, CONVERGED_TILT_DEG, CONVERGED_HEADING_DEG = 5.0, 2.0, 5.0
CONVERGED_LIMIT_S = 60.0
"""METRICS 2.6."""


def settling(seconds: float) -> float:
    """How much of a record of this length is left out before scoring, in s."""
    return START_S if seconds >= SHORT_S else max(seconds, 0.0) / 3.0


def start_and_unscored(t: Array, score_from: float | None) -> tuple[float, list[Span]]:
    """First scored time, and the segments after restarts that are not scored, of IMU times (n,)."""
    if len(t) == 0:
        return score_from or 0.0, []
    restarts = gaps.restarts(t)
    first = float(t[0]) + settling(float(t[-1] - t[0])) if score_from is None else score_from
    ends = np.append(restarts[1:], t[-1])
    return first, [(float(a), float(a) + settling(float(b - a))) for a, b in zip(restarts[1:], ends[1:], strict=True)]


def scored(reference: Reference, t: Array) -> NDArray[np.bool_]:
    """Which times (n,) count in comparisons with the reference."""
    inside = (t >= reference.scoring_start) & (t <= reference.end)
    for t0, t1 in reference.unscored:
        inside &= ~((t >= t0) & (t < t1))
    return inside


def coverage_pct(errors: Errors, reference: Reference, segments: Segments) -> float | None:
    """Share in percent of flight and rest after the scoring start that was scored; None where there is neither.

    Each scored sample covers the time to the next one of its segment. The first seconds
    after a restart are not scored and so count as missing.
    """
    wanted = spans.merge([*segments.spans("airborne"), *segments.spans("rest")])
    wanted = spans.intersect(wanted or segments.spans("all"), [(reference.scoring_start, min(reference.end, 1e12))])
    total = spans.seconds(wanted)
    if total <= 0:
        return None
    t = errors.t
    joined = np.zeros(len(t), bool)
    joined[:-1] = (np.diff(errors.gap_segment) == 0) & errors.scored[:-1] & errors.scored[1:]
    first = np.flatnonzero(joined & ~np.concatenate([[False], joined[:-1]]))
    last = np.flatnonzero(~joined & np.concatenate([[False], joined[:-1]]))
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    covered = [(float(t[a]) - 0.5 * usual, float(t[b]) + 0.5 * usual) for a, b in zip(first, last, strict=True)]
    return min(100.0, 100.0 * spans.seconds(spans.intersect(covered, wanted)) / total)


def diverged_at(errors: Errors) -> float | None:
    """The time from which the scored tilt error stays above 30 deg for 2 s; None if it never does."""
    bad = errors.scored & (errors.inclination > DIVERGED_DEG)
    for part in gaps.slices(bad, errors.gap_segment):
        if np.ptp(errors.t[part]) >= DIVERGED_S:
            return float(errors.t[part.start])
    return None


def convergence_s(errors: Errors, start: float, with_heading: bool) -> float | None:
    """Seconds from ``start`` until the row had converged; None if that took over 60 s or cannot be seen.

    The first time from which, for 5 s, the tilt error is at most 2 deg above the
    median of all scored ones (and the heading error 5 deg above its median).
    One-sided: a filter that starts right and is bent later has converged at 0 s.
    """
    later = errors.scored if errors.scored.any() else np.ones(len(errors.t), bool)
    if len(errors.t) < 2 or errors.t[-1] - errors.t[0] < CONVERGED_S:
        return None
    good = errors.inclination <= np.median(errors.inclination[later]) + CONVERGED_TILT_DEG
    if with_heading:
        heading = np.abs(errors.heading)
        good &= heading <= np.median(heading[later]) + CONVERGED_HEADING_DEG
    for part in gaps.slices(good, np.zeros(len(good), np.int64)):
        if np.ptp(errors.t[part]) >= CONVERGED_S:
            took = max(0.0, float(errors.t[part.start]) - start) if part.start > 0 else 0.0
            return took if took <= CONVERGED_LIMIT_S else None
    return None
