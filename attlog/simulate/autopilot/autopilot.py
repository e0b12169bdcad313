"""What the simulator asks of an autopilot: one step per period of the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.flight import Onboard
from attlog.simulate.scenario.scenario import Scenario

Array = NDArray[np.float64]


@dataclass(slots=True)
class Fix:
    """A fix of GNSS as it arrives: its epoch, ``ned`` (3,) m from the take-off place, ``vel`` (3,) m/s NED."""

    t_sample: float
    ned: Array
    vel: Array


@dataclass(slots=True)
class SensorInputs:
    """What has arrived since the step before; the first instance of each sensor.

    ``imu`` (k, 8): t_sample, dt, gyro (3) rad/s, acc (3) m/s^2, the newest last; k is 1 where the unit runs at the
    loop's rate, 0 in between for a slower one. ``mag`` (3,) T, ``height`` m (barometer, above the take-off place),
    ``fix``: None unless new. ``truth`` (q, w, p, v) is for autopilots that fly on truth.
    """

    imu: Array
    mag: Array | None
    height: float | None
    fix: Fix | None
    truth: tuple[Array, Array, Array, Array]


class Autopilot(Protocol):
    """Estimator, guidance and controller. ``step`` returns four commands, 0 to 1 (thrust over full thrust), in the
    rotors' order (front right, back left, front left, back right); ``onboard`` what is kept of all steps, asked
    once at the end."""

    def step(self, t: float, measured: SensorInputs) -> Array: ...

    def onboard(self) -> Onboard: ...


Maker = Callable[[Scenario, float, float], Autopilot]
"""Makes the autopilot of a scenario from gravity [m/s^2] and declination [rad] of its place."""
