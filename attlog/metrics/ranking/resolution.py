"""Does an answer tell anything? One that leaves open more than anybody needs to be told is no answer.

"No drift is told, less than 500 deg/min" is true and of no use: a filter that does nothing at all drifts less. Each
limit is what a reader knows without any log; what is not told apart from perfect and may lie beyond it is withheld.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from attlog.metrics.answer import Answer

CODE = "too_uncertain"
ENOUGH_S, ENOUGH_EVENTS, ENOUGH_WINDOWS = 300.0, 30, 4
"""A flight of usual length, and the movements that a pilot may be asked for. What would need more is too noisy."""
ORDERS = 100.0
"""The ends of an interval that are further apart than this do not even tell how many digits the value has."""
PERFECT = {"zero": 0.0, "one": 1.0}


@dataclass(frozen=True, slots=True)
class Limit:
    """``size``: the distance from perfect that is known without the log; ``even``: what is then not shown, in words."""

    size: float
    even: str


LIMITS: dict[str, Limit] = {
    "drift_": Limit(60.0, "the 60 deg/min that an uncalibrated gyro turns by"),
    # a third of what the attitude loop of a usual autopilot has to spare
    "lag_": Limit(50.0, "a lag of 50 ms"),
    "step_gain": Limit(1.0, "whether the movement is followed at all"),
    "step_error_pct": Limit(100.0, "an error of the whole movement"),
    "overshoot_pct": Limit(100.0, "an overshoot by the whole movement"),
    "gyro_bias_error_dps": Limit(1.0, "the 1 deg/s that an uncalibrated gyro is off by"),
    "noise_": Limit(1.0, "its order of magnitude"),
    "hover_jitter_deg": Limit(5.0, "its order of magnitude"),
}
"""By what metric ids begin with. Errors against the reference are not here: they describe what was flown."""


def withhold(metric: str, better: str, answer: Answer) -> bool:
    """Take the value away from an answer that tells nothing; whether it did. What it was stays in its detail.

    ``better`` is the metric's: zero, one or low. An answer whose interval excludes perfect is told, however wide;
    records that disagree are a range.
    """
    limit = next((one for begin, one in LIMITS.items() if metric.startswith(begin)), None)
    if limit is None or answer.value is None or answer.ci95 is None or answer.disagree is not None:
        return False
    if _tells(limit, better, *answer.ci95):
        return False
    answer.detail["withheld"] = {"value": answer.value, "ci95": list(answer.ci95)}
    answer.reason = _why(metric, limit, better, answer)
    answer.value, answer.ci95, answer.code, answer.ranked, answer.units = None, None, CODE, False, None
    return True


def _tells(limit: Limit, better: str, low: float, high: float) -> bool:
    if better == "low":
        return high <= limit.size or low * ORDERS >= high
    return not low <= PERFECT[better] <= high or _beyond(better, (low, high)) <= limit.size


def _beyond(better: str, ci95: tuple[float, float]) -> float:
    """How far from perfect the farther end of an interval is."""
    return max(abs(end - PERFECT.get(better, 0.0)) for end in ci95)


def _why(metric: str, limit: Limit, better: str, answer: Answer) -> str:
    """The reason: too short where more of the same would do, by the square root of its length; else too noisy."""
    times = (_beyond(better, answer.ci95 or (0.0, 0.0)) / limit.size) ** 2
    in_events = metric.startswith(("lag_", "step_", "overshoot"))
    needed = times * (answer.n if in_events else answer.seconds)
    if better == "low":
        what, more, short = "window" if answer.n == 1 else "windows", "", answer.n < ENOUGH_WINDOWS
        evidence = f"{answer.n} {what} {'is' if answer.n == 1 else 'are'}"
    elif in_events:
        more, short = f"; about {math.ceil(needed)} are needed", needed <= ENOUGH_EVENTS
        evidence = f"{answer.n} quick movements are"
    else:
        more, short = f"; about {10.0 * math.ceil(needed / 10.0):.0f} s are needed", needed <= ENOUGH_S
        evidence = f"{answer.seconds:.0f} s are"
    few = "too few" if in_events or better == "low" else "too short"
    return f"{evidence} {few if short else 'too noisy'} to show even {limit.even}{more if short else ''}"
