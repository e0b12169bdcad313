"""Paired differences of two settings: on one log over common units of evidence, and pooled over logs.

Errors and noise are compared as ratios, all other metrics as differences, always second to first:

===============  =========================================================  =====================
unit             averaged over the common units                             interval
===============  =========================================================  =====================
window of noise  (ln v_b - ln v_a) / 2, the logarithm of the ratio          t; moderated t below 4
block of errors  (ln ms_b - ln ms_a) / 2, the typical block                 t; moderated t below 4
event of lag     |lag|: difference of the jackknife's pseudo-values         t
group of drift   |drift|: difference of the slopes, each with its own sign  t
event of a step  difference of magnitudes, Hodges-Lehmann                   signed rank, inverted
none             difference of the values                                   none
===============  =========================================================  =====================

The moderated t of the ranking (docs/metrics.md) takes its prior from the scatter between *different filters*. Two
settings of one filter scatter far less: with the prior their intervals were up to 30 times too wide. From four units
on the scatter is therefore the pair's own (coverage 95 to 98 %, benchmarks/paired_intervals.py).

Logs are pooled by random effects: tau^2 by DerSimonian & Laird (1986), interval by Hartung & Knapp (2001) with the
lower bound of Roever, Knapp & Friede (2015) on its variance, for few logs of unequal size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core.sorting import median
from attlog.metrics import ranking, statistics
from attlog.metrics.metric import Answer
from attlog.metrics.statistics import Kind, UnitValues, student, student_two_sided

Array = NDArray[np.float64]
Interval = tuple[float, float]
Scale = Literal["ratio", "difference"]
Direction = Literal["better", "worse", "same", "not significant"]

RATIO_KINDS: tuple[Kind, ...] = ("log_variance", "mean_square")
ALPHA = 0.05
# From this number of windows or blocks on a pair uses its own scatter (see above).
MIN_OWN_SCATTER_UNITS = 4
# Smallest mean square [deg^2] whose logarithm is taken: 1e-9 deg, below the resolution of a quaternion.
MIN_MEAN_SQUARE = 1e-18
OPPOSITE: dict[Direction, Direction] = {"better": "worse", "worse": "better"}


@dataclass(frozen=True, slots=True)
class Difference:
    """Second setting against the first in one metric, on one log or pooled over ``logs``.

    ``value``: ratio of the two distances from ideal, or their difference in the metric's unit. Below one or zero the
    second setting is nearer to ideal. None with a ``reason``. ``error``: standard error (of the logarithm for a ratio).
    ``floor``: resolution on the same scale. ``n``: common units of evidence. ``first``, ``second``: both answers on the
    common units, errors as the typical block. ``better``, ``worse``: number of logs by sign. ``tau``, ``i2_pct``,
    ``method``: of the pooling.
    """

    scale: Scale
    value: float | None = None
    ci95: Interval | None = None
    p: float | None = None
    error: float | None = None
    floor: float = 0.0
    direction: Direction = "not significant"
    n: int = 0
    first: float | None = None
    second: float | None = None
    logs: int = 1
    better: int = 0
    worse: int = 0
    tau: float | None = None
    i2_pct: float | None = None
    method: str = ""
    log: str = ""
    window: str = ""
    reason: str = ""

    @property
    def even(self) -> float:
        """Return the value that means no difference."""
        return 1.0 if self.scale == "ratio" else 0.0

    @property
    def significant(self) -> bool:
        """Return whether the second is significantly better or worse."""
        return self.direction in OPPOSITE

    @property
    def interval_side(self) -> int:
        """Return -1 if the interval favours the second setting, 1 the first, else 0."""
        if self.ci95 is None:
            return 0
        return -1 if self.ci95[1] < self.even else 1 if self.ci95[0] > self.even else 0

    def inverse(self) -> Difference:
        """Return the difference with both settings exchanged."""

        def back(x: float) -> float:
            if self.scale == "ratio":
                return 1.0 / x if x else math.inf
            return -x if x else 0.0

        return replace(
            self,
            value=None if self.value is None else back(self.value),
            ci95=None if self.ci95 is None else (back(self.ci95[1]), back(self.ci95[0])),
            direction=OPPOSITE.get(self.direction, self.direction),
            first=self.second,
            second=self.first,
            better=self.worse,
            worse=self.better,
        )


def paired(a: Answer, b: Answer, better: str) -> Difference:
    """Return the difference of answer ``b`` to ``a``; ``better`` is the metric's."""
    for answer in (a, b):
        if answer.value is None:
            return Difference("difference", reason=answer.reason or "no value")
    if a.units is None or b.units is None:
        return _without_units(a, b, better)
    common = np.intersect1d(a.units.ids, b.units.ids)
    most = max(len(a.units.ids), len(b.units.ids))
    needed = max(statistics.NEEDED[a.units.kind], math.ceil(ranking.MIN_UNITS * most))
    if len(common) < needed:
        reason = f"{len(common)} units of evidence in common; {needed} are needed"
        return Difference("ratio" if a.units.kind in RATIO_KINDS else "difference", reason=reason)
    first, second = a.units.of(common).value, b.units.of(common).value
    found = estimate_difference(a.units, b.units, common)
    resolution = ranking.floor(a, b)
    shown = [typical_value(u, common, v) for u, v in ((a.units, first), (b.units, second))]
    if not np.any(a.units.at(common) != b.units.at(common)):
        found = found._replace(value=0.0, ci95=(0.0, 0.0))
        p, direction = 1.0, "same"
        shown[1] = shown[0]
    else:
        p = _p_value(a.units, b.units, common)
        apart = _distance(second, better) - _distance(first, better)
        ends = found.ci95
        sure = p < ALPHA and (ends is None or not ends[0] <= 0.0 <= ends[1])
        sure = sure and abs(apart) > resolution and (apart < 0.0) == (found.value < 0.0)
        direction = ("better" if apart < 0.0 else "worse") if sure else "not significant"
    return _on_scale(found, p, resolution, direction, len(common), shown)  # type: ignore[arg-type]


def typical_value(units: UnitValues, common: NDArray[np.int64], value: float) -> float:
    """Return the answer on common units.

    It is ``value``, or for errors the root of the typical mean square.
    """
    if units.kind != "mean_square":
        return value
    return math.exp(0.5 * float(np.mean(_logarithms(units.at(common)))))


def _on_scale(
    found: Estimate, p: float, resolution: float, direction: Direction, n: int, shown: Sequence[float]
) -> Difference:
    """Convert an estimate to a difference; logarithms become ratios."""
    value, ci95, floor = found.value, found.ci95, resolution
    sides = int(value < 0.0), int(value > 0.0)
    if found.scale == "ratio":
        value = math.exp(value)
        ci95 = None if ci95 is None else (math.exp(ci95[0]), math.exp(ci95[1]))
        floor = math.log1p(floor / shown[0]) if shown[0] > 0.0 else 0.0
    return Difference(
        found.scale, value, ci95, p, found.error, floor, direction, n, shown[0], shown[1], 1, sides[0], sides[1]
    )


def _without_units(a: Answer, b: Answer, better: str) -> Difference:
    """Compare two answers without common units.

    They differ significantly where their intervals are disjoint.
    """
    first, second = float(a.value or 0.0), float(b.value or 0.0)
    apart, resolution = _distance(second, better) - _distance(first, better), ranking.floor(a, b)
    same = Difference("difference", 0.0, floor=resolution, direction="same", first=first, second=second)
    if first == second:
        return same
    near_a, _, far_a = ranking.distance(a, better)
    near_b, _, far_b = ranking.distance(b, better)
    known = a.ci95 is not None and b.ci95 is not None
    sure = known and (far_a < near_b or far_b < near_a) and abs(apart) > resolution
    direction: Direction = ("better" if apart < 0.0 else "worse") if sure else "not significant"
    return replace(same, value=apart, direction=direction, better=int(apart < 0.0), worse=int(apart > 0.0))


def _distance(value: float, better: str) -> float:
    """Return the distance of a value from its ideal."""
    return ranking.distance(Answer(value, "", ""), better)[1]


class Estimate(NamedTuple):
    """Estimated difference over units; of logarithms for ratios."""

    scale: Scale
    value: float
    ci95: Interval | None
    error: float


def estimate_difference(a: UnitValues, b: UnitValues, common: NDArray[np.int64]) -> Estimate:
    """Estimate the difference of ``b`` to ``a`` over common units (k,)."""
    x, y = a.at(common), b.at(common)
    kind = a.kind
    if kind in RATIO_KINDS:
        d = 0.5 * (y - x if kind == "log_variance" else _logarithms(y) - _logarithms(x))
        if len(d) < MIN_OWN_SCATTER_UNITS:  # the prior is for logarithms of variances, which are twice d
            prior = statistics.VariancePrior(statistics.PRIORS[kind].variance / 4.0, statistics.PRIORS[kind].dof)
            return Estimate("ratio", *moderated_mean(d, prior))
        return Estimate("ratio", *_student_mean(d))
    if kind == "step_event":
        return Estimate("difference", *hodges_lehmann(y - x))
    d = np.copysign(1.0, np.mean(y)) * y - np.copysign(1.0, np.mean(x)) * x
    return Estimate("difference", *_student_mean(d))


def _student_mean(d: Array) -> tuple[float, Interval, float]:
    """Return mean, t interval and standard error of values (k,)."""
    value, error = float(np.mean(d)), float(np.std(d, ddof=1)) / math.sqrt(len(d))
    half = student(0.975, len(d) - 1) * error
    return value, (value - half, value + half), error


def _p_value(a: UnitValues, b: UnitValues, common: NDArray[np.int64]) -> float:
    """Return the two-sided p of equality on common units (k,).

    Its test is the one that the interval inverts.
    """
    if a.kind not in RATIO_KINDS or len(common) < MIN_OWN_SCATTER_UNITS:
        return statistics.p_value(a, b, common)
    found = estimate_difference(a, b, common)
    if found.error == 0.0:
        return 1.0 if found.value == 0.0 else 0.0
    return student_two_sided(found.value / found.error, len(common) - 1)


def _logarithms(squares: Array) -> Array:
    return np.asarray(np.log(np.maximum(squares, MIN_MEAN_SQUARE)))


def moderated_mean(d: Array, prior: statistics.VariancePrior) -> tuple[float, Interval, float]:
    """Return mean, moderated t interval and standard error of values (k,)."""
    low, high = statistics.moderated_interval(d, prior)
    half = 0.5 * (high - low)
    return 0.5 * (low + high), (low, high), half / student(0.975, prior.dof + len(d) - 1)


def hodges_lehmann(d: Array) -> tuple[float, Interval | None, float]:
    """Return the Hodges-Lehmann estimate, its signed-rank interval and standard error.

    The estimate is the median of the Walsh averages of differences (k,). The standard error is a quarter of the
    interval (Hollander & Wolfe, section 3.2). Below six differences the test rejects nothing at 5 %: there is no
    interval.
    """
    i, j = np.triu_indices(len(d))
    walsh = np.sort(0.5 * (d[i] + d[j]))
    value, n, m = float(median(walsh)), len(d), len(walsh)
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


class PooledMean(NamedTuple):
    """Mean of several logs.

    ``tau``: scatter of the true value between logs. ``i2_pct``: its share of all scatter.
    """

    value: float
    ci95: Interval
    p: float
    tau: float
    i2_pct: float
    method: str


def pool_values(values: Sequence[float], errors: Sequence[float | None]) -> PooledMean:
    """Pool k >= 2 values with standard errors.

    If an error is unknown (None), all values have equal weight.
    """
    y = np.asarray(values, np.float64)
    k = len(y)
    if not np.any(y):
        return PooledMean(0.0, (0.0, 0.0), 1.0, 0.0, 0.0, "equal on every log")
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
    return PooledMean(mean, (mean - half, mean + half), p, tau, i2, method)


def pool(differences: Sequence[Difference], scale: Scale) -> Difference | None:
    """Pool the differences of several logs; one log is returned unchanged."""
    usable = [d for d in differences if d.value is not None]
    if not usable:
        return None
    signs = sum(d.better for d in usable), sum(d.worse for d in usable)
    floor = median([d.floor for d in usable])
    if len(usable) == 1:
        method = "one log" if usable[0].value != usable[0].even else "equal on every log"
        return replace(usable[0], log="", n=1, first=None, second=None, tau=0.0, i2_pct=0.0, method=method)
    forward, back = (math.log, math.exp) if scale == "ratio" else (float, float)
    found = pool_values([forward(d.value or 0.0) for d in usable], [d.error for d in usable])
    direction: Direction = "not significant"
    if not any(signs):
        direction = "same"
    elif found.p < ALPHA and abs(found.value) > floor:
        direction = "better" if found.value < 0.0 else "worse"
    ci95 = back(found.ci95[0]), back(found.ci95[1])
    k = len(usable)
    return Difference(
        scale,
        back(found.value),
        ci95,
        found.p,
        floor=floor,
        direction=direction,
        n=k,
        logs=k,
        better=signs[0],
        worse=signs[1],
        tau=found.tau,
        i2_pct=found.i2_pct,
        method=found.method,
    )


def dersimonian_laird(y: Array, variance: Array) -> tuple[float, float]:
    """Return tau^2, and I^2 in percent, of values (k,) with variances (k,)."""
    w = 1.0 / variance
    centre = float(w @ y / w.sum())
    q = float(w @ (y - centre) ** 2)
    spread = q - (len(y) - 1)
    tau2 = max(0.0, spread / float(w.sum() - (w @ w) / w.sum()))
    return tau2, max(0.0, 100.0 * spread / q) if q > 0.0 else 0.0


def hartung_knapp(y: ArrayLike, weights: ArrayLike, least: bool = False) -> tuple[float, float]:
    """Return the weighted mean of values (k,) and its Hartung-Knapp standard error.

    ``least``: not below 1/sqrt(sum w).
    """
    y, w = np.asarray(y, np.float64), np.asarray(weights, np.float64)
    mean = float(w @ y / w.sum())
    scatter = float(w @ (y - mean) ** 2) / (len(y) - 1)
    return mean, math.sqrt((max(scatter, 1.0) if least else scatter) / float(w.sum()))
