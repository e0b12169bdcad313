"""Clock and axes of a truth by closed forms: planted offsets, drifts and turns, another about each axis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.base import rotation
from attlog.flight.model import Firmware, FlightLog, Gnss, Imu, Stream
from attlog.segments.increments import GyroIncrements
from attlog.truth import axes, clock

T = np.arange(0.0, 60.0, 0.01)
BIAS = np.radians([0.6, -0.3, 0.9])
TURN = rotation.to_matrix(rotation.from_euler(0.2, -0.4, 1.1)[None])[0]
"""From the truth's body to the IMU's."""


def body_rates(t: np.ndarray) -> np.ndarray:
    """Rates (n, 3) rad/s of the truth: not periodic, and of another size about each axis."""
    size = np.array([0.9, 0.5, 0.3]) * (1.0 + 0.3 * np.sin(0.05 * t))[:, None]
    return size * np.sin(np.outer(t, [1.7, 2.3, 0.9]) + 0.01 * t[:, None] ** 2)


def gyro() -> GyroIncrements:
    return GyroIncrements(T, body_rates(T) @ TURN.T + BIAS)


def truth(offset: float = 0.0, drift: float = 0.0, begin: float = 5.0, end: float = 55.0) -> clock.TruthRates:
    """Mean rates over 0.1 s on a clock that is ``offset`` early, and runs otherwise by ``drift`` about 30 s."""
    start = np.arange(begin, end, 0.05)
    exact = GyroIncrements(T, body_rates(T))
    rate = exact.between(start, start + 0.1) / 0.1
    own = [x - offset - drift * (x - 30.0) for x in (start, start + 0.1)]
    return clock.TruthRates(own[0], own[1], rate)


def test_rates_of_attitudes_are_means_over_a_span_in_body_axes() -> None:
    t = np.arange(0.0, 5.0, 0.02)
    q = rotation.multiply(
        rotation.from_euler(0.3, 0.2, -1.0)[None], rotation.from_rotvec(t[:, None] * [0.3, -0.2, 0.5])
    )
    found = clock.rates(t, q)
    np.testing.assert_allclose(found.rate, np.tile([0.3, -0.2, 0.5], (len(found.rate), 1)), atol=1e-9)
    np.testing.assert_allclose(found.end - found.start, 0.08, atol=1e-9)
    assert len(found.start) == len(t) - 4
    holed = (t < 2.0) | (t > 3.0)
    found = clock.rates(t[holed], q[holed])
    assert not np.any((found.start < 2.0) & (found.end > 3.0))
    assert len(clock.rates(t[:3], q[:3]).start) == 0


def test_rates_on_another_clock_keep_their_size_and_are_thinned_out_evenly() -> None:
    one = truth()
    moved = one.shifted(3.0, 1e-3, 30.0)
    np.testing.assert_allclose(moved.start, one.start + 3.0 + 1e-3 * (one.start - 30.0))
    np.testing.assert_array_equal(moved.rate, one.rate)
    assert len(one.thinned(300).start) == 250  # every fourth of a thousand
    assert len(one.thinned(1000).start) == 1000


@pytest.mark.parametrize("offset", [0.0, 0.4])
def test_the_turn_between_the_bodies_and_the_bias_are_those_that_were_planted(offset: float) -> None:
    found = clock.fit(truth(offset), gyro(), offset)
    assert found is not None
    np.testing.assert_allclose(found.turn, TURN, atol=1e-4)
    np.testing.assert_allclose(found.bias, BIAS, atol=1e-4)
    assert found.correlation > 0.9999
    wrong = clock.fit(truth(offset), gyro(), offset + 0.3)
    assert wrong is not None
    assert wrong.correlation < 0.97
    assert wrong.misfit > 100.0 * found.misfit


def test_fewer_than_thirty_known_intervals_tell_no_turn() -> None:
    assert clock.fit(truth(begin=5.0, end=6.4), gyro()) is None
    assert clock.fit(truth(begin=5.0, end=6.6), gyro()) is not None


def test_gross_errors_of_a_truth_do_not_turn_it() -> None:
    one = truth()
    one.rate[100:104] += 40.0
    found = clock.fit(one, gyro())
    assert found is not None
    np.testing.assert_allclose(found.turn, TURN, atol=1e-3)
    assert found.n == len(one.start) - 4


@pytest.mark.parametrize("offset", [0.0, 12.34, -7.77, 1000.0])
def test_the_offset_is_among_the_first_candidates_and_refined_to_a_millisecond(offset: float) -> None:
    found = clock.candidates(truth(offset), gyro(), None, 0.0)
    assert min(abs(x - offset) for x in found) < 0.06
    assert all(abs(a - b) > 0.5 for k, a in enumerate(found) for b in found[:k])
    fine = clock.refined(truth(offset), gyro(), min(found, key=lambda x: abs(x - offset)))
    assert fine is not None
    assert fine[0] == pytest.approx(offset, abs=2e-4)


def test_around_a_given_offset_only_that_neighbourhood_is_searched() -> None:
    (found,) = clock.candidates(truth(2.0), gyro(), 1.7, 0.5)
    assert found == pytest.approx(2.0, abs=0.05)
    (beside,) = clock.candidates(truth(2.0), gyro(), 1.0, 0.5)
    assert 0.5 <= beside <= 1.5 + 1e-9


def test_the_correlation_at_every_lag_is_pearsons_of_what_both_know() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=300) + 5.0, rng.normal(size=420) - 2.0
    a[40:60], b[100] = np.nan, np.nan
    found = clock._correlation(a, b, 0.05)
    for lag in (-80, -1, 0, 7, 150):
        x = a[max(-lag, 0) : min(len(a), len(b) - lag)]
        y = b[max(lag, 0) : max(lag, 0) + len(x)]
        both = np.isfinite(x) & np.isfinite(y)
        assert found[len(a) - 1 + lag] == pytest.approx(np.corrcoef(x[both], y[both])[0, 1], abs=1e-9)
    known = np.flatnonzero(np.isfinite(found)) - (len(a) - 1)
    assert known.min() == pytest.approx(-100, abs=1)  # 200 of 300, which is ten seconds of 0.05 s
    assert len(found) == len(a) + len(b) - 1


@pytest.mark.parametrize("drift", [0.0, 80e-6])
def test_offset_drift_and_turn_come_back_together(drift: float) -> None:
    one, start = truth(1.5, drift), clock.fit(truth(1.5), gyro(), 1.5)
    assert start is not None
    middle = 30.0 - 1.5
    found = clock.timed(one, gyro(), 1.502, middle, start)
    assert found is not None
    assert found.offset == pytest.approx(1.5, abs=2e-4)
    assert found.drift == pytest.approx(drift, abs=8e-6)
    np.testing.assert_allclose(found.turn, TURN, atol=2e-4)
    assert found.offset_sigma < 5e-4


def test_motion_counts_in_as_many_seconds_as_it_is_spread_over() -> None:
    start = np.arange(0.0, 30.0, 0.1)
    for seconds in (1, 4, 30):
        rate = np.where(start < seconds - 1e-9, 1.0, 0.0)[:, None] * [1.0, 2.0, 0.0]
        assert clock._spread(clock.TruthRates(start, start + 0.1, rate)) == pytest.approx(seconds)


def level(velocity: Any = None, world: Any = None) -> tuple[Imu, np.ndarray, np.ndarray]:
    """An IMU that feels gravity and a velocity's change, and attitudes to a world that NED is turned into."""
    q = rotation.from_euler(0.4 * np.sin(0.9 * T), 0.3 * np.sin(0.6 * T + 1.0), 0.5 * np.sin(0.2 * T))
    a = np.zeros((len(T), 3)) if velocity is None else np.gradient(velocity, T, axis=0)
    acc = rotation.rotate_inverse(q, a + np.array([0.0, 0.0, -9.81])) + np.array([0.1, -0.05, 0.08])
    if world is not None:
        q = rotation.multiply(np.tile(world, (len(T), 1)), q)
    zero = np.zeros((len(T), 3))
    return Imu(0, Stream(T, zero, "rad/s", "FRD", "I"), Stream(T, acc, "m/s^2", "FRD", "I")), T, q


def test_down_is_found_in_any_world_in_spite_of_a_bias() -> None:
    for angles in ((0.0, 0.0, 0.0), (0.5, -0.7, 1.0), (3.0, 0.1, -2.0)):
        world = rotation.from_euler(*angles)
        imu, t, q = level(world=world)
        found = axes.vertical(imu, t, q, None)
        assert found is not None
        np.testing.assert_allclose(found.down, rotation.rotate(world, np.array([0.0, 0.0, 1.0])), atol=3e-3)
        assert found.gravity == pytest.approx(9.81, abs=0.03)
        assert found.sigma < 0.01


def test_a_velocity_takes_motion_out_of_gravity() -> None:
    velocity = np.column_stack([0.1 * T**2, -0.02 * T**2, 0.0 * T])
    imu, t, q = level(velocity)
    with_motion, without = axes.vertical(imu, t, q, velocity), axes.vertical(imu, t, q, None)
    assert with_motion is not None
    assert without is not None
    np.testing.assert_allclose(with_motion.down, [0.0, 0.0, 1.0], atol=3e-3)
    assert abs(without.down[0]) > 0.01


def test_less_than_four_blocks_of_two_seconds_tell_no_vertical() -> None:
    imu, t, q = level()
    for seconds, told in ((6.5, False), (8.5, True)):
        few = t < seconds
        assert (axes.vertical(imu, t[few], q[few], None) is not None) is told


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_world_is_levelled_by_the_least_turn_from_its_nearest_axis(axis: int, sign: float) -> None:
    down = np.full(3, 0.1)
    down[axis] = sign
    down /= np.linalg.norm(down)
    q = axes.levelled(down)
    np.testing.assert_allclose(rotation.rotate(q, down), [0.0, 0.0, 1.0], atol=1e-12)
    exact = np.zeros(3)
    exact[axis] = sign
    plain = axes.levelled(exact)
    np.testing.assert_allclose(rotation.rotate(plain, exact), [0.0, 0.0, 1.0], atol=1e-12)
    apart = float(rotation.total_angle(rotation.error(q, plain)))
    assert apart == pytest.approx(np.arccos(abs(down[axis])), abs=1e-9)
    assert float(rotation.total_angle(rotation.error(axes.levelled(down, 0.2), plain))) == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.det(Rotation.from_quat(np.roll(q, -1)).as_matrix()) == pytest.approx(1.0)


def test_east_north_up_becomes_north_east_down() -> None:
    q = axes.levelled(np.array([0.0, 0.0, -1.0]))
    np.testing.assert_allclose(rotation.rotate(q, np.array([1.0, 2.0, 3.0])), [2.0, 1.0, -3.0], atol=1e-12)


def test_the_usual_body_axes_are_taken_within_three_sigmas_about_each_axis() -> None:
    sigma = np.radians([1.0, 2.0, 0.5])
    for half in ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)):
        for axis in range(3):
            for factor, taken in ((2.9, True), (-2.9, True), (3.1, False), (-3.1, False)):
                vector = np.zeros(3)
                vector[axis] = factor * sigma[axis]
                turned = rotation.multiply(np.array(half), rotation.from_rotvec(vector))
                found = axes.usual(turned, sigma)
                assert (float(rotation.total_angle(rotation.error(found, np.array(half)))) < 1e-9) is taken


def receiver(t: np.ndarray, velocity: np.ndarray, fix: int = 3) -> Gnss:
    zero = np.zeros(len(t))
    return Gnss(0, t, "GPS", zero, zero, zero, velocity, zero, zero, zero, np.full(len(t), fix))


def log_with(*receivers: Gnss) -> FlightLog:
    log = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "quadrotor")
    log.gnss = list(receivers)
    return log


@pytest.mark.parametrize(("heading", "late"), [(0.7, 0.0), (-2.5, 0.2)])
def test_north_is_where_both_velocities_go_the_same_way(heading: float, late: float) -> None:
    def flown(t: np.ndarray) -> np.ndarray:
        course = 0.5 * t + 0.8 * np.sin(1.1 * t)
        return np.column_stack([5.0 * np.cos(course), 5.0 * np.sin(course), 0.0 * t])

    own = rotation.rotate(rotation.from_rotvec([0.0, 0.0, -heading]), flown(T))
    at = np.arange(1.0, 59.0, 0.2)
    found = axes.north_by_gnss(log_with(receiver(at, flown(at - late))), T, own)
    assert found is not None
    assert found.heading == pytest.approx(heading, abs=3e-3)
    assert found.sigma < 3e-3
    assert axes.north_by_gnss(log_with(receiver(at, flown(at), fix=2)), T, own) is None
    assert axes.north_by_gnss(log_with(receiver(at, 0.15 * flown(at))), T, own) is None
    assert axes.north_by_gnss(log_with(receiver(at, flown(-at))), T, own) is None


def test_velocities_of_positions_are_over_two_tenths_of_a_second() -> None:
    position = np.column_stack([3.0 * T, -2.0 * T, 0.5 * T**2])
    found = axes.velocity_of(T, position)
    assert found is not None
    np.testing.assert_allclose(found[20:-20], np.column_stack([3.0 + 0 * T, -2.0 + 0 * T, T])[20:-20], atol=1e-3)
    np.testing.assert_allclose(found[0, :2], [3.0, -2.0], atol=1e-9)
    assert axes.velocity_of(T, 0.0 * position + 4.0) is None
    assert axes.velocity_of(T[:2], position[:2]) is None


def test_the_velocity_of_a_receiver_is_linear_between_fixes_and_unknown_beyond() -> None:
    at = np.arange(10.0, 20.0, 0.2)
    velocity = np.column_stack([at, -2.0 * at, 0.0 * at])
    found = axes.gnss_velocity(log_with(receiver(at, velocity, 2), receiver(at, velocity)), np.array([9.0, 10.1, 21.0]))
    assert found is not None
    np.testing.assert_allclose(found[1], [10.1, -20.2, 0.0])
    assert np.isnan(found[[0, 2]]).all()
    assert axes.gnss_velocity(log_with(receiver(at[:20], velocity[:20])), T) is None
