"""The 12-state filter against a dense one written from the paper's matrices, and its covariance over a long run."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, Out1, Out2
from attlog.estimators import estimate, get
from attlog.estimators.filters import ekf12
from attlog.estimators.filters.ekf12 import step as ekf12_step
from attlog.testing import Noise, flight, still
from attlog.testing.motions import total_deg

NOISE = Noise(gyro=1e-3, acc=0.05, mag=1e-6, bias=(0.01, -0.01, 0.02))


def skew(v: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def dynamics(x: np.ndarray, dt: float) -> np.ndarray:
    """(6-8), one Euler step; the rate first, because the one after it is that of the gyro's sample."""
    return vectors(rates(x, dt), dt)


def rates(x: np.ndarray, dt: float) -> np.ndarray:
    """w and w_dot of (7)."""
    return np.concatenate([x[:3] + dt * x[3:6], x[3:]])


def vectors(x: np.ndarray, dt: float) -> np.ndarray:
    """g and M of (8)."""
    w, _, g, m = x.reshape(4, 3)
    return np.concatenate([x[:6], g - dt * np.cross(w, g), m - dt * np.cross(w, m)])


def rate_transition(dt: float) -> np.ndarray:
    """The rows of w and w_dot of F in (11)."""
    f = np.eye(12)
    f[:3, 3:6] = dt * np.eye(3)
    return f


def vector_transition(x: np.ndarray, dt: float) -> np.ndarray:
    """The rows of g and M of F in (11)."""
    w, _, g, m = x.reshape(4, 3)
    f = np.eye(12)
    for i, v in ((6, g), (9, m)):
        f[i : i + 3, :3] = dt * skew(v)
        f[i : i + 3, i : i + 3] = np.eye(3) - dt * skew(w)
    return f


def dense_step(
    x: np.ndarray, p: np.ndarray, v: np.ndarray, dt: float, gyr: np.ndarray, acc: np.ndarray, mag: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rate, gyro, vectors, joint update of g and M with whole matrices; v are the parameters in their order."""
    f = rate_transition(dt)
    x, p = rates(x, dt), f @ p @ f.T + np.diag(np.repeat([0.0, v[3] ** 2 * dt, 0.0, 0.0], 3))
    x, p = dense_update(x, p, np.eye(12)[:3], gyr, v[[0, 0, 0]] ** 2 / dt)
    f = vector_transition(x, dt)
    x, p = vectors(x, dt), f @ p @ f.T + np.diag(np.repeat([0.0, 0.0, v[4] ** 2 * dt, v[5] ** 2 * dt], 3))
    z = np.concatenate([-acc, mag / np.linalg.norm(mag)])
    return dense_update(x, p, np.eye(12)[6:], z, v[[1, 1, 1, 2, 2, 2]] ** 2 / dt)


def dense_update(
    x: np.ndarray, p: np.ndarray, h: np.ndarray, z: np.ndarray, r: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """K = P H^T (H P H^T + R)^-1 with the diagonal r of R."""
    k = p @ h.T @ np.linalg.inv(h @ p @ h.T + np.diag(r))
    return x + k @ (z - h @ x), (np.eye(12) - k @ h) @ p


def parameters() -> np.ndarray:
    e = get("ekf12")
    return e.pack({name: value for name, (value, _) in e.resolve("fan").items()})


def printed_step(
    x: np.ndarray, p: np.ndarray, v: np.ndarray, dt: float, gyr: np.ndarray, acc: np.ndarray, mag: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(10) in its own order with whole matrices: all predicted with F of (11), then one update by all nine numbers."""
    w, w_dot, g, m = x.reshape(4, 3)
    f = np.eye(12)
    f[:3, 3:6] = dt * np.eye(3)
    f[6:9, :3], f[9:, :3] = dt * skew(g), dt * skew(m)
    f[6:9, 6:9] = f[9:, 9:] = np.eye(3) - dt * skew(w)
    x = np.concatenate([w + dt * w_dot, w_dot, g - dt * np.cross(w, g), m - dt * np.cross(w, m)])
    p = f @ p @ f.T + dt * np.diag(np.repeat([0.0, v[3], v[4], v[5]], 3) ** 2)
    z = np.concatenate([gyr, -acc, mag / np.linalg.norm(mag)])
    return dense_update(x, p, np.eye(12)[[0, 1, 2, 6, 7, 8, 9, 10, 11]], z, np.repeat(v[:3], 3) ** 2 / dt)


def initial(m: object, params: np.ndarray) -> np.ndarray:
    return ekf12.start(params, m.acc[0], m.mag[0], m.q[0])


def test_the_sparse_prediction_is_the_dense_one() -> None:
    random = np.random.default_rng(5)
    state = np.zeros(233)
    x = random.standard_normal(12)
    root = random.standard_normal((12, 12))
    state[4:16], state[16:160] = x, (root @ root.T).ravel()
    first_order = np.array([0.0, 0, 0, 0, 0, 0, 1])
    ekf12.predict_rate(state, first_order, 0.01)
    ekf12.predict_vectors(state, first_order, 0.01)
    f = vector_transition(rates(x, 0.01), 0.01) @ rate_transition(0.01)
    assert state[16:160].reshape(12, 12) == pytest.approx(f @ root @ root.T @ f.T, abs=1e-12)
    assert state[4:16] == pytest.approx(dynamics(x, 0.01), abs=1e-15)


def test_vectors_turn_exactly_unless_the_paper_s_step_is_asked_for() -> None:
    """A turn of 60 deg in one step: exact keeps g's length, (8) makes it 1.45 times as long."""
    for first_order, longer in ((0.0, 1.0), (1.0, np.hypot(1.0, np.pi / 3))):
        state = np.zeros(233)
        state[4:7], state[10:13] = [np.pi / 3, 0.0, 0.0], [0.0, 0.0, 9.8]
        ekf12.predict_vectors(state, np.array([0.0, 0, 0, 0, 0, 0, first_order]), 1.0)
        assert np.linalg.norm(state[10:13]) == pytest.approx(9.8 * longer)
        if not first_order:
            assert state[10:13] == pytest.approx([0.0, 9.8 * np.sin(np.pi / 3), 4.9])


def test_states_and_covariance_equal_an_independent_dense_filter() -> None:
    m = flight(5.0, 200.0, noise=NOISE)
    params = parameters()
    state = initial(m, params)
    x, p = state[4:16].copy(), state[16:160].reshape(12, 12).copy()
    for k in range(1, len(m.t)):
        ekf12.step(state, params, 0.005, m.gyr[k], m.acc[k], m.mag[k])
        x, p = dense_step(x, p, params, 0.005, m.gyr[k], m.acc[k], m.mag[k])
        assert state[4:16] == pytest.approx(x, abs=1e-8)
    assert state[16:160].reshape(12, 12) == pytest.approx(p, abs=1e-8)


def test_the_printed_preset_is_a_dense_filter_that_predicts_everything_and_then_updates() -> None:
    """From q = (1, 0, 0, 0): g is down, M north and dips as the measured vectors say."""
    m = flight(5.0, 200.0, noise=NOISE)
    e = estimate("ekf12@fan-printed", *m.sensors)
    assert e.q[0] == pytest.approx([1.0, 0.0, 0.0, 0.0])
    x = np.concatenate([e.aux[name][0] for name in ("rate", "rate_dot", "gravity", "field")])
    assert x[:9] == pytest.approx([0.0] * 8 + [9.80665])
    assert x[10] == 0.0
    assert np.linalg.norm(x[9:]) == pytest.approx(1.0)
    p = np.diag(np.repeat([1.0, 10.0, 0.980665, 0.1], 3) ** 2)
    params = parameters()
    for k in range(1, len(m.t)):
        x, p = printed_step(x, p, params, 0.005, m.gyr[k], m.acc[k], m.mag[k])
        assert e.aux["gravity"][k] == pytest.approx(x[6:9], abs=1e-8)
        assert e.aux["field"][k] == pytest.approx(x[9:], abs=1e-8)


def test_attitude_is_the_papers_three_angles() -> None:
    """(5) and (12) with the signs that the docstring gives, from the filter's own g and M."""
    m = flight(10.0, noise=NOISE)
    e = estimate("ekf12", *m.sensors)
    g, f = e.aux["gravity"], e.aux["field"]
    roll = np.arctan2(g[:, 1], g[:, 2])
    pitch = np.arctan2(-g[:, 0], np.hypot(g[:, 1], g[:, 2]))
    heading = np.arctan2(
        -(f[:, 1] * np.cos(roll) - f[:, 2] * np.sin(roll)),
        f[:, 0] * np.cos(pitch) + f[:, 1] * np.sin(pitch) * np.sin(roll) + f[:, 2] * np.sin(pitch) * np.cos(roll),
    )
    assert total_deg(e.q, rotation.from_euler(roll, pitch, heading)).max() < 1e-6


def test_the_bandwidth_does_not_depend_on_the_magnetometer_s_rate() -> None:
    """Noise is a density: a heading error of 10 deg fades as fast at 100 Hz as at 10 Hz."""
    m = still(4.0)
    q0 = rotation.turn_about_down(m.q[0], np.deg2rad(10.0))
    slow = np.full_like(m.mag, np.nan)
    slow[::10] = m.mag[::10]
    full = total_deg(estimate("ekf12", *m.sensors, q0=q0).q, m.q)
    thin = total_deg(estimate("ekf12", m.t, m.gyr, m.acc, slow, q0=q0).q, m.q)
    assert full[-1] < 6.0
    assert abs(full[-1] - thin[-1]) < 0.5


@jit.loop("a million steps")
def million(state: Out1, params: F1, gyr: F2, acc: F2, mag: F2, out: Out2) -> None:
    k = 0
    for i in range(len(out)):
        for _ in range(1000):
            k = k + 1 if k + 1 < len(gyr) else 0
            ekf12_step(state, params, 0.005, gyr[k], acc[k], mag[k])
        for j in range(144):
            out[i, j] = state[16 + j]


@pytest.mark.slow
def test_the_covariance_stays_symmetric_and_positive_over_a_million_steps() -> None:
    """Looked at every 1000 steps, in motion, with noise and a slow magnetometer."""
    m = flight(50.0, 200.0, noise=NOISE)
    mag = np.where((np.arange(len(m.t)) % 20 == 0)[:, None], m.mag, 0.0)
    params = parameters()
    out = np.empty((1000, 144))
    million(initial(m, params), params, m.gyr, m.acc, mag, out)
    p = out.reshape(-1, 12, 12)
    scale = np.sqrt(np.einsum("nii->ni", p))
    p = p / scale[:, :, None] / scale[:, None, :]
    assert np.abs(p - np.swapaxes(p, 1, 2)).max() < 1e-9
    assert np.linalg.eigvalsh(p).min() > 1e-9
