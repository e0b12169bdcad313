"""Gravity at rest against an attitude of a vehicle in which the IMU sits tilted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog import segments
from attlog.core import rotation
from attlog.flight.model import Attitude, FlightLog, Stream
from attlog.health import gravity, gyro, vibration
from attlog.health.check import HealthCase
from attlog.health.gravity import gravity_at_rest
from attlog.segments import Segment, Segments
from tests.health.imu_cases import G as imu_cases_G
from tests.health.imu_cases import case, log_of, unit
from tests.reference.flights import flight
from tests.segments.flights import imu_log


@pytest.mark.parametrize(("told", "deg"), [(True, 0.0), (False, 5.0)])
def test_a_trim_that_the_log_tells_is_no_angle_to_gravity(told: bool, deg: float) -> None:
    """The vehicle's attitude is ``q_imu (x) exp(-trim)``, with 3 and 4 deg in roll and pitch."""
    log, trim = flight(), np.radians([3.0, -4.0, 0.0])
    attitude = log.attitudes["ATT"]
    attitude.q = rotation.multiply(attitude.q, rotation.from_rotvec(-trim))
    attitude.has_trim, log.parameters.trim = True, trim if told else None
    found = gravity.gravity_checks(HealthCase(log, segments.build(log)))
    (check,) = (c for c in found if c.question == "gravity_direction")
    assert check.value == pytest.approx(deg, abs=0.1)


# An estimated accelerometer bias: how much it must explain of what gravity shows before it is told.


@pytest.mark.parametrize(
    ("bias", "left_deg", "verdict"), [(0.4, 1.9, "warning"), (0.4, 2.1, "ok"), (0.6, 3.9, "fault"), (0.1, 0.0, "ok")]
)
def test_a_bias_is_a_warning_where_it_leaves_less_than_half_of_the_tilt(
    bias: float, left_deg: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """4 deg between the attitude's up and the force at rest; 0.1, 0.4 and 0.6 m/s^2 are 0.6, 2.3 and 3.5 deg."""
    monkeypatch.setattr(gravity, "tilt_with_and_without_bias", lambda *_: (4.0, left_deg))
    stream = Stream(np.arange(2.0), np.tile([0.0, bias, 0.0], (2, 1)), "m/s^2", "FRD", "bias")
    log: Any = SimpleNamespace(estimator=SimpleNamespace(acc_bias=stream), onboard="ATT")
    (found,) = gravity.onboard_acc_bias_check(HealthCase(log, Segments()))
    assert found.verdict == verdict
    assert bool(found.evidence) is (verdict == "warning")


# Limits of gravity's size and direction and of what a gyro reads, from both sides, on made constant forces.

T = np.arange(0.0, 60.0, 0.02)
G = gravity.STANDARD_GRAVITY
REST = Segments([Segment("rest.long", 0.0, 60.0)])
AIR = Segments([Segment("airborne", 10.0, 50.0)])


def made(force: Any, q: Any = None, **more: Any) -> FlightLog:
    """A log of a constant force (3,), with noise that keeps no axis constant, and an onboard attitude (4,)."""
    noise = 1e-4 * np.random.default_rng(3).normal(size=(len(T), 3))
    log = imu_log(T, noise, np.asarray(force) + noise, **more)
    if q is not None:
        log.attitudes, log.onboard = {"ATT": Attitude(T, np.tile(q, (len(T), 1)), "ATT")}, "ATT"
    return log


def check(log: FlightLog, spans: Segments, name: str) -> Any:
    (found,) = (c for c in gravity.gravity_checks(HealthCase(log, spans)) if c.question == name)
    return found


def tilted(roll_deg: float, pitch_deg: float = 0.0) -> np.ndarray:
    return rotation.from_euler(np.radians(roll_deg), np.radians(pitch_deg), 0.0)


@pytest.mark.parametrize(
    ("size", "verdict"),
    [
        (G + 0.29, "ok"),
        (G - 0.29, "ok"),
        (G + 0.31, "warning"),
        (7.05, "warning"),
        (6.95, "fault"),
        (12.95, "warning"),
        (13.05, "fault"),
    ],
)
def test_gravity_at_rest_is_within_three_tenths_and_a_fault_outside_7_to_13(size: float, verdict: str) -> None:
    log = made([0.6 * size, 0.0, -0.8 * size])
    found = gravity._short_rest(log, log.imus[0], np.ones(len(T), bool), "at rest")
    assert (found.verdict, found.value) == (verdict, pytest.approx(size, abs=1e-3))
    assert found.text.startswith("At rest the accelerometer shows")
    assert [f"be {size / G:.2f} of what" in x for x in found.evidence] == ([] if verdict == "ok" else [True])


def test_with_motors_on_the_ground_counts_where_there_is_no_rest() -> None:
    both = Segments([Segment("rest.long", 0.0, 0.1), Segment("idle", 5.0, 9.0)])
    log = made([0.0, 0.0, -G])
    log.imus[0].acc.x[: len(T) // 20] *= 1.2
    found = check(log, both, "accelerometer_rest")
    assert (found.verdict, "n the ground with motors on" in found.text) == ("ok", True)


@pytest.mark.parametrize(("off", "verdict"), [(0.49, "ok"), (-0.49, "ok"), (0.51, "warning"), (1.51, "fault")])
def test_the_mean_vertical_force_of_a_flight_is_within_half_a_metre_per_second_squared(
    off: float, verdict: str
) -> None:
    q = tilted(20.0, -35.0)
    force = rotation.rotate_inverse(q, np.array([0.0, 0.0, -(G + off)]))
    found = check(made(force, q), AIR, "gravity_in_flight")
    assert (found.verdict, found.value) == (verdict, pytest.approx(G + off, abs=1e-3))


def test_samples_that_are_kept_unevenly_count_for_the_time_they_stand_for() -> None:
    """It pulls 12 m/s^2 half of the time, where four of five records are kept, and 7.6 where one of five is."""
    up = (T % 4.0) < 2.0
    log = made([0.0, 0.0, -G], tilted(0.0))
    log.imus[0].acc.x[:, 2] = np.where(up, -12.0, -7.6)
    kept = up | (np.arange(len(T)) % 5 == 0)
    kept &= ~up | (np.arange(len(T)) % 5 != 0)
    for stream in (log.imus[0].acc, log.imus[0].gyro):
        stream.t, stream.x = stream.t[kept], stream.x[kept]
    assert check(log, AIR, "gravity_in_flight").value == pytest.approx(9.8, abs=0.05)


@pytest.mark.parametrize(("seconds", "verdict"), [(12.0, "ok"), (14.0, "warning")])
def test_a_climb_of_eight_metres_per_second_is_allowed_for_in_a_short_flight(seconds: float, verdict: str) -> None:
    air = Segments([Segment("airborne", 10.0, 10.0 + seconds)])
    log = made([0.0, 0.0, -(G + 0.62)], tilted(0.0))
    assert check(log, air, "gravity_in_flight").verdict == verdict


@pytest.mark.parametrize(("deg", "verdict"), [(2.9, "ok"), (3.1, "warning"), (9.9, "warning"), (10.1, "fault")])
def test_gravity_at_rest_and_the_attitude_differ_by_3_and_10_degrees(deg: float, verdict: str) -> None:
    log = made(rotation.rotate_inverse(tilted(0.0, 30.0), np.array([0.0, 0.0, -G])), tilted(0.0, 30.0 - deg))
    found = check(log, REST, "gravity_direction")
    assert (found.verdict, found.value) == (verdict, pytest.approx(deg, abs=0.01))


@pytest.mark.parametrize(("deg", "verdict"), [(9.9, "ok"), (10.1, "warning"), (29.9, "warning"), (30.1, "fault")])
def test_mean_gravity_in_flight_and_the_attitude_differ_by_10_and_30_degrees(deg: float, verdict: str) -> None:
    log = made(rotation.rotate_inverse(tilted(deg), np.array([0.0, 0.0, -G])), tilted(0.0))
    found = check(log, AIR, "gravity_direction")
    assert (found.verdict, found.value) == (verdict, pytest.approx(deg, abs=0.02))


def test_an_attitude_below_five_hertz_or_five_seconds_of_flight_tells_no_gravity() -> None:
    log = made([0.0, 0.0, -G], tilted(0.0))
    few = np.arange(0.0, 60.0, 0.21)
    slow = made([0.0, 0.0, -G])
    slow.attitudes, slow.onboard = {"ATT": Attitude(few, np.tile(tilted(0.0), (len(few), 1)), "ATT")}, "ATT"
    assert gravity.mean_force_in_flight(slow, slow.imus[0], AIR) is None
    for end, told in ((14.9, False), (15.2, True)):
        found = gravity.mean_force_in_flight(log, log.imus[0], Segments([Segment("airborne", 10.0, end)]))
        assert (found is not None) is told


@pytest.mark.parametrize(("roll", "pitch"), [(90, 0), (180, 0), (270, 0), (0, 90), (0, 270), (90, 90), (180, 270)])
def test_a_quarter_turn_that_explains_the_difference_is_named(roll: int, pitch: int) -> None:
    up = Rotation.from_euler("xyz", [[12.0, -25.0, 0.0], [-20.0, 8.0, 0.0]], degrees=True).apply([0.0, 0.0, -1.0])
    turn = Rotation.from_euler("ZYX", [0.0, pitch, roll], degrees=True)
    (hint,) = gravity.mounting_hint(turn.inv().apply(up), up)
    words = " and ".join(f"{n} {a} deg" for n, a in (("roll", roll), ("pitch", pitch)) if a)
    assert f"mounted with {words} would" in hint
    assert gravity.mounting_hint(up, up) == []


@pytest.mark.parametrize(("dps", "verdict"), [(0.99, "ok"), (-1.01, "warning"), (2.99, "warning"), (-3.01, "fault")])
def test_a_gyro_at_rest_reads_up_to_one_and_three_degrees_a_second(dps: float, verdict: str) -> None:
    x = np.tile(np.radians([0.1, dps, -0.2]), (len(T), 1))
    log = imu_log(T, x, x)
    found = gyro._rest_bias(log.imus[0], REST)
    assert (found.verdict, found.value) == (verdict, pytest.approx(dps, abs=1e-3))
    assert "Standing still the gyro reads 0.10, " in found.text
    idle = gyro._rest_bias(log.imus[0], Segments([Segment("rest.long", 0.0, 0.17), Segment("idle", 1.0, 4.0)]))
    assert idle.text.startswith("On the ground with motors on the gyro")
    assert gyro._rest_bias(log.imus[0], AIR) is None


@pytest.mark.parametrize(
    ("rates", "count"),
    [
        ([100.0, 1999.0, 1500.0, 2010.0], 2),
        ([1998.9] * 5, 0),
        ([500.0, 500.1, 499.8, 100.0], 3),
        ([500.0, 100.0, 500.0, 500.0], 0),
        ([500.3] * 5, 0),
        ([250.0] * 3 + [249.0], 3),
        ([125.0] * 4, 4),
        ([1000.0] * 3, 3),
        ([], 0),
    ],
)
def test_samples_at_a_known_range_are_at_its_end_where_three_stay_there(rates: list[float], count: int) -> None:
    assert gyro.count_at_limit(np.array(rates)) == count


def force_log(after: float, climb: float = 0.0) -> FlightLog:
    """The upward force rises by ``after`` m/s^2 from 32 s on, the height by an acceleration of ``climb``."""
    log = made([0.0, 0.0, -G], tilted(0.0))
    log.imus[0].acc.x[T >= 32.0, 2] -= after
    height = np.where(T > 32.0, 0.5 * climb * (T - 32.0) ** 2, 0.0)
    log.baro = Stream(T[::5], height[::5, None], "m", "", "BARO")
    return log


@pytest.mark.parametrize(
    ("after", "climb", "verdict"),
    [(0.69, 0.0, "ok"), (-0.71, 0.0, "warning"), (1.49, 0.0, "warning"), (1.51, 0.0, "fault"), (2.0, 2.0, "ok")],
)
def test_a_vertical_force_that_changes_without_a_climb_is_told(
    monkeypatch: pytest.MonkeyPatch, after: float, climb: float, verdict: str
) -> None:
    log = force_log(after, climb)
    monkeypatch.setattr(vibration, "height_stream", lambda log: log.baro)
    found = vibration.vertical_force(log, log.imus[0], [(10.0, 56.0)])
    assert found.verdict == verdict
    if climb == 0.0:
        assert found.value == pytest.approx(abs(after), abs=0.01)
    if verdict != "ok":
        assert found.t == 32.0
        assert "first from 32 to 42 s" in found.text


def test_a_vertical_force_at_the_end_of_a_flight_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    log = force_log(0.0)
    log.imus[0].acc.x[T >= 42.5, 2] -= 3.0  # a landing, after the last whole window of 10 s
    monkeypatch.setattr(vibration, "height_stream", lambda log: log.baro)
    assert vibration.vertical_force(log, log.imus[0], [(10.0, 46.0)]).verdict == "ok"


@pytest.mark.parametrize(("throttle", "more"), [(0.64, False), (0.66, True)])
def test_vibration_that_comes_with_three_tenths_more_throttle_is_none_that_broke(throttle: float, more: bool) -> None:
    t = np.arange(0.0, 60.0)
    power = Stream(t, np.where(t < 40.0, 0.5, throttle)[:, None], "", "", "CTUN")
    assert vibration.has_more_power(power, t, 40) is more
    assert vibration.has_more_power(None, t, 40) is False


@pytest.mark.parametrize(
    ("after", "at", "verdict"), [(1.4, 30, None), (2.9, 30, "warning"), (3.2, 30, "fault"), (6.0, 51, None)]
)
def test_vibration_that_has_grown_is_told_with_axis_sizes_and_begin(
    monkeypatch: pytest.MonkeyPatch, after: float, at: int, verdict: str | None
) -> None:
    t = np.arange(10.0, 70.0)
    x = np.full((60, 3), 0.3)
    x[:, 1], x[at:, 1] = 0.5, after
    monkeypatch.setattr(vibration, "vibration_levels", lambda imu, flown: (t, x))
    log = made([0.0, 0.0, -G])
    found = vibration.logged_vibration(log, log.imus[0], [(10.0, 70.0)])
    assert found.t == (None if verdict is None else 40.0)
    if verdict is not None:
        assert (found.verdict, found.value) == (verdict, after)
        assert f"From 40 s on the accelerometer's y vibrates by {after} m/s^2 instead of 0.5." == found.text


@pytest.mark.parametrize(
    ("size", "verdict"), [(2.9, "ok"), (3.1, "warning"), (14.9, "warning"), (15.1, "fault"), (None, "unknown")]
)
def test_steady_vibration_is_judged_by_3_and_15(
    monkeypatch: pytest.MonkeyPatch, size: float | None, verdict: str
) -> None:
    t = np.arange(10.0, 70.0 if size else 19.0)
    x = np.full((len(t), 3), [0.5, 0.2, size or 1.0])
    monkeypatch.setattr(vibration, "vibration_levels", lambda imu, flown: (t, x))
    log = made([0.0, 0.0, -G])
    found = vibration.logged_vibration(log, log.imus[0], [(10.0, 70.0)])
    assert found.verdict == verdict
    if size is not None:
        assert (found.value, "z most" in found.text) == (size, True)


# Gravity's size at rest, of every unit.

NONE = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("down", "verdict"), [(0.2, "ok"), (-0.4, "warning"), (1.4, "fault")])
def test_the_size_at_rest_is_gravity_s_less_what_the_unit_reads_too_much(down: float, verdict: str) -> None:
    sound, off = gravity_at_rest(case(log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, (0.0, 0.0, down), NONE))))
    assert (sound.verdict, off.verdict) == ("ok", verdict)
    for one, size in ((sound, imu_cases_G), (off, imu_cases_G - down)):
        assert one.ci95 is not None
        assert one.ci95[0] < size < one.ci95[1]
        assert one.ci95[1] - one.ci95[0] < 0.1
        assert one.seconds == pytest.approx(56.0, abs=1.0)
    assert bool(off.why_no_setting) == (verdict != "ok")
    assert not off.settings


def test_without_rest_or_with_shaking_motors_nothing_is_said_but_that() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE))
    assert [a.verdict for a in gravity_at_rest(case(log, segments=Segments([Segment("airborne", 30.0, 90.0)])))] == [
        "unknown"
    ]
    log.imus[0].acc.x += 5.0 * np.random.default_rng(1).normal(size=(len(log.imus[0].acc.t), 3)).cumsum(axis=0) / 10
    assert [a.verdict for a in gravity_at_rest(case(log))] == ["unknown"]
