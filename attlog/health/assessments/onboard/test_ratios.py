"""How far were the aids of the onboard estimator from what it expected, in flight: arrays for figures and questions.

A test ratio is innovation over gate and standard deviation (in both firmwares the root is what is kept): 1 is rejected,
and 1 / gate is one standard deviation of what the estimator expects.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.flight.model import Array, InnovationTest
from attlog.health.assessments.model import HealthCase
from attlog.health.assessments.onboard import in_flight
from attlog.segments.airborne.grid import runs
from attlog.segments.spans import Span, inside

MOST_POINTS = 1500
FEWEST = 20


@dataclass(frozen=True, slots=True)
class RatioSeries:
    """Test ratios of an aid for a figure: the largest of each part of the flight, ``ratio`` (n,) at ``t`` (n,) s."""

    aid: str
    source: str
    t: Array
    ratio: Array


@dataclass(frozen=True, slots=True)
class RatioSummary:
    """Test ratios of an aid in flight. ``above`` s of ``seconds`` are above 1, ``longest`` (t0, t1) s without break."""

    aid: str
    source: str
    median: float
    interval: tuple[float, float]
    p95: float
    above: float
    longest: Span | None
    n: int
    seconds: float

    @property
    def longest_s(self) -> float:
        """The longest time above 1 without a break, s."""
        return 0.0 if self.longest is None else self.longest[1] - self.longest[0]


def series(case: HealthCase) -> list[RatioSeries]:
    """Per aid that was used its test ratios over the whole log, thinned to MOST_POINTS by maxima, for a figure."""
    found = []
    for test in case.log.innovation_tests:
        good = np.isfinite(test.ratio) & np.isfinite(test.t)
        t, ratio = test.t[good], test.ratio[good]
        if len(t) == 0 or not ratio.any():
            continue
        found.append(RatioSeries(test.aid, test.source, *thinned(t, ratio)))
    return found


def thinned(t: Array, x: Array) -> tuple[Array, Array]:
    """At most MOST_POINTS of samples (n,): of equal numbers of neighbours the largest, at its own time."""
    if len(t) <= MOST_POINTS:
        return t, x
    starts = np.linspace(0, len(t), MOST_POINTS + 1).astype(np.int64)[:-1]
    largest = np.maximum.reduceat(x, starts)
    part = np.searchsorted(starts, np.arange(len(t)), side="right") - 1
    is_largest = x == largest[part]
    first = np.flatnonzero(is_largest)
    at = first[np.unique(part[first], return_index=True)[1]]
    return t[at], x[at]


def summaries(case: HealthCase) -> list[RatioSummary]:
    """Per aid that was used in flight."""
    flown = in_flight.flown(case)
    found = [_summary(test, flown) for test in case.log.innovation_tests]
    return [one for one in found if one is not None]


def _summary(test: InnovationTest, flown: list[Span]) -> RatioSummary | None:
    """None where an aid was not used: no ratios in flight, or nothing but zeros."""
    use = inside(test.t, flown) & np.isfinite(test.ratio)
    t, ratio = test.t[use], test.ratio[use]
    if len(t) < FEWEST or not ratio.any():
        return None
    held = in_flight.held_seconds(t)
    above = ratio > 1.0
    stretches = [(float(t[a]), float(t[b - 1] + held[b - 1])) for a, b in runs(above)]
    return RatioSummary(
        test.aid,
        test.source,
        float(np.median(ratio)),
        in_flight.median_interval(t, ratio),
        float(np.percentile(ratio, 95.0)),
        float(held[above].sum()),
        max(stretches, key=lambda s: s[1] - s[0], default=None),
        len(t),
        float(held.sum()),
    )
