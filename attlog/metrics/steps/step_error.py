"""How wrong is the attitude after a step? The angle off about its axis, 0.5 s and 1.0 s later."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, Resolution, Wording, applies_to, paragraph, per_row
from attlog.metrics.evidence.phases import why_no_errors
from attlog.metrics.statistics import intervals as interval
from attlog.metrics.statistics.units import Ids, Summary, UnitValues, ids_of
from attlog.metrics.steps.curves import Curve, curves
from attlog.metrics.steps.fit.solution import MIN_EVENTS
from attlog.metrics.steps.fits import first_with, too_few, why_no_events
from attlog.reference.model import Row

Array = NDArray[np.float64]

AFTER_S = (0.5, 1.0)
NEAR_S = 0.05
"""The error is the mean over so long on both sides, of one sample at least."""

SMOOTHED_DEG = 0.05
"""So much does a smoother's own error change within a second: 0.02 to 0.06 deg (RMS) on six flights with truth."""

_ERROR = """How far the attitude is off {after:.1f} s after a step: the row's error relative to its own
    mean over 0.3 s before the onset, about the axis of the step, {after:.1f} s after 90 % of it (mean over
    +-50 ms). A constant heading offset or misalignment does not count. """
_DEG = _ERROR + "Median of the magnitude over the events that are seen so long; detail: 90 %."
_PCT = _ERROR + "Percent of the step, signed: negative where the row shows too little. Median over events."
_INTERVAL = """ Interval: order statistics, from 6 events on; against the smoother with 2 sigma of 0.05 deg, below
    which rows do not differ."""

_KINDS: tuple[tuple[str, str, Literal["low", "zero"], str, Resolution | None], ...] = (
    ("deg", "deg", "low", _DEG, None),
    ("pct", "%", "zero", _PCT, Resolution(100.0, "an error of the whole step", "steps")),
)

METRICS: tuple[Metric, ...] = tuple(
    Metric(
        f"step_error_{unit}.{after:.1f}s",
        f"Step error after {after:.1f} s",
        sign,
        better,
        ("reference", "events"),
        paragraph(text.format(after=after) + _INTERVAL),
        resolution=resolution,
        wording=Wording("has a", "smaller step error", "larger step error", "step error"),
        covers=True,
    )
    for unit, sign, better, text, resolution in _KINDS
    for after in AFTER_S
)


@dataclass(frozen=True, slots=True)
class EventErrors:
    """Signed errors (k,) in deg of k events with these ids, and their strokes (k,) in deg."""

    ids: Ids
    deg: Array
    stroke: Array


def errors_after(found: list[Curve], after: float) -> EventErrors:
    """The error of each event that is covered ``after`` s past 90 % of its stroke."""
    kept = [(c, e) for c in found if (e := error_at(c, c.event.t90 + after)) is not None]
    return EventErrors(
        ids_of([c.event.onset for c, _ in kept]),
        np.array([e for _, e in kept]),
        np.array([abs(c.event.delta_deg) for c, _ in kept]),
    )


@per_row
def _after(case: Case, row: Row, window: str, after: float) -> EventErrors:
    return errors_after(curves(case, row, window), after)


def error_at(curve: Curve, at: float) -> float | None:
    """The mean error (deg) over +-50 ms around a time in s, the nearest sample's if none is in there.

    None beyond the event's window, which a neighbouring step may have cut.
    """
    near = np.abs(curve.t - at) <= NEAR_S
    if near.any():
        own = curve.error[near]
        return float(own.sum()) / len(own)
    if not curve.t[0] <= at <= curve.t[-1]:
        return None
    return float(curve.error[np.argmin(np.abs(curve.t - at))])


@dataclass(frozen=True, slots=True)
class ErrorOnEvents:
    """The median over a choice of events: magnitude in deg, or signed percent.

    ``sigma``: how wrong the reference may be itself, in that unit.
    """

    errors: EventErrors
    unit: Literal["deg", "pct"]
    sigma: float = 0.0

    def __call__(self, ids: Ids) -> Summary:
        """Median and interval on the events with these ids."""
        values = magnitude(self.errors) if self.unit == "deg" else percent(self.errors)
        chosen = values[np.isin(self.errors.ids, ids)]
        value, ci95 = float(np.median(chosen)), interval.of_median(chosen)
        if ci95 is None:
            return Summary(value, None)
        low, high = interval.with_reference(value, ci95, self.sigma)
        return Summary(value, (max(low, 0.0) if self.unit == "deg" else low, high))


def magnitude(errors: EventErrors) -> Array:
    """Errors without sign (k,), deg."""
    return np.abs(errors.deg)


def percent(errors: EventErrors) -> Array:
    """Signed errors (k,) in percent of the step."""
    return np.asarray(100.0 * errors.deg / errors.stroke)


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without steps by definition."""
    if not applies_to(window, "all", "airborne"):
        return {}
    absent = why_no_errors(case, row) or why_no_events(case, row, window)
    if absent is not None:
        return {m.name: missing(*absent, m.unit, window) for m in METRICS}
    found = curves(case, row, window)
    answers: dict[str, Answer] = {}
    for after in AFTER_S:
        errors = _after(case, row, first_with(case, row, window), after)
        own = SMOOTHED_DEG if case.reference.kind == "smoother" else 0.0
        answers[f"step_error_deg.{after:.1f}s"] = _answer(errors, "deg", window, found, own)
        answers[f"step_error_pct.{after:.1f}s"] = _answer(errors, "pct", window, found, own)
    return {m.name: answers[m.name] for m in METRICS}


def _answer(
    errors: EventErrors, unit: Literal["deg", "pct"], window: str, found: list[Curve], own_deg: float
) -> Answer:
    """The answer in one unit; ``own_deg``: the reference's own error, below which rows are the same."""
    count, sign = len(errors.deg), "deg" if unit == "deg" else "%"
    if count < MIN_EVENTS:
        reason = too_few(count)
        return missing("too_few_events" if count else "no_events", reason, sign, window)
    sigma = own_deg * (100.0 / float(np.median(errors.stroke)) if unit == "pct" else 1.0)
    here = ErrorOnEvents(errors, unit, sigma)
    summary, values = here(errors.ids), percent(errors) if unit == "pct" else magnitude(errors)
    seconds = math.fsum(c.event.end - c.event.begin for c in found)
    return Answer(
        summary.value,
        sign,
        window,
        count,
        seconds,
        summary.ci95,
        f"median of {count} of {len(found)} events, order statistics",
        detail={"p90": np.quantile(np.abs(values), 0.9)},
        each=[float(v) for v in values],
        units=UnitValues("step_event", errors.ids, magnitude(errors), here),
        floor=sigma,
    )
