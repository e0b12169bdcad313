"""Guidance and navigation of the simulated vehicle: from timed commands to attitude and thrust, and its position.

    v_set = kp (p_set - p), limited      a = kp (v_set - v) + ki int(v_set - v), limited      (north, east)
    thrust vector = (a_north, a_east, a_down - g): its direction is the attitude, its length the thrust

Attitude commands (``attitude``, ``track``) set roll and pitch and keep the height: the thrust is divided by the cosine
of the tilt. Without a position (GNSS lost) horizontal commands become "level". Heading turns at a limited rate. Gains
are ours (:class:`attlog.simulate.scenario.Controller`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.controller import COMMAND_SIZE, ENGAGED, THRUST, bounded
from attlog.simulate.scenario import Command, Controller

Array = NDArray[np.float64]

CLIMB_M_S, SINK_M_S, LAND_M_S = 2.0, 1.5, 0.6
# Largest acceleration that position and velocity may ask for; the tilt limit reduces it further.
ACCELERATION_M_S2 = 5.0
# Acceleration of the point that is followed.
BRAKING_M_S2 = 1.5
MIN_THRUST, MAX_THRUST = 0.08, 0.95
# Landed: no sinking for so long although it is wanted.
TOUCH_S, MIN_CLIMB_M_S = 0.6, 0.2
MODES = {"attitude": "STABILIZE", "track": "STABILIZE", "hold": "POSCTL", "velocity": "POSCTL", "land": "LAND"}


class Guidance:
    """Set-points of a flight. ``hover``: share of thrust that carries the weight; ``gravity`` m/s^2.

    After :meth:`step`: ``command`` for :func:`attlog.simulate.controller.control`, and ``armed``, ``landed``,
    ``mode``.
    """

    def __init__(self, commands: Sequence[Command], gains: Controller, hover: float, gravity: float) -> None:
        self._commands, self._gains, self._hover, self._g = tuple(commands), gains, hover, gravity
        self.command = np.zeros(COMMAND_SIZE)
        self.command[0] = 1.0
        self.armed, self.landed, self.mode = False, True, "STABILIZE"
        self._next = 0
        self._now: Command | None = None
        self._since = 0.0
        self._heading: float | None = None
        self._heading_end = 0.0
        self._turn_rate = 0.0
        self._place = [0.0, 0.0]
        self._path = [0.0, 0.0]
        self._up = self._up_end = 0.0
        self._climbing = self._going = 0.0
        self._push = [0.0, 0.0, 0.0]
        self._touching = 0.0

    def step(self, t: float, dt: float, q: Array, p: Array, v: Array, placed: bool) -> None:
        """Set command, mode and arming at ``t`` s.

        From the estimated attitude ``q`` (4,), position ``p`` (3,) m and velocity ``v`` (3,) m/s, NED;
        ``placed``: the position is known.
        """
        w, x, y, z = q.tolist()
        at: list[float] = p.tolist()
        speed: list[float] = v.tolist()
        heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        while self._next < len(self._commands) and t >= self._commands[self._next].t:
            self._begin(self._commands[self._next], t, heading, at)
            self._next += 1
        now = self._now
        if now is None or not self.armed:
            self._stopped(heading)
            return
        if self.landed:
            self._stopped(heading)
            self.armed = now.do != "land" or t - self._since < 2.0
            return
        self._turn(dt)
        vertical = self._climb(now, dt, at, speed)
        north, east = self._horizontal(now, dt, at, speed, placed)
        tilt = 1.0 - 2.0 * (x * x + y * y)
        assert self._heading is not None
        if now.do in ("attitude", "track"):
            roll, pitch = self._angles(now, t)
        else:
            roll, pitch = _lean(north, east, self._g + vertical, self._heading, self._gains.tilt_max_deg)
        self._set(roll, pitch, self._heading)
        share = self._hover * (1.0 + vertical / self._g) / max(tilt, 0.3)
        self.command[THRUST] = min(max(share, MIN_THRUST), MAX_THRUST)
        self.command[ENGAGED] = 1.0
        if now.do == "land":
            self._touch(t, dt, speed)

    def _begin(self, command: Command, t: float, heading: float, p: list[float]) -> None:
        """Apply the immediate effects of a command."""
        self._now, self._since = command, t
        if command.do in ("disarm", "kill"):
            self.armed, self.landed = False, self.landed or command.do == "disarm"
            return
        self.armed = True
        if self._heading is None:
            self._heading = self._heading_end = heading
        if command.heading_deg is not None:
            self._heading_end = math.radians(command.heading_deg)
        self._turn_rate = math.radians(command.yaw_rate_dps)
        self.mode = MODES.get(command.do, "GUIDED")
        if command.do == "arm":
            return
        if self.landed and command.do != "land":
            self.landed = False
            self._up = self._up_end = -p[2]
            self._climbing = self._going = 0.0
            self._push = [0.0, 0.0, 0.0]
            self._path = p[:2]
        self._place = list(self._path)
        if command.do == "goto":
            self._place = [command.north_m, command.east_m]
        if command.up_m is not None and command.do not in ("land", "arm"):
            self._up_end = command.up_m
        elif command.do == "hold":
            self._up_end = self._up

    def _stopped(self, heading: float) -> None:
        """Return no torque and the present heading, on the ground or stopped."""
        self._heading = self._heading_end if self.armed and self._heading is not None else None
        self._set(0.0, 0.0, heading)
        self.command[THRUST], self.command[ENGAGED] = 0.0, 0.0

    def _turn(self, dt: float) -> None:
        """Return the heading wanted, at a limited rate along the shorter way."""
        assert self._heading is not None
        way = math.remainder(self._heading_end - self._heading, 2.0 * math.pi)
        self._heading = math.remainder(self._heading + bounded(way, self._turn_rate * dt), 2.0 * math.pi)

    def _climb(self, now: Command, dt: float, p: list[float], v: list[float]) -> float:
        """Return the upward acceleration wanted."""
        g = self._gains
        if now.do == "land":
            self._up = min(self._up, -p[2] + 1.0) - LAND_M_S * dt
            self._climbing = 0.0
            wanted = -LAND_M_S
        else:
            left = self._up_end - self._up
            most = CLIMB_M_S if left > 0.0 else SINK_M_S
            self._climbing = _sped(self._climbing, math.copysign(_stopping(abs(left), most), left), dt)
            self._up += self._climbing * dt
            wanted = self._climbing + bounded(g.height_kp * (self._up + p[2]), SINK_M_S)
        error = wanted + v[2]
        self._push[2] = bounded(self._push[2] + g.climb_ki * error * dt, 0.3 * self._g)
        return bounded(g.climb_kp * error + self._push[2], 0.6 * self._g)

    def _horizontal(self, now: Command, dt: float, p: list[float], v: list[float], placed: bool) -> tuple[float, float]:
        """Return the acceleration wanted to the north and east."""
        if not placed or now.do in ("attitude", "track"):
            self._push[0] = self._push[1] = self._going = 0.0
            self._path = self._place = p[:2]
            return 0.0, 0.0
        g, going = self._gains, (0.0, 0.0)
        if now.do == "velocity":
            going = (now.north_m_s, now.east_m_s)
            self._path = [self._path[i] + going[i] * dt for i in range(2)]
            # No longer a leash than a second: wind must not pull the point away.
            self._path = [p[i] + bounded(self._path[i] - p[i], 1.0 + abs(going[i])) for i in range(2)]
            self._place = list(self._path)
        else:
            way = [self._place[i] - self._path[i] for i in range(2)]
            left = math.hypot(*way)
            self._going = _sped(self._going, _stopping(left, now.speed_m_s), dt)
            if left > 1e-9:
                going = (self._going * way[0] / left, self._going * way[1] / left)
                share = min(self._going * dt / left, 1.0)
                self._path = [self._path[i] + share * way[i] for i in range(2)]
        pushed = []
        for i in range(2):
            wanted = going[i] + bounded(g.position_kp * (self._path[i] - p[i]), 3.0)
            error = wanted - v[i]
            self._push[i] = bounded(self._push[i] + g.velocity_ki * error * dt, 0.5 * ACCELERATION_M_S2)
            pushed.append(bounded(g.velocity_kp * error + self._push[i], ACCELERATION_M_S2))
        return pushed[0], pushed[1]

    def _angles(self, now: Command, t: float) -> tuple[float, float]:
        """Return roll and pitch of an attitude command at ``t``."""
        if now.do == "attitude":
            return math.radians(now.roll_deg), math.radians(now.pitch_deg)
        wave = math.sin(2.0 * math.pi * (t - self._since) / now.period_s)
        if now.shape == "square":
            wave = 1.0 if wave >= 0.0 else -1.0
        angle = math.radians(now.amplitude_deg) * wave
        return (angle, 0.0) if now.axis == "roll" else (0.0, angle)

    def _set(self, roll: float, pitch: float, heading: float) -> None:
        """Set the attitude wanted as a quaternion."""
        cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
        cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
        cy, sy = math.cos(0.5 * heading), math.sin(0.5 * heading)
        self.command[0] = cr * cp * cy + sr * sp * sy
        self.command[1] = sr * cp * cy - cr * sp * sy
        self.command[2] = cr * sp * cy + sr * cp * sy
        self.command[3] = cr * cp * sy - sr * sp * cy

    def _touch(self, t: float, dt: float, v: list[float]) -> None:
        """Detect the landing: no sinking although it is wanted."""
        sinking = v[2] > MIN_CLIMB_M_S
        self._touching = 0.0 if sinking or t - self._since < 1.0 else self._touching + dt
        if self._touching > TOUCH_S:
            self.landed, self._since, self._touching = True, t, 0.0


def _stopping(left: float, most: float) -> float:
    """Return the speed that can be braked within ``left`` m, at most ``most``."""
    return min(most, math.sqrt(2.0 * BRAKING_M_S2 * left))


def _sped(speed: float, wanted: float, dt: float) -> float:
    """Return the speed wanted with a limited acceleration; a smaller one is taken at once."""
    return min(wanted, speed + BRAKING_M_S2 * dt) if wanted >= 0.0 else max(wanted, speed - BRAKING_M_S2 * dt)


def _lean(north: float, east: float, up: float, heading: float, most_deg: float) -> tuple[float, float]:
    """Return roll and pitch of the thrust for an acceleration; ``up`` includes gravity, all m/s^2."""
    level, most = math.hypot(north, east), max(up, 1.0) * math.tan(math.radians(most_deg))
    if level > most:
        north, east = north * most / level, east * most / level
    ahead = north * math.cos(heading) + east * math.sin(heading)
    right = east * math.cos(heading) - north * math.sin(heading)
    pitch = math.atan2(-ahead, max(up, 1.0))
    return math.atan2(right * math.cos(pitch), max(up, 1.0)), pitch


# Gains of a fix, 1/s, 1/s, 1/s^2: velocity and bias settle together, critically damped.
POSITION, VELOCITY, BIAS = 0.6, 1.2, 0.3
# Gains of the barometer, 1/s, 1/s^2, 1/s^3.
HEIGHT, CLIMB, HEIGHT_BIAS = 1.5, 0.9, 0.1
# Time without a fix after which there is no position; time constant of the velocity then.
LOST_S, FADE_S = 1.5, 10.0
MEMORY_S, EVERY_S = 1.0, 0.02
MAX_UPDATE_INTERVAL_S = 1.0


class Navigator:
    """Position ``p`` and velocity ``v`` (3,) m, m/s NED: dead reckoning corrected by GNSS and barometer.

        v' = R f + g - b,   p' = v,   b: bias of the integrated acceleration (tilt error, accelerometer bias)

    Each fix is compared with the estimate at its epoch, a delay ago, and the difference is subtracted now (a
    complementary filter). Without fixes the velocity fades.
    """

    def __init__(self, gravity: float) -> None:
        self.p, self.v, self._bias = np.zeros(3), np.zeros(3), np.zeros(3)
        self._gravity = gravity
        # Rows of t, p, v, the oldest overwritten.
        self._memory = np.full((int(MEMORY_S / EVERY_S), 7), -np.inf)
        self._row, self._noted = 0, -math.inf
        self._fix_t = self._height_t = -math.inf
        self._ground = math.nan

    def placed(self, t: float) -> bool:
        """Return whether fixes arrive: the horizontal position is known."""
        return t - self._fix_t < LOST_S

    def inertial(self, t: float, dt: float, q: Array, force: Array, standing: bool) -> None:
        """Integrate a specific force (3,) m/s^2 over ``dt`` at attitude ``q``.

        ``standing``: on the ground with rotors still.
        """
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
        """Correct by a fix that arrives at ``t`` s and holds at ``epoch``.

        ``ned`` (3,) m, ``velocity`` (3,) m/s or NaN.
        """
        if not (np.isfinite(ned).all() and np.isfinite(velocity).all()):
            return
        if not self.placed(t):
            self.p[:2], self.v[:2] = ned[:2], velocity[:2]
            self._memory[:, 0] = self._noted = -math.inf
        else:
            dt = min(t - self._fix_t, MAX_UPDATE_INTERVAL_S)
            then = self._memory[np.abs(self._memory[:, 0] - epoch).argmin()]
            if math.isfinite(then[0]):
                off, slip = ned[:2] - then[1:3], velocity[:2] - then[4:6]
                self._correct(slice(0, 2), -math.expm1(-POSITION * dt) * off, -math.expm1(-VELOCITY * dt) * slip)
                self._bias[:2] -= BIAS * dt * slip
        self._fix_t = t

    def height(self, t: float, height: float, standing: bool) -> None:
        """Correct by a barometer's height (m above the take-off place)."""
        if not math.isfinite(height):
            return
        dt = min(t - self._height_t, MAX_UPDATE_INTERVAL_S)
        if standing or math.isnan(self._ground):
            self._ground = height if math.isnan(self._ground) else self._ground + 0.02 * (height - self._ground)
        else:
            error = (self._ground - height) - float(self.p[2])
            self._correct(slice(2, 3), np.array([-math.expm1(-HEIGHT * dt) * error]), np.array([CLIMB * dt * error]))
            self._bias[2] -= HEIGHT_BIAS * dt * error
        self._height_t = t

    def _correct(self, part: slice, position: Array, velocity: Array) -> None:
        """Subtract a difference now and from earlier estimates, so that the next fix does not see it again."""
        self.p[part] += position
        self.v[part] += velocity
        self._memory[:, 1:4][:, part] += position
        self._memory[:, 4:7][:, part] += velocity


def _turned(q: Array, v: Array) -> list[float]:
    """Rotate a vector from body to earth axes in plain numbers, ten times faster for a single one."""
    w, x, y, z = q.tolist()
    a, b, c = v.tolist()
    return [
        (1.0 - 2.0 * (y * y + z * z)) * a + 2.0 * (x * y - w * z) * b + 2.0 * (x * z + w * y) * c,
        2.0 * (x * y + w * z) * a + (1.0 - 2.0 * (x * x + z * z)) * b + 2.0 * (y * z - w * x) * c,
        2.0 * (x * z - w * y) * a + 2.0 * (y * z + w * x) * b + (1.0 - 2.0 * (x * x + y * y)) * c,
    ]
