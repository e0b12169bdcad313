"""Mahony's explicit complementary filter: one gain on the sum of gravity and heading error.

    e   = e_g + mag_gain e_m        e_g = v x d,  v = -f/g measured, d = R^T e_z predicted down
                                    e_m = R^T (0, 0, -sin psi), psi heading of the field R m
    b'  = -ki e                     gyro bias [rad/s]
    q'  = q (x) (0, w - b + kp e)/2

Source: Mahony2008 (explicit filter, equations 32); Xu section 2, who varies kp on Pixhawk logs
(section 3: 0.6, 1.1, 2; section 4: 0.6 to 1.1 are best) and does not state ki (presets, without bias).

Departures. Xu section 2 turns the accelerometer into a quaternion rate by gradient descent and adds
it to the gyro's; here the cross product of the filter that gives the paper its name does, the gradient
step is ``madgwick``. Xu's frames (right-forward-up, ENU, order Z-X-Y) are translated to FRD
and NED. Printed errors stay out: (3) loses a factor 2 in 2 q1^2, rows 2-4 of (10)
are permuted, (11) and (15) print the same quotient twice and use arctan for atan2.
``mag_form = vector`` is Mahony's cross product with the whole field,
``integrator = first_order`` Xu's (6-10), ``acc_form = direction`` his unit vector. The
default takes f/g for f/|f|: on 12 BROAD trials tilt falls from 4.2 to 2.5 deg
(kp 0.6), on four EuRoC flights it stays (6.0 and 6.1 deg).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from attlog.estimators.interface import ACC_FORM, AS_PRINTED, INTEGRATOR, MAG_FORM, MAG_GAIN, Parameter
from attlog.estimators.vectors import field_error, gravity_error, turn

SOURCE = "Mahony2008 32; Xu section 2, gains section 3"
EQUATION = "Mahony2008 32"
NEEDS = {"gyro", "acc"}
USES = {"mag"}
STATE = {"q": 4, "bias": 3}
PARAMETERS = (
    Parameter(
        "kp",
        0.45,
        "1/s",
        0,
        100,
        "gain of the error: large follows the accelerometer, small the gyro; 1/kp is the time constant",
        "attlog; below the 0.6 to 1.1 that are best of Xu's section 4, because every acceleration tilts by kp",
    ),
    Parameter(
        "ki", 0.004, "1/s^2", 0, 10, "gain of the gyro bias estimate; 0 estimates none", "attlog; kp / ki about 100 s"
    ),
    replace(MAG_GAIN, default=0.5, source="attlog; a field near motors is the worse reference; 1 is Mahony2008"),
    MAG_FORM,
    ACC_FORM,
    INTEGRATOR,
)
PRESETS = {
    "xu-0.6": {"kp": 0.6, "ki": 0.0, "mag_gain": 1.0, **AS_PRINTED},
    "xu-1.1": {"kp": 1.1, "ki": 0.0, "mag_gain": 1.0, **AS_PRINTED},
    "xu-2": {"kp": 2.0, "ki": 0.0, "mag_gain": 1.0, **AS_PRINTED},
}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude, and no bias yet."""
    state = np.zeros(7)
    state[0:4] = q0
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """One update: both errors, bias, rate, attitude."""
    kp = params[0]
    ki = params[1]
    gx, gy, gz = gravity_error(state, acc, params[4])
    mx, my, mz = field_error(state, mag, params[3])
    ex = gx + params[2] * mx
    ey = gy + params[2] * my
    ez = gz + params[2] * mz
    state[4] -= ki * ex * dt
    state[5] -= ki * ey * dt
    state[6] -= ki * ez * dt
    wx = gyr[0] - state[4] + kp * ex
    wy = gyr[1] - state[5] + kp * ey
    wz = gyr[2] - state[6] + kp * ez
    turn(state, wx, wy, wz, dt, params[5])
