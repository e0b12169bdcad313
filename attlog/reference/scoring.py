"""Scored time, errors against the reference, coverage, convergence and divergence."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans, timestamps
from attlog.core.rotation import earth_error, total_angle, unwrap, wrap
from attlog.core.spans import Span
from attlog.flight.model import Attitude
from attlog.reference.model import AttitudeErrors, Reference, ReferenceSamples
from attlog.segments import Segments, model

Array = NDArray[np.float64]

START_S = 15.0  # time for filters to settle
# Where the record is shorter than this, a third of it is left out instead of 15 s.
SHORT_S = 30.0

DIVERGED_DEG, DIVERGED_S = 30.0, 2.0  # tilt error, and time above it
DIVERGED_HEADING_DEG, DIVERGED_HEADING_S = 45.0, 10.0  # heading error, and time above it
CONVERGED_S, CONVERGED_TILT_DEG, CONVERGED_HEADING_DEG = 5.0, 2.0, 5.0  # above the later median
CONVERGED_LIMIT_S = 60.0  # later is not converged
# The reference's heading before and after its reset is the mean over this long.
RESET_S = 1.0
# A jump of an onboard attitude by this much, this soon and before the first flight is its own alignment.
ALIGNED_DEG, ALIGNED_WITHIN_S = 5.0, 60.0


def unscored_seconds(seconds: float) -> float:
    """Return how much of a record of this length is left out before scoring, in s."""
    return START_S if seconds >= SHORT_S else max(seconds, 0.0) / 3.0


def start_and_unscored(t: Array, score_from: float | None) -> tuple[float, list[Span]]:
    """Return the first scored time, and the unscored spans after restarts, of IMU times (n,)."""
    if len(t) == 0:
        return score_from or 0.0, []
    restarts = model.restart_times(t)
    first = float(t[0]) + unscored_seconds(float(t[-1] - t[0])) if score_from is None else score_from
    ends = np.append(restarts[1:], t[-1])
    return first, [
        (float(a), float(a) + unscored_seconds(float(b - a))) for a, b in zip(restarts[1:], ends[1:], strict=True)
    ]


def scored_mask(reference: Reference, t: Array) -> NDArray[np.bool_]:
    """Return which rising times (n,) count in comparisons with the reference."""
    inside = (t >= reference.scoring.start) & (t <= reference.scoring.end)
    for first, last in np.searchsorted(t, reference.scoring.unscored or np.zeros((0, 2))).tolist():
        inside[first:last] = False
    return inside


def coverage_pct(
    t: Array, number: NDArray[np.int64], counted: NDArray[np.bool_], reference: Reference, segments: Segments
) -> float | None:
    """Return the percentage of flight and rest that was scored; None where there is neither.

    ``t`` (n,) are a row's times, ``number`` (n,) their segments between gaps, ``counted`` (n,) what is scored. Each
    counted sample covers the time to the next one of its segment. Seconds after a restart count as missing.
    """
    wanted = spans.merge([*segments.spans("airborne"), *segments.spans("rest")])
    wanted = spans.intersect(
        wanted or segments.spans("all"), [(reference.scoring.start, min(reference.scoring.end, 1e12))]
    )
    total = spans.seconds(wanted)
    if total <= 0:
        return None
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    parts = [p for p in model.segment_slices(counted, number) if p.stop - p.start > 1]
    covered = [(float(t[p.start]) - 0.5 * usual, float(t[p.stop - 1]) + 0.5 * usual) for p in parts]
    return min(100.0, 100.0 * spans.seconds(spans.intersect(covered, wanted)) / total)


def diverged_at(errors: AttitudeErrors) -> float | None:
    """Return the time from which the scored tilt error stays above 30 deg for 2 s; None if never."""
    return _stays_beyond(errors, errors.tilt > DIVERGED_DEG, DIVERGED_S)


def lost_heading_at(errors: AttitudeErrors) -> float | None:
    """Return the time from which the scored heading error stays beyond 45 deg for 10 s; None if never.

    Or the first time that it is, where it is for more than half of the scored time, as in a heading that runs round or
    a short record. The error counts both as it is and as if the reference had not jumped at its resets.
    """
    if not (np.abs(errors.heading) > DIVERGED_HEADING_DEG).any():
        return None
    along = unwrap(np.radians(errors.heading))
    smooth = np.degrees(np.abs(wrap(along - np.cumsum(reset_steps(errors, along)))))
    beyond = np.minimum(np.abs(errors.heading), smooth) > DIVERGED_HEADING_DEG
    stays = _stays_beyond(errors, beyond, DIVERGED_HEADING_S)
    lost = beyond & errors.scored
    if stays is not None or np.count_nonzero(lost) <= 0.5 * np.count_nonzero(errors.scored):
        return stays
    return float(errors.t[np.argmax(lost)]) if np.ptp(errors.t[errors.scored]) >= DIVERGED_S else None


def _stays_beyond(errors: AttitudeErrors, bad: NDArray[np.bool_], seconds: float) -> float | None:
    for part in model.segment_slices(bad & errors.scored, errors.gap_segment):
        if np.ptp(errors.t[part]) >= seconds:
            return float(errors.t[part.start])
    return None


def reset_steps(errors: AttitudeErrors, along: Array) -> Array:
    """Return the jump (n,) in rad of the heading error at each reset of the reference, 0 elsewhere.

    ``along`` (n,) rad is the heading error unwrapped.
    """
    jumps = np.zeros(len(along))
    t, segment = errors.t, errors.segment
    for i in np.flatnonzero((np.diff(segment) != 0) & (np.diff(errors.gap_segment) == 0)) + 1:
        before = slice(max(np.searchsorted(t, t[i - 1] - RESET_S), np.searchsorted(segment, segment[i - 1])), i)
        after = slice(
            i, min(np.searchsorted(t, t[i] + RESET_S, "right"), np.searchsorted(segment, segment[i], "right"))
        )
        jumps[i] = np.mean(along[after]) - np.mean(along[before])
    return jumps


def aligned_at(attitude: Attitude, resets: NDArray[np.int64], segments: Segments) -> float | None:
    """Return when an onboard attitude was aligned: its last early jump of 5 deg before any flight.

    ``resets`` (k,) are indices of its resets. None where it needed none.
    """
    if len(attitude.t) == 0:
        return None
    flown = min((s.t0 for s in segments.of("airborne")), default=np.inf)
    early = resets[(resets > 0) & (attitude.t[resets] < min(attitude.t[0] + ALIGNED_WITHIN_S, flown))]
    size = np.degrees(total_angle(earth_error(attitude.q[early], attitude.q[early - 1])))
    jumped = early[size >= ALIGNED_DEG]
    return float(attitude.t[jumped[-1]]) if len(jumped) else None


def convergence_observable(errors: AttitudeErrors) -> bool:
    """Return whether 5 s pass without a break long enough to end an estimate."""
    whole = model.segment_slices(np.ones(len(errors.t), bool), _unbroken(errors))
    return any(np.ptp(errors.t[part]) >= CONVERGED_S for part in whole)


def _unbroken(errors: AttitudeErrors) -> NDArray[np.int64]:
    """Return segments (n,) between breaks at which filters restart."""
    return model.number_segments(errors.t, max(timestamps.MAX_BRIDGED_GAP_S, timestamps.gap_limit_of_times(errors.t)))


def convergence_s(errors: AttitudeErrors, start: float, with_heading: bool) -> float | None:
    """Return the seconds from ``start`` until convergence; None if over 60 s or not observable.

    The first time from which, for 5 s, the tilt error is at most 2 deg above the median of all scored ones (and the
    heading error 5 deg above its median). One-sided: a filter that is pushed off later has converged at 0 s.
    """
    later = errors.scored if errors.scored.any() else np.ones(len(errors.t), bool)
    if not convergence_observable(errors):
        return None
    good = errors.tilt <= np.median(errors.tilt[later]) + CONVERGED_TILT_DEG
    if with_heading:
        heading = np.abs(errors.heading)
        good &= heading <= np.median(heading[later]) + CONVERGED_HEADING_DEG
    for part in model.segment_slices(good, _unbroken(errors)):
        if np.ptp(errors.t[part]) >= CONVERGED_S:
            took = max(0.0, float(errors.t[part.start]) - start) if part.start > 0 else 0.0
            return took if took <= CONVERGED_LIMIT_S else None
    return None


# Errors of an attitude against the reference, at the times of the slower one.

Index = NDArray[np.int64]

# Attitudes per pass: temporaries stay in the processor's cache and cost long logs no memory.
CHUNK = 1 << 13

# Rates this close count as equal; then the row's own times are used.
SAME_RATE = 1.05


def interpolate(t: Array, q: Array, segment: Index, at: Array) -> tuple[Array, Index]:
    """Return attitudes (m, 4) at times ``at`` and their segments; NaN and -1 across a segment's end.

    ``t`` (n,) ascending, ``q`` (n, 4), ``segment`` (n,). Along the shortest arc between two samples of one segment.
    """
    out, before = rotation.slerp_in_segments(t, q, segment, at)
    return out, np.where(before >= 0, segment[before], -1) if len(t) else before


def errors_against(t: Array, q: Array, gap_segment: Index, reference: Reference) -> AttitudeErrors:
    """Return errors of the attitudes (n, 4) at ``t`` against the reference, at the slower one's times.

    Times at which either would be interpolated across a gap, restart or reset are left out.
    """
    before = reference.samples
    if before is not None and before.of is t and before.own is reference.q:
        number, faster = before.number, before.faster
    else:
        before, number, faster = None, model.number_segments(t), model.sample_rate(t) > SAME_RATE * reference.rate
    own = model.merge_numbers(number, gap_segment)
    q_est, mine = interpolate(t, q, own, reference.t) if faster else (q, own)
    has = rotation.finite_rows(q_est)
    if before is not None and np.array_equal(before.good, before.known & has):
        met = before
    else:
        met = reference.samples = _shared_samples(reference, t, number, faster, has)
    (q_est,), (mine,) = model.select_good(met.good, q_est), model.select_good(met.good, mine)
    gap_segment, segment = (model.merge_numbers(mine, x[met.where]) for x in (reference.gap_segment, reference.segment))
    return attitude_errors(met.t, q_est, met.q, gap_segment, segment, scored_mask(reference, met.t))


def _shared_samples(
    reference: Reference, t: Array, number: Index, faster: bool, has: NDArray[np.bool_]
) -> ReferenceSamples:
    """Return the reference at the times (k,) of the slower one, where a row ``has`` (k,) an attitude."""
    if faster:
        at, q, where = reference.t, reference.q, np.arange(len(reference.t))
    else:
        at, (q, _) = t, interpolate(reference.t, reference.q, reference.segment, t)
        where = np.clip(np.searchsorted(reference.t, at, side="right") - 1, 0, max(len(reference.t) - 1, 0))
    known = rotation.finite_rows(q)
    good = known & has
    (at, q), (where,) = model.select_good(good, at, q), model.select_good(good, where)
    return ReferenceSamples(reference.q, t, number, faster, known, good, at, q, where)


def attitude_errors(
    t: Array, q_est: Array, q_ref: Array, gap_segment: Index, segment: Index, scored: NDArray[np.bool_]
) -> AttitudeErrors:
    """Return the errors between attitudes (n, 4), body to earth, at common times ``t`` (n,) s.

    ``gap_segment``, ``segment`` and ``scored`` (n,) are kept beside them; errors are angles (n,) in deg.
    """
    total, heading, tilt = angles = np.empty((3, len(t)))
    for a in range(0, len(t), CHUNK):
        e = rotation.earth_error(q_est[a : a + CHUNK], q_ref[a : a + CHUNK])
        measures = (rotation.total_angle(e), rotation.heading_angle(e), rotation.tilt_angle(e))
        angles[:, a : a + CHUNK] = np.degrees(measures)
    return AttitudeErrors(t, total, heading, tilt, gap_segment, segment, scored, q_est, q_ref)
