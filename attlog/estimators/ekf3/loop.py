"""One step of EKF3 after the other: flight, modes, prediction, compass, GNSS, height, air data, output predictor."""

from __future__ import annotations

import math
from typing import NamedTuple

from attlog.core import jit
from attlog.core.jit import F1, F2, Out1, Out2
from attlog.estimators.ekf3.modes import (
    choose_states,
    control_aiding,
    detect_flight,
    measure_air,
    measure_position,
    use_compass,
)
from attlog.estimators.ekf3.state import (
    ACC_D,
    ACC_E,
    ACC_N,
    BIAS_ON,
    COMPASS,
    FIELD_LEARNED,
    FINAL_MAG,
    GNSS_ON,
    GROUND_EFFECT,
    HEADING_COMPASS,
    HEADING_KIND,
    HEADING_PREDICTED,
    HEIGHT_RATE,
    IN_FLIGHT,
    MAG_3D,
    MAG_HEALTHY,
    MAG_LEARN,
    MAG_NONE,
    MAG_PASSED,
    MAG_RATIO,
    MAG_YAW,
    MIN_SIDESLIP_SPEED,
    OBSERVABLE_SHARE,
    ON_GROUND,
    STILL_RATE,
    T_AIRSPEED,
    T_MAG,
    TILT,
    VD_CLIPS,
    YAW_INNOVATION,
    Known,
    Parameters,
    Work,
    change_compass,
    cold_start,
    limit_states,
    process_noise,
    set_tilt,
)
from attlog.estimators.error_state import (
    BA,
    BG,
    MI,
    N_ERR,
    N_STATE,
    OBS_AIRSPEED,
    OBS_BARO,
    OBS_DECLINATION,
    OBS_HEADING,
    OBS_POS_E,
    OBS_SIDESLIP,
    OBS_VEL_N,
    POS,
    TH,
    VEL,
    WIND,
    Filter,
    airspeed_row,
    correct_output,
    declination_row,
    field_row,
    forget_rows,
    heading_row,
    innovation_variance,
    predict_covariance,
    record,
    rotation,
    set_mask,
    sideslip_row,
    strapdown,
    turn_body,
    update,
    wrap,
)

# A compass that is refused in flight for so long gives way to the next one, but not in the filter's first seconds.
COMPASS_S, NEW_S = 10.0, 30.0
# Compass noise grows with the body rate: gauss per rad/s.
RATE_NOISE = 0.005


class Samples(NamedTuple):
    """All that a run reads, in rows. Times are s since boot; ``stamp``: time of measurement that the filter assumes."""

    steps: F2  # (k, 11) time, rate (3), force (3), duration, armed, flying for 5 s, 1 take-off 2 touch-down
    mag: F2  # (m, 6) stamp, arrival, field (3) in gauss, number of the compass
    gnss: F2  # (g, 14) stamp, arrival, position NED, velocity NED, sacc, hacc, vacc, fix, satellites, hdop
    baro: F2  # (b, 3) stamp, arrival, height up in m
    airspeed: F2  # (a, 3) stamp, arrival, true airspeed in m/s
    gsf: F2  # (s, 3) time, heading, variance of the yaw estimator
    final_resets: F1  # (l,) in-flight alignments as logged
    anomaly_resets: F1  # (l,) resets for a ground anomaly as logged
    gnss_starts: F1  # (l,) begins of GNSS use as logged
    compass_changes: F1  # (l,) another compass in use as logged


@jit.loop("ArduPilot's EKF3")
def run_filter(
    f: Filter, w: Work, par: Parameters, known: Known, s: Samples, first: int, last: int, out_q: Out2, out_steps: Out2
) -> None:
    """Run the steps ``first`` to ``last``, the first of them at the horizon.

    ``out_q`` (k, 4) takes the output attitude at each step's end, ``out_steps`` (k, 52) of the step at the horizon: the
    24 states, 23 variances, mode of the compass, GNSS in use, tilt aligned, in flight, final field reset done.
    """
    x, P, c, r, o = f.x, f.P, f.c, f.r, f.output
    length = int(known.length)
    ring = f.ring
    i_mag, i_gnss, i_baro, i_tas, i_gsf, i_final, i_anomaly, i_start, i_compass = 0, 0, 0, 0, 0, 0, 0, 0, 0
    if P[0, 0] == 0.0:
        cold_start(f, par)
        set_tilt(f, s.steps[first, 4], s.steps[first, 5], s.steps[first, 6])
    ready = False
    for k in range(first + length - 1, last):
        j = k - length + 1
        t, t_now, dt = s.steps[j, 0], s.steps[k, 0], s.steps[j, 7]
        if not ready:
            # outputs begin at the delayed attitude and run on with the gyro
            for i in range(4):
                o[i] = x[i]
            ready = True
            begin = j
        else:
            begin = k
        while begin <= k:
            if begin > j:
                d = s.steps[begin, 7]
                turn_body(
                    o,
                    (s.steps[begin, 1] - x[10]) * d + f.correction[0],
                    (s.steps[begin, 2] - x[11]) * d + f.correction[1],
                    (s.steps[begin, 3] - x[12]) * d + f.correction[2],
                )
            for i in range(4):
                ring[begin % length, i] = o[i]
                out_q[begin, i] = o[i]
            begin += 1
        # 1 to 4: flight, what learns, alignment, aiding
        armed, airborne = s.steps[k, 8] > 0.0, s.steps[k, 9] > 0.0
        detect_flight(f, par, known, w, armed, airborne)
        choose_states(f, par, known, w, s.airspeed[i_tas, 2])
        starts = False
        while i_start < len(s.gnss_starts) and s.gnss_starts[i_start] <= t_now:
            starts = s.gnss_starts[i_start] > s.steps[k - 1, 0]
            i_start += 1
        control_aiding(f, par, known, t_now, starts)
        # 5: strapdown at the horizon with the attitude of the step's start
        rotation(x, r)
        before_n, before_e, before_d = x[4], x[5], x[6]
        for i in range(3):
            f.rate[i] = s.steps[j, 1 + i] - x[10 + i]
            f.force[i] = s.steps[j, 4 + i] - x[13 + i]
        strapdown(f, known.latitude, dt, False)
        c[ACC_N] += 0.05 * ((x[4] - before_n) / dt - c[ACC_N])
        c[ACC_E] += 0.05 * ((x[5] - before_e) / dt - c[ACC_E])
        c[ACC_D] += 0.05 * ((x[6] - before_d) / dt - c[ACC_D])
        horizontal = math.sqrt(c[ACC_N] ** 2 + c[ACC_E] ** 2)
        if c[GNSS_ON] == 0.0 and horizontal > 5.0:
            for i in range(2):
                old = before_n if i == 0 else before_e
                x[4 + i] = old + (x[4 + i] - old) * 5.0 / horizontal
        share = dt / 10.0
        c[HEIGHT_RATE] += share * (-x[6] - c[HEIGHT_RATE])
        # 6: covariance; a frozen accelerometer bias keeps its variance aside
        rotation(x, r)
        turning = math.sqrt(f.rate[0] ** 2 + f.rate[1] ** 2 + f.rate[2] ** 2)
        for i in range(3):
            if c[ON_GROUND] > 0.0:
                learns = abs(r[2, i]) > OBSERVABLE_SHARE and (known.version < 4.8 or turning < STILL_RATE)
            else:
                learns = known.version >= 4.2
            learns = learns and c[BIAS_ON] > 0.0
            if not learns and w.frozen[i] == 0.0:
                w.bias_variance[i] = P[BA + i, BA + i]
                forget_rows(P, BA + i, 1, 0.0)
            elif learns and w.frozen[i] > 0.0:
                P[BA + i, BA + i] = max(w.bias_variance[i], 0.0)
            w.frozen[i] = 0.0 if learns else 1.0
            f.mask[BA + i] = 1.0 if learns else 0.0
        process_noise(f, par, known, w, dt)
        predict_covariance(f, dt)
        c[VD_CLIPS] = max(c[VD_CLIPS] - 1.0, 0.0)
        limit_states(f, par, known, w)
        # 7: the yaw estimator as logged
        while i_gsf + 1 < len(s.gsf) and s.gsf[i_gsf + 1, 0] <= t_now:
            i_gsf += 1
        yaw_gsf, var_gsf = 0.0, 0.0
        if len(s.gsf) and s.gsf[i_gsf, 0] <= t_now < s.gsf[i_gsf, 0] + 1.0:
            yaw_gsf, var_gsf = s.gsf[i_gsf, 1], s.gsf[i_gsf, 2]
        # the newest sample of each aid at the horizon
        mag, gnss, baro, tas = -1, -1, -1, -1
        while i_mag < len(s.mag) and s.mag[i_mag, 0] <= t and s.mag[i_mag, 1] <= t_now:
            if s.mag[i_mag, 5] == c[COMPASS] or known.flown > 0.0:
                mag = i_mag if s.mag[i_mag, 0] > t - 0.1 else -1
            i_mag += 1
        while i_gnss < len(s.gnss) and s.gnss[i_gnss, 0] <= t and s.gnss[i_gnss, 1] <= t_now:
            gnss = i_gnss if s.gnss[i_gnss, 0] > t - 0.1 else -1
            i_gnss += 1
        while i_baro < len(s.baro) and s.baro[i_baro, 0] <= t and s.baro[i_baro, 1] <= t_now:
            baro = i_baro if s.baro[i_baro, 0] > t - 0.1 else -1
            i_baro += 1
        while i_tas + 1 < len(s.airspeed) and s.airspeed[i_tas, 0] <= t and s.airspeed[i_tas, 1] <= t_now:
            tas = i_tas if s.airspeed[i_tas, 0] > t - 0.1 else -1
            i_tas += 1
        final, anomaly = False, False
        while i_final < len(s.final_resets) and s.final_resets[i_final] <= t_now + 0.03 and mag >= 0:
            final = s.final_resets[i_final] > t_now - 0.5
            i_final += 1
        while i_anomaly < len(s.anomaly_resets) and s.anomaly_resets[i_anomaly] <= t_now + 0.03 and mag >= 0:
            anomaly = s.anomaly_resets[i_anomaly] > t_now - 0.5
            i_anomaly += 1
        while i_compass < len(s.compass_changes) and s.compass_changes[i_compass] <= t_now:
            if s.compass_changes[i_compass] > s.steps[k - 1, 0]:
                change_compass(f, par)
            i_compass += 1
        if known.flown == 0.0 and known.compasses > 1.0 and c[ON_GROUND] == 0.0 and t_now - known.t_start > NEW_S:
            if t_now - c[T_MAG] > COMPASS_S:
                c[COMPASS] = (c[COMPASS] + 1.0) % known.compasses
                c[T_MAG] = t_now
                change_compass(f, par)
                mag = -1
        # 8 to 12: each phase says what is due; one place fuses
        for phase in range(4):
            rotation(x, r)
            if phase == 0:
                m = s.mag[max(mag, 0), 2:5]
                use_compass(f, par, known, w, m, mag >= 0, t, t_now, yaw_gsf, var_gsf, final, anomaly)
            elif phase == 2:
                move_to_imu(f, known, s.gnss[max(gnss, 0), 2:], w.gnss)
                height = s.baro[max(baro, 0), 2]
                measure_position(f, par, known, w, w.gnss, gnss >= 0, height, baro >= 0, s.steps[k, 10], armed, t_now)
            elif phase == 3:
                measure_air(f, par, known, w, s.airspeed[max(tas, 0), 2], tas >= 0, t_now)
            n_phase = 4 if phase < 2 else 7 if phase == 2 else 2
            for i in range(n_phase):
                if phase == 0:
                    kind = OBS_DECLINATION if i == 0 else i - 1
                elif phase == 1:
                    kind = i
                else:
                    kind = i + (OBS_VEL_N if phase == 2 else OBS_AIRSPEED)
                if w.due[kind] == 0.0:
                    continue
                fuse(f, par, known, w, kind, phase, t)
        if c[FIELD_LEARNED] == 0.0 and c[FINAL_MAG] > 0.0 and c[MAG_LEARN] > 0.0:
            if P[MI, MI] < 1e-4 and P[MI + 1, MI + 1] < 1e-4 and P[MI + 2, MI + 2] < 1e-4:
                c[FIELD_LEARNED] = 1.0
        if c[FIELD_LEARNED] > 0.0 and c[MAG_LEARN] > 0.0:
            for i in range(6):
                w.field_variance[i] = P[MI + i, MI + i]
        # 13: the output is pulled to the filter; a heading reset turned the whole ring
        correct_output(f, j % length, 0.5 * dt / max(t_now - t, dt))
        for i in range(4):
            o[i] = ring[k % length, i]
        for i in range(N_STATE):
            out_steps[j, i] = x[i]
        for i in range(N_ERR):
            out_steps[j, N_STATE + i] = P[i, i]
        out_steps[j, 47] = MAG_3D if c[MAG_LEARN] > 0.0 else MAG_YAW if known.compass > 0.0 else MAG_NONE
        out_steps[j, 48] = c[GNSS_ON]
        out_steps[j, 49] = c[TILT]
        out_steps[j, 50] = c[IN_FLIGHT]
        out_steps[j, 51] = c[FINAL_MAG]


def move_to_imu(f: Filter, known: Known, g: F1, out: Out1) -> None:
    """Move a GNSS sample from its antenna to the IMU: position by the lever arm, velocity by its rotation."""
    r, rate = f.r, f.rate
    x, y, z = known.arm_x, known.arm_y, known.arm_z
    vx, vy, vz = rate[1] * z - rate[2] * y, rate[2] * x - rate[0] * z, rate[0] * y - rate[1] * x
    for i in range(12):
        out[i] = g[i]
    for i in range(3):
        out[i] -= r[i, 0] * x + r[i, 1] * y + r[i, 2] * z
        out[3 + i] -= r[i, 0] * vx + r[i, 1] * vy + r[i, 2] * vz


def fuse(f: Filter, par: Parameters, known: Known, w: Work, kind: int, phase: int, t: float) -> None:
    """Fuse one observation that is due: prepare it, test it where it has a gate of its own, correct, limit.

    Compass axes come twice: tested in phase 0, and if all three pass corrected in phase 1 with the derivatives,
    innovations and variances of one linearisation.
    """
    x, c, full = f.x, f.c, f.full
    n, e, gate = 1, 0.0, 0.0
    for i in range(N_ERR):
        full[i] = f.mask[i]
    if kind < OBS_HEADING:
        n = 7
        if phase == 0:
            e = field_row(f, kind) - w.z[kind]
            gate = par.mag_i_gate
        else:
            for i in range(7):
                f.h_index[i] = TH + i if i < 3 else MI + i - 3
                f.h_value[i] = w.rows[kind, i]
            f.h_index[6] = MI + 3 + kind
            e = w.innovation[kind]
    elif kind == OBS_HEADING:
        n = 3
        predicted = heading_row(f, abs(f.r[2, 0]) < abs(f.r[2, 1]))
        gate = par.yaw_i_gate
        e = 0.0 if c[HEADING_KIND] == HEADING_PREDICTED else wrap(predicted - w.z[kind])
    elif kind == OBS_DECLINATION:
        n = 2
        e = min(max(declination_row(f) - w.z[kind], -0.5), 0.5)
    elif kind == OBS_AIRSPEED:
        n = 5
        e = airspeed_row(f) - w.z[kind]
        gate = par.eas_i_gate
    elif kind == OBS_SIDESLIP:
        n = 8
        e = sideslip_row(f, MIN_SIDESLIP_SPEED)
        if abs(e) > 0.5:
            return
    else:
        state = VEL + kind - OBS_VEL_N if kind <= OBS_POS_E else POS + 2
        f.h_index[0] = state
        f.h_value[0] = 1.0
        e = x[state + 1] - w.z[kind]
        if kind == OBS_BARO and c[GROUND_EFFECT] > 0.0:
            # pressure below the rotors is too high: the barometer may read too low by the dead zone
            e += min(max(-e - 0.5, 0.0), max(par.gnd_eff_dz - 0.5, 0.0))
        if c[GNSS_ON] == 0.0:
            # unaided: what the pseudo-measurement cannot see does not learn
            for i in range(3):
                if abs(f.r[2, i]) > math.sqrt(0.5):
                    full[BG + i] = 0.0
                if kind <= OBS_POS_E and kind != OBS_VEL_N + 2:
                    full[BA + i] = 0.0
    variance = innovation_variance(f, n, w.noise[kind])
    if kind < OBS_HEADING and phase == 1:
        variance = w.variance[kind]
    if gate > 0.0:
        ratio = e * e / (max(0.01 * gate, 1.0) ** 2 * variance)
        if c[HEADING_KIND] == HEADING_COMPASS or kind != OBS_HEADING:
            record(f, kind, t, e, variance, ratio)
        if kind < OBS_HEADING:
            w.innovation[kind] = e
            w.variance[kind] = variance
            for i in range(7):
                w.rows[kind, i] = f.h_value[i]
            if ratio >= 1.0:
                c[MAG_PASSED] = 0.0
            if kind < 2:
                c[MAG_RATIO] = max(ratio, c[MAG_RATIO] if kind > 0 else 0.0)
            if kind == 2:
                c[MAG_HEALTHY] = c[MAG_PASSED]
                for i in range(3):
                    w.due[i] = c[MAG_PASSED]
            return
        if kind == OBS_HEADING:
            c[MAG_RATIO] = ratio if c[HEADING_KIND] == HEADING_COMPASS else 0.0
            if c[HEADING_KIND] == HEADING_COMPASS:
                c[YAW_INNOVATION] = e
                c[MAG_HEALTHY] = 1.0 if ratio < 1.0 or c[ON_GROUND] > 0.0 or c[IN_FLIGHT] == 0.0 else 0.0
            if ratio >= 1.0 and c[IN_FLIGHT] > 0.0:
                return
            e = min(max(e, -0.5), 0.5)
        elif ratio >= 1.0:
            return
        else:
            c[T_AIRSPEED] = t
    if kind >= OBS_AIRSPEED and kind != OBS_DECLINATION and c[GNSS_ON] > 0.0 and int(par.beta_mask) & 1 == 0:
        set_mask(full, 0, WIND, 0.0)
    refused = False
    for i in range(N_ERR):
        if full[i] * f.ph[i] * f.ph[i] / variance > f.P[i, i]:
            refused = True
    if refused:
        return
    update(f, variance, e, full)
    limit_states(f, par, known, w)
    rotation(x, f.r)
