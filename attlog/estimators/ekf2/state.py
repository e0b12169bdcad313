"""PX4's EKF2: its state, the prediction and the scalar update.

State ``x`` (24,): q (body FRD to earth NED, scalar first), velocity, position (NED, m), gyro bias (rad/s),
accelerometer bias (m/s^2), earth field, body field (gauss), wind (north, east). Error state (23,): rotation about earth
axes, then the others in the same order; q_true = exp(theta) * q. Innovation is prediction minus measurement.
Facts: PX4-Autopilot ``src/modules/ekf2/EKF`` (before 1.13 PX4-ECL ``EKF``).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from attlog.core.jit import IOut1, Out1, Out2

# Error-state positions; the state's are one further from velocity on.
TH, VEL, POS, BG, BA, MI, MB, WIND = 0, 3, 6, 9, 12, 15, 18, 21
N_ERR, N_STATE = 23, 24
G = 9.80665
EARTH_RATE = 7.2921159e-5

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
    flown_alignment: float  # 1 where the log dates the alignment in flight
    imu_period: float  # s


# Control state of the filter, by position in ``c``. Times are s since boot; -1e9 is never.
CONTROL = (
    "tilt_aligned", "yaw_aligned", "gnss_on", "mag_mode", "aligned_in_flight", "t_velocity", "t_position",
    "t_gnss_sample", "t_mag_fused", "t_heading", "t_false_position", "t_rest", "field_n", "field_x", "field_y",
    "field_z", "gnss_good_since", "ground_height", "t_alignment", "acc_envelope", "gyro_envelope", "acc_north",
    "acc_east", "yaw_rate", "t_observable", "mag_good_since", "t_bad_acc", "baro_offset", "baro_var", "baro_n",
    "gnss_height_offset", "gnss_height_var", "gnss_height_n", "false_north", "false_east", "mag_consistent",
    "heading_difference", "mag_fault", "rest_n", "rest_x", "rest_y", "rest_z", "gnss_seen", "force_x", "force_y",
    "force_z", "force_n", "inhibit_bias", "acc_moves", "bad_velocity", "bad_height", "t_height", "wind_on",
    "t_airspeed", "field_saved", "t_vel_refused", "gravity_envelope", "yaw_turn", "t_gnss_start", "t_zero",
)  # fmt: skip
(
    TILT, YAW, GNSS_ON, MAG_MODE, ALIGNED, T_VEL, T_POS, T_GNSS, T_MAG, T_HEADING, T_FALSE, T_REST, FIELD_N, FIELD_X,
    FIELD_Y, FIELD_Z, GOOD_SINCE, GROUND, T_ALIGNED, ACC_ENV, GYRO_ENV, ACC_N, ACC_E, YAW_RATE, T_OBSERVABLE,
    MAG_SINCE, T_BAD_ACC, BARO_OFF, BARO_VAR, BARO_COUNT, GH_OFF, GH_VAR, GH_COUNT, FALSE_N, FALSE_E, CONSISTENT,
    HEAD_DIFF, MAG_FAULT, REST_N, REST_X, REST_Y, REST_Z, GNSS_SEEN, FORCE_X, FORCE_Y, FORCE_Z, FORCE_N, INHIBIT,
    ACC_MOVES, BAD_VEL, BAD_HGT, T_HEIGHT, WIND_ON, T_TAS, FIELD_SAVED, T_VEL_REFUSED, GRAV_ENV, YAW_TURN,
    T_START_GNSS, T_ZERO,
) = range(len(CONTROL))  # fmt: skip
NEVER = -1e9

# Magnetometer modes.
MAG_OFF, MAG_HEADING, MAG_3D, MAG_FIELD_ONLY = 0, 1, 2, 3

# Kinds of observations in the log of innovations, in the order of :data:`attlog.estimators.rerun.AIDS`.
(
    OBS_MAG_X, OBS_MAG_Y, OBS_MAG_Z, OBS_HEADING, OBS_VEL_N, OBS_VEL_E, OBS_VEL_D, OBS_POS_N, OBS_POS_E,
    OBS_GNSS_HEIGHT, OBS_BARO, OBS_AIRSPEED, OBS_SIDESLIP, OBS_DECLINATION,
) = range(14)  # fmt: skip


class Filter(NamedTuple):
    """State, covariance, control state, parameters and the arrays that one step works with; filled in place."""

    x: Out1  # (24,)
    P: Out2  # (23, 23)
    c: Out1  # control state, by CONTROL
    r: Out2  # (3, 3) body to earth of x
    r_new: Out2  # (3, 3) the same within a sequence of updates
    rate: Out1  # (3,) rad/s of the delayed step, bias removed
    force: Out1  # (3,) m/s^2 of the delayed step
    noise: Out1  # (23,) variances that one step adds
    mask: Out1  # (23,) 1 where a state may move, 0 where not
    full: Out1  # (23,) the same for one field sample
    h_index: IOut1  # (8,) states that an observation sees
    h_value: Out1  # (8,) and its derivatives by them
    ph: Out1  # (23,) P H'
    gain: Out1  # (23,)
    saved: Out1  # (6,) variances of the field states while they are not estimated
    ring: Out2  # (length, 4) output attitudes of the last steps
    output: Out1  # (4,) output attitude now
    correction: Out1  # (3,) rotation that each IMU sample adds to it
    log: Out2  # (m, 5) kind, time, innovation, variance, test ratio
    kept: IOut1  # (1,) innovations in the log


def new_filter(length: int, log_size: int) -> Filter:
    """Return a filter at identity with no covariance: it starts from gravity at rest."""
    import numpy as np

    z = np.zeros
    x = z(N_STATE)
    x[0] = 1.0
    output = z(4)
    output[0] = 1.0
    return Filter(
        x, z((N_ERR, N_ERR)), z(len(CONTROL)), z((3, 3)), z((3, 3)), z(3), z(3), z(N_ERR), np.ones(N_ERR),
        np.ones(N_ERR),
        z(8, np.int64), z(8), z(N_ERR), z(N_ERR), z(6), z((length, 4)), output, z(3), z((log_size, 5)), z(1, np.int64),
    )  # fmt: skip


def wrap(angle: float) -> float:
    """Return an angle within half a turn of zero."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def rotation(q: Out1, r: Out2) -> None:
    """Fill ``r`` (3, 3), body to earth, from the quaternion at the start of ``q``."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    r[0, 0] = 1 - 2 * (y * y + z * z)
    r[0, 1] = 2 * (x * y - w * z)
    r[0, 2] = 2 * (x * z + w * y)
    r[1, 0] = 2 * (x * y + w * z)
    r[1, 1] = 1 - 2 * (x * x + z * z)
    r[1, 2] = 2 * (y * z - w * x)
    r[2, 0] = 2 * (x * z - w * y)
    r[2, 1] = 2 * (y * z + w * x)
    r[2, 2] = 1 - 2 * (x * x + y * y)


def turn_body(q: Out1, x: float, y: float, z: float) -> None:
    """Turn ``q`` by a rotation vector in body axes: q * exp(v)."""
    a = math.sqrt(x * x + y * y + z * z)
    s = 0.5 - a * a / 48.0 if a < 1e-4 else math.sin(0.5 * a) / a
    w, x, y, z = math.cos(0.5 * a), s * x, s * y, s * z
    q0, q1, q2, q3 = q[0], q[1], q[2], q[3]
    q[0] = q0 * w - q1 * x - q2 * y - q3 * z
    q[1] = q0 * x + q1 * w + q2 * z - q3 * y
    q[2] = q0 * y - q1 * z + q2 * w + q3 * x
    q[3] = q0 * z + q1 * y - q2 * x + q3 * w
    n = 1.0 / math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for i in range(4):
        q[i] *= n


def turn_earth(q: Out1, x: float, y: float, z: float) -> None:
    """Turn ``q`` by a rotation vector in earth axes: exp(v) * q."""
    a = math.sqrt(x * x + y * y + z * z)
    s = 0.5 - a * a / 48.0 if a < 1e-4 else math.sin(0.5 * a) / a
    w, x, y, z = math.cos(0.5 * a), s * x, s * y, s * z
    q0, q1, q2, q3 = q[0], q[1], q[2], q[3]
    q[0] = w * q0 - x * q1 - y * q2 - z * q3
    q[1] = w * q1 + x * q0 + y * q3 - z * q2
    q[2] = w * q2 - x * q3 + y * q0 + z * q1
    q[3] = w * q3 + x * q2 - y * q1 + z * q0
    n = 1.0 / math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for i in range(4):
        q[i] *= n


def heading_of(q: Out1) -> float:
    """Return the Euler yaw of a quaternion in rad."""
    return math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))


def field_heading(r: Out2, mx: float, my: float, mz: float, declination: float) -> float:
    """Return the change of heading in rad that lays a body-axis field onto the declination."""
    n = r[0, 0] * mx + r[0, 1] * my + r[0, 2] * mz
    e = r[1, 0] * mx + r[1, 1] * my + r[1, 2] * mz
    return wrap(declination - math.atan2(e, n))


def predict_covariance(f: Filter, dt: float) -> None:
    """P <- F P F' + Q of one step, with the state before the prediction.

    theta' = theta - R dt dbg; v' = v - [R f dt]x theta - R dt dba; p' = p + dt v. ``force`` (3,) is the body's specific
    force less its bias; ``noise`` (23,) are the variances added to the diagonal, of velocity the body-axis ones.
    """
    P, r, noise, force = f.P, f.r, f.noise, f.force
    fx = (r[0, 0] * force[0] + r[0, 1] * force[1] + r[0, 2] * force[2]) * dt
    fy = (r[1, 0] * force[0] + r[1, 1] * force[1] + r[1, 2] * force[2]) * dt
    fz = (r[2, 0] * force[0] + r[2, 1] * force[1] + r[2, 2] * force[2]) * dt
    for side in range(2):
        for j in range(N_ERR):
            # rows in the first pass, columns in the second; the old values of what feeds a row are still there
            if side == 0:
                t0, t1, t2 = P[TH, j], P[TH + 1, j], P[TH + 2, j]
                for i in range(3):
                    P[POS + i, j] += dt * P[VEL + i, j]
                a0, a1, a2 = P[BA, j], P[BA + 1, j], P[BA + 2, j]
                P[VEL, j] += -(fy * t2 - fz * t1) - dt * (r[0, 0] * a0 + r[0, 1] * a1 + r[0, 2] * a2)
                P[VEL + 1, j] += -(fz * t0 - fx * t2) - dt * (r[1, 0] * a0 + r[1, 1] * a1 + r[1, 2] * a2)
                P[VEL + 2, j] += -(fx * t1 - fy * t0) - dt * (r[2, 0] * a0 + r[2, 1] * a1 + r[2, 2] * a2)
                b0, b1, b2 = P[BG, j], P[BG + 1, j], P[BG + 2, j]
                for i in range(3):
                    P[TH + i, j] -= dt * (r[i, 0] * b0 + r[i, 1] * b1 + r[i, 2] * b2)
            else:
                t0, t1, t2 = P[j, TH], P[j, TH + 1], P[j, TH + 2]
                for i in range(3):
                    P[j, POS + i] += dt * P[j, VEL + i]
                a0, a1, a2 = P[j, BA], P[j, BA + 1], P[j, BA + 2]
                P[j, VEL] += -(fy * t2 - fz * t1) - dt * (r[0, 0] * a0 + r[0, 1] * a1 + r[0, 2] * a2)
                P[j, VEL + 1] += -(fz * t0 - fx * t2) - dt * (r[1, 0] * a0 + r[1, 1] * a1 + r[1, 2] * a2)
                P[j, VEL + 2] += -(fx * t1 - fy * t0) - dt * (r[2, 0] * a0 + r[2, 1] * a1 + r[2, 2] * a2)
                b0, b1, b2 = P[j, BG], P[j, BG + 1], P[j, BG + 2]
                for i in range(3):
                    P[j, TH + i] -= dt * (r[i, 0] * b0 + r[i, 1] * b1 + r[i, 2] * b2)
    for i in range(N_ERR):
        if i < VEL or i >= POS:
            P[i, i] += noise[i]
    for i in range(3):
        for j in range(3):
            q = 0.0
            for k in range(3):
                q += r[i, k] * noise[VEL + k] * r[j, k]
            P[VEL + i, VEL + j] += q
    for i in range(N_ERR):
        for j in range(i):
            mean = 0.5 * (P[i, j] + P[j, i])
            P[i, j] = mean
            P[j, i] = mean


def predict_state(f: Filter, known: Known, dt: float) -> None:
    """Strapdown over one step by the bias-free rate and force; the force is in the axes of the step's end."""
    x, r, rate, force, end = f.x, f.r, f.rate, f.force, f.r_new
    wn, wd = EARTH_RATE * math.cos(known.latitude), -EARTH_RATE * math.sin(known.latitude)
    ex = r[0, 0] * wn + r[2, 0] * wd
    ey = r[0, 1] * wn + r[2, 1] * wd
    ez = r[0, 2] * wn + r[2, 2] * wd
    turn_body(x, (rate[0] - ex) * dt, (rate[1] - ey) * dt, (rate[2] - ez) * dt)
    rotation(x, end)
    for i in range(3):
        before = x[4 + i]
        a = end[i, 0] * force[0] + end[i, 1] * force[1] + end[i, 2] * force[2]
        x[4 + i] += a * dt + (G * dt if i == 2 else 0.0)
        x[7 + i] += 0.5 * dt * (before + x[4 + i])


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


def innovation_variance(f: Filter, n: int, noise: float) -> float:
    """Fill ``ph`` = P H' for a sparse H (``n`` entries) and return H P H' + noise."""
    P, ph, h_index, h_value = f.P, f.ph, f.h_index, f.h_value
    for i in range(N_ERR):
        s = 0.0
        for k in range(n):
            s += P[i, h_index[k]] * h_value[k]
        ph[i] = s
    s = noise
    for k in range(n):
        s += ph[h_index[k]] * h_value[k]
    return s


def update(f: Filter, s: float, innovation: float, mask: Out1) -> None:
    """Scalar update with masked gains: x <- x - K e, q <- exp(-K_theta e) * q, P <- P - K ph' - ph K' + s K K'."""
    x, P, ph, gain = f.x, f.P, f.ph, f.gain
    for i in range(N_ERR):
        gain[i] = mask[i] * ph[i] / s
    for i in range(N_ERR):
        for j in range(i + 1):
            p = P[i, j] - gain[i] * ph[j] - ph[i] * gain[j] + s * gain[i] * gain[j]
            P[i, j] = p
            P[j, i] = p
    for i in range(N_ERR):
        if P[i, i] < 0.0:
            for j in range(N_ERR):
                P[i, j] = 0.0
                P[j, i] = 0.0
    turn_earth(x, -gain[0] * innovation, -gain[1] * innovation, -gain[2] * innovation)
    for i in range(VEL, N_ERR):
        x[i + 1] -= gain[i] * innovation


def forget_rows(P: Out2, first: int, n: int, variance: float) -> None:
    """Clear correlations of ``n`` states from ``first`` on and set their variances."""
    for i in range(first, first + n):
        for j in range(N_ERR):
            P[i, j] = 0.0
            P[j, i] = 0.0
        P[i, i] = variance


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


def turn_heading(f: Filter, angle: float) -> None:
    """Turn the filter and all attitudes of the output ring about the vertical by ``angle`` rad."""
    x, ring = f.x, f.ring
    turn_earth(x, 0.0, 0.0, angle)
    for i in range(ring.shape[0]):
        turn_earth(ring[i], 0.0, 0.0, angle)


def record(f: Filter, kind: int, t: float, innovation: float, s: float, ratio: float) -> None:
    """Append an innovation to the log; it stays full once its end is reached."""
    log = f.log
    n = f.kept[0]
    if n < log.shape[0]:
        log[n, 0] = kind
        log[n, 1] = t
        log[n, 2] = innovation
        log[n, 3] = s
        log[n, 4] = ratio
        f.kept[0] = n + 1


def fuse_direct(f: Filter, state: int, innovation: float, noise: float) -> None:
    """Fuse a measurement of one state itself."""
    h_index, h_value, mask = f.h_index, f.h_value, f.mask
    h_index[0] = state
    h_value[0] = 1.0
    s = innovation_variance(f, 1, noise)
    update(f, s, innovation, mask)


def set_mask(mask: Out1, first: int, n: int, value: float) -> None:
    """Set ``n`` gains from ``first`` on to ``value`` (0 or 1)."""
    for i in range(first, first + n):
        mask[i] = value


def gravity_start(f: Filter) -> bool:
    """Low-pass the specific force until the vehicle holds still enough for a first tilt; True once it does."""
    c, force, rate = f.c, f.force, f.rate
    if c[FORCE_N] == 0.0:
        c[FORCE_X], c[FORCE_Y], c[FORCE_Z] = force[0], force[1], force[2]
    else:
        c[FORCE_X] += 0.1 * (force[0] - c[FORCE_X])
        c[FORCE_Y] += 0.1 * (force[1] - c[FORCE_Y])
        c[FORCE_Z] += 0.1 * (force[2] - c[FORCE_Z])
    c[FORCE_N] += 1.0
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
