"""The unscented filter against a dense one written from the paper, its linear limit, and what it promises."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.core.jit.call import compiled
from attlog.core.jit.kernel import with_helpers
from attlog.estimators import EstimatorSpec, estimate, get
from attlog.estimators.aids import SIZE
from attlog.estimators.batch import estimate_batch
from attlog.estimators.filters import ukf
from attlog.testing import Motion, Noise, flight, motion, still, swing
from attlog.testing.motions import GRAVITY, heading_deg, tilt_deg, total_deg

Array = NDArray[np.float64]
NOISE = Noise(gyro=1e-3, acc=0.05, mag=1e-6, bias=(0.01, -0.01, 0.02))
PLAIN = {"acc_factor": 0.0, "gate": 100.0, "norm_limit": 10.0, "dip_limit": 90.0}
"""Without what goes beyond the paper."""
DEG = np.pi / 180.0
NO_AID = np.full(SIZE, np.nan)


def packed(**values: float) -> Array:
    e = get("ukf")
    return e.pack({p.name: p.default for p in e.parameters} | values)


def rodrigues(p: Array) -> Rotation:
    """4 n tan(angle / 4) as a rotation: scipy's modified Rodrigues vector times four."""
    return Rotation.from_mrp(np.asarray(p) / 4.0)


class Dense:
    """Crassidis2003 with lambda = 1, a = 1 in matrices, the error on the right; the update as in the filter."""

    def __init__(self, q: Array, p: Array, values: Array) -> None:
        self.r = Rotation.from_quat(q, scalar_first=True)
        self.b = np.zeros(3)
        self.p, self.v = p, values
        self.since = 0.0

    def points(self) -> Array:
        root = np.linalg.cholesky(7.0 * self.p).T
        return np.vstack([np.zeros(6), root, -root])

    @property
    def weights(self) -> Array:
        return np.r_[1.0 / 7.0, np.full(12, 1.0 / 14.0)]

    def correct(self, x: Array, y: Array, z: Array, r: Array, keep: Array) -> None:
        w = self.weights
        mean = w @ y
        s = (y - mean).T @ np.diag(w) @ (y - mean) + r
        c = x.T @ np.diag(w) @ (y - mean)
        k = keep @ c @ np.linalg.inv(s)
        self.p = self.p - k @ c.T - c @ k.T + k @ s @ k.T
        dx = k @ (z - mean)
        self.r = self.r * rodrigues(dx[:3])
        self.b = self.b + dx[3:]

    def step(self, dt: float, gyr: Array, acc: Array, mag: Array) -> None:
        x = self.points()
        y = np.array([-(GRAVITY * (self.r * rodrigues(i[:3])).inv().apply([0.0, 0.0, 1.0])) for i in x])
        self.correct(x, y, acc, np.eye(3) * self.v[6] ** 2 / dt, np.eye(6))
        self.since += dt
        if mag.any():
            x = self.points()
            north, east, vertical = self.r.apply(mag)
            expected = self.r.inv().apply([np.hypot(north, east), 0.0, vertical])
            h = np.array([(self.r * rodrigues(i[:3])).apply(expected) for i in x])
            heading = np.arctan2(h[:, 1], h[:, 0])[:, None]
            down = self.r.inv().apply([0.0, 0.0, 1.0])
            keep = np.eye(6)
            keep[:3, :3] = np.outer(down, down)
            psi = np.array([-np.arctan2(east, north)])
            self.correct(x, heading, psi, np.array([[(DEG * self.v[8]) ** 2 / self.since]]), keep)
            self.since = 0.0
        x = self.points()
        turns = [rodrigues(i[:3]) * Rotation.from_rotvec((gyr - self.b - i[3:]) * dt) for i in x]
        p = np.array([4.0 * (turns[0].inv() * t).as_mrp() for t in turns])
        moved = np.hstack([p, x[:, 3:]])
        w = self.weights
        mean = w @ moved
        self.p = (moved - mean).T @ np.diag(w) @ (moved - mean)
        rate = gyr - self.b
        walk = (DEG * self.v[0]) ** 2 + self.v[1] ** 2 * (rate @ rate)
        self.p += np.diag(np.repeat([walk, (DEG * self.v[2]) ** 2], 3)) * dt
        self.r = self.r * turns[0] * rodrigues(mean[:3])


def test_attitude_bias_and_covariance_equal_an_independent_dense_filter() -> None:
    """From 40 deg off, where the points lie far apart, with a field in every fifth sample."""
    m = flight(1.5, 200.0, noise=NOISE)
    params = packed(**PLAIN)
    q0 = rotation.multiply(m.q[0], rotation.from_rotvec((0.5, -0.4, 0.3)))
    state = ukf.start(params, m.acc[0], m.mag[0], q0)
    dense = Dense(q0, state[11:47].reshape(6, 6).copy(), params)
    for k in range(1, len(m.t)):
        mag = m.mag[k] if k % 5 == 0 else np.zeros(3)
        ukf.step(state, params, 0.005, m.gyr[k], m.acc[k], mag, NO_AID)
        dense.step(0.005, m.gyr[k], m.acc[k], mag)
        assert total_deg(state[None, :4], dense.r.as_quat(scalar_first=True)[None]).max() < 1e-6
        assert state[4:7] == pytest.approx(dense.b, abs=1e-10)
        assert state[11:47].reshape(6, 6) == pytest.approx(dense.p, abs=1e-9)


def test_for_small_errors_it_is_the_linear_kalman_filter() -> None:
    """At rest and level with tiny variances: x' = F x, f = -g (e_z - e_z x theta), heading = theta_z."""
    dt, params = 0.01, packed(**PLAIN, gyro_noise=1e-3, bias_noise=1e-5, bias_sigma=1e-3, acc_noise=1e-3, mag_noise=0.1)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    state = ukf.start(params, np.array([0.0, 0.0, -GRAVITY]), np.array([0.5, 0.0, 0.8]), q)
    tiny = np.diag(np.repeat([(0.02 * DEG) ** 2, (1e-3 * DEG) ** 2], 3))
    state[11:47] = tiny.ravel()
    x, p = np.zeros(6), tiny.copy()
    f = np.eye(6)
    f[:3, 3:] = -dt * np.eye(3)
    h_force = np.zeros((3, 6))
    h_force[0, 1], h_force[1, 0] = GRAVITY, -GRAVITY
    h_field = np.array([[-0.8 / 0.5, 0.0, 1.0, 0.0, 0.0, 0.0]])
    keep = np.diag([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    random = np.random.default_rng(3)
    for _ in range(500):
        gyr = 1e-5 * random.standard_normal(3)
        acc = np.array([0.0, 0.0, -GRAVITY]) + 1e-3 * random.standard_normal(3)
        turn = 2e-4 * random.standard_normal()
        mag = np.array([0.5 * np.cos(turn), 0.5 * np.sin(turn), 0.8])
        for h, z, r, k_of in (
            (h_force, acc + GRAVITY * np.array([0.0, 0.0, 1.0]), np.eye(3) * params[6] ** 2 / dt, np.eye(6)),
            (h_field, np.array([-turn]), np.array([[(DEG * params[8]) ** 2 / dt]]), keep),
        ):
            s = h @ p @ h.T + r
            k = k_of @ p @ h.T @ np.linalg.inv(s)
            x = x + k @ (z - h @ x)
            p = p - k @ h @ p - p @ h.T @ k.T + k @ s @ k.T
        x = f @ x + np.r_[gyr * dt, 0.0, 0.0, 0.0]
        p = f @ p @ f.T + np.diag(np.repeat([(DEG * params[0]) ** 2, (DEG * params[2]) ** 2], 3)) * dt
        ukf.step(state, params, dt, gyr, acc, mag, NO_AID)
    scale = np.sqrt(np.diag(p))
    found = np.r_[rotation.to_rotvec(state[:4]), state[4:7]]
    assert found / scale == pytest.approx(x / scale, abs=0.01)
    assert state[11:47].reshape(6, 6) / np.outer(scale, scale) == pytest.approx(p / np.outer(scale, scale), abs=0.01)


@pytest.mark.parametrize("turn", [(170.0, 0.0, 0.0), (0.0, 175.0, 0.0), (0.0, 0.0, 170.0), (100.0, 80.0, 60.0)])
def test_it_comes_back_from_any_start_within_seconds(turn: tuple[float, float, float]) -> None:
    m = swing(40.0, noise=NOISE)
    q0 = rotation.multiply(m.q[0], rotation.from_rotvec(np.deg2rad(turn)))
    q = estimate("ukf", *m.sensors, q0=q0).q
    assert tilt_deg(q[100:], m.q[100:]).max() < 4.0
    assert total_deg(q[1000:], m.q[1000:]).max() < 8.0
    assert total_deg(q[3000:], m.q[3000:]).max() < 4.0


def test_the_bias_of_every_axis_is_found_in_motion() -> None:
    m = swing(120.0, noise=NOISE)
    bias = estimate("ukf", *m.sensors).bias
    assert bias is not None
    assert bias[-1] == pytest.approx(NOISE.bias, abs=1.5e-3)


def slowly(t: Array) -> tuple[Array, Array, Array]:
    return 0.5 * np.sin(0.2 * t), 0.4 * np.sin(0.15 * t + 1.0), 0.5 * np.sin(0.1 * t)


def test_its_sigmas_are_honest() -> None:
    """Errors over sigma, pooled over 30 noisy runs whose noise is the one that it expects."""
    noise = Noise(gyro=0.05 * DEG, acc=0.3, mag=1e-6)
    values = PLAIN | {"gyro_noise": 0.05, "rate_noise": 0.0, "bias_noise": 1e-4, "bias_sigma": 0.3, "acc_noise": 0.3}
    # 1e-6 T across a level field of 21e-6 T: 2.7 deg in each sample of 0.01 s.
    values |= {"mag_noise": float(np.rad2deg(1e-6 / 21e-6) * np.sqrt(0.01))}
    random = np.random.default_rng(8)
    tilt, heading = [], []
    for seed in range(30):
        bias = tuple(0.3 * DEG * random.standard_normal(3))
        m = motion(slowly, 40.0, noise=Noise(noise.gyro, noise.acc, noise.mag, bias), seed=seed)
        e = estimate(EstimatorSpec(get("ukf"), params=values), *m.sensors)
        late = slice(2000, None, 100)
        tilt.append(np.deg2rad(tilt_deg(e.q, m.q)[late]) / e.aux["sigma_tilt"][late])
        heading.append(np.deg2rad(heading_deg(e.q, m.q)[late]) / e.aux["sigma_heading"][late])
    assert 0.8 < np.sqrt(np.mean(np.square(tilt))) < 1.25
    assert 0.8 < np.sqrt(np.mean(np.square(heading))) < 1.25


def disturbed(m: Motion, ned: tuple[float, float, float]) -> Array:
    """The field with something more (T, earth axes) from 30 to 40 s."""
    more = np.where(((m.t > 30.0) & (m.t < 40.0))[:, None], np.array(ned), 0.0)
    return m.mag + rotation.rotate_inverse(m.q, more)


def test_a_field_of_another_size_or_dip_does_not_turn_the_heading() -> None:
    m = swing(60.0, noise=Noise(mag=2e-7))
    east = disturbed(m, (0.0, 15e-6, 10e-6))
    on = np.abs(heading_deg(estimate("ukf", m.t, m.gyr, m.acc, east).q, m.q)).max()
    off = np.abs(heading_deg(estimate("ukf:norm_limit=10,dip_limit=90", m.t, m.gyr, m.acc, east).q, m.q)).max()
    assert on < 1.0
    assert off > 4.0


def test_a_heading_that_stays_wrong_is_given_up() -> None:
    """The truth turned by 120 deg at 20 s as if the vehicle had been turned with the gyro off."""
    m = still(90.0)
    mag = np.where((m.t > 20.0)[:, None], rotation.rotate_inverse(rotation.from_euler(0.0, 0.0, 2.0), m.mag), m.mag)
    heading = rotation.to_euler(estimate("ukf", m.t, m.gyr, m.acc, mag).q)[:, 2]
    assert abs(heading[1999]) < 0.01
    assert heading[-1] == pytest.approx(2.0, abs=0.05)


def test_many_parameter_sets_side_by_side_give_what_one_gives() -> None:
    m = flight(10.0, noise=NOISE)
    sets: list[dict[str, float | str]] = [{"acc_noise": 0.2 + 0.1 * i} for i in range(20)]
    for one, values in zip(estimate_batch(get("ukf"), sets, *m.sensors), sets, strict=True):
        alone = estimate(EstimatorSpec(get("ukf"), params=values), *m.sensors)
        assert total_deg(one.q, alone.q).max() < 1e-6
        assert one.aux["sigma_heading"] == pytest.approx(alone.aux["sigma_heading"], rel=1e-9)


@pytest.mark.slow
def test_the_covariance_stays_symmetric_and_positive_over_a_million_steps() -> None:
    """Looked at every 1000 steps, in motion, with noise and a slow magnetometer."""
    m = flight(50.0, 200.0, noise=NOISE)
    mag = np.where((np.arange(len(m.t)) % 20 == 0)[:, None], m.mag, 0.0)
    params = packed()
    loop = """
@njit
def million(state, params, gyr, acc, mag, aid, out):
    k = 0
    for i in range(len(out)):
        for _ in range(1000):
            k = k + 1 if k + 1 < len(gyr) else 0
            step(state, params, 0.005, gyr[k], acc[k], mag[k], aid)
        out[i] = state[11:47]
"""
    million = compiled(with_helpers({"step": ukf.step}, jit=True) + loop, "million")
    out = np.empty((1000, 36))
    million(ukf.start(params, m.acc[0], m.mag[0], m.q[0]), params, m.gyr, m.acc, mag, NO_AID, out)
    p = out.reshape(-1, 6, 6)
    assert np.array_equal(p, np.swapaxes(p, 1, 2))
    scale = np.sqrt(np.einsum("nii->ni", p))
    p = p / scale[:, :, None] / scale[:, None, :]
    assert np.linalg.eigvalsh(p).min() > 1e-9
