"""Prescribed motion: attitude and place by formulas, with their exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.simulate.scenario.scenario import Scenario

Array = NDArray[np.float64]
RING_HZ, RING_S = 45.0, 0.03
"""A blow rings off like a light airframe on a table."""


@dataclass(slots=True)
class BodyMotion:
    """The motion at n times: attitude ``q``, body rate and its derivative, place, velocity, acceleration (earth axes);
    ``shock`` (n,) m/s^2 along body down that the sensors feel on top."""

    q: Array
    w: Array
    w_dot: Array
    p: Array
    v: Array
    a: Array
    shock: Array


def moved(scenario: Scenario, t: Array, lying: tuple[Array, Array] | None = None) -> BodyMotion:
    """The prescribed motion of a scenario at times ``t`` (n,) s since it began.

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
    """Body rate and its derivative of roll, pitch, yaw (n, 3) and their first two derivatives."""
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
