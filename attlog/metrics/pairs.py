"""Do two rows differ? One test per kind of unit, on the units that both have."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from attlog.metrics import moderated
from attlog.metrics.moderated import Prior
from attlog.metrics.quantiles import student_two_sided
from attlog.metrics.units import Ids, Kind, UnitValues

Array = NDArray[np.float64]

PRIORS: dict[Kind, Prior] = {"log_variance": Prior(0.4, 4.0), "mean_square": Prior(1.0, 3.0)}
"""Scatter of differences of logarithms from unit to unit, measured over logs."""
NEEDED: dict[Kind, int] = {"log_variance": 1, "mean_square": 3, "slope_group": 4, "lag_event": 3, "step_event": 6}
"""Fewer common units tell nothing."""
EXACT = 60
"""Up to here the signed-rank distribution is counted, beyond it is normal."""


def p_value(a: UnitValues, b: UnitValues, common: Ids) -> float:
    """Two-sided p that two rows are the same on common units (k,); 1 with too few of them or of different kinds."""
    if len(common) < NEEDED[a.kind]:
        return 1.0
    return p_of(a.kind, b.kind, a.at(common), b.at(common))


def p_of(kind: Kind, other: Kind, x: Array, y: Array) -> float:
    """Two-sided p that two rows with values (k,) each on the same units are the same, as :func:`p_value`."""
    if kind != other or len(x) < NEEDED[kind]:
        return 1.0
    if kind == "step_event":
        return signed_rank(x - y)
    if kind in ("slope_group", "lag_event"):
        # |x| > |y| exactly where (x - y)(x + y) > 0: both factors have to be told from zero
        return max(_t_test(x - y), _t_test(x + y))
    return moderated.p_value(x - y if kind == "log_variance" else _logarithms(x) - _logarithms(y), PRIORS[kind])


def _logarithms(squares: Array) -> Array:
    return np.asarray(np.log(np.maximum(squares, 1e-18)))


def _t_test(d: Array) -> float:
    error = float(np.std(d, ddof=1)) / math.sqrt(len(d))
    if error == 0.0:
        return 0.0 if np.any(d != 0.0) else 1.0
    return student_two_sided(float(np.mean(d)) / error, len(d) - 1)


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


def told_apart(p_values: Array, rate: float = 0.05) -> NDArray[np.bool_]:
    """Which of p-values (m,) stand if at most ``rate`` of the claims may be false (Benjamini & Hochberg 1995)."""
    m = len(p_values)
    order = np.argsort(p_values)
    passed = np.flatnonzero(p_values[order] <= rate * np.arange(1, m + 1) / m)
    told = np.zeros(m, bool)
    if len(passed):
        told[order[: passed[-1] + 1]] = True
    return told
