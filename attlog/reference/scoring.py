"""Tracks of replayed and onboard attitudes, their errors against the reference, coverage, convergence, divergence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans, timestamps
from attlog.core.rotation import earth_error, total_angle, unwrap, wrap
from attlog.core.sorting import median
from attlog.core.spans import Span
from attlog.estimators.interface import Estimate
from attlog.flight.model import Attitude, FlightLog
from attlog.reference import alignment
from attlog.reference.model import SMOOTHER, AlignmentStep, AttitudeErrors, Reference, ReferenceSamples, Track
from attlog.segments import Segments, increments, model
from attlog.segments.model import interpolate_attitudes

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
    usual = float(median(np.diff(t))) if len(t) > 1 else 0.0
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
    good = errors.tilt <= median(errors.tilt[later]) + CONVERGED_TILT_DEG
    if with_heading:
        heading = np.abs(errors.heading)
        good &= heading <= median(heading[later]) + CONVERGED_HEADING_DEG
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
    q_est, mine = interpolate_attitudes(t, q, own, reference.t) if faster else (q, own)
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
        at, (q, _) = t, interpolate_attitudes(reference.t, reference.q, reference.segment, t)
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


# Replayed and onboard attitudes as tracks, aligned and compared with the reference.

# Averaging time of a heading offset without a long rest, and shortest scored part of a long rest.
FIRST_S, LEAST_REST_S = 10.0, 5.0
# Heading origins without a known north: rows are compared without their heading offset.
NO_NORTH = ("none", "relative")


def replayed(
    log: FlightLog,
    segments: Segments,
    reference: Reference,
    estimate: Estimate,
    *,
    name: str,
    kind: Literal["replay", "rerun"] = "replay",
    estimator: str = "",
    parameters: dict[str, Any] | None = None,
    uses_mag: bool = False,
    north_by_gnss: bool = False,
) -> Track:
    """Return an estimate as an aligned track with errors and status."""
    t = np.asarray(estimate.t, np.float64)
    segment = np.zeros(len(t), np.int64) if estimate.segment is None else np.asarray(estimate.segment, np.int64)
    # Where a late compass or GNSS sets the heading the attitude jumps, as at a restart.
    late = estimate.no_heading
    if late:
        segment = segment + np.searchsorted([t1 for _, t1 in late], t, side="right")
    row = Track(
        name,
        kind,
        t,
        rotation.normalize(estimate.q),
        segment,
        uses_mag,
        north_by_gnss,
        causal=estimate.causal,
        bias=estimate.bias,
        skipped=dict(estimate.skipped),
        ns_per_update=estimate.ns_per_update,
        estimator=estimator or name.partition("@")[0],
        parameters=dict(parameters or {}),
    )
    if reference.alignment.trim is not None:
        row.q = alignment.apply_trim(row.q, reference.alignment.trim)
        size = float(np.degrees(np.sqrt(np.sum(reference.alignment.trim**2))))
        row.steps.append(
            AlignmentStep("trim", "taken out once", size, "deg", log.parameters.trim_source, option="config: trim")
        )
    row.is_reference = reference.kind == SMOOTHER and name == SMOOTHER
    no_north = reference.alignment.declination_deg is None and not north_by_gnss
    free_heading = not row.knows_north or no_north or reference.heading.by in NO_NORTH
    if late:
        size = float(sum(t1 - t0 for t0, t1 in late))
        what, name = ("motion", "late_motion") if north_by_gnss else ("field", "late_field")
        text = f"no {what} until then: the heading was unknown, nothing before is scored"
        row.steps.append(AlignmentStep(name, text, size, "s", applied=not free_heading))
    return _measure(row, segments, reference, free_heading, [] if free_heading and not north_by_gnss else late)


def onboard_rows(log: FlightLog, segments: Segments, reference: Reference) -> list[Track]:
    """Return all onboard attitudes as tracks.

    ``onboard`` is the one in use, others are ``onboard:NAME``. The reference is included, marked and without errors; a
    message used as external truth is not. A row that lends its heading to the reference is judged by its tilt alone.
    """
    rows = []
    for name, attitude in log.attitudes.items():
        t, q, _ = alignment.usable_samples(attitude, reference.alignment.clock)
        if len(t) < 2 or (reference.fit is not None and name == reference.fit.name):
            continue
        title = "onboard" if name == log.onboard else f"onboard:{name}"
        row = Track(title, "onboard", t, q, model.number_segments(t), uses_mag=True, estimator=name)
        row.step_deg = attitude.step_deg if attitude.step_deg > 0 else alignment.logged_step_deg(q)
        row.is_reference = reference.kind == "onboard" and reference.name == name
        if reference.alignment.trim is not None and not attitude.has_trim:
            row.q = alignment.apply_trim(row.q, reference.alignment.trim)
            row.steps.append(
                AlignmentStep("trim", "taken out once, as of the replays", source=log.parameters.trim_source)
            )
        aligned = aligned_at(attitude, increments.known_resets(log, name, segments)[0], segments)
        row.start = float(t[0])
        if aligned is not None:
            row.start = max(row.start, aligned)
            text = "its own alignment: nothing before this jump is scored"
            row.steps.append(AlignmentStep("alignment", text, row.start, "s", attitude.source))
        if row.is_reference:
            counted = scored_mask(reference, t)
            row.coverage_pct = coverage_pct(t, row.segment, counted, reference, segments)
            rows.append(row)
        else:
            row.heading_shared = reference.heading.by == "onboard" and name == log.onboard
            rows.append(_measure(row, segments, reference, free_heading=reference.heading.by in NO_NORTH))
    return sorted(rows, key=lambda r: (r.name != "onboard", not r.is_reference))


def _measure(
    row: Track, segments: Segments, reference: Reference, free_heading: bool, unknown: Sequence[Span] = ()
) -> Track:
    """Set errors, heading offset, convergence, coverage and status of a row."""
    good = rotation.finite_rows(row.q)
    first = float(row.t[good][0]) if good.any() else float(row.t[0]) if len(row.t) else 0.0
    row.start = first if row.kind != "onboard" else max(first, row.start)
    lost = np.flatnonzero(~good & (row.t > max(row.start, reference.scoring.start)))
    if reference.kind != "none" and good.any():
        t, q = model.select_good(good, row.t, row.q)
        row.errors = errors_against(t, q, row.segment[good], reference)
        row.errors.scored &= row.errors.t >= row.start
        for t0, t1 in unknown:
            row.errors.scored &= (row.errors.t < t0) | (row.errors.t >= t1)
        if free_heading and len(row.errors.t):
            _remove_heading_offset(row, segments, reference)
        _judge(row, segments, reference)
    if not good.any():
        row.status, row.reason = "failed", "no finite attitude at all"
    elif len(lost):
        bad = np.flatnonzero(~good & (row.t > first))
        for_good = not np.any(np.flatnonzero(good) > lost[0])
        scored = row.errors is not None and bool(row.errors.scored.any())
        row.status = "diverged" if scored else "failed"
        row.reason = f"returned NaN {'' if for_good else f'{len(bad)} times '}from {row.t[bad[0]]:.1f} s on"
    return row


def _judge(row: Track, segments: Segments, reference: Reference) -> None:
    """Set status, convergence and coverage from the errors."""
    errors = row.errors
    if errors is None or len(errors.t) == 0:
        row.coverage_pct = 0.0
        row.reason = f"{row.name} and the reference {reference.source} have no time in common"
        return
    own_heading = row.knows_north and row.heading_offset_deg is None and not row.heading_shared
    row.coverage_pct = coverage_pct(errors.t, errors.gap_segment, errors.scored, reference, segments)
    row.convergence_s = convergence_s(errors, row.start, own_heading)
    tipped = diverged_at(errors)
    turned = lost_heading_at(errors) if own_heading else None
    if tipped is not None:
        row.status = "diverged"
        limit = f"{DIVERGED_DEG:.0f} deg for {DIVERGED_S:.0f} s"
        row.reason = f"tilt error above {limit} from {tipped:.1f} s"
    elif turned is not None:
        row.status = "diverged"
        limit = f"{DIVERGED_HEADING_DEG:.0f} deg for {DIVERGED_HEADING_S:.0f} s or half of the time"
        row.reason = f"heading error above {limit} from {turned:.1f} s"
    elif row.convergence_s is None and convergence_observable(errors):
        row.status = "not_converged"
        seen = min(float(errors.t[-1]) - row.start, CONVERGED_LIMIT_S)
        row.reason = f"had not settled {seen:.0f} s after its start"


def withhold(row: Track, why: str) -> None:
    """Mark a replay as not judged because a sensor is unusable."""
    if why and row.kind == "replay" and row.status in ("ok", "not_converged", "diverged"):
        row.status, row.reason = "not_judged", why


def _remove_heading_offset(row: Track, segments: Segments, reference: Reference) -> None:
    """Remove a track's initial heading offset to the reference.

    The mean difference over the scored part of the first long rest of each segment (else over its first 10 s of
    scoring) is removed from ``q`` and the errors, and reported as a step. Heading jumps of the reference are removed
    from the errors too.
    """
    errors = row.errors
    assert errors is not None
    along = rotation.unwrap(np.radians(errors.heading))
    jumps = reset_steps(errors, along)
    smooth = along - np.cumsum(jumps)
    numbers, place = np.unique(row.segment, return_inverse=True)
    own = place[np.clip(np.searchsorted(row.t, errors.t, side="right") - 1, 0, len(row.t) - 1)]
    offset, sources = np.zeros(len(numbers)), []
    for part in model.segment_slices(np.ones(len(own), bool), own):
        offset[own[part.start]], source = _first_mean(errors.t[part], smooth[part], errors.scored[part], segments)
        sources.append(source)
    turned = rotation.turn_about_down(errors.q_est, -(offset[own] + np.cumsum(jumps)))
    row.errors = attitude_errors(errors.t, turned, errors.q_ref, errors.gap_segment, errors.segment, errors.scored)
    row.q = rotation.turn_about_down(row.q, -offset[place])
    row.heading_offset_deg = float(np.degrees(rotation.wrap(offset[own[0]])))
    text = f"mean heading difference over {sources[0]}, removed"
    text += "; the reference has no north of its own" if reference.heading.by in NO_NORTH else ""
    text += f" in each of {len(sources)} segments" if len(sources) > 1 else ""
    resets = int(np.count_nonzero(jumps))
    text += f"; {resets} resets of the reference not counted" if resets else ""
    row.steps.append(AlignmentStep("heading_offset", text, row.heading_offset_deg, "deg", reference.source))


def _first_mean(t: Array, along: Array, scored: NDArray[np.bool_], segments: Segments) -> tuple[float, str]:
    """Return a segment's initial heading error in rad, and its source."""
    counted = scored if scored.any() else np.ones(len(t), bool)
    for rest in segments.of("rest.long"):
        inside = spans.between(t, rest.t0, rest.t1)
        during = inside.start + np.flatnonzero(counted[inside])
        if len(during) and np.ptp(t[during]) >= LEAST_REST_S:
            return float(np.mean(along[during])), f"the rest from {t[during][0]:.0f} s"
    start = t[counted][0]
    return float(np.mean(along[counted & (t <= start + FIRST_S)])), f"{FIRST_S:.0f} s from {start:.0f} s"
