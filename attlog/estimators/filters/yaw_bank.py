"""The headings of ``gsf``, tried at once: each a Kalman filter of a horizontal velocity and a heading.

Hypothesis i is turned by x_i about the vertical against the attitude before any turn. Equations: ``gsf``.
"""

from __future__ import annotations

import math
from typing import Any

N = 5
SIGMA, W, X, V, P, MIX, RUNS = 7, 8, 13, 18, 28, 58, 61
"""Where things stand in the state: sigma of the heading, w_i, x_i, v_i (2 each), P_i (6 each: NN, NE, N psi, EE, E psi,
psi psi), x with its cosine and sine, and whether the bank runs."""

UNKNOWN, TURN = math.pi / math.sqrt(3.0), 2.0 * math.pi
CLIP, LEAST_VAR = 25.0, 1e-6
RAD = math.pi / 180.0


def begin(state: Any, vn: float, ve: float, var: float) -> None:
    """Five equal parts of the circle, all at the velocity of the fix."""
    psi = 2.0 * math.atan2(state[3], state[0]) - state[MIX]
    for i in range(N):
        state[X + i] = wrapped((i + 0.5) * TURN / N - math.pi - psi)
        state[V + 2 * i] = vn
        state[V + 2 * i + 1] = ve
        p = P + 6 * i
        state[p] = var
        state[p + 3] = var
        state[p + 5] = (math.pi / N) ** 2
    state[RUNS] = 1.0
    state[SIGMA] = math.sqrt(spread(state))


def predict(state: Any, params: Any, i: int, dn: float, de: float, dt: float) -> None:
    """Velocity and covariance of hypothesis i after a change of velocity (2,) m/s, in axes before x, over dt."""
    c = math.cos(state[X + i])
    s = math.sin(state[X + i])
    n = c * dn - s * de
    e = s * dn + c * de
    state[V + 2 * i] += n
    state[V + 2 * i + 1] += e
    p = P + 6 * i
    q = params[4] * params[4] * dt
    # First what needs the old covariances of velocity and heading.
    state[p] += e * (e * state[p + 5] - 2.0 * state[p + 2]) + q
    state[p + 1] += n * state[p + 2] - e * state[p + 4] - n * e * state[p + 5]
    state[p + 3] += n * (n * state[p + 5] + 2.0 * state[p + 4]) + q
    state[p + 2] -= e * state[p + 5]
    state[p + 4] += n * state[p + 5]
    walk = RAD * params[3]
    state[p + 5] += walk * walk * dt


def correct(state: Any, i: int, vn: float, ve: float, var: float) -> float:
    """The likelihood of the velocity (2,) m/s of a fix under hypothesis i, which is corrected by it."""
    p = P + 6 * i
    nn = state[p]
    ne = state[p + 1]
    ny = state[p + 2]
    ee = state[p + 3]
    ey = state[p + 4]
    inv = 1.0 / ((nn + var) * (ee + var) - ne * ne)
    inn = inv * (ee + var)
    ine = -inv * ne
    iee = inv * (nn + var)
    zn = vn - state[V + 2 * i]
    ze = ve - state[V + 2 * i + 1]
    square = zn * (inn * zn + ine * ze) + ze * (ine * zn + iee * ze)
    if square > CLIP:
        shorter = math.sqrt(CLIP / square)
        zn *= shorter
        ze *= shorter
        square = CLIP
    # The gains of v_N, v_E and psi, then P - K S K^T with S K^T the columns before.
    kn0 = nn * inn + ne * ine
    kn1 = nn * ine + ne * iee
    ke0 = ne * inn + ee * ine
    ke1 = ne * ine + ee * iee
    ky0 = ny * inn + ey * ine
    ky1 = ny * ine + ey * iee
    state[V + 2 * i] += kn0 * zn + kn1 * ze
    state[V + 2 * i + 1] += ke0 * zn + ke1 * ze
    state[X + i] = wrapped(state[X + i] + ky0 * zn + ky1 * ze)
    state[p] = max(nn - kn0 * nn - kn1 * ne, LEAST_VAR)
    state[p + 1] = ne - kn0 * ne - kn1 * ee
    state[p + 2] = ny - kn0 * ny - kn1 * ey
    state[p + 3] = max(ee - ke0 * ne - ke1 * ee, LEAST_VAR)
    state[p + 4] = ey - ke0 * ny - ke1 * ey
    state[p + 5] = max(state[p + 5] - ky0 * ny - ky1 * ey, LEAST_VAR)
    return math.sqrt(inv) * math.exp(-0.5 * square) / TURN


def mix(state: Any) -> None:
    """Turn the attitude to the weighted mean of the hypotheses, and tell how far they are apart."""
    c = 0.0
    s = 0.0
    for i in range(N):
        c += state[W + i] * math.cos(state[X + i])
        s += state[W + i] * math.sin(state[X + i])
    x = math.atan2(s, c)
    half = 0.5 * (x - state[MIX])
    state[MIX] = x
    state[MIX + 1] = math.cos(x)
    state[MIX + 2] = math.sin(x)
    c = math.cos(half)
    s = math.sin(half)
    q0 = state[0]
    q1 = state[1]
    q2 = state[2]
    q3 = state[3]
    state[0] = c * q0 - s * q3
    state[1] = c * q1 - s * q2
    state[2] = c * q2 + s * q1
    state[3] = c * q3 + s * q0
    state[SIGMA] = math.sqrt(spread(state))


def spread(state: Any) -> float:
    """The variance [rad^2] of the heading: of the hypotheses about their mean, and their own."""
    var = 0.0
    for i in range(N):
        off = wrapped(state[X + i] - state[MIX])
        var += state[W + i] * (state[P + 6 * i + 5] + off * off)
    return var


def wrapped(angle: float) -> float:
    """The angle [rad] within +- pi."""
    return angle - TURN * math.floor(angle / TURN + 0.5)
