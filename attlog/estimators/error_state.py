"""Error-state Kalman filter shared by EKF2 and EKF3.

State ``x`` (24,): q (body FRD to earth NED, scalar first), velocity, position (NED, m), gyro bias (rad/s),
accelerometer bias (m/s^2), earth field, body field (gauss), wind (north, east). Error state (23,): rotation about earth
axes, then the others in the same order; q_true = exp(theta) * q. Innovation is prediction minus measurement.
A filter that keeps the covariance of the quaternion itself is the same to first order.

A function ``..._row`` fills the derivatives of one observation and returns what it predicts. Loops inline all
of this: each place that calls :func:`update` is compiled again.
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
NEVER = -1e9

# Kinds of observations in the log of innovations, in the order of :data:`attlog.estimators.rerun.AIDS`.
(
    OBS_MAG_X, OBS_MAG_Y, OBS_MAG_Z, OBS_HEADING, OBS_VEL_N, OBS_VEL_E, OBS_VEL_D, OBS_POS_N, OBS_POS_E,
    OBS_GNSS_HEIGHT, OBS_BARO, OBS_AIRSPEED, OBS_SIDESLIP, OBS_DECLINATION,
) = range(14)  # fmt: skip


class Filter(NamedTuple):
    """State, covariance, control state, parameters and the arrays that one step works with; filled in place."""

    x: Out1  # (24,)
    P: Out2  # (23, 23)
    c: Out1  # control state, by the filter's own names
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


def new_filter(length: int, log_size: int, n_control: int) -> Filter:
    """Return a filter at identity with no covariance: it starts from gravity at rest."""
    import numpy as np

    z = np.zeros
    x = z(N_STATE)
    x[0] = 1.0
    output = z(4)
    output[0] = 1.0
    return Filter(
        x, z((N_ERR, N_ERR)), z(n_control), z((3, 3)), z((3, 3)), z(3), z(3), z(N_ERR), np.ones(N_ERR),
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


def strapdown(f: Filter, latitude: float, dt: float, at_end: bool) -> None:
    """Strapdown over one step by the bias-free rate and force, which is in the axes of the step's start or end."""
    x, r, rate, force, end = f.x, f.r, f.rate, f.force, f.r_new
    wn, wd = EARTH_RATE * math.cos(latitude), -EARTH_RATE * math.sin(latitude)
    ex = r[0, 0] * wn + r[2, 0] * wd
    ey = r[0, 1] * wn + r[2, 1] * wd
    ez = r[0, 2] * wn + r[2, 2] * wd
    turn_body(x, (rate[0] - ex) * dt, (rate[1] - ey) * dt, (rate[2] - ez) * dt)
    for i in range(3):
        for j in range(3):
            end[i, j] = r[i, j]
    if at_end:
        rotation(x, end)
    for i in range(3):
        before = x[4 + i]
        a = end[i, 0] * force[0] + end[i, 1] * force[1] + end[i, 2] * force[2]
        x[4 + i] += a * dt + (G * dt if i == 2 else 0.0)
        x[7 + i] += 0.5 * dt * (before + x[4 + i])


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


def field_row(f: Filter, axis: int) -> float:
    """Prepare one axis of the field and return it predicted: (R' mI + mB)_axis in gauss."""
    x, r, h_index, h_value = f.x, f.r, f.h_index, f.h_value
    # dh/dtheta = row of R' [mI]x, dh/dmI = row of R', dh/dmB = 1
    a, b, c = x[16], x[17], x[18]
    r0, r1, r2 = r[0, axis], r[1, axis], r[2, axis]
    h_index[0], h_index[1], h_index[2] = TH, TH + 1, TH + 2
    h_value[0] = r1 * c - r2 * b
    h_value[1] = r2 * a - r0 * c
    h_value[2] = r0 * b - r1 * a
    for k in range(3):
        h_index[3 + k] = MI + k
    h_value[3], h_value[4], h_value[5] = r0, r1, r2
    h_index[6] = MB + axis
    h_value[6] = 1.0
    return float(r0 * a + r1 * b + r2 * c + x[19 + axis])


def declination_row(f: Filter) -> float:
    """Prepare the direction of the earth field's horizontal part and return it in rad."""
    x, h_index, h_value = f.x, f.h_index, f.h_value
    n2 = x[16] ** 2 + x[17] ** 2
    h_index[0], h_index[1] = MI, MI + 1
    h_value[0], h_value[1] = -x[17] / n2, x[16] / n2
    return math.atan2(x[17], x[16])


def heading_row(f: Filter, by_nose: bool) -> float:
    """Prepare a heading and return it in rad: of the x axis (order 321), else of the y axis (order 312)."""
    r, h_index, h_value = f.r, f.h_index, f.h_value
    h_index[0], h_index[1], h_index[2] = TH, TH + 1, TH + 2
    h_value[2] = 1.0
    if by_nose:
        n = r[0, 0] ** 2 + r[1, 0] ** 2
        h_value[0], h_value[1] = -r[0, 0] * r[2, 0] / n, -r[1, 0] * r[2, 0] / n
        return math.atan2(r[1, 0], r[0, 0])
    n = r[0, 1] ** 2 + r[1, 1] ** 2
    h_value[0], h_value[1] = -r[0, 1] * r[2, 1] / n, -r[1, 1] * r[2, 1] / n
    return math.atan2(-r[0, 1], r[1, 1])


def airspeed_row(f: Filter) -> float:
    """Prepare the true airspeed and return it in m/s; below 0.1 m/s the derivatives mean nothing."""
    x, h_index, h_value = f.x, f.h_index, f.h_value
    vx, vy, vz = x[4] - x[22], x[5] - x[23], x[6]
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    inverse = 1.0 / max(speed, 0.1)
    for k in range(3):
        h_index[k] = VEL + k
    h_value[0], h_value[1], h_value[2] = vx * inverse, vy * inverse, vz * inverse
    h_index[3], h_index[4] = WIND, WIND + 1
    h_value[3], h_value[4] = -vx * inverse, -vy * inverse
    return speed


def sideslip_row(f: Filter, least: float) -> float:
    """Prepare the sideslip and return it: body y over x of the air velocity; 1e3 below ``least`` m/s forward."""
    x, r, h_index, h_value = f.x, f.r, f.h_index, f.h_value
    vx, vy, vz = x[4] - x[22], x[5] - x[23], x[6]
    bx = r[0, 0] * vx + r[1, 0] * vy + r[2, 0] * vz
    by = r[0, 1] * vx + r[1, 1] * vy + r[2, 1] * vz
    if abs(bx) < least:
        return 1e3
    # d(body velocity)/dtheta = R' [v]x
    for k in range(3):
        h_index[k] = TH + k
        h_index[3 + k] = VEL + k
        if k == 0:
            dx, dy = r[1, 0] * vz - r[2, 0] * vy, r[1, 1] * vz - r[2, 1] * vy
        elif k == 1:
            dx, dy = r[2, 0] * vx - r[0, 0] * vz, r[2, 1] * vx - r[0, 1] * vz
        else:
            dx, dy = r[0, 0] * vy - r[1, 0] * vx, r[0, 1] * vy - r[1, 1] * vx
        h_value[k] = (dy * bx - by * dx) / (bx * bx)
        h_value[3 + k] = (r[k, 1] * bx - by * r[k, 0]) / (bx * bx)
    h_index[6], h_index[7] = WIND, WIND + 1
    h_value[6], h_value[7] = -h_value[3], -h_value[4]
    return float(by / bx)


def correct_output(f: Filter, j: int, share: float) -> None:
    """Set the rotation that pulls the output to the filter: ``share`` of the delayed output's error (slot ``j``)."""
    x, ring, correction = f.x, f.ring, f.correction
    b0, b1, b2, b3 = ring[j, 0], ring[j, 1], ring[j, 2], ring[j, 3]
    e0 = x[0] * b0 + x[1] * b1 + x[2] * b2 + x[3] * b3
    sign = 1.0 if e0 >= 0.0 else -1.0
    ev1 = x[0] * b1 - x[1] * b0 - x[2] * b3 + x[3] * b2
    ev2 = x[0] * b2 + x[1] * b3 - x[2] * b0 - x[3] * b1
    ev3 = x[0] * b3 - x[1] * b2 + x[2] * b1 - x[3] * b0
    correction[0] = -2.0 * sign * ev1 * share
    correction[1] = -2.0 * sign * ev2 * share
    correction[2] = -2.0 * sign * ev3 * share
