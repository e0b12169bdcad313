"""What happens at the end of a step? Overshoot beyond the reference's, and the time until the error stays small."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.metrics import interval, lag
from attlog.metrics.angle_fit import Fit
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, applies_to, paragraph
from attlog.metrics.rmse import why_no_errors
from attlog.reference.model import Row

Array = NDArray[np.float64]

BAND = 0.05

METRICS: tuple[Metric, ...] = (
    Metric(
        "overshoot_pct", "Overshoot", "%", "zero", ("reference", "events"),
        paragraph(
            """How far the row's peak in a step lies beyond the reference's own peak, in percent of the step; mean over
            the events of the lag, t interval. Negative where the row falls short."""
        ),
    ),
    Metric(
        "settling_s", "Settling time", "s", "low", ("reference", "events"),
        paragraph(
            """Time from the onset of a step until the error stays below 5 % of the step for the rest of the event's
            window; 0 where it never exceeds that. Mean over the events of the lag, t interval. Events that do not
            settle within their window count with the window's end."""
        ),
    ),
)  # fmt: skip


def of_events(found: Fit) -> tuple[Array, Array, int]:
    """Overshoot (%) and settling time (s) of each event (events,), and how many did not settle in their window."""
    overshoot, settling, unsettled = [], [], 0
    for pair, offset in zip(found.pairs, found.offsets, strict=True):
        event = pair.event
        slow = len(pair.t_est) < len(pair.t_ref)
        t = pair.t_est if slow else pair.t_ref
        t = t[(t >= event.onset) & (t <= event.end)]
        t = t[(t >= pair.t_est[0]) & (t <= pair.t_est[-1])]
        if len(t) < 2:
            continue
        sign, size = np.sign(event.delta_deg), abs(event.delta_deg)
        ref = sign * np.interp(t, pair.t_ref, pair.ref)
        est = sign * (np.interp(t, pair.t_est, pair.est) - offset)
        overshoot.append(100.0 * float(np.max(est) - np.max(ref)) / size)
        outside = np.flatnonzero(np.abs(est - ref) > BAND * size)
        settling.append(float(t[min(outside[-1] + 1, len(t) - 1)] - event.onset) if len(outside) else 0.0)
        unsettled += bool(len(outside) and outside[-1] == len(t) - 1)
    return np.array(overshoot), np.array(settling), unsettled


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without movements by definition."""
    if not applies_to(window, "all", "airborne"):
        return {}
    absent = why_no_errors(case, row) or lag.why_no_events(case, row, window)
    found = lag.fits(case, row, window).get("all") if absent is None else None
    overshoot, settling, unsettled = (np.zeros(0), np.zeros(0), 0) if found is None else of_events(found)
    if absent is None and len(overshoot) < lag.MIN_EVENTS:
        absent = "too_few_events", f"{len(overshoot)} quick movements; at least {lag.MIN_EVENTS} are needed"
    if absent is not None or found is None:
        code, reason = absent or ("too_few_events", "no event is covered by this row")
        return {m.name: missing(code, reason, m.unit, window) for m in METRICS}
    method = f"mean of {len(overshoot)} events, t interval"
    detail = {"gain": found.gain, "unsettled": unsettled, "each": [float(x) for x in settling]}
    return {
        name: Answer(
            float(np.mean(values)), unit, window, len(values), found.seconds,
            _from_zero(name, interval.of_mean(values)), method,
            detail=detail if name == "settling_s" else {"each": [float(x) for x in values]},
        )
        for name, unit, values in (("overshoot_pct", "%", overshoot), ("settling_s", "s", settling))
    }  # fmt: skip


def _from_zero(name: str, ci95: interval.Interval | None) -> interval.Interval | None:
    """A time cannot be negative, an overshoot can."""
    return (max(ci95[0], 0.0), ci95[1]) if ci95 is not None and name == "settling_s" else ci95
