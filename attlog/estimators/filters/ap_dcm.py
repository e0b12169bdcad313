"""ArduPilot's DCM filter: specific force summed over a GNSS interval against gravity and the change of velocity.

    w       = gyro - b                                     b = -omega_I
    q'      = q (x) (0, w + P + Y e_z)/2
    a       = sum of R f dt / (T g)                        over the time T between two corrections
    r       = ((0, 0, -1) + AHRS_GPS_GAIN dv / (T g)) / |..|
    e       = R^T (a_last/|a_last| x r)                    a_last: the sum before the newest, for the receiver's lag
    P       = AHRS_RP_P k(|w|) e                           k: 1 below 50 deg/s, |w|/50 up to 500 deg/s, then 10
    Y       = AHRS_YAW_P k(|w|) s c_z R_zz e_h             e_h = -sin of the heading that the field shows
    s       = 0.2 (4.5 - |a_h|), from 4 m/s^2 on 0.1       a_h: horizontal acceleration, more of it tells heading
    b'      = -(0.0087 e, and 0.01 R_zz e_h in z)          below 20 deg/s, taken over every 5 s, at most 0.5 deg/s/min

Without GNSS a correction comes every 0.2 s with r = (0, 0, -1), on vehicles that fly forward with the change
of airspeed along the nose. With a compass the third earth component of the error is multiplied by
sin|roll| (0 without GNSS). P and Y are 8 times as large in the first 20 s on the ground; P is halved in the
acceleration of a launch. A forward vehicle takes its heading from the GNSS course where it has no compass, or one
that is more than 45 deg off the course for 2 s. Copters use dv only when armed.

Source: ArduPilot ``AP_AHRS_DCM`` as of versions 4.3 to 4.6, after Premerlani2009. From a log come AHRS_RP_P,
AHRS_YAW_P, AHRS_GPS_GAIN, AHRS_GPS_USE, COMPASS_USE, SCHED_LOOP_RATE, and COMPASS_DEC (as ``declination``) where the
autopilot does not look it up.
AHRS_TRIM is taken out of the attitude where it is compared, as for every filter.

Departures. One IMU is replayed; the autopilot averages two gyros and takes the better accelerometer. ``aid``
knows rest, not arming: rest stands for "disarmed". The compass correction decays by 3 % in each loop of the
autopilot until its compass is read again at 10 Hz; the mean of that is the factor c_z, so that a log's own rates
do not matter. The wind is not estimated: its change between two corrections is neglected. There is no minimum of
satellites, and GNSS is lost when no fix comes for three intervals, not by its status. The attitude is a
quaternion, which integrates exactly where the matrix is first order at the loop rate (0.001 deg/s at 400 Hz).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from attlog.estimators.aids import AIRSPEED, AT_REST, VEL_D, VEL_E, VEL_N
from attlog.estimators.interface import LogInfo, Parameter
from attlog.estimators.vectors import GRAVITY, turn

SOURCE = "ArduPilot AP_AHRS_DCM (4.3 to 4.6); Premerlani2009"
NEEDS = {"gyro", "acc"}
USES = {"mag", "gnss", "airspeed", "at_rest"}
STATE = {"q": 4, "bias": 3, "_correction": 33}
P, YAW, I_SUM, I_TIME, SUM, SUM_TIME, BEFORE, VELOCITY = 7, 10, 11, 14, 15, 18, 19, 22
LOCK, FIX_AGE, AGE, FIELD_AGE, ODD, SPEED, COURSE_N, COURSE_E = 25, 26, 27, 28, 29, 30, 31, 32
# Where things stand in the state.
HAS_YAW, YAW_AGE, AIR, C_Z, DECAY, EVERY = 33, 34, 35, 36, 37, 38

KI, KI_YAW, I_AFTER_S = 0.0087, 0.01, 5.0
DRIFT_LIMIT = math.radians(0.5 / 60.0)
SPIN_I, SPIN_P = math.radians(20.0), math.radians(50.0)
NO_GNSS_S, FIX_LOST, FIX_LOST_S, FIELD_LOST_S, DISCARD_S = 0.2, 3.0, 4.0, 2.0, 0.2
FAST, FAST_S = 8.0, 20.0
LEAST_SPEED, LAUNCH = 3.0, 7.0
COMPASS_HZ, DECAY_PER_LOOP = 10.0, 0.97
NEVER = 1e9

PARAMETERS = (
    Parameter("AHRS_RP_P", 0.2, "1/s", 0.05, 10, "how fast the accelerometer corrects roll and pitch", "ArduPilot"),
    Parameter("AHRS_YAW_P", 0.2, "1/s", 0.05, 10, "how fast compass or GNSS course correct the heading", "ArduPilot"),
    Parameter("AHRS_GPS_GAIN", 1.0, "1", 0, 10, "how much of the GNSS acceleration is taken out", "ArduPilot"),
    Parameter("AHRS_GPS_USE", 1.0, "", 0, 2, "0: no GNSS at all", "ArduPilot"),
    Parameter("COMPASS_USE", 1.0, "", 0, 1, "0: no heading from the compass", "ArduPilot"),
    Parameter("SCHED_LOOP_RATE", 400.0, "Hz", 20, 20000, "loop rate, at which compass corrections decay", "ArduPilot"),
    Parameter(
        "forward", "off", "", 0, 1, "a vehicle that moves where its nose points", "attlog, by vehicle", ("off", "on")
    ),
    Parameter(
        "fast_gains_s",
        FAST_S,
        "s",
        0,
        3600,
        "for how long gains are raised while at rest",
        "ArduPilot, 20 s from power-up",
    ),
)
# The firmware's map is within 2 deg of the world magnetic model.
MAP_DEG = 3.0
PRESETS: dict[str, dict[str, float | str]] = {}


def from_log(params: Mapping[str, float], info: LogInfo) -> dict[str, float | str]:
    """The autopilot's own parameters; ``fast_gains_s`` is what was left of 20 s after power-up.

    With COMPASS_AUTODEC (on by default) the firmware replaces COMPASS_DEC by its map's value at the first fix
    (``Compass::set_initial_location``). So the parameter in the log is the map's value for this place where it is near
    the declination (the map is coarse), and that of another place where it is not: then it counts only if nothing tells
    the declination of this one. With COMPASS_AUTODEC off it counts as it stands, 0 too.
    """
    known = {p.name: p for p in PARAMETERS}
    values: dict[str, float | str] = {
        name: min(max(params[name], known[name].low), known[name].high)
        for name in ("AHRS_RP_P", "AHRS_YAW_P", "AHRS_GPS_GAIN", "AHRS_GPS_USE", "SCHED_LOOP_RATE")
        if name in params
    }
    use = [params[name] for name in ("COMPASS_USE", "COMPASS_USE2", "COMPASS_USE3") if name in params]
    if use:
        values["COMPASS_USE"] = float(any(use))
    told = math.degrees(params.get("COMPASS_DEC", math.inf))
    if abs(told) <= 180.0 and (
        params.get("COMPASS_AUTODEC", 1.0) == 0.0
        or (told != 0.0 and (info.declination_deg is None or abs(told - info.declination_deg) <= MAP_DEG))
    ):
        values["declination"] = told
    if info.forward is not None:
        values["forward"] = "on" if info.forward else "off"
    if info.since_boot_s is not None:
        values["fast_gains_s"] = max(FAST_S - max(info.since_boot_s, 0.0), 0.0)
    return values


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: attitude, no bias yet, and how much of the compass correction is left between two readings."""
    state = np.zeros(40)
    state[0:4] = q0
    state[FIX_AGE] = state[FIELD_AGE] = state[YAW_AGE] = NEVER
    loops = max(params[5] / COMPASS_HZ, 1.0)
    state[C_Z] = (1.0 - DECAY_PER_LOOP**loops) / ((1.0 - DECAY_PER_LOOP) * loops)
    state[DECAY] = -math.log(DECAY_PER_LOOP) * params[5]
    state[HAS_YAW] = 1.0 if mag[0] != 0.0 or mag[1] != 0.0 or mag[2] != 0.0 else 0.0
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any, aid: Any) -> None:
    """One update: heading error, sum of specific force, drift correction where due, attitude."""
    wx = gyr[0] - state[4]
    wy = gyr[1] - state[5]
    wz = gyr[2] - state[6]
    spin = math.sqrt(wx * wx + wy * wy + wz * wz)
    gain = 1.0 if spin < SPIN_P else 10.0 if spin > 10.0 * SPIN_P else spin / SPIN_P
    fast = FAST if aid[AT_REST] != 0.0 and state[AGE] < params[7] else 1.0
    fix = params[3] > 0.5 and aid[VEL_N] == aid[VEL_N] and aid[VEL_E] == aid[VEL_E]
    for i in (AGE, FIX_AGE, FIELD_AGE, YAW_AGE):
        state[i] += dt
    if fix:
        state[EVERY] = min(state[FIX_AGE], FIX_LOST_S)
        state[FIX_AGE] = 0.0
        state[SPEED] = math.sqrt(aid[VEL_N] * aid[VEL_N] + aid[VEL_E] * aid[VEL_E])
        state[COURSE_N] = aid[VEL_N]
        state[COURSE_E] = aid[VEL_E]
    if params[4] > 0.5 and (mag[0] != 0.0 or mag[1] != 0.0 or mag[2] != 0.0):
        state[FIELD_AGE] = 0.0
    if aid[AIRSPEED] == aid[AIRSPEED]:
        state[AIR] = aid[AIRSPEED]
    by_compass = uses_compass(state, params, dt)
    correct_heading(state, params, dt, acc, mag, fix, by_compass, gain * fast, spin)
    correct_tilt(state, params, dt, acc, aid, fix, by_compass, gain * fast, spin)
    turn(
        state,
        gyr[0] - state[4] + state[P],
        gyr[1] - state[5] + state[P + 1],
        gyr[2] - state[6] + state[P + 2] + state[YAW],
        dt,
        0.0,
    )


def has_gnss(state: Any) -> bool:
    """Whether fixes still come: the last is not older than three of their intervals, nor than 4 s."""
    return bool(state[FIX_AGE] <= min(FIX_LOST * max(state[EVERY], NO_GNSS_S), FIX_LOST_S))


def uses_compass(state: Any, params: Any, dt: float) -> bool:
    """Whether heading comes from the compass: there is one, and on a forward vehicle it agrees with the course."""
    if state[FIELD_AGE] > FIELD_LOST_S:
        return False
    if params[6] < 0.5 or not has_gnss(state) or state[SPEED] < LEAST_SPEED:
        return True
    n = 1.0 - 2.0 * (state[2] * state[2] + state[3] * state[3])
    e = 2.0 * (state[1] * state[2] + state[0] * state[3])
    along = n * state[COURSE_N] + e * state[COURSE_E]
    off = along < math.sqrt(0.5 * (n * n + e * e)) * state[SPEED]
    state[ODD] = state[ODD] + dt if off else 0.0
    return bool(state[ODD] <= 2.0)


def correct_heading(
    state: Any, params: Any, dt: float, acc: Any, mag: Any, fix: bool, by_compass: bool, gain: float, spin: float
) -> None:
    """Y and its part of the bias, from the compass or the GNSS course."""
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    n = 1.0 - 2.0 * (q2 * q2 + q3 * q3)
    e = 2.0 * (q1 * q2 + q0 * q3)
    upright = 1.0 - 2.0 * (q1 * q1 + q2 * q2)
    error = 0.0
    new = False
    since = dt
    weight = 1.0
    if by_compass:
        hx = n * mag[0] + 2.0 * (q1 * q2 - q0 * q3) * mag[1] + 2.0 * (q1 * q3 + q0 * q2) * mag[2]
        hy = e * mag[0] + (1.0 - 2.0 * (q1 * q1 + q3 * q3)) * mag[1] + 2.0 * (q2 * q3 - q0 * q1) * mag[2]
        level = math.sqrt(hx * hx + hy * hy)
        if level > 0.0:
            error = -hy / level
            new = True
            weight = state[C_Z]
            state[HAS_YAW] = 1.0
            state[YAW_AGE] = 0.0
    elif params[6] > 0.5 and fix and state[SPEED] >= LEAST_SPEED:
        off = math.atan2(n * state[COURSE_E] - e * state[COURSE_N], n * state[COURSE_N] + e * state[COURSE_E])
        error = math.sin(off)
        new = True
        since = state[YAW_AGE]
        if state[HAS_YAW] < 0.5 or since > 20.0 or (state[SPEED] >= 3.0 * LEAST_SPEED and abs(off) >= 1.047):
            c = math.cos(0.5 * off)
            s = math.sin(0.5 * off)
            state[0] = c * q0 - s * q3
            state[1] = c * q1 - s * q2
            state[2] = c * q2 + s * q1
            state[3] = c * q3 + s * q0
            state[YAW] = 0.0
            error = 0.0
        state[HAS_YAW] = 1.0
        state[YAW_AGE] = 0.0
    if not new:
        state[YAW] *= math.exp(-state[DECAY] * dt)
        return
    ax = n * acc[0] + 2.0 * (q1 * q2 - q0 * q3) * acc[1] + 2.0 * (q1 * q3 + q0 * q2) * acc[2]
    ay = e * acc[0] + (1.0 - 2.0 * (q1 * q1 + q3 * q3)) * acc[1] + 2.0 * (q2 * q3 - q0 * q1) * acc[2]
    moved = math.sqrt(ax * ax + ay * ay)
    share = 0.2 * (4.5 - moved) if moved <= 4.0 else 0.1
    state[YAW] = upright * error * gain * params[1] * share * weight
    if since < 2.0 and spin < SPIN_I:
        state[I_SUM + 2] += upright * error * KI_YAW * since


def mean_force(state: Any, scale: float, by_velocity: bool) -> tuple[float, float, float]:
    """The summed specific force (3,) in earth axes, in g; that of the interval before where velocities are compared."""
    fx = scale * state[SUM]
    fy = scale * state[SUM + 1]
    fz = scale * state[SUM + 2]
    if by_velocity:
        ux = state[BEFORE]
        uy = state[BEFORE + 1]
        uz = state[BEFORE + 2]
        state[BEFORE] = fx
        state[BEFORE + 1] = fy
        state[BEFORE + 2] = fz
        if ux != 0.0 or uy != 0.0 or uz != 0.0:
            return ux, uy, uz
    return fx, fy, fz


def learn_bias(state: Any, bx: float, by: float, bz: float, spin: float) -> None:
    """The bias from the tilt's error (3,), body axes, summed while the turn (``spin`` rad/s) is slow, then limited."""
    if spin < SPIN_I:
        state[I_SUM] += bx * KI * state[SUM_TIME]
        state[I_SUM + 1] += by * KI * state[SUM_TIME]
        state[I_SUM + 2] += bz * KI * state[SUM_TIME]
        state[I_TIME] += state[SUM_TIME]
    if state[I_TIME] >= I_AFTER_S:
        limit = DRIFT_LIMIT * state[I_TIME]
        for i in range(3):
            state[4 + i] -= min(max(state[I_SUM + i], -limit), limit)
            state[I_SUM + i] = 0.0
        state[I_TIME] = 0.0


def correct_tilt(
    state: Any, params: Any, dt: float, acc: Any, aid: Any, fix: bool, by_compass: bool, gain: float, spin: float
) -> None:
    """P and the bias, when a fix arrives or, without GNSS, every 0.2 s."""
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    r00 = 1.0 - 2.0 * (q2 * q2 + q3 * q3)
    r01 = 2.0 * (q1 * q2 - q0 * q3)
    r02 = 2.0 * (q1 * q3 + q0 * q2)
    r10 = 2.0 * (q1 * q2 + q0 * q3)
    r11 = 1.0 - 2.0 * (q1 * q1 + q3 * q3)
    r12 = 2.0 * (q2 * q3 - q0 * q1)
    r20 = 2.0 * (q1 * q3 - q0 * q2)
    r21 = 2.0 * (q2 * q3 + q0 * q1)
    r22 = 1.0 - 2.0 * (q1 * q1 + q2 * q2)
    if dt > DISCARD_S:
        state[SUM] = state[SUM + 1] = state[SUM + 2] = state[SUM_TIME] = 0.0
        return
    if acc[0] != 0.0 or acc[1] != 0.0 or acc[2] != 0.0:
        state[SUM] += dt * (r00 * acc[0] + r01 * acc[1] + r02 * acc[2])
        state[SUM + 1] += dt * (r10 * acc[0] + r11 * acc[1] + r12 * acc[2])
        state[SUM + 2] += dt * (r20 * acc[0] + r21 * acc[1] + r22 * acc[2])
        state[SUM_TIME] += dt
    forward = params[6] > 0.5
    have_gnss = has_gnss(state)
    if (have_gnss and not fix) or (not have_gnss and state[SUM_TIME] < NO_GNSS_S) or state[SUM_TIME] <= 0.0:
        return
    vx = aid[VEL_N] if fix else r00 * state[AIR]
    vy = aid[VEL_E] if fix else r10 * state[AIR]
    vz = (aid[VEL_D] if aid[VEL_D] == aid[VEL_D] else state[VELOCITY + 2]) if fix else r20 * state[AIR]
    if fix:
        state[AIR] = max(r00 * vx + r10 * vy + r20 * vz, 0.0)
    lock = 1.0 if fix else -1.0
    scale = 1.0 / (state[SUM_TIME] * GRAVITY)
    tx = ty = 0.0
    tz = -1.0
    by_velocity = (fix or forward) and (forward or aid[AT_REST] != 1.0)
    if by_velocity and state[LOCK] == lock:
        tx += params[2] * scale * (vx - state[VELOCITY])
        ty += params[2] * scale * (vy - state[VELOCITY + 1])
        tz += params[2] * scale * (vz - state[VELOCITY + 2])
    state[LOCK] = lock
    state[VELOCITY] = vx
    state[VELOCITY + 1] = vy
    state[VELOCITY + 2] = vz
    fx, fy, fz = mean_force(state, scale, by_velocity)
    length = math.sqrt((fx * fx + fy * fy + fz * fz) * (tx * tx + ty * ty + tz * tz))
    inv = 1.0 / length if length > 0.0 else 0.0
    ex = inv * (fy * tz - fz * ty)
    ey = inv * (fz * tx - fx * tz)
    ez = inv * (fx * ty - fy * tx)
    if by_compass:
        banked = math.sqrt(r21 * r21 + r22 * r22)
        ez = ez * abs(r21) / banked if have_gnss and params[2] == 1.0 and banked > 0.0 else 0.0
    bx = r00 * ex + r10 * ey + r20 * ez
    by = r01 * ex + r11 * ey + r21 * ez
    bz = r02 * ex + r12 * ey + r22 * ez
    k = gain * params[0]
    if forward and have_gnss and state[SPEED] < LEAST_SPEED and acc[0] >= LAUNCH and abs(r20) < 0.5:
        k = 0.5 * k
    state[P] = k * bx
    state[P + 1] = k * by
    state[P + 2] = k * bz
    learn_bias(state, bx, by, bz, spin)
    state[SUM] = state[SUM + 1] = state[SUM + 2] = state[SUM_TIME] = 0.0
