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
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.metrics import intervals as interval
from attlog.metrics import ranking, statistics
from attlog.metrics.intervals import student, student_two_sided
from attlog.metrics.metric import Answer
from attlog.metrics.statistics import Kind, UnitValues

Array = NDArray[np.float64]
Scale = Literal["ratio", "difference"]
Direction = Literal["better", "worse", "same", "not significant"]

RATIO_KINDS: tuple[Kind, ...] = ("log_variance", "mean_square")
ALPHA = 0.05
MIN_OWN_SCATTER_UNITS = 4
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
    needed = max(statistics.NEEDED[a.units.kind], math.ceil(ranking.MIN_UNITS * most))
    if len(common) < needed:
        return f"{len(common)} units of evidence in common; {needed} are needed"
    first, second = a.units.of(common).value, b.units.of(common).value
    found = estimate_difference(a.units, b.units, common)
    scale, value, ci95, error = found.scale, found.value, found.ci95, found.error
    p = _p_value(a.units, b.units, common)
    if not np.any(a.units.at(common) != b.units.at(common)):
        shown = typical_value(a.units, common, first)
        return PairedDifference(scale, 0.0, (0.0, 0.0), error, 1.0, len(common), shown, shown, "same")
    apart = _size(second, better) - _size(first, better)
    significant = p < ALPHA and (ci95 is None or not ci95[0] <= 0.0 <= ci95[1])
    significant = significant and abs(apart) > ranking.floor(a, b) and (apart < 0.0) == (value < 0.0)
    direction: Direction = ("better" if apart < 0.0 else "worse") if significant else "not significant"
    first, second = (typical_value(u, common, v) for u, v in ((a.units, first), (b.units, second)))
    return PairedDifference(scale, value, ci95, error, p, len(common), first, second, direction)


def typical_value(units: UnitValues, common: NDArray[np.int64], value: float) -> float:
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


def estimate_difference(a: UnitValues, b: UnitValues, common: NDArray[np.int64]) -> DifferenceEstimate:
    """The difference of the second to the first over common units (k,), as the module's table says."""
    x, y = a.at(common), b.at(common)
    kind = a.kind
    if kind in RATIO_KINDS:
        d = 0.5 * (y - x if kind == "log_variance" else _logarithms(y) - _logarithms(x))
        if len(d) < MIN_OWN_SCATTER_UNITS:  # the prior is that of twice this, of logarithms of variances
            prior = interval.VariancePrior(statistics.PRIORS[kind].variance / 4.0, statistics.PRIORS[kind].dof)
            value, low, high, error = moderated_mean(d, prior)
            return DifferenceEstimate("ratio", value, (low, high), error)
        return DifferenceEstimate("ratio", *_student_mean(d))
    if kind == "step_event":
        return DifferenceEstimate("difference", *hodges_lehmann(y - x))
    d = np.copysign(1.0, np.mean(y)) * y - np.copysign(1.0, np.mean(x)) * x
    return DifferenceEstimate("difference", *_student_mean(d))


def _student_mean(d: Array) -> tuple[float, tuple[float, float], float]:
    """Mean of values (k,), its t interval and its standard error."""
    value, error = float(np.mean(d)), float(np.std(d, ddof=1)) / math.sqrt(len(d))
    half = student(0.975, len(d) - 1) * error
    return value, (value - half, value + half), error


def _p_value(a: UnitValues, b: UnitValues, common: NDArray[np.int64]) -> float:
    """Two-sided p that both are the same on common units (k,): of the interval's test."""
    if a.kind not in RATIO_KINDS or len(common) < MIN_OWN_SCATTER_UNITS:
        return statistics.p_value(a, b, common)
    found = estimate_difference(a, b, common)
    if found.error == 0.0:
        return 1.0 if found.value == 0.0 else 0.0
    return student_two_sided(found.value / found.error, len(common) - 1)


def _logarithms(squares: Array) -> Array:
    return np.asarray(np.log(np.maximum(squares, 1e-18)))


def moderated_mean(d: Array, prior: interval.VariancePrior) -> tuple[float, float, float, float]:
    """Mean of values (k,), both ends of its moderated 95 % interval, and its standard error."""
    low, high = interval.moderated_interval(d, prior)
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


# One number of many logs: a random-effects mean of their differences, and on how many logs its sign holds.
#
# Logs are taken as drawn from all flights one might make: the true difference scatters from log to
# log by tau. tau^2 by DerSimonian & Laird (1986), the interval by Hartung & Knapp (2001): t with logs - 1
# degrees of freedom around the weighted mean, its variance from the weighted scatter of the logs, never
# below that of the weights alone (the modification that Roever, Knapp & Friede 2015 advise for few logs of
# unequal size).


@dataclass(frozen=True, slots=True)
class PooledMean:
    """The mean of ``logs`` differences, its interval and p (None for one log alone whose own are not known).

    ``tau`` is the scatter of the true difference from log to log, ``i2_pct`` the share of the scatter that is not
    each log's own uncertainty. ``better``, ``worse``, ``same``: on how many logs the sign is so, significant or not.
    """

    value: float
    ci95: tuple[float, float] | None
    p: float | None
    logs: int
    better: int
    worse: int
    same: int
    tau: float
    i2_pct: float
    method: str


def pool(
    values: Sequence[float],
    errors: Sequence[float | None],
    alone: tuple[tuple[float, float] | None, float | None] = (None, None),
) -> PooledMean:
    """The differences of k logs as one; negative counts as better.

    ``errors`` are standard errors; where one is not known (None) all logs weigh the same. One log is
    what it is: ``alone`` are its own interval and p. ValueError without any log.
    """
    y = np.asarray(values, np.float64)
    k = len(y)
    if k == 0:
        raise ValueError("no log to pool")
    signs = int(np.sum(y < 0.0)), int(np.sum(y > 0.0)), int(np.sum(y == 0.0))
    if not np.any(y):
        return PooledMean(0.0, (0.0, 0.0), 1.0, k, *signs, 0.0, 0.0, "equal on every log")
    if k == 1:
        return PooledMean(float(y[0]), alone[0], alone[1], 1, *signs, 0.0, 0.0, "one log")
    known = [e for e in errors if e is not None and e > 0.0]
    if len(known) == 0 or any(e is None for e in errors):
        mean, error = float(np.mean(y)), float(np.std(y, ddof=1)) / math.sqrt(k)
        method, tau, i2 = f"mean of {k} logs, t interval", float(np.std(y, ddof=1)), 100.0
    else:
        variance = np.array([max(e or 0.0, min(known)) ** 2 for e in errors], np.float64)
        tau2, i2 = dersimonian_laird(y, variance)
        mean, error = hartung_knapp(y, 1.0 / (variance + tau2), least=True)
        method, tau = f"random effects over {k} logs (DerSimonian-Laird, Hartung-Knapp)", math.sqrt(tau2)
    half = student(0.975, k - 1) * error
    p = student_two_sided(mean / error, k - 1) if error > 0.0 else 0.0
    return PooledMean(mean, (mean - half, mean + half), p, k, *signs, tau, i2, method)


def dersimonian_laird(y: Array, variance: Array) -> tuple[float, float]:
    """DerSimonian & Laird's tau^2, and I^2 in percent, of values (k,) with variances (k,)."""
    w = 1.0 / variance
    centre = float(w @ y / w.sum())
    q = float(w @ (y - centre) ** 2)
    spread = q - (len(y) - 1)
    tau2 = max(0.0, spread / float(w.sum() - (w @ w) / w.sum()))
    return tau2, max(0.0, 100.0 * spread / q) if q > 0.0 else 0.0


def hartung_knapp(y: ArrayLike, weights: ArrayLike, least: bool = False) -> tuple[float, float]:
    """Weighted mean of values (k,) and its standard error by Hartung & Knapp; ``least``: not below 1/sqrt(sum w)."""
    y, w = np.asarray(y, np.float64), np.asarray(weights, np.float64)
    mean = float(w @ y / w.sum())
    scatter = float(w @ (y - mean) ** 2) / (len(y) - 1)
    return mean, math.sqrt((max(scatter, 1.0) if least else scatter) / float(w.sum()))
