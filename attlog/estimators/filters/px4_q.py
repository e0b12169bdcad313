"""PX4's light filter ``attitude_estimator_q``: heading and gravity error with a gain each, bias where it hardly turns.

    c   = R^T (0, 0, -psi) ATT_W_MAG k(|w|) + d x u ATT_W_ACC
          psi  heading of the field R m, a whole angle; k = |w|/50 deg/s from 50 deg/s on, at most 10
          d    = R^T e_z,  u = (f - a)/|f - a|,  a = R^T dv/dt of the GNSS velocity with ATT_ACC_COMP, else 0
    b'  = -c ATT_W_GYRO_BIAS                      only while |w| < 10 deg/s, each axis within ATT_BIAS_MAX
    q'  = q (x) (0, w - b + c)/2

Without ATT_ACC_COMP gravity counts only while |f| is within 10 % of g. |w| is the rate as measured, with its bias.

Source: PX4 ``attitude_estimator_q`` as of versions 1.12 to 1.15. From a log come ATT_W_ACC, ATT_W_MAG,
ATT_W_GYRO_BIAS, ATT_ACC_COMP, ATT_BIAS_MAX and, where ATT_MAG_DECL_A is 0, ATT_MAG_DECL (as ``declination``).

Departures. ATT_ACC_COMP takes the velocity from the estimator of the position there, here from the
receiver, whose accelerations come at its own rate: each holds until the next fix, or for a second. Heading from
vision and motion capture (ATT_EXT_HDG_M) is left out. The field between its samples is turned on by the gyro
(held in body axes there). Steps are exact and as long as they are (first order and cut to 20 ms there). Versions
before 1.8 filter the accelerometer with 30 Hz and have neither the 10 % limit nor, before 1.6, k and the limit of the
rate for the bias.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from attlog.estimators.aids import POS_H_ACC, VEL_D, VEL_E, VEL_N
from attlog.estimators.interface import LogInfo, Parameter
from attlog.estimators.vectors import GRAVITY, down, turn

SOURCE = "PX4 attitude_estimator_q (1.12 to 1.15)"
NEEDS = {"gyro", "acc", "mag"}
USES = {"gnss"}
STATE = {"q": 4, "bias": 3, "_velocity": 3, "_acceleration": 3, "_fix_age": 1}
V, A, AGE = 7, 10, 13
FIFTY_DPS, BIAS_RATE = 0.873, 0.175
FIX_LOST_S, NEVER = 1.0, 1e9
WORST_FIX_M = 5.0

PARAMETERS = (
    Parameter("ATT_W_ACC", 0.2, "1/s", 0, 100, "gain of the gravity error", "PX4"),
    Parameter("ATT_W_MAG", 0.1, "1/s", 0, 100, "gain of the heading error; 0 leaves the compass out", "PX4"),
    Parameter("ATT_W_GYRO_BIAS", 0.1, "1/s", 0, 100, "how fast the corrections become bias", "PX4"),
    Parameter("ATT_ACC_COMP", 0.0, "", 0, 2, "1: take the GNSS acceleration out", "PX4; 2 in 2015, later 1, now 0"),
    Parameter("ATT_BIAS_MAX", 0.05, "rad/s", 0, 2, "limit of the bias of each axis", "PX4"),
)
PRESETS: dict[str, dict[str, float | str]] = {}


def from_log(params: Mapping[str, float], info: LogInfo) -> dict[str, float | str]:
    """The autopilot's own parameters, cut to what makes sense."""
    values: dict[str, float | str] = {
        p.name: min(max(params[p.name], p.low), p.high) for p in PARAMETERS if p.name in params
    }
    if params.get("ATT_MAG_DECL_A") == 0.0 and abs(params.get("ATT_MAG_DECL", 360.0)) <= 180.0:
        values["declination"] = params["ATT_MAG_DECL"]
    return values


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude, no bias, no fix yet."""
    state = np.zeros(14)
    state[0:4] = q0
    state[AGE] = NEVER
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any, aid: Any) -> None:
    """One update: acceleration, both errors, bias, attitude."""
    accelerate(state, params, dt, aid)
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    spin = math.sqrt(gyr[0] * gyr[0] + gyr[1] * gyr[1] + gyr[2] * gyr[2])
    dx, dy, dz = down(state)
    hx = (1.0 - 2.0 * (q2 * q2 + q3 * q3)) * mag[0] + 2.0 * (q1 * q2 - q0 * q3) * mag[1]
    hx += 2.0 * (q1 * q3 + q0 * q2) * mag[2]
    hy = 2.0 * (q1 * q2 + q0 * q3) * mag[0] + (1.0 - 2.0 * (q1 * q1 + q3 * q3)) * mag[1]
    hy += 2.0 * (q2 * q3 - q0 * q1) * mag[2]
    # Without a field both are zero, of either sign, and the arctangent could be half a turn.
    psi = math.atan2(hy, hx) if hx != 0.0 or hy != 0.0 else 0.0
    k = -params[1] * psi * (min(spin / FIFTY_DPS, 10.0) if spin > FIFTY_DPS else 1.0)
    cx = k * dx
    cy = k * dy
    cz = k * dz
    norm = math.sqrt(acc[0] * acc[0] + acc[1] * acc[1] + acc[2] * acc[2])
    if norm > 0.0 and (params[3] > 0.5 or (0.9 * GRAVITY < norm and norm < 1.1 * GRAVITY)):
        # What is left of the force without the acceleration, in body axes.
        ax = state[A]
        ay = state[A + 1]
        az = state[A + 2]
        ux = acc[0] - ax
        uy = acc[1] - ay
        uz = acc[2] - az
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        g = params[0] / length if length > 0.0 else 0.0
        cx += g * (dy * uz - dz * uy)
        cy += g * (dz * ux - dx * uz)
        cz += g * (dx * uy - dy * ux)
    if spin < BIAS_RATE:
        limit = params[4]
        by = params[2] * dt
        state[4] = min(max(state[4] - by * cx, -limit), limit)
        state[5] = min(max(state[5] - by * cy, -limit), limit)
        state[6] = min(max(state[6] - by * cz, -limit), limit)
    turn(state, gyr[0] - state[4] + cx, gyr[1] - state[5] + cy, gyr[2] - state[6] + cz, dt, 0.0)


def accelerate(state: Any, params: Any, dt: float, aid: Any) -> None:
    """The acceleration in body axes from two fixes, as of the newest; zero without one in the last second."""
    state[AGE] += dt
    fix = params[3] > 0.5 and aid[VEL_N] == aid[VEL_N] and aid[VEL_E] == aid[VEL_E] and aid[VEL_D] == aid[VEL_D]
    if fix and not aid[POS_H_ACC] >= WORST_FIX_M:
        if state[AGE] < FIX_LOST_S:
            n = (aid[VEL_N] - state[V]) / state[AGE]
            e = (aid[VEL_E] - state[V + 1]) / state[AGE]
            d = (aid[VEL_D] - state[V + 2]) / state[AGE]
            q0 = state[0]
            q1 = state[1]
            q2 = state[2]
            q3 = state[3]
            state[A] = (1.0 - 2.0 * (q2 * q2 + q3 * q3)) * n + 2.0 * (q1 * q2 + q0 * q3) * e
            state[A] += 2.0 * (q1 * q3 - q0 * q2) * d
            state[A + 1] = 2.0 * (q1 * q2 - q0 * q3) * n + (1.0 - 2.0 * (q1 * q1 + q3 * q3)) * e
            state[A + 1] += 2.0 * (q2 * q3 + q0 * q1) * d
            state[A + 2] = 2.0 * (q1 * q3 + q0 * q2) * n + 2.0 * (q2 * q3 - q0 * q1) * e
            state[A + 2] += (1.0 - 2.0 * (q1 * q1 + q2 * q2)) * d
        state[V] = aid[VEL_N]
        state[V + 1] = aid[VEL_E]
        state[V + 2] = aid[VEL_D]
        state[AGE] = 0.0
    elif state[AGE] >= FIX_LOST_S:
        state[A] = state[A + 1] = state[A + 2] = 0.0
