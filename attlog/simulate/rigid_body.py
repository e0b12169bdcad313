"""A rigid body with four rotors in moving air and on the ground, and prescribed motions.

Body axes forward-right-down, earth axes north-east-down:

    p' = v,   m v' = R F + m g,   q' = 1/2 q (x) w,   J w' = M - w x (J w + h) - h'

F, M: thrust and drag torque of the rotors (both with the square of their speed), linear and quadratic air drag,
damping, ground. h: angular momentum of the rotors. Their speed follows the command with a first-order lag, solved
exactly; the rest is integrated by the classical fourth-order Runge-Kutta method in one compiled loop.

The ground carries eight points (feet and rotor tips) by springs and dampers; friction is a spring to the place where a
point touched down, dragged along beyond the cone of friction. A body at rest therefore stays at rest. A rotor that
strikes the ground breaks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, Out1, Out2, aligned_zeros
from attlog.simulate.scenario import ROTOR_SIGNS, ROTOR_TURNS, Scenario, Vehicle

Array = NDArray[np.float64]
P, V, Q, W, ROTOR, ANGLE = 0, 3, 6, 10, 13, 17
ANCHOR, TOUCHING, BROKEN = 21, 37, 45
# State: p, v (earth), q, w, rotor speeds and angles (4 each), anchors (8 x 2), touching (8), broken rotors (4).
BODY_STATE_SIZE, RAW_COLUMNS = 49, 17
# Of the step: v' 0, w' 3, specific force (body) 6, stage values behind.
NOW = 20
POINTS = 8
# Bounce of the vehicle on its feet, and the speed of impact that breaks a rotor.
SPRING_HZ, DAMPING, BREAKS_M_S = 12.0, 0.5, 0.5


class Body:
    """State (:data:`BODY_STATE_SIZE` numbers) of a vehicle and its integration; it begins at rest on its feet."""

    def __init__(self, vehicle: Vehicle, gravity: float, density: float, heading_rad: float = 0.0) -> None:
        self.numbers, self.points = _numbers(vehicle, gravity, density)
        self.state = np.zeros(BODY_STATE_SIZE)
        sink = vehicle.mass_kg * gravity / (4.0 * self.numbers[20])
        self.state[P + 2] = sink - vehicle.foot_m
        self.state[Q], self.state[Q + 3] = math.cos(0.5 * heading_rad), math.sin(0.5 * heading_rad)
        turn = np.array(
            [[math.cos(heading_rad), -math.sin(heading_rad)], [math.sin(heading_rad), math.cos(heading_rad)]]
        )
        self.state[ANCHOR : ANCHOR + 8] = (self.points[:4, :2] @ turn.T).ravel()
        self.state[TOUCHING : TOUCHING + 4] = 1.0
        self.now = np.zeros(NOW)
        self.health = np.ones(4)
        """Thrust of each rotor over what it should be."""
        self._command, self._wind = np.zeros(4), np.zeros(3)
        self._raw = np.zeros((0, RAW_COLUMNS))

    def advance(self, command: Array, wind: Array, h: float, raw: Array) -> None:
        """Integrate ``len(raw)`` steps of ``h`` s under motor commands (4,) and wind (3,) m/s, earth axes.

        ``raw`` (n, 17) is filled: w, w', specific force at the centre of gravity, rotor speeds, rotor angles.
        The same array each time is bound once.
        """
        if raw is not self._raw:
            fixed = (self.state, self._command, self.health, self._wind, self.numbers, self.points)
            scratch = aligned_zeros(4, 13), aligned_zeros(13), aligned_zeros(3, 4), aligned_zeros(3 * POINTS)
            self._raw, self._steps = raw, sub_steps.bound(*fixed, ..., len(raw), raw, self.now, *scratch)
        self._command[:], self._wind[:] = command, wind
        self._steps(h)


def _numbers(v: Vehicle, gravity: float, density: float) -> tuple[Array, Array]:
    """Return the loop's numbers of a vehicle, and the points (8, 3) that can touch the ground."""
    spring = v.mass_kg * (2.0 * math.pi * SPRING_HZ) ** 2 / 4.0
    damper = 2.0 * DAMPING * v.mass_kg * 2.0 * math.pi * SPRING_HZ / 4.0
    side = v.arm_m / math.sqrt(2.0)
    signs = np.array(ROTOR_SIGNS)
    feet = np.column_stack([0.7 * side * signs, np.full(4, v.foot_m)])
    tips = np.column_stack([1.3 * side * signs, np.full(4, -0.03)])
    numbers = [
        v.mass_kg,
        gravity,
        density,
        v.thrust_factor,
        v.torque_m,
        v.motor_lag_s,
        v.rotor_inertia_kg_m2,
        v.speed_max_rad_s,
        *v.inertia_kg_m2,
        *v.drag_n_s_m,
        *v.drag_area_m2,
        *v.damping_n_m_s,
        spring,
        damper,
        v.friction,
        side,
        *ROTOR_TURNS,
        *signs.ravel(),
    ]
    return np.array(numbers), np.ascontiguousarray(np.vstack([feet, tips]))


@jit.loop("the rigid body")
def sub_steps(
    s: Out1,
    command: F1,
    health: F1,
    wind: F1,
    c: F1,
    points: F2,
    h: float,
    n: int,
    raw: Out2,
    now: Out1,
    k: Out2,
    y: Out1,
    rotor: Out2,
    force: Out1,
) -> None:
    """Integrate ``n`` steps of ``h``: the state ``s`` moves on, a raw row is written at the end of each.

    Scratch: four derivatives ``k``, a state ``y``, three sets of rotor speeds, the ground's ``force``.
    """
    half = math.exp(-0.5 * h / c[5]) if c[5] > 0.0 else 0.0
    for i in range(13):
        y[i] = s[i]
    for i in range(4):
        rotor[0, i] = s[13 + i]
    _derivative(y, rotor[0], s, command, health, wind, c, points, k[0], now, force)
    for j in range(n):
        for i in range(4):
            goal = 0.0
            if s[45 + i] < 0.5:
                goal = c[7] * math.sqrt(min(max(command[i], 0.0), 1.0))
            rotor[0, i] = s[13 + i]
            rotor[1, i] = goal + (rotor[0, i] - goal) * half
            rotor[2, i] = goal + (rotor[1, i] - goal) * half
        for i in range(13):
            y[i] = s[i] + 0.5 * h * k[0, i]
        _derivative(y, rotor[1], s, command, health, wind, c, points, k[1], now, force)
        for i in range(13):
            y[i] = s[i] + 0.5 * h * k[1, i]
        _derivative(y, rotor[1], s, command, health, wind, c, points, k[2], now, force)
        for i in range(13):
            y[i] = s[i] + h * k[2, i]
        _derivative(y, rotor[2], s, command, health, wind, c, points, k[3], now, force)
        for i in range(13):
            s[i] += h / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])
        norm = 1.0 / math.sqrt(s[6] ** 2 + s[7] ** 2 + s[8] ** 2 + s[9] ** 2)
        for i in range(4):
            s[6 + i] *= norm
            # Simpson's rule: the angle of a speed that settles exponentially.
            s[17 + i] += h / 6.0 * (rotor[0, i] + 4.0 * rotor[1, i] + rotor[2, i])
            s[13 + i] = rotor[2, i]
        for i in range(13):
            y[i] = s[i]
        _derivative(y, rotor[2], s, command, health, wind, c, points, k[0], now, force)
        _settle_contacts(s, c, points, force)
        for i in range(3):
            raw[j, i] = s[10 + i]
            raw[j, 3 + i] = now[3 + i]
            raw[j, 6 + i] = now[6 + i]
        for i in range(8):
            raw[j, 9 + i] = s[13 + i]


def _derivative(
    y: Any,
    rotor: Any,
    s: Any,
    command: Any,
    health: Any,
    wind: Any,
    c: Any,
    points: Any,
    out: Any,
    now: Any,
    force: Any,
) -> None:
    """Write the derivative of p, v, q, w at ``y`` to ``out`` (13,), acceleration, w', specific force to ``now``."""
    q0, q1, q2, q3 = y[6], y[7], y[8], y[9]
    w0, w1, w2 = y[10], y[11], y[12]
    r00, r01, r02 = 1 - 2 * (q2 * q2 + q3 * q3), 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)
    r10, r11, r12 = 2 * (q1 * q2 + q0 * q3), 1 - 2 * (q1 * q1 + q3 * q3), 2 * (q2 * q3 - q0 * q1)
    r20, r21, r22 = 2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1 * q1 + q2 * q2)
    a0, a1, a2 = y[3] - wind[0], y[4] - wind[1], y[5] - wind[2]
    u0 = r00 * a0 + r10 * a1 + r20 * a2
    u1 = r01 * a0 + r11 * a1 + r21 * a2
    u2 = r02 * a0 + r12 * a1 + r22 * a2
    speed = 0.5 * c[2] * math.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
    f0 = -(c[11] + c[14] * speed) * u0
    f1 = -(c[12] + c[15] * speed) * u1
    f2 = -(c[13] + c[16] * speed) * u2
    m0, m1, m2 = -c[17] * w0, -c[18] * w1, -c[19] * w2
    spin = 0.0
    for i in range(4):
        thrust = health[i] * c[3] * rotor[i] * rotor[i]
        turn = c[24 + i]
        f2 -= thrust
        m0 -= thrust * c[29 + 2 * i] * c[23]
        m1 += thrust * c[28 + 2 * i] * c[23]
        m2 += turn * c[4] * thrust
        spin -= turn * c[6] * rotor[i]
        if c[5] > 0.0:
            goal = 0.0
            if s[45 + i] < 0.5:
                goal = c[7] * math.sqrt(min(max(command[i], 0.0), 1.0))
            m2 += turn * c[6] * (goal - rotor[i]) / c[5]
    reach = -0.5
    if y[2] > reach:
        for p in range(POINTS):
            x0, x1, x2 = points[p, 0], points[p, 1], points[p, 2]
            deep = y[2] + r20 * x0 + r21 * x1 + r22 * x2
            force[3 * p] = 0.0
            force[3 * p + 1] = 0.0
            force[3 * p + 2] = 0.0
            if deep <= 0.0:
                continue
            t0, t1, t2 = w1 * x2 - w2 * x1, w2 * x0 - w0 * x2, w0 * x1 - w1 * x0
            v0 = y[3] + r00 * t0 + r01 * t1 + r02 * t2
            v1 = y[4] + r10 * t0 + r11 * t1 + r12 * t2
            v2 = y[5] + r20 * t0 + r21 * t1 + r22 * t2
            press = c[20] * deep + c[21] * v2
            if press <= 0.0:
                continue
            g0, g1 = -c[21] * v0, -c[21] * v1
            if s[37 + p] > 0.5:
                g0 -= c[20] * (y[0] + r00 * x0 + r01 * x1 + r02 * x2 - s[21 + 2 * p])
                g1 -= c[20] * (y[1] + r10 * x0 + r11 * x1 + r12 * x2 - s[22 + 2 * p])
            size = math.sqrt(g0 * g0 + g1 * g1)
            if size > c[22] * press:
                g0 *= c[22] * press / size
                g1 *= c[22] * press / size
            force[3 * p], force[3 * p + 1], force[3 * p + 2] = g0, g1, -press
            b0 = r00 * g0 + r10 * g1 - r20 * press
            b1 = r01 * g0 + r11 * g1 - r21 * press
            b2 = r02 * g0 + r12 * g1 - r22 * press
            f0 += b0
            f1 += b1
            f2 += b2
            m0 += x1 * b2 - x2 * b1
            m1 += x2 * b0 - x0 * b2
            m2 += x0 * b1 - x1 * b0
    f0 /= c[0]
    f1 /= c[0]
    f2 /= c[0]
    for i in range(3):
        out[i] = y[3 + i]
    out[3] = r00 * f0 + r01 * f1 + r02 * f2
    out[4] = r10 * f0 + r11 * f1 + r12 * f2
    out[5] = r20 * f0 + r21 * f1 + r22 * f2 + c[1]
    out[6] = 0.5 * (-q1 * w0 - q2 * w1 - q3 * w2)
    out[7] = 0.5 * (q0 * w0 + q2 * w2 - q3 * w1)
    out[8] = 0.5 * (q0 * w1 - q1 * w2 + q3 * w0)
    out[9] = 0.5 * (q0 * w2 + q1 * w1 - q2 * w0)
    h0, h1, h2 = c[8] * w0, c[9] * w1, c[10] * w2 + spin
    out[10] = (m0 - (w1 * h2 - w2 * h1)) / c[8]
    out[11] = (m1 - (w2 * h0 - w0 * h2)) / c[9]
    out[12] = (m2 - (w0 * h1 - w1 * h0)) / c[10]
    for i in range(3):
        now[i] = out[3 + i]
        now[3 + i] = out[10 + i]
    now[6], now[7], now[8] = f0, f1, f2


def _settle_contacts(s: Any, c: Any, points: Any, force: Any) -> None:
    """Anchor points that touched down, release lifted ones, drag sliding ones; break rotors that strike."""
    q0, q1, q2, q3 = s[6], s[7], s[8], s[9]
    if s[2] <= -0.5:
        for p in range(POINTS):
            s[37 + p] = 0.0
        return
    for p in range(POINTS):
        x0, x1, x2 = points[p, 0], points[p, 1], points[p, 2]
        r0 = (1 - 2 * (q2 * q2 + q3 * q3)) * x0 + 2 * (q1 * q2 - q0 * q3) * x1 + 2 * (q1 * q3 + q0 * q2) * x2
        r1 = 2 * (q1 * q2 + q0 * q3) * x0 + (1 - 2 * (q1 * q1 + q3 * q3)) * x1 + 2 * (q2 * q3 - q0 * q1) * x2
        r2 = 2 * (q1 * q3 - q0 * q2) * x0 + 2 * (q2 * q3 + q0 * q1) * x1 + (1 - 2 * (q1 * q1 + q2 * q2)) * x2
        if s[2] + r2 <= 0.0:
            s[37 + p] = 0.0
            continue
        at0, at1 = s[0] + r0, s[1] + r1
        if s[37 + p] < 0.5:
            s[37 + p] = 1.0
            s[21 + 2 * p], s[22 + 2 * p] = at0, at1
            if p >= 4:
                t0, t1, t2 = s[11] * x2 - s[12] * x1, s[12] * x0 - s[10] * x2, s[10] * x1 - s[11] * x0
                fall = s[5] + 2 * (q1 * q3 - q0 * q2) * t0 + 2 * (q2 * q3 + q0 * q1) * t1
                fall += (1 - 2 * (q1 * q1 + q2 * q2)) * t2
                if abs(fall) > BREAKS_M_S:
                    s[45 + p - 4] = 1.0
            continue
        # The anchor stays within what friction can hold.
        hold = -c[22] * force[3 * p + 2] / c[20]
        g0, g1 = at0 - s[21 + 2 * p], at1 - s[22 + 2 * p]
        size = math.sqrt(g0 * g0 + g1 * g1)
        if size > hold:
            s[21 + 2 * p], s[22 + 2 * p] = at0 - g0 * hold / size, at1 - g1 * hold / size


# Ringing of a light airframe on a table.
RING_HZ, RING_S = 45.0, 0.03


@dataclass(slots=True)
class BodyMotion:
    """A motion at n times: attitude ``q``, body rate and its derivative, place, velocity, acceleration (earth axes).

    ``shock`` (n,) m/s^2: along body down, felt by the sensors on top.
    """

    q: Array
    w: Array
    w_dot: Array
    p: Array
    v: Array
    a: Array
    shock: Array


def prescribed_motion(scenario: Scenario, t: Array, lying: tuple[Array, Array] | None = None) -> BodyMotion:
    """Return the prescribed motion of a scenario at times ``t`` (n,) s since it began.

    It begins at the attitude (4,) and place (3,) of ``lying``, else at the scenario's angles, with the centre of
    gravity at its height over the feet.
    """
    motion = scenario.motion
    assert motion is not None
    place = np.array([0.0, 0.0, -scenario.vehicle.foot_m])
    start = [motion.roll_deg, motion.pitch_deg, scenario.place.heading_deg, 0.0, 0.0, 0.0]
    if lying is not None:
        start[:3] = np.degrees(rotation.to_euler(lying[0])).tolist()
        place = lying[1]
    value = np.tile(np.array(start), (len(t), 1))
    first, second, shock = np.zeros_like(value), np.zeros_like(value), np.zeros(len(t))
    now, begin = list(start), 0.0
    for move in motion.move:
        wanted = [move.roll_deg, move.pitch_deg, move.heading_deg, move.up_m, move.north_m, move.east_m]
        u = np.clip((t - begin) / move.seconds, 0.0, 1.0)
        begin += move.seconds
        for k, goal in enumerate(wanted):
            if goal is not None:
                way = goal - now[k]
                value[:, k] += way * u**3 * (10 + u * (-15 + 6 * u))
                first[:, k] += way * 30 * u**2 * (1 - u) ** 2 / move.seconds
                second[:, k] += way * 60 * u * (1 - u) * (1 - 2 * u) / move.seconds**2
                now[k] = goal
        after = np.maximum(t - begin, 0.0)
        shock += move.shock_m_s2 * np.exp(-after / RING_S) * np.sin(2 * np.pi * RING_HZ * after)
    angles, rates, accelerations = (np.radians(x[:, :3]) for x in (value, first, second))
    q = rotation.from_euler(*angles.T)
    w, w_dot = _body_rates(angles, rates, accelerations)
    arm = np.array(motion.arm_m)
    home = rotation.rotate(rotation.from_euler(*np.radians(start[:3])), arm)
    p = rotation.rotate(q, arm) - home + place
    v = rotation.rotate(q, np.cross(w, arm))
    a = rotation.rotate(q, np.cross(w_dot, arm) + np.cross(w, np.cross(w, arm)))
    for moving, ways in ((p, value), (v, first), (a, second)):
        moving += ways[:, [4, 5, 3]] * [1.0, 1.0, -1.0]
    return BodyMotion(q, w, w_dot, p, v, a, shock)


def _body_rates(angles: Array, rates: Array, accelerations: Array) -> tuple[Array, Array]:
    """Return body rate and its derivative of roll, pitch, yaw (n, 3) and their first two derivatives."""
    (roll, pitch, _), (dr, dp, dy), (ddr, ddp, ddy) = angles.T, rates.T, accelerations.T
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    w = np.stack([dr - dy * sp, dp * cr + dy * sr * cp, -dp * sr + dy * cr * cp], axis=1)
    w_dot = np.stack(
        [
            ddr - ddy * sp - dy * cp * dp,
            ddp * cr - dp * sr * dr + ddy * sr * cp + dy * (cr * cp * dr - sr * sp * dp),
            -ddp * sr - dp * cr * dr + ddy * cr * cp - dy * (sr * cp * dr + cr * sp * dp),
        ],
        axis=1,
    )
    return w, w_dot
