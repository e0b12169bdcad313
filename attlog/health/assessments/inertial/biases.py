"""What the smoother without a compass says of the biases of the replayed unit, in flight, with its total error.

The smoother's own sigma is too small by half (flights with truth); gravity's model, a scale error of 0.003 and the
attitude add the floors. Where a flight hardly turns, the horizontal bias and the tilt cannot be parted, and its own
sigma says so: it is believed below SURE_M_S2 only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.flight.model import Array
from attlog.health.assessments.model import HealthCase, MotionAttitude

INFLATED = 1.5
"""The smoother's own sigma of an accelerometer bias is that much too small (24 flights with truth)."""
FLOOR_M_S2 = np.array([0.03, 0.03, 0.05])
"""Tilt that no flight parts from it; along z the model of gravity and a scale error of 0.003 (0.03 m/s^2)."""
SURE_M_S2 = 0.045
"""Two of 24 flights, which hardly move, have 0.09 and are 0.9 m/s^2 wrong; with less the error is below 0.13."""
FLOOR_DPS = np.array([0.05, 0.05, 0.05])
SURE_DPS = 0.3


@dataclass(frozen=True, slots=True)
class Bias:
    """What a sensor reads too much: ``mean`` and one ``sigma`` (3,), m/s^2 or deg/s, along the body's axes.

    ``known`` (3,): of which axes it is believed. ``n`` samples in ``seconds``; ``by`` says what found it.
    """

    mean: Array
    sigma: Array
    known: tuple[bool, bool, bool]
    n: int
    seconds: float
    by: str

    @property
    def sure(self) -> bool:
        """Whether all three axes are known."""
        return all(self.known)


def acc_bias(case: HealthCase) -> Bias | None:
    """The bias of the replayed accelerometer [m/s^2]; None where there is no smoother with GNSS."""
    read = _read(case.motion, "acc_bias_{}_m_s2", "acc_bias_{}_sigma_m_s2")
    if read is None:
        return None
    mean, own, n, seconds = read
    level, down = bool(own[:2].max() <= SURE_M_S2), bool(own[2] <= SURE_M_S2)
    return Bias(mean, np.hypot(INFLATED * own, FLOOR_M_S2), (level, level, down), n, seconds, "the smoother with GNSS")


def gyro_bias(case: HealthCase) -> Bias | None:
    """The bias of the replayed gyro [deg/s] in flight; None where there is no smoother with GNSS."""
    read = _read(case.motion, "gyro_bias_{}_dps", "gyro_bias_{}_sigma_dps")
    if read is None:
        return None
    mean, own, n, seconds = read
    known = tuple(bool(s <= SURE_DPS) for s in own)
    return Bias(mean, np.hypot(INFLATED * own, FLOOR_DPS), (known[0], known[1], known[2]), n, seconds, "the smoother")


def _read(motion: MotionAttitude | None, mean: str, sigma: str) -> tuple[Array, Array, int, float] | None:
    """Mean and own sigma (3,) as the smoother tells them, samples and seconds of the segment they are of."""
    if motion is None or len(motion.t) < 2:
        return None
    numbers = [motion.quality.get(name.format(axis)) for name in (mean, sigma) for axis in "xyz"]
    values = [float(x) for x in numbers if isinstance(x, float | int) and np.isfinite(x)]
    if len(values) < 6:
        return None
    longest = motion.t[motion.segment == np.argmax(np.bincount(motion.segment))]  # of which the smoother tells
    return np.array(values[:3]), np.array(values[3:]), len(longest), float(longest[-1] - longest[0])
