"""Fan's extended Kalman filter with 12 states: rate, its derivative, gravity and field, all in body axes.

    X    = [w, w_dot, g, M]                                                        (6)
    w'   = w_dot,  w_dot' = noise,  g' = -w x g,  M' = -w x M                      (7, 8)

         | I      T I   0      0     |
    F  = | 0      I     0      0     |      W = -[w]x T                            (11)
         | [g]x T 0     I + W  0     |
         | [M]x T 0     0      I + W |

    z    = [w, g, M] = [gyro, -f, m/|m|]     H picks them, constant                (9, 10)
    P-   = F P F^T + Q,  K = P- H^T (H P- H^T + R)^-1                    (no number)

    roll    = atan2(g_y, g_z),  pitch = atan2(-g_x, |g_yz|)                        (5)
    heading = atan2(-(M_y cos roll - M_z sin roll),                                (13)
                    M_x cos pitch + M_y sin pitch sin roll + M_z sin pitch cos roll)

Source: Fan 6-13. The paper gives no noise values; the defaults are ours (docs/estimators.md).

Presets. ``fan-printed`` keeps the printed order (``order = printed``): (10, 11) predict all of X and P from the
state before, then every sensor corrects. It starts at q = (1, 0, 0, 0), which section 4 prints for the
complementary filter; none is printed for this one. ``fan`` uses the gyro's sample before the vectors turn
(``order = ahead``), one sample ahead of print. In a lively flight at 100 Hz the two are up to 0.43 deg
apart; given the gyro one sample sooner, the printed order is ``fan`` to 0.0001 deg.

Departures. Fan prints wrong entries in rows 1 and 2 of sigma_g and sigma_M (they are [g]x
and [M]x), pitch without its sign, ``M_bx sin(phi)`` in the heading and a plain arctangent.
The field enters as a unit vector, so its unit does not matter. There is no gyro bias among
the states: a bias tilts g and M until the measurements balance it. By default the gyro sample is used
before g and M are predicted, because it is the rate of just that time. The prediction turns g and M
exactly, with ``integrator = first_order`` by (8) as the paper does (BROAD: tilt 2.2 for
1.6 deg, thinned to 26 Hz 5.6 for 3.3). F is (11) in both.

How it computes. H picks three neighbouring states per sensor and R is diagonal, so the three
sensors are used one after the other: S is a block of P plus r I, its inverse a closed form,
K = P_k^T S^-1 twelve rows of three, and P -= K P_k one pass over P in vector registers. Of
F P F^T only the rows of g and M are products; those of w are sums, their counterparts copies.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from attlog.estimators.interface import INTEGRATOR, Parameter
from attlog.estimators.vectors import GRAVITY, down, quaternion_from_matrix, turned_back

SOURCE = "Fan 6-13"
NEEDS = {"gyro", "acc", "mag"}
HOLD_MAG = False
VECTORS_AT = "end"
STATE = {"q": 4, "rate": 3, "rate_dot": 3, "gravity": 3, "field": 3, "_covariance": 144, "_work": 72, "_since_field": 1}
# Where things stand: X, P, V (work) in the state; W, G, M within X and within each row of P.
X, W, G, M, P, V, SINCE = 4, 0, 6, 9, 16, 160, 232

PARAMETERS = (
    Parameter(
        "gyro_noise",
        2e-4,
        "rad/s/sqrt(Hz)",
        1e-7,
        1,
        "gyro noise density, R = n^2 / dt",
        "MEMS data sheets, 0.01 deg/s/sqrt(Hz)",
    ),
    Parameter(
        "acc_noise",
        0.5,
        "m/s^2/sqrt(Hz)",
        1e-5,
        1e3,
        "density of what the accelerometer shows beside gravity, R = n^2 / dt: vibration and accelerations",
        "attlog; a quarter of the acceleration of a lively flight over a second",
    ),
    Parameter(
        "mag_noise",
        0.05,
        "1/sqrt(Hz)",
        1e-5,
        1e2,
        "density of the field's disturbance as part of the field, R = n^2 / (time since the last sample)",
        "attlog, as acc_noise as part of gravity",
    ),
    Parameter(
        "jerk_noise",
        30.0,
        "rad/s^2/sqrt(s)",
        1e-6,
        1e6,
        "random walk of the angular acceleration: large follows the gyro at once",
        "attlog; copters reach 50 rad/s^2 within a second",
    ),
    Parameter(
        "gravity_noise",
        0.07,
        "m/s^2/sqrt(s)",
        1e-9,
        1e2,
        "random walk of g: what the gyro does not explain, its bias first; bandwidth = gravity_noise / acc_noise",
        "attlog",
    ),
    Parameter(
        "field_noise",
        0.0075,
        "1/sqrt(s)",
        1e-9,
        1e2,
        "random walk of M: what the gyro does not explain; bandwidth = field_noise / mag_noise",
        "attlog, as gravity_noise as part of gravity",
    ),
    INTEGRATOR,
    Parameter(
        "order",
        "ahead",
        "",
        0,
        1,
        "the gyro's sample before the vectors are predicted, which it turns; or all predictions before all updates",
        "attlog; printed is Fan 10, whose vectors turn by the rate of the sample before",
        ("ahead", "printed"),
    ),
)
PRESETS: dict[str, dict[str, float | str]] = {
    "fan": {"integrator": "first_order"},
    "fan-printed": {"integrator": "first_order", "order": "printed", "init": "identity"},
}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """The state: g and M as the start attitude shows them, rates unknown."""
    state = np.zeros(233)
    state[0:4] = q0
    dx, dy, dz = down(state)
    state[X + G : X + M] = GRAVITY * np.array([dx, dy, dz])
    q0w, q1, q2, q3 = state[0], state[1], state[2], state[3]
    north = np.array([1.0 - 2.0 * (q2 * q2 + q3 * q3), 2.0 * (q1 * q2 - q0w * q3), 2.0 * (q1 * q3 + q0w * q2)])
    # The dip is the angle between the two measured vectors; without a field it is zero.
    size = math.sqrt(float(np.sum(acc * acc) * np.sum(mag * mag)))
    sine = -float(np.sum(acc * mag)) / size if size > 0.0 else 0.0
    state[X + M : P] = math.sqrt(max(1.0 - sine * sine, 0.0)) * north + sine * np.array([dx, dy, dz])
    sigma = np.repeat([1.0, 10.0, 0.1 * GRAVITY, 0.1], 3)
    state[P:V:13] = sigma * sigma
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """One update: prediction of the rate, gyro, prediction of the vectors, gravity, field where new, attitude.

    The gyro's sample is the rate over this dt, so it is used before it turns g and M. In the printed order the
    vectors turn first, by the rate of the state before: both predictions together are F of (11).
    """
    if params[7] > 0.5:
        predict_vectors(state, params, dt)
    predict_rate(state, params, dt)
    measure(state, W, gyr[0], gyr[1], gyr[2], params[0] * params[0] / dt)
    if params[7] < 0.5:
        predict_vectors(state, params, dt)
    state[SINCE] += dt
    norm = math.sqrt(mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2])
    has_acc = acc[0] != 0.0 or acc[1] != 0.0 or acc[2] != 0.0
    if has_acc:
        measure(state, G, -acc[0], -acc[1], -acc[2], params[1] * params[1] / dt)
    if norm > 0.0:
        inv = 1.0 / norm
        measure(state, M, mag[0] * inv, mag[1] * inv, mag[2] * inv, params[2] * params[2] / state[SINCE])
    if norm > 0.0:
        state[SINCE] = 0.0
    attitude(state)


def predict_rate(state: Any, params: Any, dt: float) -> None:
    """Rows w and w_dot of (7, 11): P- = F P F^T + Q and X-."""
    for i in range(3):
        for j in range(12):
            state[P + 12 * i + j] += dt * state[P + 12 * i + j + 36]
    for j in range(12):
        for i in range(3):
            state[P + 12 * j + i] += dt * state[P + 12 * j + i + 3]
    for i in range(3):
        state[P + 13 * i + 39] += params[3] * params[3] * dt
        state[X + i] += dt * state[X + i + 3]


def predict_vectors(state: Any, params: Any, dt: float) -> None:
    """Rows g and M of (8, 11): P- = F P F^T + Q with F at the state before; g and M turn exactly or by (8)."""
    wx = dt * state[X]
    wy = dt * state[X + 1]
    wz = dt * state[X + 2]
    gx = dt * state[X + G]
    gy = dt * state[X + G + 1]
    gz = dt * state[X + G + 2]
    mx = dt * state[X + M]
    my = dt * state[X + M + 1]
    mz = dt * state[X + M + 2]
    # Rows g and M of F P.
    for j in range(12):
        ux = state[P + j]
        uy = state[P + 12 + j]
        uz = state[P + 24 + j]
        px = state[P + 72 + j]
        py = state[P + 84 + j]
        pz = state[P + 96 + j]
        qx = state[P + 108 + j]
        qy = state[P + 120 + j]
        qz = state[P + 132 + j]
        state[V + j] = px + gy * uz - gz * uy - wy * pz + wz * py
        state[V + 12 + j] = py + gz * ux - gx * uz - wz * px + wx * pz
        state[V + 24 + j] = pz + gx * uy - gy * ux - wx * py + wy * px
        state[V + 36 + j] = qx + my * uz - mz * uy - wy * qz + wz * qy
        state[V + 48 + j] = qy + mz * ux - mx * uz - wz * qx + wx * qz
        state[V + 60 + j] = qz + mx * uy - my * ux - wx * qy + wy * qx
    # (F P) F^T: columns w and w_dot stay, then g and M.
    for i in range(6):
        v = V + 12 * i
        row = P + 72 + 12 * i
        for j in range(6):
            state[row + j] = state[v + j]
            state[P + 12 * j + 6 + i] = state[row + j]
        ux = state[v]
        uy = state[v + 1]
        uz = state[v + 2]
        qx = state[v + 9]
        qy = state[v + 10]
        qz = state[v + 11]
        state[row + 9] = qx + my * uz - mz * uy - wy * qz + wz * qy
        state[row + 10] = qy + mz * ux - mx * uz - wz * qx + wx * qz
        state[row + 11] = qz + mx * uy - my * ux - wx * qy + wy * qx
    for i in range(3):
        v = V + 12 * i
        row = P + 72 + 12 * i
        ux = state[v]
        uy = state[v + 1]
        uz = state[v + 2]
        px = state[v + 6]
        py = state[v + 7]
        pz = state[v + 8]
        state[row + 6] = px + gy * uz - gz * uy - wy * pz + wz * py
        state[row + 7] = py + gz * ux - gx * uz - wz * px + wx * pz
        state[row + 8] = pz + gx * uy - gy * ux - wx * py + wy * px
        for j in range(9, 12):
            state[P + 12 * j + 6 + i] = state[row + j]
    # The updates leave both halves equal up to rounding, which must not pile up.
    for i in range(0, 12, 3):
        a = P + 13 * i
        state[a + 12] = state[a + 1]
        state[a + 24] = state[a + 2]
        state[a + 25] = state[a + 14]
    for i in range(3):
        state[P + 13 * i + 78] += params[4] * params[4] * dt
        state[P + 13 * i + 117] += params[5] * params[5] * dt
    for at in (X + G, X + M):
        x = state[at]
        y = state[at + 1]
        z = state[at + 2]
        if params[6] > 0.5:
            state[at] = x - (wy * z - wz * y)
            state[at + 1] = y - (wz * x - wx * z)
            state[at + 2] = z - (wx * y - wy * x)
        else:
            tx, ty, tz = turned_back(x, y, z, wx, wy, wz, 1.0)
            state[at] = tx
            state[at + 1] = ty
            state[at + 2] = tz


def measure(state: Any, k: int, x: float, y: float, z: float, r: float) -> None:
    """The Kalman update for states k, k+1, k+2 of X, measured as x, y, z with variance r each.

    Called with k as a literal: only then the compiler sees that no store meets a later load.
    """
    p = P + 13 * k
    a = state[p] + r
    b = state[p + 1]
    c = state[p + 2]
    d = state[p + 13] + r
    e = state[p + 14]
    f = state[p + 26] + r
    # The inverse of S: cofactors by determinant.
    xx = d * f - e * e
    xy = c * e - b * f
    xz = b * e - c * d
    s = 1.0 / (a * xx + b * xy + c * xz)
    xx *= s
    xy *= s
    xz *= s
    yy = s * (a * f - c * c)
    yz = s * (b * c - a * e)
    zz = s * (a * d - b * b)
    ex = x - state[X + k]
    ey = y - state[X + k + 1]
    ez = z - state[X + k + 2]
    for j in range(12):
        ux = state[P + 12 * k + j]
        uy = state[P + 12 * k + 12 + j]
        uz = state[P + 12 * k + 24 + j]
        kx = xx * ux + xy * uy + xz * uz
        ky = xy * ux + yy * uy + yz * uz
        kz = xz * ux + yz * uy + zz * uz
        state[V + j] = ux
        state[V + 12 + j] = uy
        state[V + 24 + j] = uz
        state[V + 36 + j] = kx
        state[V + 48 + j] = ky
        state[V + 60 + j] = kz
        state[X + j] += kx * ex + ky * ey + kz * ez
    reduce_rows(state, 0)
    reduce_rows(state, 3)
    reduce_rows(state, 6)
    reduce_rows(state, 9)


def reduce_rows(state: Any, i: int) -> None:
    """P -= K P_k for rows i, i+1, i+2; P_k and K^T stand in V."""
    ax = state[V + i + 36]
    ay = state[V + i + 48]
    az = state[V + i + 60]
    bx = state[V + i + 37]
    by = state[V + i + 49]
    bz = state[V + i + 61]
    cx = state[V + i + 38]
    cy = state[V + i + 50]
    cz = state[V + i + 62]
    for j in range(12):
        ux = state[V + j]
        uy = state[V + 12 + j]
        uz = state[V + 24 + j]
        state[P + 12 * i + j] -= ax * ux + ay * uy + az * uz
        state[P + 12 * i + j + 12] -= bx * ux + by * uy + bz * uz
        state[P + 12 * i + j + 24] -= cx * ux + cy * uy + cz * uz


def attitude(state: Any) -> None:
    """The quaternion of (5, 13) from g and M: down along g, east along g x M, north along east x down."""
    dx = state[X + G]
    dy = state[X + G + 1]
    dz = state[X + G + 2]
    mx = state[X + M]
    my = state[X + M + 1]
    mz = state[X + M + 2]
    ex = dy * mz - dz * my
    ey = dz * mx - dx * mz
    ez = dx * my - dy * mx
    down_squared = dx * dx + dy * dy + dz * dz
    east_squared = ex * ex + ey * ey + ez * ez
    if down_squared > 0.0 and east_squared > 0.0:
        s = 1.0 / math.sqrt(down_squared)
        dx *= s
        dy *= s
        dz *= s
        s = 1.0 / math.sqrt(east_squared)
        ex *= s
        ey *= s
        ez *= s
        state[V] = ey * dz - ez * dy
        state[V + 1] = ez * dx - ex * dz
        state[V + 2] = ex * dy - ey * dx
        state[V + 3] = ex
        state[V + 4] = ey
        state[V + 5] = ez
        state[V + 6] = dx
        state[V + 7] = dy
        state[V + 8] = dz
        quaternion_from_matrix(state, V)
