"""How fast does a filter give tilt back where the accelerometer disagrees? Gravity's aiding in steps."""

from __future__ import annotations

import math

from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, applies_to, paragraph
from attlog.metrics.evidence.phases import why_no_errors
from attlog.metrics.steps.fit.solution import MIN_EVENTS
from attlog.metrics.steps.fits import evidence, too_few, why_no_events
from attlog.reference.model import Row

LARGEST_HALF_PER_S, LARGEST_HALF = 0.2, 0.2
"""Answered where half the interval is below 0.2 1/s or 20 % of the value."""

COMMON_PER_S, COMMON = 0.004, 0.02
"""The interval beside its jackknife: scale and noise of the logged gyro pass for aiding. `gyro`, which has none, shows
0.002 to 0.006 1/s, `mahony` up to 1.3 % more than its gain. The jackknife alone held the leak in 84 %."""

METRICS: tuple[Metric, ...] = (
    Metric(
        "leak_per_s",
        "Leak",
        "1/s",
        "low",
        ("reference", "events"),
        paragraph(
            """How fast the row turns its tilt towards the direction that the accelerometer takes for down: rate over
            angle between the two, 1/s; its reciprocal is a time constant. In a step the accelerometer shows
            thrust, not gravity, so this is how fast a true tilt is given back. From the gravity part of the aiding that
            the fit of the lag finds, regressed on that angle over all events. Interval: root sum of squares of the
            jackknife over events, 0.004 1/s and 2 %. Answered where half of it is below 0.2 1/s or 20 %, and where roll
            or pitch moved. A filter that corrects by fixed amounts has a leak that depends on the step."""
        ),
    ),
)


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without steps by definition."""
    if not applies_to(window, "all", "airborne"):
        return {}
    metric = METRICS[0]
    absent = why_no_errors(case, row) or why_no_events(case, row, window)
    return {metric.name: missing(*absent, metric.unit, window) if absent else _answer(case, row, window)}


def _answer(case: Case, row: Row, window: str) -> Answer:
    seen = evidence(case, row, window)
    found = None if seen is None else seen.fits.get("all")
    count = 0 if found is None or seen is None else sum(seen.events[k].axis != 2 for k in found.events)
    if found is None or count < MIN_EVENTS:
        reason = too_few(count, " in roll or pitch")
        return missing("too_few_events", reason, "1/s", window)
    if not math.isfinite(found.leak):
        return missing("not_covered", "no accelerometer samples around the steps", "1/s", window)
    half = math.hypot(found.half_width(3), COMMON_PER_S, COMMON * found.leak)
    if half > max(LARGEST_HALF_PER_S, LARGEST_HALF * abs(found.leak)):
        width = (
            f"{found.leak:.2f} +- {half:.2f} 1/s" if math.isfinite(half) else f"{found.leak:.2f} 1/s without interval"
        )
        reason = f"{width}: the steps do not show it"
        return missing("too_few_events", reason, "1/s", window, fitted=found.leak)
    return Answer(
        found.leak,
        "1/s",
        window,
        len(found.events),
        found.seconds,
        (found.leak - half, found.leak + half),
        f"aiding in {len(found.events)} events, jackknife",
        ranked=False,
        reason="slow is right in a step, fast against gyro drift",
        detail={"time_constant_s": 1.0 / found.leak if abs(found.leak) > half else None},
    )
