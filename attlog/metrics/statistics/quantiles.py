"""Quantiles of the chi-square and Student distributions, for real degrees of freedom.

The incomplete gamma and beta functions are summed as in Abramowitz & Stegun (6.5.29,
6.5.31, 26.5.8) and inverted by bisection. scipy has the same numbers (the tests compare);
importing it costs half a second, which a short analysis would notice.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TINY = 1e-300
_STEPS = 2000
_MANY = 30.0
_FEW = 2.0
"""Degrees of freedom below which Student's tails are too long for Newton's steps."""
_NEWTON = 30


@lru_cache(maxsize=4096)
def chi_square(probability: float, dof: float) -> float:
    """The value below which a chi-square variable with ``dof`` degrees of freedom stays with ``probability``."""
    if dof < _MANY:
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
    """The value below which Student's t with ``dof`` degrees of freedom stays with ``probability``."""
    if probability == 0.5:
        return 0.0
    if probability < 0.5:
        return -student(1.0 - probability, dof)
    if dof >= _FEW:
        return _student_by_newton(probability, dof)
    upper = 2.0 * (1.0 - probability)
    return _invert(lambda t: 1.0 - _beta(0.5 * dof, 0.5, dof / (dof + t * t)), 1.0 - upper)


def _student_by_newton(probability: float, dof: float) -> float:
    """From the normal quantile, which is smaller: the distribution is concave there, so that no step goes too far."""
    t = NormalDist().inv_cdf(probability)
    front = math.exp(math.lgamma(0.5 * dof + 0.5) - math.lgamma(0.5 * dof)) / math.sqrt(math.pi * dof)
    for _ in range(_NEWTON):
        density = front * math.exp(-0.5 * (dof + 1.0) * math.log1p(t * t / dof))
        step = (0.5 * student_two_sided(t, dof) - (1.0 - probability)) / density
        t += step
        if abs(step) <= 1e-9 * t + 1e-13:  # the next one would be its square
            break
    return t


def student_two_sided(t: float, dof: float) -> float:
    """The probability that Student's t with ``dof`` degrees of freedom lies further from zero than ``t``."""
    return _beta(0.5 * dof, 0.5, dof / (dof + t * t))


def students_two_sided(t: Array, dof: float) -> Array:
    """The same for many ``t`` (m,) of one ``dof``."""
    return _betas(0.5 * dof, 0.5, dof / (dof + t * t))


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
    """Regularised lower incomplete gamma function P(a, x)."""
    if x <= 0:
        return 0.0
    front = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        term = total = 1.0 / a
        for k in range(1, _STEPS):
            term *= x / (a + k)
            total += term
            if term < 1e-16 * total:
                break
        return front * total
    # modified Lentz algorithm for the continued fraction of Q(a, x)
    b = x + 1.0 - a
    c, d = 1.0 / _TINY, 1.0 / b
    h = d
    for k in range(1, _STEPS):
        b += 2.0
        numerator = -k * (k - a)
        d = 1.0 / _nonzero(numerator * d + b)
        c = _nonzero(b + numerator / c)
        h *= d * c
        if abs(d * c - 1.0) < 1e-15:
            break
    return 1.0 - front * h


def _beta(a: float, b: float, x: float) -> float:
    """Regularised incomplete beta function I_x(a, b)."""
    if x <= 0.0 or x >= 1.0:
        return float(x >= 1.0)
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _beta(b, a, 1.0 - x)
    front = math.exp(math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)) / a
    c, d = 1.0, 1.0 / _nonzero(1.0 - (a + b) * x / (a + 1.0))
    h = d
    for m in range(1, _STEPS):
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


def _betas(a: float, b: float, x: Array) -> Array:
    """:func:`_beta` of many x (m,), whose continued fractions run side by side until the last one stands."""
    found, inside = np.where(np.isnan(x), x, x >= 1.0), (x > 0.0) & (x < 1.0)
    mirrored = inside & (x > (a + 1.0) / (a + b + 2.0))
    if mirrored.any():
        found[mirrored] = 1.0 - _betas(b, a, 1.0 - x[mirrored])
    own = np.flatnonzero(inside & ~mirrored)
    x = x[own]
    front = np.exp(math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * np.log(x) + b * np.log1p(-x)) / a
    c, d = np.ones(len(x)), 1.0 / _nonzeros(1.0 - (a + b) * x / (a + 1.0))
    h = d.copy()
    for m in range(1, _STEPS if len(own) else 1):
        for numerator in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1.0 / _nonzeros(1.0 + numerator * d)
            c = _nonzeros(1.0 + numerator / c)
            h *= d * c
        moving = np.abs(d * c - 1.0) >= 1e-15
        if not moving.all():
            found[own[~moving]] = (front * h)[~moving]
            own = own[moving]
            x, front, c, d, h = (v[moving] for v in (x, front, c, d, h))
            if not len(own):
                break
    found[own] = front * h
    return found


def _nonzeros(x: Array) -> Array:
    return np.where(np.abs(x) > _TINY, x, _TINY)


def _nonzero(x: float) -> float:
    return x if abs(x) > _TINY else _TINY
