"""Tilt and speed of the nearest record, fast force by numpy, and percentiles of what a log does not know."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude, Gnss, Imu, Stream
from attlog.segments import motion, resets, vibration
from tests.segments.flights import imu_log


def receiver(index: int, t: np.ndarray, speed: np.ndarray, fix: np.ndarray) -> Gnss:
    zero = 0.0 * t
    return Gnss(
        index, t, "GPS", zero, zero, zero, np.column_stack([0.6 * speed, zero, 0.8 * speed]), zero, zero, zero, fix
    )


def test_a_tilt_is_that_of_the_nearest_record_up_to_a_second_and_a_half_away() -> None:
    log = imu_log(np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 3)))
    at = np.array([8.4, 8.6, 10.0, 10.9, 11.1, 13.5, 13.6])
    assert np.isnan(motion.tilt_deg(log, at)).all()
    t = np.array([10.0, 12.0])
    log.attitudes = {"ATT": Attitude(t, rotation.from_euler(np.radians([5.0, -20.0]), 0 * t, 0 * t + 2.0), "ATT")}
    log.onboard = "ATT"
    np.testing.assert_allclose(motion.tilt_deg(log, at), [np.nan, 5.0, 5.0, 5.0, 20.0, 20.0, np.nan], atol=1e-9)
    one = Attitude(t[:1], log.attitudes["ATT"].q[:1], "ATT")
    log.attitudes = {"ATT": one}
    np.testing.assert_allclose(motion.tilt_deg(log, at), [np.nan, 5.0, 5.0, 5.0, 5.0, np.nan, np.nan], atol=1e-9)


def test_a_speed_is_that_of_the_first_receiver_with_four_fixes_of_three_dimensions() -> None:
    log = imu_log(np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 3)))
    t = np.arange(10.0, 16.0)
    few = receiver(0, t, np.full(6, 99.0), np.array([3, 3, 3, 2, 2, 2]))
    good = receiver(1, t, 1.0 + np.arange(6.0), np.array([3, 3, 3, 2, 3, 3]))
    at = np.array([8.4, 8.6, 12.4, 13.6, 17.0])
    log.gnss = [few]
    assert np.isnan(motion.speed_m_s(log, at)).all()
    log.gnss = [few, good, receiver(2, t, np.full(6, 77.0), np.full(6, 3))]
    np.testing.assert_allclose(motion.speed_m_s(log, at), [np.nan, 1.0, 3.0, 5.0, np.nan])
    good.vel_ned[:, 2] = np.nan
    np.testing.assert_allclose(motion.speed_m_s(log, at), [np.nan, 0.6, 1.8, 3.0, np.nan])


@pytest.mark.parametrize("n", [3, 4, 7])
def test_a_smoothed_value_is_the_mean_of_its_window_and_of_fewer_at_the_ends(n: int) -> None:
    x = np.random.default_rng(n).normal(size=(20, 2))
    want = [x[max(k - n // 2, 0) : k - n // 2 + n].mean(axis=0) for k in range(20)]
    np.testing.assert_allclose(vibration.smooth(x, n), want, atol=1e-12)


def test_fast_force_of_each_second_is_what_a_mean_over_a_fifth_of_it_leaves() -> None:
    t = np.arange(0.0, 8.0, 0.01)
    acc = np.random.default_rng(2).normal(size=(len(t), 3)) * [1.0, 2.0, 3.0] * (1.0 + t)[:, None]
    unit = Imu(0, Stream(t, acc, "", "", ""), Stream(t, acc, "", "", ""))
    starts, found = vibration.levels(unit, [(2.0, 6.505)])
    np.testing.assert_allclose(starts, [2.0, 3.0, 4.0, 5.0], atol=0.011)
    part = acc[(t >= 2.0) & (t <= 6.505)]
    fast = part - vibration.smooth(part, 20)
    for k, values in enumerate(found):
        np.testing.assert_allclose(values, np.sqrt(np.mean(fast[100 * k : 100 * (k + 1)] ** 2, axis=0)), rtol=0.03)
    assert len(vibration.levels(unit, [(2.0, 2.08)])[0]) == 0


def test_the_ninetieth_percentile_of_what_is_known_is_that_of_numpy() -> None:
    rows = np.random.default_rng(1).normal(size=(30, 20))
    rows[np.random.default_rng(2).random(rows.shape) < 0.4] = np.nan
    rows[7], rows[8, 1:] = np.nan, np.nan
    want = [np.nanquantile(r, 0.9) if np.isfinite(r).any() else 0.0 for r in rows]
    np.testing.assert_allclose(resets._percentile_90(rows), want)


@pytest.mark.parametrize(("around", "kept"), [(0.49, True), (0.51, False)])
def test_a_jump_stands_out_four_times_of_its_neighbours_but_for_the_next_ones(around: float, kept: bool) -> None:
    jump = np.full(200, 0.01)
    jump[89:112] = around
    jump[100] = 2.0
    jump[99] = jump[101] = 0.9
    assert resets._jumps(jump, np.zeros(200)).tolist() == ([100] if kept else [])
    jump[:] = np.nan
    assert resets._jumps(jump, np.zeros(200)).tolist() == []
