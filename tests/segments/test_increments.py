"""The gyro's rotation between instants is that of multiplying small rotations one after the other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.segments.increments import Turning


@pytest.mark.parametrize("sampling", ["interval", "instant"])
def test_rotation_over_an_interval_is_the_product_of_its_samples(sampling):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.003, 0.006, 4000))
    rate = np.radians(120) * np.sin(np.outer(t, [3.1, 2.3, 1.7]) + np.arange(3))
    edges = np.arange(0, 3990, 20)
    found = Turning(t, rate, sampling).between(t[edges[:-1]], t[edges[1:]])
    mean = rate[1:] if sampling == "interval" else 0.5 * (rate[1:] + rate[:-1])
    steps = Rotation.from_rotvec(mean * np.diff(t)[:, None])
    for k, (a, b) in enumerate(pairwise(edges)):
        product = Rotation.identity()
        for i in range(a, b):
            product = product * steps[i]
        off = Rotation.from_rotvec(found[k]).inv() * product
        assert np.degrees(off.magnitude()) < 0.01


def test_a_cone_turns_about_its_axis_though_no_rate_does():
    """Coning: rates about x and y in quadrature turn the body about z; the plain sum of angles misses it."""
    t = np.arange(0, 1, 1e-4)
    amplitude, frequency = np.radians(2.0), 2 * np.pi * 20
    rate = amplitude * frequency * np.column_stack([np.cos(frequency * t), np.sin(frequency * t), 0 * t])
    start, end = np.array([0.1]), np.array([0.6])
    found = Turning(t, rate, "instant").between(start, end)[0]
    expected = 0.5 * amplitude**2 * frequency * 0.5
    assert found[2] == pytest.approx(expected, rel=0.02)


def test_long_logs_are_summed_in_blocks_without_seams(monkeypatch):
    rng = np.random.default_rng(2)
    t, rate = np.arange(1000) * 0.01, rng.normal(size=(1000, 3))
    at = np.sort(rng.uniform(0, 9.99, 50))
    whole = Turning(t, rate).between(at[:-1], at[1:])
    monkeypatch.setattr("attlog.segments.increments.CHUNK", 7)
    np.testing.assert_allclose(Turning(t, rate).between(at[:-1], at[1:]), whole, atol=1e-12)
