"""A slow magnetometer between its samples, for estimators that take whole segments."""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.estimators.api import estimate
from attlog.estimators.base import Array
from attlog.estimators.engine.samples import HOLD_PERIODS


def propagated(t: Array, gyr: Array, mag: Array) -> Array:
    """The field (n, 3) at every sample: the last one propagated with the gyro for up to 1.5 of its periods, else 0.

    ``t`` (n,) s, ``gyr`` (n, 3) rad/s, ``mag`` (n, 3) with NaN rows where there is no new
    sample, as ``run`` gets them. The shared loop does the same for steps.
    """
    new = np.flatnonzero(np.isfinite(mag).all(axis=1))
    field = np.zeros_like(mag)
    if len(new) == 0:
        return field
    q = estimate("gyro", t, gyr, q0=[1.0, 0.0, 0.0, 0.0]).q
    last = np.searchsorted(new, np.arange(len(t)), side="right") - 1
    source = new[np.maximum(last, 0)]
    period = float(np.median(np.diff(t[new]))) if len(new) > 1 else 0.0
    use = (last >= 0) & (t - t[source] <= HOLD_PERIODS * period)
    field[use] = rotation.rotate_inverse(q[use], rotation.rotate(q[source[use]], mag[source[use]]))
    return field
