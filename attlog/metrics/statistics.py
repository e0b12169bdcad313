"""Units of evidence of an answer, paired tests of rows, error sizes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core.plain import IN_JSON, NumberArray
from attlog.metrics import intervals as interval
from attlog.metrics.intervals import VariancePrior, students_two_sided

Array = NDArray[np.float64]
Ids = NDArray[np.int64]
Kind = Literal["log_variance", "mean_square", "slope_group", "lag_event", "step_event"]


@dataclass(frozen=True, slots=True)
class Summary:
    """Value and 95 % interval of a row on some units."""

    value: float
    ci95: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class UnitValues:
    """Values of an answer's units of evidence, paired between rows by ``ids``.

    ``ids`` (k,) of :func:`make_ids`; ``values`` (k,) by ``kind``. ``log_variance``: logarithm of a window's variance.
    ``mean_square``: mean square of a block. ``slope_group``: signed slope of a group. ``lag_event``: jackknife
    pseudo-value of an event, ``n whole - (n - 1) without it`` (their mean is the lag, their scatter its jackknife
    variance). ``step_event``: magnitude of an event's error. ``on`` recomputes the answer on some units and must
    pickle. Units read from a file lack it and are averaged by kind.
    """

    kind: Kind
    ids: Annotated[Ids, NumberArray(int)]
    values: Annotated[Array, NumberArray(float)]
    on: Callable[[Ids], Summary] | None = field(default=None, repr=False, compare=False, metadata={IN_JSON: False})

    def of(self, ids: Ids) -> Summary:
        """Return value and interval on the units ``ids`` (m,)."""
        return self.on(ids) if self.on is not None else Summary(_summed_up(self.kind, self.at(ids)), None)

    def at(self, ids: Ids) -> Array:
        """Return the values (m,) of units ``ids`` (m,); KeyError for unknown ones."""
        order = np.argsort(self.ids)
        place = np.searchsorted(self.ids, ids, sorter=order)
        found = order[np.minimum(place, len(order) - 1)]
        if not np.array_equal(self.ids[found], ids):
            raise KeyError(f"units {np.setdiff1d(ids, self.ids).tolist()} are not there")
        return self.values[found]


def make_ids(times: ArrayLike) -> Ids:
    """Return ids (k,) of units by their start ``times`` (k,) s.

    Whole milliseconds, equal for all rows.
    """
    return np.round(1000.0 * np.asarray(times, np.float64)).astype(np.int64)


def _summed_up(kind: Kind, values: Array) -> float:
    """Return the mean of units on their scale; step events: the median."""
    if kind == "step_event":
        return float(np.median(values))
    mean = float(np.mean(values))
    return math.exp(0.5 * mean) if kind == "log_variance" else math.sqrt(mean) if kind == "mean_square" else mean


# Paired test of two rows: one test per kind of unit, on common units.

# Prior variance of the difference of logarithms between units, from many logs.
PRIORS: dict[Kind, VariancePrior] = {"log_variance": VariancePrior(0.4, 4.0), "mean_square": VariancePrior(1.0, 3.0)}
# Smallest number of common units for a test.
NEEDED: dict[Kind, int] = {"log_variance": 1, "mean_square": 3, "slope_group": 4, "lag_event": 3, "step_event": 6}
# Largest number of values with an exact signed-rank distribution, else a normal one.
EXACT = 60


def p_value(a: UnitValues, b: UnitValues, common: Ids) -> float:
    """Return two-sided p that two rows are equal on common units.

    ``common``: ids (k,). 1 for too few units or different kinds.
    """
    if a.kind != b.kind or len(common) < NEEDED[a.kind]:
        return 1.0
    return float(p_values(a.kind, a.at(common)[None], b.at(common)[None])[0])


def p_values(kind: Kind, x: Array, y: Array) -> Array:
    """Return :func:`p_value` (m,) of pairs with values (m, k)."""
    if x.shape[1] < NEEDED[kind]:
        return np.ones(len(x))
    if kind == "step_event":
        return np.array([signed_rank(d) for d in x - y])
    if kind in ("slope_group", "lag_event"):
        # |x| > |y| exactly where (x - y)(x + y) > 0: both factors must differ from zero
        sizes = np.minimum(_t_of(x - y), _t_of(x + y))
        return students_two_sided(sizes, x.shape[1] - 1)
    return interval.moderated_p_value(
        x - y if kind == "log_variance" else _logarithms(x) - _logarithms(y), PRIORS[kind]
    )


def _logarithms(squares: Array) -> Array:
    return np.asarray(np.log(np.maximum(squares, 1e-18)))


def _t_of(d: Array) -> Array:
    """Return Student's t sizes (m,) of differences (m, k)."""
    mean = np.abs(np.mean(d, axis=1))
    error = np.std(d, axis=1, ddof=1) / math.sqrt(d.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(error > 0.0, mean / error, np.where(np.any(d != 0.0, axis=1), np.inf, 0.0))


def signed_rank(d: Array) -> float:
    """Return two-sided p of Wilcoxon's signed-rank test of differences (k,)."""
    d = d[d != 0.0]
    n = len(d)
    if n == 0:
        return 1.0
    size = np.abs(d)
    ordered = np.sort(size)  # twice the mean rank of ties
    doubled = np.searchsorted(ordered, size, "left") + np.searchsorted(ordered, size, "right") + 1
    positive, total = int(np.sum(doubled[d > 0])), int(np.sum(doubled))
    if n > EXACT:
        deviation = math.sqrt(float(np.sum(doubled.astype(float) ** 2))) / 2.0
        return 2.0 * NormalDist().cdf(-abs(positive - total / 2.0) / deviation)
    ways = np.zeros(total + 1)
    ways[0] = 1.0
    for rank in doubled.tolist():
        ways[rank:] = ways[rank:] + ways[: total + 1 - rank]
    tail = min(positive, total - positive)
    return min(1.0, 2.0 * float(np.sum(ways[: tail + 1])) / 2.0**n)


def significant(p_values: Array, rate: float = 0.05) -> NDArray[np.bool_]:
    """Return which p-values (m,) pass (false discovery rate, Benjamini & Hochberg 1995)."""
    m = len(p_values)
    order = np.argsort(p_values)
    passed = np.flatnonzero(p_values[order] <= rate * np.arange(1, m + 1) / m)
    stand = np.zeros(m, bool)
    if len(passed):
        stand[order[: passed[-1] + 1]] = True
    return stand


# The size of an error angle over a record: RMSE and 95th percentile with their 95 % intervals.

STATISTICS = {"rmse": "root mean square", "p95": "95th percentile"}
P95 = 0.95  # probability of the percentile
# Largest end of an interval over its value: one burst does not predict larger values.
MAX_INTERVAL_RATIO = 3.0
PIECES = 4  # two scales of changes: halves and quarters
GROUP_S, MAX_GROUPS = 5.0, 20  # length as that of blocks of tilt errors
SHORTEST_S, MIN_SAMPLES = 4.0, 8  # a second and two samples a quarter
# Largest angle between two attitudes, the limit of an interval.
HALF_TURN_DEG = 180.0


def groups_of(n: int, duration: float) -> list[slice]:
    """Return consecutive groups of n samples as independent evidence.

    4 to 20 groups of 5 s; none for a record below 4 s.
    """
    if duration < SHORTEST_S or n < MIN_SAMPLES:
        return []
    return interval.equal_groups(n, int(np.clip(duration // GROUP_S, 4, MAX_GROUPS)))


def root_mean_square(angle: Array, groups: list[slice]) -> tuple[float, interval.Interval | None]:
    """Return the RMS of an angle (n,) and its 95 % interval.

    The t interval of the groups' mean squares. The relative error of the mean square becomes a factor (delta method),
    so that the interval of a short, uneven record stays above zero.
    """
    squares = angle**2
    square = float(np.mean(squares))
    spread = interval.neighbour_interval(interval.group_means(squares, groups)) if len(groups) > 1 else None
    if spread is None or square == 0.0:
        return math.sqrt(square), None if spread is None else (0.0, 0.0)
    factor = math.exp(0.25 * (spread[1] - spread[0]) / square)
    return math.sqrt(square), (math.sqrt(square) / factor, min(math.sqrt(square) * factor, HALF_TURN_DEG))


class ErrorSize:
    """Size of an unsigned error angle (n,) in deg over ``duration`` s.

    ``sigma``: the reference's own error (one sigma, RMS over the record, deg).
    """

    def __init__(self, angle: Array, duration: float, sigma: float = 0.0) -> None:
        self._angle, self._sigma = angle, sigma
        self.pieces = PIECES if duration >= SHORTEST_S and len(angle) >= MIN_SAMPLES else 0
        self._squares: Array | None = None

    def of(self, name: str) -> tuple[float, interval.Interval | None]:
        """Return one of STATISTICS and its interval (None for short records)."""
        whole, *parts = self._sizes(name)
        if not self.pieces:
            return whole, None
        changes = _changes(parts, whole)
        if name != "rmse":  # a percentile rests on few samples: at least the changes of the RMS
            square, *squares = self._sizes("rmse")
            changes = np.maximum(changes, _changes(squares, square))
        low, high = interval.wandering_interval(whole, changes)
        low, high = interval.widen_by_reference(whole, (low, min(high, MAX_INTERVAL_RATIO * whole)), self._sigma)
        return whole, (max(low, 0.0), min(high, HALF_TURN_DEG))

    def _sizes(self, name: str) -> list[float]:
        """Return the size of the whole, of both halves and four quarters."""
        halves, quarters = (interval.equal_groups(len(self._angle), n) if self.pieces else [] for n in (2, PIECES))
        if name == "rmse":
            if self._squares is None:
                self._squares = self._angle**2
            square = interval.group_means(self._squares, [slice(0, len(self._angle)), *halves, *quarters])
            return [float(x) for x in np.sqrt(square)]
        parts = [self._angle, *(self._angle[piece] for piece in (*halves, *quarters))]
        return [interval.quantile(_ordered_at(part, P95), P95) for part in parts]


def _changes(parts: list[float], whole: float) -> Array:
    """Return changes (3,) of log mean square between halves and quarters.

    The size of a part is limited to a thousandth of the whole, as its logarithm is unbounded.
    """
    size = 2.0 * np.log(np.maximum(parts, 1e-3 * whole)) if whole > 0.0 else np.zeros(len(parts))
    return np.abs(size[1::2] - size[::2])


def _ordered_at(values: Array, probability: float) -> Array:
    """Return the values (n,) partitioned around a quantile."""
    place = int(probability * (len(values) - 1))
    return np.partition(values, [place, min(place + 1, len(values) - 1)])
