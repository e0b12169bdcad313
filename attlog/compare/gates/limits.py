"""Is an answer beyond a limit? Absolute limits and those beside the onboard attitude by the value; those beside a
baseline so that noise fails no build.

Sizes are compared: where good is zero the absolute value, where good is one (gains) and another answer stands beside it
the distance from one. A limit beside a baseline is exceeded where the size is beyond it **and** the evidence tells it
from the baseline: the 95 % interval of the difference lies on the worse side of zero (of a limit that asks for less
than the baseline: beyond the limit). The interval is

- on the same log that of the pairs of evidence (:mod:`attlog.compare.differences.paired`); a percentile takes the
width of its RMSE's interval (``Metric.decided_by``);
- of two logs, and for metrics without units of evidence, that of independent answers (Zou2008, as
  :mod:`attlog.compare.diff.diff` does for two flights);
- without any interval the size alone decides, but not for "not worse than the baseline" of two logs.

"Not worse than the baseline" allows what :mod:`attlog.compare.diff.tolerance` calls negligible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from attlog.compare.diff.diff import interval
from attlog.compare.diff.tolerance import Tolerances
from attlog.compare.differences.paired import paired
from attlog.metrics.answer import Answer
from attlog.metrics.ranking import best as ranking

Kind = Literal[
    "min", "max", "max_ratio_to_onboard", "max_above_onboard", "max_ratio_to_baseline", "max_above_baseline", "baseline"
]
KINDS: tuple[Kind, ...] = (
    "min",
    "max",
    "max_ratio_to_onboard",
    "max_above_onboard",
    "max_ratio_to_baseline",
    "max_above_baseline",
    "baseline",
)
"""As they are called in a file; ``baseline`` alone means not worse than it."""
ROUNDING = 1e-9
"""A value that differs from its limit by this share is equal to it."""


@dataclass(frozen=True, slots=True)
class GateLimit:
    """One limit. ``value`` in the metric's unit, as a ratio, or 0 for not worse than the baseline."""

    kind: Kind
    value: float

    @property
    def against(self) -> Literal["", "onboard", "baseline"]:
        """What the answer is compared with, if with anything."""
        return "onboard" if self.kind.endswith("onboard") else "baseline" if self.kind.endswith("baseline") else ""

    def __str__(self) -> str:
        return "not worse than baseline" if self.kind == "baseline" else f"{self.kind}={self.value:g}"


@dataclass(frozen=True, slots=True)
class LimitVerdict:
    """Whether an answer keeps a limit. ``allowed``: the size up to (or from) which it does; ``excess``: times beyond.

    ``size``, ``other``: the sizes that were compared. ``at_least``: the smallest size that the evidence allows beside
    the other answer, None without one; ``excused``: beyond the limit, but not significantly.
    """

    passed: bool
    allowed: float
    excess: float
    size: float
    other: float | None = None
    at_least: float | None = None
    excused: bool = False


def judged(
    limit: GateLimit,
    metric: str,
    better: str,
    answer: Answer,
    other: Answer | None = None,
    *,
    same_log: bool = True,
    decided: tuple[Answer, Answer] | None = None,
) -> LimitVerdict:
    """An answer with a value against one limit.

    ``other``: the onboard attitude's or the baseline's answer, with a value. ``decided``: (other, own) answers of the
    metric whose pairing holds for this one too.
    """
    if other is None:
        size = abs(float(answer.value or 0.0)) if better == "zero" else float(answer.value or 0.0)
        return _absolute(limit, size)
    size, before = (ranking.distance(a, better)[1] for a in (answer, other))
    if limit.kind == "baseline":
        allowed = before + max(Tolerances().of(metric, answer.unit, before), ranking.floor(other, answer))
    else:
        allowed = limit.value * before if "ratio" in limit.kind else before + limit.value
    beyond = size > allowed * (1.0 + ROUNDING)
    least = at_least(answer, other, better, same_log, decided) if limit.against == "baseline" else None
    unknown = least is None and limit.kind == "baseline" and not same_log
    failed = beyond and not unknown and (least is None or least > min(before, allowed))
    excess = size / allowed if allowed > 0.0 else math.inf if size > 0.0 else 0.0
    return LimitVerdict(not failed, allowed, excess, size, before, least, beyond and not failed)


def _absolute(limit: GateLimit, size: float) -> LimitVerdict:
    low, high = (limit.value, size) if limit.kind == "min" else (size, limit.value)
    excess = low / high if high > 0.0 else math.inf if low > high else 1.0
    return LimitVerdict(low <= high + ROUNDING * abs(high), limit.value, excess, size)


def at_least(
    answer: Answer, other: Answer, better: str, same_log: bool, decided: tuple[Answer, Answer] | None = None
) -> float | None:
    """The smallest size (95 %) that an answer can have beside another one's; None where nothing tells it."""
    near, size, _ = ranking.distance(answer, better)
    _, before, far = ranking.distance(other, better)
    if same_log and answer.units is not None and other.units is not None:
        found = paired(other, answer, better)
        if not isinstance(found, str) and found.ci95 is not None:
            return before * math.exp(found.ci95[0]) if found.scale == "ratio" else before + found.ci95[0]
    if same_log and decided is not None and decided[0].units is not None and decided[1].units is not None:
        found = paired(*decided, better)
        if not isinstance(found, str) and found.ci95 is not None:
            return size * math.exp(found.ci95[0] - found.value)
    if answer.ci95 is None or other.ci95 is None:
        return None
    span = interval(before, (before, far), size, (near, size))
    return None if span is None else before + span[0]
