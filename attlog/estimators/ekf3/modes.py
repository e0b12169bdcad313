"""Decisions of EKF3 in each step: flight, learning states, alignment, aiding, and which observations are due."""

from __future__ import annotations

import math

from attlog.core.jit import F1
from attlog.estimators.ekf3.state import (
    ACC_BIAS_SHARE,
    ACC_D,
    ACC_E,
    ACC_N,
    ANOMALIES,
    ARMED_BEFORE,
    BAD_IMU,
    BIAS_ON,
    BY_GNSS,
    DECLINATION_DUE,
    DOWN_AT_RESET,
    DRIFT,
    FIELD_LEARNED,
    FIELD_SET,
    FINAL_MAG,
    FINAL_YAW,
    GNSS_E,
    GNSS_N,
    GNSS_ON,
    GNSS_VD,
    GNSS_VE,
    GNSS_VN,
    GOOD_GNSS,
    GROUND,
    GROUND_EFFECT,
    HACC,
    HEADING_COMPASS,
    HEADING_GSF,
    HEADING_HELD,
    HEADING_KIND,
    HEADING_PREDICTED,
    HEIGHT,
    HELD_E,
    HELD_N,
    IN_FLIGHT,
    MAG_HEALTHY,
    MAG_LEARN,
    MAG_PASSED,
    MAG_RATIO,
    NOISE_SCALE,
    ON_GROUND,
    RESET_FIELD,
    RESET_YAW,
    SACC,
    SPEED_LOW_PASS,
    START_GYRO_BIAS,
    STATIC_YAW,
    STILL_RATE,
    T_AIRSPEED,
    T_BAD_IMU,
    T_BAD_RATIO,
    T_GNSS,
    T_GOOD,
    T_HEIGHT,
    T_MAG,
    T_PASSED,
    T_POSITION,
    T_SIDESLIP,
    T_SYNTHETIC,
    T_VELOCITY,
    TAKE_OFF_HEIGHT,
    TILT,
    VACC,
    VD_LOW_PASS,
    WIND_ON,
    YAW,
    YAW_AT_RESET,
    YAW_BY_COMPASS,
    YAW_BY_GSF,
    YAW_INNOVATION,
    Known,
    Parameters,
    Work,
    angle_between,
    heading_from_field,
    mark_reset,
    reset_field,
    reset_heading,
    set_origin,
    tilt_variance,
)
from attlog.estimators.error_state import (
    BA,
    BG,
    MI,
    NEVER,
    OBS_AIRSPEED,
    OBS_BARO,
    OBS_DECLINATION,
    OBS_GNSS_HEIGHT,
    OBS_HEADING,
    OBS_POS_N,
    OBS_SIDESLIP,
    OBS_VEL_N,
    POS,
    TH,
    VEL,
    WIND,
    Filter,
    forget_rows,
    heading_of,
    record,
    wrap,
)

# In-flight alignment at this height above take-off, m; ground anomalies are looked for from the second one on.
FINAL_RESET_M, ANOMALY_CLIMB_M = 2.5, 0.5
# Growth of the yaw innovation that is an anomaly of the ground, rad, and how often it may reset.
ANOMALY_YAW_RAD, MAX_ANOMALIES = 0.25, 2.0
# Largest rotation between two compass samples at which a heading may be reset, rad.
MAX_RESET_TURN_RAD = 0.1745
# Without so much field to the north a declination is not fused.
MIN_NORTH_GAUSS = 1e-3
# Time limits in s: position without and with other aids, any aid at all, height without and with velocity.
POSITION_S, POSITION_AIDED_S, AID_S, HEIGHT_S, HEIGHT_AIDED_S = 7.0, 10.0, 15.0, 5.0, 10.0
# Seconds for which a bad IMU is remembered.
BAD_IMU_S = 10.0
# Seconds of good checks before GNSS is used by the filter's own rules, without one until it is bad again; and of bad
# compass ratios until the heading is reset on the ground.
GOOD_GNSS_S, BAD_GNSS_S, BAD_RATIO_S = 10.0, 5.0, 5.0
# Seconds between headings without compass, and between sideslips.
SYNTHETIC_S, SIDESLIP_S = 0.14, 0.1
# Noise of a sideslip of zero (variance), and of the declination beside three compass axes, rad.
SIDESLIP_NOISE, DECLINATION_SIGMA, FIRST_DECLINATION_SIGMA = 0.03, 0.34, math.radians(20.0)


def detect_flight(f: Filter, par: Parameters, known: Known, w: Work, armed: bool, airborne: bool) -> None:
    """Detect ground and flight: armed, then a climb of 1.5 m, or 5 s in the air by the vehicle; planes by speed."""
    x, c = f.x, f.c
    if not armed:
        c[ON_GROUND], c[IN_FLIGHT] = 1.0, 0.0
        c[GROUND] = x[9]
        c[ANOMALIES] = 0.0
        if c[FIELD_SET] > 0.0:
            mark_reset(f, w)
    elif known.plane > 0.0:
        c[ON_GROUND] = 0.0
        fast = c[GNSS_VN] ** 2 + c[GNSS_VE] ** 2 > 100.0 and c[SACC] < 1.0
        if fast and (airborne or abs(c[HEIGHT]) > 10.0):
            c[IN_FLIGHT] = 1.0
    else:
        c[ON_GROUND] = 0.0
        if x[9] - c[GROUND] < -1.5 or airborne:
            c[IN_FLIGHT] = 1.0


def choose_states(f: Filter, par: Parameters, known: Known, w: Work, tas: float) -> None:
    """Switch wind, field and bias states on or off, and align the tilt."""
    x, P, c = f.x, f.P, f.c
    wind = (known.airspeed > 0.0 or known.plane > 0.0) and c[ON_GROUND] == 0.0 and c[GNSS_ON] > 0.0
    if wind and known.version >= 4.1:
        wind = c[WIND_ON] > 0.0 or x[4] ** 2 + x[5] ** 2 > 25.0
    if wind and c[WIND_ON] == 0.0:
        speed = math.sqrt(x[4] ** 2 + x[5] ** 2) - tas
        if c[YAW] > 0.0 and known.airspeed > 0.0 and tas > 0.0:
            heading = heading_of(x)
            x[22], x[23] = speed * math.cos(heading), speed * math.sin(heading)
            forget_rows(P, WIND, 2, max(par.eas_m_nse**2, 0.25))
        else:
            x[22], x[23] = 0.0, 0.0
            forget_rows(P, WIND, 2, 400.0)
    elif not wind and c[WIND_ON] > 0.0:
        forget_rows(P, WIND, 2, 0.0)
    c[WIND_ON] = 1.0 if wind else 0.0
    moves = c[ACC_N] ** 2 + c[ACC_E] ** 2 > 0.25
    wanted = False
    if par.mag_cal == 0.0:
        wanted = c[IN_FLIGHT] > 0.0
    elif par.mag_cal == 1.0:
        wanted = moves
    elif par.mag_cal == 3.0:
        wanted = c[FINAL_YAW] > 0.0 and c[FINAL_MAG] > 0.0
    elif par.mag_cal == 4.0:
        wanted = True
    if known.compass == 0.0 or (c[ON_GROUND] > 0.0 and par.mag_cal != 4.0):
        wanted = False
    if wanted and c[MAG_LEARN] == 0.0:
        c[MAG_LEARN] = 1.0
        for i in range(6):
            P[MI + i, MI + i] = w.field_variance[i] if c[FIELD_LEARNED] > 0.0 else par.mag_m_nse**2
        c[DECLINATION_DUE] = 1.0 - c[FIELD_LEARNED]
        if c[FIELD_SET] == 0.0 or (c[FINAL_MAG] == 0.0 and c[IN_FLIGHT] > 0.0):
            c[RESET_YAW] = 1.0
    elif not wanted and c[MAG_LEARN] > 0.0:
        c[MAG_LEARN] = 0.0
        forget_rows(P, MI, 6, 0.0)
    if c[TILT] == 0.0:
        limit = math.radians(5.0 if known.version >= 4.1 else 3.0)
        if tilt_variance(f) < limit * limit:
            c[TILT] = 1.0
    if c[TILT] > 0.0 and c[BIAS_ON] == 0.0:
        c[BIAS_ON] = 1.0
        forget_rows(P, BG, 3, START_GYRO_BIAS**2)
        forget_rows(P, BA, 3, (ACC_BIAS_SHARE * par.acc_bias_lim) ** 2)
        for i in range(3):
            w.frozen[i] = 0.0
    if c[ON_GROUND] > 0.0:
        c[FINAL_YAW], c[FINAL_MAG] = 0.0, 0.0


def control_aiding(f: Filter, par: Parameters, known: Known, t: float, starts: bool) -> None:
    """Begin and end the use of GNSS."""
    x, c = f.x, f.c
    if t >= known.t_origin:
        set_origin(f, known)
    if c[GNSS_ON] == 0.0:
        if known.flown == 0.0:
            starts = par.src1_posxy == BY_GNSS and c[GOOD_GNSS] > 0.0 and t - c[T_GNSS] < 1.0
            starts = starts and c[TILT] > 0.0 and c[YAW] > 0.0
            for i in range(3):
                starts = starts and (f.P[BG + i, BG + i] <= math.radians(0.15) ** 2 or known.plane > 0.0)
        if starts:
            c[GNSS_ON] = 1.0
            set_origin(f, known)
            reset_velocity(f, par)
            reset_position(f, par)
        c[T_VELOCITY] = c[T_POSITION] = t
        return
    if t - max(c[T_VELOCITY], c[T_POSITION], c[T_AIRSPEED]) > AID_S:
        c[GNSS_ON] = 0.0
        c[HELD_N], c[HELD_E] = x[7], x[8]
        x[4] = x[5] = 0.0
        x[9] = -c[HEIGHT]
        forget_rows(f.P, VEL, 2, par.velne_m_nse**2)
        forget_rows(f.P, POS, 2, par.noaid_m_nse**2)


def reset_velocity(f: Filter, par: Parameters) -> None:
    """Set the velocity to that of GNSS."""
    x, P, c = f.x, f.P, f.c
    x[4], x[5] = c[GNSS_VN], c[GNSS_VE]
    x[6] = c[GNSS_VD]
    forget_rows(P, VEL, 2, max(c[SACC], par.velne_m_nse) ** 2)
    forget_rows(P, VEL + 2, 1, max(c[SACC], par.veld_m_nse) ** 2)


def reset_position(f: Filter, par: Parameters) -> None:
    """Set the horizontal position to that of GNSS."""
    x, P, c = f.x, f.P, f.c
    x[7], x[8] = c[GNSS_N], c[GNSS_E]
    forget_rows(P, POS, 2, max(c[HACC], par.posne_m_nse) ** 2)


def use_compass(
    f: Filter,
    par: Parameters,
    known: Known,
    w: Work,
    m: F1,
    sampled: bool,
    t: float,
    t_now: float,
    yaw_gsf: float,
    var_gsf: float,
    final_flown: bool,
    anomaly_flown: bool,
) -> None:
    """Decide on resets by the compass and on what of it is due: a heading, or three axes with the declination."""
    x, P, c, r, due = f.x, f.P, f.c, f.r, w.due
    for i in range(4):
        due[i] = 0.0
    due[OBS_DECLINATION] = 0.0
    declination = known.declination if t_now >= known.t_fix else known.stored_declination
    if c[DECLINATION_DUE] > 0.0 and P[MI, MI] > 0.0:
        c[DECLINATION_DUE] = 0.0
        due[OBS_DECLINATION] = 1.0 if x[16] > MIN_NORTH_GAUSS else 0.0
        w.z[OBS_DECLINATION], w.noise[OBS_DECLINATION] = declination, FIRST_DECLINATION_SIGMA**2
    predicted = present_heading(f)
    turning = math.sqrt(f.rate[0] ** 2 + f.rate[1] ** 2 + f.rate[2] ** 2)
    still = c[ON_GROUND] > 0.0 and turning < STILL_RATE
    if not still:
        c[STATIC_YAW] = predicted
    if known.compass == 0.0 or par.src1_yaw != YAW_BY_COMPASS:
        if c[YAW] == 0.0 and c[TILT] > 0.0 and var_gsf > 0.0:
            reset_heading(f, wrap(yaw_gsf - heading_of(x)), var_gsf)
        if t_now - c[T_SYNTHETIC] > SYNTHETIC_S:
            c[T_SYNTHETIC] = t_now
            trace = 0.25 * (P[TH, TH] + P[TH + 1, TH + 1] + P[TH + 2, TH + 2])
            w.noise[OBS_HEADING] = max(par.yaw_m_nse, 0.05) ** 2
            if c[YAW] > 0.0 and par.src1_yaw == YAW_BY_GSF and var_gsf > 0.0 and known.plane == 0.0:
                due[OBS_HEADING] = 1.0
                c[HEADING_KIND] = HEADING_GSF
                w.z[OBS_HEADING] = wrap(yaw_gsf - heading_of(x)) + predicted
                w.noise[OBS_HEADING] = var_gsf
            elif still:
                due[OBS_HEADING] = 1.0
                c[HEADING_KIND] = HEADING_HELD
                w.z[OBS_HEADING] = c[STATIC_YAW]
            elif c[ON_GROUND] > 0.0 or c[GNSS_ON] == 0.0 or trace > 0.01:
                due[OBS_HEADING] = 1.0
                c[HEADING_KIND] = HEADING_PREDICTED
        return
    if not sampled:
        return
    if c[MAG_HEALTHY] > 0.0:
        c[T_MAG] = t_now
    slow = angle_between(x, w.q_mag) < MAX_RESET_TURN_RAD
    for i in range(4):
        w.q_mag[i] = x[i]
    copter = known.plane == 0.0
    final, anomaly = False, False
    if c[FINAL_YAW] == 0.0 and c[ON_GROUND] == 0.0 and copter:
        if known.flown > 0.0:
            final, anomaly = final_flown, anomaly_flown
        elif slow:
            final = x[9] - c[GROUND] < -FINAL_RESET_M
            growth = abs(c[YAW_INNOVATION]) - abs(c[YAW_AT_RESET])
            anomaly = (
                not final
                and c[ANOMALIES] < MAX_ANOMALIES
                and c[DOWN_AT_RESET] - x[9] > ANOMALY_CLIMB_M
                and growth > ANOMALY_YAW_RAD
                and angle_between(x, w.q_reset) <= growth
            )
    if (c[YAW] == 0.0 and c[TILT] > 0.0 and slow) or final or anomaly:
        c[RESET_YAW] = 1.0
    if c[RESET_YAW] > 0.0 and c[TILT] > 0.0:
        if final:
            c[IN_FLIGHT] = 1.0
        heading_from_field(f, par, m[0], m[1], m[2], declination)
        if anomaly:
            c[ANOMALIES] += 1.0
        if c[FIELD_LEARNED] == 0.0:
            reset_field(f, par, known, w, m[0], m[1], m[2])
        if anomaly:
            c[FINAL_YAW], c[FINAL_MAG] = 0.0, 0.0
    elif c[RESET_FIELD] > 0.0:
        reset_field(f, par, known, w, m[0], m[1], m[2])
    if c[YAW] == 0.0:
        return
    if c[MAG_LEARN] == 0.0 or c[FIELD_SET] == 0.0:
        predicted = present_heading(f)  # a reset may have changed it
        north, east = math.cos(predicted), math.sin(predicted)
        # the field in axes turned back by the predicted heading
        fn = r[0, 0] * m[0] + r[0, 1] * m[1] + r[0, 2] * m[2]
        fe = r[1, 0] * m[0] + r[1, 1] * m[1] + r[1, 2] * m[2]
        w.z[OBS_HEADING] = wrap(-math.atan2(north * fe - east * fn, north * fn + east * fe) + declination)
        w.noise[OBS_HEADING] = max(par.yaw_m_nse, 0.05) ** 2
        due[OBS_HEADING] = 1.0
        c[HEADING_KIND] = HEADING_COMPASS
        return
    c[MAG_PASSED] = 1.0
    noise = min(max(par.mag_m_nse, 0.01), 0.5) ** 2 + (0.005 * turning) ** 2
    for i in range(3):
        due[i] = 1.0
        w.z[i], w.noise[i] = m[i], noise
    if x[16] > MIN_NORTH_GAUSS and (c[GNSS_ON] == 0.0 or known.has_table > 0.0):
        due[OBS_DECLINATION] = 1.0
        w.z[OBS_DECLINATION], w.noise[OBS_DECLINATION] = declination, DECLINATION_SIGMA**2


def present_heading(f: Filter) -> float:
    """Return the heading in rad by the order of rotations that is better conditioned."""
    r = f.r
    if abs(r[2, 0]) < abs(r[2, 1]):
        return math.atan2(r[1, 0], r[0, 0])
    return math.atan2(-r[0, 1], r[1, 1])


def accept_gnss(f: Filter, par: Parameters, known: Known, g: F1, t: float) -> None:
    """Take a GNSS sample: hold peaks of its accuracies, scale noises by the satellites, check."""
    c = f.c
    since = min(max(t - c[T_GNSS], 0.0), 5.0)
    decay = 1.0 - 0.2 * since
    c[SACC] = max(decay * c[SACC], min(g[6], 50.0), par.velne_m_nse) if g[6] > 0.0 else 0.0
    c[HACC] = max(decay * c[HACC], min(g[7], 100.0), par.posne_m_nse) if g[7] > 0.0 else 0.0
    c[VACC] = max(decay * c[VACC], min(g[8], 100.0), 1.5 * par.posne_m_nse) if g[8] > 0.0 else 0.0
    if c[T_GNSS] == NEVER:
        c[T_GOOD], c[GNSS_N], c[GNSS_E] = t, g[0], g[1]
    c[T_GNSS] = t
    satellites = g[10]
    if satellites >= 6.0 and c[GNSS_ON] > 0.0:
        c[NOISE_SCALE] = 1.0
    else:
        c[NOISE_SCALE] = 1.4 if satellites == 5.0 and c[GNSS_ON] > 0.0 else 2.0
    check_gnss(f, par, known, g, since, t)
    c[GNSS_N], c[GNSS_E] = g[0], g[1]
    c[GNSS_VN], c[GNSS_VE], c[GNSS_VD] = g[3], g[4], g[5]


def check_gnss(f: Filter, par: Parameters, known: Known, g: F1, since: float, t: float) -> None:
    """Judge GNSS by the checks in use: good after 10 s without a failure, bad after 5 s without a pass.

    The compass is judged beside it: ratios above 1 for 5 s on the ground reset the heading.
    """
    c = f.c
    if c[MAG_RATIO] <= 1.0 or c[ON_GROUND] == 0.0:
        c[T_BAD_RATIO] = t
    elif t - c[T_BAD_RATIO] > BAD_RATIO_S:
        c[T_BAD_RATIO] = t
        c[RESET_YAW] = 1.0
    scale = max(0.01 * par.check_scale, 0.1) * (1.3 if c[GOOD_GNSS] > 0.0 else 1.0)
    check = int(par.gps_check)
    speed = math.sqrt(g[3] ** 2 + g[4] ** 2)
    c[DRIFT] = min(
        (c[DRIFT] + math.sqrt((g[0] - c[GNSS_N]) ** 2 + (g[1] - c[GNSS_E]) ** 2)) * (1.0 - 0.1 * since), 10.0
    )
    good = True
    if check & 1:
        good = good and g[10] >= 6.0
    if check & 2:
        good = good and g[11] <= 2.5
    if check & 4:
        good = good and c[SACC] <= scale
    if check & 8:
        good = good and g[7] <= 5.0 * scale and g[8] <= 7.5 * scale
    if check & 16:
        good = good and c[MAG_RATIO] <= 1.0
    if c[ON_GROUND] > 0.0:
        c[VD_LOW_PASS] += 0.1 * (g[5] - c[VD_LOW_PASS])
        c[SPEED_LOW_PASS] += 0.1 * (speed - c[SPEED_LOW_PASS])
        if check & 32:
            good = good and c[DRIFT] <= 3.0 * scale
        if check & 64:
            good = good and abs(c[VD_LOW_PASS]) <= 0.3 * scale
        if check & 128:
            good = good and c[SPEED_LOW_PASS] <= 0.3 * scale
    if good:
        c[T_PASSED] = t
    else:
        c[T_GOOD] = t
    if c[GOOD_GNSS] == 0.0:
        c[GOOD_GNSS] = 1.0 if t - c[T_GOOD] > GOOD_GNSS_S else 0.0
    elif t - c[T_PASSED] > BAD_GNSS_S:
        c[GOOD_GNSS] = 0.0
    if c[GOOD_GNSS] > 0.0 and known.flown == 0.0:
        set_origin(f, known)


def measure_position(
    f: Filter,
    par: Parameters,
    known: Known,
    w: Work,
    g: F1,
    fixed: bool,
    height: float,
    has_height: bool,
    ground_effect: float,
    armed: bool,
    t: float,
) -> None:
    """Gate GNSS velocity, GNSS position and height; reset what has timed out; say what is due.

    ``g``: position NED, velocity NED, sacc, hacc, vacc, fix, satellites, hdop. ``ground_effect``: 1 at take-off, 2 at
    touch-down.
    """
    x, P, c, due, z, noise = f.x, f.P, f.c, w.due, w.z, w.noise
    for i in range(OBS_VEL_N, OBS_BARO + 1):
        due[i] = 0.0
    if fixed:
        accept_gnss(f, par, known, g, t)
    on = c[GNSS_ON] > 0.0
    aids = fixed and on and par.src1_posxy == BY_GNSS
    move = math.sqrt(c[ACC_N] ** 2 + c[ACC_E] ** 2 + c[ACC_D] ** 2)
    kind = OBS_GNSS_HEIGHT if par.src1_posz == BY_GNSS else OBS_BARO
    has_height = fixed if kind == OBS_GNSS_HEIGHT else has_height
    down = x[9]
    if has_height:
        c[GROUND_EFFECT] = 1.0 if ground_effect > 0.0 and kind == OBS_BARO else 0.0
        c[HEIGHT] = -g[2] if kind == OBS_GNSS_HEIGHT else height
        down = -c[HEIGHT]
        noise[kind] = par.alt_m_nse**2
        if kind == OBS_GNSS_HEIGHT:
            noise[kind] = max(c[VACC], 1.5 * par.posne_m_nse) ** 2
        elif ground_effect > 0.0:
            noise[kind] *= 4.0
            if armed and ground_effect == 1.0:
                down = min(down, -c[TAKE_OFF_HEIGHT])
        if ground_effect != 1.0 or not armed:
            c[TAKE_OFF_HEIGHT] = c[HEIGHT]
        z[kind] = down
    scale = c[NOISE_SCALE] ** 2
    velocity = aids and par.src1_velxy == BY_GNSS
    vertical = velocity and par.src1_velz == BY_GNSS
    if aids:
        v_check = par.velne_m_nse**2 + (0.05 * move) ** 2
        p_noise = max(c[HACC], par.posne_m_nse) ** 2
        if c[SACC] > 0.0:
            v_noise, d_noise = max(c[SACC], par.velne_m_nse) ** 2, max(c[SACC], par.veld_m_nse) ** 2
        else:
            v_noise, d_noise = v_check, par.veld_m_nse**2 + (0.07 * move) ** 2
        if vertical and has_height and kind == OBS_BARO:
            look_for_bad_imu(f, x[9] - down, x[6] - g[5], noise[kind], d_noise, g[5], t)
        # position
        position_gate = max(0.01 * par.pos_i_gate, 1.0) ** 2
        en, ee = x[7] - g[0], x[8] - g[1]
        sum_s = P[POS, POS] + P[POS + 1, POS + 1] + 2.0 * p_noise
        ratio = (en * en + ee * ee) / (position_gate * sum_s)
        record(f, OBS_POS_N, t, en, P[POS, POS] + p_noise, ratio)
        record(f, OBS_POS_N + 1, t, ee, P[POS + 1, POS + 1] + p_noise, ratio)
        others = t - c[T_VELOCITY] < POSITION_S or t - c[T_AIRSPEED] < POSITION_S
        timeout = t - c[T_POSITION] > (POSITION_AIDED_S if others else POSITION_S)
        passed = ratio < 1.0 or par.glitch_rad <= 0.0
        if passed:
            c[T_POSITION] = t
        if ratio >= 1.0 and par.glitch_rad <= 0.0:
            p_noise = max(p_noise * ratio, p_noise)
        unsure = par.glitch_rad > 0.0 and P[POS, POS] + P[POS + 1, POS + 1] > par.glitch_rad**2
        if passed or timeout or c[BAD_IMU] > 0.0:
            if (timeout or unsure) and c[GOOD_GNSS] > 0.0:
                reset_position(f, par)
                forget_rows(P, POS, 2, (0.5 * par.glitch_rad) ** 2)
                c[T_POSITION] = t
                if timeout and not others:
                    reset_velocity(f, par)
                    velocity = False
                    c[T_VELOCITY] = t
            else:
                for i in range(2):
                    due[OBS_POS_N + i] = 1.0
                    z[OBS_POS_N + i] = g[i]
                    noise[OBS_POS_N + i] = p_noise * scale
        # velocity
        if velocity:
            n = 3 if vertical else 2
            gate = max(0.01 * par.vel_i_gate, 1.0) ** 2
            squares, sums = 0.0, 0.0
            for i in range(n):
                e = x[4 + i] - g[3 + i]
                squares += e * e
                sums += P[VEL + i, VEL + i] + v_check
            ratio = squares / (gate * sums)
            for i in range(n):
                record(f, OBS_VEL_N + i, t, x[4 + i] - g[3 + i], P[VEL + i, VEL + i] + v_check, ratio)
            passed = ratio < 1.0 or par.glitch_rad <= 0.0
            if passed:
                c[T_VELOCITY] = t
            if passed or c[BAD_IMU] > 0.0:
                for i in range(n):
                    due[OBS_VEL_N + i] = 1.0
                    z[OBS_VEL_N + i] = g[3 + i]
                    noise[OBS_VEL_N + i] = (d_noise if i == 2 else v_noise) * scale
    elif has_height and not on:
        # unaided: a held position with each height; a plane that is armed has no velocity
        sigma = min(max(par.noaid_m_nse, 0.5), 50.0) if armed and c[TILT] > 0.0 else 0.5
        if known.plane > 0.0 and armed and c[TILT] > 0.0:
            if c[ARMED_BEFORE] == 0.0:
                x[4] = x[5] = 0.0
            for i in range(2):
                due[OBS_VEL_N + i] = 1.0
                z[OBS_VEL_N + i] = 0.0
                noise[OBS_VEL_N + i] = sigma * sigma * scale
        else:
            for i in range(2):
                due[OBS_POS_N + i] = 1.0
                z[OBS_POS_N + i] = c[HELD_N] if i == 0 else c[HELD_E]
                noise[OBS_POS_N + i] = sigma * sigma * scale
    if has_height:
        gate_height(f, par, kind, down, noise[kind], t, w)
        if kind == OBS_BARO:
            noise[kind] /= known.n_baro
    c[ARMED_BEFORE] = 1.0 if armed else 0.0


def gate_height(f: Filter, par: Parameters, kind: int, down: float, noise: float, t: float, w: Work) -> None:
    """Gate a height; one that is refused for too long resets the filter's."""
    x, P, c = f.x, f.P, f.c
    e = x[9] - down
    s = P[POS + 2, POS + 2] + noise
    ratio = e * e / (max(0.01 * par.hgt_i_gate, 1.0) ** 2 * s)
    record(f, kind, t, e, s, ratio)
    passed = ratio < (3.0 if c[GNSS_ON] == 0.0 and c[ON_GROUND] > 0.0 else 1.0)
    aided = c[GNSS_ON] > 0.0 and t - c[T_VELOCITY] < HEIGHT_S
    timeout = t - c[T_HEIGHT] > (HEIGHT_AIDED_S if aided else HEIGHT_S)
    if passed:
        c[T_HEIGHT] = t
    if timeout and not passed:
        x[9] = down
        forget_rows(P, POS + 2, 1, noise)
        if c[GNSS_ON] > 0.0 and c[IN_FLIGHT] > 0.0:
            x[6] = c[GNSS_VD]
        elif c[ON_GROUND] > 0.0:
            x[6] = 0.0
        forget_rows(P, VEL + 2, 1, par.veld_m_nse**2)
        c[T_HEIGHT] = t
    elif passed or c[BAD_IMU] > 0.0:
        w.due[kind] = 1.0


def look_for_bad_imu(
    f: Filter, height: float, velocity: float, height_noise: float, velocity_noise: float, vd: float, t: float
) -> None:
    """Hold the IMU for bad while height and vertical velocity both disagree in the same direction."""
    c = f.c
    since = t - c[T_BAD_IMU]
    sigma2 = 9.0 if since > 2.0 * BAD_IMU_S else 4.0 if since > 1.5 * BAD_IMU_S else 1.0
    if height * velocity > 0.0 and height**2 > sigma2 * height_noise and velocity**2 > sigma2 * velocity_noise:
        c[T_BAD_IMU] = t
    c[BAD_IMU] = 0.0
    if since < BAD_IMU_S:
        c[BAD_IMU] = 1.0
        f.x[6] = vd


def measure_air(f: Filter, par: Parameters, known: Known, w: Work, tas: float, sampled: bool, t: float) -> None:
    """Say whether airspeed and sideslip are due: with wind states, sideslip for planes every 0.1 s."""
    c = f.c
    w.due[OBS_AIRSPEED] = 0.0
    w.due[OBS_SIDESLIP] = 0.0
    if c[WIND_ON] == 0.0:
        return
    if sampled and known.airspeed > 0.0:
        w.due[OBS_AIRSPEED] = 1.0
        w.z[OBS_AIRSPEED] = tas
        w.noise[OBS_AIRSPEED] = min(max(par.eas_m_nse, 0.5), 5.0) ** 2
    if known.plane > 0.0 and t - c[T_SIDESLIP] >= SIDESLIP_S:
        c[T_SIDESLIP] = t
        w.due[OBS_SIDESLIP] = 1.0
        w.noise[OBS_SIDESLIP] = SIDESLIP_NOISE
