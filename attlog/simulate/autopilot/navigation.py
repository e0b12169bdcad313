"""Where a vehicle believes it is: specific force integrated twice, pulled to GNSS and barometer.

    v' = R f + g - b,   p' = v,   b: what the integrated acceleration is off by (tilt error, accelerometer bias)

Each fix is compared with what was believed at its epoch, which is a delay ago, and the difference is taken off now
(the complementary filter that small autopilots use). Without fixes it is dead reckoning whose velocity fades.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

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
        self._gravity = gravity
        # Rows of t, p, v, the oldest overwritten.
        self._memory = np.full((int(MEMORY_S / EVERY_S), 7), -np.inf)
        self._row, self._noted = 0, -math.inf
        self._fix_t = self._height_t = -math.inf
        self._ground = math.nan

    def placed(self, t: float) -> bool:
        """Whether fixes come: the horizontal position is known."""
        return t - self._fix_t < LOST_S

    def inertial(self, t: float, dt: float, q: Array, force: Array, standing: bool) -> None:
        """A specific force (3,) m/s^2 over ``dt`` at attitude ``q``; ``standing``: on the ground with rotors still."""
        a = _turned(q, force)
        a[2] += self._gravity
        fade = 1.0 if self.placed(t) else math.exp(-dt / FADE_S)
        (fx, fy, fz), (bx, by, bz) = a, self._bias.tolist()
        x, y, z = fx - bx, fy - by, fz - bz
        if standing:
            # Nothing moves: what is left is the error of tilt and accelerometer.
            share = min(0.5 * dt, 1.0)
            self._bias += (share * x, share * y, share * z)
            self.v[:] = 0.0
        else:
            u, v, w = self.v.tolist()
            self.p += ((u + 0.5 * dt * x) * dt, (v + 0.5 * dt * y) * dt, (w + 0.5 * dt * z) * dt)
            self.v[:] = (u + dt * x) * fade, (v + dt * y) * fade, w + dt * z
        if t - self._noted >= EVERY_S - 1e-9:
            self._row, self._noted = (self._row + 1) % len(self._memory), t
            self._memory[self._row, 0], self._memory[self._row, 1:4], self._memory[self._row, 4:] = t, self.p, self.v

    def fix(self, t: float, epoch: float, ned: Array, velocity: Array) -> None:
        """A fix that arrives at ``t`` s and holds at ``epoch``: ``ned`` (3,) m, ``velocity`` (3,) m/s; NaN is none."""
        if not (np.isfinite(ned).all() and np.isfinite(velocity).all()):
            return
        if not self.placed(t):
            self.p[:2], self.v[:2] = ned[:2], velocity[:2]
            self._memory[:, 0] = self._noted = -math.inf
        else:
            dt = min(t - self._fix_t, LONGEST_S)
            then = self._memory[np.abs(self._memory[:, 0] - epoch).argmin()]
            if math.isfinite(then[0]):
                off, slip = ned[:2] - then[1:3], velocity[:2] - then[4:6]
                self._correct(slice(0, 2), -math.expm1(-POSITION * dt) * off, -math.expm1(-VELOCITY * dt) * slip)
                self._bias[:2] -= BIAS * dt * slip
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
            self._correct(slice(2, 3), np.array([-math.expm1(-HEIGHT * dt) * error]), np.array([CLIMB * dt * error]))
            self._bias[2] -= HEIGHT_BIAS * dt * error
        self._height_t = t

    def _correct(self, part: slice, position: Array, velocity: Array) -> None:
        """Take a difference off now and from what was believed before, so that the next fix does not see it again."""
        self.p[part] += position
        self.v[part] += velocity
        self._memory[:, 1:4][:, part] += position
        self._memory[:, 4:7][:, part] += velocity


def _turned(q: Array, v: Array) -> list[float]:
    """A vector turned from body to earth axes; in plain numbers, which is ten times faster for a single one."""
    w, x, y, z = q.tolist()
    a, b, c = v.tolist()
    return [
        (1.0 - 2.0 * (y * y + z * z)) * a + 2.0 * (x * y - w * z) * b + 2.0 * (x * z + w * y) * c,
        2.0 * (x * y + w * z) * a + (1.0 - 2.0 * (x * x + z * z)) * b + 2.0 * (y * z - w * x) * c,
        2.0 * (x * z - w * y) * a + 2.0 * (y * z + w * x) * b + (1.0 - 2.0 * (x * x + y * y)) * c,
    ]
