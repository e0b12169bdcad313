"""One number of many logs: a random-effects mean of their differences, and on how many logs its sign holds.

Logs are taken as drawn from all flights one might make: the true difference scatters from log to
log by tau. tau^2 by DerSimonian & Laird (1986), the interval by Hartung & Knapp (2001): t with logs - 1
degrees of freedom around the weighted mean, its variance from the weighted scatter of the logs, never
below that of the weights alone (the modification that Roever, Knapp & Friede 2015 advise for few logs of
unequal size).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.metrics.statistics.quantiles import student, student_two_sided

Array = NDArray[np.float64]


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
        tau2, i2 = between(y, variance)
        mean, error = hartung_knapp(y, 1.0 / (variance + tau2), least=True)
        method, tau = f"random effects over {k} logs (DerSimonian-Laird, Hartung-Knapp)", math.sqrt(tau2)
    half = student(0.975, k - 1) * error
    p = student_two_sided(mean / error, k - 1) if error > 0.0 else 0.0
    return PooledMean(mean, (mean - half, mean + half), p, k, *signs, tau, i2, method)


def between(y: Array, variance: Array) -> tuple[float, float]:
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
