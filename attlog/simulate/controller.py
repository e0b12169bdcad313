"""The nested controller of Huang et al. (angle to rate to torque to rotors, 400 Hz), and its transfer functions.

    e      = angle from the attitude to the set-point, in body axes      (tilt first, then heading)
    w_set  = kp e + ki int(e)                       outer PI, limited to ``rate_limit``
    u      = kp (w_set - w) + ki int(w_set - w) - kd dw/dt               inner PID, limited to +-1
    f_i    = thrust + mixer_i u                     share of a rotor's largest thrust, 0 to 1

Source: Huang tables 2 and 3: outer 4.5 and 0.35, inner 0.14, 0.015 and 0.0025 for roll and pitch. Ours, because the
paper prints none: the unit of ``u`` (1 moves the rotors of a side by half of their largest thrust, as in autopilots of
that time), yaw's gains, all limits, the derivative of the measured rate behind a low-pass (that of the error would kick
at every step of the set-point), and the anti-windup: an integral stops in the direction that is limited, and the mixer
gives up yaw first, then thrust, roll and pitch last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import jit
from attlog.core.jit import F1, F2, Out1
from attlog.simulate.scenario import Controller

Array = NDArray[np.float64]
Three = tuple[float, float, float]

# Places in the state: three axes each, and whether there was a rate before.
ANGLE_INTEGRAL, RATE_INTEGRAL, LAST_RATE, SLOPE, CUT, STARTED, STATE_SIZE = 0, 3, 6, 9, 12, 15, 16
# Places of gains in their array: three axes each, then the derivative's low-pass and the idle thrust.
KP, KI, RATE_KP, RATE_KI, RATE_KD, RATE_LIMIT, ANGLE_PART, RATE_PART, COMMON_GAINS = 0, 3, 6, 9, 12, 15, 18, 21, 24
# A command: attitude wanted, collective share of thrust, 1 in flight (0 stops the rotors).
Q_SET, THRUST, ENGAGED, COMMAND_SIZE = 0, 4, 5, 6


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains and limits as (roll, pitch, yaw); ``u`` is the torque as a share of what the mixer can give.

    ``angle_kp`` 1/s, ``angle_ki`` 1/s^2, ``rate_kp`` s (u per rad/s), ``rate_ki`` 1, ``rate_kd`` s^2;
    ``rate_limit`` rad/s; ``angle_part`` rad/s and ``rate_part`` u, the most that an integral may give;
    ``derivative_hz`` corner of the derivative's low-pass; ``idle`` share of thrust at which a rotor still turns.
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
        """Return the gains of a scenario."""
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
        """Return the array (k,) that :func:`control` takes."""
        parts = (self.angle_kp, self.angle_ki, self.rate_kp, self.rate_ki, self.rate_kd, self.rate_limit)
        return np.array([*sum((*parts, self.angle_part, self.rate_part), ()), self.derivative_hz, self.idle])


def scaled_rate_gains(gains: Array, factors: Sequence[float]) -> Array:
    """Return packed gains with those of the rate loop of roll, pitch and yaw times a factor each."""
    found = gains.copy()
    for axis, factor in enumerate(factors):
        found[[RATE_KP + axis, RATE_KI + axis, RATE_KD + axis]] *= factor
    return found


def mixer(positions: Any, spins: Any) -> Array:
    """Return the share of each rotor per unit of roll, pitch and yaw: (n, 3), largest entry 0.5.

    ``positions`` (n, 2 or 3) m in body axes from the centre of mass, ``spins`` (n,) +1 where the rotor turns
    counter-clockwise seen from above (its drag turns the body clockwise, to a larger heading), else -1.
    """
    place = np.asarray(positions, np.float64)
    columns = np.column_stack([-place[:, 1], place[:, 0], np.asarray(spins, np.float64)])
    shares: Array = 0.5 * columns / np.abs(columns).max(axis=0)
    return shares


def new_controller_state() -> Array:
    """Return the controller's state before its first step."""
    return np.zeros(STATE_SIZE)


@jit.loop("the controller")
def control(state: Out1, gains: F1, q: F1, rate: F1, command: F1, shares: F2, dt: float, out: Out1) -> None:
    """Make one step: ``out`` is rotor shares (n), rate set-point (3), torque asked for (3), thrust given (1).

    ``q`` (4,) attitude and ``rate`` (3,) rad/s as estimated, ``command`` as above, ``shares`` (n, 3) of
    :func:`mixer`. State and ``out`` change in place.
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
    """Return x within +-limit."""
    return limit if x > limit else (-limit if x < -limit else x)


def angle_error(q: Any, wanted: Any) -> tuple[float, float, float]:
    """Return the rotation (rad, body axes) from attitude ``q`` to ``wanted``: thrust axis first, then heading.

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
    """Turn torques ``out[n + 3:n + 6]`` into rotor shares ``out[:n]``; return the collective share that was possible.

    Roll and pitch are scaled together if a rotor cannot span them; the thrust is moved to where they fit; yaw gets
    the remainder. ``state[CUT:]``: direction in which an axis was cut (+1, -1, 0 not).
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


LinearArray = NDArray[np.floating[Any]]
Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True, slots=True)
class LoopAxis:
    """One axis of the loop as transfer functions, for small angles.

    With authority A (``authority``, rad/s^2 per unit of torque), rotor lag T (``lag``, s) and the loop's delay d
    (``delay``, s: half a period of holding the output, sensors and computing):

        P(s) = A e^(-ds) / (T s + 1) / s                                   torque -> rate
        F(s) = kp + ki/s + kd s / (s/w_d + 1)                              rate -> torque (fed back)
        C(s) = kp + ki/s,   Co(s) = 4.5 + 0.35/s                           inner and outer PI
        L(s) = P (F + C Co / s)                                            the loop, cut at the rotors
        angle / set-point = (P C Co / s) / (1 + L)

    The delay is a Pade fraction of second order in steps and exact in margins.
    """

    authority: float
    lag: float
    gains: Gains
    index: int = 0
    delay: float = 0.00125

    @property
    def rate_feedback(self) -> tuple[LinearArray, LinearArray]:
        """Return numerator and denominator of F(s), from the highest power."""
        g, i = self.gains, self.index
        corner = 1.0 / (2.0 * math.pi * g.derivative_hz)
        low_pass = np.array([corner, 1.0])
        slope = np.array([g.rate_kd[i], 0.0, 0.0])
        return np.polyadd(np.polymul([g.rate_kp[i], g.rate_ki[i]], low_pass), slope), np.polymul([1.0, 0.0], low_pass)

    @property
    def forward(self) -> tuple[LinearArray, LinearArray]:
        """Return numerator and denominator of C(s) Co(s), from the highest power."""
        g, i = self.gains, self.index
        return np.polymul([g.rate_kp[i], g.rate_ki[i]], [g.angle_kp[i], g.angle_ki[i]]), np.array([1.0, 0.0, 0.0])

    def loop(self, omega: ArrayLike) -> Complex:
        """Return L(j omega); ``omega`` (n,) rad/s."""
        s = 1j * np.asarray(omega, np.float64)
        plant = self.authority * np.exp(-self.delay * s) / (self.lag * s + 1.0) / s
        inner, outer = _at(self.rate_feedback, s), _at(self.forward, s) / s
        found: Complex = plant * (inner + outer)
        return found

    def closed(self) -> tuple[LinearArray, LinearArray]:
        """Return numerator and denominator of angle / set-point, the delay as a Pade fraction."""
        d = self.delay
        ahead, behind = np.array([d * d / 12.0, -d / 2.0, 1.0]), np.array([d * d / 12.0, d / 2.0, 1.0])
        plant_num = self.authority * ahead
        plant_den = np.polymul(np.polymul([self.lag, 1.0], [1.0, 0.0]), behind)
        (f_num, f_den), (c_num, c_den) = self.rate_feedback, self.forward
        c_den = np.polymul(c_den, [1.0, 0.0])
        both = np.polyadd(np.polymul(f_num, c_den), np.polymul(c_num, f_den))
        num = np.polymul(np.polymul(plant_num, c_num), f_den)
        den = np.polyadd(np.polymul(plant_den, np.polymul(f_den, c_den)), np.polymul(plant_num, both))
        # F and C share integrators, which stand in both.
        while abs(num[-1]) < 1e-12 and abs(den[-1]) < 1e-12:
            num, den = num[:-1], den[:-1]
        return num, den

    def step(self, t: ArrayLike) -> LinearArray:
        """Return the angle (n,) at times ``t`` (n,) after a unit step, by a sum over the poles."""
        num, den = self.closed()
        poles = np.roots(den)
        residues = np.polyval(num, poles) / (np.polyval(np.polyder(den), poles) * poles)
        t = np.asarray(t, np.float64)
        parts = residues[None, :] * np.exp(np.outer(t, poles))
        rest = float(np.polyval(num, 0.0) / np.polyval(den, 0.0))
        return np.where(t > 0.0, rest + parts.sum(axis=1).real, 0.0)

    def response(self, omega: float) -> complex:
        """Return angle / set-point at ``omega`` rad/s, the delay exact."""
        s = np.array([1j * omega])
        plant = self.authority * np.exp(-self.delay * s) / (self.lag * s + 1.0) / s
        return complex((plant * _at(self.forward, s) / s / (1.0 + self.loop([omega])))[0])


@dataclass(frozen=True, slots=True)
class Margins:
    """Distance from instability: ``gain`` (factor), ``phase_deg``, ``delay_s``, at rad/s."""

    gain: float
    gain_at: float
    phase_deg: float
    phase_at: float

    @property
    def delay_s(self) -> float:
        """Return the additional delay that the phase margin allows."""
        return math.radians(self.phase_deg) / self.phase_at


def margins(axis: LoopAxis) -> Margins:
    """Return the gain margin above the highest crossing of -180 deg, the phase margin at that of 1."""
    omega = np.geomspace(0.1, 3000.0, 60000)
    loop = axis.loop(omega)
    size, phase = np.abs(loop), np.unwrap(np.angle(loop))
    phase -= 2.0 * np.pi * np.round((phase[-1] - np.angle(loop[-1])) / (2.0 * np.pi))
    phase = phase - 2.0 * np.pi * np.ceil((phase[len(phase) // 2] - 0.0) / (2.0 * np.pi))
    unity = int(np.flatnonzero((size[:-1] >= 1.0) & (size[1:] < 1.0))[-1])
    turned = int(np.flatnonzero((phase[:-1] >= -np.pi) & (phase[1:] < -np.pi) & (omega[1:] > omega[unity]))[0])
    return Margins(
        float(1.0 / size[turned]), float(omega[turned]), float(np.degrees(np.pi + phase[unity])), float(omega[unity])
    )


def rise_and_overshoot(t: LinearArray, y: LinearArray) -> tuple[float, float]:
    """Return the time from 10 to 90 % of a unit step ``y`` (n,) at ``t`` (n,) s, and its overshoot."""
    a, b = (float(np.interp(level, np.maximum.accumulate(y), t)) for level in (0.1, 0.9))
    return b - a, float(y.max() - 1.0)


def _at(fraction: tuple[LinearArray, LinearArray], s: Complex) -> Complex:
    """Return a fraction of polynomials at s."""
    value: Complex = np.polyval(fraction[0], s) / np.polyval(fraction[1], s)
    return value
