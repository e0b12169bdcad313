"""The filters as plain numpy arrays are filters: the one is mahony_dcm, the other finds attitude and bias."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators import estimate
from attlog.reproduce.cost import CostSamples
from attlog.reproduce.huang import plain
from attlog.testing import Noise, flight, swing
from attlog.testing.subject import total_deg


def test_mahony_in_numpy_is_mahony_dcm() -> None:
    """The shared loop hands a step the vectors of the sample before and the gyro's own."""
    m = flight(5.0, 400.0)
    s = CostSamples(m.t[1:], m.gyr[1:], m.acc[:-1], m.mag[:-1])
    e = estimate("mahony_dcm@huang", *m.sensors, q0=m.q[0])
    assert plain.mahony(s, m.q[0]) == pytest.approx(rotation.to_matrix(e.q[1:]), abs=1e-6)


def test_the_dense_ekf_follows_the_truth_and_finds_the_bias() -> None:
    bias = np.array([0.02, -0.01, 0.015])
    m = swing(40.0, 400.0, noise=Noise(gyro=1e-4, bias=tuple(bias)))
    x = plain.ekf(CostSamples(m.t[1:], m.gyr[1:], m.acc[1:], m.mag[1:]), m.q[0])
    assert total_deg(x[-2000:, :4], m.q[-2000:]).max() < 1.0
    assert x[-1, 4:] == pytest.approx(bias, abs=1e-3)


def test_the_derivative_of_a_turned_vector_is_the_numerical_one() -> None:
    random = np.random.default_rng(3)
    q, v = random.standard_normal(4), random.standard_normal(3)
    value, by_q = plain.turned_back(q, v)
    unit = rotation.normalize(q)
    assert plain.turned_back(unit, v)[0] == pytest.approx(rotation.rotate_inverse(unit, v))
    steps = 1e-6 * np.eye(4)
    numerical = [(plain.turned_back(q + d, v)[0] - plain.turned_back(q - d, v)[0]) / 2e-6 for d in steps]
    assert by_q == pytest.approx(np.array(numerical).T, abs=1e-8)
    assert value.shape == (3,)


def test_an_update_in_numpy_takes_microseconds() -> None:
    mahony, ekf = plain.nanoseconds(rounds=2, updates=100)
    assert min(*mahony, *ekf) > 5e3
