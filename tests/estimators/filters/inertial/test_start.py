"""What the alignment of ``mekf`` makes of an accelerometer's bias."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators.filters.inertial import start
from attlog.estimators.filters.inertial.layout import REACH, N, Q

G = 9.80665


@pytest.mark.parametrize("euler_deg", [(0.0, 0.0, 0.0), (20.0, -35.0, 110.0), (-60.0, 50.0, -140.0)])
def test_a_bias_of_any_axis_is_taken_for_the_tilt_that_takes_it_out_of_the_level(euler_deg: tuple[float, ...]) -> None:
    """The small turn ``theta`` after which ``R (f + b)`` points up again: the reach is what leads back."""
    q = rotation.from_euler(*np.radians(euler_deg))
    state = np.zeros(1000)
    state[Q : Q + 4] = q
    start.start_reach(state)
    force = rotation.rotate_inverse(q, np.array([0.0, 0.0, -G]))
    for axis in range(3):
        bias = 1e-4 * np.eye(3)[axis]
        up = rotation.rotate(q, force + bias)
        theta = np.cross(up, [0.0, 0.0, -1.0]) / G
        assert -1e-4 * state[REACH + N * axis : REACH + N * axis + 2] == pytest.approx(theta[:2], abs=1e-9)
