"""Mounting rotations by number (MAV_SENSOR_ORIENTATION), shared by PX4 and ArduPilot.

Values: MAVLink common.xml, and PX4 src/lib/conversion/rotation.h.
"""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array

EULER_DEG = (
    (0, 0, 0),
    (0, 0, 45),
    (0, 0, 90),
    (0, 0, 135),
    (0, 0, 180),
    (0, 0, 225),
    (0, 0, 270),
    (0, 0, 315),
    (180, 0, 0),
    (180, 0, 45),
    (180, 0, 90),
    (180, 0, 135),
    (0, 180, 0),
    (180, 0, 225),
    (180, 0, 270),
    (180, 0, 315),
    (90, 0, 0),
    (90, 0, 45),
    (90, 0, 90),
    (90, 0, 135),
    (270, 0, 0),
    (270, 0, 45),
    (270, 0, 90),
    (270, 0, 135),
    (0, 90, 0),
    (0, 270, 0),
    (0, 180, 90),
    (0, 180, 270),
    (90, 90, 0),
    (180, 90, 0),
    (270, 90, 0),
    (90, 180, 0),
    (270, 180, 0),
    (90, 270, 0),
    (180, 270, 0),
    (270, 270, 0),
    (90, 180, 90),
    (90, 0, 270),
    (90, 68, 293),
    (0, 315, 0),
    (90, 315, 0),
    (270, 0, 180),
    (270, 0, 270),
    (0, 90, 180),
    (0, 9, 180),
    (0, 45, 0),
    (270, 0, 225),
    (270, 0, 315),
)
"""Roll, pitch, yaw of the sensor or board in the vehicle, by number."""


def mounting(number: float | None) -> Array | None:
    """The rotation matrix (3, 3) that turns sensor vectors into body vectors, None for an unknown number."""
    if number is None or not 0 <= number < len(EULER_DEG):
        return None
    return euler_matrix(*EULER_DEG[int(number)])


def euler_matrix(roll_deg: float, pitch_deg: float, yaw_deg: float) -> Array:
    """The rotation matrix (3, 3) of Euler angles in degrees, z-y-x."""
    return rotation.to_matrix(rotation.from_euler(*np.radians([roll_deg, pitch_deg, yaw_deg])))
