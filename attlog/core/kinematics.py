"""Body rates and mean earth-frame specific force of an attitude, to be compared with an IMU."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class BodyRates:
    """Mean body rates (k, 3) rad/s of an attitude over intervals from ``start`` to ``end`` (k,) s."""

    start: Array
    end: Array
    rate: Array

    def select(self, use: NDArray[np.bool_] | NDArray[np.int64] | slice) -> BodyRates:
        """Return the selected intervals."""
        return BodyRates(self.start[use], self.end[use], self.rate[use])

    def at_most(self, count: int) -> BodyRates:
        """Return every k-th interval, at most ``count``."""
        return self.select(slice(None, None, max(1, -(-len(self.start) // count))))

    def shifted(self, offset: float, drift: float = 0.0, middle: float = 0.0) -> BodyRates:
        """Return the rates at times t + offset + drift (t - middle)."""
        start, end = (t + offset + drift * (t - middle) for t in (self.start, self.end))
        return BodyRates(start, end, self.rate)


def body_rates(
    t: Array, q: Array, segment: NDArray[np.int64], step: int, stride: int = 1, max_s: float = np.inf
) -> BodyRates:
    """Return mean body rates over ``step`` samples, beginning at every ``stride``-th sample.

    ``q`` (n, 4), body to earth, at ``t`` (n,) s. Intervals lie within one ``segment`` (n,), last at most ``max_s`` and
    have finite rates.
    """
    first = np.arange(0, max(len(t) - step, 0), stride)
    last = first + step
    span = t[last] - t[first]
    good = (segment[first] == segment[last]) & (span > 0) & (span <= max_s)
    first, last = first[good], last[good]
    rate = rotation.relative_rotvecs(q[first], q[last]) / (t[last] - t[first])[:, None]
    return BodyRates(t[first], t[last], rate).select(rotation.finite_rows(rate))


def earth_force(
    t_force: Array, force: Array, t: Array, q: Array, segment: NDArray[np.int64] | None, max_samples: int = 4000
) -> Array | None:
    """Return the mean specific force (3,) in earth axes, None without overlap.

    ``force`` (m, 3) m/s^2 at ascending ``t_force`` (m,) s, ``q`` (n, 4), body to earth, at ``t`` (n,) s. Long records
    are thinned to about ``max_samples``. The mean is (0, 0, -g) if the mean acceleration is zero.
    """
    some = slice(None, None, max(1, len(t_force) // max_samples))
    _, earth = known_earth_force(t_force[some], force[some], t, q, segment)
    return np.asarray(earth.mean(axis=0)) if len(earth) else None


def known_earth_force(
    t_force: Array, force: Array, t: Array, q: Array, segment: NDArray[np.int64] | None = None
) -> tuple[Array, Array]:
    """Return times (k,) s and specific forces (k, 3) in earth axes where force and attitude are known."""
    turned, _ = rotation.slerp_in_segments(t, q, segment, t_force)
    earth = rotation.rotate(turned, force)
    known = rotation.finite_rows(earth)
    return t_force[known], earth[known]


def tilt_deg(force: Array) -> float:
    """Return the angle in deg between a mean force (3,) in earth axes and up."""
    return float(np.degrees(np.arctan2(np.hypot(force[0], force[1]), -force[2])))
