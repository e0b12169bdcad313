"""95 % intervals: of a mean, of a variance, of a pooled fit, of a quantile."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.metrics.statistics.quantiles import chi_square, student, students_two_sided

Array = NDArray[np.float64]


Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class VariancePrior:
    """What is known of the variance of one value: ``variance``, worth ``dof`` degrees of freedom."""

    variance: float
    dof: float


WANDERING = VariancePrior(1.3, 2.0)
"""Squared change of the logarithm of an error's mean square from one piece of a flight to the next: 0.9 to 1.5 whether
pieces last 2.5 or 80 s, in flights with truth and in real logs (its prior is worth what makes halves of flights
agree)."""
WEIGHTS = (1.5, 0.75, 0.75)
"""What the change between halves counts, and those between the quarters of each: what both tell of the next record."""
REFERENCE_SIGMAS = 2.0
"""A sum of errors that last as long as the record: of those against a smoother 95 % were within one of its sigmas."""
MOST_ALIKE = 0.6
"""Few values tell their own correlation badly: none is taken for more than this, which doubles an interval."""


def of_mean(values: ArrayLike) -> Interval | None:
    """t interval of the mean of independent values (k,); None for fewer than two."""
    x = np.asarray(values, np.float64)
    if len(x) < 2:
        return None
    half = student(0.975, len(x) - 1) * float(np.std(x, ddof=1)) / math.sqrt(len(x))
    centre = float(np.mean(x))
    return centre - half, centre + half


def of_neighbours(values: ArrayLike) -> Interval | None:
    """t interval of the mean of consecutive values (k,) that may resemble their neighbours; None for fewer than two.

    Widened by sqrt((1 + r) / (1 - r)), as the mean of a first-order process is: r is the correlation of neighbours,
    less its bias of -1/k, from 0 to MOST_ALIKE.
    """
    x = np.asarray(values, np.float64)
    ends = of_mean(x)
    d = x - np.mean(x) if ends is not None else x
    square = float(d @ d)
    if ends is None or len(x) < 3 or not square > 0.0:
        return ends
    r = min(max(float(d[1:] @ d[:-1]) / square + 1.0 / len(x), 0.0), MOST_ALIKE)
    centre, half = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]) * math.sqrt((1.0 + r) / (1.0 - r))
    return centre - half, centre + half


def of_wandering(value: float, changes: ArrayLike) -> Interval:
    """Interval of the size of an error that wanders on every scale of time: longer records do not average it out.

    ``changes`` (3,): by how much the logarithm of its mean square changes from the first to the second half of the
    record, and between the two quarters of each half. They tell how much it would change to the next record (a half is
    to the other what the record is to the next), moderated by WANDERING. The interval is a factor.
    """
    weights = np.array(WEIGHTS)
    dof = WANDERING.dof + float(np.sum(weights))
    square = (WANDERING.dof * WANDERING.variance + float(weights @ np.asarray(changes, np.float64) ** 2)) / dof
    factor = math.exp(0.5 * student(0.975, dof) * math.sqrt(0.5 * square))
    return value / factor, value * factor


def with_reference(value: float, ci95: Interval, sigma: float) -> Interval:
    """The interval of an error against a reference that is wrong itself by ``sigma`` (one sigma, RMS).

    The RMS of a difference is within the RMS of the reference's error of that of the truth, however both are correlated
    (triangle inequality): 2 sigma, independent of the rest.
    """
    low, high = (math.hypot(value - end, REFERENCE_SIGMAS * sigma) for end in ci95)
    return value - low, value + high


def of_jackknife(value: float, left_out: ArrayLike) -> Interval | None:
    """t interval around ``value`` from the values (k,) found with one event left out; None for fewer than three."""
    x = np.asarray(left_out, np.float64)
    k = len(x)
    if k < 3 or not np.isfinite(x).all():
        return None
    error = math.sqrt((k - 1) / k * float(np.sum((x - np.mean(x)) ** 2)))
    half = student(0.975, k - 1) * error
    return value - half, value + half


def of_sigma_chi_square(sigma: float, dof: float) -> Interval:
    """Interval of a standard deviation whose variance has ``dof`` degrees of freedom."""
    return sigma * math.sqrt(dof / chi_square(0.975, dof)), sigma * math.sqrt(dof / chi_square(0.025, dof))


def of_sigma_log(sigma: float, variances: ArrayLike) -> Interval | None:
    """Interval of a pooled standard deviation: t interval on the logarithm of the window variances (k,)."""
    v = np.asarray(variances, np.float64)
    if len(v) < 2 or not (v > 0).all():
        return None
    half = 0.5 * student(0.975, len(v) - 1) * float(np.std(np.log(v), ddof=1)) / math.sqrt(len(v))
    return sigma * math.exp(-half), sigma * math.exp(half)


def of_median(values: ArrayLike) -> Interval | None:
    """Interval of the median of independent values (k,) from order statistics; None for fewer than six.

    The r-th smallest and r-th largest value, r the largest rank whose binomial coverage is at least 95 %.
    """
    x = np.sort(np.asarray(values, np.float64))
    rank = _median_rank(len(x))
    return (float(x[rank - 1]), float(x[len(x) - rank])) if rank else None


@lru_cache(maxsize=1024)
def _median_rank(k: int) -> int:
    """How many of k values may lie outside on each side: twice the coins of k that show so few heads, at most 5 %.

    Whole numbers: their shares of 2^k are too small for floating point from some thousand values on.
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
    """``count`` consecutive slices of ``n`` samples, sizes equal to one sample; fewer where there are not so many."""
    return [slice(a, b) for a, b in pairwise(_edges(n, min(count, n)))]


def sums(values: Array, first: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
    """The sums (k,) of ``values[first:last]`` for k ranges of values (n,)."""
    if len(first) == 0:
        return np.zeros(0)
    ends = np.column_stack([first, last]).ravel()
    if ends[-1] == len(values):
        ends = ends[:-1]  # the last range goes to the end of the values by itself
    padded = values if ends.max() < len(values) else np.append(values, 0.0)
    return np.where(last > first, np.add.reduceat(padded, ends)[::2], 0.0)


def means(values: Array, groups: list[slice]) -> Array:
    """The mean (k,) of each of k groups of ``values`` (n,), none of them empty."""
    first, last = np.array([(g.start, g.stop) for g in groups]).T
    return np.asarray(sums(values, first, last) / (last - first))


def quantile(ordered: Array, probability: float) -> float:
    """The quantile of values (n,) in ascending order, linear between them (Hyndman & Fan 1996, definition 7)."""
    place = probability * (len(ordered) - 1)
    below = min(int(place), len(ordered) - 1)
    low, high = float(ordered[below]), float(ordered[min(below + 1, len(ordered) - 1)])
    return low + (place - below) * (high - low)


def _moderated(values: Array, prior: VariancePrior) -> tuple[Array, Array, float]:
    """Means (m,) of values (m, k), k >= 1, their standard errors (m,) and the degrees of freedom."""
    k = values.shape[1]
    own = np.var(values, axis=1, ddof=1) if k > 1 else np.zeros(len(values))
    dof = prior.dof + k - 1
    return np.mean(values, axis=1), np.sqrt((prior.dof * prior.variance + (k - 1) * own) / dof / k), dof


def of_moderated(values: ArrayLike, prior: VariancePrior) -> tuple[float, float]:
    """The 95 % interval of the mean of values (k,), k >= 1."""
    means, errors, dof = _moderated(np.asarray(values, np.float64)[None], prior)
    mean, half = float(means[0]), student(0.975, dof) * float(errors[0])
    return mean - half, mean + half


def p_of_moderated(values: Array, prior: VariancePrior) -> Array:
    """Two-sided p (m,) that the means of values (m, k), k >= 1, are zero."""
    means, errors, dof = _moderated(values, prior)
    return students_two_sided(means / errors, dof)
