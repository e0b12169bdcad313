"""Complementary filter with fixed PI gains: the classic that Fan and Lyu compare theirs with.

    e    = e_g + e_m                cross products of measured and predicted gravity and field
    I'   = e                        integral of the error; reported as gyro bias b = -ki I
    w'   = w + kp e + ki I
    q'   = q (x) (0, w')/2

Source: Fan 14-18 and section 5 (preset ``fan``: kp 3, ki 0.01); Lyu's "traditional"
filter, (13)-(16) with ratio 1, gains of section 3.1 (preset ``lyu-fixed``: kp 0.5, ki 0.001,
no magnetometer).

Departures. Fan's norm without root (1), sign of +w_by in row 2 of Omega (3) and
diagonal of the DCM (4) are printed errors and stay out. Neither paper says whether ki
is per second or per sample: ``ki_per``. Fan section 4 may start at q = (1, 0, 0, 0), ``init = identity``;
the preset starts from the first vectors as every filter does, because from there the integral keeps a
wrong heading for minutes (kp / ki = 300 s). It differs from ``mahony`` in gains and in
``ki_per`` alone: the equations are the same.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from attlog.estimators.interface import ACC_FORM, AS_PRINTED, INTEGRATOR, KI_PER, MAG_FORM, MAG_GAIN, Parameter
from attlog.estimators.vectors import field_error, gravity_error, turn

SOURCE = "Fan 14-18 and section 5; Lyu 13-16"
EQUATION = "Mahony2008 32"
NEEDS = {"gyro", "acc"}
USES = {"mag"}
STATE = {"q": 4, "bias": 3}
PARAMETERS = (
    Parameter(
        "kp",
        0.35,
        "1/s",
        0,
        100,
        "proportional gain: large follows the accelerometer, small the gyro",
        "attlog; accelerations of 3 s average out (docs/estimators.md)",
    ),
    Parameter(
        "ki",
        0.0035,
        "1/s^2",
        0,
        10,
        "integral gain, takes out the gyro bias; 0 estimates none",
        "attlog; kp / ki = 100 s, slower than a flight's accelerations",
    ),
    replace(
        MAG_GAIN, default=0.4, source="attlog; a field near motors is the worse reference, a gyro holds heading 7 s"
    ),
    MAG_FORM,
    ACC_FORM,
    INTEGRATOR,
    KI_PER,
)
PRESETS = {
    "fan": {"kp": 3.0, "ki": 0.01, "mag_gain": 1.0, "mag_form": "vector", **AS_PRINTED},
    "lyu-fixed": {"kp": 0.5, "ki": 0.001, "mag_gain": 0.0, **AS_PRINTED},
}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude, and no bias yet."""
    state = np.zeros(7)
    state[0:4] = q0
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """One update: both errors, integral, rate, attitude."""
    kp = params[0]
    gx, gy, gz = gravity_error(state, acc, params[4])
    mx, my, mz = field_error(state, mag, params[3])
    ex = gx + params[2] * mx
    ey = gy + params[2] * my
    ez = gz + params[2] * mz
    ki_dt = params[1] * (1.0 if params[6] > 0.5 else dt)
    state[4] -= ki_dt * ex
    state[5] -= ki_dt * ey
    state[6] -= ki_dt * ez
    wx = gyr[0] - state[4] + kp * ex
    wy = gyr[1] - state[5] + kp * ey
    wz = gyr[2] - state[6] + kp * ez
    turn(state, wx, wy, wz, dt, params[5])
