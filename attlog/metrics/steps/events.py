"""Steps: fast attitude changes of the vehicle, found per body axis in the reference's own rate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.metrics.base import Case, per_case
from attlog.reference.model import Reference
from attlog.segments import gaps

Array = NDArray[np.float64]

AXES = ("roll", "pitch", "yaw")
SMALLEST_DEG = (5.0, 5.0, 10.0)
LEVEL = 0.15
"""An onset is where the rate rises above this share of the stroke's peak rate."""
QUIET_S = 0.3
STROKE_S = 1.0
REST_OF_EVENT_S = 0.7
BEFORE_S, AFTER_S = 0.5, 1.0
RUN_AFTER_S = 1.2
RATE_SPAN_S = 0.04
"""The rate is taken over this span: then a logged step of 0.01 deg at 400 Hz is no step."""


@dataclass(frozen=True, slots=True)
class StepEvent:
    """One step about a body axis: onset, half and 90 % of the stroke, its size, the window to compare in (s)."""

    axis: int
    onset: float
    middle: float
    t90: float
    delta_deg: float
    begin: float
    end: float


def find(t: Array, q: Array, segment: NDArray[np.int64]) -> list[StepEvent]:
    """Step events of an attitude ``q`` (n, 4) at ``t`` (n,) s, in time order; no event crosses a segment.

    The stroke is the largest excursion of the integrated body rate within 1 s of the
    onset, at least 5 deg (yaw 10); an onset less than 0.7 s after the last event's
    90 % point belongs to that event (docs/metrics.md, Steps).
    """
    events: list[StepEvent] = []
    for own in gaps.slices(np.ones(len(t), bool), segment):
        if own.stop - own.start < 8 or t[own.stop - 1] - t[own.start] < BEFORE_S + RUN_AFTER_S:
            continue
        turn = np.degrees(rotation.increments(q[own]))
        for axis in range(3):
            events += _cut_to_neighbours(_of_axis(t[own], turn[:, axis], axis))
    return sorted(events, key=lambda e: e.onset)


@per_case
def of_reference(case: Case) -> list[StepEvent]:
    """The events of the reference that every row is judged by: after the scoring start, before the end."""
    return scored(case.reference)


def scored(reference: Reference) -> list[StepEvent]:
    """The events of a reference after its scoring start and before its end."""
    found = find(reference.t, reference.q, reference.segment) if len(reference.t) else []
    return [e for e in found if e.begin >= reference.scoring_start and e.end <= reference.end]


def in_window(case: Case, events: list[StepEvent], window: str) -> list[StepEvent]:
    """The events whose onset lies in a window."""
    inside = case.segments.mask(np.array([e.onset for e in events]), window)
    return [e for e, ok in zip(events, inside, strict=True) if ok]


def _of_axis(t: Array, turn: Array, axis: int) -> list[StepEvent]:
    angle = np.concatenate([[0.0], np.cumsum(np.nan_to_num(turn))])
    step = float(np.median(np.diff(t)))
    if step <= 0:
        return []
    span = max(1, round(RATE_SPAN_S / step))
    elapsed = t[span:] - t[:-span]
    rate = np.abs(angle[span:] - angle[:-span]) / np.maximum(elapsed, 1e-9)
    at = 0.5 * (t[span:] + t[:-span])
    quiet = max(1, round(QUIET_S / step))
    peak = _largest_ahead(rate, max(1, round(STROKE_S / step)))
    before = np.full(len(rate), np.inf)
    before[quiet:] = _largest_ahead(rate, quiet)[: len(rate) - quiet]
    onsets = np.flatnonzero((rate >= LEVEL * peak) & (before < LEVEL * peak) & (peak >= SMALLEST_DEG[axis] / STROKE_S))
    events: list[StepEvent] = []
    for i in onsets:
        onset = float(at[i])
        if onset - BEFORE_S < t[0] or (events and onset < events[-1].t90 + REST_OF_EVENT_S):
            continue
        event = _stroke(t, angle, axis, onset)
        if event is not None and event.t90 + RUN_AFTER_S <= t[-1]:
            events.append(event)
    return events


def _stroke(t: Array, angle: Array, axis: int, onset: float) -> StepEvent | None:
    first, last = np.searchsorted(t, [onset, onset + STROKE_S])
    before = slice(max(int(first) - 1, 0), int(last) + 1)  # alone: interp would look at the whole flight
    excursion = angle[first:last] - np.interp(onset, t[before], angle[before])
    if len(excursion) == 0:
        return None
    delta = float(excursion[np.argmax(np.abs(excursion))])
    if abs(delta) < SMALLEST_DEG[axis]:
        return None
    share = excursion / delta
    middle, t90 = (float(t[first + np.argmax(share >= level)]) for level in (0.5, 0.9))
    return StepEvent(axis, onset, middle, t90, delta, onset - BEFORE_S, t90 + AFTER_S)


def _cut_to_neighbours(events: list[StepEvent]) -> list[StepEvent]:
    cut = list(events)
    for k in range(len(events) - 1):
        halfway = 0.5 * (events[k].t90 + events[k + 1].onset)
        cut[k] = replace(cut[k], end=min(cut[k].end, halfway))
        cut[k + 1] = replace(cut[k + 1], begin=max(cut[k + 1].begin, halfway))
    return cut


def _largest_ahead(x: Array, count: int) -> Array:
    """The maximum of x[i : i + count] for each i (shorter at the end), by doubling."""
    out, have = x.copy(), 1
    while have < count:
        shift = min(have, count - have)
        if shift >= len(x):
            break
        out = np.concatenate([np.maximum(out[:-shift], out[shift:]), out[-shift:]])
        have += shift
    return out
