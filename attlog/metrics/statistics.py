"""Quantiles, 95 % intervals, grouped sums, units of evidence, paired tests of rows, error sizes.

The incomplete gamma and beta functions are summed as in Abramowitz & Stegun (6.5.29, 6.5.31, 26.5.8) and inverted by
bisection or Newton. The tests compare them with scipy, whose import costs half a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from statistics import NormalDist
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core.plain import IN_JSON, NumberArray
from attlog.core.sorting import median

Array = NDArray[np.float64]

_TINY = 1e-300
_MAX_TERMS = 2000
_MIN_NEWTON_DOF = 30.0
# Degrees of freedom below which Student's tails are too long for Newton's steps.
_MIN_STUDENT_NEWTON_DOF = 2.0
_MAX_NEWTON_STEPS = 30


@lru_cache(maxsize=4096)
def chi_square(probability: float, dof: float) -> float:
    """Return the chi-square quantile for ``dof`` degrees of freedom."""
    if dof < _MIN_NEWTON_DOF:
        return 2.0 * _invert(lambda x: _lower_gamma(0.5 * dof, x), probability)
    # Wilson and Hilferty's cube, then Newton: bisection would sum a long series a hundred times
    a, ninth = 0.5 * dof, 2.0 / (9.0 * dof)
    x = a * (1.0 - ninth + NormalDist().inv_cdf(probability) * math.sqrt(ninth)) ** 3
    for _ in range(3):
        density = math.exp((a - 1.0) * math.log(x) - x - math.lgamma(a))
        x -= (_lower_gamma(a, x) - probability) / density
    return 2.0 * x


@lru_cache(maxsize=4096)
def student(probability: float, dof: float) -> float:
    """Return the quantile of Student's t for ``dof`` degrees of freedom."""
    if probability == 0.5:
        return 0.0
    if probability < 0.5:
        return -student(1.0 - probability, dof)
    if dof >= _MIN_STUDENT_NEWTON_DOF:
        return _student_by_newton(probability, dof)
    upper = 2.0 * (1.0 - probability)
    return _invert(lambda t: 1.0 - _beta(0.5 * dof, 0.5, dof / (dof + t * t)), 1.0 - upper)


def _student_by_newton(probability: float, dof: float) -> float:
    """Invert the distribution of t by Newton's method.

    Starts at the normal quantile, which is smaller: the distribution is concave there, so no step overshoots.
    """
    t = NormalDist().inv_cdf(probability)
    front = math.exp(math.lgamma(0.5 * dof + 0.5) - math.lgamma(0.5 * dof)) / math.sqrt(math.pi * dof)
    for _ in range(_MAX_NEWTON_STEPS):
        density = front * math.exp(-0.5 * (dof + 1.0) * math.log1p(t * t / dof))
        step = (0.5 * student_two_sided(t, dof) - (1.0 - probability)) / density
        t += step
        if abs(step) <= 1e-9 * t + 1e-13:  # quadratic convergence: the next step is below rounding
            break
    return t


def student_two_sided(t: float, dof: float) -> float:
    """Return the probability of a value of Student's t beyond +-``t``."""
    return _beta(0.5 * dof, 0.5, dof / (dof + t * t))


def students_two_sided(t: Array, dof: float) -> Array:
    """Return :func:`student_two_sided` of values ``t`` (m,)."""
    return np.array([student_two_sided(x, dof) for x in t.tolist()], np.float64)


def _invert(rising: Callable[[float], float], target: float) -> float:
    low, high = 0.0, 1.0
    while rising(high) < target and high < 1e12:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        if rising(middle) < target:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _lower_gamma(a: float, x: float) -> float:
    """Return the regularised lower incomplete gamma function P(a, x)."""
    if x <= 0:
        return 0.0
    front = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        term = total = 1.0 / a
        for k in range(1, _MAX_TERMS):
            term *= x / (a + k)
            total += term
            if term < 1e-16 * total:
                break
        return front * total
    # modified Lentz algorithm for the continued fraction of Q(a, x)
    b = x + 1.0 - a
    c, d = 1.0 / _TINY, 1.0 / b
    h = d
    for k in range(1, _MAX_TERMS):
        b += 2.0
        numerator = -k * (k - a)
        d = 1.0 / _nonzero(numerator * d + b)
        c = _nonzero(b + numerator / c)
        h *= d * c
        if abs(d * c - 1.0) < 1e-15:
            break
    return 1.0 - front * h


def _beta(a: float, b: float, x: float) -> float:
    """Return the regularised incomplete beta function I_x(a, b)."""
    if not 0.0 < x < 1.0:
        return x if math.isnan(x) else float(x >= 1.0)
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _beta(b, a, 1.0 - x)
    front = math.exp(math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)) / a
    c, d = 1.0, 1.0 / _nonzero(1.0 - (a + b) * x / (a + 1.0))
    h = d
    for m in range(1, _MAX_TERMS):
        for numerator in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1.0 / _nonzero(1.0 + numerator * d)
            c = _nonzero(1.0 + numerator / c)
            h *= d * c
        if abs(d * c - 1.0) < 1e-15:
            break
    return front * h


def _nonzero(x: float) -> float:
    return x if abs(x) > _TINY else _TINY


# 95 % intervals: of a mean, of a variance, of a pooled fit, of a quantile.

Interval = tuple[float, float]


class VariancePrior(NamedTuple):
    """Prior ``variance`` of one value, worth ``dof`` degrees of freedom."""

    variance: float
    dof: float


# Prior of the squared change of log(mean square error) between adjacent parts of a flight: 0.9 to 1.5 for parts of 2.5
# to 80 s, in flights with truth and in real logs. Its weight was chosen so that halves of flights agree.
WANDERING = VariancePrior(1.3, 2.0)
# Weights of the change between halves, and between the quarters of each half.
CHANGE_WEIGHTS = (1.5, 0.75, 0.75)
# Sigmas of the reference in an interval. Its errors last as long as the record: 95 % of those against a smoother were
# within one sigma.
REFERENCE_SIGMAS = 2.0
# Largest correlation used, as that of few values is uncertain; it doubles an interval.
MAX_NEIGHBOUR_CORRELATION = 0.6
# Correlation of blocks of errors two apart from which they are a slow error, and largest one of neighbours. Equal rows
# with errors of 100 s in 200 s of flight are told apart in 21 % (were 60 %). On 20 simulated flights a half of the
# flight orders 3 pairs by heading and none turns round in the other half (were 6 of 21), 381 by tilt (were 519).
SLOW_CORRELATION, MAX_BLOCK_CORRELATION = 0.3, 0.95
# Logarithm of mean squares by which every block differs only of unequal rows: 2.7 times the error.
CLEAR = 2.0


def mean_interval(values: ArrayLike) -> Interval | None:
    """Return the t interval of the mean of independent values (k,)."""
    x = np.asarray(values, np.float64)
    if len(x) < 2:
        return None
    half = student(0.975, len(x) - 1) * float(np.std(x, ddof=1)) / math.sqrt(len(x))
    centre = float(np.mean(x))
    return centre - half, centre + half


def neighbour_interval(values: ArrayLike) -> Interval | None:
    """Return the t interval of the mean of consecutive, correlated values (k,).

    Widened by sqrt((1 + r) / (1 - r)) as for a first-order process; r is the correlation of neighbours, plus 1/k for
    its bias, limited to 0 ... MAX_NEIGHBOUR_CORRELATION. None for fewer than two values.
    """
    x = np.asarray(values, np.float64)
    ends = mean_interval(x)
    d = x - np.mean(x) if ends is not None else x
    square = float(d @ d)
    if ends is None or len(x) < 3 or not square > 0.0:
        return ends
    r = min(max(float(d[1:] @ d[:-1]) / square + 1.0 / len(x), 0.0), MAX_NEIGHBOUR_CORRELATION)
    centre, half = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]) * math.sqrt((1.0 + r) / (1.0 - r))
    return centre - half, centre + half


def wandering_interval(value: float, changes: Sequence[float]) -> Interval:
    """Return the interval of an error that varies on all time scales.

    Longer records do not average such an error. ``changes`` (3,) of the logarithm of its mean square: between the
    halves of the record, and between the quarters of each half. A next record is expected to differ as one half does
    from the other; WANDERING is the prior of the change. The interval is a factor.
    """
    dof = WANDERING.dof + sum(CHANGE_WEIGHTS)
    own = sum(weight * change * change for weight, change in zip(CHANGE_WEIGHTS, changes, strict=True))
    square = (WANDERING.dof * WANDERING.variance + own) / dof
    factor = math.exp(0.5 * student(0.975, dof) * math.sqrt(0.5 * square))
    return value / factor, value * factor


def widen_by_reference(value: float, ci95: Interval, sigma: float) -> Interval:
    """Widen an error's interval by the reference's own error.

    ``sigma``: its one sigma, RMS. The RMS of the difference deviates from the true RMS by at most the RMS of the
    reference's error, for any correlation (triangle inequality). 2 sigma are added as root sum of squares.
    """
    low, high = (math.hypot(value - end, REFERENCE_SIGMAS * sigma) for end in ci95)
    return value - low, value + high


def jackknife_interval(value: float, left_out: ArrayLike) -> Interval | None:
    """Return the t interval around ``value`` from leave-one-out values (k,)."""
    x = np.asarray(left_out, np.float64)
    k = len(x)
    if k < 3 or not np.isfinite(x).all():
        return None
    error = math.sqrt((k - 1) / k * float(np.sum((x - np.mean(x)) ** 2)))
    half = student(0.975, k - 1) * error
    return value - half, value + half


def chi_square_interval(sigma: float, dof: float) -> Interval:
    """Return the interval of a standard deviation with ``dof`` degrees of freedom."""
    return sigma * math.sqrt(dof / chi_square(0.975, dof)), sigma * math.sqrt(dof / chi_square(0.025, dof))


def median_interval(values: ArrayLike) -> Interval | None:
    """Return the interval of a median by order statistics.

    From the r-th smallest to the r-th largest value, r the largest rank whose binomial coverage is at least 95 %. None
    for fewer than six values.
    """
    x = np.sort(np.asarray(values, np.float64))
    rank = _median_rank(len(x))
    return (float(x[rank - 1]), float(x[len(x) - rank])) if rank else None


@lru_cache(maxsize=1024)
def _median_rank(k: int) -> int:
    """Return the rank r of :func:`median_interval` for k values; 0 for none.

    Integers: shares of 2^k underflow for more than about a thousand values.
    """
    outside, ways, rank = 0, 1, 0
    while rank < k // 2 and 40 * (outside + ways) <= 1 << k:
        outside += ways
        ways = ways * (k - rank) // (rank + 1)
        rank += 1
    return rank


@lru_cache(maxsize=256)
def _edges(n: int, count: int) -> tuple[int, ...]:
    return tuple(np.linspace(0, n, count + 1).round().astype(int).tolist())


def equal_groups(n: int, count: int) -> list[slice]:
    """Return ``count`` consecutive slices of ``n`` samples, equal to one sample."""
    return [slice(a, b) for a, b in pairwise(_edges(n, min(count, n)))]


def group_sums(values: Array, first: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
    """Return the sums (k,) of ``values[first:last]`` for k ranges of values (n,)."""
    if len(first) == 0:
        return np.zeros(0)
    ends = np.column_stack([first, last]).ravel()
    if ends[-1] == len(values):
        ends = ends[:-1]  # reduceat extends the last range to the end
    padded = values if ends.max() < len(values) else np.append(values, 0.0)
    return np.where(last > first, np.add.reduceat(padded, ends)[::2], 0.0)


def group_means(values: Array, groups: list[slice]) -> Array:
    """Return the means (k,) of nonempty groups of ``values`` (n,)."""
    first, last = np.array([(g.start, g.stop) for g in groups]).T
    return np.asarray(group_sums(values, first, last) / (last - first))


def quantile(ordered: Array, probability: float) -> float:
    """Return a quantile of ascending values (Hyndman & Fan 1996, definition 7)."""
    place = probability * (len(ordered) - 1)
    below = min(int(place), len(ordered) - 1)
    low, high = float(ordered[below]), float(ordered[min(below + 1, len(ordered) - 1)])
    return low + (place - below) * (high - low)


def _moderated(values: Array, prior: VariancePrior) -> tuple[Array, Array, float]:
    """Return moderated means, standard errors (m,) and degrees of freedom.

    Of values (m, k), k >= 1, per row (Smyth 2004).
    """
    k = values.shape[1]
    own = np.var(values, axis=1, ddof=1) if k > 1 else np.zeros(len(values))
    dof = prior.dof + k - 1
    return np.mean(values, axis=1), np.sqrt((prior.dof * prior.variance + (k - 1) * own) / dof / k), dof


def moderated_interval(values: ArrayLike, prior: VariancePrior) -> tuple[float, float]:
    """Return the 95 % interval of a mean with a prior variance."""
    means, errors, dof = _moderated(np.asarray(values, np.float64)[None], prior)
    mean, half = float(means[0]), student(0.975, dof) * float(errors[0])
    return mean - half, mean + half


def moderated_p_value(values: Array, prior: VariancePrior) -> Array:
    """Return two-sided p (m,) that means of values (m, k) are zero."""
    means, errors, dof = _moderated(values, prior)
    return students_two_sided(means / errors, dof)


def correlated_p_value(values: Array, prior: VariancePrior) -> Array:
    """Return two-sided p (m,) that means of consecutive values (m, k) are zero, which may be one slow error.

    Where values two apart correlate by SLOW_CORRELATION and not all are beyond CLEAR, as of a first-order process: with
    the correlation r of neighbours (plus 1/k for the bias of its estimate) k values are worth n = k (1 - r) / (1 + r).
    """
    k = values.shape[1]
    means, errors, dof = _moderated(values, prior)
    if k < 4:
        return students_two_sided(means / errors, dof)
    d = values - means[:, None]
    square = np.maximum(np.sum(d * d, axis=1), 1e-30)
    near, far = (np.sum(d[:, lag:] * d[:, :-lag], axis=1) / square for lag in (1, 2))
    slow = (far * k / (k - 2) + 1.0 / k > SLOW_CORRELATION) & (np.min(values * np.sign(means)[:, None], axis=1) < CLEAR)
    r = np.where(slow, np.clip(near + 1.0 / k, 0.0, MAX_BLOCK_CORRELATION), 0.0)
    independent = k * (1.0 - r) / (1.0 + r)
    # only the values' own scatter is slow, not that which the prior adds
    errors = np.sqrt((prior.dof * prior.variance / k + square / independent) / dof)
    sizes, dofs = means / errors, prior.dof + np.maximum(independent - 1.0, 0.0)
    return np.array([student_two_sided(t, n) for t, n in zip(sizes.tolist(), dofs.tolist(), strict=True)])


# Units of evidence of an answer, paired tests of rows, error sizes.

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
        return float(median(values))
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
    if kind == "mean_square":
        return correlated_p_value(_logarithms(x) - _logarithms(y), PRIORS[kind])
    return moderated_p_value(x - y, PRIORS[kind])


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
HALVES_AND_QUARTERS = ((0, 2), (2, 4), (0, 1), (1, 2), (2, 3), (3, 4))  # from, to; in quarters
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
    return equal_groups(n, int(np.clip(duration // GROUP_S, 4, MAX_GROUPS)))


def root_mean_square(angle: Array, groups: list[slice]) -> tuple[float, Interval | None]:
    """Return the RMS of an angle (n,) and its 95 % interval.

    The t interval of the groups' mean squares. The relative error of the mean square becomes a factor (delta method),
    so that the interval of a short, uneven record stays above zero.
    """
    squares = angle**2
    square = float(np.mean(squares))
    spread = neighbour_interval(group_means(squares, groups)) if len(groups) > 1 else None
    if spread is None or square == 0.0:
        return math.sqrt(square), None if spread is None else (0.0, 0.0)
    factor = math.exp(0.25 * (spread[1] - spread[0]) / square)
    return math.sqrt(square), (math.sqrt(square) / factor, min(math.sqrt(square) * factor, HALF_TURN_DEG))


class ErrorSize:
    """Size of an unsigned error angle (n,) in deg over ``duration`` s.

    ``sigma``: the reference's own error (one sigma, RMS over the record, deg). ``noise``: its white noise in deg, which
    is independent of the row and taken out of the RMSE.
    """

    def __init__(self, angle: Array, duration: float, sigma: float = 0.0, noise: float = 0.0) -> None:
        self._angle, self._sigma, self._noise = angle, sigma, noise
        self.pieces = PIECES if duration >= SHORTEST_S and len(angle) >= MIN_SAMPLES else 0
        self._rms: list[float] = []

    def of(self, name: str) -> tuple[float, Interval | None]:
        """Return one of STATISTICS and its interval (None for short records)."""
        whole, *parts = self._sizes(name)
        if not self.pieces:
            return whole, None
        changes = _changes(parts, whole)
        if name != "rmse":  # a percentile rests on few samples: at least the changes of the RMS
            square, *squares = self._sizes("rmse")
            changes = list(map(max, changes, _changes(squares, square)))
        low, high = wandering_interval(whole, changes)
        low, high = widen_by_reference(whole, (low, min(high, MAX_INTERVAL_RATIO * whole)), self._sigma)
        return whole, (max(low, 0.0), min(high, HALF_TURN_DEG))

    def _sizes(self, name: str) -> list[float]:
        """Return the size of the whole, of both halves and four quarters."""
        ends = _edges(len(self._angle), self.pieces or 1)
        parts = HALVES_AND_QUARTERS if self.pieces else ()
        places = [(0, ends[-1]), *((ends[a], ends[b]) for a, b in parts)]
        if name != "rmse":
            return [quantile(_ordered_at(self._angle[a:b], P95), P95) for a, b in places]
        if not self._rms:
            sums = np.add.reduceat(self._angle**2, ends[:-1]).tolist()
            squares = [sum(sums), *(sum(sums[a:b]) for a, b in parts)]
            own = [square / (b - a) - self._noise**2 for square, (a, b) in zip(squares, places, strict=True)]
            self._rms = [math.sqrt(max(square, 0.0)) for square in own]
        return self._rms


def _changes(parts: list[float], whole: float) -> list[float]:
    """Return changes (3,) of log mean square between halves and quarters.

    The size of a part is limited to a thousandth of the whole, as its logarithm is unbounded.
    """
    if not whole > 0.0:
        return [0.0] * (len(parts) // 2)
    size = [2.0 * math.log(max(part, 1e-3 * whole)) for part in parts]
    return [abs(b - a) for a, b in zip(size[::2], size[1::2], strict=True)]


def _ordered_at(values: Array, probability: float) -> Array:
    """Return the values (n,) partitioned around a quantile."""
    place = int(probability * (len(values) - 1))
    return np.partition(values, [place, min(place + 1, len(values) - 1)])
