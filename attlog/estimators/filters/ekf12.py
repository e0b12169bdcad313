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

from attlog.estimators.interface import INTEGRATOR, Parameter, choice
from attlog.estimators.vectors import (
    GRAVITY,
    cross,
    down,
    is_present,
    matrix,
    places,
    quaternion_from_matrix,
    turned_back,
)

SOURCE = "Fan 6-13"
NEEDS = {"gyro", "acc", "mag"}
HOLD_MAG = False
VECTORS_AT = "end"
STATE = {"q": 4, "rate": 3, "rate_dot": 3, "gravity": 3, "field": 3, "_P": 144, "_V": 72, "_since_field": 1}
S = places(STATE)
# Rate, gravity and field within X, which is the state from ``S.rate`` on, and within each row of P.
W, G, M = 0, 6, 9

# Noises of measurements as densities, R = n^2 / dt, for the field over the time since its last sample; a quarter of the
# acceleration of a lively flight over a second. Walks over noises are bandwidths. Copters reach 50 rad/s^2 in a second.
DATA_SHEET = "MEMS data sheets, 0.01 deg/s/sqrt(Hz)"
PARAMETERS = (
    Parameter("gyro_noise", 2e-4, "rad/s/sqrt(Hz)", 1e-7, 1, "gyro noise density", DATA_SHEET),
    Parameter("acc_noise", 0.5, "m/s^2/sqrt(Hz)", 1e-5, 1e3, "vibration and accelerations beside gravity", "attlog"),
    Parameter("mag_noise", 0.05, "1/sqrt(Hz)", 1e-5, 1e2, "disturbance as part of the field", "attlog; acc_noise / g"),
    Parameter("jerk_noise", 30.0, "rad/s^2/sqrt(s)", 1e-6, 1e6, "random walk of the angular acceleration", "attlog"),
    Parameter("gravity_noise", 0.07, "m/s^2/sqrt(s)", 1e-9, 1e2, "random walk of g: follows a gyro bias", "attlog"),
    Parameter("field_noise", 0.0075, "1/sqrt(s)", 1e-9, 1e2, "random walk of M", "attlog; gravity_noise / g"),
    INTEGRATOR,
    choice(
        "order", ("ahead", "printed"), "gyro first, then vectors; or all predictions first", "attlog; printed: Fan 10"
    ),
)
K = places({p.name: 1 for p in PARAMETERS})
PRESETS: dict[str, dict[str, float | str]] = {
    "fan": {"integrator": "first_order"},
    "fan-printed": {"integrator": "first_order", "order": "printed", "init": "identity"},
}


def start(params: Any, acc: Any, mag: Any, q0: Any) -> Any:
    """Return the state: g and M as the start attitude shows them, rates unknown."""
    state = np.zeros(sum(STATE.values()))
    state[0:4] = q0
    dx, dy, dz = down(state)
    state[S.gravity : S.field] = GRAVITY * np.array([dx, dy, dz])
    north = np.array(matrix(state, 0)[:3])
    # The dip is the angle between the two measured vectors; without a field it is zero.
    size = math.sqrt(float(np.sum(acc * acc) * np.sum(mag * mag)))
    sine = -float(np.sum(acc * mag)) / size if size > 0.0 else 0.0
    state[S.field : S.P] = math.sqrt(max(1.0 - sine * sine, 0.0)) * north + sine * np.array([dx, dy, dz])
    sigma = np.repeat([1.0, 10.0, 0.1 * GRAVITY, 0.1], 3)
    state[S.P : S.V : 13] = sigma * sigma
    return state


def step(state: Any, params: Any, dt: float, gyr: Any, acc: Any, mag: Any) -> None:
    """Take one update: predict the rate, gyro, predict the vectors, gravity, field where new, attitude.

    The gyro's sample is the rate over this dt, so it is used before it turns g and M. In the printed order the
    vectors turn first, by the rate of the state before: both predictions together are F of (11).
    """
    if params[K.order] > 0.5:
        predict_vectors(state, params, dt)
    predict_rate(state, params, dt)
    measure(state, W, gyr[0], gyr[1], gyr[2], params[K.gyro_noise] * params[K.gyro_noise] / dt)
    if params[K.order] < 0.5:
        predict_vectors(state, params, dt)
    state[S.since_field] += dt
    norm = math.sqrt(mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2])
    if is_present(acc):
        measure(state, G, -acc[0], -acc[1], -acc[2], params[K.acc_noise] * params[K.acc_noise] / dt)
    if norm > 0.0:
        inv = 1.0 / norm
        measure(
            state,
            M,
            mag[0] * inv,
            mag[1] * inv,
            mag[2] * inv,
            params[K.mag_noise] * params[K.mag_noise] / state[S.since_field],
        )
        state[S.since_field] = 0.0
    attitude(state)


def predict_rate(state: Any, params: Any, dt: float) -> None:
    """Predict rows w and w_dot of (7, 11): P- = F P F^T + Q and X-."""
    for i in range(3):
        for j in range(12):
            state[S.P + 12 * i + j] += dt * state[S.P + 12 * i + j + 36]
    for j in range(12):
        for i in range(3):
            state[S.P + 12 * j + i] += dt * state[S.P + 12 * j + i + 3]
    for i in range(3):
        state[S.P + 13 * i + 39] += params[K.jerk_noise] * params[K.jerk_noise] * dt
        state[S.rate + i] += dt * state[S.rate + i + 3]


def predict_vectors(state: Any, params: Any, dt: float) -> None:
    """Predict rows g and M of (8, 11) with F at the state before; g and M turn exactly or by (8)."""
    wx, wy, wz = dt * state[S.rate], dt * state[S.rate + 1], dt * state[S.rate + 2]
    gx, gy, gz = dt * state[S.gravity], dt * state[S.gravity + 1], dt * state[S.gravity + 2]
    mx, my, mz = dt * state[S.field], dt * state[S.field + 1], dt * state[S.field + 2]
    # Rows g and M of F P.
    for j in range(12):
        ux, uy, uz = state[S.P + j], state[S.P + 12 + j], state[S.P + 24 + j]
        px, py, pz = state[S.P + 72 + j], state[S.P + 84 + j], state[S.P + 96 + j]
        qx, qy, qz = state[S.P + 108 + j], state[S.P + 120 + j], state[S.P + 132 + j]
        state[S.V + j] = px + gy * uz - gz * uy - wy * pz + wz * py
        state[S.V + 12 + j] = py + gz * ux - gx * uz - wz * px + wx * pz
        state[S.V + 24 + j] = pz + gx * uy - gy * ux - wx * py + wy * px
        state[S.V + 36 + j] = qx + my * uz - mz * uy - wy * qz + wz * qy
        state[S.V + 48 + j] = qy + mz * ux - mx * uz - wz * qx + wx * qz
        state[S.V + 60 + j] = qz + mx * uy - my * ux - wx * qy + wy * qx
    # (F P) F^T: columns w and w_dot stay, then g and M.
    for i in range(6):
        v = S.V + 12 * i
        row = S.P + 72 + 12 * i
        for j in range(6):
            state[row + j] = state[v + j]
            state[S.P + 12 * j + 6 + i] = state[row + j]
        ux, uy, uz = state[v], state[v + 1], state[v + 2]
        qx, qy, qz = state[v + 9], state[v + 10], state[v + 11]
        state[row + 9] = qx + my * uz - mz * uy - wy * qz + wz * qy
        state[row + 10] = qy + mz * ux - mx * uz - wz * qx + wx * qz
        state[row + 11] = qz + mx * uy - my * ux - wx * qy + wy * qx
    for i in range(3):
        v = S.V + 12 * i
        row = S.P + 72 + 12 * i
        ux, uy, uz = state[v], state[v + 1], state[v + 2]
        px, py, pz = state[v + 6], state[v + 7], state[v + 8]
        state[row + 6] = px + gy * uz - gz * uy - wy * pz + wz * py
        state[row + 7] = py + gz * ux - gx * uz - wz * px + wx * pz
        state[row + 8] = pz + gx * uy - gy * ux - wx * py + wy * px
        for j in range(9, 12):
            state[S.P + 12 * j + 6 + i] = state[row + j]
    # The updates leave both halves equal up to rounding, which must not pile up.
    for i in range(0, 12, 3):
        a = S.P + 13 * i
        state[a + 12] = state[a + 1]
        state[a + 24] = state[a + 2]
        state[a + 25] = state[a + 14]
    for i in range(3):
        state[S.P + 13 * i + 78] += params[K.gravity_noise] * params[K.gravity_noise] * dt
        state[S.P + 13 * i + 117] += params[K.field_noise] * params[K.field_noise] * dt
    for at in (S.gravity, S.field):
        x, y, z = state[at], state[at + 1], state[at + 2]
        if params[K.integrator] > 0.5:
            state[at] = x - (wy * z - wz * y)
            state[at + 1] = y - (wz * x - wx * z)
            state[at + 2] = z - (wx * y - wy * x)
        else:
            state[at], state[at + 1], state[at + 2] = turned_back(x, y, z, wx, wy, wz, 1.0)


def measure(state: Any, k: int, x: float, y: float, z: float, r: float) -> None:
    """Update with states k, k+1, k+2 of X measured as x, y, z with variance r each.

    Called with k as a literal: only then the compiler sees that no store meets a later load.
    """
    p = S.P + 13 * k
    a, b, c = state[p] + r, state[p + 1], state[p + 2]
    d, e, f = state[p + 13] + r, state[p + 14], state[p + 26] + r
    # The inverse of S: cofactors by determinant.
    xx = d * f - e * e
    xy = c * e - b * f
    xz = b * e - c * d
    s = 1.0 / (a * xx + b * xy + c * xz)
    xx, xy, xz = s * xx, s * xy, s * xz
    yy = s * (a * f - c * c)
    yz = s * (b * c - a * e)
    zz = s * (a * d - b * b)
    ex, ey, ez = x - state[S.rate + k], y - state[S.rate + k + 1], z - state[S.rate + k + 2]
    for j in range(12):
        ux, uy, uz = state[S.P + 12 * k + j], state[S.P + 12 * k + 12 + j], state[S.P + 12 * k + 24 + j]
        kx = xx * ux + xy * uy + xz * uz
        ky = xy * ux + yy * uy + yz * uz
        kz = xz * ux + yz * uy + zz * uz
        state[S.V + j], state[S.V + 12 + j], state[S.V + 24 + j] = ux, uy, uz
        state[S.V + 36 + j], state[S.V + 48 + j], state[S.V + 60 + j] = kx, ky, kz
        state[S.rate + j] += kx * ex + ky * ey + kz * ez
    reduce_rows(state, 0)
    reduce_rows(state, 3)
    reduce_rows(state, 6)
    reduce_rows(state, 9)


def reduce_rows(state: Any, i: int) -> None:
    """Subtract K P_k from rows i, i+1, i+2 of P; V holds P_k and K^T."""
    ax, ay, az = state[S.V + i + 36], state[S.V + i + 48], state[S.V + i + 60]
    bx, by, bz = state[S.V + i + 37], state[S.V + i + 49], state[S.V + i + 61]
    cx, cy, cz = state[S.V + i + 38], state[S.V + i + 50], state[S.V + i + 62]
    for j in range(12):
        ux, uy, uz = state[S.V + j], state[S.V + 12 + j], state[S.V + 24 + j]
        state[S.P + 12 * i + j] -= ax * ux + ay * uy + az * uz
        state[S.P + 12 * i + j + 12] -= bx * ux + by * uy + bz * uz
        state[S.P + 12 * i + j + 24] -= cx * ux + cy * uy + cz * uz


def attitude(state: Any) -> None:
    """Write the quaternion of (5, 13) from g and M: down along g, east along g x M, north along east x down."""
    dx, dy, dz = state[S.gravity], state[S.gravity + 1], state[S.gravity + 2]
    ex, ey, ez = cross(dx, dy, dz, state[S.field], state[S.field + 1], state[S.field + 2])
    down_squared = dx * dx + dy * dy + dz * dz
    east_squared = ex * ex + ey * ey + ez * ez
    if down_squared > 0.0 and east_squared > 0.0:
        s = 1.0 / math.sqrt(down_squared)
        dx, dy, dz = s * dx, s * dy, s * dz
        s = 1.0 / math.sqrt(east_squared)
        ex, ey, ez = s * ex, s * ey, s * ez
        state[S.V], state[S.V + 1], state[S.V + 2] = cross(ex, ey, ez, dx, dy, dz)
        state[S.V + 3], state[S.V + 4], state[S.V + 5] = ex, ey, ez
        state[S.V + 6], state[S.V + 7], state[S.V + 8] = dx, dy, dz
        quaternion_from_matrix(state, S.V)
