"""The nested controller of Huang et al.: angle to rate to torque to rotors, at 400 Hz.

    e      = angle from the attitude to the set-point, in body axes      (tilt first, then heading)
    w_set  = kp e + ki int(e)                       outer PI, limited to ``rate_limit``
    u      = kp (w_set - w) + ki int(w_set - w) - kd dw/dt               inner PID, limited to +-1
    f_i    = thrust + mixer_i u                     share of a rotor's largest thrust, 0 to 1

Source: Huang tables 2 and 3: outer 4.5 and 0.35, inner 0.14, 0.015 and 0.0025, alike for roll and pitch.
Ours, because the paper does not tell it: the unit of ``u`` (1 turns the rotors of one side up by half of
their largest thrust and the others down, as autopilots of that time had it), yaw's gains, all limits, the
derivative of the measured rate behind a low-pass (that of the error would kick at every step of the set-point),
and what happens at a limit: an integral does not go on in the direction that is limited already, and the
mixer gives up yaw first, then thrust, and roll and pitch last.

Plain functions on arrays of float64, so that they compile (:func:`compiled`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.autopilot.loop import Controller
from attlog.simulate.physics.kernel import function_of, kernel_of

Array = NDArray[np.float64]
Three = tuple[float, float, float]

ANGLE_INTEGRAL, RATE_INTEGRAL, LAST_RATE, SLOPE, CUT, STARTED, STATE_SIZE = 0, 3, 6, 9, 12, 15, 16
"""Where things stand in the state: three axes each, and whether there was a rate before."""
KP, KI, RATE_KP, RATE_KI, RATE_KD, RATE_LIMIT, ANGLE_PART, RATE_PART, COMMON_GAINS = 0, 3, 6, 9, 12, 15, 18, 21, 24
"""Where gains stand in their array: three axes each, then the derivative's low-pass and the idle thrust."""
Q_SET, THRUST, ENGAGED, COMMAND_SIZE = 0, 4, 5, 6
"""A command: attitude wanted, collective share of thrust, and 1 in flight (0 stops the rotors)."""


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains and limits as (roll, pitch, yaw). ``u`` is the torque as a share of what the mixer can ask for.

    ``angle_kp`` 1/s, ``angle_ki`` 1/s^2, ``rate_kp`` s (u per rad/s), ``rate_ki`` 1, ``rate_kd`` s^2; ``rate_limit``
    rad/s; ``angle_part`` rad/s and ``rate_part`` u, the most that an integral may give; ``derivative_hz`` corner of the
    derivative's low-pass; ``idle`` share of thrust at which a rotor still turns.
    """

    angle_kp: Three
    angle_ki: Three
    rate_kp: Three
    rate_ki: Three
    rate_kd: Three
    rate_limit: Three
    angle_part: Three = (0.2, 0.2, 0.0)
    rate_part: Three = (0.2, 0.2, 0.3)
    derivative_hz: float = 30.0
    idle: float = 0.03

    @classmethod
    def of(cls, c: Controller) -> Gains:
        """The gains of a scenario."""
        most, turn = math.radians(c.rate_max_dps), math.radians(c.yaw_rate_max_dps)
        return cls(
            (c.angle_kp, c.angle_kp, c.yaw_angle_kp),
            (c.angle_ki, c.angle_ki, 0.0),
            (c.rate_kp, c.rate_kp, c.yaw_rate_kp),
            (c.rate_ki, c.rate_ki, c.yaw_rate_ki),
            (c.rate_kd, c.rate_kd, 0.0),
            (most, most, turn),
        )

    def pack(self) -> Array:
        """The array (k,) that :func:`control` takes."""
        parts = (self.angle_kp, self.angle_ki, self.rate_kp, self.rate_ki, self.rate_kd, self.rate_limit)
        return np.array([*sum((*parts, self.angle_part, self.rate_part), ()), self.derivative_hz, self.idle])


def mixer(positions: Any, spins: Any) -> Array:
    """What one unit of roll, pitch and yaw adds to each rotor's share of thrust: (n, 3), largest entry 0.5.

    ``positions`` (n, 2 or 3) m in body axes from the centre of mass, ``spins`` (n,) +1 where the rotor turns
    counter-clockwise seen from above (its drag turns the body clockwise, to a larger heading), else -1.
    """
    place = np.asarray(positions, np.float64)
    columns = np.column_stack([-place[:, 1], place[:, 0], np.asarray(spins, np.float64)])
    shares: Array = 0.5 * columns / np.abs(columns).max(axis=0)
    return shares


def start() -> Array:
    """The controller's state before its first step."""
    return np.zeros(STATE_SIZE)


def control(state: Any, gains: Any, q: Any, rate: Any, command: Any, shares: Any, dt: float, out: Any) -> None:
    """One step: ``out`` is rotor thrust shares (n), rate set-point (3), torque asked for (3), thrust given (1).

    ``q`` (4,) attitude and ``rate`` (3,) rad/s as the vehicle knows them, ``command`` as above, ``shares`` (n, 3)
    of :func:`mixer`. State and ``out`` are changed in place.
    """
    n = len(shares)
    if command[ENGAGED] < 0.5:
        for i in range(len(state)):
            state[i] = 0.0
        for i in range(len(out)):
            out[i] = 0.0
        return
    ex, ey, ez = angle_error(q, command)
    for i in range(3):
        error = ex if i == 0 else (ey if i == 1 else ez)
        limit = gains[RATE_LIMIT + i]
        wanted = gains[KP + i] * error + state[ANGLE_INTEGRAL + i]
        held = state[CUT + i] if abs(wanted) <= limit else (1.0 if wanted > 0.0 else -1.0)
        if held * error <= 0.0:
            part = gains[ANGLE_PART + i]
            state[ANGLE_INTEGRAL + i] = bounded(state[ANGLE_INTEGRAL + i] + gains[KI + i] * error * dt, part)
        out[n + i] = bounded(gains[KP + i] * error + state[ANGLE_INTEGRAL + i], limit)
    follow = 1.0 - math.exp(-2.0 * math.pi * gains[COMMON_GAINS] * dt)
    for i in range(3):
        slope = (rate[i] - state[LAST_RATE + i]) / dt if state[STARTED] > 0.5 else 0.0
        state[SLOPE + i] += follow * (slope - state[SLOPE + i])
        state[LAST_RATE + i] = rate[i]
        error = out[n + i] - rate[i]
        if state[CUT + i] * error <= 0.0:
            part = gains[RATE_PART + i]
            state[RATE_INTEGRAL + i] = bounded(state[RATE_INTEGRAL + i] + gains[RATE_KI + i] * error * dt, part)
        torque = gains[RATE_KP + i] * error + state[RATE_INTEGRAL + i] - gains[RATE_KD + i] * state[SLOPE + i]
        out[n + 3 + i] = bounded(torque, 1.0)
    state[STARTED] = 1.0
    out[n + 6] = mix(out, n, shares, command[THRUST], gains[COMMON_GAINS + 1], state)


def bounded(x: float, limit: float) -> float:
    """x within +-limit."""
    return limit if x > limit else (-limit if x < -limit else x)


def angle_error(q: Any, wanted: Any) -> tuple[float, float, float]:
    """The turn (rad, body axes) from attitude ``q`` to ``wanted``: the shortest one of the thrust axis, then heading.

    For one axis it is the difference of its angles, however large.
    """
    a = q[0] * wanted[0] + q[1] * wanted[1] + q[2] * wanted[2] + q[3] * wanted[3]
    b = q[0] * wanted[1] - q[1] * wanted[0] - q[2] * wanted[3] + q[3] * wanted[2]
    c = q[0] * wanted[2] + q[1] * wanted[3] - q[2] * wanted[0] - q[3] * wanted[1]
    d = q[0] * wanted[3] - q[1] * wanted[2] + q[2] * wanted[1] - q[3] * wanted[0]
    # A product of two turns: of the thrust axis (twist, x, y, 0), and about it (a, 0, 0, d) / twist.
    twist = math.sqrt(a * a + d * d)
    if twist < 1e-9:
        return math.pi * b, math.pi * c, 0.0
    x = (b * a - c * d) / twist
    y = (c * a + b * d) / twist
    sine = math.sqrt(x * x + y * y)
    factor = 2.0 * math.atan2(sine, twist) / sine if sine > 1e-9 else 2.0
    heading = 2.0 * math.atan2(d, a)
    if heading > math.pi:
        heading -= 2.0 * math.pi
    elif heading < -math.pi:
        heading += 2.0 * math.pi
    return factor * x, factor * y, heading


def mix(out: Any, n: int, shares: Any, thrust: float, idle: float, state: Any) -> float:
    """Rotor shares ``out[:n]`` from torques ``out[n + 3:n + 6]``; gives the collective share that was possible.

    Roll and pitch come first and are scaled together if a rotor cannot span them; the thrust is moved to where they
    fit; yaw gets what room is left. ``state[CUT:]`` tells per axis in which direction it was cut (+1, -1, 0 not).
    """
    low = 0.0
    high = 0.0
    for i in range(n):
        out[i] = shares[i, 0] * out[n + 3] + shares[i, 1] * out[n + 4]
        low = min(low, out[i])
        high = max(high, out[i])
    span = high - low
    scale = (1.0 - idle) / span if span > 1.0 - idle else 1.0
    given = max(min(thrust, 1.0 - scale * high), idle - scale * low)
    room = 1.0
    for i in range(n):
        out[i] = given + scale * out[i]
        turn = shares[i, 2] * out[n + 5]
        if turn > 0.0:
            room = min(room, (1.0 - out[i]) / turn)
        elif turn < 0.0:
            room = min(room, (idle - out[i]) / turn)
    room = max(room, 0.0)
    for i in range(n):
        out[i] = max(min(out[i] + room * shares[i, 2] * out[n + 5], 1.0), idle)
    for i in range(3):
        u = out[n + 3 + i]
        cut = abs(u) >= 1.0 or (scale < 1.0 if i < 2 else room < 1.0)
        state[CUT + i] = (1.0 if u > 0.0 else -1.0) if cut else 0.0
    return given


SIGNATURE = "void(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8, f8[::1])"
KERNEL = kernel_of(control, SIGNATURE, "controller")


def compiled() -> Callable[..., None]:
    """:func:`control` as machine code; in plain Python with ATTLOG_NO_JIT=1."""
    return function_of(KERNEL, control)
