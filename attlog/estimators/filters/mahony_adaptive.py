"""Mahony's filter with a gain that fades when the accelerometer shows more than gravity.

    F'     = (R f - F) / tau                specific force in earth axes, low-passed
    s      = 1                              a < thr1,  a = | |F| - g | / g
           = (thr2 - a) / (thr2 - thr1)     thr1 <= a <= thr2
           = 0                              a > thr2
    e      = s e_g + mag_gain e_m           e_g, e_m as in ``mahony``
    k      = kp (1 + rate_gain |w - b|)
    b'     = -ki e
    q'     = q (x) (0, w - b + k e)/2

Source: Xu, whose abstract promises an adaptive gain but prints no law. **The law here is
ours**: the piecewise factor of Valenti2015 (equations 60-62), applied to
the gravity error only, because an acceleration says nothing about the field. The optional
rate term raises the gain while the body turns, where gyro scale errors grow; it is off by
default. Preset ``xu``: kp 0.6, where Xu's best fixed gains begin (section 4), without bias.

What is compared with g is not the sample but the specific force low-passed in earth axes, where
turning leaves it alone: 15 m/s^2 of vibration makes |f| of every sample too large, and a filter that
believes it never corrects its tilt again.

Departures. An acceleration across gravity hardly changes |f| and passes the test: 10 % in
norm is 0.46 g sideways. ``acc_form = vector`` (the default; ``direction`` as printed) treats those better.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from attlog.estimators.interface import ACC_FORM, AS_PRINTED, INTEGRATOR, MAG_FORM, MAG_GAIN, Parameter
from attlog.estimators.vectors import GRAVITY, field_error, gravity_error, turn

SOURCE = "Xu section 3 (gains); Valenti2015 60-62 (law)"
NEEDS = {"gyro", "acc"}
USES = {"mag"}
STATE = {"q": 4, "bias": 3, "trust": 1, "_force": 3}
PARAMETERS = (
    Parameter(
        "kp",
        0.3,
        "1/s",
        0,
        100,
        "gain of the error where the accelerometer is trusted in full",
        "attlog; half of the 0.6 where the best of Xu's section 4 begin",
    ),
    Parameter(
        "ki",
        0.006,
        "1/s^2",
        0,
        10,
        "gain of the gyro bias estimate; 0 estimates none",
        "attlog; larger than in mahony: long accelerations, which it takes for bias, are left out",
    ),
    Parameter(
        "thr1",
        0.1,
        "1",
        0,
        10,
        "deviation of |f| from g, in g, up to which the accelerometer is trusted in full",
        "Valenti2015",
    ),
    Parameter(
        "thr2", 0.2, "1", 0, 10, "deviation from which it is not used; at or below thr1 it is a switch", "Valenti2015"
    ),
    Parameter(
        "rate_gain", 0.0, "s/rad", 0, 100, "by how much the gain grows per rad/s of body rate", "attlog; 0 is off"
    ),
    replace(MAG_GAIN, default=0.5, source="attlog; as mahony"),
    Parameter(
        "tau",
        0.1,
        "s",
        0,
        100,
        "time constant of the specific force whose size decides; 0 takes each sample's own, vibration and all",
        "attlog; rotors shake above 5 Hz, manoeuvres last longer than half a second",
    ),
    MAG_FORM,
    ACC_FORM,
    INTEGRATOR,
)
PRESETS = {"xu": {"kp": 0.6, "ki": 0.0, "mag_gain": 1.0, **AS_PRINTED}}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude, no bias yet, full trust, gravity alone."""
    state = np.zeros(11)
    state[0:4] = q0
    state[7] = 1.0
    state[10] = -GRAVITY
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """One update: trust, both errors, bias, rate, attitude."""
    ki = params[1]
    thr1 = params[2]
    thr2 = params[3]
    norm = smooth_force(state, params[6], dt, acc)
    deviation = math.fabs(norm - GRAVITY) / GRAVITY
    width = thr2 - thr1
    fade = (thr2 - deviation) / width if width > 0.0 else 0.0
    fade = fade if fade > 0.0 else 0.0
    trust = 1.0 if deviation < thr1 else fade
    gx, gy, gz = gravity_error(state, acc, params[8])
    mx, my, mz = field_error(state, mag, params[7])
    ex = trust * gx + params[5] * mx
    ey = trust * gy + params[5] * my
    ez = trust * gz + params[5] * mz
    state[4] -= ki * ex * dt
    state[5] -= ki * ey * dt
    state[6] -= ki * ez * dt
    state[7] = trust
    wx = gyr[0] - state[4]
    wy = gyr[1] - state[5]
    wz = gyr[2] - state[6]
    k = params[0] * (1.0 + params[4] * math.sqrt(wx * wx + wy * wy + wz * wz))
    turn(state, wx + k * ex, wy + k * ey, wz + k * ez, dt, params[9])


def smooth_force(state: Any, tau: float, dt: float, acc: Any) -> float:
    """|F| [m/s^2] after one step of the low-pass towards R f; unchanged where there is no sample."""
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    fx = acc[0]
    fy = acc[1]
    fz = acc[2]
    north = fx * (1.0 - 2.0 * (q2 * q2 + q3 * q3)) + 2.0 * fy * (q1 * q2 - q0 * q3) + 2.0 * fz * (q1 * q3 + q0 * q2)
    east = 2.0 * fx * (q1 * q2 + q0 * q3) + fy * (1.0 - 2.0 * (q1 * q1 + q3 * q3)) + 2.0 * fz * (q2 * q3 - q0 * q1)
    down = 2.0 * fx * (q1 * q3 - q0 * q2) + 2.0 * fy * (q2 * q3 + q0 * q1) + fz * (1.0 - 2.0 * (q1 * q1 + q2 * q2))
    share = dt / (tau + dt) if fx != 0.0 or fy != 0.0 or fz != 0.0 else 0.0
    x = state[8] + share * (north - state[8])
    y = state[9] + share * (east - state[9])
    z = state[10] + share * (down - state[10])
    state[8] = x
    state[9] = y
    state[10] = z
    return math.sqrt(x * x + y * y + z * z)
