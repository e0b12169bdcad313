"""Evaluated time of a row: settled phases, 5 s windows, absence reasons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.core.spans import Span, clipped, complement, intersect
from attlog.flight.model import Imu
from attlog.metrics.metric import Case, per_case, per_object, per_row
from attlog.reference import alignment
from attlog.reference.model import SMOOTHER, Track
from attlog.segments import increments, model

# Phases in the order of the sentences. Never pooled: noise of a filter differs between them by up to ten times.
PHASES = ("rest", "hover", "cruise", "idle")
# Settling time after a row's own start, and after a restart.
SETTLING_S = 10.0
# Settling time after the motors stop: filters still respond to vibration.
SETTLING_AFTER_MOTORS_S = 5.0
# Resets of an onboard attitude on the ground this soon after its first sample are its initial alignment.
ALIGNING_S = 30.0
SHORTEST_S = 2.0  # shortest rest of the segments


@per_case
def unsettled_spans(case: Case, phase: str) -> list[Span]:
    """Return the spans in which filters settle.

    After the first sample and restarts of the record; for rest also after the motors stop.
    """
    continuous = case.segments.spans("all")
    starts = model.restart_times(np.array([x for span in continuous for x in span])[::2]) if continuous else np.zeros(0)
    found = [(float(t), float(t) + SETTLING_S) for t in starts]
    for kind in ("armed", "airborne", "idle") if phase == "rest" else ():
        found += [(t1, t1 + SETTLING_AFTER_MOTORS_S) for _, t1 in case.segments.spans(kind)]
    return found


@per_row
def own_start(case: Case, row: Track) -> float:
    """Return when a row has settled after its own start, s.

    For an onboard attitude: after the resets of its initial alignment.
    """
    start = row.start
    if row.kind == "onboard":
        takeoff = min((t0 for t0, _ in case.segments.spans("airborne")), default=math.inf)
        end = min(takeoff, start + ALIGNING_S)
        start = max([start, *(s.t1 for s in case.segments.of("reset") if s.t1 < end)])
    return start + SETTLING_S


def phase_of(case: Case, window: str) -> str | None:
    """Return the phase of a window, the first in it for ``T0:T1``."""
    if window in ("all", "rest", "rest.long"):
        return "rest"
    if window in PHASES:
        return window
    if ":" in window:
        return next((p for p in PHASES if phase_spans(case, p, window)), "rest")
    return None


@per_case
def phase_spans(case: Case, phase: str, window: str) -> list[Span]:
    """Return the settled spans of a phase inside a window.

    Within continuous segments; in the air also scored.
    """
    allowed = complement(unsettled_spans(case, phase), -math.inf, math.inf)
    if phase in ("hover", "cruise"):
        reference = case.reference
        allowed = intersect(
            allowed, complement(reference.scoring.unscored, reference.scoring.start, reference.scoring.end)
        )
    if ":" in window or window == "rest.long":
        allowed = intersect(allowed, case.segments.spans(window))
    return clipped(intersect(case.segments.spans(phase), allowed), case.segments.spans("all"))


def rest_spans(case: Case, row: Track, window: str) -> list[Span]:
    """Return rest inside a window after the row has settled."""
    return intersect(phase_spans(case, "rest", window), [(own_start(case, row), math.inf)])


def reason_unavailable(case: Case, phase: str, window: str) -> tuple[str, str]:
    """Return code and reason if a phase has no usable time."""
    where = f" in {window} s" if ":" in window else ""
    if phase == "idle":
        if not case.segments.spans("idle"):
            return "no_rest", "the vehicle never stood with its motors turning"
        return "rest_too_short", f"it never stood{where} for 5 s with its motors turning, once the filter had settled"
    if phase in ("hover", "cruise"):
        what = "hover" if phase == "hover" else "flight other than hover"
        if not case.segments.spans(phase):
            return "not_applicable", f"there is no {what} in this log"
        return "record_too_short", f"no 5 s of {what}{where} in which this row is scored without a gap or a turn"
    if not case.segments.spans("rest"):
        return "no_rest", "the vehicle never stood still with motors off for 2 s; record 20 s before arming"
    if window == "rest.long" and not case.segments.spans(window):
        return "no_rest", "no rest of this log is long enough to count as long; record 20 s before arming"
    if ":" in window and not intersect(case.segments.spans("rest"), case.segments.spans(window)):
        return "no_rest", f"there is no rest{where}"
    return "rest_too_short", (
        f"no {SHORTEST_S:.0f} s of rest{where} after the filter settled ({SETTLING_S:.0f} s after its start, "
        f"{SETTLING_AFTER_MOTORS_S:.0f} s after the motors stopped)"
    )


def why_no_errors(case: Case, row: Track, window: str = "") -> tuple[str, str] | None:
    """Return code and reason if a row has no errors, else None."""
    if case.reference.kind == "none" or len(case.reference.t) == 0:
        nothing = "the log holds no attitude to compare with; log the autopilot's attitude (or ground truth)"
        return "no_reference", case.reference.faults.reference or nothing
    if row.is_reference:
        return "not_applicable", "this row is the reference itself"
    if row.errors is None or len(row.errors.t) == 0:
        return "not_covered", row.reason or "this row and the reference have no time in common"
    return None


def why_no_heading(case: Case, row: Track, window: str = "") -> tuple[str, str] | None:
    """Return code and reason if a row's heading cannot be compared."""
    if row.heading_shared:
        return "not_applicable", f"{case.reference.heading.why}, so the reference has its heading from this row"
    if case.reference.heading.by == "none":
        return "no_reference", f"{case.reference.heading.why}, and no other heading can be compared with"
    return None


def why_never_airborne(case: Case) -> str:
    """Return the reason for a log without flight."""
    if not case.log.kind.flies:
        return f"a {case.log.vehicle} does not fly"
    return "the vehicle was never airborne (as far as the log shows)"


# Shared by several metrics: segments of samples, small rotations and lines within them.

Array = NDArray[np.float64]

# Shortest record of a drift in the air (four groups of 5 s), and at rest after settling (four of 2 s).
DRIFT_AIR_S, DRIFT_REST_S = 20.0, 8.0
# Tolerance of a record's length: half a block of 1 s.
DRIFT_SLACK_S = 0.5


def unbroken(t: Array, inside: NDArray[np.bool_], segment_of: NDArray[np.int64] | None = None) -> list[slice]:
    """Return index ranges of marked samples, cut at gaps and segment changes."""
    segment = model.number_segments(t)
    return model.segment_slices(inside, segment if segment_of is None else model.merge_numbers(segment, segment_of))


def within(t: Array, span: Span, segment_of: NDArray[np.int64] | None = None) -> list[slice]:
    """Return unbroken index ranges with span[0] <= t <= span[1]."""
    i, j = int(np.searchsorted(t, span[0], side="left")), int(np.searchsorted(t, span[1], side="right"))
    found = unbroken(t[i:j], np.ones(j - i, bool), None if segment_of is None else segment_of[i:j])
    return [slice(s.start + i, s.stop + i) for s in found]


def covered_seconds(t: Array, segments: list[slice]) -> float:
    """Return the time in s covered by index ranges of ``t`` (n,)."""
    return float(sum(t[s.stop - 1] - t[s.start] for s in segments))


@per_row
def row_segments(case: Case, row: Track) -> NDArray[np.int64]:
    """Return a row's segments (n,) between restarts or, onboard, resets."""
    attitude = case.log.attitudes.get(row.estimator) if row.kind == "onboard" else None
    if attitude is None:
        return row.segment
    jumped = np.zeros(len(attitude.t), np.int64)
    jumped[increments.known_resets(case.log, row.estimator, case.segments)[0]] = 1
    _, _, kept = alignment.usable_samples(attitude, case.reference.alignment.clock)
    return row.segment + np.cumsum(jumped)[kept]


def imu_of(case: Case, row: Track) -> Imu | None:
    """Return a row's replayed IMU; for onboard rows the default one."""
    if row.imu is not None:
        return row.imu
    return case.log.replay_imu


def logged_unit(case: Case, imu: Imu) -> int | None:
    """Return an IMU's index in the log; None for modified samples."""
    return next((k for k, unit in enumerate(case.log.imus) if unit is imu), None)


def detrended(t: Array, x: Array) -> Array:
    """Return ``x`` (n,) or (n, k) without its least-squares line over ``t``."""
    u = t - np.mean(t)
    centred = x - np.mean(x, axis=0)
    slope = np.tensordot(u, centred, axes=(0, 0)) / float(u @ u)
    return np.asarray(centred - (u[:, None] * slope if x.ndim == 2 else u * slope))


def deviations(q: Array) -> Array:
    """Return small rotations (n, 3) in deg from the mean attitude.

    About level roll axis, level pitch axis and down. Body axes are inclined to the vertical: a drift of heading would
    appear as tilt.
    """
    centre = rotation.mean(q)
    away = rotation.earth_error(q, centre)
    heading = rotation.unwrap(rotation.heading_angle(away))
    north, east = rotation.to_rotvec(away)[:, :2].T
    yaw = rotation.to_euler(centre)[2]
    roll, pitch = north * np.cos(yaw) + east * np.sin(yaw), east * np.cos(yaw) - north * np.sin(yaw)
    return np.asarray(np.degrees(np.column_stack([roll, pitch, heading])))


# Windows of 5 s: the unit in which noise is measured, equal for all rows of a log.

# Part of the definition of noise: 1, 2 and 5 s give 0.04, 0.08 and 0.31 deg for one filter in hover.
WINDOW_S = 5.0
# Samples that are processed together.
SAMPLES_AT_ONCE = 1 << 15
MIN_SAMPLES = 20  # the variance of 20 samples has an error of a third
# Smallest gap: in s, and in median sampling intervals.
GAP_S, GAP_STEPS = 0.25, 5.0
# Tolerance of a window's length.
ROUND_S = 0.05


def lay_windows(span: Span, phase: str) -> list[Span]:
    """Return windows of 5 s from the start of a span.

    A rest of 2 to 5 s is one window.
    """
    length = span[1] - span[0]
    count = int((length + ROUND_S) // WINDOW_S)
    if count == 0 and phase == "rest" and length >= SHORTEST_S - ROUND_S:
        return [span]
    return [(span[0] + WINDOW_S * k, span[0] + WINDOW_S * (k + 1)) for k in range(count)]


def filled_samples(t: Array, window: Span) -> slice | None:
    """Return a window's index range of times (n,); None with gaps."""
    i, j = (int(k) for k in np.searchsorted(t, [window[0] - 1e-9, window[1] - 1e-9]))
    if j - i < MIN_SAMPLES:
        return None
    steps = np.diff(t[i:j])
    ends = max(t[i] - window[0], window[1] - t[j - 1] - ROUND_S)
    gap = max(GAP_S, GAP_STEPS * float(median(steps)))
    return slice(i, j) if max(float(np.max(steps)), float(ends)) <= gap else None


@per_row
def known_samples(case: Case, row: Track) -> NDArray[np.bool_]:
    """Return which attitudes (n,) of a row are known."""
    return rotation.finite_rows(row.q)


def sample_batches(inside: Sequence[slice]) -> Iterator[tuple[list[slice], NDArray[np.int64], NDArray[np.int64]]]:
    """Yield batches of index ranges of about SAMPLES_AT_ONCE samples.

    Each: the ranges, the indices of their samples, and the bounds (ranges + 1,) in these.
    """
    ends = np.cumsum([part.stop - part.start for part in inside])
    edges = [0, *(np.flatnonzero(np.diff((ends - 1) // SAMPLES_AT_ONCE)) + 1).tolist(), len(inside)]
    for a, b in pairwise(edges):
        if b > a:
            own = list(inside[a:b])
            lengths = [part.stop - part.start for part in own]
            yield own, np.concatenate([np.arange(p.start, p.stop) for p in own]), np.cumsum([0, *lengths])


@per_object
def windows_of_times(case: Case, t: Array, phase: str, span: Span) -> list[tuple[Span, slice | None]]:
    """Return the windows of a span with the index range of each."""
    return [(window, filled_samples(t, window)) for window in lay_windows(span, phase)]


def row_windows(case: Case, row: Track, phase: str, window: str) -> list[list[tuple[Span, slice]]]:
    """Return the usable windows of a row in a phase, by span."""
    found = [span_windows(case, row, phase, span) for span in phase_spans(case, phase, window)]
    return [group for group in found if group]


def span_windows(case: Case, row: Track, phase: str, span: Span) -> list[tuple[Span, slice]]:
    """Return the usable windows of a row in one span."""
    start, segment, known = own_start(case, row), row_segments(case, row), known_samples(case, row)
    return [
        (w, s)
        for w, s in windows_of_times(case, row.t, phase, span)
        if w[0] >= start - ROUND_S and s is not None and segment[s.start] == segment[s.stop - 1] and known[s].all()
    ]


def why_unproven(case: Case) -> str | None:
    """Return why nothing against an onboard attitude without a smoother is ranked, else None."""
    if case.reference.kind != "onboard" or SMOOTHER not in case.reference.faults.refused:
        return None
    return "the onboard attitude is unproven, the smoother refused"
