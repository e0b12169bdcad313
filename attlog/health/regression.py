"""Robust least squares and medians with errors clustered by blocks of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from attlog.core.sorting import median
from attlog.flight.model import Array

# Cluster length: attitude errors are correlated over seconds.
BLOCK_S = 5.0
# Huber threshold in robust deviations (Huber1964).
HUBER = 2.0
# Iterations of reweighting.
HUBER_PASSES = 6


class RobustFit(NamedTuple):
    """Coefficients ``x`` (p,), covariance (p, p), robust residual deviation, number of blocks."""

    x: Array
    covariance: Array
    scatter: float
    blocks: int

    @property
    def sigma(self) -> Array:
        """Standard errors (p,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def robust_fit(
    t: Array, columns: Array, y: Array, prior: Array | None = None, huber: float = HUBER
) -> RobustFit | None:
    """Solve ``columns`` (n, k, p) x = ``y`` (n, k) by robust least squares; None if singular.

    ``t`` (n,) s. ``prior`` (p,): standard deviation of a coefficient about 0, infinity for none. Huber weights with
    threshold ``huber`` robust deviations. The covariance is clustered by blocks of BLOCK_S (Cameron2015 10 and 11),
    plus the prior's contribution.
    """
    n, k, p = columns.shape
    flat, target = columns.reshape(n * k, p), y.ravel()
    weight: Array = np.ones(n * k)
    scatter = max(1.4826 * float(median(np.abs(target))), 1e-9)
    x: Array = np.zeros(p)
    normal: Array = np.eye(p)
    penalty: Array = np.zeros(p) if prior is None else scatter**2 / np.asarray(prior) ** 2
    for turn in range(HUBER_PASSES):
        normal = np.asarray(flat.T @ (weight[:, None] * flat) + np.diag(penalty), np.float64)
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > 1e12:
            return None
        x = np.asarray(np.linalg.solve(normal, flat.T @ (weight * target)), np.float64)
        left = np.abs(target - flat @ x)
        scatter = max(1.4826 * float(median(left)), 1e-9)
        weight = np.minimum(1.0, huber * scatter / np.maximum(left, 1e-12))
        if prior is not None and turn < HUBER_PASSES - 1:
            penalty = scatter**2 / np.asarray(prior) ** 2
    residual = target - flat @ x
    numbers, block = np.unique((t // BLOCK_S).astype(np.int64), return_inverse=True)
    score = (flat * (weight * residual)[:, None]).reshape(n, k, p).sum(axis=1)
    sums = np.stack([np.bincount(block, score[:, j], len(numbers)) for j in range(p)])
    middle = sums @ sums.T
    inverse = np.linalg.inv(normal)
    few = len(numbers) / max(len(numbers) - p / k, 1.0)
    covariance = few * inverse @ middle @ inverse + scatter**2 * inverse @ np.diag(penalty) @ inverse
    return RobustFit(x, covariance, scatter, len(numbers))


def interval_text(value: float, sigma: float, digits: int) -> str:
    """Format a 95 % interval: ``1.2 to 1.8``."""
    return f"{value - 1.96 * sigma:.{digits}f} to {value + 1.96 * sigma:.{digits}f}"


def median_interval(t: Array, x: Array) -> tuple[float, float]:
    """Return the 95 % interval of a median by order statistics of block medians."""
    block = (t // BLOCK_S).astype(np.int64)
    starts = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
    medians = np.sort([float(median(part)) for part in np.split(x, starts[1:])])
    n = len(medians)
    reach = 0.98 * np.sqrt(n)
    low, high = int(np.floor(0.5 * n - reach)), int(np.ceil(0.5 * n + reach))
    return float(medians[max(low, 0)]), float(medians[min(high, n - 1)])
