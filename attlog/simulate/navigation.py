"""Where a vehicle believes it is: specific force integrated twice, pulled to GNSS and barometer.

    v' = R f + g - b,   p' = v,   b: what the integrated acceleration is off by (tilt error, accelerometer bias)

Each fix is compared with what was believed at its epoch, which is a delay ago, and the difference is taken off now
(the complementary filter that small autopilots use). Without fixes it is dead reckoning whose velocity fades.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import rotation

Array = NDArray[np.float64]

POSITION, VELOCITY, BIAS = 0.6, 1.2, 0.3
"""Gains of a fix, 1/s, 1/s, 1/s^2: velocity and bias settle together, critically damped."""
HEIGHT, CLIMB, HEIGHT_BIAS = 1.5, 0.9, 0.1
"""Gains of the barometer, 1/s, 1/s^2, 1/s^3."""
LOST_S, FADE_S = 1.5, 10.0
"""Without a fix for so long there is no position; the velocity then fades with this time constant."""
MEMORY_S, EVERY_S = 1.0, 0.02
LONGEST_S = 1.0


class Navigator:
    """Position ``p`` and velocity ``v`` (3,) m, m/s NED from the take-off place. ``gravity`` m/s^2."""

    def __init__(self, gravity: float) -> None:
        self.p, self.v, self._bias = np.zeros(3), np.zeros(3), np.zeros(3)
        self._down = np.array([0.0, 0.0, gravity])
        self._memory: deque[tuple[float, Array, Array]] = deque(maxlen=int(MEMORY_S / EVERY_S))
        self._fix_t = self._height_t = -math.inf
        self._ground = math.nan
        self._t = 0.0

    def placed(self, t: float) -> bool:
        """Whether fixes come: the horizontal position is known."""
        return t - self._fix_t < LOST_S

    def inertial(self, t: float, dt: float, q: Array, force: Array, standing: bool) -> None:
        """A specific force (3,) m/s^2 over ``dt`` at attitude ``q``; ``standing``: on the ground with rotors still."""
        a = rotation.rotate(q, force) + self._down - self._bias
        if standing:
            # Nothing moves: what is left is the error of tilt and accelerometer.
            self._bias += min(0.5 * dt, 1.0) * a
            self.v[:] = 0.0
        else:
            self.p += (self.v + 0.5 * dt * a) * dt
            self.v += dt * a
        if not self.placed(t):
            self.v[:2] *= math.exp(-dt / FADE_S)
        self._t = t
        if not self._memory or t - self._memory[-1][0] >= EVERY_S - 1e-9:
            self._memory.append((t, self.p.copy(), self.v.copy()))

    def fix(self, t: float, epoch: float, ned: Array, velocity: Array) -> None:
        """A fix that arrives at ``t`` and holds at ``epoch``; without numbers it is none."""
        if not (np.isfinite(ned).all() and np.isfinite(velocity).all()):
            return
        if not self.placed(t):
            self.p[:2], self.v[:2] = ned[:2], velocity[:2]
            self._memory.clear()
        elif self._memory:
            dt = min(t - self._fix_t, LONGEST_S)
            _, p, v = min(self._memory, key=lambda m: abs(m[0] - epoch))
            self._correct(slice(0, 2), (ned - p)[:2] * -math.expm1(-POSITION * dt), 0.0)
            self._correct(slice(0, 2), 0.0, (velocity - v)[:2] * -math.expm1(-VELOCITY * dt))
            self._bias[:2] -= BIAS * dt * (velocity - v)[:2]
        self._fix_t = t

    def height(self, t: float, height: float, standing: bool) -> None:
        """A barometer's height (m), whose zero is where the vehicle stood."""
        if not math.isfinite(height):
            return
        dt = min(t - self._height_t, LONGEST_S)
        if standing or math.isnan(self._ground):
            self._ground = height if math.isnan(self._ground) else self._ground + 0.02 * (height - self._ground)
        else:
            error = (self._ground - height) - float(self.p[2])
            self._correct(slice(2, 3), -math.expm1(-HEIGHT * dt) * error, CLIMB * dt * error)
            self._bias[2] -= HEIGHT_BIAS * dt * error
        self._height_t = t

    def _correct(self, part: slice, position: Any, velocity: Any) -> None:
        """Take a difference off now and from what was believed before, so that the next fix does not see it again."""
        self.p[part] += position
        self.v[part] += velocity
        for _, p, v in self._memory:
            p[part] += position
            v[part] += velocity
