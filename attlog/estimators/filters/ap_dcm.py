"""ArduPilot's DCM filter: specific force summed over a GNSS interval against gravity and the change of velocity.

    w       = gyro - b                                     b = -omega_I
    q'      = q (x) (0, w + P + Y e_z)/2
    a       = sum of R f dt / (T g)                        over the time T between two corrections
    r       = ((0, 0, -1) + AHRS_GPS_GAIN dv / (T g)) / |..|
    e       = R^T (a_last/|a_last| x r)                    a_last: the sum before the newest, for the receiver's lag
    P       = AHRS_RP_P k(|w|) e                           k: 1 below 50 deg/s, |w|/50 up to 500 deg/s, then 10
    Y       = AHRS_YAW_P k(|w|) s c_z R_zz e_h             e_h = -sin of the heading that the field shows
    s       = 0.2 (4.5 - |a_h|), from 4 m/s^2 on 0.1       a_h: horizontal acceleration, more of it shows heading
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

Departures. One IMU is replayed; the autopilot averages two gyros and takes the better accelerometer. ``aid`` holds
rest, not arming: rest counts as "disarmed". The compass correction decays by 3 % in each loop of the
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
from attlog.estimators.interface import LogInfo, Parameter, choice
from attlog.estimators.vectors import GRAVITY, cross, is_present, matrix, places, turn, turn_heading

SOURCE = "ArduPilot AP_AHRS_DCM (4.3 to 4.6); Premerlani2009"
NEEDS = {"gyro", "acc"}
USES = {"mag", "gnss", "airspeed", "at_rest"}
STATE = {
    "q": 4,
    "bias": 3,
    # P and Y; sum of the corrections that become bias, over which time.
    "_tilt": 3,
    "_yaw": 1,
    "_drift": 3,
    "_drift_s": 1,
    # Sum of the specific force, over which time; the sum and the velocity before; 1 where that was of GNSS, else -1.
    "_force": 3,
    "_force_s": 1,
    "_before": 3,
    "_velocity": 3,
    "_lock": 1,
    # Seconds since the last fix, the start, the last field, and of a compass that contradicts the course.
    "_fix_age": 1,
    "_age": 1,
    "_field_age": 1,
    "_odd_s": 1,
    "_speed": 1,
    "_course": 2,
    "_has_yaw": 1,
    "_yaw_age": 1,
    "_air": 1,
    # What is left of a compass correction between two readings, its decay [1/s], and the interval of the fixes.
    "_c_z": 1,
    "_decay": 1,
    "_interval": 1,
}

# Gains of the integral [1/s] for tilt and heading, how often it is applied [s], largest drift [rad/s^2].
KI, KI_YAW, I_AFTER_S, DRIFT_LIMIT = 0.0087, 0.01, 5.0, math.radians(0.5 / 60.0)
# Rates above which nothing is learnt, and above which gains grow.
SPIN_I, SPIN_P = math.radians(20.0), math.radians(50.0)
# Interval without GNSS; intervals and seconds after which GNSS, seconds after which the field is lost; longest step.
NO_GNSS_S, FIX_LOST, FIX_LOST_S, FIELD_LOST_S, DISCARD_S = 0.2, 3.0, 4.0, 2.0, 0.2
# Raised gains: factor and seconds.
FAST, FAST_S = 8.0, 20.0
# A course counts from this speed [m/s]; a launch is more than this along the nose [m/s^2].
MIN_COURSE_M_S, LAUNCH_M_S2 = 3.0, 7.0
COMPASS_HZ, DECAY_PER_LOOP, NEVER = 10.0, 0.97, 1e9

PARAMETERS = (
    Parameter("AHRS_RP_P", 0.2, "1/s", 0.05, 10, "how fast the accelerometer corrects roll and pitch", "ArduPilot"),
    Parameter("AHRS_YAW_P", 0.2, "1/s", 0.05, 10, "how fast compass or GNSS course correct the heading", "ArduPilot"),
    Parameter("AHRS_GPS_GAIN", 1.0, "1", 0, 10, "how much of the GNSS acceleration is taken out", "ArduPilot"),
    Parameter("AHRS_GPS_USE", 1.0, "", 0, 2, "0: no GNSS at all", "ArduPilot"),
    Parameter("COMPASS_USE", 1.0, "", 0, 1, "0: no heading from the compass", "ArduPilot"),
    Parameter("SCHED_LOOP_RATE", 400.0, "Hz", 20, 20000, "loop rate, at which compass corrections decay", "ArduPilot"),
    choice("forward", ("off", "on"), "a vehicle that moves where its nose points", "attlog, by vehicle"),
    Parameter(
        "fast_gains_s", FAST_S, "s", 0, 3600, "how long gains are raised at rest", "ArduPilot, 20 s from power-up"
    ),
)
K = places({p.name: 1 for p in PARAMETERS})
S = places(STATE)
# The firmware's map is within 2 deg of the world magnetic model.
MAP_DEG = 3.0
PRESETS: dict[str, dict[str, float | str]] = {}


def from_log(params: Mapping[str, float], info: LogInfo) -> dict[str, float | str]:
    """Return the autopilot's own parameters; ``fast_gains_s`` is what was left of 20 s after power-up.

    With COMPASS_AUTODEC (on by default) the firmware replaces COMPASS_DEC by its map's value at the first fix
    (``Compass::set_initial_location``). So COMPASS_DEC of a log is this place's where it is near the declination (the
    map is coarse), else another place's: then it counts only if the declination is unknown. With COMPASS_AUTODEC off it
    always counts, 0 too.
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
    logged = math.degrees(params.get("COMPASS_DEC", math.inf))
    if abs(logged) <= 180.0 and (
        params.get("COMPASS_AUTODEC", 1.0) == 0.0
        or (logged != 0.0 and (info.declination_deg is None or abs(logged - info.declination_deg) <= MAP_DEG))
    ):
        values["declination"] = logged
    if info.forward is not None:
        values["forward"] = "on" if info.forward else "off"
    if info.since_boot_s is not None:
        values["fast_gains_s"] = max(FAST_S - max(info.since_boot_s, 0.0), 0.0)
    return values


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state: attitude, no bias yet, the decay of a compass correction between two readings."""
    state = np.zeros(sum(STATE.values()))
    state[0:4] = q0
    state[S.fix_age] = state[S.field_age] = state[S.yaw_age] = NEVER
    loops = max(params[K.SCHED_LOOP_RATE] / COMPASS_HZ, 1.0)
    state[S.c_z] = (1.0 - DECAY_PER_LOOP**loops) / ((1.0 - DECAY_PER_LOOP) * loops)
    state[S.decay] = -math.log(DECAY_PER_LOOP) * params[K.SCHED_LOOP_RATE]
    state[S.has_yaw] = 1.0 if is_present(mag) else 0.0
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any, aid: Any) -> None:
    """Take one update: heading error, sum of specific force, drift correction where due, attitude."""
    wx, wy, wz = gyr[0] - state[4], gyr[1] - state[5], gyr[2] - state[6]
    spin = math.sqrt(wx * wx + wy * wy + wz * wz)
    gain = 1.0 if spin < SPIN_P else 10.0 if spin > 10.0 * SPIN_P else spin / SPIN_P
    fast = FAST if aid[AT_REST] != 0.0 and state[S.age] < params[K.fast_gains_s] else 1.0
    fix = params[K.AHRS_GPS_USE] > 0.5 and aid[VEL_N] == aid[VEL_N] and aid[VEL_E] == aid[VEL_E]
    for i in (S.age, S.fix_age, S.field_age, S.yaw_age):
        state[i] += dt
    if fix:
        state[S.interval] = min(state[S.fix_age], FIX_LOST_S)
        state[S.fix_age] = 0.0
        state[S.speed] = math.sqrt(aid[VEL_N] * aid[VEL_N] + aid[VEL_E] * aid[VEL_E])
        state[S.course] = aid[VEL_N]
        state[S.course + 1] = aid[VEL_E]
    if params[K.COMPASS_USE] > 0.5 and is_present(mag):
        state[S.field_age] = 0.0
    if aid[AIRSPEED] == aid[AIRSPEED]:
        state[S.air] = aid[AIRSPEED]
    by_compass = uses_compass(state, params, dt)
    correct_heading(state, params, dt, acc, mag, fix, by_compass, gain * fast, spin)
    correct_tilt(state, params, dt, acc, aid, fix, by_compass, gain * fast, spin)
    turn(
        state,
        gyr[0] - state[4] + state[S.tilt],
        gyr[1] - state[5] + state[S.tilt + 1],
        gyr[2] - state[6] + state[S.tilt + 2] + state[S.yaw],
        dt,
        0.0,
    )


def has_gnss(state: Any) -> bool:
    """Return whether the last fix is not older than three of their intervals, nor than 4 s."""
    return bool(state[S.fix_age] <= min(FIX_LOST * max(state[S.interval], NO_GNSS_S), FIX_LOST_S))


def uses_compass(state: Any, params: Any, dt: float) -> bool:
    """Return whether the compass gives the heading; on a forward vehicle it has to agree with the course."""
    if state[S.field_age] > FIELD_LOST_S:
        return False
    if params[K.forward] < 0.5 or not has_gnss(state) or state[S.speed] < MIN_COURSE_M_S:
        return True
    n = 1.0 - 2.0 * (state[2] * state[2] + state[3] * state[3])
    e = 2.0 * (state[1] * state[2] + state[0] * state[3])
    along = n * state[S.course] + e * state[S.course + 1]
    off = along < math.sqrt(0.5 * (n * n + e * e)) * state[S.speed]
    state[S.odd_s] = state[S.odd_s] + dt if off else 0.0
    return bool(state[S.odd_s] <= 2.0)


def correct_heading(
    state: Any, params: Any, dt: float, acc: Any, mag: Any, fix: bool, by_compass: bool, gain: float, spin: float
) -> None:
    """Correct Y and its part of the bias by the compass or the GNSS course."""
    n, r01, r02, e, r11, r12, _, _, upright = matrix(state, 0)
    error = 0.0
    new = False
    since = dt
    weight = 1.0
    if by_compass:
        hx = n * mag[0] + r01 * mag[1] + r02 * mag[2]
        hy = e * mag[0] + r11 * mag[1] + r12 * mag[2]
        level = math.sqrt(hx * hx + hy * hy)
        if level > 0.0:
            error = -hy / level
            new = True
            weight = state[S.c_z]
            state[S.has_yaw] = 1.0
            state[S.yaw_age] = 0.0
    elif params[K.forward] > 0.5 and fix and state[S.speed] >= MIN_COURSE_M_S:
        off = math.atan2(n * state[S.course + 1] - e * state[S.course], n * state[S.course] + e * state[S.course + 1])
        error = math.sin(off)
        new = True
        since = state[S.yaw_age]
        if state[S.has_yaw] < 0.5 or since > 20.0 or (state[S.speed] >= 3.0 * MIN_COURSE_M_S and abs(off) >= 1.047):
            turn_heading(state, math.cos(0.5 * off), math.sin(0.5 * off))
            state[S.yaw] = 0.0
            error = 0.0
        state[S.has_yaw] = 1.0
        state[S.yaw_age] = 0.0
    if not new:
        state[S.yaw] *= math.exp(-state[S.decay] * dt)
        return
    ax = n * acc[0] + r01 * acc[1] + r02 * acc[2]
    ay = e * acc[0] + r11 * acc[1] + r12 * acc[2]
    moved = math.sqrt(ax * ax + ay * ay)
    share = 0.2 * (4.5 - moved) if moved <= 4.0 else 0.1
    state[S.yaw] = upright * error * gain * params[K.AHRS_YAW_P] * share * weight
    if since < 2.0 and spin < SPIN_I:
        state[S.drift + 2] += upright * error * KI_YAW * since


def mean_force(state: Any, scale: float, by_velocity: bool) -> tuple[float, float, float]:
    """Return the summed specific force (3,) in earth axes, in g; with velocities that of the interval before."""
    fx, fy, fz = scale * state[S.force], scale * state[S.force + 1], scale * state[S.force + 2]
    if by_velocity:
        ux, uy, uz = state[S.before], state[S.before + 1], state[S.before + 2]
        state[S.before], state[S.before + 1], state[S.before + 2] = fx, fy, fz
        if ux != 0.0 or uy != 0.0 or uz != 0.0:
            return ux, uy, uz
    return fx, fy, fz


def learn_bias(state: Any, bx: float, by: float, bz: float, spin: float) -> None:
    """Sum the tilt's error (3,), body axes, to the bias while the turn (``spin`` rad/s) is slow; limit the bias."""
    if spin < SPIN_I:
        state[S.drift] += bx * KI * state[S.force_s]
        state[S.drift + 1] += by * KI * state[S.force_s]
        state[S.drift + 2] += bz * KI * state[S.force_s]
        state[S.drift_s] += state[S.force_s]
    if state[S.drift_s] >= I_AFTER_S:
        limit = DRIFT_LIMIT * state[S.drift_s]
        for i in range(3):
            state[4 + i] -= min(max(state[S.drift + i], -limit), limit)
            state[S.drift + i] = 0.0
        state[S.drift_s] = 0.0


def correct_tilt(
    state: Any, params: Any, dt: float, acc: Any, aid: Any, fix: bool, by_compass: bool, gain: float, spin: float
) -> None:
    """Correct P and the bias when a fix arrives or, without GNSS, every 0.2 s."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = matrix(state, 0)
    if dt > DISCARD_S:
        state[S.force] = state[S.force + 1] = state[S.force + 2] = state[S.force_s] = 0.0
        return
    if is_present(acc):
        state[S.force] += dt * (r00 * acc[0] + r01 * acc[1] + r02 * acc[2])
        state[S.force + 1] += dt * (r10 * acc[0] + r11 * acc[1] + r12 * acc[2])
        state[S.force + 2] += dt * (r20 * acc[0] + r21 * acc[1] + r22 * acc[2])
        state[S.force_s] += dt
    forward = params[K.forward] > 0.5
    have_gnss = has_gnss(state)
    if (have_gnss and not fix) or (not have_gnss and state[S.force_s] < NO_GNSS_S) or state[S.force_s] <= 0.0:
        return
    vx = aid[VEL_N] if fix else r00 * state[S.air]
    vy = aid[VEL_E] if fix else r10 * state[S.air]
    vz = (aid[VEL_D] if aid[VEL_D] == aid[VEL_D] else state[S.velocity + 2]) if fix else r20 * state[S.air]
    if fix:
        state[S.air] = max(r00 * vx + r10 * vy + r20 * vz, 0.0)
    lock = 1.0 if fix else -1.0
    scale = 1.0 / (state[S.force_s] * GRAVITY)
    tx = ty = 0.0
    tz = -1.0
    by_velocity = (fix or forward) and (forward or aid[AT_REST] != 1.0)
    if by_velocity and state[S.lock] == lock:
        tx += params[K.AHRS_GPS_GAIN] * scale * (vx - state[S.velocity])
        ty += params[K.AHRS_GPS_GAIN] * scale * (vy - state[S.velocity + 1])
        tz += params[K.AHRS_GPS_GAIN] * scale * (vz - state[S.velocity + 2])
    state[S.lock] = lock
    state[S.velocity], state[S.velocity + 1], state[S.velocity + 2] = vx, vy, vz
    fx, fy, fz = mean_force(state, scale, by_velocity)
    length = math.sqrt((fx * fx + fy * fy + fz * fz) * (tx * tx + ty * ty + tz * tz))
    inv = 1.0 / length if length > 0.0 else 0.0
    ex, ey, ez = cross(fx, fy, fz, tx, ty, tz)
    ex, ey, ez = inv * ex, inv * ey, inv * ez
    if by_compass:
        banked = math.sqrt(r21 * r21 + r22 * r22)
        ez = ez * abs(r21) / banked if have_gnss and params[K.AHRS_GPS_GAIN] == 1.0 and banked > 0.0 else 0.0
    bx = r00 * ex + r10 * ey + r20 * ez
    by = r01 * ex + r11 * ey + r21 * ez
    bz = r02 * ex + r12 * ey + r22 * ez
    k = gain * params[K.AHRS_RP_P]
    if forward and have_gnss and state[S.speed] < MIN_COURSE_M_S and acc[0] >= LAUNCH_M_S2 and abs(r20) < 0.5:
        k = 0.5 * k
    state[S.tilt], state[S.tilt + 1], state[S.tilt + 2] = k * bx, k * by, k * bz
    learn_bias(state, bx, by, bz, spin)
    state[S.force] = state[S.force + 1] = state[S.force + 2] = state[S.force_s] = 0.0
