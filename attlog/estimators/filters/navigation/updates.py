"""What each aid says of the state: residual, non-zero entries of its rows, and noise. Plain functions for the kernels.

| aid | predicted |
| --- | --- |
| GNSS velocity, valid at its stamp less the delay | v + a e + R (w x l) - a tg |
| GNSS position | p + v e + R l + pb - v tg |
| height | -p_d - v_d e + bb |
| field | (I + S) m + bm with m = R^T M + (R^T M x w)(e - tm) |
| rest | v = 0; the gyro shows its bias |

``e`` is the time from the sample to which the event was moved; ``a`` the earth acceleration from a centred 0.1 s mean
of the accelerometer, ``w`` a centred 60 ms mean of the gyro: single samples would bias the delays.
"""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.filters.navigation.layout import (
    ARM,
    BA,
    BARO,
    BARO_BIAS,
    BG,
    EARTH,
    GNSS_DELAY,
    GRAVITY_AT,
    HARD,
    MAG,
    MAG_DELAY,
    PHI,
    POS,
    POSITION,
    SOFT,
    STILL,
    VELOCITY,
    WANDER,
    V,
)


def to_matrix3(q: Any, R: Any) -> None:
    """R (3, 3) from body to earth of a unit quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)


def turn_body(q: Any, x: float, y: float, z: float) -> None:
    """q <- q exp(v / 2) for a rotation vector in body axes, unit length kept."""
    turn(q, x, y, z, 1.0)


def turn_earth(q: Any, x: float, y: float, z: float) -> None:
    """q <- exp(v / 2) q for a rotation vector in earth axes, unit length kept."""
    turn(q, x, y, z, -1.0)


def turn(q: Any, x: float, y: float, z: float, side: float) -> None:
    """Multiply by exp(v / 2) from the right (side 1) or the left (side -1)."""
    angle = math.sqrt(x * x + y * y + z * z)
    c = math.cos(0.5 * angle)
    s = 0.5 if angle < 1e-12 else math.sin(0.5 * angle) / angle
    x, y, z = s * x, s * y, s * z
    a, b, d, e = q[0], q[1], q[2], q[3]
    n0 = a * c - b * x - d * y - e * z
    n1 = a * x + b * c + side * (d * z - e * y)
    n2 = a * y + d * c + side * (e * x - b * z)
    n3 = a * z + e * c + side * (b * y - d * x)
    norm = 1.0 / math.sqrt(n0 * n0 + n1 * n1 + n2 * n2 + n3 * n3)
    q[0], q[1], q[2], q[3] = n0 * norm, n1 * norm, n2 * norm, n3 * norm


def between(R: Any, L: Any, out: Any) -> float:
    """out = log(R L^T), a small rotation vector in earth axes; returns its angle in rad (1 where it is not small)."""
    x = y = z = trace = 0.0
    for k in range(3):
        x += R[2, k] * L[1, k] - R[1, k] * L[2, k]
        y += R[0, k] * L[2, k] - R[2, k] * L[0, k]
        z += R[1, k] * L[0, k] - R[0, k] * L[1, k]
        trace += R[0, k] * L[0, k] + R[1, k] * L[1, k] + R[2, k] * L[2, k]
    s = 0.5 * math.sqrt(x * x + y * y + z * z)
    if s > 0.5 or trace < 1.0:
        return 1.0
    scale = 0.5 if s < 1e-9 else 0.5 * math.asin(s) / s
    out[0], out[1], out[2] = scale * x, scale * y, scale * z
    return 2.0 * scale * s


def field_rows(
    x: Any, x0: Any, R: Any, J: Any, e: float, w: Any, z: Any, linear: bool, work: Any, r: Any, hi: Any, hv: Any
) -> int:
    """Residual and rows of a field sample; returns entries per row.

    ``J`` is the attitude (3, 3) of the Jacobian, ``x0`` (39,) the state that gives its field and soft iron: running
    estimates would let every sample at a slightly different attitude invent heading. ``linear``: the residual is
    linear about (J, x0) as well. ``work`` (4, 3).
    """
    m, c, d, phi = work[0], work[1], work[2], work[3]
    S = SOFT
    for i in range(3):
        m[i] = J[0, i] * x0[EARTH] + J[1, i] * x0[EARTH + 1] + J[2, i] * x0[EARTH + 2]
    c[0], c[1], c[2] = m[1] * w[2] - m[2] * w[1], m[2] * w[0] - m[0] * w[2], m[0] * w[1] - m[1] * w[0]
    for row in range(3):
        s0 = x0[S] if row == 0 else x0[S + 3] if row == 1 else x0[S + 4]
        s1 = x0[S + 3] if row == 0 else x0[S + 1] if row == 1 else x0[S + 5]
        s2 = x0[S + 4] if row == 0 else x0[S + 5] if row == 1 else x0[S + 2]
        s0 += 1.0 if row == 0 else 0.0
        s1 += 1.0 if row == 1 else 0.0
        s2 += 1.0 if row == 2 else 0.0
        for k in range(3):
            d[k] = s0 * J[k, 0] + s1 * J[k, 1] + s2 * J[k, 2]
        hi[row, 0], hi[row, 1], hi[row, 2] = PHI, PHI + 1, PHI + 2
        hv[row, 0] = d[1] * x0[EARTH + 2] - d[2] * x0[EARTH + 1]
        hv[row, 1] = d[2] * x0[EARTH] - d[0] * x0[EARTH + 2]
        hv[row, 2] = d[0] * x0[EARTH + 1] - d[1] * x0[EARTH]
        for k in range(3):
            hi[row, 3 + k], hv[row, 3 + k] = EARTH + k, d[k]
        hi[row, 6], hv[row, 6] = HARD + row, 1.0
        hi[row, 7], hi[row, 8], hi[row, 9] = S + row, S, S
        hv[row, 7] = m[row]
        if row == 0:
            hi[row, 8], hv[row, 8], hi[row, 9], hv[row, 9] = S + 3, m[1], S + 4, m[2]
        elif row == 1:
            hi[row, 8], hv[row, 8], hi[row, 9], hv[row, 9] = S + 3, m[0], S + 5, m[2]
        else:
            hi[row, 8], hv[row, 8], hi[row, 9], hv[row, 9] = S + 4, m[0], S + 5, m[1]
        hi[row, 10], hv[row, 10] = MAG_DELAY, -(s0 * c[0] + s1 * c[1] + s2 * c[2])
    if linear:
        between(R, J, phi)
        for row in range(3):
            h = x0[HARD + row] + m[row] + c[row] * (e - x0[MAG_DELAY])
            h += soft_times(x0, row, m, c, e - x0[MAG_DELAY])
            for k in range(3):
                h += hv[row, k] * phi[k]
            for k in range(3, 11):
                h += hv[row, k] * (x[hi[row, k]] - x0[hi[row, k]])
            r[row] = z[row] - h
        return 11
    for i in range(3):
        m[i] = R[0, i] * x[EARTH] + R[1, i] * x[EARTH + 1] + R[2, i] * x[EARTH + 2]
    c[0], c[1], c[2] = m[1] * w[2] - m[2] * w[1], m[2] * w[0] - m[0] * w[2], m[0] * w[1] - m[1] * w[0]
    lead = e - x[MAG_DELAY]
    for row in range(3):
        r[row] = z[row] - x[HARD + row] - m[row] - c[row] * lead - soft_times(x, row, m, c, lead)
    return 11


def soft_times(x: Any, row: int, m: Any, c: Any, lead: float) -> float:
    """One component of S (m + c lead)."""
    S = SOFT
    a, b, d = m[0] + c[0] * lead, m[1] + c[1] * lead, m[2] + c[2] * lead
    if row == 0:
        total: float = x[S] * a + x[S + 3] * b + x[S + 4] * d
    elif row == 1:
        total = x[S + 3] * a + x[S + 1] * b + x[S + 5] * d
    else:
        total = x[S + 4] * a + x[S + 5] * b + x[S + 2] * d
    return total


def rows(
    kind: int, x: Any, R: Any, e: float, f: Any, w: Any, z: Any, par: Any, work: Any, r: Any, hi: Any, hv: Any
) -> int:
    """Residual ``r`` (3,) and rows (``hi``, ``hv`` (3, WIDE)) of an event that is no field sample; entries per row."""
    if kind == VELOCITY:
        a, u = work[0], work[1]
        for i in range(3):
            a[i] = R[i, 0] * (f[0] - x[BA]) + R[i, 1] * (f[1] - x[BA + 1]) + R[i, 2] * (f[2] - x[BA + 2])
        a[2] += par[GRAVITY_AT]
        u[0] = w[1] * x[ARM + 2] - w[2] * x[ARM + 1]
        u[1] = w[2] * x[ARM] - w[0] * x[ARM + 2]
        u[2] = w[0] * x[ARM + 1] - w[1] * x[ARM]
        for i in range(3):
            arm = R[i, 0] * u[0] + R[i, 1] * u[1] + R[i, 2] * u[2]
            r[i] = z[i] - x[V + i] - a[i] * (e - x[GNSS_DELAY]) - arm
            hi[i, 0], hv[i, 0] = V + i, 1.0
            hi[i, 1], hv[i, 1] = GNSS_DELAY, -a[i]
            hi[i, 2], hv[i, 2] = ARM, R[i, 1] * w[2] - R[i, 2] * w[1]
            hi[i, 3], hv[i, 3] = ARM + 1, R[i, 2] * w[0] - R[i, 0] * w[2]
            hi[i, 4], hv[i, 4] = ARM + 2, R[i, 0] * w[1] - R[i, 1] * w[0]
        return 5
    if kind == POSITION:
        for i in range(3):
            arm = R[i, 0] * x[ARM] + R[i, 1] * x[ARM + 1] + R[i, 2] * x[ARM + 2]
            lead = e - x[GNSS_DELAY]
            r[i] = z[i] - x[POS + i] - x[V + i] * lead - arm - x[WANDER + i]
            hi[i, 0], hv[i, 0] = POS + i, 1.0
            hi[i, 1], hv[i, 1] = V + i, lead
            hi[i, 2], hv[i, 2] = WANDER + i, 1.0
            hi[i, 3], hv[i, 3] = GNSS_DELAY, -x[V + i]
            for k in range(3):
                hi[i, 4 + k], hv[i, 4 + k] = ARM + k, R[i, k]
        return 7
    if kind == BARO:
        r[0] = z[0] + x[POS + 2] + x[V + 2] * e - x[BARO_BIAS]
        hi[0, 0], hv[0, 0] = POS + 2, -1.0
        hi[0, 1], hv[0, 1] = V + 2, -e
        hi[0, 2], hv[0, 2] = BARO_BIAS, 1.0
        return 3
    first = V if kind == STILL else BG
    for i in range(3):
        r[i] = z[i] - x[first + i]
        hi[i, 0], hv[i, 0] = first + i, 1.0
    return 1


def group_of(kind: int, row: int) -> int:
    """Which noise level a scalar update belongs to."""
    if kind == VELOCITY:
        return 1 if row == 2 else 0
    if kind == POSITION:
        return 3 if row == 2 else 2
    if kind == BARO:
        return 4
    if kind == MAG:
        return 5
    return 7 if kind == STILL else 6
