"""Attitude error after a step, about the axis of the step."""

from __future__ import annotations

import math
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import is_in, median
from attlog.metrics import statistics, step_fit
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, Resolution, Wording, missing, paragraph, per_row
from attlog.metrics.statistics import Ids, Summary, UnitValues, make_ids
from attlog.metrics.step_fit import MIN_EVENTS, too_few, why_no_events
from attlog.metrics.step_products import axes_of, axis_of
from attlog.metrics.step_turning import StepEvent, SummedTurning
from attlog.metrics.windows import why_no_errors, why_unproven
from attlog.reference.model import AttitudeErrors, Track

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Averaging time of the error before the onset, which removes a constant heading offset.
BEFORE_S = 0.3

# Largest gap of a set-point in figures.
SETPOINT_HOLE_S = 0.5


class Curve(NamedTuple):
    """Turning and error of a row in one event, deg.

    At the slower one's times ``t`` (n,) s in the event's window, positive along the stroke. ``reference`` (n,): turning
    of the reference since the onset. ``error`` (n,): the row's error relative to its mean over 0.3 s before the onset,
    negative if the row turns too little.
    """

    event: StepEvent
    t: Array
    reference: Array
    error: Array

    @property
    def row(self) -> Array:
        """Turning (n,) of the row since the onset."""
        return self.reference + self.error

    @property
    def seconds(self) -> Array:
        """Time (n,) since the onset, s."""
        return self.t - self.event.onset


def curves(case: Case, row: Track, window: str) -> list[Curve]:
    """Return the window's events that row and reference cover without a gap."""
    return _curves(case, row, step_fit.first_with(case, row, window))


class EventSamples(NamedTuple):
    """Samples of a row's errors in one event.

    ``own`` (n,): indices in the event, ``before`` (m,): before its onset; ``body`` (3,): axis of the stroke.
    """

    event: StepEvent
    own: Index
    before: Index
    body: Array


@per_row
def _curves(case: Case, row: Track, window: str) -> list[Curve]:
    return event_curves(case, row, step_fit.events_in(case, row, window))


def event_curves(case: Case, row: Track, events: list[StepEvent]) -> list[Curve]:
    """Return the row's error in events, about each stroke's axis.

    The error rotation q_est q_ref^* relative to its mean before the onset. All events are computed at once, as a row
    may have hundreds.
    """
    errors, ref = row.errors, step_fit.reference_turning(case)
    found = [] if errors is None else _all_covered(case, errors, events)
    if errors is None or not found:
        return []
    own, body = np.concatenate([c.own for c in found]), np.array([c.body for c in found])
    ends = np.cumsum([len(c.own) for c in found])
    of = np.repeat(np.arange(len(found)), [len(c.own) for c in found])
    start = _means(errors, [c.before for c in found])
    middle = np.minimum(np.searchsorted(ref.t, [c.event.middle for c in found]), len(ref.t) - 1)
    error = rotation.earth_error(errors.q_est[own], errors.q_ref[own])
    away = np.degrees(rotation.to_rotvec(rotation.multiply(error, rotation.conjugate(start)[of])))
    off = np.split(np.einsum("ni,ni->n", away, rotation.rotate(ref.q[middle], body)[of]), ends[:-1])
    onset = [c.event.onset for c in found]
    turned = np.split(_turned(ref, errors.t[own], body[of]) - _turned(ref, np.array(onset), body)[of], ends[:-1])
    return [Curve(c.event, errors.t[c.own], *x) for c, *x in zip(found, turned, off, strict=True)]


def _all_covered(case: Case, errors: AttitudeErrors, events: list[StepEvent]) -> list[EventSamples]:
    """Return the events that row and reference cover without a gap."""
    if not len(errors.t):
        return []
    ref, broken = step_fit.reference_turning(case), np.zeros(len(errors.t), np.int64)
    np.cumsum((np.diff(errors.segment) != 0) | ~rotation.finite_rows(errors.q_est)[1:], out=broken[1:])
    t, times = errors.t, np.array([(e.begin, e.middle, e.onset, e.t90, e.end) for e in events]).reshape(-1, 5)
    begin, middle, onset, t90, end = times.T
    segment = broken[np.minimum(np.searchsorted(t, middle), len(t) - 1)]  # numbered in time
    i = np.maximum(np.searchsorted(t, begin), np.searchsorted(broken, segment))
    j = np.minimum(np.searchsorted(t, end), np.searchsorted(broken, segment, side="right"))
    first = np.maximum(i, np.searchsorted(t, onset - BEFORE_S))
    last = np.minimum(j, np.searchsorted(t, onset, side="right"))
    axes = axes_of(ref, events) * np.copysign(1.0, [e.delta_deg for e in events])[:, None]
    whole = np.isfinite(axes[:, 0]) & (j - i > 1) & (last > first) & (t[j - 1] >= t90)
    found = []
    for k in np.flatnonzero(whole).tolist():
        own, before = np.arange(i[k], j[k]), np.arange(first[k], last[k])
        found.append(EventSamples(events[k], own, before, axes[k]))
    return found


def _means(errors: AttitudeErrors, groups: list[Index]) -> Array:
    """Return the mean error rotation (k, 4) of each group of samples."""
    own = np.concatenate(groups)
    error = rotation.earth_error(errors.q_est[own], errors.q_ref[own])
    return rotation.group_means(error, np.cumsum([0, *(len(g) for g in groups)]))


def _turned(ref: SummedTurning, t: Array, body: Array) -> Array:
    """Return the reference's summed turning (n,) in deg at times (n,) s about axes ``body`` (n, 3)."""
    return np.asarray(sum(body[:, k] * np.interp(t, ref.t, ref.turned[:, k]) for k in range(3)))


def setpoint(case: Case, curve: Curve) -> Array | None:
    """Return the set-point's turning (n,) deg since an event's onset."""
    wanted, ref = case.log.setpoints.attitude, step_fit.reference_turning(case)
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


# Error about the axis of a step, 0.5 s later.

AFTER_S = 0.5
# Half the averaging time of the error; at least one sample.
NEAR_S = 0.05

# Change of a smoother's own error within a second: 0.02 to 0.06 deg (RMS) on six flights with truth.
SMOOTHED_DEG = 0.05

_ERROR = """How far the attitude is off 0.5 s after a step: the row's error relative to its own mean over 0.3 s before
    the onset, about the axis of the step, 0.5 s after 90 % of it (mean over +-50 ms). A constant heading offset or
    misalignment does not count. """
_DEG = _ERROR + "Median of the magnitude over the events that are seen so long."
_PCT = _ERROR + "Percent of the step, signed: negative where the row shows too little. Median over events."
_INTERVAL = """ Interval: order statistics, from 6 events on; against the smoother with 2 sigma of 0.05 deg, below
    which rows do not differ."""

UNITS: tuple[Literal["deg", "pct"], ...] = ("deg", "pct")
_KINDS: tuple[tuple[str, str, Literal["low", "zero"], str, Resolution | None], ...] = (
    ("deg", "deg", "low", _DEG, None),
    ("pct", "%", "zero", _PCT, Resolution(100.0, "an error of the whole step", "steps")),
)

STEP_ERROR_METRICS: tuple[Metric, ...] = tuple(
    Metric(
        f"step_error_{unit}.0.5s",
        "Step error after 0.5 s",
        sign,
        better,
        paragraph(text + _INTERVAL),
        resolution=resolution,
        wording=Wording("has a", "smaller step error", "larger step error", "step error"),
        covers=True,
    )
    for unit, sign, better, text, resolution in _KINDS
)


class EventErrors(NamedTuple):
    """Signed errors and strokes (k,) in deg of events by id."""

    ids: Ids
    deg: Array
    stroke: Array


def errors_after(found: list[Curve]) -> EventErrors:
    """Return each event's error AFTER_S past 90 % of its stroke."""
    kept = [(c, e) for c in found if (e := error_at(c, c.event.t90 + AFTER_S)) is not None]
    return EventErrors(
        make_ids([c.event.onset for c, _ in kept]),
        np.array([e for _, e in kept]),
        np.array([abs(c.event.delta_deg) for c, _ in kept]),
    )


def error_at(curve: Curve, at: float) -> float | None:
    """Return the mean error (deg) within 50 ms of a time.

    Without samples there, that of the nearest one. None beyond the event's window, which may end early at the next
    step.
    """
    near = np.abs(curve.t - at) <= NEAR_S
    if near.any():
        own = curve.error[near]
        return float(own.sum()) / len(own)
    if not curve.t[0] <= at <= curve.t[-1]:
        return None
    return float(curve.error[np.argmin(np.abs(curve.t - at))])


def error_on_events(errors: EventErrors, values: Array, least: float, sigma: float, ids: Ids) -> Summary:
    """Return the median of ``values`` (k,) on the events ``ids``.

    ``least``: lower limit of the interval. ``sigma``: error of the reference itself, in the unit of the values.
    """
    chosen = values[is_in(errors.ids, ids)]
    value, ci95 = float(median(chosen)), statistics.median_interval(chosen)
    if ci95 is None:
        return Summary(value, None)
    low, high = statistics.widen_by_reference(value, ci95, sigma)
    return Summary(value, (max(low, least), high))


def compute_step_error(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the errors of a row after the steps of a window."""
    found = curves(case, row, window)
    errors = errors_after(found)
    own = SMOOTHED_DEG if case.reference.kind == "smoother" else 0.0
    return {
        m.name: _answer(errors, unit, window, found, own, why_unproven(case))
        for m, unit in zip(STEP_ERROR_METRICS, UNITS, strict=True)
    }


def _answer(
    errors: EventErrors,
    unit: Literal["deg", "pct"],
    window: str,
    found: list[Curve],
    own_deg: float,
    unranked: str | None,
) -> Answer:
    """Return the answer in one unit.

    ``own_deg``: the reference's own error, below which rows are equal. ``unranked``: why no row is ranked, else None.
    """
    count, sign = len(errors.deg), "deg" if unit == "deg" else "%"
    if count < MIN_EVENTS:
        reason = too_few(count)
        return missing("too_few_events" if count else "no_events", reason, sign, window)
    sigma = own_deg * (100.0 / float(median(errors.stroke)) if unit == "pct" else 1.0)
    sizes = np.abs(errors.deg)
    values, least = (100.0 * errors.deg / errors.stroke, -math.inf) if unit == "pct" else (sizes, 0.0)
    here = partial(error_on_events, errors, values, least, sigma)
    summary = here(errors.ids)
    seconds = math.fsum(c.event.end - c.event.begin for c in found)
    return Answer(
        summary.value,
        sign,
        window,
        count,
        seconds,
        summary.ci95,
        f"median of {count} of {len(found)} events, order statistics",
        each=[float(v) for v in values],
        units=UnitValues("step_event", errors.ids, sizes, here),
        floor=sigma,
        reason=unranked,
        ranked=unranked is None,
    )


STEP_ERROR = MetricGroup(
    "step error",
    "Step response",
    STEP_ERROR_METRICS,
    compute_step_error,
    ("all", "airborne"),
    needs=(why_no_errors, why_no_events),
    rests_on=step_fit.first_with,
)
METRIC_GROUPS = (STEP_ERROR,)
