"""What airspeed tells a filter of a body that flies where its nose points: accelerations that are no gravity.

    v' = d/dt (V e_x) = (V', w_z V, -w_y V)        true airspeed V along the nose, no sideslip                (1)
    f - v' = -g R^T e_z                            in air that moves steadily                                 (2)

In a coordinated turn the specific force points out of the cabin floor, whatever the bank; (2) turns it back to gravity.
The angle of attack is left out: it counts while the body rolls, and cancels over a turn.

Source: centripetal correction of Premerlani2009, and the change of airspeed.
"""

from __future__ import annotations

import math
from typing import Any

AIR_SPEED, AIR_CHANGE, AIR_HEARD, AIR_TOLD, AIR_AGE = 0, 1, 2, 3, 4
"""From where it stands in the state: V of (1) [m/s], V' [m/s^2], the low-passed reading, the last one, its age [s]."""
SLOWEST, SURE = 1.0, 3.0
"""Below the first [m/s] a pitot tube tells nothing, from the second on it counts in full."""
FOLLOW_TIME, STEEPEST, AIR_LOST = 0.3, 10.0, 2.0
"""Time constant of the low-pass [s], the steepest change believed [m/s^2], how long a reading holds [s]."""
NEVER = 1e9


def hear(state: Any, at: int, dt: float, told: float, still: bool) -> None:
    """The airspeed at ``at`` after another ``dt``: ``told`` m/s, NaN where nothing new came.

    The first reading counts at once. While the body is ``still`` the reading is followed and no acceleration
    concluded: tubes tell anything before they are set to zero.
    """
    first = state[at + AIR_AGE] >= NEVER
    state[at + AIR_AGE] += dt
    if told == told:
        state[at + AIR_TOLD] = told
        state[at + AIR_AGE] = 0.0
    state[at + AIR_SPEED] = 0.0
    state[at + AIR_CHANGE] = 0.0
    if state[at + AIR_AGE] > AIR_LOST:
        state[at + AIR_HEARD] = 0.0
        state[at + AIR_AGE] = NEVER
    elif first or still:
        state[at + AIR_HEARD] = state[at + AIR_TOLD]
    else:
        before = counted(state[at + AIR_HEARD])
        step = (1.0 - math.exp(-dt / FOLLOW_TIME)) * (state[at + AIR_TOLD] - state[at + AIR_HEARD])
        state[at + AIR_HEARD] += min(max(step, -STEEPEST * dt), STEEPEST * dt)
        state[at + AIR_SPEED] = counted(state[at + AIR_HEARD])
        state[at + AIR_CHANGE] = (state[at + AIR_SPEED] - before) / dt


def counted(speed: float) -> float:
    """How much of an airspeed in m/s counts: nothing of a breeze, all of a flight."""
    share = min(max((speed - SLOWEST) / (SURE - SLOWEST), 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share) * speed


def without_flight(state: Any, at: int, acc: Any, wy: float, wz: float) -> tuple[float, float, float]:
    """(2): specific force less v'; a missing sample (zero) stays one. ``w`` rad/s, the gyro's bias taken off."""
    if acc[0] == 0.0 and acc[1] == 0.0 and acc[2] == 0.0:
        return 0.0, 0.0, 0.0
    speed = state[at + AIR_SPEED]
    return acc[0] - state[at + AIR_CHANGE], acc[1] - wz * speed, acc[2] + wy * speed
