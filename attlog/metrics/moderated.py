"""The mean of a few values with a scatter that is partly known beforehand: Smyth's moderated t.

Logarithms of window variances scatter by much the same amount in all logs. That prior
``s0^2`` counts as ``nu0`` degrees of freedom beside the ``k - 1`` of the values, so that one
window has an interval and two have a sensible one (Smyth 2004).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from attlog.metrics.quantiles import student, student_two_sided


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of the variance of one value: ``variance``, worth ``dof`` degrees of freedom."""

    variance: float
    dof: float


def _error(values: ArrayLike, prior: Prior) -> tuple[float, float, float]:
    """Mean, its standard error and the degrees of freedom."""
    x = np.asarray(values, np.float64)
    k = len(x)
    own = float(np.var(x, ddof=1)) if k > 1 else 0.0
    dof = prior.dof + k - 1
    return float(np.mean(x)), math.sqrt((prior.dof * prior.variance + (k - 1) * own) / dof / k), dof


def interval(values: ArrayLike, prior: Prior) -> tuple[float, float]:
    """The 95 % interval of the mean of values (k,), k >= 1."""
    mean, error, dof = _error(values, prior)
    half = student(0.975, dof) * error
    return mean - half, mean + half


def p_value(values: ArrayLike, prior: Prior) -> float:
    """Two-sided p that the mean of values (k,), k >= 1, is zero."""
    mean, error, dof = _error(values, prior)
    return student_two_sided(mean / error, dof)
