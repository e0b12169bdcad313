"""Advice on ArduPilot's logging: bits of the official parameter documentation, never what is set or does not exist.

Bits: ``@Bitmask`` of LOG_BITMASK in ArduCopter, ArduPlane, Rover, ArduSub, Blimp and AntennaTracker
``Parameters.cpp``, which ardupilot.org shows as "Complete Parameter List" of each vehicle.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from attlog import flight
from attlog.flight.advice import LoggingNeed, VehicleSettings, logging_advice, remedy
from attlog.flight.calibration import compass_switches
from tests.golden import check_golden

COPTER = (
    "0:Fast Attitude,1:Medium Attitude,2:GPS,3:System Performance,4:Control Tuning,5:Navigation Tuning,6:RC input,"
    "7:IMU,8:Mission Commands,9:Battery Monitor,10:RC output,11:Optical Flow,12:PID,13:Compass,15:Camera,17:Motors,"
    "18:Fast IMU,19:Raw IMU,20:Video Stabilization,21:Fast harmonic notch logging"
)
PLANE = (
    "0:Fast Attitude,1:Medium Attitude,2:GPS,3:Performance,4:Control Tuning,5:Navigation Tuning,7:IMU,"
    "8:Mission Commands,9:Battery Monitor,10:Compass,11:TECS,12:Camera,"
    "13:RC Input-Output,14:Rangefinder,19:Raw IMU,20:Fullrate Attitude"
)
ROVER = (
    "0:Fast Attitude,1:Medium Attitude,2:GPS,3:System Performance,4:Throttle,5:Navigation Tuning,7:IMU,"
    "8:Mission Commands,9:Battery Monitor,10:Rangefinder,11:Compass,12:Camera,13:Steering,14:RC Input-Output,19:Raw IMU"
)
SUB = (
    "0:Fast Attitude,1:Medium Attitude,2:GPS,3:PM,4:Control Tuning,5:NTUN,6:RCIN,7:IMU,8:CMD,9:CURRENT,10:RCOUT,"
    "11:OPTFLOW,12:PID,13:Compass,15:CAMERA,17:MOTBATT,18:Fast IMU,19:Raw IMU"
)
BLIMP = (
    "0:Fast Attitude,1:Medium Attitude,2:GPS,3:System Performance,4:Control Tuning,6:RC Input,7:IMU,9:Battery Monitor,"
    "10:RC Output,12:PID,13:Compass"
)
TRACKER = "0:Attitude,1:GPS,2:RCIN,3:IMU,4:RCOUT,5:Compass,6:Battery"
DOCUMENTED = {"copter": COPTER, "plane": PLANE, "rover": ROVER, "sub": SUB, "blimp": BLIMP, "tracker": TRACKER}


def bits(family: str) -> dict[str, int]:
    return {name.lower(): int(bit) for bit, name in (item.split(":") for item in DOCUMENTED[family].split(","))}


def ardupilot(family: str, version: str, values: dict[str, float], what: LoggingNeed, rate: float | None = None) -> str:
    return logging_advice(VehicleSettings("ArduPilot", version, family, values), what, rate)


def modern(family: str, mask: int, what: LoggingNeed, rate: float | None = None, **values: float) -> str:
    """Return the advice to a vehicle of today."""
    return ardupilot(family, "4.5.0", {"LOG_BITMASK": mask, "LOG_DISARMED": 0, **values}, what, rate)


def px4(version: str, values: dict[str, float], what: LoggingNeed, rate: float | None = None) -> str:
    return logging_advice(VehicleSettings("PX4", version, values=values), what, rate)


def named(sentence: str) -> dict[str, int]:
    """The bits that a sentence names, by their name in brackets."""
    return {name.lower(): int(bit) for bit, name in re.findall(r"bit (\d+)(?: of LOG_BITMASK)? \(([^)]+)\)", sentence)}


@pytest.mark.parametrize("family", DOCUMENTED)
@pytest.mark.parametrize(
    ("what", "rate"),
    [("imu", None), ("imu", 8.0), ("fast_imu", 25.0), ("attitude", 10.0), ("attitude", None), ("mag", None)],
)
def test_every_bit_is_the_documented_one(family: str, what: LoggingNeed, rate: float | None) -> None:
    said = named(modern(family, 0, what, rate))
    documented = bits(family)
    if "attitude" in documented:
        documented |= {"fast attitude": -1}
    assert {name: documented[name] for name in said} == said
    if what in ("attitude", "mag") or rate is None:
        assert said, "a bit that is not set is named"


@pytest.mark.parametrize("family", DOCUMENTED)
@pytest.mark.parametrize("what", ["imu", "fast_imu", "attitude", "mag"])
@pytest.mark.parametrize("rate", [None, 12.0])
def test_what_is_set_is_never_advised(family: str, what: LoggingNeed, rate: float | None) -> None:
    full = modern(family, (1 << 22) - 1, what, rate)
    assert "set already" in full
    assert not full.startswith("Set ")


# Advice of a version, on limits of the rate, and on PX4's logging (src/modules/logger/params.c, logged_topics.cpp).

ALL_BITS = (1 << 22) - 1
LIMITS = {"LOG_FILE_RATEMAX": 10, "LOG_DARM_RATEMAX": 5, "LOG_BACKEND_TYPE": 1, "LOG_MAV_RATEMAX": 10}


def ardupilot_cases() -> Iterator[tuple[str, str]]:
    yield "fast IMU bit missing", modern("copter", ALL_BITS & ~(1 << 18), "fast_imu", 100.0)
    yield "attitude bit missing", modern("copter", ALL_BITS & ~1, "attitude", 10.0)
    yield "compass bit missing", modern("rover", ALL_BITS & ~(1 << 11), "mag")
    for rate in (5.2, 8.3, 10.0):
        yield f"limited to {rate} Hz", modern("copter", 180222, "imu", rate, **LIMITS)
    yield "25 Hz is the rate of the task, not of the limit", modern("copter", 180222, "fast_imu", 25.0, **LIMITS)
    yield "task above a limit", modern("copter", 180222, "fast_imu", 25.0, LOG_FILE_RATEMAX=40)
    for backend in (1, 4):
        said = modern("copter", 180222, "imu", 9.8, LOG_BLK_RATEMAX=10, LOG_BACKEND_TYPE=backend)
        yield f"limit of block storage, backend {backend}", said
    for disarmed in (0, 1, 2, 3):
        yield f"before arming, LOG_DISARMED {disarmed}", modern("plane", 0, "rest", LOG_DISARMED=disarmed)
    for version in ("Copter 3.1.1", "Rover 2.46beta2", "Plane 3.0.4-beta3"):
        yield (
            f"before arming, {version}",
            ardupilot(version.split()[0].lower(), version, {"LOG_BITMASK": -22530}, "rest"),
        )
    for version, mask in (("Copter 3.2.1", 43006), ("Copter 3.3-dev", 131070)):
        yield f"before arming, {version}, mask {mask}", ardupilot("copter", version, {"LOG_BITMASK": mask}, "rest")
    for what in ("imu", "fast_imu"):
        yield f"{what}, Copter 3.1.1", ardupilot("copter", "Copter 3.1.1", {"LOG_BITMASK": 0}, what)  # type: ignore[arg-type]
        said = ardupilot("copter", "Copter 3.2.1", {"LOG_BITMASK": 43006}, what, 49.0)  # type: ignore[arg-type]
        yield f"{what}, Copter 3.2.1 at 49 Hz", said
    yield "unknown vehicle", ardupilot("", "", {}, "imu")


def px4_cases() -> Iterator[tuple[str, str]]:
    for version, profile in (("1.15.0", 0), ("1.9.0", 1), ("1.15.0", 1), ("1.15.0", 16), ("1.8.0", 3)):
        for rate in (None, 9.0):
            said = px4(version, {"SDLOG_PROFILE": profile}, "imu", rate)
            yield f"IMU at {rate} Hz, {version}, profile {profile}", said
    for profile in (1, 17):
        yield f"attitude, profile {profile}", px4("1.15.0", {"SDLOG_PROFILE": profile}, "attitude", 4.0)
    yield "attitude, 1.6.5", px4("1.6.5", {"SDLOG_PROFILE": 0}, "attitude", 4.0)
    yield "attitude, no profile", px4("", {"SYS_LOGGER": 1}, "attitude", 4.0)
    for mode in (-1, 0, 1, 2, 3):
        yield f"before arming, SDLOG_MODE {mode}", px4("1.15.0", {"SDLOG_MODE": mode}, "rest")
    yield "before arming, no mode", px4("", {"SYS_LOGGER": 0, "SDLOG_RATE": -1}, "rest")
    for need in ("imu", "fast_imu", "attitude", "mag", "rest"):
        other = VehicleSettings("other", name="ULogExampleWriter")
        yield f"no autopilot, {need}", logging_advice(other, need)  # type: ignore[arg-type]


def test_a_log_that_begins_before_arming_is_told_to_stand_still_only(corpus: Path) -> None:
    log = flight.read(corpus / "logs" / "cases" / "px4_1.6.5_hand_rotation.ulg")
    assert log.advice("rest") == (
        "The log begins before arming already: let the vehicle stand still with motors off for 30 s."
    )


def test_a_unit_whose_records_are_mostly_refused_is_no_flight(corpus: Path) -> None:
    log = flight.read(corpus / "logs" / "cases" / "px4_1.17dev_hil_absurd.ulg")
    assert log.imu is None
    (problem,) = (p for p in log.problems if p.code == "imu_mostly_refused")
    assert problem.severity == "error"
    assert "74 %" in problem.text
    assert "SDLOG" not in problem.text


# Which parameters switch a compass: by the firmware's own names, where the log holds them.


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ({"COMPASS_USE": 1.0}, {}),
        ({"COMPASS_USE": 1.0, "COMPASS_PRIMARY": 0.0}, {"COMPASS_PRIMARY": 1.0}),
        ({"COMPASS_USE": 1.0, "COMPASS_USE2": 0.0}, {"COMPASS_USE2": 1.0, "COMPASS_USE": 0.0}),
        (
            {"COMPASS_USE": 1.0, "COMPASS_USE2": 0.0, "COMPASS_PRIMARY": 0.0},
            {"COMPASS_USE2": 1.0, "COMPASS_USE": 0.0, "COMPASS_PRIMARY": 1.0},
        ),
    ],
)
def test_another_compass_is_used_by_the_switches_of_the_log(values: dict[str, float], wanted: dict[str, float]) -> None:
    assert compass_switches(values, 1, 0) == wanted


# Remedies: only parameters of the log are named, those of the compass in use, and none that is set already.

SLOTS = {"CAL_MAG0_ID": 589858.0, "CAL_MAG0_ROT": -1.0, "CAL_MAG1_ID": 592905.0, "CAL_MAG1_ROT": 6.0}
ONE_SLOT = {"CAL_MAG0_ID": 5.0, "CAL_MAG0_ROT": 0.0, "CAL_MAG1_ID": 0.0, "CAL_MAG1_ROT": -1.0}
ORIENTATIONS = {"COMPASS_ORIENT": 4.0, "COMPASS_ORIENT2": 0.0}
REMEDIES: tuple[tuple[Any, str, dict[str, float], int, str | None], ...] = (
    ("PX4", "compass_mounting", SLOTS, 0, "592905"),
    ("PX4", "compass_mounting", SLOTS, 0, "589858"),
    ("PX4", "compass_mounting", SLOTS, 0, "7"),
    ("PX4", "compass_mounting", SLOTS, 0, None),
    ("PX4", "compass_mounting", SLOTS | {"CAL_MAG0_EN": 0.0, "CAL_MAG1_EN": 1.0}, 0, None),
    ("PX4", "compass_mounting", SLOTS | {"CAL_MAG0_PRIO": 0.0, "CAL_MAG1_PRIO": 75.0}, 0, None),
    ("PX4", "compass_mounting", ONE_SLOT, 0, None),
    ("ArduPilot", "compass_mounting", ORIENTATIONS, 0, None),
    ("ArduPilot", "compass_mounting", ORIENTATIONS, 1, None),
    ("ArduPilot", "compass_mounting", ORIENTATIONS, 2, None),
    ("telemetry", "compass_mounting", ORIENTATIONS, 0, None),
    ("ArduPilot", "declination", {"COMPASS_AUTODEC": 0.0}, 0, None),
    ("ArduPilot", "declination", {"COMPASS_AUTODEC": 1.0}, 0, None),
    ("ArduPilot", "gyro_bias", {"INS_GYR_CAL": 1.0}, 0, None),
    ("ArduPilot", "interference", {"COMPASS_MOTCT": 0.0}, 0, None),
    ("ArduPilot", "temperature", {"INS_TCAL1_ENABLE": 0.0}, 0, None),
    ("PX4", "temperature", {"TC_G_ENABLE": 1.0}, 0, None),
    ("PX4", "vibration", {"IMU_GYRO_DNF_EN": 0.0}, 0, None),
    ("unknown", "other", {}, 0, None),
)


def test_advice_and_remedies_are_as_reviewed() -> None:
    lines = [f"{name}: {said}" for name, said in (*ardupilot_cases(), *px4_cases())]
    for kind, fault, values, compass, device in REMEDIES:
        said = remedy(VehicleSettings(kind, values=values), fault, compass, device)
        own = " ".join(f"{name} {value:g}" for name, value in values.items())
        lines.append(f"{kind}, {fault}, compass {compass}, device {device}, {own}: {said}")
    check_golden(Path(__file__).parent / "golden" / "advice.txt", lines)


def test_gaps_of_telemetry_need_the_vehicles_own_log_and_no_faster_card() -> None:
    said = remedy(VehicleSettings("telemetry", name=".bin"), "gaps", 0, None)
    assert "instead of telemetry" in said
    assert "faster" not in said
