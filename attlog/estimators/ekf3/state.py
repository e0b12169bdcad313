"""ArduPilot's EKF3: parameters, control state, process noise, limits and resets.

The state itself and its update are those of :mod:`attlog.estimators.error_state`. EKF3 keeps the covariance of the
quaternion; rotations about earth axes are the same filter to first order. A block of states that is off has no rows.
Facts: ArduPilot ``libraries/AP_NavEKF3`` (3.6 to 4.8).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from attlog.core.jit import Out1, Out2
from attlog.estimators.error_state import (
    BA,
    BG,
    MB,
    MI,
    N_ERR,
    POS,
    TH,
    VEL,
    WIND,
    Filter,
    field_heading,
    forget_rows,
    rotation,
    turn_heading,
)


class Parameters(NamedTuple):
    """EKF3's parameters by their names, in the firmware's units."""

    velne_m_nse: float
    veld_m_nse: float
    posne_m_nse: float
    alt_m_nse: float
    mag_m_nse: float
    yaw_m_nse: float
    eas_m_nse: float
    gyro_p_nse: float
    acc_p_nse: float
    gbias_p_nse: float
    abias_p_nse: float
    mage_p_nse: float
    magb_p_nse: float
    wind_p_nse: float
    wind_pscale: float
    vel_i_gate: float
    pos_i_gate: float
    hgt_i_gate: float
    mag_i_gate: float
    yaw_i_gate: float
    eas_i_gate: float
    noaid_m_nse: float
    gps_check: float
    check_scale: float
    glitch_rad: float
    acc_bias_lim: float
    mag_ef_lim: float
    mag_cal: float
    beta_mask: float
    gnd_eff_dz: float
    src1_posxy: float
    src1_velxy: float
    src1_velz: float
    src1_posz: float
    src1_yaw: float


class Known(NamedTuple):
    """Facts of the flight and the firmware that a step needs."""

    version: float  # of the firmware: 4.1, 4.6
    latitude: float  # rad
    declination: float  # rad, once there was a fix
    stored_declination: float  # rad, before
    t_fix: float  # s, first fix
    table_n: float  # gauss: earth field of the firmware's table
    table_e: float
    table_d: float
    has_table: float  # 1 where the firmware uses its table
    step_s: float
    length: float  # of the output ring, steps
    spread_2: float  # mean square of steps over that of the mean step
    spread_4: float  # mean fourth power alike
    plane: float
    airspeed: float  # 1 where airspeed is used
    compass: float  # 1 where the core has a compass in use
    compasses: float  # that may be used
    unit: float  # number of the compass at first
    t_start: float  # s, begin of the filter
    flown: float  # 1: resets and GNSS use as logged; 0: by the filter's own rules
    t_origin: float  # s, origin set as logged; inf by the filter's own rules
    n_baro: float  # barometer samples on board for each logged one
    arm_x: float  # m from the IMU to the GNSS antenna, body axes
    arm_y: float
    arm_z: float


# Control state of the filter, by position in ``c``. Times are s since boot; -1e9 is never.
CONTROL = (
    "tilt", "yaw", "gnss_on", "on_ground", "in_flight", "ground", "bias_on", "mag_learn", "field_learned", "field_set",
    "final_yaw", "final_mag", "reset_yaw", "reset_field", "anomalies", "down_at_reset", "yaw_at_reset",
    "yaw_innovation", "mag_healthy", "t_mag", "wind_on", "t_synthetic", "t_velocity", "t_position", "t_height",
    "t_airspeed", "t_bad_imu", "bad_imu", "acc_n", "acc_e", "acc_d", "sacc", "hacc", "vacc", "t_gnss", "noise_scale",
    "origin",
    "held_n", "held_e", "height_rate", "vd_clips", "t_good", "declination_due", "gnss_vn", "gnss_ve", "gnss_vd",
    "gnss_n", "gnss_e", "height", "take_off_height", "t_sideslip", "armed_before", "static_yaw", "heading_kind",
    "mag_passed", "good_gnss", "t_bad_ratio", "ground_effect", "mag_ratio", "t_passed", "drift", "vd_low_pass",
    "speed_low_pass", "compass",
)  # fmt: skip
(
    TILT, YAW, GNSS_ON, ON_GROUND, IN_FLIGHT, GROUND, BIAS_ON, MAG_LEARN, FIELD_LEARNED, FIELD_SET, FINAL_YAW,
    FINAL_MAG, RESET_YAW, RESET_FIELD, ANOMALIES, DOWN_AT_RESET, YAW_AT_RESET, YAW_INNOVATION, MAG_HEALTHY, T_MAG,
    WIND_ON, T_SYNTHETIC, T_VELOCITY, T_POSITION, T_HEIGHT, T_AIRSPEED, T_BAD_IMU, BAD_IMU, ACC_N, ACC_E, ACC_D, SACC,
    HACC, VACC, T_GNSS, NOISE_SCALE, ORIGIN, HELD_N, HELD_E, HEIGHT_RATE, VD_CLIPS, T_GOOD, DECLINATION_DUE, GNSS_VN,
    GNSS_VE, GNSS_VD, GNSS_N, GNSS_E, HEIGHT, TAKE_OFF_HEIGHT, T_SIDESLIP, ARMED_BEFORE, STATIC_YAW, HEADING_KIND,
    MAG_PASSED, GOOD_GNSS, T_BAD_RATIO, GROUND_EFFECT, MAG_RATIO, T_PASSED, DRIFT, VD_LOW_PASS, SPEED_LOW_PASS,
    COMPASS,
) = range(len(CONTROL))  # fmt: skip

# Modes of the compass, as XKFS.MAG_FUSION counts them.
MAG_NONE, MAG_YAW, MAG_3D = 0, 1, 2
# Sources of EK3_SRC1_YAW, and GNSS in the other EK3_SRC1_*.
YAW_BY_COMPASS, YAW_BY_GSF, BY_GNSS = 1.0, 8.0, 3.0
# Kinds of a heading that is fused: of the compass, of the yaw estimator, held at rest, its own prediction.
HEADING_COMPASS, HEADING_GSF, HEADING_HELD, HEADING_PREDICTED = 0.0, 1.0, 2.0, 3.0

# Sigmas at the start: attitude (variance), gyro bias, share of the accelerometer bias' limit.
START_ATTITUDE_VARIANCE = 0.01
START_GYRO_BIAS = math.radians(2.5)
ACC_BIAS_SHARE = 0.2
# A larger tilt variance is not believed.
MAX_TILT_VARIANCE = math.radians(30.0) ** 2
# Noise of the specific force while the IMU is bad, m/s^2.
BAD_IMU_NOISE = 5.0
# On the ground an accelerometer's bias learns where its axis has more than this share of gravity.
OBSERVABLE_SHARE = 0.8
# A vehicle on the ground that turns less is at rest, rad/s.
STILL_RATE = 0.1
# Body x of the air velocity from which on sideslip is fused, m/s.
MIN_SIDESLIP_SPEED = 5.0


class Work(NamedTuple):
    """Observations of one step, and what outlives the states it belongs to; filled in place."""

    due: Out1  # (14,) 1 where an observation is to be fused, by the kinds of ``error_state``
    z: Out1  # (14,) measured values
    noise: Out1  # (14,) their variances
    innovation: Out1  # (3,) of the compass axes at their linearisation
    variance: Out1  # (3,) of these innovations
    rows: Out2  # (3, 8) their derivatives
    frozen: Out1  # (3,) 1 where an accelerometer bias does not learn
    bias_variance: Out1  # (3,) its variance meanwhile
    field_variance: Out1  # (6,) variances of the field states once they were learnt
    q_reset: Out1  # (4,) attitude at the last reset of the field
    q_mag: Out1  # (4,) attitude at the last compass sample
    gnss: Out1  # (12,) GNSS sample at the IMU: position, velocity NED, sacc, hacc, vacc, fix, satellites, hdop


def tilt_variance(f: Filter) -> float:
    """Return the variance of the tilt in rad^2, at most (30 deg)^2."""
    return float(min(f.P[TH, TH] + f.P[TH + 1, TH + 1], MAX_TILT_VARIANCE))


def process_noise(f: Filter, par: Parameters, known: Known, w: Work, dt: float) -> None:
    """Fill the variances that one step adds."""
    c, noise = f.c, f.noise
    acc = BAD_IMU_NOISE if c[BAD_IMU] > 0.0 else par.acc_p_nse
    on, learn = c[BIAS_ON], c[MAG_LEARN]
    two, four = known.spread_2, known.spread_4
    wind = dt * par.wind_p_nse * (1.0 + par.wind_pscale * abs(c[HEIGHT_RATE]))
    if known.airspeed == 0.0:
        wind *= 10.0
    for i in range(3):
        noise[TH + i] = two * (par.gyro_p_nse * dt) ** 2
        noise[VEL + i] = two * (acc * dt) ** 2
        noise[POS + i] = 0.0
        noise[BG + i] = on * four * (par.gbias_p_nse * dt) ** 2
        noise[BA + i] = on * (1.0 - w.frozen[i]) * four * (par.abias_p_nse * dt) ** 2
        noise[MI + i] = learn * two * (par.mage_p_nse * dt) ** 2
        noise[MB + i] = learn * two * (par.magb_p_nse * dt) ** 2
    for i in range(2):
        noise[WIND + i] = c[WIND_ON] * two * wind**2


def limit_states(f: Filter, par: Parameters, known: Known, w: Work) -> None:
    """Clip states and variances as the firmware does."""
    x, P, c = f.x, f.P, f.c
    dt = known.step_s
    limit = 0.5
    for i in range(3):
        x[4 + i] = min(max(x[4 + i], -500.0), 500.0)
        x[10 + i] = min(max(x[10 + i], -limit), limit)
        x[13 + i] = min(max(x[13 + i], -par.acc_bias_lim), par.acc_bias_lim)
        x[19 + i] = min(max(x[19 + i], -0.5), 0.5)
    if known.has_table > 0.0 and c[ORIGIN] > 0.0 and c[MAG_LEARN] > 0.0:
        width = par.mag_ef_lim * 1e-3
        x[16] = min(max(x[16], known.table_n - width), known.table_n + width)
        x[17] = min(max(x[17], known.table_e - width), known.table_e + width)
        x[18] = min(max(x[18], known.table_d - width), known.table_d + width)
    for i in range(2):
        x[22 + i] = min(max(x[22 + i], -100.0), 100.0)
        P[VEL + i, VEL + i] = min(max(P[VEL + i, VEL + i], 1e-4), 1e3)
    if P[VEL + 2, VEL + 2] < 1e-4:
        P[VEL + 2, VEL + 2] = 1e-4
        c[VD_CLIPS] += 83.0
        if c[VD_CLIPS] > 415.0:
            forget_rows(P, VEL + 2, 1, par.veld_m_nse**2)
            c[VD_CLIPS] = 0.0
    for i in range(3):
        P[POS + i, POS + i] = min(max(P[POS + i, POS + i], 1e-4), 1e6)
        P[BG + i, BG + i] = min(P[BG + i, BG + i], 0.175**2)
        P[MI + i, MI + i] = min(P[MI + i, MI + i], 0.01)
        P[MB + i, MB + i] = min(P[MB + i, MB + i], 0.01)
    for i in range(2):
        P[WIND + i, WIND + i] = min(P[WIND + i, WIND + i], 400.0)
    if c[BIAS_ON] > 0.0:
        least = (5e-9 if known.version >= 4.5 else 1e-9) / dt**2
        largest = 0.0
        reset = False
        for i in range(3):
            if w.frozen[i] == 0.0:
                largest = max(largest, P[BA + i, BA + i])
                reset = reset or P[BA + i, BA + i] < least
            else:
                largest = max(largest, w.bias_variance[i])
        floor = max(0.01 * largest, least)
        for i in range(3):
            if w.frozen[i] == 0.0:
                P[BA + i, BA + i] = min(max(P[BA + i, BA + i], floor), 100.0)
                if reset:
                    forget_rows(P, BA + i, 1, (ACC_BIAS_SHARE * par.acc_bias_lim) ** 2)


def reset_heading(f: Filter, turn: float, variance: float) -> None:
    """Turn the filter and its outputs about the vertical; tilt keeps its variance, correlations go.

    The firmware turns the variances to body axes and drops what is off the diagonal there: a tilted vehicle becomes
    unsure of its tilt.
    """
    c, P, r = f.c, f.P, f.r
    tilt = 0.5 * tilt_variance(f)
    turn_heading(f, turn)
    rotation(f.x, r)
    forget_rows(P, TH, 3, 0.0)
    for k in range(3):
        body = (r[0, k] ** 2 + r[1, k] ** 2) * tilt + r[2, k] ** 2 * variance
        for i in range(3):
            for j in range(3):
                P[TH + i, TH + j] += r[i, k] * body * r[j, k]
    c[YAW] = 1.0
    if c[IN_FLIGHT] > 0.0:
        c[FINAL_YAW] = 1.0
    c[RESET_YAW] = 0.0


def reset_field(f: Filter, par: Parameters, known: Known, w: Work, mx: float, my: float, mz: float) -> None:
    """Reset the earth field to the table, else to the sample; the body field stays."""
    x, P, c, r = f.x, f.P, f.c, f.r
    if known.has_table > 0.0 and c[ORIGIN] > 0.0:
        x[16], x[17], x[18] = known.table_n, known.table_e, known.table_d
    else:
        for i in range(3):
            x[16 + i] = r[i, 0] * mx + r[i, 1] * my + r[i, 2] * mz
    noise = c[MAG_LEARN] * par.mag_m_nse**2
    forget_rows(P, MI, 6, noise)
    if known.has_table > 0.0 and c[ORIGIN] > 0.0:
        P[MI, MI] = 0.0
        P[MI + 1, MI + 1] = 0.0
    c[RESET_FIELD] = 0.0
    c[FIELD_SET] = 1.0
    if c[IN_FLIGHT] > 0.0:
        c[FINAL_MAG] = 1.0
    mark_reset(f, w)


def change_compass(f: Filter, par: Parameters) -> None:
    """Forget what belongs to the last compass; the earth field is reset at the next sample."""
    x, c = f.x, f.c
    x[19] = x[20] = x[21] = 0.0
    forget_rows(f.P, MB, 3, c[MAG_LEARN] * par.mag_m_nse**2)
    c[RESET_FIELD], c[FIELD_LEARNED] = 1.0, 0.0


def set_origin(f: Filter, known: Known) -> None:
    """Take the origin as set: the earth field becomes that of the table."""
    x, c = f.x, f.c
    if c[ORIGIN] == 0.0 and known.has_table > 0.0:
        x[16], x[17], x[18] = known.table_n, known.table_e, known.table_d
        c[DECLINATION_DUE] = c[MAG_LEARN]
    c[ORIGIN] = 1.0


def mark_reset(f: Filter, w: Work) -> None:
    """Remember height, attitude and yaw innovation as the state of the field on the ground."""
    f.c[DOWN_AT_RESET] = f.x[9]
    f.c[YAW_AT_RESET] = f.c[YAW_INNOVATION]
    for i in range(4):
        w.q_reset[i] = f.x[i]


def heading_from_field(f: Filter, par: Parameters, mx: float, my: float, mz: float, declination: float) -> None:
    """Reset the heading to that of one compass sample."""
    reset_heading(f, field_heading(f.r, mx, my, mz, declination), par.yaw_m_nse**2)


def set_tilt(f: Filter, fx: float, fy: float, fz: float) -> None:
    """Set the attitude to the tilt of a specific force, heading zero."""
    x = f.x
    roll = math.atan2(-fy, -fz)
    pitch = math.atan2(fx, math.sqrt(fy * fy + fz * fz))
    cr, sr, cp, sp = math.cos(roll / 2), math.sin(roll / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    x[0], x[1], x[2], x[3] = cr * cp, sr * cp, cr * sp, -sr * sp


def cold_start(f: Filter, par: Parameters) -> None:
    """Start level with the first force: no biases, variances of the firmware."""
    P = f.P
    for i in range(N_ERR):
        for j in range(N_ERR):
            P[i, j] = 0.0
    for i in range(3):
        P[TH + i, TH + i] = START_ATTITUDE_VARIANCE
        P[VEL + i, VEL + i] = (par.veld_m_nse if i == 2 else par.velne_m_nse) ** 2
        P[POS + i, POS + i] = (par.alt_m_nse if i == 2 else par.posne_m_nse) ** 2


def angle_between(a: Out1, b: Out1) -> float:
    """Return the angle in rad between two attitudes."""
    dot = abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3])
    return 2.0 * math.acos(min(dot, 1.0))
