"""The scale of a column of dots: logarithmic for sizes, about zero for what has a sign."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

Span = tuple[float, float]

FAR = 4.0
"""A value so many times the middle one is drawn at the edge."""
APART = 22.0
"""Percent of the width between two ticks, so that their labels do not touch in a narrow column."""
WIDE = 2.5
"""An end of an interval may lie so many times further out than a value."""
EDGE = 3.0
"""Percent of the width left free at both ends."""
LEAST = {"ms": 10.0, "deg/min": 1.0}
"""A scale about zero spans so much at least, so that half a millisecond does not look like much."""
FINE = (1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True)
class DotScale:
    """From ``low`` to ``high``, both positive where ``log``; a place is a percentage of the width."""

    low: float
    high: float
    log: bool

    def place(self, value: float) -> float:
        """Where a value stands; what is beyond the scale stands at its edge."""
        low, high = (math.log10(self.low), math.log10(self.high)) if self.log else (self.low, self.high)
        if self.log:
            value = math.log10(value) if value > 0.0 else low
        share = (value - low) / (high - low)
        return round(min(max(EDGE + (100.0 - 2.0 * EDGE) * share, 0.5), 99.5), 2)

    def holds(self, value: float) -> bool:
        """Whether a value lies on the scale."""
        return self.low <= value <= self.high

    @property
    def ticks(self) -> list[float]:
        """Two to four round values: 1, 2 or 5 times a power of ten."""
        found: list[float] = []
        for tick in _decades(self.low, self.high) if self.log else _steps(self.low, self.high):
            if not found or self.place(tick) - self.place(found[-1]) >= APART:
                found.append(tick)
        return found


def log_scale(values: Sequence[float], spans: Sequence[Span]) -> DotScale:
    """For sizes and their intervals; an interval that begins at zero is cut."""
    good = [v for v in values if v > 0.0] or [1.0]
    ends = [x for span in spans for x in span if x > 0.0]
    low, high = min(good), max(good)
    low, high = max(min([low, *ends]), 0.2 * low), min(max([high, *ends]), 5.0 * high)
    while high < 2.0 * low:  # values that hardly differ do not fill the column
        low, high = low / 1.2, high * 1.2
    return DotScale(low, high, True)


def zero_scale(values: Sequence[float], spans: Sequence[Span], unit: str) -> DotScale:
    """For values with a sign: zero is in it, and all that is not far off."""
    ends = [x for span in spans for x in span]
    most = max(LEAST.get(unit, 0.0) / 2.0, FAR * median([abs(x) for x in ends or values]))
    near = [x for x in [*values, 0.0] if abs(x) <= most] + [x for x in ends if abs(x) <= WIDE * most]
    low, high = min(near), max(near)
    short = LEAST.get(unit, 1.0) - (high - low)
    return DotScale(low - max(short, 0.0) / 2.0, high + max(short, 0.0) / 2.0, False)


def _decades(low: float, high: float) -> list[float]:
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found: list[float] = []
    for steps in (FINE[:1], FINE[::2], FINE):
        found = [s * 10.0**p for p in powers for s in steps if low <= s * 10.0**p <= high]
        if len(found) >= 2:
            break
    return found if len(found) <= 4 else found[:: math.ceil(len(found) / 4)]


def _steps(low: float, high: float) -> list[float]:
    rough = (high - low) / 4.0
    power = 10.0 ** math.floor(math.log10(rough))
    step = next((s * power for s in FINE if s * power >= rough), 10.0 * power)
    first = math.ceil(low / step)
    return [i * step for i in range(first, math.floor(high / step) + 1)]
