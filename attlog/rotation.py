"""Attitudes as quaternions, Euler angles and rotation vectors: conversions, products, interpolation, errors.

Quaternions are scalar first, Hamilton product; ``q`` turns body vectors (forward-right-down) into earth vectors
(north-east-down). Euler angles are roll, pitch, yaw in the order z-y-x. Angles in rad. Arrays are (n, 4) and (n, 3), or
single ones. ``ENU`` and ``FLU`` turn east-north-up into north-east-down and forward-left-up into forward-right-down:
``multiply(multiply(ENU, q_ros), FLU)``.
"""

from attlog.core.rotation import (
    ENU,
    FLU,
    conjugate,
    earth_error,
    from_euler,
    from_matrix,
    from_rotvec,
    heading_angle,
    mean,
    multiply,
    normalize,
    rotate,
    rotate_inverse,
    slerp,
    tilt_angle,
    to_euler,
    to_matrix,
    to_rotvec,
    total_angle,
    wrap,
)

__all__ = [
    "ENU",
    "FLU",
    "conjugate",
    "earth_error",
    "from_euler",
    "from_matrix",
    "from_rotvec",
    "heading_angle",
    "mean",
    "multiply",
    "normalize",
    "rotate",
    "rotate_inverse",
    "slerp",
    "tilt_angle",
    "to_euler",
    "to_matrix",
    "to_rotvec",
    "total_angle",
    "wrap",
]
