"""Does an answer tell anything? One that leaves open more than anybody needs to be told is no answer.

"No drift is told, less than 500 deg/min" is true and of no use: a filter that does nothing at all drifts less. Each
limit is what a reader knows without any log; what is not told apart from perfect and may lie beyond it is withheld.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from attlog.metrics.answer import Answer

CODE = "too_uncertain"
ENOUGH_S, ENOUGH_EVENTS = 300.0, 30
"""A flight of usual length, and the movements that a pilot may be asked for. What would need more is too noisy."""
ORDERS = 100.0
"""The ends of an interval that are further apart than this do not even tell how many digits the value has."""
PERFECT = {"zero": 0.0, "one": 1.0}


@dataclass(frozen=True, slots=True)
class Limit:
    """``size``: the distance from perfect that is known without the log; ``shown`` with its unit; ``what`` it is."""

    size: float
    shown: str
    what: str


LIMITS: dict[str, Limit] = {
    "drift_": Limit(60.0, "60 deg/min", "what a gyro that nobody calibrated turns by"),
    "lag_": Limit(50.0, "50 ms", "a third of what the attitude loop of a usual autopilot has to spare"),
    "step_gain": Limit(1.0, "1", "the whole movement"),
    "step_error_pct": Limit(100.0, "100 %", "the whole movement"),
    "overshoot_pct": Limit(100.0, "100 %", "the whole movement"),
    "gyro_bias_error_dps": Limit(1.0, "1 deg/s", "the offset of a gyro that nobody calibrated"),
    "noise_": Limit(1.0, "1 deg", "the whole error of a usual filter"),
    "hover_jitter_deg": Limit(5.0, "5 deg", "more than a vehicle that holds its place moves by"),
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
    if metric.startswith(("lag_", "step_", "overshoot")):
        is_of, needed, enough = _counted(answer.n, "quick movement"), times * answer.n, float(ENOUGH_EVENTS)
        more = _counted(math.ceil(needed), "quick movement")
    else:
        is_of, needed, enough = f"{answer.seconds:.0f} s", times * answer.seconds, ENOUGH_S
        more = f"{10.0 * math.ceil(needed / 10.0):.0f} s"
    why = f"too short; about {more} are needed" if needed <= enough else "too noisy"
    return f"{is_of}, {why} to see even {limit.shown}, {limit.what}"


def _counted(n: int, thing: str) -> str:
    return f"{n} {thing}{'' if n == 1 else 's'}"
