"""What signs about the onboard attitude stand for, once their common cause is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from attlog.health.findings import attitude, sensors
from attlog.health.findings.finding import Finding
from attlog.health.sensors.accelerometer import MEAN_GRAVITY

LOG: Any = SimpleNamespace(remedies={"accelerometer": "Calibrate the level."}, simulated=False)


def of(*signs: Finding, log: Any = LOG) -> list[Finding]:
    return attitude.settled(signs, log)


def sign(kind: str, severity: Any = "warning", about: str = "", **more: Any) -> Finding:
    return Finding(kind, severity, "said", about=about, cause="its own", action="do", **more)


@pytest.mark.parametrize(("deg", "severity"), [(9.9, "note"), (10.1, "warning"), (None, "warning")])
def test_a_small_jump_is_a_note(deg: float | None, severity: str) -> None:
    (found,) = of(sign(attitude.RESET, value=deg))
    assert found.severity == severity
    assert of(sign(attitude.KIND, value=deg))[0].severity == "warning"


@pytest.mark.parametrize(
    ("about", "severity", "kind"),
    [
        ("gravity direction", "warning", "accelerometer"),
        ("gravity direction", "serious", attitude.MOUNTING),
        ("gyro against attitude", "warning", attitude.MOUNTING),
        (MEAN_GRAVITY, "warning", attitude.MOUNTING),
    ],
)
def test_a_small_angle_to_gravity_is_the_accelerometers_and_a_large_one_the_mountings(
    about: str, severity: str, kind: str
) -> None:
    (found,) = of(sign(attitude.MOUNTING, severity, about))
    assert found.kind == kind
    if kind == "accelerometer":
        assert (found.cause, found.action) == (attitude.LEVEL, "Calibrate the level.")


@pytest.mark.parametrize("gyro", ["gyro", "gyro_bias", "frozen_gyro"])
def test_a_broken_gyro_explains_a_wrong_attitude_and_mounting(gyro: str) -> None:
    wrong, turned, other = sign(attitude.KIND), sign(attitude.MOUNTING), sign("battery")
    assert [f.kind for f in of(wrong, turned, other, sign(gyro, "serious"))] == [gyro, gyro, "battery", gyro]
    assert [f.kind for f in of(wrong, turned, sign(gyro))] == [attitude.KIND, attitude.MOUNTING, gyro]


def test_a_wrong_attitude_explains_what_gravity_contradicts_but_no_vibration() -> None:
    wrong = sign(attitude.KIND, "serious")
    gravity = sign(attitude.MOUNTING, "serious", "gravity in flight")
    shaken = sign("vibration", "warning", "gravity in flight")
    trimmed = sign("trim", "note", "trim")
    kinds = [f.kind for f in of(wrong, gravity, shaken, trimmed)]
    assert kinds == [attitude.KIND, attitude.KIND, "vibration", "trim"]
    assert of(sign(attitude.KIND), gravity)[1].kind == attitude.MOUNTING


def test_axes_of_the_force_that_are_wrong_leave_out_what_the_force_says_of_the_attitude() -> None:
    frame = sign(attitude.FRAME.replace(" ", "_"))
    kept = of(frame, sign(attitude.MOUNTING, "serious", "gravity in flight"), sign("trim", "note", "trim"), sign("gps"))
    assert [f.kind for f in kept] == [frame.kind, "gps"]


def test_a_simulator_whose_frames_differ_has_no_mounting() -> None:
    simulated: Any = SimpleNamespace(remedies={}, simulated=True)
    (found,) = of(sign(attitude.MOUNTING, "serious"), log=simulated)
    assert (found.kind, found.cause, found.action) == (attitude.SIMULATOR, attitude.FRAMES, "")
    assert of(sign(attitude.MOUNTING, "note"), log=simulated)[0].kind == attitude.MOUNTING


def test_a_mean_force_of_a_flight_is_no_level_calibration_and_vibration_explains_it() -> None:
    """Of a flight whose accelerometer was rectified by 10 m/s^2 a level calibration was asked for."""
    mean = sign(attitude.MOUNTING, "warning", MEAN_GRAVITY)
    shaken = sign("vibration", "warning", "clipping", t=3.0)
    assert {f.kind for f in sensors.settled(of(mean, shaken))} == {"vibration"}
    assert [f.kind for f in of(mean, sign(attitude.KIND, "serious"))] == [attitude.KIND, attitude.KIND]
