"""Where a body is still, gravity tells how an attitude is tilted; where it moves, nothing is said."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from attlog.core import rotation
from attlog.estimators import evidence as gnss
from attlog.estimators.evidence import HeadingOffset, both, heading_offset, pieces, still_windows, tilt_residual

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


@pytest.mark.parametrize(("size", "still"), [(0.048, True), (0.052, False)])
def test_the_means_of_eighths_may_scatter_by_five_hundredths(size: float, still: bool) -> None:
    gyr, acc, _ = standing()
    acc[:, 2] += size * np.where(np.floor(T / 0.25 + 1e-9) % 2 == 0, 1.0, -1.0)
    assert bool(len(still_windows(T, gyr, acc))) is still


# The heading error by GNSS acceleration, on motion whose heading and GNSS are known.

GRAVITY = 9.81


@dataclass
class Flight:
    """A flight of 120 s: the truth, and what its sensors say."""

    t: np.ndarray
    acc: np.ndarray
    q: np.ndarray
    fixes: np.ndarray
    velocity: np.ndarray

    def found(self, *, heading_deg: float = 0.0, tilt_deg: float = 0.0) -> HeadingOffset:
        """What is said of the true attitude, turned by these."""
        q = rotation.turn_about_down(self.q, np.radians(heading_deg))
        q = rotation.multiply(rotation.from_rotvec(np.radians([tilt_deg, 0.0, 0.0])), q)
        return heading_offset(self.t, self.acc, q, self.fixes, self.velocity)


def flown(
    *, late_s: float = 0.0, moves: float = 1.5, noise_m_s: float = 0.03, every_s: float = 0.2, scale: float = 1.0
) -> Flight:
    """A copter that accelerates by two tones (m/s^2) in each direction while it yaws; GNSS ``late_s`` later."""
    t = np.arange(0.0, 120.0, 0.008)
    tones = np.array([[0.31, 0.83], [0.23, 0.67]])  # Hz of north and east
    amplitude = moves * np.array([[0.6, 0.8], [0.9, 0.5]])
    w = 2.0 * np.pi * tones
    earth = np.stack([(amplitude[k] * np.sin(np.outer(t, w[k]))).sum(axis=1) for k in range(2)], axis=1)
    force = np.column_stack([earth, np.full(len(t), -GRAVITY)])
    q = rotation.from_euler(0.1 * np.sin(0.9 * t), 0.1 * np.cos(0.7 * t), 0.4 * t)
    fixes = np.arange(0.5, 119.5, every_s)
    then = fixes - late_s
    speed = np.stack(
        [(amplitude[k] / w[k] * (1.0 - np.cos(np.outer(then, w[k])))).sum(axis=1) for k in range(2)], axis=1
    )
    rng = np.random.default_rng(5)
    velocity = np.column_stack([speed + noise_m_s * rng.standard_normal(speed.shape), np.zeros(len(fixes))])
    acc = scale * rotation.rotate_inverse(q, force) + 0.1 * rng.standard_normal((len(t), 3)) + [0.2, -0.1, 0.1]
    return Flight(t, acc, q, fixes, velocity)


@pytest.mark.parametrize("off", [-120.0, -28.0, 0.0, 12.0, 170.0])
def test_the_offset_of_a_heading_is_found_with_its_sign(off: float) -> None:
    found = flown().found(heading_deg=off)
    assert found.known
    assert found.offset_deg == pytest.approx(off, abs=1.0)
    assert abs(found.offset_deg - off) < 3.0 * found.sigma_deg
    assert found.wrong == (abs(off) > 8.0)
    assert found.sound == (off == 0.0)


@pytest.mark.parametrize("late", [-0.15, 0.2, 0.45])
def test_a_late_receiver_moves_the_delay_and_not_the_heading(late: float) -> None:
    found = flown(late_s=late).found(heading_deg=20.0)
    assert found.delay_s == pytest.approx(late, abs=0.03)
    assert found.offset_deg == pytest.approx(20.0, abs=1.5)


def test_hover_says_nothing_of_any_heading() -> None:
    found = flown(moves=0.01, noise_m_s=0.1).found(heading_deg=90.0)
    assert not any([found.known, found.wrong, found.sound])
    assert found.why


def test_an_accelerometer_of_wrong_scale_is_another_fault() -> None:
    found = flown(scale=2.0).found(heading_deg=40.0)
    assert found.correlation > 0.9
    assert not found.known
    assert "0.5 times" in found.why


def test_jumps_of_gnss_are_left_out() -> None:
    flight = flown()
    flight.velocity[200:203] += 8.0
    found = flight.found(heading_deg=15.0)
    assert found.known
    assert found.offset_deg == pytest.approx(15.0, abs=1.5)


def test_one_turn_to_one_side_leaves_delay_and_heading_unknown() -> None:
    """While a vehicle circles, 0.15 s of delay look like 0.15 s of turning: here 9 deg."""
    flight = flown()
    rate = np.radians(60.0)
    force = np.column_stack(
        [-3.0 * np.sin(rate * flight.t), 3.0 * np.cos(rate * flight.t), np.full(len(flight.t), -GRAVITY)]
    )
    flight.acc = rotation.rotate_inverse(flight.q, force)
    flight.velocity[:, 0] = 3.0 / rate * np.cos(rate * flight.fixes)
    flight.velocity[:, 1] = 3.0 / rate * np.sin(rate * flight.fixes)
    flight.velocity[:, :2] += 0.03 * np.random.default_rng(3).standard_normal((len(flight.fixes), 2))
    assert flight.found().sigma_deg == pytest.approx(9.0, abs=1.0)


def test_a_heading_that_is_wrong_for_a_part_is_wrong_in_these_segments() -> None:
    flight = flown()
    turned = np.where(flight.t > 60.0, np.radians(45.0), 0.0)
    found = pieces(flight.t, flight.acc, rotation.turn_about_down(flight.q, turned), flight.fixes, flight.velocity)
    early = [one for one in found if one.t1 < 60.0]
    late = [one for one in found if one.t0 > 60.0]
    assert early
    assert not any(one.wrong for one in early)
    assert late
    assert all(one.wrong for one in late)
    assert [one.offset_deg for one in late] == pytest.approx([45.0] * len(late), abs=3.0)


def test_errors_stay_within_their_sigma() -> None:
    """White GNSS noise of 20 flights: the offset is beyond two sigma in about one of twenty, never in five."""
    errors = []
    flight = flown(noise_m_s=0.0, moves=0.4)
    rng = np.random.default_rng(7)
    velocity = flight.velocity
    for _ in range(20):
        flight.velocity = velocity + 0.15 * rng.standard_normal(velocity.shape)
        found = flight.found()
        errors.append(found.offset_deg / found.sigma_deg)
    assert np.count_nonzero(np.abs(errors) > 2.0) < 5
    assert np.sqrt(np.mean(np.square(errors))) > 0.2


def test_gaps_of_the_imu_and_times_outside_the_spans_are_left_out() -> None:
    flight = flown()
    bad = (flight.t > 50.0) & (flight.t < 52.0)
    flight.acc[bad & (flight.t < 51.0)] = np.nan
    keep = ~(bad & (flight.t >= 51.0))
    spans = np.array([[10.0, 100.0]])
    args = flight.t[keep], flight.acc[keep], flight.q[keep], flight.fixes, flight.velocity
    found = heading_offset(*args, spans)
    assert found.known
    assert abs(found.offset_deg) < 1.0
    assert found.t0 >= 10.0
    assert found.t1 <= 100.0
    assert heading_offset(*args, np.zeros((0, 2))).why


@pytest.mark.parametrize("fixes", [0, 1, 3])
def test_without_gnss_there_is_no_answer(fixes: int) -> None:
    flight = flown()
    whole, parts = both(flight.t, flight.acc, flight.q, flight.fixes[:fixes], flight.velocity[:fixes])
    assert not whole.known
    assert whole.why
    assert parts == []


@pytest.mark.parametrize("fixes", [0, 1, 3])
def test_without_windows_the_force_has_no_changes(fixes: int) -> None:
    flight = flown()
    steps = gnss.velocity_steps(flight.t, flight.acc, flight.q, flight.fixes[:fixes], flight.velocity[:fixes])
    assert steps.force(0.2).shape == (0,)
    assert steps.force([0.0, 0.2]).shape == (2, 0)


def test_a_receiver_that_seems_earlier_than_any_is_not_believed() -> None:
    found = flown(late_s=-0.4).found()
    assert not found.known
    assert "delay" in found.why


# When the heading by GNSS acceleration counts, is wrong or sound: limits from both sides.

FOUND = gnss.HeadingOffset(0.0, 1.0, 1.0, 0.9, 0.1, 9.0, 0.0, 60.0, True, "")


@pytest.mark.parametrize(
    ("offset", "sigma", "wrong", "sound"),
    [
        (7.9, 1.0, False, False),
        (8.1, 1.0, True, False),
        (-8.1, 1.0, True, False),
        (14.9, 5.0, False, False),
        (15.1, 5.0, True, False),
        (2.9, 1.0, False, True),
        (-3.1, 1.0, False, False),
        (3.9, 2.0, False, True),
        (4.1, 2.0, False, False),
        (0.0, 2.1, False, False),
    ],
)
def test_a_heading_is_wrong_beyond_eight_and_sound_within_three_degrees_or_its_sigmas(
    offset: float, sigma: float, wrong: bool, sound: bool
) -> None:
    found = FOUND._replace(offset_deg=offset, sigma_deg=sigma)
    assert (found.wrong, found.sound) == (wrong, sound)
    silent = found._replace(known=False)
    assert (silent.wrong, silent.sound) == (False, False)


def test_a_fix_is_paired_with_the_nearest_to_a_second_later() -> None:
    t = np.array([0.0, 0.4, 0.9, 1.2, 2.45, 3.14, 3.16])
    i, j = gnss._pairs(t)
    assert list(zip(i.tolist(), j.tolist(), strict=True)) == [(0, 2), (1, 3), (3, 4), (4, 6)]
    i, j = gnss._pairs(np.array([0.0, 0.9, 1.1001]))
    assert (i.tolist(), j.tolist()) == ([0], [1])
    assert len(gnss._pairs(np.array([0.0]))[0]) == 0
