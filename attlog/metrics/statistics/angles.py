"""The size of an error angle over a record: RMSE, median, 95th percentile, largest, each with its 95 % interval."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.statistics import intervals as interval

Array = NDArray[np.float64]


STATISTICS = {"rmse": "root mean square", "median": "median", "p95": "95th percentile", "max": "largest value"}
QUANTILES = {"median": 0.5, "p95": 0.95, "max": 1.0}
MOST = {"rmse": 3.0, "p95": 3.0, "median": math.inf}
"""An interval ends at so many times the value: what came in one burst was not seen to be larger than this elsewhere
(halves of flights agree as often as without). A median leaves bursts out."""
PIECES = 4
GROUP_S, MAX_GROUPS = 5.0, 20
SHORTEST_S, MIN_SAMPLES = 4.0, 8
HALF_TURN_DEG = 180.0
"""No attitude is further from another, so no interval of an error ends beyond it."""


def groups_of(n: int, duration: float) -> list[slice]:
    """Consecutive groups of n samples that stand for independent evidence: 4 to 20 of 5 s; none below 4 s."""
    if duration < SHORTEST_S or n < MIN_SAMPLES:
        return []
    return interval.equal_groups(n, int(np.clip(duration // GROUP_S, 4, MAX_GROUPS)))


def root_mean_square(angle: Array, groups: list[slice]) -> tuple[float, interval.Interval | None]:
    """RMS of an angle (n,) without memory beyond its groups, and its interval: t over their mean squares.

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


class ErrorSize:
    """The sizes of an error angle without sign (n,), in deg, over a record of ``duration`` s.

    ``sigma``: how wrong the reference may be itself (one sigma, RMS over the record, deg).
    """

    def __init__(self, angle: Array, duration: float, sigma: float = 0.0) -> None:
        self._angle, self._sigma = angle, sigma
        self.pieces = PIECES if duration >= SHORTEST_S and len(angle) >= MIN_SAMPLES else 0
        self._squares: Array | None = None

    def of(self, name: str) -> tuple[float, interval.Interval | None]:
        """One of STATISTICS with its interval where it has one; an extreme has one of the reference alone."""
        if name == "max":
            value = float(np.max(self._angle))
            return value, self._with_reference(value, (value, value)) if self._sigma > 0.0 else None
        whole, *parts = self._sizes(name)
        if not self.pieces:
            return whole, None
        changes = _changes(parts, whole)
        if name != "rmse":  # where few samples reach, their changes say little: the size of the error changes too
            square, *squares = self._sizes("rmse")
            changes = np.maximum(changes, _changes(squares, square))
        low, high = interval.of_wandering(whole, changes)
        return whole, self._with_reference(whole, (low, min(high, MOST[name] * whole)))

    def _with_reference(self, value: float, ci95: interval.Interval) -> interval.Interval:
        low, high = interval.with_reference(value, ci95, self._sigma)
        return max(low, 0.0), min(high, HALF_TURN_DEG)

    def _sizes(self, name: str) -> list[float]:
        """The size of the whole; where there are pieces also of both halves and the four quarters."""
        halves, quarters = (interval.equal_groups(len(self._angle), n) if self.pieces else [] for n in (2, PIECES))
        if name == "rmse":
            if self._squares is None:
                self._squares = self._angle**2
            square = interval.means(self._squares, [slice(0, len(self._angle)), *halves, *quarters])
            return [float(x) for x in np.sqrt(square)]
        probability = QUANTILES[name]
        parts = [self._angle, *(self._angle[piece] for piece in (*halves, *quarters))]
        return [interval.quantile(_ordered_at(part, probability), probability) for part in parts]


def _changes(parts: list[float], whole: float) -> Array:
    """How much the logarithm of the mean square changes (3,) between halves, and between the quarters of each.

    A part that is a thousand times smaller than the whole counts as that: its logarithm could be anything.
    """
    size = 2.0 * np.log(np.maximum(parts, 1e-3 * whole)) if whole > 0.0 else np.zeros(len(parts))
    return np.abs(size[1::2] - size[::2])


def _ordered_at(values: Array, probability: float) -> Array:
    """The values (n,), those at a quantile where they stand in ascending order."""
    place = int(probability * (len(values) - 1))
    return np.partition(values, [place, min(place + 1, len(values) - 1)])
