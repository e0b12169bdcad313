"""Mahony's filter on the direction cosine matrix, as small autopilots run it.

    d    = third row of R, d = R^T e_z              predicted down in body axes
    e_g  = v x d,  v = -f/|f|                       gravity error
    e_m  = -sin(psi) d                              psi: signed horizontal angle from expected to measured field
    e    = e_g + mag_gain e_m
    b'   = -ki e
    R'   = R [w - b + kp e]x
    r    = r_x . r_y / 2,  r_x -= r r_y,  r_y -= r r_x,  r_i = (3 - |r_i|^2) r_i / 2,  r_z = r_x x r_y

Source: Huang 2.3.2 (the filter) on the matrix of 2.3.1 with its renormalisation, which is
Premerlani2009's; gains of figure 3 (preset ``huang``: kp 0.3, ki 0.01, first-order step,
meant for 400 Hz). Tables 2 and 3 are the gains of the controller.

Departures. The dot in r_x . r_y is missing in print. The heading error of 2.3.2 is
|Hm x Hc|, the measured field with the body x axis: without a sign, which would drive the nose
to magnetic north, and with a factor cos(dip). The working meaning is the signed horizontal
angle above; ``heading_error = printed`` (preset ``huang``) keeps the factor, which is 1 where the
field is level and halves the gain on heading at a dip of 60 deg. Printed with a = f/|f| the
gravity error diverges; the sign here is tested on motion. It is ``mahony``
with another way to integrate: both agree to the integration error.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from attlog.estimators.interface import ACC_FORM, AS_PRINTED, INTEGRATOR, MAG_FORM, MAG_GAIN, Parameter
from attlog.estimators.vectors import (
    field_error,
    gravity_error,
    matrix_from_quaternion,
    quaternion_from_matrix,
    turn_matrix,
)

SOURCE = "Huang 2.3.2; Premerlani2009 (renormalisation)"
EQUATION = "Mahony2008 32"
NEEDS = {"gyro", "acc", "mag"}
STATE = {"q": 4, "bias": 3, "_matrix": 9}
PARAMETERS = (
    Parameter(
        "kp",
        0.3,
        "1/s",
        0,
        100,
        "proportional gain: large follows accelerometer and magnetometer, small the gyro",
        "Huang fig. 3",
    ),
    Parameter(
        "ki",
        0.005,
        "1/s^2",
        0,
        10,
        "integral gain, takes out the gyro bias; 0 estimates none",
        "attlog; half of Huang's 0.01 (fig. 3), which turns accelerations of half a minute into bias",
    ),
    replace(MAG_GAIN, default=0.5, source="attlog; as mahony"),
    Parameter(
        "heading_error",
        "sine",
        "",
        0,
        1,
        "size of the heading error: sine of the horizontal angle, or that times cos(dip), which leaves less the "
        "steeper the field",
        "attlog; printed is |Hm x Hc| of Huang 2.3.2",
        ("sine", "printed"),
    ),
    MAG_FORM,
    ACC_FORM,
    INTEGRATOR,
)
PRESETS = {"huang": {"kp": 0.3, "ki": 0.01, "mag_gain": 1.0, "heading_error": "printed", **AS_PRINTED}}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude as quaternion and matrix, and no bias yet."""
    state = np.zeros(16)
    state[0:4] = q0
    matrix_from_quaternion(state, 7)
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """One update: both errors, bias, rate, matrix, and the quaternion that follows it."""
    kp = params[0]
    ki = params[1]
    gx, gy, gz = gravity_error(state, acc, params[5])
    mx, my, mz = field_error(state, mag, params[4])
    gain = params[2] * (cos_dip(state, mag) if params[3] > 0.5 else 1.0)
    ex = gx + gain * mx
    ey = gy + gain * my
    ez = gz + gain * mz
    state[4] -= ki * ex * dt
    state[5] -= ki * ey * dt
    state[6] -= ki * ez * dt
    wx = gyr[0] - state[4] + kp * ex
    wy = gyr[1] - state[5] + kp * ey
    wz = gyr[2] - state[6] + kp * ez
    turn_matrix(state, 7, wx, wy, wz, dt, params[6])
    quaternion_from_matrix(state, 7)


def cos_dip(state: Any, mag: Any) -> float:
    """The level part of the field's direction, by the estimated down axis: |Hm x Hc| / sin(psi); 1 without a field."""
    square = mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2]
    down = mag[0] * state[13] + mag[1] * state[14] + mag[2] * state[15]
    level = 1.0 - down * down / square if square > 0.0 else 1.0
    return math.sqrt(level) if level > 0.0 else 0.0
