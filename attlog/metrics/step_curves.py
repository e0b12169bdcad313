"""An event as angles about its own axis: what the reference turned since the onset, and how far off the row is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.metrics import step_evidence
from attlog.metrics.base import Case, per_row
from attlog.metrics.step_columns import axis_of
from attlog.metrics.steps import Event
from attlog.metrics.turning import Turning
from attlog.reference.model import Errors, Row

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

    event: Event
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
    return _curves(case, row, step_evidence.first_with(case, row, window))


@dataclass(frozen=True, slots=True)
class Covered:
    """An event: its samples ``own`` (n,) of a row's errors, those ``before`` (m,) its onset, its ``body`` axis (3,)."""

    event: Event
    own: Index
    before: Index
    body: Array


@per_row
def _curves(case: Case, row: Row, window: str) -> list[Curve]:
    return of_events(case, row, step_evidence.events_in(case, row, window))


def of_events(case: Case, row: Row, events: list[Event]) -> list[Curve]:
    """Error rotation q_est q_ref^* against its mean before the onset, about the stroke's axis in earth axes.

    All events at once: a row may have hundreds.
    """
    errors, ref = row.errors, step_evidence.reference_turning(case)
    found = [] if errors is None else [c for c in (_covered(errors, ref, e) for e in events) if c is not None]
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
    apart = np.degrees(rotation.to_rotvec(rotation.multiply(error, rotation.conjugate(start)[of])))
    off = np.split(np.einsum("ni,ni->n", apart, axes[of]), ends[:-1])
    return [
        Curve(c.event, errors.t[c.own], _turned(ref, c, errors.t[c.own]), x) for c, x in zip(found, off, strict=True)
    ]


def _covered(errors: Errors, ref: Turning, event: Event) -> Covered | None:
    """What a row and the reference show of an event without a gap; None where that is too little."""
    body = axis_of(ref, event)
    if body is None:
        return None
    i, j = np.searchsorted(errors.t, [event.begin, event.end], side="left")
    middle = min(int(np.searchsorted(errors.t, event.middle)), len(errors.t) - 1)
    own = np.arange(i, j)[errors.segment[i:j] == errors.segment[middle]]
    own = own[rotation.finite(errors.q_est[own])]
    t = errors.t[own]
    before = own[(t >= event.onset - BEFORE_S) & (t <= event.onset)]
    return None if len(own) < 2 or len(before) == 0 or t[-1] < event.t90 else Covered(event, own, before, body)


def _means(errors: Errors, groups: list[Index]) -> Array:
    """The mean error rotation (k, 4) of each group of samples."""
    own = np.concatenate(groups)
    error = rotation.error(errors.q_est[own], errors.q_ref[own])
    return rotation.means(error, np.cumsum([0, *(len(g) for g in groups)]))


def _turned(ref: Turning, covered: Covered, t: Array) -> Array:
    """What the reference turned (n,) deg about the event's axis since its onset, at times (n,)."""
    event = covered.event
    near = slice(max(int(np.searchsorted(ref.t, t[0])) - 1, 0), int(np.searchsorted(ref.t, t[-1], side="right")) + 1)
    along = math.copysign(1.0, event.delta_deg) * (ref.turned[near] @ covered.body)
    return np.asarray(np.interp(t, ref.t[near], along) - np.interp(event.onset, ref.t[near], along))


def setpoint(case: Case, curve: Curve) -> Array | None:
    """The set-point's turning (n,) deg about the event's axis since the onset; None where none is logged around it."""
    wanted, ref = case.log.setpoints, step_evidence.reference_turning(case)
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
