"""Rows of measurements and the transition against differences of what they linearise."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators.filters.navigation.backward import back_through_updates
from attlog.estimators.filters.navigation.forward import carry, shrink
from attlog.estimators.filters.navigation.layout import (
    BARO,
    EARTH,
    GNSS_DELAY,
    GRAVITY_AT,
    MAG,
    MAG_DELAY,
    NO_RATE,
    POSITION,
    ROW,
    SETTINGS,
    SOFT,
    STILL,
    SUMS,
    VELOCITY,
    WIDE,
    N,
)
from attlog.estimators.filters.navigation.motion import padded, predict, square, undo
from attlog.estimators.filters.navigation.start import field_matrix
from attlog.estimators.filters.navigation.updates import field_rows, rows, to_matrix3
from tests.estimators.filters.navigation.dense import transition_matrix

RANDOM = np.random.default_rng(4)
Q = rotation.normalize(np.array([0.8, 0.2, -0.3, 0.45]))
X = RANDOM.standard_normal(N) * 0.1
X[EARTH : EARTH + 3] = 0.2, 0.05, 0.43
X[SOFT : SOFT + 6] *= 0.1
X[GNSS_DELAY], X[MAG_DELAY] = 0.02, 0.025
FORCE, RATE = np.array([0.5, -1.0, -9.0]), np.array([0.4, -0.7, 0.9])
LATE = 0.03
COUNT = {VELOCITY: 3, POSITION: 3, BARO: 1, MAG: 3, STILL: 3, NO_RATE: 3}


def event(kind, q, x):
    """Residual of zero values, and the dense rows."""
    par = np.zeros(SETTINGS)
    par[GRAVITY_AT] = 9.8
    R, r = np.zeros((3, 3)), np.zeros(3)
    hi, hv, work = np.zeros((3, WIDE), np.int64), np.zeros((3, WIDE)), np.zeros((4, 3))
    to_matrix3(q, R)
    if kind == MAG:
        wide = field_rows(x, x, R, R, LATE, RATE, np.zeros(3), False, work, r, hi, hv)
    else:
        wide = rows(kind, x, R, LATE, FORCE, RATE, np.zeros(3), par, work, r, hi, hv)
    H = np.zeros((COUNT[kind], N))
    for i in range(COUNT[kind]):
        for k in range(wide):
            H[i, hi[i, k]] += hv[i, k]
    return r[: COUNT[kind]].copy(), H


def moved(q, x, dx):
    """The state with an error dx put in."""
    out = x.copy()
    out[3:] += dx[3:]
    return rotation.multiply(rotation.from_rotvec(dx[:3]), q), out


@pytest.mark.parametrize("kind", COUNT)
def test_rows_are_the_derivatives_of_what_is_predicted(kind):
    """Left out of the rows on purpose: attitude and biases inside accelerations that only multiply a delay."""
    h = 1e-6
    H = event(kind, Q, X)[1]
    for i in range(N):
        dx = np.zeros(N)
        dx[i] = h
        slope = -(event(kind, *moved(Q, X, dx))[0] - event(kind, *moved(Q, X, -dx))[0]) / (2.0 * h)
        loose = 1.1 if kind in (VELOCITY, POSITION) and (i < 3 or 12 <= i < 15) else 0.06 if kind == MAG else 1e-6
        assert slope == pytest.approx(H[:, i], abs=loose), i


def test_the_rows_of_the_start_are_those_of_a_field_sample():
    hi, hv, work, r, R = (
        np.zeros((3, WIDE), np.int64),
        np.zeros((3, WIDE)),
        np.zeros((4, 3)),
        np.zeros(3),
        np.zeros((3, 3)),
    )
    to_matrix3(Q, R)
    field_rows(X, X, R, R, 0.0, np.zeros(3), np.zeros(3), False, work, r, hi, hv)
    dense = np.zeros((3, N))
    for i in range(3):
        dense[i, hi[i, :11]] = hv[i, :11]
    assert field_matrix(rotation.to_matrix(Q), X) == pytest.approx(dense, abs=1e-12)


def test_a_residual_linear_about_the_state_itself_is_the_plain_one():
    hi, hv, work, R = np.zeros((3, WIDE), np.int64), np.zeros((3, WIDE)), np.zeros((4, 3)), np.zeros((3, 3))
    to_matrix3(Q, R)
    found = []
    for linear in (False, True):
        r = np.zeros(3)
        field_rows(X, X, R, R, LATE, RATE, np.array([0.1, 0.2, 0.3]), linear, work, r, hi, hv)
        found.append(r)
    assert found[1] == pytest.approx(found[0], abs=1e-12)


def carried(q, x, gyr, acc, dt):
    """State and sums after some samples."""
    q, x, sums, R = q.copy(), x.copy(), np.zeros(SUMS), np.zeros((3, 3))
    n = len(gyr)
    carry(np.full(n, dt), gyr, acc, np.zeros(n, np.int8), 0, n - 1, 9.8, q, x, R, np.empty((n, 4)), sums)
    return q, x, sums


def test_the_transition_is_the_derivative_of_the_motion():
    """Over a node of five samples; what is left is of second order in its length."""
    gyr = 0.8 * RANDOM.standard_normal((5, 3))
    acc = np.array([0.0, 0.0, -9.8]) + 2.0 * RANDOM.standard_normal((5, 3))
    q1, x1, sums = carried(Q, X, gyr, acc, 0.004)
    phi = transition_matrix(sums, 0, 1e12)
    h = 1e-6
    for i in range(N):
        dx = np.zeros(N)
        dx[i] = h
        q2, x2, _ = carried(*moved(Q, X, dx), gyr, acc, 0.004)
        turned = rotation.to_rotvec(rotation.multiply(q2, rotation.conjugate(q1)))
        slope = np.concatenate([turned, (x2 - x1)[3:]]) / h
        # Gyro scale and bias multiply each other in the motion, which the rows leave out; biases here are large.
        assert slope == pytest.approx(phi[:, i], abs=4e-3), i


def random_covariance():
    root = RANDOM.standard_normal((N, N))
    P = root @ root.T
    return 0.5 * (P + P.T)


@pytest.mark.parametrize("rest", [0, 1])
def test_a_covariance_moves_by_the_transition_and_stays_symmetric_to_the_bit(rest):
    sums, M = RANDOM.standard_normal(SUMS), np.zeros((5, 3, 3))
    sums[0] = 0.02
    phi, P = transition_matrix(sums, rest, 0.1), random_covariance()
    moved_on = padded(P)
    predict(moved_on, sums, rest, 0.1, M)
    assert square(moved_on) == pytest.approx(phi @ P @ phi.T, abs=1e-10)
    assert np.array_equal(square(moved_on), square(moved_on).T)
    lam, back = RANDOM.standard_normal(ROW), padded(P)
    expected = phi.T @ lam[:N]
    undo(lam, back, sums, rest, 0.1, M)
    assert square(back) == pytest.approx(phi.T @ P @ phi, abs=1e-10)
    assert np.array_equal(square(back), square(back).T)
    assert lam[:N] == pytest.approx(expected, abs=1e-12)


def test_three_updates_at_once_are_three_one_after_the_other():
    P, hi = random_covariance(), np.array([[0, 5, 20], [1, 5, 38], [2, 20, 30]])
    hv, u = RANDOM.standard_normal((3, 3)), np.zeros(3 * ROW)
    expected = P.copy()
    for i in range(3):
        h = np.zeros(N)
        h[hi[i]] = hv[i]
        ph = expected @ h
        s = h @ ph + 0.5
        u[i * ROW : i * ROW + N] = ph / np.sqrt(s)
        expected -= np.outer(ph, ph) / s
    flat = padded(P)
    shrink(flat, 3, u)
    assert square(flat) == pytest.approx(expected, abs=1e-12)
    assert np.array_equal(square(flat), square(flat).T)


def test_updates_are_undone_one_by_one_whatever_the_group():
    """Five updates, two and three at once, against the equations of the file's head."""
    count, hi = 5, np.array([[0, 5, 20], [1, 5, 38], [2, 20, 30], [3, 4, 5], [0, 1, 2]], np.int8)
    H, K, lam = RANDOM.standard_normal((count, 3)), RANDOM.standard_normal((count, N)), RANDOM.standard_normal(N)
    s, nu, L = RANDOM.uniform(1, 2, count), RANDOM.standard_normal(count), random_covariance()
    rows = np.zeros((count, ROW))
    rows[:, :N] = K
    flat_lam, flat, score = np.append(lam, 0.0), padded(L), np.zeros(count)
    back_through_updates(
        0,
        count,
        rows.ravel(),
        H,
        hi,
        np.full(count, 3, np.int8),
        s,
        nu,
        flat_lam,
        flat,
        np.zeros(3 * ROW),
        np.zeros(3 * ROW),
        np.zeros(3 * ROW),
        score,
    )
    for k in range(count - 1, -1, -1):
        h = np.zeros(N)
        h[hi[k]] = H[k]
        u, D, Lk = nu[k] / s[k] + K[k] @ lam, 1 / s[k] + K[k] @ L @ K[k], L @ K[k]
        assert score[k] == pytest.approx(u * u / D)
        lam, L = lam - h * u, L - np.outer(h, Lk) - np.outer(Lk, h) + D * np.outer(h, h)
    assert flat_lam[:N] == pytest.approx(lam)
    assert square(flat) == pytest.approx(L, rel=1e-9, abs=1e-9)
    assert np.array_equal(square(flat), square(flat).T)
