"""Accelerometer and magnetometer alone: the attitude that each pair of vectors shows, no memory.

    v     = -f/|f|
    roll  = atan2(v_y, v_z)
    pitch = atan2(-v_x, |v_yz|)
    yaw   = atan2(-(m_y cos(roll) - m_z sin(roll)),
                  m_x cos(pitch) + m_y sin(pitch) sin(roll) + m_z sin(pitch) cos(roll))

It never drifts, but takes every acceleration for a tilt and every vibration for a rotation.

Source: Fan "method 1", equations 5, 12 and 13 (the heading); Xu 11-15.

Departures. Fan prints ``M_bx sin(phi)`` in the heading, a plain arctangent and pitch
without its sign; Xu (11) and (15) print the same quotient twice. Without a usable vector
the affected angles stay as they were.
"""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.vectors import down, is_present, quaternion

SOURCE = "Fan 5, 12, 13; Xu 11-15"
NEEDS = {"acc", "mag"}
VECTORS_AT = "end"
STATE = {"q": 4}
PARAMETERS = ()


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state: attitude only."""
    return q0


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """Compute three angles from two vectors, then their quaternion (order z-y-x)."""
    # Without specific force the attitude's own down axis counts.
    vx, vy, vz = (-acc[0], -acc[1], -acc[2]) if is_present(acc) else down(state)
    roll = math.atan2(vy, vz)
    pitch = math.atan2(-vx, math.sqrt(vy * vy + vz * vz))
    hx = mag[0] * math.cos(pitch) + math.sin(pitch) * (mag[1] * math.sin(roll) + mag[2] * math.cos(roll))
    hy = mag[1] * math.cos(roll) - mag[2] * math.sin(roll)
    if hx != 0.0 or hy != 0.0:
        yaw = math.atan2(-hy, hx)
    else:
        q0, q1, q2, q3 = quaternion(state, 0)
        yaw = math.atan2(2.0 * (q0 * q3 + q1 * q2), 1.0 - 2.0 * (q2 * q2 + q3 * q3))
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    state[0] = cr * cp * cy + sr * sp * sy
    state[1] = sr * cp * cy - cr * sp * sy
    state[2] = cr * sp * cy + sr * cp * sy
    state[3] = cr * cp * sy - sr * sp * cy
