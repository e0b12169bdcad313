"""Steps: fast attitude changes of the vehicle, found per body axis in the reference's own rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, I1, Out1, Out2
from attlog.core.sorting import median
from attlog.metrics.metric import Case, per_case
from attlog.reference.model import Reference
from attlog.segments import model

Array = NDArray[np.float64]

AXES = ("roll", "pitch", "yaw")
SMALLEST_DEG = (5.0, 5.0, 10.0)  # of roll, pitch and yaw
# An onset is where the rate rises above this share of the stroke's peak rate.
LEVEL = 0.15
QUIET_S = 0.3  # parts a step from the one before
STROKE_S = 1.0  # slower turns are no steps
REST_OF_EVENT_S = 0.7  # a doublet is one event
BEFORE_S, AFTER_S = 0.5, 1.0  # window around onset and 90 %
RUN_AFTER_S = 1.2  # the window and 0.2 s of margin
# The rate is taken over this span: then a logged step of 0.01 deg at 400 Hz is no step.
RATE_SPAN_S = 0.04


class StepEvent(NamedTuple):
    """One step about a body axis: onset, half and 90 % of the stroke, its size, the window to compare in (s)."""

    axis: int
    onset: float
    middle: float
    t90: float
    delta_deg: float
    begin: float
    end: float


def find_steps(t: Array, q: Array, segment: NDArray[np.int64]) -> list[StepEvent]:
    """Return step events of an attitude ``q`` (n, 4) at ``t`` (n,) s in time order; none crosses a segment.

    The stroke is the largest excursion of the integrated body rate within 1 s of the onset, at least 5 deg (yaw 10); an
    onset less than 0.7 s after the last event's 90 % point belongs to that event (docs/metrics.md, Steps).
    """
    events: list[StepEvent] = []
    for own in model.segment_slices(np.ones(len(t), bool), segment):
        if own.stop - own.start < 8 or t[own.stop - 1] - t[own.start] < BEFORE_S + RUN_AFTER_S:
            continue
        turn = np.degrees(rotation.increments(q[own]))
        for axis in range(3):
            events += _cut_to_neighbours(_of_axis(t[own], turn[:, axis], axis))
    return sorted(events, key=lambda e: e.onset)


@per_case
def reference_steps(case: Case) -> list[StepEvent]:
    """Return the events of the reference, cached per case."""
    return scored_steps(case.reference)


def scored_steps(reference: Reference) -> list[StepEvent]:
    """Return the events of a reference after its scoring start and before its end."""
    found = find_steps(reference.t, reference.q, reference.segment) if len(reference.t) else []
    return [e for e in found if e.begin >= reference.scoring.start and e.end <= reference.scoring.end]


def steps_in_window(case: Case, events: list[StepEvent], window: str) -> list[StepEvent]:
    """Return the events whose onset lies in a window."""
    inside = case.segments.mask(np.array([e.onset for e in events]), window)
    return [e for e, ok in zip(events, inside, strict=True) if ok]


def _of_axis(t: Array, turn: Array, axis: int) -> list[StepEvent]:
    angle = np.concatenate([[0.0], np.cumsum(np.nan_to_num(turn))])
    step = float(median(np.diff(t)))
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
        cut[k] = cut[k]._replace(end=min(cut[k].end, halfway))
        cut[k + 1] = cut[k + 1]._replace(begin=max(cut[k + 1].begin, halfway))
    return cut


def _largest_ahead(x: Array, count: int) -> Array:
    """Return the maximum of x[i : i + count] for each i (shorter at the end), by doubling."""
    out, have = x.copy(), 1
    while have < count:
        shift = min(have, count - have)
        if shift >= len(x):
            break
        out = np.concatenate([np.maximum(out[:-shift], out[shift:]), out[-shift:]])
        have += shift
    return out


# How an attitude turns: the sum of its body increments, and the samples around each step.

Index = NDArray[np.int64]


DEG = math.degrees(1.0)
# Squared tangent of half an angle below which a series holds to the last digit: 0.1 rad, as between most samples.
SMALL = 0.0025


# So far before the onset and beyond the 90 % point a step must be covered, s.
REACH_BEFORE_S, REACH_AFTER_S = 0.1, 0.3


@jit.loop("the turning of an attitude")
def summed_turning(out: Out2, q: F2) -> None:
    """Fill ``out`` (n, 3) with the summed rotation vectors in deg of ``q_i^* q_(i+1)`` of attitudes ``q`` (n, 4)."""
    sx, sy, sz = 0.0, 0.0, 0.0
    for i in range(len(q)):
        if i > 0:
            w, x, y, z = q[i - 1, 0], q[i - 1, 1], q[i - 1, 2], q[i - 1, 3]
            e, f, g, h = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
            tx, ty, tz = w * f - x * e - y * h + z * g, w * g + x * h - y * e - z * f, w * h - x * g + y * f - z * e
            cosine, square = w * e + x * f + y * g + z * h, tx * tx + ty * ty + tz * tz
            size, factor = abs(cosine), 2.0
            if square < SMALL * size * size:
                s = square / (size * size)
                factor = 1.0 - s * (
                    1.0 / 3.0 - s * (0.2 - s * (1.0 / 7.0 - s * (1.0 / 9.0 - s * (1.0 / 11.0 - s / 13.0))))
                )
                factor *= 2.0 / size
            elif square > 1e-24:
                sine = math.sqrt(square)
                factor = 2.0 * math.atan2(sine, size) / sine
            factor *= -DEG if cosine < 0.0 else DEG
            sx, sy, sz = sx + factor * tx, sy + factor * ty, sz + factor * tz
        out[i, 0], out[i, 1], out[i, 2] = sx, sy, sz


@jit.loop("the turning in steps")
def about_axes(out: Out2, at: Out1, axes: F2, start: F1, begin: I1, first: I1, t: F1, turned: F2, cross: int) -> None:
    """Fill ``out[:, 0]`` with what is turned (n,) in deg about each event's axis since its first sample.

    Event e has ``axes[e]`` and the samples ``first[e]`` to ``first[e + 1]`` of ``out`` and ``at``, which are those from
    ``begin[e]`` on of ``t`` and ``turned`` (m, 3). ``at`` becomes their time after ``-start[e]``; with ``cross`` the
    next three columns what is turned, times the axis.
    """
    for e in range(len(begin)):
        ux, uy, uz = axes[e, 0], axes[e, 1], axes[e, 2]
        k0 = begin[e]
        for i in range(first[e], first[e + 1]):
            k = k0 + i - first[e]
            x, y, z = turned[k, 0] - turned[k0, 0], turned[k, 1] - turned[k0, 1], turned[k, 2] - turned[k0, 2]
            at[i] = t[k] + start[e]
            out[i, 0] = x * ux + y * uy + z * uz
            if cross == 1:
                out[i, 1], out[i, 2], out[i, 3] = y * uz - z * uy, z * ux - x * uz, x * uy - y * ux


class Timing(NamedTuple):
    """Segment ``number`` (n,) between gaps of times (n,), and their median ``step`` in s."""

    number: Index
    step: float

    @classmethod
    def of(cls, t: Array) -> Timing:
        """Return the timing of times (n,) s."""
        return cls(model.number_segments(t), float(median(np.diff(t))) if len(t) > 1 else math.inf)


@dataclass(slots=True)
class SummedTurning:
    """An attitude over time with its summed turning.

    ``t`` (n,) s, ``q`` (n, 4) finite samples only; ``segment`` (n,) changes at gaps, restarts and left-out samples;
    ``turned`` (n, 3) deg: the rotation vectors of ``q_i^* q_(i+1)`` summed in body axes; ``step`` median interval, s.
    """

    t: Array
    q: Array
    segment: Index
    # What is known of ``t`` where others have the same times.
    timing: Timing | None = None
    turned: Array = field(init=False)
    step: float = field(init=False)

    def __post_init__(self) -> None:
        good = rotation.finite_rows(self.q)
        if good.all():
            timing = self.timing or Timing.of(self.t)
            self.segment = model.merge_numbers(timing.number, self.segment)
        else:
            lost = np.cumsum(~good)[good].astype(np.int64)
            self.t, self.q = self.t[good], self.q[good]
            timing = Timing.of(self.t)
            self.segment = model.merge_numbers(timing.number, self.segment[good], lost)
        self.t, self.q = (np.ascontiguousarray(x, np.float64) for x in (self.t, self.q))
        self.step, self.timing = timing.step, None
        self.turned = np.empty((len(self.t), 3))
        summed_turning(self.turned, self.q)


@dataclass(slots=True)
class EventIndex:
    """Samples of a :class:`SummedTurning` around several events, one event after the other.

    ``index`` (n,) sample numbers, ``of`` (n,) number of the event, ``first`` (events,) where each event begins.
    """

    index: Index
    of: Index
    first: Index


def around(track: SummedTurning, events: Sequence[StepEvent], margin: float) -> list[slice | None]:
    """Return the samples from ``margin`` s before to after each event's window, cut at gaps.

    None where they do not reach from 0.1 s before the onset to 0.3 s after the 90 % point.
    """
    if len(track.t) < 2:
        return [None] * len(events)
    last = len(track.t) - 1
    times = np.array([(e.begin, e.onset, e.middle, e.t90, e.end) for e in events]).reshape(-1, 5)
    begin, onset, middle, t90, close = times.T
    own = track.segment[np.minimum(np.searchsorted(track.t, middle), last)]  # segments are numbered in time
    first = np.maximum(np.searchsorted(track.t, begin - margin), np.searchsorted(track.segment, own))
    end = np.minimum(np.searchsorted(track.t, close + margin), np.searchsorted(track.segment, own, side="right"))
    reaches = (end - first > 1) & (track.t[np.minimum(first, last)] <= onset - REACH_BEFORE_S)
    reaches &= track.t[end - 1] >= np.minimum(t90 + REACH_AFTER_S, close)
    return [slice(i, j) if ok else None for i, j, ok in zip(first.tolist(), end.tolist(), reaches, strict=True)]


def stack_events(parts: Sequence[slice]) -> EventIndex:
    """Return the samples of these ranges one after the other."""
    sizes = np.array([p.stop - p.start for p in parts], np.int64)
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    of = np.repeat(np.arange(len(parts)), sizes)
    start = np.array([p.start for p in parts], np.int64)
    return EventIndex(np.arange(int(sizes.sum())) - first[of] + start[of], of, first)


def event_places(stack: EventIndex) -> tuple[Index, Index]:
    """Return each event's first sample (events,), and where each begins in the stack, and its end (events + 1,)."""
    return stack.index[stack.first], np.append(stack.first, len(stack.index))
