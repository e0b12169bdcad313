"""One step of EKF2 after the other: prediction, aids whose time has come, rest, heading, output predictor."""

from __future__ import annotations

import math
from typing import NamedTuple

from attlog.core import jit
from attlog.core.jit import F2, Out2
from attlog.estimators.ekf2.observations import (
    align_field,
    emergency_heading,
    field_logic,
    fuse_gnss,
    fuse_heading,
    fuse_height,
    fuse_wind,
)
from attlog.estimators.ekf2.state import (
    ACC_E,
    ACC_ENV,
    ACC_N,
    ALIGNED,
    BAD_HGT,
    BAD_VEL,
    BARO_COUNT,
    BARO_OFF,
    BARO_VAR,
    ERA_B,
    ERA_C,
    ERA_D,
    FALSE_E,
    FALSE_N,
    FIELD_N,
    FORCE_N,
    GH_COUNT,
    GH_OFF,
    GH_VAR,
    GNSS_ON,
    GOOD_SINCE,
    GRAV_ENV,
    GROUND,
    GYRO_ENV,
    MAG_MODE,
    MAG_SINCE,
    REST_N,
    REST_X,
    REST_Y,
    REST_Z,
    T_ALIGNED,
    T_BAD_ACC,
    T_FALSE,
    T_GNSS,
    T_HEADING,
    T_LANDED,
    T_ZERO,
    TILT,
    YAW,
    YAW_RATE,
    Known,
    Parameters,
    cold_start,
    gravity_start,
    limit_states,
    process_noise,
)
from attlog.estimators.error_state import (
    BA,
    BG,
    OBS_BARO,
    OBS_GNSS_HEIGHT,
    POS,
    TH,
    VEL,
    Filter,
    G,
    correct_output,
    forget_rows,
    fuse_direct,
    heading_of,
    innovation_variance,
    predict_covariance,
    rotation,
    strapdown,
    turn_body,
    update,
)


class Samples(NamedTuple):
    """All that a run reads, in rows. Times are s since boot; ``due``: when a sample is fused at the delayed time."""

    imu: F2  # (n, 4) duration, gyro rad/s
    # (k, 14) time, rate (3), force (3), duration, clip bits, landed, at rest, ground effect, last IMU sample,
    # GNSS in use as logged (-1: by the filter's own checks)
    steps: F2
    mag: F2  # (m, 6) due, arrival, field (3), share of an onboard sample
    gnss: F2  # (g, 13) due, arrival, position NED, velocity NED, eph, epv, sacc, fix, satellites
    baro: F2  # (b, 3) due, arrival, height down in m
    airspeed: F2  # (a, 3) due, arrival, true airspeed in m/s
    gsf: F2  # (s, 3) time, heading, variance of the bank of yaw hypotheses
    resets: F2  # (l, 2) when the log resets the heading; 0 alignment in flight, 1 emergency


@jit.loop("PX4's EKF2")
def run_filter(
    f: Filter, par: Parameters, known: Known, s: Samples, first: int, last: int, out_q: Out2, out_steps: Out2
) -> None:
    """Run the steps ``first`` to ``last``.

    ``out_q`` (n, 4) takes the output attitude at every IMU sample, ``out_steps`` (k, 25) of each step: variances of
    theta and velocity, gyro and accelerometer bias, mode of the magnetometer, GNSS, tilt aligned, aligned in flight,
    variances of both biases, body field.
    """
    x, P, c, r, rate, force, mask, o = f.x, f.P, f.c, f.r, f.rate, f.force, f.mask, f.output
    length = int(known.length)
    era = known.era
    ring, correction = f.ring, f.correction
    i_mag, i_gnss, i_baro, i_tas, i_gsf, i_reset = 0, 0, 0, 0, 0, 0
    started = P[0, 0] > 0.0
    ring_ready = False
    sample = int(s.steps[first - 1, 12]) + 1 if first > 0 else 0
    for k in range(first, last):
        t_now = s.steps[k, 0]
        # output predictor over this step's samples
        while sample <= s.steps[k, 12]:
            dt = s.imu[sample, 0]
            if ring_ready:
                turn_body(
                    o,
                    (s.imu[sample, 1] - x[10]) * dt + correction[0],
                    (s.imu[sample, 2] - x[11]) * dt + correction[1],
                    (s.imu[sample, 3] - x[12]) * dt + correction[2],
                )
                for i in range(4):
                    out_q[sample, i] = o[i]
            sample += 1
        j = k - length + 1
        if j < first:
            continue
        t = s.steps[j, 0]
        for i in range(3):
            rate[i] = s.steps[j, 1 + i]
            force[i] = s.steps[j, 4 + i]
        dt = s.steps[j, 7]
        if not started:
            if gravity_start(f) and c[FORCE_N] > 10:
                cold_start(f, par, known)
                started = True
                c[MAG_SINCE] = t
                c[GOOD_SINCE] = t
            else:
                continue
        if not ring_ready:
            # the ring of outputs begins at the delayed attitude and runs on with the gyro
            for i in range(4):
                o[i] = x[i]
            for b in range(j, k + 1):
                if b > j:
                    turn_body(
                        o,
                        (s.steps[b, 1] - x[10]) * s.steps[b, 7],
                        (s.steps[b, 2] - x[11]) * s.steps[b, 7],
                        (s.steps[b, 3] - x[12]) * s.steps[b, 7],
                    )
                for i in range(4):
                    ring[b % length, i] = o[i]
            ring_ready = True
        else:
            for i in range(4):
                ring[k % length, i] = o[i]
        in_air = s.steps[j, 9] == 0.0
        rest = s.steps[j, 10] > 0.0
        rotation(x, r)
        for i in range(3):
            rate[i] -= x[10 + i]
        # envelopes that stop the learning of accelerometer biases
        alpha = min(dt / max(par.abl_tau, 0.1), 1.0)
        size = math.sqrt(rate[0] ** 2 + rate[1] ** 2 + rate[2] ** 2)
        c[GYRO_ENV] = max(size, (1.0 - alpha) * c[GYRO_ENV])
        size = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
        c[ACC_ENV] = max(size, (1.0 - alpha) * c[ACC_ENV])
        # EKF2's gravity test: the force, low-passed, within a tenth of gravity
        c[GRAV_ENV] += min(dt / 0.5, 1.0) * (size - c[GRAV_ENV]) if c[GRAV_ENV] > 0.0 else size
        stop_learning = c[GYRO_ENV] > par.abl_gyrlim or c[ACC_ENV] > par.abl_acclim or int(s.steps[j, 8]) != 0
        false_position = c[GNSS_ON] == 0.0
        for i in range(3):
            learns = not stop_learning
            if era <= ERA_B:
                if not in_air and abs(r[2, i]) < 0.8:
                    learns = False
            elif false_position and not rest and abs(r[2, i]) < 0.966:
                learns = False
            mask[BA + i] = 1.0 if learns else 0.0
            if not learns and era != ERA_D:
                v = P[BA + i, BA + i]
                forget_rows(P, BA + i, 1, v)
        for i in range(3):
            force[i] -= x[13 + i]
        process_noise(f, par, known, dt, int(s.steps[j, 8]), t)
        predict_covariance(f, dt)
        strapdown(f, known.latitude, dt, True)
        limit_states(f, par, known)
        # horizontal acceleration and yaw rate, low-passed with 1 s
        an = r[0, 0] * force[0] + r[0, 1] * force[1] + r[0, 2] * force[2]
        ae = r[1, 0] * force[0] + r[1, 1] * force[1] + r[1, 2] * force[2]
        a1 = dt / (1.0 + dt)
        c[ACC_N] += a1 * (an - c[ACC_N])
        c[ACC_E] += a1 * (ae - c[ACC_E])
        spin = r[2, 0] * rate[0] + r[2, 1] * rate[1] + r[2, 2] * rate[2]
        c[YAW_RATE] += a1 * (spin - c[YAW_RATE])
        rotation(x, r)
        if c[TILT] == 0.0 and P[TH, TH] + P[TH + 1, TH + 1] < math.radians(3.0) ** 2:
            c[TILT] = 1.0
        while i_gsf + 1 < len(s.gsf) and s.gsf[i_gsf + 1, 0] <= t_now:
            i_gsf += 1
        yaw_gsf, var_gsf = 0.0, 0.0
        if len(s.gsf) and s.gsf[i_gsf, 0] <= t_now:
            yaw_gsf, var_gsf = s.gsf[i_gsf, 1], s.gsf[i_gsf, 2]
        # height above where it took off; the in-flight alignment
        if not in_air:
            c[GROUND] = x[9]
            c[T_LANDED] = t
        align = known.flown_alignment == 0.0 and in_air and c[ALIGNED] == 0.0 and c[GROUND] - x[9] > 1.5
        while i_reset < len(s.resets) and s.resets[i_reset, 0] <= t_now:
            if s.resets[i_reset, 0] > s.steps[k - 1, 0] and c[YAW] > 0.0:
                if s.resets[i_reset, 1] > 0.0:
                    emergency_heading(f, yaw_gsf, var_gsf)
                else:
                    align = True
            i_reset += 1
        if align and c[YAW] > 0.0:
            c[ALIGNED] = 1.0
            if known.reset_in_climb > 0 and c[FIELD_N] > 0 and par.mag_type != 5.0:
                align_field(f, par, known, t, yaw_gsf, var_gsf, False)
                c[T_ALIGNED] = t
        # observations whose time has come
        while i_mag < len(s.mag) and s.mag[i_mag, 0] <= t and s.mag[i_mag, 1] <= t_now:
            if s.mag[i_mag, 0] > t - 0.3:
                field_logic(f, par, known, s.mag[i_mag, 2:5], t, in_air, rest, yaw_gsf, var_gsf, s.mag[i_mag, 5])
            i_mag += 1
        while i_gnss < len(s.gnss) and s.gnss[i_gnss, 0] <= t and s.gnss[i_gnss, 1] <= t_now:
            if s.gnss[i_gnss, 0] > t - 0.3:
                fuse_gnss(f, par, known, s.gnss[i_gnss, 2:], t, s.steps[j, 13], in_air, yaw_gsf, var_gsf)
                rotation(x, r)
                if int(par.gps_ctrl) & 2 and (era >= ERA_C or par.hgt_ref == 1.0) and s.gnss[i_gnss, 11] >= 3:
                    height_noise = max(s.gnss[i_gnss, 9], 1.5 * par.gps_p_noise, 0.01) ** 2
                    fuse_height(
                        f, s.gnss[i_gnss, 4], height_noise, par.gps_p_gate, par.hgt_ref == 1.0, GH_OFF, GH_VAR,
                        GH_COUNT, OBS_GNSS_HEIGHT, t, known.n_gnss, 0.0,
                    )  # fmt: skip
            i_gnss += 1
        if s.steps[j, 13] >= 0.0:
            stops = s.steps[j, 13] == 0.0
        else:
            stops = t - c[T_GNSS] > (7.0 if era == ERA_D else 10.0)
        if c[GNSS_ON] > 0.0 and stops:
            c[GNSS_ON] = 0.0
            c[FALSE_N], c[FALSE_E] = x[7], x[8]
            if era != ERA_D:
                c[GOOD_SINCE] = 1e12
        if c[GNSS_ON] == 0.0 and c[GOOD_SINCE] > 1e11 and t - c[T_GNSS] < 1.0:
            c[GOOD_SINCE] = t
        while i_tas < len(s.airspeed) and s.airspeed[i_tas, 0] <= t and s.airspeed[i_tas, 1] <= t_now:
            if s.airspeed[i_tas, 0] > t - 0.3 and in_air and par.arsp_thr > 0.0 and s.airspeed[i_tas, 2] > par.arsp_thr:
                fuse_wind(f, par, s.airspeed[i_tas, 2], t)
                if par.fuse_beta > 0.0:
                    fuse_wind(f, par, 0.0, t)
                rotation(x, r)
            i_tas += 1
        while i_baro < len(s.baro) and s.baro[i_baro, 0] <= t and s.baro[i_baro, 1] <= t_now:
            if s.baro[i_baro, 0] > t - 0.3 and par.baro_ctrl > 0.0 and (era >= ERA_C or par.hgt_ref == 0.0):
                zone = par.gnd_eff_dz if s.steps[j, 11] > 0.0 else 0.0
                fuse_height(
                    f, s.baro[i_baro, 2], max(par.baro_noise, 0.01) ** 2, par.baro_gate, par.hgt_ref == 0.0, BARO_OFF,
                    BARO_VAR, BARO_COUNT, OBS_BARO, t, known.n_baro, zone,
                )  # fmt: skip
            i_baro += 1
        # upward velocity and height innovations together: the accelerometer is wrong
        if c[BAD_VEL] > 3.0 and c[BAD_HGT] > 3.0:
            c[T_BAD_ACC] = t
        # at rest
        if rest:
            c[REST_N] += 1.0
            c[REST_X] += s.steps[j, 1]
            c[REST_Y] += s.steps[j, 2]
            c[REST_Z] += s.steps[j, 3]
            if t - c[T_ZERO] > 0.2:
                c[T_ZERO] = t
                if c[TILT] == 0.0 or c[GNSS_ON] == 0.0:
                    sigma = 0.001 if c[TILT] == 0.0 else 0.2
                    for i in range(3):
                        fuse_direct(f, VEL + i, x[4 + i], sigma * sigma)
                if era >= ERA_C and c[REST_N] > 0.0:
                    mean = (c[REST_X] / c[REST_N], c[REST_Y] / c[REST_N], c[REST_Z] / c[REST_N])
                    for i in range(3):
                        fuse_direct(f, BG + i, x[10 + i] - mean[i], par.gyr_noise**2)
                c[REST_N], c[REST_X], c[REST_Y], c[REST_Z] = 0.0, 0.0, 0.0, 0.0
        else:
            c[REST_N], c[REST_X], c[REST_Y], c[REST_Z] = 0.0, 0.0, 0.0, 0.0
        # false position without GNSS, gravity
        if c[GNSS_ON] == 0.0:
            tilt_unsure = P[TH, TH] + P[TH + 1, TH + 1] > math.radians(3.0) ** 2
            if (era <= ERA_B or rest or tilt_unsure) and t - c[T_FALSE] > 0.2:
                c[T_FALSE] = t
                if in_air and c[TILT] > 0.0:
                    sigma = max(par.noaid_noise, 0.5)
                elif rest:
                    sigma = 0.1 if era <= ERA_B else 0.01
                else:
                    sigma = 0.5
                for i in range(2):
                    e = x[7 + i] - (c[FALSE_N] if i == 0 else c[FALSE_E])
                    fuse_direct(f, POS + i, e, sigma * sigma)
            if era >= ERA_C and int(par.imu_ctrl) & 4 and 0.9 * G < c[GRAV_ENV] < 1.1 * G:
                rotation(x, r)
                size = math.sqrt(s.steps[j, 4] ** 2 + s.steps[j, 5] ** 2 + s.steps[j, 6] ** 2)
                for i in range(3):
                    # h = -(row i of R')_down; dh/dtheta = row i of R' [(0, 0, -1)]x
                    f.h_index[0], f.h_index[1] = TH, TH + 1
                    f.h_value[0], f.h_value[1] = -r[1, i], r[0, i]
                    var = innovation_variance(f, 2, par.grav_noise**2)
                    e = -r[2, i] - (s.steps[j, 4 + i] - x[13 + i]) / size
                    if e * e <= 0.25 * 0.25 * var:
                        update(f, var, e, mask)
        else:
            c[FALSE_N], c[FALSE_E] = x[7], x[8]
        # no heading source for a second
        if t - c[T_HEADING] > 1.0:
            rotation(x, r)
            if c[TILT] == 0.0:
                fuse_heading(f, heading_of(x), 1e-3, 1e3, False, mask, t, 1.0, False)
            elif P[TH + 2, TH + 2] > par.head_noise**2 and (era == ERA_D or rest):
                fuse_heading(f, heading_of(x), 0.25, 1e3, False, mask, t, 1.0, False)
        limit_states(f, par, known)
        # correct the output: the delayed output attitude is pulled to the filter's
        if ring_ready:
            correct_output(f, j % length, 0.5 * known.imu_period / max(t_now - t, known.imu_period))
            # a heading reset turned the whole ring: the newest output follows it
            for i in range(4):
                o[i] = ring[k % length, i]
        for i in range(3):
            out_steps[j, i] = P[TH + i, TH + i]
            out_steps[j, 3 + i] = P[VEL + i, VEL + i]
            out_steps[j, 6 + i] = x[10 + i]
            out_steps[j, 9 + i] = x[13 + i]
            out_steps[j, 16 + i] = P[BG + i, BG + i]
            out_steps[j, 19 + i] = P[BA + i, BA + i]
            out_steps[j, 22 + i] = x[19 + i]
        out_steps[j, 12] = c[MAG_MODE]
        out_steps[j, 13] = c[GNSS_ON]
        out_steps[j, 14] = c[TILT]
        out_steps[j, 15] = c[ALIGNED]
