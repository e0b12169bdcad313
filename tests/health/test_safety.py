"""Safety functions that parameters switch off: each by itself, by vehicle and version, and what replaces them."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Firmware, TimeLine
from attlog.health import safety
from attlog.health.check import Check
from attlog.health.findings import findings, nothing_wrong
from tests.health.made_flight import case, flight

SOUND = {
    "ArduPilot": {
        **{"ARMING_CHECK": 1, "FS_THR_ENABLE": 1, "BATT_MONITOR": 4, "BATT_FS_LOW_ACT": 2, "BATT_FS_CRT_ACT": 1},
        **{"BATT_LOW_VOLT": 14.0, "BATT_CRT_VOLT": 0, "BATT_LOW_MAH": 0, "BATT_CRT_MAH": 0},
        **{"FS_EKF_THRESH": 0.8, "FS_CRASH_CHECK": 1, "FS_GCS_ENABLE": 0, "COMPASS_ENABLE": 1, "COMPASS_USE": 1},
    },
    "PX4": {"CBRK_SUPPLY_CHK": 0, "NAV_RCL_ACT": 2, "NAV_DLL_ACT": 0, "COM_LOW_BAT_ACT": 3, "BAT1_SOURCE": 0},
}


def checked(
    firmware: str,
    vehicle: str = "quadrotor",
    version: str = "4.5",
    mode: str = "",
    simulated: bool = False,
    **params: float,
) -> list[Check]:
    """The check of a vehicle with sound settings but for ``params``."""
    log = flight(firmware=firmware, params=SOUND[firmware] | params)
    log.vehicle, log.simulated, log.firmware = vehicle, simulated, Firmware(firmware, version)
    log.state.mode = TimeLine(np.array([0.0]), [mode], "MODE") if mode else None
    return safety.safety_checks(case(log))


@pytest.mark.parametrize(
    ("firmware", "params", "function"),
    [
        ("ArduPilot", {"ARMING_CHECK": 0}, "arming checks"),
        ("ArduPilot", {"ARMING_SKIPCHK": -1}, "arming checks"),
        ("ArduPilot", {"FS_THR_ENABLE": 0}, "radio failsafe"),
        ("ArduPilot", {"BATT_MONITOR": 0}, "battery monitor"),
        ("ArduPilot", {"FS_EKF_THRESH": 0}, "EKF failsafe"),
        ("ArduPilot", {"FS_CRASH_CHECK": 0}, "crash check"),
        ("PX4", {"CBRK_SUPPLY_CHK": 894281}, "supply check"),
        ("PX4", {"CBRK_VELPOSERR": 201607}, "position check"),
        ("PX4", {"NAV_RCL_ACT": 0}, "radio failsafe"),
        ("PX4", {"BAT1_SOURCE": -1}, "battery monitor"),
    ],
)
def test_each_function_switched_off_is_named_alone_and_as_a_note(firmware: str, params: dict, function: str) -> None:
    (sound,) = checked(firmware)
    assert sound.verdict == "ok"
    (check,) = checked(firmware, **params)
    assert (check.verdict, check.text) == ("warning", f"Switched off: {function}.")
    assert all(name in check.action or name.startswith(("ARMING", "BATT")) for name in params)
    log = flight(firmware=firmware)
    found = [one for one in findings(log, [check]) if one.kind == "unsafe_settings"]
    assert [one.severity for one in found] == ["note"]
    assert nothing_wrong(found)


@pytest.mark.parametrize(
    ("firmware", "params"),
    [
        ("ArduPilot", {"BATT_FS_LOW_ACT": 0, "BATT_FS_CRT_ACT": 0}),
        ("ArduPilot", {"BATT_LOW_VOLT": 0}),
        ("PX4", {"COM_LOW_BAT_ACT": 0}),
    ],
)
def test_the_battery_failsafe_is_off_in_every_new_autopilot_and_no_warning_alone(firmware: str, params: dict) -> None:
    (check,) = checked(firmware, **params)
    assert check.verdict == "ok"
    assert "battery failsafe" not in check.text
    assert "Battery failsafe off" in check.evidence[0]
    other = {"FS_CRASH_CHECK": 0} if firmware == "ArduPilot" else {"CBRK_SUPPLY_CHK": 894281}
    (check,) = checked(firmware, **params, **other)
    assert "battery failsafe" in check.text


@pytest.mark.parametrize(
    "sound",
    [
        {"BATT_MONITOR": 0, "BATT2_MONITOR": 4},
        {"FS_THR_ENABLE": 0, "FS_GCS_ENABLE": 1},
        {"ARMING_CHECK": 64},
        {"ARMING_SKIPCHK": 4},
    ],
)
def test_what_replaces_a_function_or_leaves_part_of_it_is_no_warning(sound: dict) -> None:
    (check,) = checked("ArduPilot", **sound)
    assert check.verdict == "ok"


def test_a_ground_station_guards_every_mode_only_from_copter_4_on() -> None:
    (check,) = checked("ArduPilot", version="Copter 3.6.7", FS_THR_ENABLE=0, FS_GCS_ENABLE=1)
    assert "radio failsafe" in check.text


@pytest.mark.parametrize(("vehicle", "off"), [("fixed wing", "THR_FAILSAFE"), ("rover", "FS_ACTION")])
def test_parameters_of_another_vehicle_are_not_read(vehicle: str, off: str) -> None:
    (check,) = checked("ArduPilot", vehicle=vehicle, FS_CRASH_CHECK=0)
    assert check.verdict == "ok"
    (check,) = checked("ArduPilot", vehicle=vehicle, **{off: 0})
    assert check.text == "Switched off: radio failsafe."


NO_COMPASS = [
    ("ArduPilot", "LOITER", {"COMPASS_USE": 0}, True),
    ("ArduPilot", "LOITER", {"COMPASS_ENABLE": 0}, True),
    ("ArduPilot", "LOITER", {"COMPASS_USE": 0, "COMPASS_USE2": 1}, False),
    ("ArduPilot", "ALT_HOLD", {"COMPASS_USE": 0}, False),
    ("ArduPilot", "LOITER", {"COMPASS_USE": 0, "EK3_SRC1_YAW": 2}, False),
    ("ArduPilot", "LOITER", {"COMPASS_USE": 0, "EK3_SRC1_YAW": 1}, True),
    ("ArduPilot", "LOITER", {"COMPASS_USE": 0, "EK3_MAG_CAL": 5}, False),
    ("PX4", "Position", {"SYS_HAS_MAG": 0}, True),
    ("PX4", "Mission", {"EKF2_MAG_TYPE": 5}, True),
    ("PX4", "Stabilized", {"EKF2_MAG_TYPE": 5}, False),
    ("PX4", "Mission", {"EKF2_MAG_TYPE": 5, "EKF2_GPS_CTRL": 15}, False),
    ("PX4", "Mission", {"EKF2_MAG_TYPE": 1, "EKF2_GPS_CTRL": 7}, False),
]


@pytest.mark.parametrize(("firmware", "mode", "params", "warned"), NO_COMPASS)
def test_compasses_all_off_matter_where_a_position_was_held_without_another_heading(
    firmware: str, mode: str, params: dict, warned: bool
) -> None:
    (check,) = checked(firmware, mode=mode, **params)
    assert ("every compass" in check.text) is warned
    assert (check.verdict == "warning") is warned


def test_a_plane_needs_no_compass_for_its_heading() -> None:
    (check,) = checked("ArduPilot", vehicle="fixed wing", mode="AUTO", COMPASS_USE=0)
    assert check.verdict == "ok"


def test_settings_count_as_they_were_at_the_first_arming() -> None:
    log = flight(firmware="ArduPilot", params=SOUND["ArduPilot"])
    log.parameters.lines["ARMING_CHECK"] = TimeLine(np.array([0.0, 50.0]), [1.0, 0.0], "PARM")
    (check,) = safety.safety_checks(case(log))
    assert check.verdict == "ok"


def test_without_parameters_safety_is_unknown_and_a_simulation_is_not_asked() -> None:
    (check,) = safety.safety_checks(case(flight(firmware="ArduPilot")))
    assert check.verdict == "unknown"
    assert "--params" in check.text
    (check,) = safety.safety_checks(case(flight(firmware="PX4", params={"MPC_XY_P": 1.0})))
    assert check.verdict == "unknown"
    assert checked("PX4", simulated=True, NAV_RCL_ACT=0) == []
