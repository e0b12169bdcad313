"""What happens at the end of a step? Overshoot beyond the reference's, and the time until the error stays small."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, Resolution, applies_to, paragraph, per_row
from attlog.metrics.evidence.phases import why_no_errors
from attlog.metrics.statistics import intervals as interval
from attlog.metrics.steps.curves import Curve, curves
from attlog.metrics.steps.fit.solution import MIN_EVENTS
from attlog.metrics.steps.fits import first_with, too_few, why_no_events
from attlog.reference.model import Row

Array = NDArray[np.float64]

BAND = 0.05

METRICS: tuple[Metric, ...] = (
    Metric(
        "overshoot_pct",
        "Overshoot",
        "%",
        "zero",
        ("reference", "events"),
        paragraph(
            """How far the row's peak in a step lies beyond the reference's own peak, in percent of the step; mean over
            events, t interval. Negative where the row falls short."""
        ),
        resolution=Resolution(100.0, "an overshoot by the whole step", "steps"),
    ),
    Metric(
        "settling_s",
        "Settling time",
        "s",
        "low",
        ("reference", "events"),
        paragraph(
            """Time from the onset of a step until the error about its axis (0 before the onset) stays below 5 % of
            the step for the rest of the event's window; 0 where it never exceeds that. Mean over events, t interval.
            Events that do not settle within their window count with the window's end."""
        ),
    ),
)


def of_events(found: list[Curve]) -> tuple[Array, Array, int]:
    """Overshoot (%) and settling time (s) of each event (events,), and how many did not settle in their window."""
    overshoot, settling, unsettled = [], [], 0
    for curve in found:
        seconds, size = curve.seconds, abs(curve.event.delta_deg)
        first = int(np.searchsorted(seconds, 0.0))
        since, reference, error = seconds[first:], curve.reference[first:], curve.error[first:]
        if len(since) < 2:
            continue
        overshoot.append(100.0 * float((reference + error).max() - reference.max()) / size)
        outside = np.flatnonzero(np.abs(error) > BAND * size)
        settling.append(float(since[min(outside[-1] + 1, len(since) - 1)]) if len(outside) else 0.0)
        unsettled += bool(len(outside) and outside[-1] == len(since) - 1)
    return np.array(overshoot), np.array(settling), unsettled


@per_row
def _ends(case: Case, row: Row, window: str) -> tuple[Array, Array, int]:
    return of_events(curves(case, row, window))


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without steps by definition."""
    if not applies_to(window, "all", "airborne"):
        return {}
    absent = why_no_errors(case, row) or why_no_events(case, row, window)
    found = curves(case, row, window) if absent is None else []
    overshoot, settling, unsettled = _ends(case, row, first_with(case, row, window)) if found else of_events([])
    if absent is None and len(overshoot) < MIN_EVENTS:
        absent = "too_few_events", too_few(len(overshoot))
    if absent is not None:
        return {m.name: missing(*absent, m.unit, window) for m in METRICS}
    seconds = math.fsum(c.event.end - c.event.begin for c in found)
    method = f"mean of {len(overshoot)} events, t interval"
    detail = {"unsettled": unsettled}
    return {
        name: Answer(
            float(np.mean(values)),
            unit,
            window,
            len(values),
            seconds,
            _from_zero(name, interval.of_mean(values)),
            method,
            detail=detail if name == "settling_s" else {},
            each=[float(x) for x in values],
        )
        for name, unit, values in (("overshoot_pct", "%", overshoot), ("settling_s", "s", settling))
    }


def _from_zero(name: str, ci95: interval.Interval | None) -> interval.Interval | None:
    """A time cannot be negative, an overshoot can."""
    return (max(ci95[0], 0.0), ci95[1]) if ci95 is not None and name == "settling_s" else ci95
