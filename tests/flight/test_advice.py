"""Advice on ArduPilot's logging: bits of the official parameter documentation, never what is set or does not exist.

Bits: ``@Bitmask`` of LOG_BITMASK in ArduCopter, ArduPlane, Rover, ArduSub, Blimp and AntennaTracker
``Parameters.cpp``, which ardupilot.org shows as "Complete Parameter List" of each vehicle.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from attlog import flight
from attlog.flight.advice import GENERAL_REMEDIES, LoggingNeed, VehicleSettings, logging_advice, remedy
from attlog.flight.calibration import compass_switches

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


def test_one_missing_bit_is_what_is_advised() -> None:
    everything = (1 << 22) - 1
    fast = modern("copter", everything & ~(1 << 18), "fast_imu", 100.0)
    assert fast == "Set bit 18 (fast IMU) of LOG_BITMASK."
    assert modern("copter", everything & ~1, "attitude", 10.0) == "Set bit 0 of LOG_BITMASK (fast attitude)."
    assert modern("rover", everything & ~(1 << 11), "mag") == "Set bit 11 of LOG_BITMASK (compass)."


def test_limits_of_the_rate_are_named_where_they_are_the_reason() -> None:
    limits = {"LOG_FILE_RATEMAX": 10, "LOG_DARM_RATEMAX": 5, "LOG_BACKEND_TYPE": 1, "LOG_MAV_RATEMAX": 10}
    for rate in (5.2, 8.3, 10.0):
        assert modern("copter", 180222, "imu", rate, **limits) == (
            "LOG_FILE_RATEMAX 10 Hz and LOG_DARM_RATEMAX 5 Hz (while disarmed) limit the rate: set them to 0."
        )
    faster = modern("copter", 180222, "fast_imu", 25.0, **limits)
    assert faster == "Set bit 18 (fast IMU) or bit 19 (raw IMU) of LOG_BITMASK."
    other_backend = modern("copter", 180222, "imu", 10.0, LOG_BLK_RATEMAX=10, LOG_BACKEND_TYPE=1)
    assert "RATEMAX" not in other_backend
    block = modern("copter", 180222, "imu", 9.8, LOG_BLK_RATEMAX=10, LOG_BACKEND_TYPE=4)
    assert block == "LOG_BLK_RATEMAX 10 Hz limits the rate: set it to 0."
    above_source = modern("copter", 180222, "fast_imu", 25.0, LOG_FILE_RATEMAX=40)
    assert "RATEMAX" not in above_source, "25 Hz is the rate of the task, not of the limit"


@pytest.mark.parametrize("disarmed", [1, 2, 3])
def test_logging_before_arming_that_is_on_is_not_advised(disarmed: int) -> None:
    assert modern("copter", 0, "rest", LOG_DISARMED=disarmed).startswith(f"LOG_DISARMED is {disarmed} already")


def test_logging_before_arming_is_set_as_this_version_can() -> None:
    assert modern("plane", 0, "rest").startswith("Set LOG_DISARMED to 1 and let")
    for version in ("Copter 3.1.1", "Copter 3.0.1", "Rover 2.46beta2", "Plane 3.0.4-beta3"):
        family = version.split()[0].lower()
        old = ardupilot(family, version, {"LOG_BITMASK": -22530}, "rest")
        assert "LOG_" not in old, f"{version} has no setting for it"
    off = ardupilot("copter", "Copter 3.2.1", {"LOG_BITMASK": 43006}, "rest")
    assert off.startswith("Set bit 16 of LOG_BITMASK")
    on = ardupilot("copter", "Copter 3.3-dev", {"LOG_BITMASK": 131070}, "rest")
    assert on.startswith("Bit 16 of LOG_BITMASK (log when disarmed) is set already")


@pytest.mark.parametrize("what", ["imu", "fast_imu"])
def test_bits_that_came_later_are_not_advised_to_old_versions(what: LoggingNeed) -> None:
    old = ardupilot("copter", "Copter 3.1.1", {"LOG_BITMASK": 0}, what)
    assert named(old) == {"imu": 7}
    assert "3.4 and later" in ardupilot("copter", "Copter 3.2.1", {"LOG_BITMASK": 43006}, what, 49.0)


def test_an_unknown_vehicle_gets_no_number() -> None:
    assert re.search(r"\d", ardupilot("", "", {}, "imu")) is None


# Advice on PX4's logging: src/modules/logger/params.c and logged_topics.cpp.


@pytest.mark.parametrize(
    ("version", "profile", "said"),
    [
        ("1.15.0", 0, "Set bit 0 of SDLOG_PROFILE (default set), which logs sensor_combined at full rate."),
        ("1.9.0", 1, "Set bit 1 of SDLOG_PROFILE (estimator replay), which logs sensor_combined at full rate."),
        ("1.15.0", 1, "Bit 0 of SDLOG_PROFILE (default set) is set already"),
        ("1.15.0", 16, "Bit 4 of SDLOG_PROFILE (high rate) is set already"),
        ("1.8.0", 3, "Bit 1 of SDLOG_PROFILE (estimator replay) is set already"),
    ],
)
def test_a_topic_set_that_is_on_is_not_advised(version: str, profile: int, said: str) -> None:
    for rate in (None, 9.0):
        assert px4(version, {"SDLOG_PROFILE": profile}, "imu", rate).startswith(said)


def test_the_attitude_at_full_rate_is_bit_4() -> None:
    assert "Set bit 4 of SDLOG_PROFILE" in px4("1.15.0", {"SDLOG_PROFILE": 1}, "attitude", 4.0)
    assert "set already" in px4("1.15.0", {"SDLOG_PROFILE": 17}, "attitude", 4.0)


@pytest.mark.parametrize(("version", "values"), [("1.6.5", {"SDLOG_PROFILE": 0}), ("", {"SYS_LOGGER": 1})])
def test_versions_without_topic_sets_have_a_file(version: str, values: dict[str, float]) -> None:
    said = px4(version, values, "attitude", 4.0)
    assert "vehicle_attitude" in said
    assert "logger_topics.txt" in said
    assert "SDLOG_PROFILE" not in said


@pytest.mark.parametrize(("mode", "advised"), [(0, True), (1, False), (2, False), (-1, True), (3, True)])
def test_logging_from_boot_is_advised_only_where_it_is_off(mode: int, advised: bool) -> None:
    said = px4("1.15.0", {"SDLOG_MODE": mode}, "rest")
    assert said.startswith("Set SDLOG_MODE to 1 and let" if advised else f"SDLOG_MODE is {mode} already: let")


def test_versions_without_the_mode_are_not_told_to_set_it() -> None:
    assert "SDLOG_MODE" not in px4("", {"SYS_LOGGER": 0, "SDLOG_RATE": -1}, "rest")


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


def test_a_program_that_is_no_autopilot_is_told_by_its_name_without_settings() -> None:
    settings = VehicleSettings("other", name="ULogExampleWriter")
    assert logging_advice(settings, "imu").startswith("ULogExampleWriter wrote it")
    needs: tuple[LoggingNeed, ...] = ("fast_imu", "attitude", "mag", "rest")
    assert [logging_advice(settings, what) for what in needs] == [""] * 4


# Which parameters switch a compass: by the firmware's own names, where the log holds them.


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ({"COMPASS_USE": 1.0}, {}),
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


@pytest.mark.parametrize(
    ("kind", "fault", "values", "compass", "device", "named"),
    [
        ("PX4", "compass_mounting", SLOTS, 0, "592905", "CAL_MAG1_ROT 6,"),
        ("PX4", "compass_mounting", SLOTS, 0, "589858", "CAL_MAG0_ROT -1,"),
        ("PX4", "compass_mounting", SLOTS, 0, "7", ""),
        ("PX4", "compass_mounting", SLOTS, 0, None, ""),
        ("PX4", "compass_mounting", SLOTS | {"CAL_MAG0_EN": 0.0, "CAL_MAG1_EN": 1.0}, 0, None, "CAL_MAG1_ROT 6,"),
        ("PX4", "compass_mounting", SLOTS | {"CAL_MAG0_PRIO": 0.0, "CAL_MAG1_PRIO": 75.0}, 0, None, "CAL_MAG1_ROT 6,"),
        ("PX4", "compass_mounting", ONE_SLOT, 0, None, "CAL_MAG0_ROT 0,"),
        ("ArduPilot", "compass_mounting", ORIENTATIONS, 0, None, "COMPASS_ORIENT 4,"),
        ("ArduPilot", "compass_mounting", ORIENTATIONS, 1, None, "COMPASS_ORIENT2 0,"),
        ("ArduPilot", "compass_mounting", ORIENTATIONS, 2, None, ""),
        ("telemetry", "compass_mounting", ORIENTATIONS, 0, None, ""),
        ("ArduPilot", "declination", {"COMPASS_AUTODEC": 0.0}, 0, None, "Set COMPASS_AUTODEC to 1."),
        ("ArduPilot", "declination", {"COMPASS_AUTODEC": 1.0}, 0, None, ""),
        ("ArduPilot", "gyro_bias", {"INS_GYR_CAL": 1.0}, 0, None, ""),
        (
            "ArduPilot",
            "interference",
            {"COMPASS_MOTCT": 0.0},
            0,
            None,
            "power wires. Then run compassmot (COMPASS_MOTCT",
        ),
        ("ArduPilot", "temperature", {"INS_TCAL1_ENABLE": 0.0}, 0, None, "INS_TCAL1_ENABLE is 0"),
        ("PX4", "temperature", {"TC_G_ENABLE": 1.0}, 0, None, "TC_G_ENABLE is 1"),
        ("PX4", "vibration", {"IMU_GYRO_DNF_EN": 0.0}, 0, None, ""),
    ],
)
def test_a_remedy_names_the_parameter_that_helps(
    kind: Any, fault: str, values: dict[str, float], compass: int, device: str | None, named: str
) -> None:
    said = remedy(VehicleSettings(kind, values=values), fault, compass, device)
    assert named in said
    general = "" if fault == "declination" and values == {"COMPASS_AUTODEC": 1.0} else GENERAL_REMEDIES[fault]
    assert named or said == general


def test_an_unknown_fault_has_no_remedy() -> None:
    assert remedy(VehicleSettings(), "other", 0, None) == ""
