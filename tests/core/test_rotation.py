"""Rotations agree with scipy, with closed forms, and keep what rotations keep."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation, Slerp

from attlog.core import rotation

quaternions = (
    arrays(np.float64, (4,), elements=st.floats(-1, 1, width=32))
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
angles = st.floats(-3.1, 3.1)


def scipy_of(q: np.ndarray) -> Rotation:
    """The same rotation in scipy, whose scalar comes last."""
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


def same(a: np.ndarray, b: np.ndarray, tolerance: float = 1e-7) -> None:
    """Both quaternions turn alike (q and -q do)."""
    np.testing.assert_allclose(np.abs(np.sum(a * b, axis=-1)), 1.0, atol=tolerance)


@pytest.fixture
def many() -> np.ndarray:
    """A thousand attitudes all over the sphere."""
    return rotation.normalize(np.random.default_rng(3).standard_normal((1000, 4)))


def test_vectors_products_and_matrices_turn_as_in_scipy(many):
    other = rotation.normalize(np.random.default_rng(4).standard_normal((1000, 4)))
    v = np.random.default_rng(5).standard_normal((1000, 3))
    np.testing.assert_allclose(rotation.rotate(many, v), scipy_of(many).apply(v), atol=1e-12)
    np.testing.assert_allclose(rotation.rotate_inverse(many, v), scipy_of(many).inv().apply(v), atol=1e-12)
    np.testing.assert_allclose(rotation.to_matrix(many), scipy_of(many).as_matrix(), atol=1e-12)
    same(rotation.multiply(many, other), np.roll((scipy_of(many) * scipy_of(other)).as_quat(), 1, axis=1), 1e-12)


def test_euler_angles_are_those_of_scipy_in_the_order_z_y_x(many):
    expected = scipy_of(many).as_euler("ZYX")[:, ::-1]
    np.testing.assert_allclose(rotation.to_euler(many), expected, atol=1e-9)
    same(rotation.from_euler(*expected.T), many, 1e-12)


def test_rotation_vectors_are_those_of_scipy(many):
    np.testing.assert_allclose(rotation.to_rotvec(many), scipy_of(many).as_rotvec(), atol=1e-9)
    same(rotation.from_rotvec(scipy_of(many).as_rotvec()), many, 1e-12)


def test_slerp_is_that_of_scipy_and_silent_outside():
    t = np.array([0.0, 1.0, 2.5, 4.0])
    q = rotation.normalize(np.random.default_rng(6).standard_normal((4, 4)))
    at = np.linspace(0, 4, 41)
    same(rotation.slerp(t, q, at), np.roll(Slerp(t, scipy_of(q))(at).as_quat(), 1, axis=1), 1e-9)
    assert np.isnan(rotation.slerp(t, q, [-0.1, 4.1])).all()
    assert np.isnan(rotation.slerp(t[:1], q[:1], [0.5])).all()
    np.testing.assert_allclose(rotation.slerp(t[:1], q[:1], [0.0])[0], q[0])


def test_the_mean_attitude_is_that_of_scipy():
    base = rotation.from_euler(0.1, -0.2, 3.1)
    noise = rotation.from_rotvec(0.2 * np.random.default_rng(7).standard_normal((200, 3)))
    q = rotation.multiply(base, noise) * np.where(np.arange(200) % 2, 1.0, -1.0)[:, None]
    same(rotation.mean(q), np.roll(scipy_of(q).mean().as_quat(), 1), 1e-9)


def test_a_pitch_of_ninety_degrees_gives_finite_angles_that_turn_alike():
    q = rotation.from_euler(0.3, np.pi / 2, 1.0)
    angles = rotation.to_euler(q)
    assert np.isfinite(angles).all()
    np.testing.assert_allclose(angles[1], np.pi / 2, atol=1e-7)


def test_float32_quaternions_read_as_their_own_rounding_and_not_as_six_hundredths_of_a_degree(many):
    """The scalar part's acos turns float32 rounding into 0.06 deg; the vector part does not."""
    stored = rotation.normalize(many.astype(np.float32))
    total = np.degrees(rotation.total_angle(rotation.earth_error(stored, many)))
    assert total.max() < 2e-5
    q0 = np.clip(np.abs(np.sum(stored.astype(np.float32) * many.astype(np.float32), axis=1)), 0, 1)
    assert np.degrees(2 * np.arccos(q0)).max() > 0.01


def test_an_error_splits_into_heading_and_tilt_in_earth_axes():
    ref = rotation.from_euler(0.5, -0.7, 2.0)
    e = rotation.earth_error(rotation.turn_about_down(ref, np.radians(7.0)), ref)
    np.testing.assert_allclose(np.degrees(rotation.heading_angle(e)), 7.0)
    np.testing.assert_allclose(rotation.tilt_angle(e), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.degrees(rotation.total_angle(e)), 7.0)
    tilted = rotation.multiply(rotation.from_rotvec(np.radians([3.0, 4.0, 0.0])), ref)
    e = rotation.earth_error(tilted, ref)
    np.testing.assert_allclose(np.degrees(rotation.tilt_angle(e)), 5.0)
    np.testing.assert_allclose(rotation.heading_angle(e), 0.0, atol=1e-12)


@given(est=quaternions, ref=quaternions, angle=angles)
def test_errors_do_not_depend_on_where_north_is_nor_on_signs(est, ref, angle):
    """Yaw equivariance: turning both attitudes about down changes no error angle."""
    e = rotation.earth_error(est, ref)
    turned = rotation.earth_error(rotation.turn_about_down(est, angle), -rotation.turn_about_down(ref, angle))
    for measure in (rotation.total_angle, rotation.tilt_angle):
        assert measure(turned) == pytest.approx(float(measure(e)), abs=1e-7)
    if rotation.tilt_angle(e) < 3.0:
        assert rotation.wrap(rotation.heading_angle(turned) - rotation.heading_angle(e)) == pytest.approx(0, abs=1e-6)


def test_many_rows_are_turned_as_each_alone():
    """Long logs go through in blocks: nothing may happen where one ends."""
    n = 2 * rotation.BLOCK_ROWS + 17
    rng = np.random.default_rng(8)
    a, b = (rotation.normalize(rng.standard_normal((n, 4))) for _ in range(2))
    v = rng.standard_normal((n, 3))
    ends = [0, rotation.BLOCK_ROWS - 1, rotation.BLOCK_ROWS, 2 * rotation.BLOCK_ROWS, n - 1]
    for function, rows in (
        (rotation.multiply, (a, b)),
        (rotation.multiply, (a[0], b)),
        (rotation.multiply, (a, b[:1])),
        (rotation.rotate, (a, v)),
        (rotation.rotate, (a, v[0])),
        (rotation.to_rotvec, (a,)),
        (rotation.from_rotvec, (v,)),
        (rotation.to_euler, (a,)),
        (rotation.to_matrix, (a,)),
        (rotation.normalize, (3.0 * a,)),
    ):
        whole = function(*rows)
        assert len(whole) == n
        for k in ends:
            alone = function(*(x[min(k, len(x) - 1)] if x.ndim == 2 else x for x in rows))
            np.testing.assert_allclose(whole[k], alone, rtol=1e-14, atol=1e-15)
    t = np.arange(float(n))
    at = np.linspace(0.0, n - 1.0, n)
    np.testing.assert_allclose(rotation.slerp(t, a, at)[ends], [rotation.slerp(t, a, x)[0] for x in at[ends]])


def test_between_close_and_far_attitudes_interpolation_is_that_of_scipy():
    """On both sides of the angle up to which series are used, and in any order of times."""
    rng = np.random.default_rng(8)
    t = np.arange(200.0)
    angles = np.concatenate([[0.0, 1e-12, 1e-6], np.geomspace(1e-3, 3.0, 196)])
    steps = Rotation.from_rotvec(angles[:, None] * rotation.rotate(rotation.normalize(rng.normal(size=4)), [1.0, 0, 0]))
    q = [np.array([1.0, 0.0, 0.0, 0.0])]
    for step in np.roll(steps.as_quat(), 1, axis=1):
        q.append(rotation.multiply(q[-1], step) * rng.choice([-1.0, 1.0]))
    at = rng.permutation(np.concatenate([rng.uniform(0.0, 199.0, 2000), t]))
    wanted = Slerp(t, scipy_of(np.array(q)))(at)
    found = rotation.slerp(t, np.array(q), at)
    assert (scipy_of(found) * wanted.inv()).magnitude().max() < 1e-14
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-14)


def test_interpolation_never_crosses_segments_and_tells_the_sample_before():
    t, q = np.arange(5.0), rotation.from_euler(0.1 * np.arange(5.0), 0.0, 0.0)
    found, before = rotation.slerp_in_segments(
        t, q, np.array([0, 0, 0, 1, 1]), [2.5, -1.0, 0.5, 4.0, 2.0, 5.0, np.nan, 3.5]
    )
    np.testing.assert_array_equal(before, [-1, -1, 0, 4, 2, -1, -1, 3])
    np.testing.assert_array_equal(np.isfinite(found).all(axis=1), before >= 0)
    np.testing.assert_array_equal(found[3], q[4])
    assert rotation.to_euler(found[[2, 7]])[:, 0] == pytest.approx([0.05, 0.35], abs=1e-12)
    assert len(rotation.slerp_in_segments(t[:0], q[:0], None, [1.0])[0]) == 1


def test_increments_are_the_rotations_between_neighbours():
    q = rotation.normalize(np.random.default_rng(5).standard_normal((2 * rotation.BLOCK_ROWS + 3, 4)))
    wanted = (scipy_of(q[:-1]).inv() * scipy_of(q[1:])).as_rotvec()
    np.testing.assert_allclose(rotation.increments(q), wanted, atol=1e-9)
    assert rotation.increments(q[:1]).shape == rotation.increments(q[:0]).shape == (0, 3)
