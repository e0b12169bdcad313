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
from attlog.estimators.vectors import GRAVITY, cross, down, matrix, places, turn

SOURCE = "PX4 attitude_estimator_q (1.12 to 1.15)"
NEEDS = {"gyro", "acc", "mag"}
USES = {"gnss"}
STATE = {"q": 4, "bias": 3, "_velocity": 3, "_acceleration": 3, "_fix_age": 1}
S = places(STATE)
# Rates [rad/s] from which the heading's gain grows, and up to which the bias is corrected: 50 and 10 deg/s.
FAST_RATE, BIAS_RATE = 0.873, 0.175
# An acceleration holds so long; fixes whose horizontal sigma is larger do not count.
FIX_LOST_S, MAX_FIX_SIGMA_M, NEVER = 1.0, 5.0, 1e9

PARAMETERS = (
    Parameter("ATT_W_ACC", 0.2, "1/s", 0, 100, "gain of the gravity error", "PX4"),
    Parameter("ATT_W_MAG", 0.1, "1/s", 0, 100, "gain of the heading error; 0 leaves the compass out", "PX4"),
    Parameter("ATT_W_GYRO_BIAS", 0.1, "1/s", 0, 100, "how fast the corrections become bias", "PX4"),
    Parameter("ATT_ACC_COMP", 0.0, "", 0, 2, "1: take the GNSS acceleration out", "PX4; 2 in 2015, later 1, now 0"),
    Parameter("ATT_BIAS_MAX", 0.05, "rad/s", 0, 2, "limit of the bias of each axis", "PX4"),
)
K = places({p.name: 1 for p in PARAMETERS})
PRESETS: dict[str, dict[str, float | str]] = {}


def from_log(params: Mapping[str, float], info: LogInfo) -> dict[str, float | str]:
    """Return the autopilot's own parameters, cut to their ranges."""
    values: dict[str, float | str] = {
        p.name: min(max(params[p.name], p.low), p.high) for p in PARAMETERS if p.name in params
    }
    if params.get("ATT_MAG_DECL_A") == 0.0 and abs(params.get("ATT_MAG_DECL", 360.0)) <= 180.0:
        values["declination"] = params["ATT_MAG_DECL"]
    return values


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state: attitude, no bias, no fix yet."""
    state = np.zeros(sum(STATE.values()))
    state[0:4] = q0
    state[S.fix_age] = NEVER
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any, aid: Any) -> None:
    """Take one update: acceleration, both errors, bias, attitude."""
    accelerate(state, params, dt, aid)
    spin = math.sqrt(gyr[0] * gyr[0] + gyr[1] * gyr[1] + gyr[2] * gyr[2])
    dx, dy, dz = down(state)
    r00, r01, r02, r10, r11, r12, _, _, _ = matrix(state, 0)
    hx = r00 * mag[0] + r01 * mag[1] + r02 * mag[2]
    hy = r10 * mag[0] + r11 * mag[1] + r12 * mag[2]
    # Without a field both are zero, of either sign, and the arctangent could be half a turn.
    psi = math.atan2(hy, hx) if hx != 0.0 or hy != 0.0 else 0.0
    k = -params[K.ATT_W_MAG] * psi * (min(spin / FAST_RATE, 10.0) if spin > FAST_RATE else 1.0)
    cx, cy, cz = k * dx, k * dy, k * dz
    norm = math.sqrt(acc[0] * acc[0] + acc[1] * acc[1] + acc[2] * acc[2])
    if norm > 0.0 and (params[K.ATT_ACC_COMP] > 0.5 or (0.9 * GRAVITY < norm and norm < 1.1 * GRAVITY)):
        # What is left of the force without the acceleration, in body axes.
        at = S.acceleration
        ux, uy, uz = acc[0] - state[at], acc[1] - state[at + 1], acc[2] - state[at + 2]
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        g = params[K.ATT_W_ACC] / length if length > 0.0 else 0.0
        ex, ey, ez = cross(dx, dy, dz, ux, uy, uz)
        cx, cy, cz = cx + g * ex, cy + g * ey, cz + g * ez
    if spin < BIAS_RATE:
        limit = params[K.ATT_BIAS_MAX]
        by = params[K.ATT_W_GYRO_BIAS] * dt
        state[4] = min(max(state[4] - by * cx, -limit), limit)
        state[5] = min(max(state[5] - by * cy, -limit), limit)
        state[6] = min(max(state[6] - by * cz, -limit), limit)
    turn(state, gyr[0] - state[4] + cx, gyr[1] - state[5] + cy, gyr[2] - state[6] + cz, dt, 0.0)


def accelerate(state: Any, params: Any, dt: float, aid: Any) -> None:
    """Update the acceleration in body axes by the two newest fixes; zero without one in the last second."""
    state[S.fix_age] += dt
    fix = (
        params[K.ATT_ACC_COMP] > 0.5
        and aid[VEL_N] == aid[VEL_N]
        and aid[VEL_E] == aid[VEL_E]
        and aid[VEL_D] == aid[VEL_D]
    )
    if fix and not aid[POS_H_ACC] >= MAX_FIX_SIGMA_M:
        if state[S.fix_age] < FIX_LOST_S:
            n = (aid[VEL_N] - state[S.velocity]) / state[S.fix_age]
            e = (aid[VEL_E] - state[S.velocity + 1]) / state[S.fix_age]
            d = (aid[VEL_D] - state[S.velocity + 2]) / state[S.fix_age]
            R = matrix(state, 0)
            for i in range(3):
                state[S.acceleration + i] = R[i] * n + R[3 + i] * e + R[6 + i] * d
        state[S.velocity], state[S.velocity + 1], state[S.velocity + 2] = aid[VEL_N], aid[VEL_E], aid[VEL_D]
        state[S.fix_age] = 0.0
    elif state[S.fix_age] >= FIX_LOST_S:
        for i in range(3):
            state[S.acceleration + i] = 0.0
