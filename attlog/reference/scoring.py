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
# In records shorter than this a third is left out instead of 15 s.
SHORT_S = 30.0

DIVERGED_DEG, DIVERGED_S = 30.0, 2.0  # tilt error, and time above it
DIVERGED_HEADING_DEG, DIVERGED_HEADING_S = 45.0, 10.0  # heading error, and time above it
CONVERGED_S, CONVERGED_TILT_DEG, CONVERGED_HEADING_DEG = 5.0, 2.0, 5.0  # above the later median
CONVERGED_LIMIT_S = 60.0  # later is not converged
# Averaging time of the heading before and after a reset of the reference.
RESET_S = 1.0
# Smallest jump, and latest time after its first sample, of an onboard attitude's initial alignment.
ALIGNED_DEG, ALIGNED_WITHIN_S = 5.0, 60.0


def unscored_seconds(seconds: float) -> float:
    """Return the unscored time in s at the start of a record."""
    return START_S if seconds >= SHORT_S else max(seconds, 0.0) / 3.0


def start_and_unscored(t: Array, score_from: float | None) -> tuple[float, list[Span]]:
    """Return the first scored time, and the unscored spans after restarts."""
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
    """Return the scored percentage of flight and rest; None without either.

    ``t`` (n,): a row's times; ``number`` (n,): their segments between gaps; ``counted`` (n,): scored samples. Each
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
    """Return when the scored tilt error exceeds 30 deg for 2 s."""
    return _stays_beyond(errors, errors.tilt > DIVERGED_DEG, DIVERGED_S)


def lost_heading_at(errors: AttitudeErrors) -> float | None:
    """Return when the scored heading error exceeds 45 deg for 10 s.

    Or the first time above it, if that is more than half of the scored time, as for a heading that rotates or in a
    short record. None if never. The error must be as large without the reference's jumps at its resets.
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
    """Return jumps (n,) in rad of the heading error at reference resets.

    0 elsewhere. ``along`` (n,) rad: the unwrapped heading error.
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
    """Return the time at which an onboard attitude finished its initial alignment.

    Its last jump of 5 deg within 60 s and before any flight; None without one. ``resets`` (k,): indices of its resets.
    """
    if len(attitude.t) == 0:
        return None
    flown = min((s.t0 for s in segments.of("airborne")), default=np.inf)
    early = resets[(resets > 0) & (attitude.t[resets] < min(attitude.t[0] + ALIGNED_WITHIN_S, flown))]
    size = np.degrees(total_angle(earth_error(attitude.q[early], attitude.q[early - 1])))
    jumped = early[size >= ALIGNED_DEG]
    return float(attitude.t[jumped[-1]]) if len(jumped) else None


def convergence_observable(errors: AttitudeErrors) -> bool:
    """Return whether errors cover 5 s without a break that restarts filters."""
    whole = model.segment_slices(np.ones(len(errors.t), bool), _unbroken(errors))
    return any(np.ptp(errors.t[part]) >= CONVERGED_S for part in whole)


def _unbroken(errors: AttitudeErrors) -> NDArray[np.int64]:
    """Return segments (n,) between breaks that restart filters."""
    return model.number_segments(errors.t, max(timestamps.MAX_BRIDGED_GAP_S, timestamps.gap_limit_of_times(errors.t)))


def convergence_s(errors: AttitudeErrors, start: float, with_heading: bool) -> float | None:
    """Return the convergence time in s after ``start``.

    None if over 60 s or not observable. The first time from which, for 5 s, the tilt error is at most 2 deg above its
    scored median (and the heading error 5 deg above its own). One-sided: a filter that is disturbed later converged at
    0 s.
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
    """Return attitudes (m, 4) at times ``at`` and their segments (m,).

    ``t`` (n,) ascending, ``q`` (n, 4), ``segment`` (n,). Slerp between two samples of one segment; NaN and -1
    elsewhere.
    """
    out, before = rotation.slerp_in_segments(t, q, segment, at)
    return out, np.where(before >= 0, segment[before], -1) if len(t) else before


def errors_against(t: Array, q: Array, gap_segment: Index, reference: Reference) -> AttitudeErrors:
    """Return errors of attitudes ``q`` (n, 4) at ``t`` against the reference.

    At the slower one's times. Times that need an interpolation across a gap, restart or reset are left out.
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
    """Return the reference at the times (k,) of the slower one."""
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
    """Return errors between attitudes (n, 4), body to earth, at common times.

    Angles (n,) in deg. ``gap_segment``, ``segment`` and ``scored`` (n,) are passed on.
    """
    total, heading, tilt = angles = np.empty((3, len(t)))
    for a in range(0, len(t), CHUNK):
        e = rotation.earth_error(q_est[a : a + CHUNK], q_ref[a : a + CHUNK])
        measures = (rotation.total_angle(e), rotation.heading_angle(e), rotation.tilt_angle(e))
        angles[:, a : a + CHUNK] = np.degrees(measures)
    return AttitudeErrors(t, total, heading, tilt, gap_segment, segment, scored, q_est, q_ref)
