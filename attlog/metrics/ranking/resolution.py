"""Does an answer say anything? One that leaves more open than anybody would assume is no answer.

"No significant drift, below 500 deg/min" is true and of no use: a filter that does nothing at all drifts less. What
is not significantly different from perfect and may lie beyond the metric's ``resolution`` is withheld.
"""

from __future__ import annotations

import math

from attlog.metrics.answer import Answer
from attlog.metrics.base import Metric, Resolution

CODE = "too_uncertain"
ENOUGH_S, ENOUGH_STEPS, ENOUGH_WINDOWS = 300.0, 30, 4
"""A flight of usual length, and the steps that a pilot may be asked for. What would need more is too noisy."""
ORDERS = 100.0
"""The ends of an interval that are further apart than this do not even show how many digits the value has."""
PERFECT = {"zero": 0.0, "one": 1.0}


def withhold(metric: Metric, answer: Answer) -> bool:
    """Take the value away from an answer that says nothing; whether it did. What it was stays in its detail.

    An answer whose interval excludes perfect stays, however wide; records that disagree are a range.
    """
    limit = metric.resolution
    if limit is None or answer.value is None or answer.ci95 is None or answer.disagree is not None:
        return False
    if _resolved(limit, metric.better, *answer.ci95):
        return False
    answer.detail["withheld"] = {"value": answer.value, "ci95": list(answer.ci95)}
    answer.reason = _why(limit, metric.better, answer)
    answer.value, answer.ci95, answer.code, answer.ranked, answer.units = None, None, CODE, False, None
    return True


def _resolved(limit: Resolution, better: str, low: float, high: float) -> bool:
    if better == "low":
        return high <= limit.size or low * ORDERS >= high
    return not low <= PERFECT[better] <= high or _beyond(better, (low, high)) <= limit.size


def _beyond(better: str, ci95: tuple[float, float]) -> float:
    """How far from perfect the farther end of an interval is."""
    return max(abs(end - PERFECT.get(better, 0.0)) for end in ci95)


def _why(limit: Resolution, better: str, answer: Answer) -> str:
    """The reason: too short where more of the same would do, by the square root of its length; else too noisy."""
    times = (_beyond(better, answer.ci95 or (0.0, 0.0)) / limit.size) ** 2
    few, more = "too few", ""
    if limit.evidence == "windows":
        evidence, short = f"{answer.n} window{' is' if answer.n == 1 else 's are'}", answer.n < ENOUGH_WINDOWS
    elif limit.evidence == "steps":
        needed = times * answer.n
        evidence, short = f"{answer.n} steps are", needed <= ENOUGH_STEPS
        more = f"; about {math.ceil(needed)} are needed"
    else:
        needed, few = times * answer.seconds, "too short"
        evidence, short = f"{answer.seconds:.0f} s are", needed <= ENOUGH_S
        more = f"; about {10.0 * math.ceil(needed / 10.0):.0f} s are needed"
    return f"{evidence} {few if short else 'too noisy'} to show even {limit.even}{more if short else ''}"
