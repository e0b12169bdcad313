"""The size of an error angle over a record: RMSE, median, 95th percentile, largest, each with its 95 % interval."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.statistics import intervals as interval

Array = NDArray[np.float64]


Whole = tuple[float, interval.Interval | None]
"""A value and its interval."""
STATISTICS = {"rmse": "root mean square", "median": "median", "p95": "95th percentile", "max": "largest value"}
GROUP_S = {"inclination": 5.0, "heading": 10.0, "total": 10.0}
"""Errors of filters wander over seconds, heading for longer than tilt: shorter groups would count one swing twice. With
5 s for heading the interval of half a flight met the other half in 82 % only."""
MAX_GROUPS = 20
SHORTEST_S, MIN_SAMPLES = 4.0, 8
HALF_TURN_DEG = 180.0
"""No attitude is further from another, so no interval of an error ends beyond it."""


def groups_of(n: int, duration: float, length: float = GROUP_S["inclination"]) -> list[slice]:
    """Consecutive groups of n samples that stand for independent evidence: 4 to 20 of ``length`` s; none below 4 s."""
    if duration < SHORTEST_S or n < MIN_SAMPLES:
        return []
    return interval.equal_groups(n, int(np.clip(duration // length, 4, MAX_GROUPS)))


def root_mean_square(angle: Array, groups: list[slice]) -> tuple[float, interval.Interval | None]:
    """RMS of an error angle (n,) and its interval: t over the mean squares of the groups, which may resemble
    their neighbours, on logarithmic scale.

    The relative error of the mean square becomes a factor (delta method), so that the
    interval of a short, uneven record does not reach below zero.
    """
    squares = angle**2
    square = float(np.mean(squares))
    spread = interval.of_neighbours(interval.means(squares, groups)) if len(groups) > 1 else None
    if spread is None or square == 0.0:
        return math.sqrt(square), None if spread is None else (0.0, 0.0)
    factor = math.exp(0.25 * (spread[1] - spread[0]) / square)
    return math.sqrt(square), (math.sqrt(square) / factor, min(math.sqrt(square) * factor, HALF_TURN_DEG))


def statistic(
    angle: Array, name: str, groups: list[slice], ordered: Array | None = None, whole: Whole | None = None
) -> Whole:
    """One of STATISTICS of an error angle without sign (n,), with its interval where it has one.

    Where several are asked for: ``ordered`` are the same angles in ascending order, ``whole`` is their RMS.
    """
    if name == "rmse":
        return whole or root_mean_square(angle, groups)
    ordered = np.sort(angle) if ordered is None else ordered
    if name == "max":
        return float(ordered[-1]), None
    if name == "median":
        return interval.quantile(ordered, 0.5), interval.of_quantile(angle, 0.5, groups, ordered)
    return percentile_95(angle, groups, ordered, whole or root_mean_square(angle, groups))


def percentile_95(angle: Array, groups: list[slice], ordered: Array, whole: Whole) -> Whole:
    """The 95th percentile of an error angle (n,) and its interval: Woodruff's, widened to that of the whole's size.

    Few groups reach the 95th percentile at all, so the shares below it say little about how far it lies: alone they
    met the other half of a flight in 50 to 70 %. It grows and shrinks with the RMSE, whose relative interval counts.
    """
    value = interval.quantile(ordered, 0.95)
    shares = interval.of_quantile(angle, 0.95, groups, ordered)
    if shares is None or whole[1] is None or whole[0] == 0.0:
        return value, shares
    low, high = (value * end / whole[0] for end in whole[1])
    return value, (min(shares[0], low), min(max(shares[1], high), HALF_TURN_DEG))
