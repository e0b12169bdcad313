"""What a log holds of vibration beside its continuous samples: the autopilot's own levels, bursts, onboard spectra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Measure = Literal["rest", "difference"]
"""How a level is made. ``rest`` (ArduPilot's VIBE): root of the low-passed square of what a 5 Hz low-pass leaves, per
axis. ``difference`` (PX4): low-passed length of the difference of successive samples."""


@dataclass(frozen=True, slots=True)
class VibrationLimits:
    """What a measure's level may be: ``share`` of the flight is judged, ``warning`` and ``fault`` in m/s^2."""

    share: float
    warning: float
    fault: float
    source: str


LIMITS: dict[Measure, VibrationLimits] = {
    "rest": VibrationLimits(0.95, 30.0, 60.0, "ardupilot.org, Measuring Vibration"),
    "difference": VibrationLimits(0.80, 9.81, np.inf, "PX4 Flight Review, Vibration Metrics"),
}
"""PX4 names no level at which a flight fails, only where its plot turns red, which its author (pull request 252 of
Flight Review) calls a guess: it is a warning, and clipping tells the rest."""


@dataclass(slots=True)
class OnboardVibration:
    """The level that the autopilot measured of one unit: ``level`` (n,) m/s^2 at ``t`` (n,) s, of the worst axis where
    the measure has axes. ``unit`` is the IMU's index."""

    unit: int
    measure: Measure
    source: str
    t: Array
    level: Array


@dataclass(slots=True)
class Burst:
    """Successive samples of one sensor at its own rate, between pauses: ``x`` (n, 3) rad/s or m/s^2 at ``rate`` Hz from
    ``t`` s on. ``filtered``: behind the autopilot's low-pass and notches."""

    sensor: Literal["gyro", "accelerometer"]
    unit: int
    t: float
    rate: float
    x: NDArray[np.float32]
    filtered: bool
    source: str


@dataclass(slots=True)
class OnboardSpectrum:
    """The peaks that the autopilot found in its gyro at ``rate`` Hz: ``peaks`` (n, k) Hz at ``t`` (n,) s, NaN for none,
    each good to ``resolution`` Hz."""

    t: Array
    peaks: Array
    rate: float
    resolution: float
    source: str
