"""Constant-rate data for packages that know no time: integrals interpolated onto a regular grid, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.base import rotation
from attlog.estimators.base import Array

JITTER = 0.05
TYPICAL_FIELD_UT = 50.0


@dataclass(frozen=True, slots=True)
class UniformSamples:
    """Samples ``period`` seconds apart. ``t`` (m,) s; ``gyr``, ``acc`` (m, 3); ``mag`` (m, 3), zero rows where none.

    ``mag_period`` (s) is the magnetometer's own; ``regular`` False where the input had to be resampled.
    """

    t: Array
    period: float
    gyr: Array
    acc: Array
    mag: Array
    mag_period: float
    regular: bool

    def back(self, t: Array, q: Array) -> Array:
        """Attitudes (n, 4) at the input's times ``t`` from attitudes (m, 4) on the grid."""
        if self.regular:
            return q
        return rotation.slerp(self.t, q, np.clip(t, self.t[0], self.t[-1]))


def uniform(t: Array, gyr: Array, acc: Array, mag: Array) -> UniformSamples:
    """The samples as they are where their spacing varies by under 5 %, else resampled at the median rate.

    ``t`` (n,) s, ``gyr`` (n, 3) rad/s, ``acc`` (n, 3) m/s^2, ``mag`` (n, 3) with NaN rows where it has no sample.
    Rates and specific forces are means over the interval before their time, so it is
    their integrals that are interpolated: no turn is lost.
    """
    step = np.diff(t)
    period = float(np.median(step)) if len(step) else 0.01
    finite = np.isfinite(mag)
    new = finite[:, 0] & finite[:, 1] & finite[:, 2]
    mag = np.where(new[:, None], mag, 0.0)
    mag_t = t[new]
    mag_period = float(np.median(np.diff(mag_t))) if len(mag_t) > 1 else period
    if len(step) == 0 or np.max(np.abs(step - period)) <= JITTER * period:
        return UniformSamples(t, period, gyr, acc, mag, max(mag_period, period), True)
    grid = t[0] + period * np.arange(int(np.ceil((t[-1] - t[0]) / period - 1e-9)) + 1)
    placed = np.zeros((len(grid), 3))
    placed[np.minimum(np.searchsorted(grid, mag_t - 1e-9), len(grid) - 1)] = mag[new]
    rates = [_resample(t, x, grid, period) for x in (gyr, acc)]
    return UniformSamples(grid, period, rates[0], rates[1], placed, max(mag_period, period), False)


def _resample(t: Array, x: Array, grid: Array, period: float) -> Array:
    """Means over the grid's intervals of ``x`` (n, 3), whose rows are means over the input's intervals."""
    step, mean = np.diff(t), np.empty((len(grid), 3))
    mean[:1] = x[:1]
    for i in range(3):  # one axis at a time: in long logs copies add up
        integral = np.concatenate([[0.0], np.cumsum(x[1:, i] * step)])
        mean[1:, i] = np.diff(np.interp(grid, t, integral)) / period
    # The last interval reaches beyond the input: only its covered part was integrated.
    covered = min((t[-1] - grid[-2]) / period, 1.0) if len(grid) > 1 else 1.0
    mean[-1] /= covered
    return mean


def typical_size(mag: Array) -> Array:
    """The field (n, 3) in any unit scaled to a median norm of 50, zero rows kept: packages think in microtesla."""
    return mag * typical_scale(mag)


def typical_scale(mag: Array) -> float:
    """The factor that does it; 1 for a field (n, 3) that is nowhere."""
    norm = np.sqrt(np.sum(mag**2, axis=1))
    return TYPICAL_FIELD_UT / float(np.median(norm[norm > 0])) if norm.any() else 1.0
