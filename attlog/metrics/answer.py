"""An answer: a number with its evidence, or a code and a sentence that says what is missing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from attlog.metrics.statistics.units import UnitValues

CODES = (
    "no_rest",
    "rest_too_short",
    "no_reference",
    "reference_too_slow",
    "reference_diverged",
    "no_events",
    "too_few_events",
    "no_magnetometer",
    "no_setpoint",
    "no_gnss",
    "not_converged",
    "diverged",
    "not_a_pure_delay",
    "not_covered",
    "clock_unknown",
    "not_applicable",
    "did_not_move",
    "lag_at_edge",
    "rate_too_low",
    "record_too_short",
    "too_uncertain",
    "part_failed",
)


@dataclass(frozen=True, slots=True)
class SpanAnswer:
    """One span of time that a question was put to: [t0, t1] s, how much of it could be used, and what it says.

    ``value`` with ``ci95``, or None and the ``reason``, which says what would be needed.
    """

    t0: float
    t1: float
    usable_s: float
    value: float | None = None
    ci95: tuple[float, float] | None = None
    reason: str | None = None


@dataclass(slots=True)
class Answer:
    """The value of one metric for one row and window.

    With a value: ``n`` independent units of evidence over ``seconds``, ``ci95`` the
    95 % interval. Without: ``code`` (of CODES) and ``reason``. ``ranked`` is False where
    the value is shown but may not be "best"; ``reason`` then says why. ``detail`` holds
    more for people (slopes, flags); nothing is computed from it. In the value's own unit:

    - ``floor``: the difference below which two values are the same, for the ranking
    - ``counts_as_zero_below``: a smaller value is no different from zero
    - ``gyro_share``: what the gyro itself wanders by, of noise that is added to it; variances that differ by less
      than its square are the same
    - ``coverage_pct``: the share of the time that a comparison stands on where that is not nearly all
    - ``each``: the value of every single event; ``records``: each span of time on its own
    - ``disagree``: least and largest of the records where one value does not explain them all
    - ``changes``: first and last rate where the rate itself rises or falls steadily
    - ``taken_out``: what was subtracted because it is not the row's own (the delay of the logged sensors)
    - ``units``: the evidence by which the answer is paired with another on the same log
    """

    value: float | None = None
    unit: str = ""
    window: str = ""
    n: int = 0
    seconds: float = 0.0
    ci95: tuple[float, float] | None = None
    method: str = ""
    code: str | None = None
    reason: str | None = None
    ranked: bool = True
    detail: dict[str, Any] = field(default_factory=dict)
    floor: float = 0.0
    counts_as_zero_below: float = 0.0
    gyro_share: float = 0.0
    coverage_pct: float | None = None
    each: list[float] = field(default_factory=list)
    records: list[SpanAnswer] = field(default_factory=list)
    disagree: tuple[float, float] | None = None
    changes: tuple[float, float] | None = None
    taken_out: float | None = None
    units: UnitValues | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.value is None:
            if self.code not in CODES or not self.reason:
                raise ValueError(
                    f"an absent value needs a code of CODES and a reason, got {self.code!r}, {self.reason!r}"
                )
            self.ranked = False


def missing(code: str, reason: str, unit: str, window: str, **detail: Any) -> Answer:
    """An answer without a value: why, and what would be needed."""
    return Answer(None, unit, window, code=code, reason=reason, detail=detail)
