"""Faults of delay, gaps, scale, axes, offset and mounting, put into flights with truth: their size, time and cause.

The sizes are the test's own; ``benchmarks/planted.py`` does the same on the corpus and publishes the counts."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import flight, segments
from attlog.core import rotation
from attlog.flight.model import FlightLog, Stream, TimeLine
from attlog.health import attitude as jumps
from attlog.health import compass_power, compass_turn, gravity, vibration
from attlog.health.check import Check, HealthCase
from attlog.health.findings import findings
from attlog.health.registry import run_checks
from attlog.reference import choose
from tests.conftest import SAMPLES
from tests.health.test_health import good

QUAD, COPTER = SAMPLES / "px4_steps.ulg", SAMPLES / "copter_steps_stabilize.bin"
NEW = (
    "imu_delay",
    "gaps",
    "gyro_scale",
    "gyro_bias_step",
    "force_axes",
    "accelerometer_offset",
    "compass_offset",
    "compass_turn",
)


@cache
def read(path: Path) -> FlightLog:
    return flight.read(path)


def checked(path: Path, change: Callable[[FlightLog], None] | None = None, truth: bool = True) -> dict[str, Check]:
    log = deepcopy(read(path))
    if not truth:
        log.truth = None
    if change is not None:
        change(log)
    return {c.question: c for c in reversed(run_checks(HealthCase(log, segments.build(log)))) if c.in_use}


def each_gyro(change: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Callable[[FlightLog], None]:
    def on(log: FlightLog) -> None:
        for imu in log.imus:
            imu.gyro.x = change(imu.gyro.t, imu.gyro.x)

    return on


@pytest.mark.parametrize("path", [QUAD, COPTER], ids=lambda p: p.name)
@pytest.mark.parametrize("truth", [True, False])
def test_the_flight_itself_has_none_of_them(path: Path, truth: bool) -> None:
    found = checked(path, truth=truth)
    assert {name: found[name].text for name in NEW if found[name].verdict not in ("ok", "unknown")} == {}


@pytest.mark.parametrize(("path", "own_ms"), [(QUAD, 0.0), (COPTER, 2.8)], ids=["px4", "ardupilot"])
@pytest.mark.parametrize("late_ms", [15.0, -9.0])
def test_an_imu_on_another_clock_is_late_or_early_by_what_its_filter_does_not_explain(
    path: Path, own_ms: float, late_ms: float
) -> None:
    def shift(log: FlightLog) -> None:
        for imu in log.imus:
            for stream in (imu.gyro, imu.acc):
                stream.t = stream.t + 1e-3 * late_ms

    if late_ms < 0:
        check = checked(path, shift, truth=False)["imu_delay"]
        assert (check.verdict, "the attitude, not the IMU, is late" in check.text) == ("ok", True)
    check = checked(path, shift, truth=late_ms < 0)["imu_delay"]
    assert check.verdict == "warning"
    assert check.value == pytest.approx(own_ms + late_ms, abs=1.0)
    assert ("earlier" if late_ms < 0 else "later") in check.text


@pytest.mark.parametrize(("factor", "way"), [(1.03, "much"), (0.97, "little")])
def test_a_gyro_that_reads_too_much_or_too_little_is_told_in_percent(factor: float, way: str) -> None:
    check = checked(QUAD, each_gyro(lambda _, x: x * [factor, 1.0, 1.0]))["gyro_scale"]
    assert check.verdict == "fault"
    assert check.value == pytest.approx(100.0 * (factor - 1.0), abs=0.5)
    assert f"too {way} about x (" in check.text


def test_the_onboard_attitude_accuses_no_gyro() -> None:
    found = checked(QUAD, each_gyro(lambda _, x: x * [1.05, 1.0, 1.0]), truth=False)["gyro_scale"]
    assert found.verdict == "unknown"


def test_an_offset_that_rest_and_the_onboard_bias_do_not_show_is_unknown() -> None:
    """0.4 m/s^2 from take-off on, as a fit misled by wind shows it, and the same at rest too."""

    def push(begin: float) -> Callable[[FlightLog], None]:
        def on(log: FlightLog) -> None:
            for imu in log.imus:
                imu.acc.x = imu.acc.x + np.outer(imu.acc.t > begin, [0.4, 0.0, 0.0])

        return on

    take_off = segments.build(deepcopy(read(QUAD))).spans("airborne")[0][0]
    aloft = checked(QUAD, push(take_off))["accelerometer_offset"]
    assert (aloft.verdict, "do not show it" in aloft.text) == ("unknown", True)
    assert checked(QUAD, push(-1.0))["accelerometer_offset"].is_trouble


def test_a_bias_that_steps_in_flight_is_told_with_axis_sign_and_time() -> None:
    step = np.radians([0.0, -1.2, 0.0])
    check = checked(COPTER, each_gyro(lambda t, x: x + np.outer(t > 50.0, step)), truth=False)["gyro_bias_step"]
    assert check.verdict == "warning"
    assert check.value == pytest.approx(-1.2, abs=0.2)
    assert check.t == pytest.approx(50.0, abs=2.0)
    assert "about y" in check.text


def test_a_step_about_z_that_no_onboard_heading_shows_is_told_by_the_smoother_with_its_time() -> None:
    log = deepcopy(read(COPTER))
    log.truth = None
    each_gyro(lambda t, x: x + np.outer(t > 50.0, np.radians([0.0, 0.0, 1.2])))(log)
    case = attlog.prepare(log)
    assert case.reference.kind == "smoother"
    (check,) = (
        c for c in run_checks(HealthCase(case.log, case.segments, case.reference)) if c.question == "gyro_bias_step"
    )
    assert (check.verdict, check.value) == ("warning", pytest.approx(1.2, abs=0.1))
    assert check.t == pytest.approx(50.0, abs=1.0)
    assert "about z" in check.text
    assert "by the smoother" in check.text
    (found,) = (f for f in findings(case.log, [check]) if f.kind == "gyro_bias")
    assert (found.t, found.value) == (check.t, check.value)


@pytest.mark.parametrize("path", [QUAD, COPTER], ids=lambda p: p.name)
def test_iron_beside_the_compass_is_an_offset_in_its_axes(path: Path) -> None:
    def iron(log: FlightLog) -> None:
        for mag in log.mags:
            mag.field.x = mag.field.x + 1e-6 * np.array([6.0, -8.0, 2.0])

    found = checked(path, iron)
    assert found["compass_offset"].verdict == "warning"
    assert found["compass_offset"].value == pytest.approx(np.sqrt(6**2 + 8**2 + 2**2), abs=2.0)
    assert found["compass_turn"].verdict != "fault"


@pytest.mark.parametrize("turn", [28.0, -15.0])
def test_a_compass_mounted_askew_is_a_turn_and_no_offset(turn: float) -> None:
    """Mounted clockwise it shows the field turned the other way."""

    def mount(log: FlightLog) -> None:
        q = rotation.from_euler(0.0, 0.0, np.radians(turn))
        for mag in log.mags:
            mag.field.x = rotation.rotate_inverse(np.tile(q, (len(mag.field.x), 1)), mag.field.x)

    found = checked(QUAD, mount)
    assert found["compass_turn"].verdict in ("warning", "fault")
    assert found["compass_turn"].value == pytest.approx(turn, abs=4.0)
    assert found["compass_offset"].verdict == "ok"


def lose(log: FlightLog, every: float, seconds: float, attitude: bool) -> None:
    for imu in log.imus:
        keep = (imu.gyro.t % every) >= seconds
        for stream in (imu.gyro, imu.acc):
            stream.t, stream.x = stream.t[keep], stream.x[keep]
    flew = log.onboard_attitude
    if attitude and flew is not None:
        keep = (flew.t % every) >= seconds
        flew.t, flew.q, flew.resets = flew.t[keep], flew.q[keep], np.zeros(0, np.int64)
        flew.t_sample = None if flew.t_sample is None else flew.t_sample[keep]


@pytest.mark.parametrize(("attitude", "cause"), [(False, "The IMU, its driver"), (True, "The logger lost records")])
def test_gaps_are_the_imus_where_others_go_on_and_the_loggers_where_none_does(attitude: bool, cause: str) -> None:
    log = deepcopy(read(QUAD))
    lose(log, 5.0, 0.2, attitude)
    checks = run_checks(HealthCase(log, segments.build(log)))
    check = next(c for c in checks if c.question == "gaps")
    assert check.verdict == "warning"
    assert check.value / check.count == pytest.approx(0.2, abs=0.01)
    entry = next(p for p in findings(log, checks) if p.kind == "gaps")
    assert (entry.severity, entry.cause.startswith(cause), bool(entry.action)) == ("warning", True, True)


def test_two_short_gaps_change_nothing_and_are_only_counted() -> None:
    check = checked(QUAD, lambda log: lose(log, 40.0, 0.1, False))["gaps"]
    assert (check.verdict, check.count) == ("ok", 2)
    assert "2 gaps" in check.text


def test_what_a_flight_cannot_tell_is_unknown_with_its_reason() -> None:
    hover = checked(SAMPLES / "px4_hover.ulg")
    assert hover["gyro_scale"].verdict == "unknown"
    assert "360 deg" in hover["gyro_scale"].action

    def blind(log: FlightLog) -> None:
        log.gnss[0].fix[:] = 0

    found = checked(QUAD, blind)
    assert found["force_axes"].verdict == found["accelerometer_offset"].verdict == "unknown"
    assert "GNSS velocity" in found["force_axes"].text


@pytest.mark.parametrize(("since", "steady"), [(0.0, True), (0.5, False)])
def test_iron_that_comes_during_the_flight_is_no_constant_offset(since: float, steady: bool) -> None:
    log = deepcopy(read(QUAD))
    phases = segments.build(log)
    a, b = phases.spans("airborne")[0]
    for mag in log.mags:
        later = mag.field.t_best >= a + since * (b - a)
        mag.field.x = mag.field.x + np.outer(later, 1e-6 * np.array([20.0, -10.0, 0.0]))
    reference = choose(log, phases)
    found = compass_turn.fit_turn(log, phases, reference)
    assert found is not None
    assert (found.is_large and found.steady) is steady
    assert any(check.is_trouble for check in compass_turn.fit_checks("MAG", found, reference)) is steady


def test_an_onboard_heading_that_a_compass_drags_is_no_step_of_the_gyro() -> None:
    """By 1.5 deg/s from 50 s on: about z an onboard attitude does not judge the gyro."""

    def drag(log: FlightLog) -> None:
        attitude = log.onboard_attitude
        assert attitude is not None
        turned = np.radians(1.5) * np.maximum(attitude.t - 50.0, 0.0)
        attitude.q = rotation.turn_about_down(attitude.q, turned)

    check = checked(COPTER, drag, truth=False)["gyro_bias_step"]
    assert check.verdict == "ok"
    assert "about x and y" in check.text


# Faults put into a good flight are found with their size and time; the flight itself is silent.


def flown(name: str = "px4_steps.ulg") -> tuple[FlightLog, segments.Segments]:
    log = deepcopy(good(name))
    return log, segments.build(log)


def only(found: list[Check], name: str) -> Check:
    return next(c for c in found if c.question == name)


def test_vibration_that_begins_in_flight_is_told_with_its_size_and_onset() -> None:
    log, phases = flown()
    imu = log.replay_imu
    assert imu is not None
    a, b = max(phases.spans("airborne"), key=lambda s: s[1] - s[0])
    start = 0.5 * (a + b)
    later = imu.acc.t >= start
    imu.acc.x[later, 2] += 5.0 * np.random.default_rng(1).normal(size=later.sum())
    found = vibration.logged_vibration(log, imu, phases.spans("airborne"))
    assert found.verdict == "fault"
    assert found.t == pytest.approx(start, abs=2.0)
    # white noise less its mean over about 20 or 40 samples
    assert found.value == pytest.approx(5.0, rel=0.06)


def test_of_current_and_throttle_the_one_that_bends_the_field_counts() -> None:
    """A current that follows nothing stands before a throttle by which the field doubles."""
    rng = np.random.default_rng(2)
    t = np.arange(0.0, 60.0, 0.1)
    throttle = 0.5 + 0.3 * np.sin(0.3 * t)
    field = 40e-6 * (0.5 + throttle)
    log, _ = flown()
    x = np.column_stack([field, np.zeros_like(t), np.zeros_like(t)]) + 0.1e-6 * rng.normal(size=(len(t), 3))
    log.mags[0].field, log.mag = Stream(t, x, "T", "FRD", "mag"), 0
    log.power.battery = Stream(t, np.column_stack([0 * t + 15.0, 10.0 + 5.0 * np.cos(1.7 * t)]), "V A", "", "battery")
    log.power.throttle = Stream(t, throttle[:, None], "1", "", "throttle")
    found = compass_power.interference_check(
        log, segments.Segments([segments.Segment("armed", 0.0, 60.0)]), log.mags[log.mag]
    )
    assert found.verdict == "fault"
    assert "with the throttle" in found.text


def test_a_realignment_in_flight_is_told_with_size_and_time_and_one_before_arming_is_not() -> None:
    log, _ = flown()
    attitude = log.onboard_attitude
    assert attitude is not None
    a, b = max(segments.build(log).spans("airborne"), key=lambda s: s[1] - s[0])
    at = 0.5 * (a + b)
    turned = rotation.from_euler(0.0, 0.0, np.radians(25.0))
    later = attitude.t >= at
    attitude.q[later] = rotation.multiply(np.tile(turned, (later.sum(), 1)), attitude.q[later])
    phases = segments.build(log)
    found = only(jumps.jump_checks(HealthCase(log, phases)), "attitude_jumps")
    assert found.verdict == "fault"
    assert found.value == pytest.approx(25.0, abs=1.0)
    assert found.t == pytest.approx(at, abs=0.2)
    assert "heading jumped once" in found.text
    assert found.about == "heading"


@pytest.mark.parametrize(("before_s", "is_switch"), [(0.1, True), (3.0, False)])
def test_a_jump_at_a_switch_of_imu_blames_the_switch_not_the_compass(before_s: float, is_switch: bool) -> None:
    log, _ = flown()
    attitude = log.onboard_attitude
    assert attitude is not None
    a, b = max(segments.build(log).spans("airborne"), key=lambda s: s[1] - s[0])
    later = attitude.t >= 0.5 * (a + b)
    turned = rotation.from_euler(0.0, 0.0, np.radians(25.0))
    attitude.q[later] = rotation.multiply(np.tile(turned, (later.sum(), 1)), attitude.q[later])
    log.imu_that_flew = TimeLine(np.array([0.0, 0.5 * (a + b) - before_s]), [0, 1], "made")
    found = only(jumps.jump_checks(HealthCase(log, segments.build(log))), "attitude_jumps")
    assert ("switched from IMU 0 to 1" in found.cause) == is_switch
    assert found.about == ("" if is_switch else "heading")


def test_the_same_realignment_before_take_off_is_a_warning() -> None:
    """Armed on the ground until after it."""
    log, _ = flown()
    attitude = log.onboard_attitude
    assert attitude is not None
    a, b = max(segments.build(log).spans("airborne"), key=lambda s: s[1] - s[0])
    at = 0.5 * (a + b)
    attitude.q = rotation.turn_about_down(attitude.q, np.where(attitude.t >= at, np.radians(25.0), 0.0))
    phases = segments.build(log)
    phases.segments = [s for s in phases.segments if s.kind != "airborne"]
    phases.segments.append(segments.Segment("airborne", at + 5.0, b))
    found = only(jumps.jump_checks(HealthCase(log, phases)), "attitude_jumps")
    assert (found.verdict, found.value) == ("warning", pytest.approx(25.0, abs=1.0))


def test_an_estimated_bias_is_told_as_tilt_and_as_what_it_explains() -> None:
    log, phases = flown()
    imu, onboard = log.replay_imu, log.onboard_attitude
    assert imu is not None
    assert onboard is not None
    imu.acc.x[:, 0] -= 0.4  # a fault that the estimator takes off again
    log.estimator.acc_bias = Stream(np.array([0.0, 1.0]), np.tile([-0.4, 0.0, 0.0], (2, 1)), "m/s^2", "FRD", "bias")
    (found,) = gravity.onboard_acc_bias_check(HealthCase(log, phases))
    assert found.verdict == "warning"
    assert found.value == pytest.approx(-0.4)
    assert "2.3 deg of tilt" in found.text
    assert "It explains" in found.evidence[0]
    log.onboard = ""
    (alone,) = gravity.onboard_acc_bias_check(HealthCase(log, phases))
    assert alone.value == found.value
    assert "explains" not in alone.text
    log.estimator.acc_bias = None
    assert gravity.onboard_acc_bias_check(HealthCase(log, phases)) == []
