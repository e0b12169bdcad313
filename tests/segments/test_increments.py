"""The gyro's rotation between instants is that of multiplying small rotations one after the other."""

from __future__ import annotations

from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.kernels.loops import briefly
from attlog.segments import increments
from attlog.segments.increments import GyroIncrements
from tests.conftest import few


@pytest.fixture(autouse=True, params=[nullcontext, briefly], ids=["compiled", "in numpy"])
def way(request):
    with request.param():
        yield


@pytest.mark.parametrize("sampling", few(["interval", "instant"], 2))
def test_rotation_over_an_interval_is_the_product_of_its_samples(sampling):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.003, 0.006, 4000))
    rate = np.radians(120) * np.sin(np.outer(t, [3.1, 2.3, 1.7]) + np.arange(3))
    edges = np.arange(0, 3990, 20)
    found = GyroIncrements(t, rate, sampling).between(t[edges[:-1]], t[edges[1:]])
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
    found = GyroIncrements(t, rate, "instant").between(start, end)[0]
    expected = 0.5 * amplitude**2 * frequency * 0.5
    assert found[2] == pytest.approx(expected, rel=0.02)


def test_long_logs_are_summed_in_blocks_without_seams(monkeypatch):
    rng = np.random.default_rng(2)
    t, rate = np.arange(1000) * 0.01, rng.normal(size=(1000, 3))
    at = np.sort(rng.uniform(0, 9.99, 50))
    whole = GyroIncrements(t, rate).between(at[:-1], at[1:])
    monkeypatch.setattr("attlog.segments.increments.CHUNK", 7)
    np.testing.assert_allclose(GyroIncrements(t, rate).between(at[:-1], at[1:]), whole, atol=1e-12)


def test_the_gyro_stands_still_outside_its_times_whatever_the_order_in_which_it_is_asked():
    t = np.arange(0.0, 1.0, 0.01)
    turning = GyroIncrements(t, np.tile([0.3, -0.2, 0.1], (len(t), 1)))
    start, end = np.array([0.5, -3.0, 0.2, 0.985, 2.0, np.nan]), np.array([0.505, 0.1, 4.0, 0.995, 3.0, 0.5])
    wanted = np.outer([0.005, 0.1, 0.79, 0.005, 0.0, np.nan], [0.3, -0.2, 0.1])
    np.testing.assert_allclose(turning.between(start, end), wanted, atol=1e-12)
    assert not GyroIncrements(t[:1], np.ones((1, 3))).between(start, end).any()


def test_the_plain_loops_say_what_the_compiled_ones_do():
    rng = np.random.default_rng(3)
    t, rate = np.cumsum(rng.uniform(0.001, 0.02, 300)), rng.normal(size=(300, 3))
    at = rng.uniform(-0.1, t[-1] + 0.1, 40)
    for interval, sampling in enumerate(("instant", "interval")):
        sums, out = np.empty((300, 6)), np.empty((39, 3))
        increments.summed_gyro(sums, t, rate, interval)
        increments.gyro_between(out, t, sums, at[:-1], at[1:])
        np.testing.assert_allclose(out, GyroIncrements(t, rate, sampling).between(at[:-1], at[1:]), atol=1e-13)


def test_the_loops_are_among_what_is_compiled_when_the_package_is_built():
    from attlog import prebuilt

    assert {increments.SUMMED.name, increments.BETWEEN.name} <= {k.name for k in prebuilt.kernels()}
