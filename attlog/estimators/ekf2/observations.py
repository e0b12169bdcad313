"""Observations of EKF2: field, heading, GNSS, height, airspeed; what each may correct and when it is refused."""

from __future__ import annotations

import math

from attlog.core.jit import F1, Out1
from attlog.estimators.ekf2.state import (
    ACC_E,
    ACC_MOVES,
    ACC_N,
    ALIGNED,
    BAD_HGT,
    BAD_VEL,
    CONSISTENT,
    ERA_B,
    ERA_C,
    ERA_D,
    FIELD_N,
    FIELD_SAVED,
    FIELD_X,
    FIELD_Y,
    FIELD_Z,
    GNSS_CHECKED,
    GNSS_ON,
    GOOD_SINCE,
    HEAD_DIFF,
    MAG_3D,
    MAG_FAULT,
    MAG_FIELD_ONLY,
    MAG_HEADING,
    MAG_MODE,
    MAG_OFF,
    MAG_SINCE,
    T_ALIGNED,
    T_BAD_ACC,
    T_GNSS,
    T_HEADING,
    T_HEIGHT,
    T_LANDED,
    T_MAG,
    T_OBSERVABLE,
    T_POS,
    T_VEL,
    TILT,
    WIND_ON,
    YAW,
    YAW_RATE,
    Known,
    Parameters,
    low_pass,
)
from attlog.estimators.error_state import (
    BG,
    MB,
    MI,
    N_ERR,
    NEVER,
    OBS_AIRSPEED,
    OBS_BARO,
    OBS_HEADING,
    OBS_POS_N,
    OBS_SIDESLIP,
    OBS_VEL_N,
    POS,
    TH,
    VEL,
    WIND,
    Filter,
    airspeed_row,
    declination_row,
    field_heading,
    field_row,
    forget_rows,
    fuse_direct,
    heading_of,
    heading_row,
    innovation_variance,
    record,
    rotation,
    set_mask,
    sideslip_row,
    turn_heading,
    update,
    wrap,
)

Vector = tuple[float, float, float]
# Variance of the bank of yaw hypotheses, rad^2, below which a reset takes its heading: 15 deg.
MAX_BANK_VARIANCE = math.radians(15.0) ** 2


def fuse_axis(f: Filter, m: F1, axis: int, noise: float) -> tuple[float, float]:
    """Prepare one axis of the field with the present state; return (innovation, variance)."""
    predicted = field_row(f, axis)
    return predicted - m[axis], innovation_variance(f, 7, noise)


def fuse_field(f: Filter, par: Parameters, m: F1, t: float, mask: Out1, ratio_n: float) -> bool:
    """Fuse the three axes of a field sample; True where no axis is beyond the gate."""
    x, rr = f.x, f.r_new
    noise = max(par.mag_noise, 0.01) ** 2
    gate = max(par.mag_gate, 1.0) ** 2
    good = True
    for axis in range(3):
        e, s = fuse_axis(f, m, axis, noise)
        ratio = e * e / (gate * s)
        record(f, axis, t, e, s, ratio)
        good = good and ratio <= 1.0
    if not good:
        return False
    for axis in range(3):
        # Jacobians stay at the first linearisation; innovations follow the state.
        fuse_axis(f, m, axis, noise)
        s = innovation_variance(f, 7, noise * ratio_n)
        rotation(x, rr)
        e = rr[0, axis] * x[16] + rr[1, axis] * x[17] + rr[2, axis] * x[18] + x[19 + axis] - m[axis]
        update(f, s, e, mask)
    return True


def fuse_declination(f: Filter, declination: float, sigma: float, mask: Out1) -> None:
    """Fuse the direction of the earth field's horizontal part."""
    if f.x[16] ** 2 + f.x[17] ** 2 < 1e-6:
        return
    e = wrap(declination_row(f) - declination)
    s = innovation_variance(f, 2, sigma * sigma)
    e = min(max(e, -0.5), 0.5)
    update(f, s, e, mask)


def fuse_heading(
    f: Filter, heading: float, noise: float, gate: float, clip: bool, mask: Out1, t: float, ratio_n: float, keep: bool
) -> bool:
    """Fuse a heading in rad; True where it passed. ``clip``: a refused innovation is clipped to the gate instead."""
    r = f.r
    predicted = heading_row(f, abs(r[2, 0]) < abs(r[2, 1]) or abs(r[2, 0]) < 0.9)
    s = innovation_variance(f, 3, noise)
    e = wrap(predicted - heading)
    ratio = e * e / (gate * gate * s)
    if keep:
        record(f, OBS_HEADING, t, e, s, ratio)
    if ratio > 1.0:
        if not clip:
            return False
        limit = gate * math.sqrt(s)
        e = min(max(e, -limit), limit)
    s = innovation_variance(f, 3, noise * ratio_n)
    update(f, s, e, mask)
    return True


def align_field(
    f: Filter, par: Parameters, known: Known, t: float, gsf_yaw: float, gsf_var: float, start: bool
) -> None:
    """Reset heading and field states from the low-passed field, or from the bank of yaw hypotheses."""
    x, P, c, r = f.x, f.P, f.c, f.r
    era = known.era
    mx, my, mz = c[FIELD_X], c[FIELD_Y], c[FIELD_Z]
    has_model = known.strength > 0.0
    d = known.declination
    hn, hd = known.strength * math.cos(known.inclination), known.strength * math.sin(known.inclination)
    by_gsf = (not start) and known.reset_in_climb == 2 and c[GNSS_ON] > 0 and 0.0 < gsf_var < MAX_BANK_VARIANCE
    if by_gsf:
        turn = wrap(gsf_yaw - heading_of(x))
        turn_heading(f, turn)
        forget_rows(P, TH + 2, 1, gsf_var)
    else:
        turn = field_heading(r, mx, my, mz, d)
        turn_heading(f, turn)
        variance = par.head_noise**2
        if not start and (era == ERA_B or era == ERA_C):
            variance *= 0.1
        forget_rows(P, TH + 2, 1, variance)
    rotation(x, r)
    noise = max(par.mag_noise, 0.01) ** 2
    if (era == ERA_D or by_gsf) and has_model:
        x[16], x[17], x[18] = hn * math.cos(d), hn * math.sin(d), hd
        for i in range(3):
            x[19 + i] = 0.0
        if by_gsf:
            for i in range(3):
                x[19 + i] = (mx, my, mz)[i] - (r[0, i] * x[16] + r[1, i] * x[17] + r[2, i] * x[18])
        forget_rows(P, MI, 6, noise)
    else:
        for i in range(3):
            x[16 + i] = r[i, 0] * mx + r[i, 1] * my + r[i, 2] * mz
        forget_rows(P, MI, 3, noise)
        forget_rows(P, MB, 3, noise)
        fuse_declination(f, d, 0.02, f.mask)
    c[YAW] = 1.0
    c[CONSISTENT] = 1.0
    c[HEAD_DIFF] = 0.0
    c[T_HEADING] = t
    c[T_MAG] = t


def field_logic(
    f: Filter,
    par: Parameters,
    known: Known,
    m: F1,
    t: float,
    in_air: bool,
    at_rest: bool,
    gsf_yaw: float,
    gsf_var: float,
    n_mag: float,
) -> None:
    """Decide what one field sample may correct, and fuse it (``mag_control.cpp``, ``mag_fusion.cpp``)."""
    x, P, c, r, full, mask, saved = f.x, f.P, f.c, f.r, f.full, f.mask, f.saved
    era = known.era
    kind = par.mag_type
    low_pass(c, FIELD_X, FIELD_N, m)
    strength = math.sqrt(m[0] ** 2 + m[1] ** 2 + m[2] ** 2)
    passes = strength > 0.0
    if int(par.mag_check) & 1 and known.strength > 0.0:
        passes = abs(strength - known.strength) <= par.mag_chk_str
    if not passes or c[TILT] == 0.0:
        c[MAG_SINCE] = t
    if kind == 5.0 or c[TILT] == 0.0 or c[MAG_FAULT] > 0.0:
        c[MAG_MODE] = MAG_OFF
        return
    set_mask(full, 0, N_ERR, 1.0)
    if era == ERA_D:
        if c[MAG_MODE] == MAG_OFF and not c[YAW]:
            if c[FIELD_N] > 3 and t - c[MAG_SINCE] > 1.0:
                align_field(f, par, known, t, gsf_yaw, gsf_var, True)
                c[MAG_MODE] = MAG_HEADING
            return
        # heading innovation of the sample, low-passed, against what GNSS makes of the heading
        declination = math.atan2(x[17], x[16]) if c[ALIGNED] > 0.0 else known.declination
        sure = max(P[MB, MB], P[MB + 1, MB + 1], P[MB + 2, MB + 2]) <= par.mag_noise**2
        b = 1.0 if sure else 0.0
        turn = field_heading(r, m[0] - b * x[19], m[1] - b * x[20], m[2] - b * x[21], declination)
        c[HEAD_DIFF] += 0.1 * (turn - c[HEAD_DIFF])
        moves = math.sqrt(c[ACC_N] ** 2 + c[ACC_E] ** 2) > par.mag_acclim
        if abs(c[HEAD_DIFF]) >= par.head_noise:
            c[CONSISTENT] = 0.0
        elif moves:
            c[CONSISTENT] = 1.0
        usable = (c[CONSISTENT] > 0.0 or c[GNSS_ON] == 0.0) and passes
        if not usable or kind == 6.0:
            mode = MAG_FIELD_ONLY
        elif c[ALIGNED] > 0.0 and kind == 0.0:
            mode = MAG_3D
        else:
            mode = MAG_HEADING
        c[MAG_MODE] = mode
        for i in range(N_ERR):
            full[i] = mask[i]
        if mode == MAG_FIELD_ONLY:
            set_mask(full, 0, MI, 0.0)
            set_mask(full, WIND, 2, 0.0)
        elif mode == MAG_HEADING:
            full[TH], full[TH + 1], full[BG], full[BG + 1] = 0.0, 0.0, 0.0, 0.0
        if fuse_field(f, par, m, t, full, n_mag):
            c[T_MAG] = t
            if mode != MAG_FIELD_ONLY:
                c[T_HEADING] = t
        elif t - c[T_MAG] > 7.0:
            if c[GNSS_ON] == 0.0 or at_rest:
                align_field(f, par, known, t, gsf_yaw, gsf_var, True)
            else:
                c[MAG_FAULT] = 1.0
        rotation(x, r)
        if known.strength > 0.0 and (c[GNSS_ON] == 0.0 or at_rest):
            fuse_declination(f, known.declination, 0.5, full)
        return
    # eras A to C
    declination = known.declination
    if c[ALIGNED] > 0.0 and x[16] ** 2 + x[17] ** 2 > 1e-4:
        declination = math.atan2(x[17], x[16])
    if not c[YAW]:
        if c[FIELD_N] > 3:
            align_field(f, par, known, t, gsf_yaw, gsf_var, True)
            c[MAG_MODE] = MAG_HEADING
        return
    acceleration = math.sqrt(c[ACC_N] ** 2 + c[ACC_E] ** 2)
    limit = par.mag_acclim * (1.0 if c[ACC_MOVES] > 0.0 else 2.0)
    c[ACC_MOVES] = 1.0 if c[GNSS_ON] > 0.0 and acceleration > limit else 0.0
    if c[ACC_MOVES] > 0.0 or abs(c[YAW_RATE]) > par.mag_yawlim:
        c[T_OBSERVABLE] = t
    three = kind == 2.0 or (kind != 1.0 and c[ALIGNED] > 0.0 and t - c[T_OBSERVABLE] < 2.0)
    if three and c[MAG_MODE] != MAG_3D:
        if c[FIELD_SAVED] > 0.0:
            for i in range(6):
                P[MI + i, MI + i] = max(saved[i], 1e-12)
        elif P[MI, MI] == 0.0:
            forget_rows(P, MI, 6, max(par.mag_noise, 0.01) ** 2)
            if x[16] ** 2 + x[17] ** 2 + x[18] ** 2 < 1e-6:
                for i in range(3):
                    x[16 + i] = r[i, 0] * c[FIELD_X] + r[i, 1] * c[FIELD_Y] + r[i, 2] * c[FIELD_Z]
    if not three and c[MAG_MODE] == MAG_3D:
        for i in range(6):
            saved[i] = P[MI + i, MI + i]
        c[FIELD_SAVED] = 1.0
    c[MAG_MODE] = MAG_3D if three else MAG_HEADING
    for i in range(N_ERR):
        full[i] = mask[i]
    if three:
        if t - c[T_ALIGNED] < 5.0:
            set_mask(full, 0, MI, 0.0)
            set_mask(full, WIND, 2, 0.0)
        if fuse_field(f, par, m, t, full, n_mag):
            c[T_MAG] = t
            c[T_HEADING] = t
        rotation(x, r)
        if int(par.decl_type) & 4 or c[GNSS_ON] == 0.0:
            fuse_declination(f, known.declination, 0.5, full)
    else:
        forget_rows(P, MI, 6, 0.0)
        turn = field_heading(r, m[0] - x[19], m[1] - x[20], m[2] - x[21], declination)
        if t - c[T_ALIGNED] < 5.0 and c[ALIGNED] > 0.0:
            c[T_HEADING] = t
        if abs(r[2, 0]) < abs(r[2, 1]) or abs(r[2, 0]) < 0.9:
            predicted = math.atan2(r[1, 0], r[0, 0])
        else:
            predicted = math.atan2(-r[0, 1], r[1, 1])
        set_mask(full, MI, 6, 0.0)
        if fuse_heading(f, wrap(predicted + turn), par.head_noise**2, par.hdg_gate, not in_air, full, t, n_mag, True):
            c[T_MAG] = t
            c[T_HEADING] = t
    rotation(x, r)


def fuse_gnss(
    f: Filter,
    par: Parameters,
    known: Known,
    z: F1,
    t: float,
    flown: float,
    in_air: bool,
    gsf_yaw: float,
    gsf_var: float,
) -> None:
    """Fuse one GNSS sample: z = position NED, velocity NED, eph, epv, sacc, fix, satellites.

    ``flown``: whether the log says that GNSS was in use, -1 for the filter's own checks.
    """
    x, P, c, r, rate = f.x, f.P, f.c, f.r, f.rate
    era = known.era
    n = known.n_gnss
    ctrl = int(par.gps_ctrl)
    px, py, pz = par.gps_pos_x, par.gps_pos_y, par.gps_pos_z
    # lever arm in earth axes and the velocity it adds
    lx = r[0, 0] * px + r[0, 1] * py + r[0, 2] * pz
    ly = r[1, 0] * px + r[1, 1] * py + r[1, 2] * pz
    lz = r[2, 0] * px + r[2, 1] * py + r[2, 2] * pz
    wx, wy, wz = rate[1] * pz - rate[2] * py, rate[2] * px - rate[0] * pz, rate[0] * py - rate[1] * px
    ux = r[0, 0] * wx + r[0, 1] * wy + r[0, 2] * wz
    uy = r[1, 0] * wx + r[1, 1] * wy + r[1, 2] * wz
    uz = r[2, 0] * wx + r[2, 1] * wy + r[2, 2] * wz
    pos = (z[0] - lx, z[1] - ly, z[2] - lz)
    vel = (z[3] - ux, z[4] - uy, z[5] - uz)
    v_noise = max(z[8], par.gps_v_noise, 0.01) ** 2
    p_noise = min(max(z[6], par.gps_p_noise, 0.01), max(par.noaid_noise, par.gps_p_noise)) ** 2
    checked = par.req_gps_h
    if era == ERA_D and c[GNSS_CHECKED] > 0.0:
        checked = max(1.0, 0.1 * par.req_gps_h)
    if known.brief_checks > 0.0 and c[GNSS_CHECKED] > 0.0:
        good = z[9] >= 3 and z[6] <= 50.0 and z[7] <= 50.0 and z[8] <= 10.0
    else:
        good = z[9] >= 3 and z[6] <= par.req_eph and z[7] <= par.req_epv and z[8] <= par.req_sacc
        good = good and z[10] >= par.req_nsats
    if not good:
        c[GOOD_SINCE] = t
    healthy = good and t - c[GOOD_SINCE] >= checked
    if healthy:
        c[GNSS_CHECKED] = 1.0
    if era != ERA_D or good:
        c[T_GNSS] = t
    if c[GNSS_ON] == 0.0:
        ready = healthy if flown < 0.0 else flown > 0.0
        if (ctrl & 5) and c[TILT] > 0.0 and c[YAW] > 0.0 and ready:
            c[GNSS_ON] = 1.0
            reset_to_gnss(f, vel, pos, v_noise, p_noise, t)
        return
    if era == ERA_D and not healthy:
        return  # left out until the checks pass again
    if ctrl & 4:
        ratio_all = 0.0
        ratio_d = 0.0
        for i in range(3):
            noise = v_noise * (2.25 if i == 2 else 1.0)
            s = P[VEL + i, VEL + i] + noise
            e = x[4 + i] - vel[i]
            ratio = e * e / (par.gps_v_gate**2 * s)
            record(f, OBS_VEL_N + i, t, e, s, ratio)
            if i == 2 and era <= ERA_B:
                ratio_d = ratio
            else:
                ratio_all = max(ratio_all, ratio)
            if i == 2:
                c[BAD_VEL] = e / math.sqrt(s)
        for i in range(3):
            ratio = ratio_d if (i == 2 and era <= ERA_B) else ratio_all
            e = x[4 + i] - vel[i]
            noise = v_noise * (2.25 if i == 2 else 1.0)
            if ratio > 1.0 and i == 2 and t - c[T_BAD_ACC] < 10.0:
                limit = par.gps_v_gate * math.sqrt(P[VEL + 2, VEL + 2] + noise)
                e = min(max(e, -limit), limit)
                ratio = 1.0
            if ratio <= 1.0:
                fuse_direct(f, VEL + i, e, noise * n)
        if ratio_all <= 1.0:
            c[T_VEL] = t
    if ctrl & 1:
        ratio = 0.0
        for i in range(2):
            s = P[POS + i, POS + i] + p_noise
            e = x[7 + i] - pos[i]
            each = e * e / (par.gps_p_gate**2 * s)
            record(f, OBS_POS_N + i, t, e, s, each)
            ratio = max(ratio, each)
        if ratio <= 1.0:
            for i in range(2):
                fuse_direct(f, POS + i, x[7 + i] - pos[i], p_noise * n)
            c[T_POS] = t
    if known.flown_emergency == 0.0 and era >= ERA_B and in_air and t - c[T_VEL] > 1.0 and c[T_VEL] > c[T_LANDED]:
        if abs(wrap(gsf_yaw - heading_of(x))) > math.radians(25.0):
            emergency_heading(f, gsf_yaw, gsf_var)
    silent = t - c[T_VEL] > 7.0
    if era <= ERA_B:
        silent = (silent and t - c[T_POS] > 7.0) or t - c[T_POS] > 14.0
    if silent:
        reset_to_gnss(f, vel, pos, v_noise, p_noise, t)


def reset_to_gnss(f: Filter, vel: Vector, pos: Vector, v_noise: float, p_noise: float, t: float) -> None:
    """Reset velocity and horizontal position to a sample."""
    for i in range(3):
        f.x[4 + i] = vel[i]
        forget_rows(f.P, VEL + i, 1, v_noise * (2.25 if i == 2 else 1.0))
    for i in range(2):
        f.x[7 + i] = pos[i]
        forget_rows(f.P, POS + i, 1, p_noise)
    f.c[T_VEL] = f.c[T_POS] = t


def emergency_heading(f: Filter, gsf_yaw: float, gsf_var: float) -> None:
    """Reset the heading to the bank's where that is sure; the magnetometer is at fault, velocity and position too."""
    if not 0.0 < gsf_var < MAX_BANK_VARIANCE:
        return
    turn_heading(f, wrap(gsf_yaw - heading_of(f.x)))
    forget_rows(f.P, TH + 2, 1, gsf_var)
    rotation(f.x, f.r)
    f.c[MAG_FAULT] = 1.0
    f.c[T_VEL] = f.c[T_POS] = NEVER


def fuse_height(
    f: Filter,
    z: float,
    noise: float,
    gate: float,
    is_reference: bool,
    off: int,
    var: int,
    count: int,
    kind: int,
    t: float,
    n: float,
    dead_zone: float,
) -> None:
    """Fuse a height source (down-positive ``z``); a source that is not the reference has an estimated offset."""
    x, P, c, gain = f.x, f.P, f.c, f.gain
    if c[count] == 0.0:
        c[off] = z - x[9]
        c[var] = noise
        c[count] = 1.0
        return
    c[count] += 1.0
    if not is_reference:
        c[var] += 0.13**2 * (0.05 if kind == OBS_BARO else 0.2)
        s = c[var] + noise + P[POS + 2, POS + 2]
        gain = c[var] / s
        c[off] += gain * min(max(z - x[9] - c[off], -3.0 * math.sqrt(s)), 3.0 * math.sqrt(s))
        c[var] *= 1.0 - gain
    s = P[POS + 2, POS + 2] + noise
    e = x[9] - (z - c[off])
    if dead_zone > 0.0:
        # ground effect: the barometer may read too low by the dead zone
        if e < 0.0:
            e = min(e + dead_zone, 0.0)
    ratio = e * e / (gate * gate * s)
    record(f, kind, t, e, s, ratio)
    c[BAD_HGT] = e / math.sqrt(s)
    if ratio > 1.0 and t - c[T_BAD_ACC] < 10.0:
        limit = gate * math.sqrt(s)
        e = min(max(e, -limit), limit)
        ratio = 1.0
    if ratio <= 1.0:
        fuse_direct(f, POS + 2, e, noise * n)
        c[T_HEIGHT] = t
    elif t - c[T_HEIGHT] > 5.0:
        x[9] = z - c[off]
        forget_rows(P, POS + 2, 1, noise)
        c[T_HEIGHT] = t


def fuse_wind(f: Filter, par: Parameters, tas: float, t: float) -> None:
    """Fuse true airspeed (and sideslip where asked); starts the wind at the first use."""
    x, P, c, mask = f.x, f.P, f.c, f.mask
    vx, vy, vz = x[4] - x[22], x[5] - x[23], x[6]
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    if tas > 0.0:
        if c[WIND_ON] == 0.0:
            heading = heading_of(x)
            x[22] = x[4] - tas * math.cos(heading)
            x[23] = x[5] - tas * math.sin(heading)
            forget_rows(P, WIND, 2, 3.0**2)
            c[WIND_ON] = 1.0
            return
        if speed > 1.0:
            airspeed_row(f)
            noise = max(par.eas_noise, 0.1) ** 2
            s = innovation_variance(f, 5, noise)
            e = speed - tas
            ratio = e * e / (par.tas_gate**2 * s)
            record(f, OBS_AIRSPEED, t, e, s, ratio)
            if ratio <= 1.0:
                update(f, s, e, mask)
        return
    if c[WIND_ON] == 0.0 or speed < 1.0:
        return
    e = sideslip_row(f, 1.0)
    if e == 1e3:
        return
    s = innovation_variance(f, 8, par.beta_noise**2)
    ratio = e * e / (par.beta_gate**2 * s)
    record(f, OBS_SIDESLIP, t, e, s, ratio)
    if ratio <= 1.0:
        update(f, s, e, mask)
