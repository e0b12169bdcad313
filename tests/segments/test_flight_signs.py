"""Signs of flight on the grid, lift-off and landing, by closed forms: other numbers in every axis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import Attitude, Firmware, FlightLog, Gnss, Imu, Stream
from attlog.flight.vehicle import VehicleKind
from attlog.segments import airborne, flight_signs, heights, rest
from attlog.segments.flight_signs import Grid
from attlog.segments.heights import HeightLevel
from tests.flight.made_log import with_fields
from tests.segments.flights import imu_log

Array = np.ndarray
T = 0.1 * np.arange(400)


def made_grid(n: int = 400, **more: Any) -> Grid:
    """A vehicle that stands level."""
    none, yes = np.zeros(n), np.ones(n, bool)
    fields: dict[str, Any] = {
        "t": 0.1 * np.arange(n),
        "known": yes,
        "force": np.tile([0.0, 0.0, -9.81], (n, 1)),
        "size": np.full(n, 9.81),
        "dynamics": none - 1.0,
        "slope": none,
        "contact": ~yes,
        "speed": np.full(n, np.nan),
        "down": np.tile([0.0, 0.0, 1.0], (n, 1)),
        "slow": False,
    }
    return Grid(**{**fields, **more})


def made_log(**more: Any) -> FlightLog:
    log = FlightLog(Path("made.bin"), "made", 0, 0, Firmware("made"), VehicleKind.MULTIROTOR)
    return with_fields(log, **more)


def stream(t: Array, x: Array, source: str = "made", kind: str = "1") -> Stream:
    return Stream(np.asarray(t, float), np.asarray(x, float), kind, "", source)


def test_the_slope_is_that_of_least_squares_over_four_seconds() -> None:
    rng = np.random.default_rng(2)
    gravity = rng.normal(size=(400, 3))
    force = gravity * [0.8, 0.8, 5.0] + [0.3, -0.2, 0.0] + 0.05 * rng.normal(size=(400, 3))
    at = 200
    part = slice(at - 20, at + 20)
    g, f = gravity[part, :2] - gravity[part, :2].mean(axis=0), force[part, :2] - force[part, :2].mean(axis=0)
    assert flight_signs._ground_slope(force, gravity)[at] == pytest.approx(np.sum(g * f) / np.sum(g * g))
    assert np.isnan(flight_signs._ground_slope(force, 0.01 * gravity)[at])  # gravity's part varies too little
    gravity[at + 5] = np.nan
    unknown = np.flatnonzero(np.isnan(flight_signs._ground_slope(force, gravity)))
    assert (unknown.min(), unknown.max()) == (at + 5 - 19, at + 5 + 20)


def test_down_in_body_axes_is_the_last_row_of_the_rotation_and_unknown_far_from_an_attitude() -> None:
    q = rotation.from_euler(0.3, -0.5, 1.0)
    log = made_log(attitudes={"A": Attitude(np.array([10.0, 10.1]), np.tile(q, (2, 1)), "A")}, onboard="A")
    t = np.array([8.4, 8.6, 10.05, 11.5, 11.7])
    down = flight_signs._down_axis(log, t)
    wanted = rotation.rotate_inverse(q[None], np.array([0.0, 0.0, 1.0]))[0]
    np.testing.assert_allclose(down[1:4], np.tile(wanted, (3, 1)), atol=1e-12)
    assert np.isnan(down[[0, 4]]).all()
    assert np.isnan(flight_signs._down_axis(made_log(), t)).all()


def test_power_is_the_throttle_else_the_mean_of_the_motors_else_of_the_rotors() -> None:
    t = np.array([0.5, 1.5])
    motors = stream([0.0, 1.0], [[100.0, 300.0], [400.0, 400.0]], "motors")
    rpm = stream([0.0, 1.0], [[1000.0], [500.0]], "rpm")
    power, source = airborne._drive_power(made_log(motors=motors, rpm=rpm), t)
    assert (power.tolist(), source) == ([0.5, 1.0], "motors")  # type: ignore[union-attr]
    power, source = airborne._drive_power(made_log(rpm=rpm), t)
    assert (power.tolist(), source) == ([1.0, 0.5], "rpm")  # type: ignore[union-attr]
    throttle = stream([0.0, 1.0], [-0.3, 0.2], "throttle")
    power, source = airborne._drive_power(made_log(motors=motors, throttle=throttle), t)
    assert (power.tolist(), source) == ([0.3, 0.2], "throttle")  # type: ignore[union-attr]
    assert airborne._drive_power(made_log(throttle=stream([0.0], [1.0])), t) == (None, "")


def test_the_power_of_flight_is_the_median_where_something_carries_itself_else_the_largest_that_is_held() -> None:
    power = np.linspace(0.0, 1.0, 101)
    assert airborne._usual_power(power, power > 0.5) == pytest.approx(0.755)
    assert airborne._usual_power(power, power > 2.0) == pytest.approx(0.95)


def test_gaps_of_up_to_two_seconds_are_closed_where_all_between_is_known() -> None:
    whole = np.ones(200, bool)
    assert airborne._bridge_gaps([(10, 30), (50, 60), (81, 90)], whole) == [(10, 60), (81, 90)]
    whole[40] = False
    assert airborne._bridge_gaps([(10, 30), (50, 60)], whole) == [(10, 30), (50, 60)]
    assert airborne._bridge_gaps([(10, 60), (20, 50)], whole) == [(10, 60)]


def level(above: Array, sensor: str = "barometer") -> HeightLevel:
    return HeightLevel(sensor, sensor, above)


def test_half_a_second_above_what_proves_a_flight_is_one() -> None:
    for count, proven in ((5, True), (4, False)):
        above = np.zeros(400)
        above[100 : 100 + count] = 2.1
        assert airborne._is_flight(90, 200, made_grid(), [level(above)]) is proven
    assert not airborne._is_flight(110, 200, made_grid(), [level(np.where(T < 10.9, 9.0, 0.0))])


def test_an_imu_that_is_too_slow_proves_a_flight_by_three_seconds_of_height_alone() -> None:
    unknown = np.full((400, 3), np.nan)
    grid = made_grid(dynamics=np.full(400, 3.0), down=unknown, slow=True)
    for seconds, proven in ((3.0, True), (2.9, False)):
        above = np.where((T >= 10.0) & (T < 10.0 + seconds - 1e-9), 1.0, 0.0)
        assert bool(airborne._is_flight(50, 300, grid, [level(above)])) is proven


def test_a_flight_reaches_to_where_the_height_left_the_ground_and_met_it() -> None:
    """It climbs from 10 to 12 s and sinks from 18 to 20 s; signs of flight from 11.5 to 18.6 s."""
    above = np.interp(T, [10.0, 12.0, 18.0, 20.0], [0.0, 8.0, 8.0, 0.0])
    driven = np.ones(400, bool)
    first, last = airborne._extend_to_ground(115, 186, [level(above)], driven)
    assert (first, last) == (101, 200)
    driven[[107, 192]] = False
    assert airborne._extend_to_ground(115, 186, [level(above)], driven) == (108, 192)
    slow = np.interp(T, [10.0, 20.0, 30.0], [0.3, 9.0, 0.3])
    assert airborne._extend_to_ground(150, 250, [level(slow)], np.ones(400, bool)) == (120, 280)


def test_lift_off_is_where_the_force_leaves_its_level_between_two_steps_of_the_grid() -> None:
    """From 9.81 by 0.2 and then by 0.4 m/s^2: the limit of 0.25 lies at a quarter of the step."""
    size = np.full(400, 9.81)
    size[121], size[122:] = 10.01, 10.21
    driven = np.ones(400, bool)
    found = airborne._liftoff_time(made_grid(size=size), 123, driven)
    assert found == pytest.approx(12.2 - (1.5 - 0.25) * 0.1)
    driven[:122] = False
    assert airborne._liftoff_time(made_grid(size=size), 123, driven) == pytest.approx(12.2 - 0.05)
    assert airborne._liftoff_time(made_grid(size=size, slow=True), 123, driven) == pytest.approx(12.3)
    assert airborne._liftoff_time(made_grid(), 123, np.ones(400, bool)) == pytest.approx(12.3)


def test_a_ground_that_trembles_is_left_at_five_robust_deviations() -> None:
    size = 9.81 + 0.1 * np.tile([1.0, -1.0], 200)
    for jump, found in ((0.7, 12.3), (0.8, 12.0)):
        raised = size.copy()
        raised[120:] = 9.81 + jump
        at = airborne._liftoff_time(made_grid(size=raised), 123, np.ones(400, bool))
        assert at == pytest.approx(found, abs=0.16)
        assert (at < 12.2) == (found < 12.2)


def test_landing_is_the_first_touch_of_the_largest_bump_around_the_end() -> None:
    size = np.full(400, 9.81)
    size[[195, 196, 197]] = 11.0, 12.0, 13.0
    assert airborne._landing_time(made_grid(size=size), 200) == pytest.approx(19.6)
    size[[195, 196, 197]] = 9.81, 9.81, 10.2
    assert airborne._landing_time(made_grid(size=size), 200) == pytest.approx(20.0)  # no bump stands out
    size[195], size[179], size[211] = 10.4, 30.0, 30.0  # two seconds before and one behind are looked at
    assert airborne._landing_time(made_grid(size=size), 200) == pytest.approx(19.5)
    assert airborne._landing_time(made_grid(size=size), 400) == pytest.approx(39.9)


@pytest.mark.parametrize(
    ("sensor", "hint", "sure"), [("range", 0.3, 0.5), ("barometer", 0.7, 2.0), ("GNSS", 3.0, 12.0)]
)
def test_each_sensor_has_its_own_height_of_a_hint_and_of_a_proof(sensor: str, hint: float, sure: float) -> None:
    above = np.array([np.nan, hint - 0.01, hint + 0.01, sure - 0.01, sure + 0.01])
    assert level(above, sensor).hint.tolist() == [False, False, True, True, True]
    assert level(above, sensor).sure.tolist() == [False, False, False, False, True]


def test_heights_count_from_the_line_through_the_ground_before_and_after() -> None:
    """A barometer that drifts by 4 m, and a flight 10 m above it from 10 to 25 s."""
    drift = 100.0 + 0.1 * T
    flown = np.interp(T, [10.0, 12.0, 23.0, 25.0], [0.0, 10.0, 10.0, 0.0])
    log = made_log(baro=[stream(T, drift + flown, "BARO", "m")])
    (found,) = heights.height_levels(log, made_grid(), (T < 9.5) | (T > 25.5))
    assert found.sensor == "barometer"
    np.testing.assert_allclose(found.above[130:220], 10.0, atol=0.01)
    np.testing.assert_allclose(found.above[5:80], 0.0, atol=0.01)
    np.testing.assert_allclose(found.above[280:395], 0.0, atol=0.01)


def test_ground_is_where_it_stands_for_a_second_and_neither_moves_nor_climbs() -> None:
    climb = stream(T, 0.6 * T, "BARO", "m")
    assert heights.height_levels(made_log(baro=[climb]), made_grid(), np.ones(400, bool)) == []
    slow = stream(T, 0.4 * T, "BARO", "m")
    assert len(heights.height_levels(made_log(baro=[slow]), made_grid(), np.ones(400, bool))) == 1
    fast = made_grid(speed=np.full(400, 2.1))
    assert heights.height_levels(made_log(baro=[slow]), fast, np.ones(400, bool)) == []
    assert heights.long_runs(np.array([1, 1, 0, 1, 1, 1, 0], bool), 3).tolist() == [0, 0, 0, 1, 1, 1, 0]


def test_two_flights_are_one_where_the_height_between_them_changes_by_more_than_five_metres() -> None:
    for metres, pause_s, joins in ((6.0, 5.0, True), (4.0, 5.0, False), (6.0, 11.0, False), (-6.0, 5.0, True)):
        b = 100 + round(10 * pause_s)
        high = np.interp(T, [10.0, 0.1 * b], [50.0, 50.0 + metres])
        log = made_log(baro=[stream(T, high, "BARO", "m")])
        found = airborne.join_across_falls(log, made_grid(), [(20, 100), (b, 300)])
        assert (len(found) == 1) is joins
        assert (found[0][0], found[-1][1]) == (20, 300)
    known = np.ones(400, bool)
    known[120] = False
    log = made_log(baro=[stream(T, np.interp(T, [10.0, 15.0], [0.0, 9.0]), "BARO", "m")])
    assert len(airborne.join_across_falls(log, made_grid(known=known), [(20, 100), (150, 300)])) == 2


# Tilt and speed of the nearest record, fast force by numpy, and percentiles of what a log does not know.


def receiver(index: int, t: np.ndarray, speed: np.ndarray, fix: np.ndarray) -> Gnss:
    zero = 0.0 * t
    return Gnss(
        index, t, "GPS", zero, zero, zero, np.column_stack([0.6 * speed, zero, 0.8 * speed]), zero, zero, zero, fix
    )


def test_a_tilt_is_that_of_the_nearest_record_up_to_a_second_and_a_half_away() -> None:
    log = imu_log(np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 3)))
    at = np.array([8.4, 8.6, 10.0, 10.9, 11.1, 13.5, 13.6])
    assert np.isnan(flight_signs.tilt_at(log, at)).all()
    t = np.array([10.0, 12.0])
    log.attitudes = {"ATT": Attitude(t, rotation.from_euler(np.radians([5.0, -20.0]), 0 * t, 0 * t + 2.0), "ATT")}
    log.onboard = "ATT"
    np.testing.assert_allclose(flight_signs.tilt_at(log, at), [np.nan, 5.0, 5.0, 5.0, 20.0, 20.0, np.nan], atol=1e-9)
    one = Attitude(t[:1], log.attitudes["ATT"].q[:1], "ATT")
    log.attitudes = {"ATT": one}
    np.testing.assert_allclose(flight_signs.tilt_at(log, at), [np.nan, 5.0, 5.0, 5.0, 5.0, np.nan, np.nan], atol=1e-9)


def test_a_speed_is_that_of_the_first_receiver_with_four_fixes_of_three_dimensions() -> None:
    log = imu_log(np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 3)))
    t = np.arange(10.0, 16.0)
    few = receiver(0, t, np.full(6, 99.0), np.array([3, 3, 3, 2, 2, 2]))
    good = receiver(1, t, 1.0 + np.arange(6.0), np.array([3, 3, 3, 2, 3, 3]))
    at = np.array([8.4, 8.6, 12.4, 13.6, 17.0])
    log.gnss = [few]
    assert np.isnan(flight_signs.speed_at(log, at)).all()
    log.gnss = [few, good, receiver(2, t, np.full(6, 77.0), np.full(6, 3))]
    np.testing.assert_allclose(flight_signs.speed_at(log, at), [np.nan, 1.0, 3.0, 5.0, np.nan])
    good.vel_ned[:, 2] = np.nan
    np.testing.assert_allclose(flight_signs.speed_at(log, at), [np.nan, 0.6, 1.8, 3.0, np.nan])


def test_fast_force_of_each_second_is_what_a_mean_over_a_fifth_of_it_leaves() -> None:
    t = np.arange(0.0, 8.0, 0.01)
    acc = np.random.default_rng(2).normal(size=(len(t), 3)) * [1.0, 2.0, 3.0] * (1.0 + t)[:, None]
    unit = Imu(0, Stream(t, acc, "", "", ""), Stream(t, acc, "", "", ""))
    starts, found = rest.vibration_levels(unit, [(2.0, 6.505)])
    np.testing.assert_allclose(starts, [2.0, 3.0, 4.0, 5.0], atol=0.011)
    part = acc[(t >= 2.0) & (t <= 6.505)]
    fast = part - rest.centred_mean(part, 20)
    for k, values in enumerate(found):
        np.testing.assert_allclose(values, np.sqrt(np.mean(fast[100 * k : 100 * (k + 1)] ** 2, axis=0)), rtol=0.03)
    assert len(rest.vibration_levels(unit, [(2.0, 2.08)])[0]) == 0
