"""Where a body is still, gravity tells how an attitude is tilted; where it moves, nothing is said."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators.evidence.still import still_windows, tilt_residual, within

RATE, SECONDS, G = 200.0, 20.0, 9.80665
T = np.arange(0.0, SECONDS, 1.0 / RATE)


def standing(roll_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gyro and accelerometer (n, 3) of a body that lies tilted, and its attitude (n, 4)."""
    q = np.tile(rotation.from_euler(np.radians(roll_deg), 0.0, 0.3), (len(T), 1))
    return np.zeros((len(T), 3)), rotation.rotate_inverse(q, np.array([0.0, 0.0, -G])), q


def test_every_window_of_a_body_that_lies_is_still_and_its_attitude_has_no_residual() -> None:
    gyr, acc, q = standing(20.0)
    found = still_windows(T, gyr, acc)
    assert found[0].tolist() == [0.0, 2.0]
    assert np.diff(found[:, 0]) == pytest.approx(0.5)
    assert len(found) == (SECONDS - 2.0) / 0.5 + 1
    assert tilt_residual(found, T, acc, q) == pytest.approx(0.0, abs=1e-6)


def test_the_residual_is_the_angle_that_the_attitude_is_tilted_by_whatever_its_heading() -> None:
    gyr, acc, q = standing(20.0)
    wrong = rotation.multiply(rotation.from_rotvec(np.radians([4.0, 0.0, 0.0])), q)
    turned = rotation.turn_about_down(wrong, np.full(len(T), 1.0))
    assert tilt_residual(still_windows(T, gyr, acc), T, acc, turned) == pytest.approx(4.0, abs=1e-6)


def test_a_gyro_bias_and_the_vibration_of_idling_motors_hide_no_stillness() -> None:
    gyr, acc, _ = standing()
    rng = np.random.default_rng(3)
    shaken = acc + 2.0 * np.sin(2 * np.pi * 72.0 * T)[:, None] + rng.normal(0.0, 0.1, acc.shape)
    spun = gyr + np.radians([3.0, -2.0, 1.0]) + np.radians(20.0) * np.sin(2 * np.pi * 60.0 * T)[:, None]
    assert len(still_windows(T, spun, shaken)) >= 0.9 * len(still_windows(T, gyr, acc))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_body_that_turns_to_and_fro_is_not_still(axis: int) -> None:
    """By 1 deg in 3 s: too slow for the force's direction about the vertical, seen by the gyro."""
    gyr, acc, _ = standing()
    gyr[:, axis] = np.radians(1.0) * (2 * np.pi / 3.0) * np.cos(2 * np.pi * T / 3.0)
    assert not len(still_windows(T, gyr, acc))


@pytest.mark.parametrize(
    "push",
    [
        lambda t: 0.2 * np.sin(2 * np.pi * t / 2.0),  # swaying
        lambda t: np.where(np.mod(t, 1.0) < 0.2, 1.0, 0.0),  # blows
        lambda t: 2.0 * t,  # getting faster and faster
    ],
)
def test_a_body_that_is_pushed_is_not_still(push) -> None:
    gyr, acc, _ = standing()
    acc[:, 0] += push(T)
    assert not len(still_windows(T, gyr, acc))


def test_a_force_that_is_no_gravity_is_no_stillness() -> None:
    """A steady climb of the speed, or an accelerometer in other units."""
    gyr, acc, _ = standing()
    assert len(still_windows(T, gyr, acc * 1.05))
    assert not len(still_windows(T, gyr, acc * 1.08))
    assert not len(still_windows(T, gyr, acc / G))


def test_windows_end_at_gaps_and_leave_out_what_is_no_number() -> None:
    gyr, acc, q = standing()
    keep = (T < 8.0) | (T > 12.0)
    acc[(T > 15.0) & (T < 15.6)] = np.nan
    found = still_windows(T[keep], gyr[keep], acc[keep])
    assert len(found)
    for low, high in ((8.0, 12.0), (15.0, 15.6)):
        hole = (low + 0.25, high - 0.25)  # parts at the ends still have samples
        assert np.all((found[:, 1] <= hole[0]) | (found[:, 0] >= hole[1]))
    assert np.isfinite(tilt_residual(found, T[keep], acc[keep], q[keep])).all()


def test_where_the_attitude_is_unknown_the_residual_is_too() -> None:
    gyr, acc, q = standing()
    q[T > 10.0] = np.nan
    found = still_windows(T, gyr, acc)
    residual = tilt_residual(found, T, acc, q)
    assert np.isfinite(residual[found[:, 1] <= 10.0]).all()
    assert np.isnan(residual[found[:, 0] > 10.0]).all()


def test_nothing_is_still_without_samples() -> None:
    for n in (0, 1, 7):
        assert still_windows(T[:n], np.zeros((n, 3)), np.zeros((n, 3))).shape == (0, 2)
    assert not within(np.zeros((0, 2)), T).any()


@pytest.mark.parametrize("spoiled", ["time", "gyro", "force"])
def test_a_sample_that_is_no_number_in_any_of_its_parts_is_left_out(spoiled: str) -> None:
    """Every tenth sample: the windows stay as they are."""
    gyr, acc, _ = standing(20.0)
    t = T.copy()
    {"time": t[:, None], "gyro": gyr, "force": acc}[spoiled][5::10, 0] = np.nan
    np.testing.assert_allclose(still_windows(t, gyr, acc), still_windows(T, *standing(20.0)[:2]))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("deg", "still"), [(0.29, True), (0.31, False)])
def test_an_angle_may_leave_that_of_the_mean_rate_by_three_tenths_of_a_degree(
    axis: int, deg: float, still: bool
) -> None:
    """The rate is larger in the first half of a window than in the second: the angle is off most in its middle."""
    gyr, acc, _ = standing()
    gyr[:, axis] = 0.5
    gyr[T < 1.0, axis] += np.radians(deg)
    gyr[(T >= 1.0) & (T < 2.0), axis] -= np.radians(deg)
    assert bool(np.any(still_windows(T, gyr, acc)[:, 0] == 0.0)) is still


@pytest.mark.parametrize(("off", "still"), [(0.59, True), (-0.59, True), (0.61, False), (-0.61, False)])
def test_the_mean_force_is_gravitys_within_six_tenths(off: float, still: bool) -> None:
    gyr, acc, _ = standing()
    assert bool(len(still_windows(T, gyr, acc * (9.8 + off) / G))) is still


@pytest.mark.parametrize(("size", "still"), [(0.048, True), (0.052, False)])
def test_the_means_of_eighths_may_scatter_by_five_hundredths(size: float, still: bool) -> None:
    gyr, acc, _ = standing()
    acc[:, 2] += size * np.where(np.floor(T / 0.25 + 1e-9) % 2 == 0, 1.0, -1.0)
    assert bool(len(still_windows(T, gyr, acc))) is still
