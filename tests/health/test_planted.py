"""Faults put into a good flight are found with their size and time; the flight itself is silent."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest

from attlog import segments
from attlog.core import rotation
from attlog.flight.model import Attitude, FlightLog, Stream
from attlog.health import attitude as jumps
from attlog.health import compass_power, gravity, sources, vibration
from attlog.health.check import Check, HealthCase
from attlog.health.registry import run_checks
from tests.health.test_health import good


def flown(name: str = "px4_steps.ulg") -> tuple[FlightLog, segments.Segments]:
    log = deepcopy(good(name))
    return log, segments.build(log)


def only(found: list[Check], name: str) -> Check:
    return next(c for c in found if c.question == name)


@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_steps_stabilize.bin"])
def test_a_good_flight_is_silent(name: str) -> None:
    log, phases = flown(name)
    found = run_checks(HealthCase(log, phases))
    quiet = (
        "vibration_level",
        "vertical_force",
        "compass_offset",
        "compass_motors",
        "second_source",
        "accelerometer_rest",
    )
    assert {c.verdict for c in found if c.question in quiet} <= {"ok", "unknown"}
    assert only(jumps.jump_checks(HealthCase(log, phases)), "attitude_jumps").verdict in ("ok", "warning")


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


def test_a_force_that_vibration_takes_away_is_told_by_the_barometer() -> None:
    log, phases = flown()
    imu = log.replay_imu
    assert imu is not None
    a, b = max(phases.spans("airborne"), key=lambda s: s[1] - s[0])
    start = 0.5 * (a + b)
    imu.acc.x[imu.acc.t >= start, 2] += 2.5
    found = only(vibration.vertical_force_check(HealthCase(log, phases)), "vertical_force")
    assert found.verdict == "fault"
    assert found.value == pytest.approx(2.5, abs=0.5)
    assert found.t == pytest.approx(start, abs=vibration.FORCE_WINDOW_S + 1.0)
    assert (
        f"first from {found.t:.0f} to {found.t + vibration.FORCE_WINDOW_S:.0f} s" in found.text
    )  # as sharp as a window


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


def test_a_second_source_that_leaves_is_told_with_its_size_and_time() -> None:
    log, phases = flown()
    flew = log.onboard_attitude
    assert flew is not None
    a, b = max(phases.spans("airborne"), key=lambda s: s[1] - s[0])
    at = a + 0.4 * (b - a)
    q = flew.q.copy()
    later = flew.t >= at
    turned = np.tile(rotation.from_euler(0.0, 0.0, np.radians(70.0)), (later.sum(), 1))
    q[later] = rotation.multiply(turned, q[later])
    log.attitudes["backup"] = Attitude(flew.t, q, "backup", t_sample=flew.t_sample)
    (found,) = sources.source_checks(HealthCase(log, phases))
    assert found.verdict == "fault"
    assert found.value == pytest.approx(70.0, abs=1.0)
    assert found.t == pytest.approx(at, abs=2.0)
    assert "backup differs from vehicle_attitude by 70 deg in heading; which is right" in found.text


def test_a_second_source_that_comes_and_goes_is_told_with_its_share_and_its_end() -> None:
    log, phases = flown()
    flew = log.onboard_attitude
    assert flew is not None
    a, b = max(phases.spans("airborne"), key=lambda s: s[1] - s[0])
    q, later = flew.q.copy(), np.zeros(len(flew.t), bool)
    for share in (0.2, 0.5):
        later |= np.abs(flew.t - a - share * (b - a)) < 0.09 * (b - a)
    turned = np.tile(rotation.from_euler(0.0, 0.0, np.radians(70.0)), (later.sum(), 1))
    q[later] = rotation.multiply(turned, q[later])
    log.attitudes["backup"] = Attitude(flew.t, q, "backup", t_sample=flew.t_sample)
    (found,) = sources.source_checks(HealthCase(log, phases))
    assert found.t_end == pytest.approx(a + 0.59 * (b - a), abs=1.0)
    share, _, rest = found.text.removeprefix("In ").partition(" % of the time from ")
    assert float(share) == pytest.approx(100 * 0.36 / 0.48, abs=10.0)
    assert f"to {found.t_end:.0f} s backup differs from vehicle_attitude by 70 deg in heading" in rest


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
