"""Complementary filter with variable integral: the integral is faded out where the error is large.

    e      = e_g + e_m                      sine of the angle between predicted and measured gravity (13-15), and field
    I'     = e
    e_adj  = kp e + ratio ki I              (16)
    ratio  = 1                              |e| < err1                                                  (17)
           = (err2 - |e|) / (err2 - err1)   err1 <= |e| <= err2
           = 0                              |e| > err2
    w'     = w + e_adj                      (18)
    q'     = q (x) (0, w')/2                (8-10)

Source: Lyu 11-18, values of section 3.1 (preset ``lyu``: kp 0.5, ki 0.001, err1 0.3, err2 0.8,
no magnetometer, first-order step). Reported as gyro bias is ``b = -ki I``.

Departures. Printed frames are left-handed and matrix (1) is garbled in places: both are
translated to FRD and NED. |e| is the norm of the vector. The ratio scales the integral's
output as printed; ``freeze = input`` scales what is accumulated instead, the usual
anti-windup. Lyu does not say whether ki is per second or per sample: ``ki_per``.

Know this: err1 = 0.3 is an error of 17 deg. At rest and in gentle motion the ratio is 1 and
the filter is ``complementary`` to the last bit; it can be neither quieter nor slower there. With
3 m/s^2 (RMS) of vibration the mean error is above err1; then it is some percent quieter with ki per sample.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from attlog.estimators.interface import ACC_FORM, AS_PRINTED, INTEGRATOR, KI_PER, MAG_FORM, MAG_GAIN, Parameter
from attlog.estimators.vectors import field_error, gravity_error, turn

SOURCE = "Lyu 11-18"
NEEDS = {"gyro", "acc"}
USES = {"mag"}
STATE = {"q": 4, "bias": 3, "ratio": 1}
PARAMETERS = (
    Parameter(
        "kp",
        0.3,
        "1/s",
        0,
        100,
        "proportional gain: large follows the accelerometer, small the gyro",
        "attlog; as complementary",
    ),
    Parameter(
        "ki",
        0.005,
        "1/s^2",
        0,
        10,
        "integral gain, takes out the gyro bias; 0 estimates none",
        "attlog; may be larger than in complementary because it fades where errors are large",
    ),
    Parameter("err1", 0.3, "1", 0, 2, "error (sine) up to which the integral works in full", "Lyu section 3.1"),
    Parameter(
        "err2",
        0.8,
        "1",
        0,
        2,
        "error (sine) from which the integral is off; at or below err1 it is a switch",
        "Lyu section 3.1",
    ),
    replace(MAG_GAIN, default=0.5, source="attlog; as complementary"),
    MAG_FORM,
    ACC_FORM,
    INTEGRATOR,
    KI_PER,
    Parameter(
        "freeze",
        "output",
        "",
        0,
        1,
        "what the ratio scales: the integral's output, or its input (anti-windup)",
        "Lyu 16 prints output",
        ("output", "input"),
    ),
)
PRESETS = {"lyu": {"kp": 0.5, "ki": 0.001, "err1": 0.3, "err2": 0.8, "mag_gain": 0.0, **AS_PRINTED}}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude, no bias yet, ratio 1."""
    state = np.zeros(8)
    state[0:4] = q0
    state[7] = 1.0
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """One update: errors, ratio, integral, rate, attitude."""
    kp = params[0]
    err1 = params[2]
    err2 = params[3]
    gx, gy, gz = gravity_error(state, acc, params[6])
    mx, my, mz = field_error(state, mag, params[5])
    ex = gx + params[4] * mx
    ey = gy + params[4] * my
    ez = gz + params[4] * mz
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    width = err2 - err1
    fade = (err2 - size) / width if width > 0.0 else 0.0
    fade = fade if fade > 0.0 else 0.0
    ratio = 1.0 if size < err1 else fade
    output = 1.0 if params[9] > 0.5 else ratio
    entry = ratio if params[9] > 0.5 else 1.0
    ki_dt = params[1] * (1.0 if params[8] > 0.5 else dt) * entry
    state[4] -= ki_dt * ex
    state[5] -= ki_dt * ey
    state[6] -= ki_dt * ez
    state[7] = ratio
    wx = gyr[0] - output * state[4] + kp * ex
    wy = gyr[1] - output * state[5] + kp * ey
    wz = gyr[2] - output * state[6] + kp * ez
    turn(state, wx, wy, wz, dt, params[7])
