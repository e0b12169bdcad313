"""An event as angles about its own axis: what the reference turned since the onset, and how far off the row is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.metrics.base import Case, per_row, per_times
from attlog.metrics.steps import events as steps
from attlog.metrics.steps import fits as step_fits
from attlog.metrics.steps.events import StepEvent
from attlog.metrics.steps.fit.groups import axis_of
from attlog.metrics.steps.fit.turning import SummedTurning
from attlog.reference.model import AttitudeErrors, Row

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BEFORE_S = 0.3
"""The error before the onset is the mean over this time; a constant heading offset is none."""

SETPOINT_HOLE_S = 0.5
"""A set-point that was not logged for longer is not drawn."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One event at the slower one's times ``t`` (n,) s within its window, in deg, positive along the stroke.

    ``reference`` (n,) is its turning since the onset, ``error`` (n,) the row's error relative to
    its mean over 0.3 s before the onset; negative: the row shows too little.
    """

    event: StepEvent
    t: Array
    reference: Array
    error: Array

    @property
    def row(self) -> Array:
        """What the row turned since the onset (n,)."""
        return self.reference + self.error

    @property
    def seconds(self) -> Array:
        """Time (n,) since the onset."""
        return self.t - self.event.onset


def curves(case: Case, row: Row, window: str) -> list[Curve]:
    """The events of a window that the row and the reference cover without a gap."""
    return _curves(case, row, step_fits.first_with(case, row, window))


@dataclass(frozen=True, slots=True)
class EventSamples:
    """An event: its samples ``own`` (n,) of a row's errors, those ``before`` (m,) its onset, its ``body`` axis (3,).

    ``turned`` (n,) deg: what the reference turned about that axis since the onset.
    """

    event: StepEvent
    own: Index
    before: Index
    body: Array
    turned: Array


@per_row
def _curves(case: Case, row: Row, window: str) -> list[Curve]:
    return of_events(case, row, step_fits.events_in(case, row, window))


def of_events(case: Case, row: Row, events: list[StepEvent]) -> list[Curve]:
    """Error rotation q_est q_ref^* against its mean before the onset, about the stroke's axis in earth axes.

    All events at once: a row may have hundreds.
    """
    errors, ref = row.errors, step_fits.reference_turning(case)
    found = [] if errors is None else _all_covered(case, errors, events)
    if errors is None or not found:
        return []
    own = np.concatenate([c.own for c in found])
    ends = np.cumsum([len(c.own) for c in found])
    of = np.repeat(np.arange(len(found)), [len(c.own) for c in found])
    start = _means(errors, [c.before for c in found])
    middle = np.minimum(np.searchsorted(ref.t, [c.event.middle for c in found]), len(ref.t) - 1)
    axes = rotation.rotate(ref.q[middle], np.array([c.body for c in found]))
    axes *= np.array([math.copysign(1.0, c.event.delta_deg) for c in found])[:, None]
    error = rotation.error(errors.q_est[own], errors.q_ref[own])
    away = np.degrees(rotation.to_rotvec(rotation.multiply(error, rotation.conjugate(start)[of])))
    off = np.split(np.einsum("ni,ni->n", away, axes[of]), ends[:-1])
    return [Curve(c.event, errors.t[c.own], c.turned, x) for c, x in zip(found, off, strict=True)]


def _all_covered(case: Case, errors: AttitudeErrors, events: list[StepEvent]) -> list[EventSamples]:
    """The events that a row and the reference show without a gap; most as any row without one at these times."""
    ref, whole = step_fits.reference_turning(case), _without_gaps(case, errors.t)
    broken = np.zeros(len(errors.t), np.int64)
    np.cumsum((np.diff(errors.segment) != 0) | ~rotation.finite(errors.q_est)[1:], out=broken[1:])
    found = []
    for event in events:
        known = whole[event] if event in whole else _covered(errors.t, broken, ref, event)
        if known is not None and broken[known.own[0]] != broken[known.own[-1]]:
            known = _covered(errors.t, broken, ref, event)
        if known is not None:
            found.append(known)
    return found


@per_times
def _without_gaps(case: Case, t: Array) -> dict[StepEvent, EventSamples | None]:
    """What a row at times (n,) and the reference show of all its events if no gap is in them."""
    ref, unbroken = step_fits.reference_turning(case), np.zeros(len(t), np.int64)
    return {event: _covered(t, unbroken, ref, event) for event in steps.of_reference(case)}


def _covered(t: Array, segment: Index, ref: SummedTurning, event: StepEvent) -> EventSamples | None:
    """What a row at times (n,), in segments (n,) without a gap, and the reference show of an event.

    None where that is too little.
    """
    body = axis_of(ref, event)
    if body is None:
        return None
    i, j = np.searchsorted(t, [event.begin, event.end], side="left")
    if i == j:
        return None
    middle = min(int(np.searchsorted(t, event.middle)), len(t) - 1)
    own = np.arange(i, j)[segment[i:j] == segment[middle]]
    at = t[own]
    before = own[(at >= event.onset - BEFORE_S) & (at <= event.onset)]
    if len(own) < 2 or len(before) == 0 or at[-1] < event.t90:
        return None
    return EventSamples(event, own, before, body, _turned(ref, event, body, at))


def _means(errors: AttitudeErrors, groups: list[Index]) -> Array:
    """The mean error rotation (k, 4) of each group of samples."""
    own = np.concatenate(groups)
    error = rotation.error(errors.q_est[own], errors.q_ref[own])
    return rotation.means(error, np.cumsum([0, *(len(g) for g in groups)]))


def _turned(ref: SummedTurning, event: StepEvent, body: Array, t: Array) -> Array:
    """What the reference turned (n,) deg about the event's axis (3,) since its onset, at times (n,)."""
    near = slice(max(int(np.searchsorted(ref.t, t[0])) - 1, 0), int(np.searchsorted(ref.t, t[-1], side="right")) + 1)
    along = math.copysign(1.0, event.delta_deg) * (ref.turned[near] @ body)
    return np.asarray(np.interp(t, ref.t[near], along) - np.interp(event.onset, ref.t[near], along))


def setpoint(case: Case, curve: Curve) -> Array | None:
    """The set-point's turning (n,) deg about the event's axis since the onset; None where none is logged around it."""
    wanted, ref = case.log.setpoints, step_fits.reference_turning(case)
    body = axis_of(ref, curve.event)
    if wanted is None or len(wanted.t) < 2 or body is None:
        return None
    if curve.t[0] < wanted.t[0] or curve.t[-1] > wanted.t[-1] or _largest_hole(wanted.t, curve.t) > SETPOINT_HOLE_S:
        return None
    q = rotation.slerp(wanted.t, wanted.q, np.append(curve.t, curve.event.onset))
    k = min(int(np.searchsorted(ref.t, curve.event.onset)), len(ref.t) - 1)
    turn = np.degrees(rotation.to_rotvec(rotation.multiply(rotation.conjugate(ref.q[k]), q)))
    return math.copysign(1.0, curve.event.delta_deg) * (turn[:-1] @ body)


def _largest_hole(t: Array, within: Array) -> float:
    i, j = np.searchsorted(t, [within[0], within[-1]])
    return float(np.max(np.diff(t[max(int(i) - 1, 0) : int(j) + 1]), initial=0.0))
