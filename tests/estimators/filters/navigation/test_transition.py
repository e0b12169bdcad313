"""The transition of the error state against a matrix product of numpy, written from the equations of the model."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.estimators.filters.navigation.layout import ROW, SUMS, N
from attlog.estimators.filters.navigation.motion import cross_times, padded, predict, square, undo

RANDOM = np.random.default_rng(11)


def cross(a: np.ndarray) -> np.ndarray:
    return np.array([np.cross(a, axis) for axis in np.eye(3)]).T


def transition(T: float, a: np.ndarray, D: np.ndarray, W: np.ndarray, rest: int, tau: float) -> np.ndarray:
    """Attitude 0, velocity 3, position 6, gyro bias 9, accelerometer bias 12, wandering 27, gyro scale 36."""
    Phi, A = np.eye(N), cross(a)
    Phi[6:9, 3:6] = T * np.eye(3)
    Phi[6:9, 0:3], Phi[6:9, 12:15] = -0.5 * T * A, -0.5 * T * D
    Phi[3:6, 0:3], Phi[3:6, 12:15] = -A, -D
    if not rest:
        Phi[3:6, 9:12], Phi[3:6, 36:39] = 0.5 * A @ D, 0.5 * A @ W
        Phi[0:3, 9:12], Phi[0:3, 36:39] = -D, -W
    Phi[27:30, 27:30] = np.exp(-T / tau) * np.eye(3)
    return Phi


def test_a_cross_product_with_a_matrix_is_that_of_its_columns() -> None:
    a, m, out = RANDOM.normal(size=3), RANDOM.normal(size=(3, 3)), np.zeros((3, 3))
    cross_times(a, m, out)
    assert out == pytest.approx(np.cross(a, m, axisb=0, axisc=0))


@pytest.mark.parametrize("rest", [0, 1])
def test_a_covariance_moves_forth_by_the_transition_and_information_back_by_its_transpose(rest: int) -> None:
    sums = RANDOM.normal(size=SUMS)
    sums[0] = 0.3
    Phi = transition(0.3, sums[1:4], sums[4:13].reshape(3, 3), sums[13:22].reshape(3, 3), rest, 0.7)
    root = RANDOM.normal(size=(N, N))
    P, M = root @ root.T, np.zeros((5, 3, 3))
    moved = padded(P)
    predict(moved, sums, rest, 0.7, M)
    assert square(moved) == pytest.approx(Phi @ P @ Phi.T, rel=1e-9, abs=1e-9)
    lam, L = RANDOM.normal(size=ROW), padded(P)
    want = Phi.T @ lam[:N]
    undo(lam, L, sums, rest, 0.7, M)
    assert lam[:N] == pytest.approx(want)
    assert square(L) == pytest.approx(Phi.T @ P @ Phi, rel=1e-9, abs=1e-9)
