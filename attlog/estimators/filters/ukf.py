"""Unscented Kalman filter for attitude and gyro bias: thirteen attitudes carry the uncertainty, no Jacobian does.

    error  x = (p, db),  p = 4 n tan(angle/4): generalised Rodrigues vector, a = 1, f = 4                     (31-33)
           true q = q (x) dq(p),  dq = ((16 - |p|^2), 8 p) / (16 + |p|^2),  body axes
    points x_0 = 0,  x_i = +- sqrt(7) column i of the Cholesky factor of P,  weights 1/7 and 1/14              (5-7)
    turn   p_i' of exp(-(w - b) dt) (x) dq(p_i) (x) exp((w - b - db_i) dt)                                  (34-37)
           P' = cov(p_i', db_i) + diag(gyro_noise^2 + rate_noise^2 |w|^2, bias_noise^2) dt
    force  f   against  -g R_i^T e_z,            noise (acc_noise^2 + acc_factor <|f - expected|^2>) / dt
    field  -psi  against  heading of R_i R^T (h, 0, z),  psi, h, z: heading, length, height of R m
                                                 noise mag_noise^2 / (time since the last sample)
           K = cov(x, y) cov(y)^-1,  of the field only d d^T K for the attitude, d = R^T e_z                 (8-12)

Source: Crassidis2003 (USQUE; equation numbers above), lambda = 1, a = 1. Sigma of tilt and heading and both innovations
in units of their expected size are auxiliary outputs.

Departures. Of a plane that tells its airspeed, f is the force without its turns (``engine/airspeed.py``). The field
corrects heading and bias, its share of the tilt enters the covariance only (Schmidt). What the points see is asked of
the field as expected: with the measured one its noise stands in gain and innovation and becomes a bias (8 deg of tilt
with 2.7 deg of noise a sample). Noise is added once per step, not half before and half after. The field counts as
heading, not as vector, and not while its norm or dip deviates from what they were (after 60 s of that with a quarter of
its weight); an innovation beyond ``gate`` sigmas weighs less. Forces beside gravity raise their own noise, with a mean
over 8 s: accelerations of a body that does not fly away cancel as vectors if the filter waits. A mean force that stays
off by more than its sigma, and a heading that stays beyond the gate for 10 s, open the covariance again.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from attlog.estimators.aids import AIR_AGE, AIRSPEED, AT_REST, NEVER, update_airspeed, without_acceleration
from attlog.estimators.interface import Parameter
from attlog.estimators.vectors import GRAVITY, down, half_angle

SOURCE = "Crassidis2003 5-12, 31-37"
NEEDS = {"gyro", "acc"}
USES = {"mag", "airspeed", "at_rest"}
HOLD_MAG = False
STATE = {
    "q": 4,
    "bias": 3,
    "sigma_tilt": 1,
    "sigma_heading": 1,
    "ratio_force": 1,
    "ratio_field": 1,
    "_covariance": 36,
    "_points": 72,
    "_seen": 36,
    "_gain": 18,
    "_force": 4,
    "_field": 9,
    "_airspeed": 5,
}
SIGMA, RATIO, P, X, Y, K = 7, 9, 11, 47, 119, 155
FORCE_VAR, FORCE_MEAN, SINCE, NORM, DIP, LEARNT, GOOD, BAD, GATED, LEVEL = (
    173,
    174,
    177,
    178,
    179,
    180,
    181,
    182,
    183,
    184,
)
AIR = 186
SIZE = 191
"""Where things stand in the state. Point i is six numbers at X + 6 i; what it sees, three numbers at Y + 3 i."""

ROOT, W0, WI = math.sqrt(7.0), 1.0 / 7.0, 1.0 / 14.0
RAD = math.pi / 180.0
LEAST_HEADING = 3.0 * RAD
MEAN_S, VAR_S, VAR_MOST = 3.0, 8.0, 400.0
LEARN_S, FOLLOW_S, GOOD_S, BAD_S, GATED_S, SMOOTH_S = 10.0, 15.0, 0.5, 60.0, 10.0, 0.1
LEAST_FIELD_S, MOST_FIELD_S = 1e-3, 0.2
AIR_NOISE, AIR_FACTOR = 0.6, 0.1
"""Once airspeed has taken turns out of the force, what is left is more, and shorter: at least, at most."""

PARAMETERS = (
    Parameter("gyro_noise", 0.03, "deg/sqrt(s)", 1e-5, 10, "random walk of the attitude by the gyro", "attlog"),
    Parameter("rate_noise", 0.005, "sqrt(s)", 0, 1, "what gyro scale errors add in a turn: walk per rate", "attlog"),
    Parameter("bias_noise", 0.002, "deg/s/sqrt(s)", 0, 10, "random walk of the gyro bias", "attlog"),
    Parameter("bias_sigma", 0.65, "deg/s", 1e-4, 100, "gyro bias expected at the start", "attlog"),
    Parameter("tilt_sigma", 2.0, "deg", 0.01, 90, "tilt error expected at the start", "attlog"),
    Parameter("heading_sigma", 10.0, "deg", 0.01, 180, "heading error expected at the start", "attlog"),
    Parameter("acc_noise", 0.3, "m/s^2*sqrt(s)", 1e-4, 100, "density of forces beside gravity", "attlog"),
    Parameter("acc_factor", 0.5, "s", 0, 100, "how much their mean square adds: their correlation time", "attlog"),
    Parameter("mag_noise", 8.0, "deg*sqrt(s)", 0.01, 1000, "noise density of the heading of the field", "attlog"),
    Parameter("gate", 2.0, "", 0.1, 100, "sigmas beyond which a heading weighs less", "attlog"),
    Parameter("norm_limit", 0.1, "", 1e-3, 10, "deviation of the field's norm that is a disturbance", "Laidig2023"),
    Parameter("dip_limit", 5.0, "deg", 0.1, 90, "deviation of the field's dip that is a disturbance", "attlog"),
)
PRESETS: dict[str, dict[str, float | str]] = {}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: as sure of the start attitude as it agrees with the vectors."""
    state = np.zeros(SIZE)
    state[0:4] = q0
    state[AIR + AIR_AGE] = NEVER
    dx, dy, dz = down(state)
    square = float(np.sum(acc * acc))
    cosine = -(acc[0] * dx + acc[1] * dy + acc[2] * dz) / math.sqrt(square) if square > 0.0 else -1.0
    # A horizontal acceleration a makes |f|^2 = g^2 + a^2; a tenth of g apart, which faulty sensors have at rest.
    moved = math.sqrt(max(abs(square / (GRAVITY * GRAVITY) - 1.0) - 0.1, 0.0))
    tilt = max(RAD * params[4], math.acos(min(max(cosine, -1.0), 1.0)), min(math.atan(moved), math.pi))
    hx, hy, _ = rotated(q0[0], q0[1], q0[2], q0[3], mag[0], mag[1], mag[2])
    off = abs(math.atan2(hy, hx)) if hx != 0.0 or hy != 0.0 else math.pi
    for i in range(3):
        state[P + 7 * i] = tilt * tilt
        state[P + 7 * i + 21] = (RAD * params[3]) ** 2
    # A tilt error e is one of e tan(dip) in the heading that was found with it.
    open_heading(state, max(RAD * params[5], off, 2.0 * tilt) ** 2 - tilt * tilt)
    report(state)
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any, aid: Any) -> None:
    """One update: force, field where new, turn."""
    update_airspeed(state, AIR, dt, aid[AIRSPEED], aid[AT_REST] == 1.0)
    fx, fy, fz = without_acceleration(state, AIR, acc, gyr[1] - state[5], gyr[2] - state[6])
    if fx != 0.0 or fy != 0.0 or fz != 0.0:
        correct_by_force(state, params, dt, fx, fy, fz)
    state[SINCE] += dt
    if mag[0] != 0.0 or mag[1] != 0.0 or mag[2] != 0.0:
        since = min(max(state[SINCE], LEAST_FIELD_S), MOST_FIELD_S)
        state[SINCE] = 0.0
        correct_by_field(state, params, since, mag[0], mag[1], mag[2])
    predict(state, params, dt, gyr[0], gyr[1], gyr[2])
    report(state)


def draw(state: Any) -> None:
    """The points x_1 to x_12 of P: columns of its Cholesky factor times sqrt(7), and their opposites."""
    for j in range(6):
        for i in range(6):
            a = X + 12 * j + i
            if i < j:
                state[a] = 0.0
            else:
                s = state[P + 6 * i + j]
                for k in range(j):
                    s -= state[X + 12 * k + i] * state[X + 12 * k + j] / 7.0
                if i == j:
                    state[a] = ROOT * math.sqrt(max(s, 1e-18))
                else:
                    state[a] = 7.0 * s / state[X + 12 * j + j]
    for j in range(6):
        for i in range(6):
            state[X + 12 * j + 6 + i] = -state[X + 12 * j + i]


def predict(state: Any, params: Any, dt: float, gx: float, gy: float, gz: float) -> None:
    """Attitude, points and covariance turned by the gyro."""
    draw(state)
    wx = gx - state[4]
    wy = gy - state[5]
    wz = gz - state[6]
    e0, e1, e2, e3 = turned(1.0, 0.0, 0.0, 0.0, wx, wy, wz, dt)
    mx = 0.0
    my = 0.0
    mz = 0.0
    for i in range(12):
        a = X + 6 * i
        p0, p1, p2, p3 = from_rodrigues(state[a], state[a + 1], state[a + 2])
        p0, p1, p2, p3 = turned(p0, p1, p2, p3, wx - state[a + 3], wy - state[a + 4], wz - state[a + 5], dt)
        # Relative to the middle: conj(e) (x) p, with the sign that makes it the shorter way.
        r0 = e0 * p0 + e1 * p1 + e2 * p2 + e3 * p3
        s = 4.0 / (1.0 + abs(r0))
        s = s if r0 >= 0.0 else -s
        x = s * (e0 * p1 - e1 * p0 - e2 * p3 + e3 * p2)
        y = s * (e0 * p2 - e2 * p0 - e3 * p1 + e1 * p3)
        z = s * (e0 * p3 - e3 * p0 - e1 * p2 + e2 * p1)
        state[Y + 3 * i] = x
        state[Y + 3 * i + 1] = y
        state[Y + 3 * i + 2] = z
        mx += WI * x
        my += WI * y
        mz += WI * z
    for i in range(3):
        for j in range(i, 3):
            mi = mx if i == 0 else my if i == 1 else mz
            mj = mx if j == 0 else my if j == 1 else mz
            s = W0 * mi * mj
            for k in range(12):
                s += WI * (state[Y + 3 * k + i] - mi) * (state[Y + 3 * k + j] - mj)
            state[P + 6 * i + j] = s
            state[P + 6 * j + i] = s
        for j in range(3, 6):
            s = 0.0
            for k in range(12):
                s += WI * state[Y + 3 * k + i] * state[X + 6 * k + j]
            state[P + 6 * i + j] = s
            state[P + 6 * j + i] = s
    walk = (RAD * params[0]) ** 2 + params[1] * params[1] * (wx * wx + wy * wy + wz * wz)
    drift = RAD * params[2]
    for i in range(3):
        state[P + 7 * i] += walk * dt
        state[P + 7 * i + 21] += drift * drift * dt
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    state[0], state[1], state[2], state[3] = turned(q0, q1, q2, q3, wx, wy, wz, dt)
    inject(state, mx, my, mz, 0.0, 0.0, 0.0)


def expected_forces(state: Any, dx: float, dy: float, dz: float) -> tuple[float, float, float]:
    """The force (3,) m/s^2, body axes, at each point to Y; their mean. ``d`` is the earth's down as the mean has it."""
    ax = -W0 * GRAVITY * dx
    ay = -W0 * GRAVITY * dy
    az = -W0 * GRAVITY * dz
    for i in range(12):
        a = X + 6 * i
        c0, c1, c2, c3 = from_rodrigues(state[a], state[a + 1], state[a + 2])
        ux, uy, uz = rotated(c0, -c1, -c2, -c3, dx, dy, dz)
        state[Y + 3 * i] = -GRAVITY * ux
        state[Y + 3 * i + 1] = -GRAVITY * uy
        state[Y + 3 * i + 2] = -GRAVITY * uz
        ax -= WI * GRAVITY * ux
        ay -= WI * GRAVITY * uy
        az -= WI * GRAVITY * uz
    return ax, ay, az


def inverse(
    xx: float, xy: float, xz: float, yy: float, yz: float, zz: float
) -> tuple[float, float, float, float, float, float]:
    """The inverse of a symmetric matrix (3, 3) by its upper triangle: cofactors by determinant."""
    ixx = yy * zz - yz * yz
    ixy = xz * yz - xy * zz
    ixz = xy * yz - xz * yy
    inv = 1.0 / (xx * ixx + xy * ixy + xz * ixz)
    iyy = inv * (xx * zz - xz * xz)
    iyz = inv * (xy * xz - xx * yz)
    izz = inv * (xx * yy - xy * xy)
    return ixx * inv, ixy * inv, ixz * inv, iyy, iyz, izz


def reduce_by_force(state: Any, ixx: float, ixy: float, ixz: float, iyy: float, iyz: float, izz: float) -> None:
    """P -= C S^-1 C^T: C of error and force stays in K; S^-1 by its upper triangle."""
    for i in range(6):
        cx = 0.0
        cy = 0.0
        cz = 0.0
        for k in range(12):
            w = WI * state[X + 6 * k + i]
            cx += w * state[Y + 3 * k]
            cy += w * state[Y + 3 * k + 1]
            cz += w * state[Y + 3 * k + 2]
        state[K + 3 * i] = cx
        state[K + 3 * i + 1] = cy
        state[K + 3 * i + 2] = cz
    for i in range(6):
        cx = state[K + 3 * i]
        cy = state[K + 3 * i + 1]
        cz = state[K + 3 * i + 2]
        kx = ixx * cx + ixy * cy + ixz * cz
        ky = ixy * cx + iyy * cy + iyz * cz
        kz = ixz * cx + iyz * cy + izz * cz
        for j in range(i, 6):
            p = state[P + 6 * i + j] - (kx * state[K + 3 * j] + ky * state[K + 3 * j + 1] + kz * state[K + 3 * j + 2])
            state[P + 6 * i + j] = p
            state[P + 6 * j + i] = p


def correct_by_force(state: Any, params: Any, dt: float, fx: float, fy: float, fz: float) -> None:
    """The update with the specific force: gravity, and accelerations as its noise."""
    draw(state)
    dx, dy, dz = down(state)
    ax, ay, az = expected_forces(state, dx, dy, dz)
    ex = fx + GRAVITY * dx
    ey = fy + GRAVITY * dy
    ez = fz + GRAVITY * dz
    state[FORCE_VAR] += (1.0 - math.exp(-dt / VAR_S)) * (
        min((ex * ex + ey * ey + ez * ez) / 3.0, VAR_MOST) - state[FORCE_VAR]
    )
    flown = state[AIR] > 0.0
    density = max(params[6], AIR_NOISE) if flown else params[6]
    lasting = min(params[7], AIR_FACTOR) if flown else params[7]
    r = (density * density + lasting * state[FORCE_VAR]) / dt
    bx = -GRAVITY * dx - ax
    by = -GRAVITY * dy - ay
    bz = -GRAVITY * dz - az
    sxx = W0 * bx * bx + r
    sxy = W0 * bx * by
    sxz = W0 * bx * bz
    syy = W0 * by * by + r
    syz = W0 * by * bz
    szz = W0 * bz * bz + r
    for i in range(12):
        x = state[Y + 3 * i] - ax
        y = state[Y + 3 * i + 1] - ay
        z = state[Y + 3 * i + 2] - az
        state[Y + 3 * i] = x
        state[Y + 3 * i + 1] = y
        state[Y + 3 * i + 2] = z
        sxx += WI * x * x
        sxy += WI * x * y
        sxz += WI * x * z
        syy += WI * y * y
        syz += WI * y * z
        szz += WI * z * z
    ixx, ixy, ixz, iyy, iyz, izz = inverse(sxx, sxy, sxz, syy, syz, szz)
    zx = fx - ax
    zy = fy - ay
    zz = fz - az
    gx = ixx * zx + ixy * zy + ixz * zz
    gy = ixy * zx + iyy * zy + iyz * zz
    gz = ixz * zx + iyz * zy + izz * zz
    state[RATIO] = math.sqrt(max(zx * gx + zy * gy + zz * gz, 0.0) / 3.0)
    reduce_by_force(state, ixx, ixy, ixz, iyy, iyz, izz)
    inject(
        state,
        state[K] * gx + state[K + 1] * gy + state[K + 2] * gz,
        state[K + 3] * gx + state[K + 4] * gy + state[K + 5] * gz,
        state[K + 6] * gx + state[K + 7] * gy + state[K + 8] * gz,
        state[K + 9] * gx + state[K + 10] * gy + state[K + 11] * gz,
        state[K + 12] * gx + state[K + 13] * gy + state[K + 14] * gz,
        state[K + 15] * gx + state[K + 16] * gy + state[K + 17] * gz,
    )
    watch_tilt(state, dt, fx, fy, fz)


def watch_tilt(state: Any, dt: float, fx: float, fy: float, fz: float) -> None:
    """Opens the tilt's covariance where the mean force, as a vector in earth axes, stays away from the vertical."""
    ux, uy, uz = rotated(state[0], state[1], state[2], state[3], fx, fy, fz)
    k = 1.0 - math.exp(-dt / MEAN_S)
    state[FORCE_MEAN] += k * (ux - state[FORCE_MEAN])
    state[FORCE_MEAN + 1] += k * (uy - state[FORCE_MEAN + 1])
    state[FORCE_MEAN + 2] += k * (uz + GRAVITY - state[FORCE_MEAN + 2])
    mx = state[FORCE_MEAN]
    my = state[FORCE_MEAN + 1]
    mz = state[FORCE_MEAN + 2]
    off = math.sqrt(mx * mx + my * my + mz * mz) / GRAVITY
    noise = math.sqrt(state[FORCE_VAR]) / GRAVITY
    if off > 0.3 + 4.0 * state[SIGMA] + noise:
        for i in range(3):
            state[P + 7 * i] += off * off
        open_heading(state, -off * off)
        state[FORCE_MEAN] = 0.0
        state[FORCE_MEAN + 1] = 0.0
        state[FORCE_MEAN + 2] = 0.0


def correct_by_field(state: Any, params: Any, since: float, mx: float, my: float, mz: float) -> None:
    """The update with the heading of the field: of the error's third component and the bias only."""
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    hx, hy, hz = rotated(q0, q1, q2, q3, mx, my, mz)
    level = math.sqrt(hx * hx + hy * hy)
    weight = trusted(state, params, since, level, hz)
    if level == 0.0 or weight == 0.0:
        return
    draw(state)
    # What the points see is asked of the field as expected, not as measured: its noise would be in both factors.
    bx, by, bz = rotated(q0, -q1, -q2, -q3, level, 0.0, hz)
    mean = 0.0
    for i in range(12):
        a = X + 6 * i
        c0, c1, c2, c3 = from_rodrigues(state[a], state[a + 1], state[a + 2])
        ux, uy, uz = rotated(c0, c1, c2, c3, bx, by, bz)
        ux, uy, uz = rotated(q0, q1, q2, q3, ux, uy, uz)
        d = math.atan2(uy, ux)
        state[Y + 3 * i] = d
        mean += WI * d
    z = -math.atan2(hy, hx) - mean
    z = z - 2.0 * math.pi if z > math.pi else z + 2.0 * math.pi if z < -math.pi else z
    s = W0 * mean * mean
    for i in range(12):
        s += WI * (state[Y + 3 * i] - mean) * (state[Y + 3 * i] - mean)
    noise = RAD * params[8]
    r = noise * noise / (since * weight)
    limit = params[9] * math.sqrt(heading_var(state) + LEAST_HEADING * LEAST_HEADING)
    beyond = abs(z) / limit
    state[RATIO + 1] = beyond
    state[GATED] = state[GATED] + since if beyond > 1.0 else 0.0
    r = r * beyond * beyond if beyond > 1.0 else r
    s += r
    for i in range(6):
        c = 0.0
        for k in range(12):
            c += WI * state[X + 6 * k + i] * (state[Y + 3 * k] - mean)
        state[K + i] = c
    # The gain k: c / s, of whose attitude part only the share about the vertical is left.
    dx, dy, dz = down(state)
    along = (dx * state[K] + dy * state[K + 1] + dz * state[K + 2]) / s
    state[K + 6] = along * dx
    state[K + 7] = along * dy
    state[K + 8] = along * dz
    for i in range(3, 6):
        state[K + 6 + i] = state[K + i] / s
    for i in range(6):
        for j in range(i, 6):
            k = state[K + 6 + i]
            state[P + 6 * i + j] += k * (s * state[K + 6 + j] - state[K + j]) - state[K + i] * state[K + 6 + j]
            state[P + 6 * j + i] = state[P + 6 * i + j]
    inject(
        state, z * along * dx, z * along * dy, z * along * dz, z * state[K + 9], z * state[K + 10], z * state[K + 11]
    )
    if state[GATED] > GATED_S:
        open_heading(state, z * z)
        state[GATED] = 0.0


def open_heading(state: Any, var: float) -> None:
    """Add a variance [rad^2] about the vertical."""
    dx, dy, dz = down(state)
    state[P] += var * dx * dx
    state[P + 7] += var * dy * dy
    state[P + 14] += var * dz * dz
    state[P + 1] += var * dx * dy
    state[P + 6] = state[P + 1]
    state[P + 2] += var * dx * dz
    state[P + 12] = state[P + 2]
    state[P + 8] += var * dy * dz
    state[P + 13] = state[P + 8]


def heading_var(state: Any) -> float:
    """The variance [rad^2] about the vertical, d^T P d."""
    dx, dy, dz = down(state)
    x = state[P] * dx + state[P + 1] * dy + state[P + 2] * dz
    y = state[P + 6] * dx + state[P + 7] * dy + state[P + 8] * dz
    z = state[P + 12] * dx + state[P + 13] * dy + state[P + 14] * dz
    var: float = dx * x + dy * y + dz * z
    return max(var, 0.0)


def trusted(state: Any, params: Any, since: float, level: float, vertical: float) -> float:
    """How much the field counts: 1 while norm and dip are what they were, 0 while not, 1/16 after a minute of that."""
    smooth = 1.0 - math.exp(-since / SMOOTH_S) if state[NORM] > 0.0 else 1.0
    state[LEVEL] += smooth * (level - state[LEVEL])
    state[LEVEL + 1] += smooth * (vertical - state[LEVEL + 1])
    norm = math.sqrt(state[LEVEL] * state[LEVEL] + state[LEVEL + 1] * state[LEVEL + 1])
    dip = math.atan2(state[LEVEL + 1], state[LEVEL])
    learning = state[LEARNT] < LEARN_S
    state[LEARNT] += since
    if state[NORM] == 0.0:
        state[NORM] = norm
        state[DIP] = dip
        state[GOOD] = GOOD_S
    good = abs(norm - state[NORM]) < params[10] * state[NORM] and abs(dip - state[DIP]) < RAD * params[11]
    state[GOOD] = state[GOOD] + since if good or learning else 0.0
    follow = 1.0 - math.exp(-since / FOLLOW_S)
    if learning:
        follow = since / state[LEARNT]
    if learning or state[GOOD] >= GOOD_S:
        state[NORM] += follow * (norm - state[NORM])
        state[DIP] += follow * (dip - state[DIP])
        state[BAD] = max(state[BAD] - 2.0 * since, 0.0)
        return 1.0
    state[BAD] = min(state[BAD] + since, BAD_S)
    return 0.0625 if state[BAD] >= BAD_S else 0.0


def inject(state: Any, px: float, py: float, pz: float, bx: float, by: float, bz: float) -> None:
    """Correct attitude and bias by an error x = (p, db), and bring the quaternion to unit length."""
    c0, c1, c2, c3 = from_rodrigues(px, py, pz)
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    p0 = c0 * q0 - c1 * q1 - c2 * q2 - c3 * q3
    p1 = c0 * q1 + c1 * q0 - c2 * q3 + c3 * q2
    p2 = c0 * q2 + c2 * q0 - c3 * q1 + c1 * q3
    p3 = c0 * q3 + c3 * q0 - c1 * q2 + c2 * q1
    inv = 1.0 / math.sqrt(p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
    state[0] = p0 * inv
    state[1] = p1 * inv
    state[2] = p2 * inv
    state[3] = p3 * inv
    state[4] += bx
    state[5] += by
    state[6] += bz


def report(state: Any) -> None:
    """Sigma of tilt and heading."""
    heading = heading_var(state)
    state[SIGMA] = math.sqrt(max(state[P] + state[P + 7] + state[P + 14] - heading, 0.0))
    state[SIGMA + 1] = math.sqrt(heading)


def from_rodrigues(px: float, py: float, pz: float) -> tuple[float, float, float, float]:
    """The unit quaternion of a generalised Rodrigues vector with a = 1, f = 4 (32)."""
    square = px * px + py * py + pz * pz
    inv = 1.0 / (16.0 + square)
    return (16.0 - square) * inv, 8.0 * px * inv, 8.0 * py * inv, 8.0 * pz * inv


def turned(
    q0: float, q1: float, q2: float, q3: float, wx: float, wy: float, wz: float, dt: float
) -> tuple[float, float, float, float]:
    """q (x) exp(w dt)."""
    h = 0.5 * dt
    x = wx * h
    y = wy * h
    z = wz * h
    c, k = half_angle(x * x + y * y + z * z)
    x = x * k
    y = y * k
    z = z * k
    return (
        q0 * c - q1 * x - q2 * y - q3 * z,
        q1 * c + q0 * x + q2 * z - q3 * y,
        q2 * c + q0 * y + q3 * x - q1 * z,
        q3 * c + q0 * z + q1 * y - q2 * x,
    )


def rotated(q0: float, q1: float, q2: float, q3: float, vx: float, vy: float, vz: float) -> tuple[float, float, float]:
    """R(q) v."""
    tx = 2.0 * (q2 * vz - q3 * vy)
    ty = 2.0 * (q3 * vx - q1 * vz)
    tz = 2.0 * (q1 * vy - q2 * vx)
    return (vx + q0 * tx + q2 * tz - q3 * ty, vy + q0 * ty + q3 * tx - q1 * tz, vz + q0 * tz + q1 * ty - q2 * tx)
