"""Gyro alone: the integrated rate, the yardstick of drift that every filter must beat.

    q' = q (x) (0, w)/2

Accelerometer and magnetometer give the start attitude only; after that nothing is
corrected, so the error grows with gyro bias, scale error and noise.

Source: Lyu 8-10, Xu 6-10 (first-order Runge-Kutta: ``integrator = first_order``).

Departures. The exponential map is the default: at 250 Hz and 100 deg/s the first-order
step turns 0.0004 deg/s slower.
"""

from __future__ import annotations

from typing import Any

from attlog.estimators.interface import INTEGRATOR
from attlog.estimators.vectors import turn

SOURCE = "Lyu 8-10; Xu 6-10"
NEEDS = {"gyro"}
USES = {"acc", "mag"}
STATE = {"q": 4}
PARAMETERS = (INTEGRATOR,)


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state: attitude only."""
    return q0


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """Turn by the measured rate."""
    turn(state, gyr[0], gyr[1], gyr[2], dt, params[0])
