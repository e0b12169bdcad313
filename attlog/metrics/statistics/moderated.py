"""The mean of a few values with a scatter that is partly known beforehand: Smyth's moderated t.

Logarithms of window variances scatter by much the same amount in all logs. That prior
``s0^2`` counts as ``nu0`` degrees of freedom beside the ``k - 1`` of the values, so that one
window has an interval and two have a sensible one (Smyth 2004).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.metrics.statistics.quantiles import student, students_two_sided

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of the variance of one value: ``variance``, worth ``dof`` degrees of freedom."""

    variance: float
    dof: float


def _errors(values: Array, prior: Prior) -> tuple[Array, Array, float]:
    """Means (m,) of values (m, k), k >= 1, their standard errors (m,) and the degrees of freedom."""
    k = values.shape[1]
    own = np.var(values, axis=1, ddof=1) if k > 1 else np.zeros(len(values))
    dof = prior.dof + k - 1
    return np.mean(values, axis=1), np.sqrt((prior.dof * prior.variance + (k - 1) * own) / dof / k), dof


def interval(values: ArrayLike, prior: Prior) -> tuple[float, float]:
    """The 95 % interval of the mean of values (k,), k >= 1."""
    means, errors, dof = _errors(np.asarray(values, np.float64)[None], prior)
    mean, half = float(means[0]), student(0.975, dof) * float(errors[0])
    return mean - half, mean + half


def p_values(values: Array, prior: Prior) -> Array:
    """Two-sided p (m,) that the means of values (m, k), k >= 1, are zero."""
    means, errors, dof = _errors(values, prior)
    return students_two_sided(means / errors, dof)
