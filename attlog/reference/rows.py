"""Replayed and onboard attitudes as tracks, aligned and compared with the reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans
from attlog.core.spans import Span
from attlog.estimators.interface import Estimate
from attlog.flight.model import FlightLog
from attlog.reference import alignment, scoring, smoother
from attlog.reference.model import AlignmentStep, Reference, Track
from attlog.reference.scoring import attitude_errors
from attlog.segments import Segments, model, resets

Array = NDArray[np.float64]
# Averaging time of a heading offset without a long rest, and shortest scored part of a long rest.
FIRST_S, LEAST_REST_S = 10.0, 5.0
# Heading origins without a known north: rows are compared without their heading offset.
NO_NORTH = ("nobody", "relative")


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
    row.is_reference = reference.kind == smoother.SMOOTHER and name == smoother.SMOOTHER
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
        aligned = scoring.aligned_at(attitude, resets.known_resets(log, name, segments)[0], segments)
        row.start = float(t[0])
        if aligned is not None:
            row.start = max(row.start, aligned)
            text = "its own alignment: nothing before this jump is scored"
            row.steps.append(AlignmentStep("alignment", text, row.start, "s", attitude.source))
        if row.is_reference:
            counted = scoring.scored_mask(reference, t)
            row.coverage_pct = scoring.coverage_pct(t, row.segment, counted, reference, segments)
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
        row.errors = scoring.errors_against(t, q, row.segment[good], reference)
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
    row.coverage_pct = scoring.coverage_pct(errors.t, errors.gap_segment, errors.scored, reference, segments)
    row.convergence_s = scoring.convergence_s(errors, row.start, own_heading)
    tipped = scoring.diverged_at(errors)
    turned = scoring.lost_heading_at(errors) if own_heading else None
    if tipped is not None:
        row.status = "diverged"
        limit = f"{scoring.DIVERGED_DEG:.0f} deg for {scoring.DIVERGED_S:.0f} s"
        row.reason = f"tilt error above {limit} from {tipped:.1f} s"
    elif turned is not None:
        row.status = "diverged"
        limit = f"{scoring.DIVERGED_HEADING_DEG:.0f} deg for {scoring.DIVERGED_HEADING_S:.0f} s or half of the time"
        row.reason = f"heading error above {limit} from {turned:.1f} s"
    elif row.convergence_s is None and scoring.convergence_observable(errors):
        row.status = "not_converged"
        seen = min(float(errors.t[-1]) - row.start, scoring.CONVERGED_LIMIT_S)
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
    jumps = scoring.reset_steps(errors, along)
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
