"""What the smoother says of the biases of the replayed unit, in flight, with its total error.

The smoother's own sigma is too small by half (flights with truth); gravity's model, a scale error of 0.003 and the
attitude add the floors. Where a flight hardly turns, the horizontal bias and the tilt cannot be parted: its own sigma
is then large, or, in the worst flights, the runs with and without the compass disagree.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from attlog.flight.model import Array
from attlog.health.assessments.model import HealthCase, MotionAttitude

Quality = Mapping[str, float | str]
INFLATED = 1.5
"""The smoother's own sigma of an accelerometer bias is that much too small (24 flights with truth)."""
FLOOR_M_S2 = np.array([0.03, 0.03, 0.05])
"""Tilt that no flight parts from it; along z the model of gravity and a scale error of 0.003 (0.03 m/s^2)."""
ALONE_M_S2, BOTH_M_S2 = 0.03, 0.045
"""The smoother's own sigma is believed up to here: without a compass, and where one agrees with motion. On 24 flights
with truth and 48 planted offsets: beyond it errors reach 0.9 m/s^2, below it they stay within two total sigmas."""
AGREE = 2.0
"""Joint total sigmas up to which the runs with and without the compass agree."""
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
    """The bias of the replayed accelerometer [m/s^2]; None where there is no smoother with GNSS.

    That of the reference where it is a smoother whose compass agrees with motion, else that without a compass.
    """
    if (read := _of_motion(case.motion)) is None:
        return None
    longest, quality = read
    names = "acc_bias_{}_m_s2", "acc_bias_{}_sigma_m_s2"
    alone, sure, by, agree = _read(quality, *names), ALONE_M_S2, "the smoother with GNSS", True
    if alone is None:
        return None
    mean, own = alone
    reference = case.reference
    if reference is not None and reference.kind == "smoother" and reference.quality.get("heading_from") == "both":
        both = _read(reference.quality, *names)
        if both is not None:
            doubt = np.hypot(_total(own), _total(both[1]))
            agree = bool(np.all(np.abs(both[0] - mean)[:2] <= AGREE * doubt[:2]))
            (mean, own), sure, by = both, BOTH_M_S2, "the smoother with GNSS and compass"
    level, down = agree and bool(own[:2].max() <= sure), bool(own[2] <= sure)
    return Bias(mean, _total(own), (level, level, down), len(longest), float(longest[-1] - longest[0]), by)


def _total(own: Array) -> Array:
    """The total error (3,) of a bias of the accelerometer by the smoother's own sigma."""
    return np.asarray(np.hypot(INFLATED * own, FLOOR_M_S2))


def gyro_bias(case: HealthCase) -> Bias | None:
    """The bias of the replayed gyro [deg/s] in flight; None where there is no smoother with GNSS."""
    if (read := _of_motion(case.motion)) is None:
        return None
    longest, quality = read
    told = _read(quality, "gyro_bias_{}_dps", "gyro_bias_{}_sigma_dps")
    if told is None:
        return None
    mean, own = told
    known = tuple(bool(s <= SURE_DPS) for s in own)
    sigma, seconds = np.hypot(INFLATED * own, FLOOR_DPS), float(longest[-1] - longest[0])
    return Bias(mean, sigma, (known[0], known[1], known[2]), len(longest), seconds, "the smoother")


def _of_motion(motion: MotionAttitude | None) -> tuple[Array, Quality] | None:
    """The times (n,) s of the longest segment, of which the smoother tells, and what it tells."""
    if motion is None or len(motion.t) < 2:
        return None
    return motion.t[motion.segment == np.argmax(np.bincount(motion.segment))], motion.quality


def _read(quality: Quality, mean: str, sigma: str) -> tuple[Array, Array] | None:
    """Mean and own sigma (3,) as a smoother tells them; None where it does not."""
    numbers = [quality.get(name.format(axis)) for name in (mean, sigma) for axis in "xyz"]
    values = [float(x) for x in numbers if isinstance(x, float | int) and np.isfinite(x)]
    return (np.array(values[:3]), np.array(values[3:])) if len(values) == 6 else None
