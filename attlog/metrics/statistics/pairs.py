"""Do two rows differ? One test per kind of unit, on the units that both have."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.statistics import intervals as interval
from attlog.metrics.statistics.intervals import VariancePrior
from attlog.metrics.statistics.quantiles import students_two_sided
from attlog.metrics.statistics.units import Ids, Kind, UnitValues

Array = NDArray[np.float64]

PRIORS: dict[Kind, VariancePrior] = {"log_variance": VariancePrior(0.4, 4.0), "mean_square": VariancePrior(1.0, 3.0)}
"""Scatter of differences of logarithms from unit to unit, measured over logs."""
NEEDED: dict[Kind, int] = {"log_variance": 1, "mean_square": 3, "slope_group": 4, "lag_event": 3, "step_event": 6}
"""With fewer common units there is no test."""
EXACT = 60
"""Up to here the signed-rank distribution is counted, beyond it is normal."""


def p_value(a: UnitValues, b: UnitValues, common: Ids) -> float:
    """Two-sided p that two rows are the same on common units (k,); 1 with too few of them or of different kinds."""
    if a.kind != b.kind or len(common) < NEEDED[a.kind]:
        return 1.0
    return float(p_values(a.kind, a.at(common)[None], b.at(common)[None])[0])


def p_values(kind: Kind, x: Array, y: Array) -> Array:
    """The same of many pairs at once: values (m, k) of the one and the other rows on the same units; (m,)."""
    if x.shape[1] < NEEDED[kind]:
        return np.ones(len(x))
    if kind == "step_event":
        return signed_ranks(x - y)
    if kind in ("slope_group", "lag_event"):
        # |x| > |y| exactly where (x - y)(x + y) > 0: both factors must differ from zero
        sizes = np.minimum(_t_of(x - y), _t_of(x + y))
        return students_two_sided(sizes, x.shape[1] - 1)
    return interval.p_of_moderated(x - y if kind == "log_variance" else _logarithms(x) - _logarithms(y), PRIORS[kind])


def _logarithms(squares: Array) -> Array:
    return np.asarray(np.log(np.maximum(squares, 1e-18)))


def _t_of(d: Array) -> Array:
    """Sizes (m,) of Student's t of differences (m, k); infinite where they differ from zero by one value alone."""
    mean = np.abs(np.mean(d, axis=1))
    error = np.std(d, axis=1, ddof=1) / math.sqrt(d.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(error > 0.0, mean / error, np.where(np.any(d != 0.0, axis=1), np.inf, 0.0))


def signed_ranks(d: Array) -> Array:
    """:func:`signed_rank` of many rows of differences (m, k): those beyond the counted ones without ties at once."""
    m, k = d.shape
    found, size = np.ones(m), np.abs(d)
    ordered = np.sort(size, axis=1)
    at_once = (k > EXACT) & (ordered[:, 0] > 0.0) & (np.diff(ordered, axis=1) > 0.0).all(axis=1)
    for row in np.flatnonzero(~at_once):
        found[row] = signed_rank(d[row])
    if at_once.any():
        doubled = 2.0 * (1.0 + np.argsort(np.argsort(size[at_once], axis=1), axis=1))
        positive = np.sum(np.where(d[at_once] > 0.0, doubled, 0.0), axis=1)
        deviation = math.sqrt(float(np.sum((2.0 * np.arange(1.0, k + 1.0)) ** 2))) / 2.0
        deviates = np.abs(positive - k * (k + 1.0) / 2.0) / deviation
        found[at_once] = [2.0 * NormalDist().cdf(-z) for z in deviates.tolist()]
    return found


def signed_rank(d: Array) -> float:
    """Two-sided p of Wilcoxon's signed-rank test of differences (k,); zeros do not count, ties share their rank."""
    d = d[d != 0.0]
    n = len(d)
    if n == 0:
        return 1.0
    size = np.abs(d)
    ordered = np.sort(size)  # twice the rank: all that are smaller, and half of those that are as large
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
    """Which of p-values (m,) stand if at most ``rate`` of the claims may be false (Benjamini & Hochberg 1995)."""
    m = len(p_values)
    order = np.argsort(p_values)
    passed = np.flatnonzero(p_values[order] <= rate * np.arange(1, m + 1) / m)
    stand = np.zeros(m, bool)
    if len(passed):
        stand[order[: passed[-1] + 1]] = True
    return stand
