"""A sensor that fails in a way that only physics shows: what then judges the others is right."""

from __future__ import annotations

import contextlib
import functools
from pathlib import Path

import numpy as np
import pytest

from attlog import analysis, flight, formats
from attlog.base import rotation
from attlog.base.errors import LogUnusable
from attlog.flight.model import Attitude
from attlog.formats.base import Messages
from attlog.health import answerable, audit
from attlog.metrics.base import Case
from attlog.reference import smoothed
from tests.conftest import SAMPLES, few
from tests.fuzz.sensors import AXES, FAULTS, any_fault, faulty, without_truth

PX4, COPTER, TELEMETRY = "px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"
LOGS = (PX4, COPTER, TELEMETRY)
TILT_DEG, SIGMAS = 3.0, 4.0
"""So far a reference may be from truth (RMS), or so many of its own sigmas."""
CHEAP = (
    (PX4, "gyro", "radians"),
    (PX4, "gyro", "one axis reversed"),
    (PX4, "gyro", "stopped"),
    (COPTER, "gyro", "half as much again"),
    (COPTER, "gyro", "late"),
    (COPTER, "attitude", "swapped"),
    (TELEMETRY, "gyro", "swapped"),
    (PX4, "attitude", "backwards"),
    (PX4, "accelerometer", "in g"),
    (COPTER, "accelerometer", "zero"),
)
TOLD = (
    (PX4, "compass", "reversed", "compass axes", "all its axes have the other sign"),
    (TELEMETRY, "compass", "one axis reversed", "compass axes", "it does with x = -x"),
    (COPTER, "compass", "swapped", "compass axes", "it does with x = y, y = x"),
    (COPTER, "gyro", "spiked", "gyro spikes", "jumps 9 times for a single sample"),
    (PX4, "accelerometer", "reversed", "accelerometer axes", "the accelerometer's axes are wrong"),
    (COPTER, "accelerometer", "late", "accelerometer delay", "taken 4.5 s later"),
)
"""What the audit says of faults that misled the smoother, or that nobody told of."""
EVERY = [(log, sensor, fault) for log in LOGS for sensor in AXES for fault in FAULTS]


@functools.cache
def opened(name: str) -> Messages:
    return formats.open(SAMPLES / name)


@functools.cache
def truth(name: str) -> tuple[float, Attitude]:
    log = flight.flight_in(opened(name))
    assert log.truth is not None
    return log.t0_us * 1e-6, log.truth


def prepared(messages: Messages) -> Case:
    return analysis.prepare(flight.flight_in(without_truth(messages)), {"estimators": ["gyro"]})


def off_deg(case: Case, name: str) -> float:
    """How far (deg RMS) down by the reference is from down by the truth."""
    reference, (begin, true) = case.reference, truth(name)
    t = reference.t + case.log.t0_us * 1e-6 - begin
    used = (t > true.t[0]) & (t < true.t[-1]) & (reference.t >= reference.scoring_start)
    nearest = np.clip(np.searchsorted(true.t, t[used]), 0, len(true.t) - 1)
    tilt = rotation.inclination_angle(rotation.error(reference.q[used], true.q[nearest]))
    return float(np.degrees(np.sqrt(np.mean(tilt**2)))) if used.any() else 0.0


def honest(name: str, sensor: str, fault: str) -> None:
    case = prepared(faulty(opened(name), sensor, fault))
    if case.reference.kind == "onboard" and sensor == "attitude":
        return  # nothing else was there to judge by; agreement with it is called agreement
    off, own = off_deg(case, name), smoothed.sigma_deg(case.reference, "inclination")
    assert case.reference.kind == "none" or off <= max(TILT_DEG, SIGMAS * own)


@pytest.mark.parametrize(("name", "sensor", "fault"), few(CHEAP, 4))
def test_what_judges_after_a_fault_of_a_sensor_is_right(name: str, sensor: str, fault: str) -> None:
    honest(name, sensor, fault)


@pytest.mark.parametrize(("name", "sensor", "fault", "check", "said"), TOLD)
def test_a_fault_that_would_mislead_a_smoother_is_told_and_none_is_made(
    name: str, sensor: str, fault: str, check: str, said: str
) -> None:
    case = prepared(faulty(opened(name), sensor, fault))
    told = {c.name: c for c in audit(case.log, case.segments, case.reference)}
    assert told[check].verdict == "fault"
    assert said in told[check].text
    assert case.reference.kind == "onboard"
    assert said in case.reference.refused["smoother"]
    assert off_deg(case, name) < TILT_DEG


def test_what_is_left_to_say_with_an_accelerometer_in_wrong_axes() -> None:
    """The field tells that it is not the attitude that flew: filters are compared with that, and all is led by it."""
    log = flight.flight_in(without_truth(faulty(opened(PX4), "accelerometer", "reversed")))
    result = analysis.analyze(log, {"estimators": ["mahony", "eskf"]})
    assert result.reference is not None
    assert result.reference.choice == "onboard"
    assert all("the accelerometer is wrong" in verdict.sentence for verdict in result.verdicts)
    codes = {problem.kind for problem in result.findings}
    assert "accelerometer_axes" in codes
    assert not codes & {"attitude", "mounting"}, "the attitude is right"


def test_sound_sensors_are_not_accused() -> None:
    for name in LOGS:
        assert prepared(opened(name)).reference.sensor_faults == {}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "sensor", "fault"), EVERY)
def test_what_judges_after_any_fault_of_a_sensor_is_right(name: str, sensor: str, fault: str) -> None:
    with contextlib.suppress(LogUnusable):  # refused is honest
        honest(name, sensor, fault)


@pytest.mark.slow
def test_what_info_foresees_of_a_gyro_that_is_wrong_is_what_analyze_does() -> None:
    case = prepared(faulty(opened(PX4), "gyro", "one axis reversed"))
    assert case.reference.kind == "onboard"
    assert "no smoother: the logged gyro" in smoothed.expected_reference(case.log, case.segments, case.reference)
    assert not any(answer.can for answer in answerable(case.log, case))
    sound = prepared(opened(PX4))
    assert any(answer.can for answer in answerable(sound.log, sound))


def test_a_fault_changes_all_axes_and_nothing_else() -> None:
    whole, broken = opened(COPTER), faulty(opened(COPTER), "gyro", "half")
    for axis in "XYZ":
        assert broken["IMU", 0][f"Gyr{axis}"] == pytest.approx(0.5 * whole["IMU", 0][f"Gyr{axis}"], rel=1e-6)
    assert (broken["IMU", 0]["AccX"] == whole["IMU", 0]["AccX"]).all()
    assert any_fault(whole, 3).tables.keys() == whole.tables.keys()
    assert faulty(opened(PX4), "gyro", "swapped").path == Path(opened(PX4).path)
