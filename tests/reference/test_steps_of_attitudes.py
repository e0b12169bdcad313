"""The step of logged attitudes, what a floor is made of, and which samples of an attitude are fit to compare."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude, Imu, Stream
from attlog.reference import clock, floor
from attlog.reference.physics import late_force


def attitudes(step_deg: float, n: int = 600) -> np.ndarray:
    """A random walk of roll and pitch in whole steps; of none where the step is 0."""
    rng = np.random.default_rng(4)
    walk = np.cumsum(rng.normal(0.0, 0.06, (n, 2)), axis=0)
    angles = np.round(walk / step_deg) * step_deg if step_deg else walk
    return rotation.from_euler(*np.radians(angles).T, 0.3 + 0.0 * walk[:, 0])


@pytest.mark.parametrize(("step", "shown"), [(0.01, 0.01), (0.05, 0.05), (0.0, floor.FLOAT32_DEG)])
def test_the_step_of_printed_angles_is_the_smallest_difference_that_repeats(step: float, shown: float) -> None:
    assert floor.step_deg(attitudes(step)) == pytest.approx(shown, rel=1e-3)
    assert floor.step_deg(attitudes(step)[:8]) == floor.FLOAT32_DEG


def test_a_floor_is_the_root_of_steps_stamps_and_gaps() -> None:
    t = np.cumsum(np.random.default_rng(0).choice([0.020, 0.021], 400))
    rate = np.radians(np.column_stack([30.0 * np.sin(t), 5.0 + 0.0 * t, 0.0 * t]))
    unit = Imu(0, Stream(t, rate, "rad/s", "FRD", "IMU"), Stream(t, 0.0 * rate, "m/s^2", "FRD", "IMU"))
    found, own, told = floor.step(t, attitudes(0.0, 400), 0.02, unit)
    moved = 30.0 * np.sin(t)
    timing = 1e-3 / np.sqrt(12.0) * np.sqrt(np.mean((moved - np.median(moved)) ** 2))
    assert own == 0.02
    assert found == pytest.approx(np.hypot(0.02, timing), rel=1e-6)
    assert (told.value, told.unit) == (found, "deg")
    assert floor.step(t, attitudes(0.05, 400), 0.0, None)[:2] == pytest.approx((0.05, 0.05), rel=1e-3)


def test_samples_that_are_fit_to_compare_rise_in_time_and_have_a_norm() -> None:
    q = np.tile([1.0, 0.0, 0.0, 0.0], (8, 1))
    q[1], q[2], q[3], q[4] = [0.49, 0, 0, 0], [0.51, 0, 0, 0], [1.99, 0, 0, 0], [2.01, 0, 0, 0]
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 2.5, 6.0, 6.0])
    at, unit, good = clock.usable(Attitude(t, q, "ATT"), "sample")
    assert good.tolist() == [True, False, True, True, False, False, True, False]
    assert at.tolist() == [0.0, 2.0, 3.0, 6.0]
    np.testing.assert_allclose(rotation.length(unit), 1.0)
    late = Attitude(t, q, "ATT", t_sample=t - 0.1)
    assert clock.usable(late, "sample")[0].tolist() == pytest.approx([-0.1, 1.9, 2.9, 5.9])
    assert clock.usable(late, "publication")[0].tolist() == at.tolist()


def test_means_of_the_force_are_over_tenths_of_a_second_with_their_middles() -> None:
    t = np.concatenate([[7.0], 7.01 + 0.02 * np.arange(25)])
    t = t[(t < 7.2) | (t > 7.3)]
    force = np.column_stack([t, t**2, -t])
    force[3] = np.nan
    at, mean = late_force._mean_force(t, force)
    np.testing.assert_allclose(at, 7.05 + 0.1 * np.arange(5))
    for k in (0, 1, 3, 4):
        own = np.isfinite(force[:, 0]) & (t >= 7.0 + 0.1 * k) & (t < 7.1 + 0.1 * k)
        np.testing.assert_allclose(mean[k], force[own].mean(axis=0))
    assert np.isnan(mean[2]).all()


def test_fixes_a_second_apart_within_the_forces_are_pairs() -> None:
    t = np.array([0.5, 1.1, 1.6, 2.1, 2.6, 3.1, 4.8, 5.8, 6.8, 7.9, 8.9, 9.5])
    first, last = late_force._pairs(t, np.arange(0.0, 10.01, 0.1))
    assert [(t[a], t[b]) for a, b in zip(first, last, strict=True)] == [
        (1.1, 2.1),
        (1.6, 2.6),
        (2.1, 3.1),
        (4.8, 5.8),
        (5.8, 6.8),
        (6.8, 7.9),
        (7.9, 8.9),
    ]


@pytest.mark.parametrize("shift", [0, 7, -5])
def test_a_force_that_is_moved_back_leaves_nothing_of_the_changes(shift: int) -> None:
    """Sines in north and east, met at a level attitude; ``shift`` steps late, and a receiver that is 0.3 s late."""
    step = late_force.STEP_S
    grid = step * (np.arange(900) + 0.5)

    def velocity(t: np.ndarray) -> np.ndarray:
        return np.column_stack([4.0 * np.sin(0.9 * t), 3.0 * np.sin(0.53 * t)])

    edges = step * np.arange(901) - shift * step
    force = np.column_stack([np.diff(velocity(edges), axis=0) / step, np.full(900, -9.81)])
    t = np.arange(5.0, 80.0, 0.2)
    change = velocity(t + 1.0 - 0.3) - velocity(t - 0.3)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (900, 1))
    spans = t - grid[0], t + 1.0 - grid[0]
    change -= np.median(change, axis=0)
    left, alike = late_force._fit(q, force, shift, 0.3, spans, change)
    assert left < 0.01 * np.mean(np.sum(change**2, axis=1))
    assert alike > 0.995
    for wrong in ((shift + 4, 0.3), (shift - 4, 0.3), (shift, 0.0)):
        assert late_force._fit(q, force, *wrong, spans, change)[0] > 3.0 * max(left, 1e-3)
