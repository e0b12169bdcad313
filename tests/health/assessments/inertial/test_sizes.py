"""Differences of units and blocks of a signal: closed forms with another number in every axis."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.health.assessments.inertial import imu_instances
from attlog.health.assessments.inertial.blocks import Blocks, averaged, blocks
from attlog.health.assessments.inertial.imu_instances import Difference, answer
from tests.health.assessments.inertial.cases import case, log_of, unit

NONE = (0.0, 0.0, 0.0)


def made(rows: np.ndarray, spread: tuple[float, ...] = (0.5, 0.2, 0.1)) -> Blocks:
    return Blocks(np.arange(len(rows), dtype=float), rows, 100, 10.0, np.array(spread))


def test_the_sigma_of_a_middle_is_that_of_the_scatter_of_blocks_inflated() -> None:
    rows = np.array([[1.0, 10.0, 0.0], [2.0, 14.0, 0.0], [4.0, 11.0, 0.0], [3.0, 12.0, 0.0], [9.0, 13.0, 0.0]])
    mad = np.array([1.0, 1.0, 0.0])
    wanted = np.hypot(1.5 * 1.2533 * 1.4826 * mad / np.sqrt(5), 0.3)
    np.testing.assert_allclose(made(rows).middle, [3.0, 12.0, 0.0])
    np.testing.assert_allclose(made(rows).sigma(0.3), wanted)
    np.testing.assert_allclose(made(rows[:2]).sigma(0.0), 1.5 * 1.2533 * np.array([0.5, 0.2, 0.1]) / np.sqrt(2))


def test_the_sigma_of_a_length_is_that_along_it() -> None:
    one = Difference(np.array([3.0, 0.0, -4.0]), np.array([0.1, 9.0, 0.2]), made(np.zeros((3, 3))), "at rest")
    assert one.size == 5.0
    assert one.unsure == pytest.approx(np.hypot(0.6 * 0.1, 0.8 * 0.2))
    assert one.text("m/s^2") == f"5.00 ± {1.96 * one.unsure:.2f} m/s^2 at rest"
    nothing = Difference(np.zeros(3), np.array([0.1, 0.4, 0.2]), made(np.zeros((3, 3))), "at rest")
    assert nothing.unsure == 0.4


def test_the_interval_of_a_size_follows_from_those_of_its_axes() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, (0.4, -0.2, 0.9), (0.7, 0.0, 1.8)))
    for found in answer(case(log)):
        vector, half = np.array(found.vector), np.array(found.vector_ci95)
        size = np.linalg.norm(vector)
        along = np.sqrt(np.sum((vector * half) ** 2)) / size
        assert found.value == pytest.approx(size, abs=2e-3)
        assert found.ci95 == pytest.approx((size - along, size + along), abs=4e-3)
        floor = 1.96 * 0.02
        assert (half >= floor - 1e-3).all()


def test_one_error_is_clearly_larger_from_twice_the_other_and_the_least_on() -> None:
    for sizes, wrong in (
        ([0.3, 0.15], 0),
        ([0.3, 0.16], None),
        ([0.1, 0.3], 1),
        ([0.14, 0.01], None),
        ([0.15, 0.01], 0),
        ([5.0], None),
    ):
        assert imu_instances._larger(sizes, 0.15) == wrong


@pytest.mark.parametrize(
    ("apart", "verdict"), [(0.45, "ok"), (0.6, "warning"), (0.72, "warning"), (0.9, "fault")], ids=lambda x: str(x)
)
def test_accelerometers_may_differ_by_half_a_metre_per_second_squared(apart: float, verdict: str) -> None:
    log = log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, (0.0, 0.6 * apart, 0.8 * apart), NONE))
    assert answer(case(log))[0].verdict == verdict


@pytest.mark.parametrize(("apart", "verdict"), [(0.9, "ok"), (1.2, "warning"), (4.8, "warning"), (5.3, "fault")])
def test_gyros_may_differ_by_a_degree_per_second(apart: float, verdict: str) -> None:
    log = log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, NONE, (0.6 * apart, 0.0, -0.8 * apart)))
    assert answer(case(log))[1].verdict == verdict


def test_blocks_of_five_seconds_have_the_median_and_the_robust_deviation_of_their_samples() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 40.0, 0.1)
    x = rng.normal(size=(400, 2)) * [1.0, 4.0] + [5.0, -3.0]
    found = blocks(t, x, [(0.0, 26.0), (30.0, 35.0)])
    assert found is not None
    parts = [slice(50 * k, 50 * k + 50) for k in range(5)] + [slice(300, 350)]
    np.testing.assert_allclose(found.x, [np.median(x[p], axis=0) for p in parts])
    np.testing.assert_allclose(found.t, [0.5 * (t[p][0] + t[p][-1]) for p in parts])
    mad = [1.4826 * np.median(np.abs(x[p] - np.median(x[p], axis=0)), axis=0) for p in parts]
    np.testing.assert_allclose(found.spread, np.median(mad, axis=0))
    assert (found.samples, found.seconds) == (300, pytest.approx(30.0, rel=0.01))


def test_more_than_five_hundred_samples_are_means_of_neighbours() -> None:
    x = np.arange(1000.0)[:, None] * [1.0, -1.0]
    np.testing.assert_allclose(averaged(x), x.reshape(250, 4, 2).mean(axis=1))
    np.testing.assert_array_equal(averaged(x[:499]), x[:499])
    assert averaged(x[:501]).shape == (250, 2)
