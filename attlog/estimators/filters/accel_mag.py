"""Accelerometer and magnetometer alone: the attitude that each pair of vectors shows, no memory.

    v     = -f/|f|
    roll  = atan2(v_y, v_z)
    pitch = atan2(-v_x, |v_yz|)
    yaw   = atan2(-(m_y cos(roll) - m_z sin(roll)),
                  m_x cos(pitch) + m_y sin(pitch) sin(roll) + m_z sin(pitch) cos(roll))

Never drifts, but takes every acceleration for a tilt and every vibration for a rotation.

Source: Fan "method 1", equations 5, 12 and 13 (the heading); Xu 11-15.

Departures. Fan prints ``M_bx sin(phi)`` in the heading, a plain arctangent and pitch
without its sign; Xu (11) and (15) print the same quotient twice. Without a usable vector
the affected angles stay as they were.
"""

from __future__ import annotations

import math
from typing import Any

SOURCE = "Fan 5, 12, 13; Xu 11-15"
NEEDS = {"acc", "mag"}
VECTORS_AT = "end"
STATE = {"q": 4}
PARAMETERS = ()


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude only."""
    return q0


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """One update: three angles from two vectors, then the quaternion of the angles (order z-y-x)."""
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    has_acc = acc[0] != 0.0 or acc[1] != 0.0 or acc[2] != 0.0
    # The attitude's own down axis stands in where there is no specific force.
    vx = -acc[0] if has_acc else 2.0 * (q1 * q3 - q0 * q2)
    vy = -acc[1] if has_acc else 2.0 * (q2 * q3 + q0 * q1)
    vz = -acc[2] if has_acc else 1.0 - 2.0 * (q1 * q1 + q2 * q2)
    roll = math.atan2(vy, vz)
    pitch = math.atan2(-vx, math.sqrt(vy * vy + vz * vz))
    hx = mag[0] * math.cos(pitch) + math.sin(pitch) * (mag[1] * math.sin(roll) + mag[2] * math.cos(roll))
    hy = mag[1] * math.cos(roll) - mag[2] * math.sin(roll)
    if hx != 0.0 or hy != 0.0:
        yaw = math.atan2(-hy, hx)
    else:
        yaw = math.atan2(2.0 * (q0 * q3 + q1 * q2), 1.0 - 2.0 * (q2 * q2 + q3 * q3))
    cr = math.cos(0.5 * roll)
    sr = math.sin(0.5 * roll)
    cp = math.cos(0.5 * pitch)
    sp = math.sin(0.5 * pitch)
    cy = math.cos(0.5 * yaw)
    sy = math.sin(0.5 * yaw)
    state[0] = cr * cp * cy + sr * sp * sy
    state[1] = sr * cp * cy - cr * sp * sy
    state[2] = cr * sp * cy + sr * cp * sy
    state[3] = cr * cp * sy - sr * sp * cy
