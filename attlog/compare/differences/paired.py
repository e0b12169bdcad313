"""How much does a configuration differ from another on one log? On the units of evidence that both have.

Errors and noises are compared as ratios, everything else as a difference, always the second to the first:

===============  ==========================================================  ====================
unit             what is averaged over the common units                      interval
===============  ==========================================================  ====================
window of noise  half of ln v_b - ln v_a: the logarithm of the ratio         t; moderated t below 4
block of errors  half of ln ms_b - ln ms_a: the typical block                t; moderated t below 4
event of lag     |lag|: difference of the jackknife's pseudo-values          t
group of drift   |drift|: difference of the slopes, each with its own sign   t
event of a step  difference of magnitudes, Hodges-Lehmann                    signed rank, inverted
none             difference of the values                                    none
===============  ==========================================================  ====================

The ranking's moderated t (docs/metrics.md) takes the scatter of two *different filters* as known beforehand. Two
settings of one filter scatter far less, so that its interval was up to thirty times too wide and held the other
half of a flight in 99 to 100 %; from four units on Student's t stands on the pair's own scatter (95 to 98 %, see
benchmarks/paired_intervals.py).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.answer import Answer
from attlog.metrics.ranking import best as ranking
from attlog.metrics.statistics import intervals as interval
from attlog.metrics.statistics import pairs
from attlog.metrics.statistics.quantiles import student, student_two_sided
from attlog.metrics.statistics.units import Kind, UnitValues

Array = NDArray[np.float64]
Scale = Literal["ratio", "difference"]
Direction = Literal["better", "worse", "same", "not significant"]

RATIOS: tuple[Kind, ...] = ("log_variance", "mean_square")
ALPHA = 0.05
OWN_SCATTER = 4
"""From so many windows or blocks on the scatter of a pair is taken from the pair itself."""


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """What the second answer is beside the first, on ``n`` common units.

    ``value`` on the scale it is averaged on: the logarithm of the ratio, or the difference of
    sizes (how far from perfect) in the metric's unit; negative where the second is nearer to perfect.
    ``error`` is its standard error, None without units. ``first`` and ``second`` are both answers on
    the common units, errors as those of the typical block (not the RMSE, which a few blocks can carry): their
    ratio is the one in ``value``. ``direction``: whether the second is significantly better or worse;
    "same" where all units are equal.
    """

    scale: Scale
    value: float
    ci95: tuple[float, float] | None
    error: float | None
    p: float | None
    n: int
    first: float
    second: float
    direction: Direction


def paired(a: Answer, b: Answer, better: str) -> PairedDifference | str:
    """The second answer beside the first, or the sentence why they cannot be compared. ``better`` as the metric's."""
    for answer in (a, b):
        if answer.value is None:
            return answer.reason or "no value"
    if a.units is None or b.units is None:
        return _without_units(a, b, better)
    common = np.intersect1d(a.units.ids, b.units.ids)
    most = max(len(a.units.ids), len(b.units.ids))
    needed = max(pairs.NEEDED[a.units.kind], math.ceil(ranking.MIN_UNITS * most))
    if len(common) < needed:
        return f"{len(common)} units of evidence in common; {needed} are needed"
    first, second = a.units.of(common).value, b.units.of(common).value
    found = estimate(a.units, b.units, common)
    scale, value, ci95, error = found.scale, found.value, found.ci95, found.error
    p = _p_value(a.units, b.units, common)
    if not np.any(a.units.at(common) != b.units.at(common)):
        shown = typical(a.units, common, first)
        return PairedDifference(scale, 0.0, (0.0, 0.0), error, 1.0, len(common), shown, shown, "same")
    apart = _size(second, better) - _size(first, better)
    significant = p < ALPHA and (ci95 is None or not ci95[0] <= 0.0 <= ci95[1])
    significant = significant and abs(apart) > ranking.floor(a, b) and (apart < 0.0) == (value < 0.0)
    direction: Direction = ("better" if apart < 0.0 else "worse") if significant else "not significant"
    first, second = (typical(u, common, v) for u, v in ((a.units, first), (b.units, second)))
    return PairedDifference(scale, value, ci95, error, p, len(common), first, second, direction)


def typical(units: UnitValues, common: NDArray[np.int64], value: float) -> float:
    """What stands for an answer on common units: ``value``, of errors the root of the typical mean square."""
    if units.kind != "mean_square":
        return value
    return math.exp(0.5 * float(np.mean(_logarithms(units.at(common)))))


def _without_units(a: Answer, b: Answer, better: str) -> PairedDifference:
    """Two answers without common units: they differ significantly where their intervals do not meet."""
    first, second = float(a.value or 0.0), float(b.value or 0.0)
    apart = _size(second, better) - _size(first, better)
    if first == second:
        return PairedDifference("difference", 0.0, None, None, None, 0, first, second, "same")
    near_a, _, far_a = ranking.distance(a, better)
    near_b, _, far_b = ranking.distance(b, better)
    known = a.ci95 is not None and b.ci95 is not None
    significant = known and (far_a < near_b or far_b < near_a) and abs(apart) > ranking.floor(a, b)
    direction: Direction = ("better" if apart < 0.0 else "worse") if significant else "not significant"
    return PairedDifference("difference", apart, None, None, None, 0, first, second, direction)


def _size(value: float, better: str) -> float:
    """How far a value is from perfect."""
    return ranking.distance(Answer(value, "", ""), better)[1]


@dataclass(frozen=True, slots=True)
class DifferenceEstimate:
    """A difference over units: its scale, value, interval and standard error."""

    scale: Scale
    value: float
    ci95: tuple[float, float] | None
    error: float


def estimate(a: UnitValues, b: UnitValues, common: NDArray[np.int64]) -> DifferenceEstimate:
    """The difference of the second to the first over common units (k,), as the module's table says."""
    x, y = a.at(common), b.at(common)
    kind = a.kind
    if kind in RATIOS:
        d = 0.5 * (y - x if kind == "log_variance" else _logarithms(y) - _logarithms(x))
        if len(d) < OWN_SCATTER:  # the prior is that of twice this, of logarithms of variances
            prior = interval.VariancePrior(pairs.PRIORS[kind].variance / 4.0, pairs.PRIORS[kind].dof)
            value, low, high, error = moderated_mean(d, prior)
            return DifferenceEstimate("ratio", value, (low, high), error)
        return DifferenceEstimate("ratio", *_mean(d))
    if kind == "step_event":
        return DifferenceEstimate("difference", *hodges_lehmann(y - x))
    d = np.copysign(1.0, np.mean(y)) * y - np.copysign(1.0, np.mean(x)) * x
    return DifferenceEstimate("difference", *_mean(d))


def _mean(d: Array) -> tuple[float, tuple[float, float], float]:
    """Mean of values (k,), its t interval and its standard error."""
    value, error = float(np.mean(d)), float(np.std(d, ddof=1)) / math.sqrt(len(d))
    half = student(0.975, len(d) - 1) * error
    return value, (value - half, value + half), error


def _p_value(a: UnitValues, b: UnitValues, common: NDArray[np.int64]) -> float:
    """Two-sided p that both are the same on common units (k,): of the interval's test."""
    if a.kind not in RATIOS or len(common) < OWN_SCATTER:
        return pairs.p_value(a, b, common)
    found = estimate(a, b, common)
    if found.error == 0.0:
        return 1.0 if found.value == 0.0 else 0.0
    return student_two_sided(found.value / found.error, len(common) - 1)


def _logarithms(squares: Array) -> Array:
    return np.asarray(np.log(np.maximum(squares, 1e-18)))


def moderated_mean(d: Array, prior: interval.VariancePrior) -> tuple[float, float, float, float]:
    """Mean of values (k,), both ends of its moderated 95 % interval, and its standard error."""
    low, high = interval.of_moderated(d, prior)
    half = 0.5 * (high - low)
    return 0.5 * (low + high), low, high, half / student(0.975, prior.dof + len(d) - 1)


def hodges_lehmann(d: Array) -> tuple[float, tuple[float, float] | None, float]:
    """Median of the Walsh averages of differences (k,), the values that the signed-rank test does not refuse, and
    a quarter of their width as standard error (Hollander & Wolfe, section 3.2).

    No interval under six differences: the test cannot refuse anything at 5 %.
    """
    i, j = np.triu_indices(len(d))
    walsh = np.sort(0.5 * (d[i] + d[j]))
    value, n, m = float(np.median(walsh)), len(d), len(walsh)
    ways = np.zeros(m + 1)
    ways[0] = 1.0
    for rank in range(1, n + 1):
        ways[rank:] = ways[rank:] + ways[: m + 1 - rank]
    below = np.cumsum(ways) / 2.0**n
    cut = int(np.searchsorted(below, 0.5 * ALPHA, side="right"))
    if cut == 0:
        return value, None, float(np.std(d, ddof=1)) / math.sqrt(n)
    ci95 = (float(walsh[cut - 1]), float(walsh[m - cut]))
    return value, ci95, 0.25 * (ci95[1] - ci95[0])
