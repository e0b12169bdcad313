"""The vector maths of filter steps against scipy's rotations: other numbers about every axis."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm  # type: ignore[import-untyped]
from scipy.spatial.transform import Rotation

from attlog.estimators import vectors

RNG = np.random.default_rng(4)
STARTS = Rotation.from_quat(RNG.normal(size=(6, 4)))
RATES = RNG.normal(size=(6, 3)) * [3.0, 1.0, 2.0]
DT = 0.1


def scalar_first(r: Rotation) -> np.ndarray:
    return np.roll(r.as_quat(), 1, axis=-1)


def turned_by(rate: np.ndarray, dt: float) -> Rotation:
    return Rotation.from_rotvec(rate * dt)


@pytest.mark.parametrize("k", range(6))
def test_a_turn_is_the_exponential_of_the_rate_from_the_right(k: int) -> None:
    state = np.concatenate([scalar_first(STARTS[k]) * (1.0 + 2e-8), [7.0]])
    vectors.turn(state, *RATES[k], DT, 0.0)
    wanted = STARTS[k] * turned_by(RATES[k], DT)
    np.testing.assert_allclose(state[:4] * np.sign(state[:4] @ scalar_first(wanted)), scalar_first(wanted), atol=1e-12)
    assert state[4] == 7.0


@pytest.mark.parametrize("k", range(3))
def test_a_turn_of_first_order_adds_half_the_product_and_normalises(k: int) -> None:
    q = scalar_first(STARTS[k])
    state = q.copy()
    vectors.turn(state, *RATES[k], DT, 1.0)
    w, x, y, z = q
    p, r, s = RATES[k]
    product = np.array([-x * p - y * r - z * s, w * p + y * s - z * r, w * r + z * p - x * s, w * s + x * r - y * p])
    wanted = q + 0.5 * DT * product
    np.testing.assert_allclose(state, wanted / np.linalg.norm(wanted), atol=1e-12)


def test_a_step_never_turns_by_more_than_two_radians() -> None:
    for size in (2.1, 30.0, 1e3):
        state = np.array([1.0, 0.0, 0.0, 0.0])
        vectors.turn(state, 0.6 * size, 0.0, -0.8 * size, 1.0, 0.0)
        angle = 2.0 * np.arccos(state[0] / np.linalg.norm(state))
        assert angle <= 2.0 + 1e-6
        assert angle == pytest.approx(4.0 * (0.5 * size) / (1.0 + (0.5 * size) ** 2), rel=1e-5)


@pytest.mark.parametrize("k", range(6))
def test_down_is_the_third_row_of_the_rotation(k: int) -> None:
    np.testing.assert_allclose(vectors.down(scalar_first(STARTS[k])), STARTS[k].as_matrix()[2], atol=1e-12)


@pytest.mark.parametrize("k", range(6))
def test_gravitys_error_is_the_cross_product_of_measured_and_predicted_down(k: int) -> None:
    q, force = scalar_first(STARTS[k]), np.array([3.0, -5.0, -8.0])
    down = STARTS[k].as_matrix()[2]
    unit = -force / np.linalg.norm(force)
    np.testing.assert_allclose(vectors.gravity_error(q, force, 0.0), np.cross(unit, down), atol=1e-12)
    np.testing.assert_allclose(vectors.gravity_error(q, force, 1.0), np.cross(-force / 9.80665, down), atol=1e-12)
    np.testing.assert_array_equal(vectors.gravity_error(q, np.zeros(3), 0.0), np.zeros(3))


@pytest.mark.parametrize("k", range(6))
def test_the_fields_error_turns_about_down_or_towards_the_whole_vector(k: int) -> None:
    q, field, r = scalar_first(STARTS[k]), np.array([0.2, -0.1, 0.45]), STARTS[k].as_matrix()
    north, east, below = r @ field
    level = np.hypot(north, east)
    np.testing.assert_allclose(vectors.field_error(q, field, 0.0), r.T @ [0.0, 0.0, -east / level], atol=1e-12)
    earth = r.T @ np.array([level, 0.0, below]) / np.linalg.norm(field)
    wanted = np.cross(field / np.linalg.norm(field), earth)
    np.testing.assert_allclose(vectors.field_error(q, field, 1.0), wanted, atol=1e-12)
    for form in (0.0, 1.0):
        np.testing.assert_array_equal(np.abs(vectors.field_error(q, np.zeros(3), form)), np.zeros(3))


@pytest.mark.parametrize("k", range(6))
def test_a_vector_of_the_earth_turns_back_as_the_body_turns(k: int) -> None:
    v = np.array([0.3, -0.7, 1.1])
    wanted = turned_by(RATES[k], DT).inv().apply(v)
    np.testing.assert_allclose(vectors.turned_back(*v, *RATES[k], DT), wanted, atol=1e-12)
    vectors.turn_vector_back(v, *RATES[k], DT)
    np.testing.assert_allclose(v, wanted, atol=1e-12)


def matrix_state(r: Rotation, q: np.ndarray, at: int = 5) -> np.ndarray:
    state = np.zeros(at + 10)
    state[:4], state[at : at + 9], state[4], state[-1] = q, r.as_matrix().ravel(), 3.0, 8.0
    return state


@pytest.mark.parametrize("k", range(6))
def test_a_quaternion_is_that_of_its_matrix_with_the_sign_of_the_last_one(k: int) -> None:
    before = (STARTS[k] * turned_by(RATES[k], 0.3)).as_quat()
    for sign in (1.0, -1.0):
        last = sign * np.roll(before, 1)
        state = matrix_state(STARTS[k], last)
        vectors.quaternion_from_matrix(state, 5)
        wanted = scalar_first(STARTS[k])
        np.testing.assert_allclose(state[:4], wanted * np.sign(wanted @ last), atol=1e-12)


@pytest.mark.parametrize("k", range(6))
def test_a_matrix_turns_by_rodrigues_and_stays_orthonormal(k: int) -> None:
    state = matrix_state(STARTS[k], np.zeros(4))
    vectors.turn_matrix(state, 5, *RATES[k], DT, 0.0)
    x, y, z = RATES[k] * DT
    wanted = STARTS[k].as_matrix() @ expm(np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
    np.testing.assert_allclose(state[5:14].reshape(3, 3), wanted, atol=1e-10)
    first = matrix_state(STARTS[k], np.zeros(4))
    vectors.turn_matrix(first, 5, *(0.02 * RATES[k]), DT, 1.0)
    step = 0.02 * RATES[k] * DT
    skew = np.array([[0.0, -step[2], step[1]], [step[2], 0.0, -step[0]], [-step[1], step[0], 0.0]])
    np.testing.assert_allclose(first[5:14].reshape(3, 3), STARTS[k].as_matrix() @ (np.eye(3) + skew), atol=1e-4)
