"""PX4's EKF2: parameters, control state, process noise, limits and the start from gravity.

The state itself and its update are those of :mod:`attlog.estimators.error_state`.
Facts: PX4-Autopilot ``src/modules/ekf2/EKF`` (before 1.13 PX4-ECL ``EKF``).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from attlog.core.jit import Out1
from attlog.estimators.error_state import BA, BG, MB, MI, N_ERR, N_STATE, POS, TH, VEL, WIND, Filter, G

# Eras of the firmware: up to 1.11, up to 1.13, 1.14, from 1.15 on.
ERA_A, ERA_B, ERA_C, ERA_D = 0, 1, 2, 3


class Parameters(NamedTuple):
    """EKF2's parameters by their names, in the firmware's units; angles in rad."""

    gyr_noise: float
    acc_noise: float
    gyr_b_noise: float
    acc_b_noise: float
    gyr_b_lim: float
    abl_lim: float
    abl_acclim: float
    abl_gyrlim: float
    abl_tau: float
    mag_noise: float
    head_noise: float
    mag_e_noise: float
    mag_b_noise: float
    mag_type: float
    mag_acclim: float
    mag_yawlim: float
    mag_gate: float
    hdg_gate: float
    mag_check: float
    mag_chk_str: float
    gps_v_noise: float
    gps_p_noise: float
    gps_v_gate: float
    gps_p_gate: float
    noaid_noise: float
    baro_noise: float
    baro_gate: float
    gnd_eff_dz: float
    req_eph: float
    req_epv: float
    req_sacc: float
    req_nsats: float
    req_gps_h: float
    grav_noise: float
    arsp_thr: float
    eas_noise: float
    tas_gate: float
    fuse_beta: float
    beta_noise: float
    beta_gate: float
    wind_nsd: float
    gbias_init: float
    abias_init: float
    angerr_init: float
    imu_ctrl: float
    gps_ctrl: float
    baro_ctrl: float
    hgt_ref: float
    decl_type: float
    mag_decl: float
    gps_pos_x: float
    gps_pos_y: float
    gps_pos_z: float


class Known(NamedTuple):
    """Facts of the flight and the firmware that a step needs."""

    era: float  # of the firmware
    reset_in_climb: float  # 0 none, 1 by the field, 2 by the bank of yaw hypotheses where it is sure
    latitude: float  # rad
    declination: float  # rad
    inclination: float  # rad
    strength: float  # of the model in gauss, 0 unknown
    step_s: float
    length: float  # of the output ring, steps
    plane: float
    n_gnss: float  # logged over onboard rate
    n_baro: float  # logged over onboard rate
    flown_alignment: float  # 1: the log dates the alignment in flight, else 1.5 m above the take-off height
    flown_emergency: float  # 1: the log dates emergency resets of the heading, else by the rule
    brief_checks: float  # 1: once passed, GNSS is checked by wide limits (from 1.17)
    imu_period: float  # s


# Control state of the filter, by position in ``c``. Times are s since boot; -1e9 is never.
(
    TILT, YAW, GNSS_ON, MAG_MODE, ALIGNED, T_VEL, T_POS, T_GNSS, T_MAG, T_HEADING, T_FALSE, FIELD_N, FIELD_X, FIELD_Y,
    FIELD_Z, GOOD_SINCE, GROUND, T_ALIGNED, ACC_ENV, GYRO_ENV, ACC_N, ACC_E, YAW_RATE, T_OBSERVABLE, MAG_SINCE,
    T_BAD_ACC, BARO_OFF, BARO_VAR, BARO_COUNT, GH_OFF, GH_VAR, GH_COUNT, FALSE_N, FALSE_E, CONSISTENT, HEAD_DIFF,
    MAG_FAULT, REST_N, REST_X, REST_Y, REST_Z, GNSS_CHECKED, FORCE_X, FORCE_Y, FORCE_Z, FORCE_N, ACC_MOVES, BAD_VEL,
    BAD_HGT, T_HEIGHT, WIND_ON, FIELD_SAVED, GRAV_ENV, T_ZERO, T_LANDED, N_CONTROL,
) = range(56)  # fmt: skip

# Magnetometer modes.
MAG_OFF, MAG_HEADING, MAG_3D, MAG_FIELD_ONLY = 0, 1, 2, 3


def process_noise(f: Filter, par: Parameters, known: Known, dt: float, clip: int, t: float) -> None:
    """Fill the variances that one step adds (``covariance.cpp``)."""
    P, c, noise = f.P, f.c, f.noise
    era = known.era
    bad = t - c[T_BAD_ACC] < 10.0
    for i in range(3):
        noise[TH + i] = (par.gyr_noise * dt) ** 2
        sigma = 4.9 if bad or (clip >> i) & 1 else par.acc_noise
        noise[VEL + i] = (sigma * dt) ** 2
        noise[POS + i] = 0.0
        noise[BG + i] = (par.gyr_b_noise * dt) ** 2
        noise[BA + i] = (par.acc_b_noise * dt) ** 2
        if era == ERA_D:
            if P[BG + i, BG + i] >= par.gyr_noise**2:
                noise[BG + i] = 0.0
            if P[BA + i, BA + i] >= par.acc_noise**2:
                noise[BA + i] = 0.0
        noise[MI + i] = (par.mag_e_noise * dt) ** 2
        noise[MB + i] = (par.mag_b_noise * dt) ** 2
        if era == ERA_D:
            if P[MI + i, MI + i] >= par.mag_noise**2:
                noise[MI + i] = 0.0
            if P[MB + i, MB + i] >= par.mag_noise**2:
                noise[MB + i] = 0.0
        elif c[MAG_MODE] != MAG_3D:
            noise[MI + i] = 0.0
            noise[MB + i] = 0.0
    if era != ERA_D and c[MAG_MODE] == MAG_3D:
        earth = P[MI, MI] + P[MI + 1, MI + 1] + P[MI + 2, MI + 2]
        body = P[MB, MB] + P[MB + 1, MB + 1] + P[MB + 2, MB + 2]
        for i in range(3):
            if earth >= 0.1:
                noise[MI + i] = 0.0
            if body >= 0.1:
                noise[MB + i] = 0.0
    wind = par.wind_nsd**2 * dt if c[WIND_ON] > 0.0 else 0.0
    noise[WIND] = wind
    noise[WIND + 1] = wind


def limit_states(f: Filter, par: Parameters, known: Known) -> None:
    """Clip biases and variances as the firmware does."""
    x, P = f.x, f.P
    for i in range(3):
        x[10 + i] = min(max(x[10 + i], -par.gyr_b_lim), par.gyr_b_lim)
        x[13 + i] = min(max(x[13 + i], -par.abl_lim), par.abl_lim)
        x[19 + i] = min(max(x[19 + i], -0.5), 0.5)
        P[VEL + i, VEL + i] = min(max(P[VEL + i, VEL + i], 1e-6), 1e6)
        P[POS + i, POS + i] = min(max(P[POS + i, POS + i], 1e-6), 1e6)
        if known.era != ERA_D:
            P[BA + i, BA + i] = max(P[BA + i, BA + i], 5e-8 / known.step_s**2)


def low_pass(c: Out1, first: int, count: int, v: Out1) -> None:
    """Low-pass a vector in ``c`` from ``first`` on by a tenth of each sample; ``count`` are the samples so far."""
    share = 0.1 if c[count] > 0.0 else 1.0
    for i in range(3):
        c[first + i] += share * (v[i] - c[first + i])
    c[count] += 1.0


def gravity_start(f: Filter) -> bool:
    """Low-pass the specific force until the vehicle holds still enough for a first tilt; True once it does."""
    c, force, rate = f.c, f.force, f.rate
    low_pass(c, FORCE_X, FORCE_N, force)
    size = math.sqrt(c[FORCE_X] ** 2 + c[FORCE_Y] ** 2 + c[FORCE_Z] ** 2)
    spin = math.sqrt(rate[0] ** 2 + rate[1] ** 2 + rate[2] ** 2)
    return 0.8 * G < size < 1.2 * G and spin < math.radians(15.0)


def cold_start(f: Filter, par: Parameters, known: Known) -> None:
    """Set tilt from the low-passed force, all else to zero, and the start variances."""
    x, P, c = f.x, f.P, f.c
    roll = math.atan2(-c[FORCE_Y], -c[FORCE_Z])
    pitch = math.atan2(c[FORCE_X], math.sqrt(c[FORCE_Y] ** 2 + c[FORCE_Z] ** 2))
    for i in range(N_STATE):
        x[i] = 0.0
    cr, sr, cp, sp = math.cos(roll / 2), math.sin(roll / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    x[0], x[1], x[2], x[3] = cr * cp, sr * cp, cr * sp, -sr * sp
    for i in range(N_ERR):
        for j in range(N_ERR):
            P[i, j] = 0.0
    tilt = par.angerr_init**2
    P[TH, TH], P[TH + 1, TH + 1] = tilt, tilt
    P[TH + 2, TH + 2] = 0.01**2 if known.era >= ERA_C else tilt
    v = max(par.gps_v_noise, 0.01) ** 2
    p = max(par.gps_p_noise, 0.01) ** 2
    for i in range(2):
        P[VEL + i, VEL + i] = v
        P[POS + i, POS + i] = p
    P[VEL + 2, VEL + 2] = 2.25 * v
    P[POS + 2, POS + 2] = max(par.baro_noise, 0.01) ** 2
    for i in range(3):
        P[BG + i, BG + i] = par.gbias_init**2
        P[BA + i, BA + i] = par.abias_init**2
