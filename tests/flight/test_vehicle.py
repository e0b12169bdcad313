"""One list says what a vehicle is and what it can do; MAVLink's own names are the truth."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega
from scipy.spatial.transform import Rotation

from attlog.flight import calibration, vehicle
from attlog.flight.vehicle import NAME_OF_TYPE, VehicleKind, vehicle_kind, vehicle_name

ENUM = {number: entry.name for number, entry in mavutil.mavlink.enums["MAV_TYPE"].items()}
WORDS = (
    ("VTOL", VehicleKind.VTOL),
    ("TRICOPTER", VehicleKind.MULTIROTOR),
    ("ROTOR", VehicleKind.MULTIROTOR),
    ("FIXED_WING", VehicleKind.PLANE),
    ("HELICOPTER", VehicleKind.HELICOPTER),
    ("COAXIAL", VehicleKind.HELICOPTER),
    ("AIRSHIP", VehicleKind.AIRSHIP),
    ("BALLOON", VehicleKind.BALLOON),
    ("ROVER", VehicleKind.ROVER),
    ("BOAT", VehicleKind.BOAT),
    ("SUBMARINE", VehicleKind.SUB),
    ("TRACKER", VehicleKind.TRACKER),
    ("PARAFOIL", VehicleKind.PARAFOIL),
    ("ROCKET", VehicleKind.ROCKET),
    ("FLAPPING", VehicleKind.ORNITHOPTER),
)


@pytest.mark.parametrize("number", ENUM, ids=ENUM.get)
def test_every_type_of_mavlink_is_the_kind_that_its_name_says(number: int) -> None:
    expected = next((kind for word, kind in WORDS if word in ENUM[number]), None)
    if expected is not None:
        assert vehicle_kind(vehicle_name(number)) is expected
    elif number not in NAME_OF_TYPE:
        assert vehicle_kind(vehicle_name(number)) is VehicleKind.OTHER


@pytest.mark.parametrize("name", ["rover", "boat", "submarine", "antenna tracker", "tracker"])
def test_what_stays_on_the_ground_neither_flies_nor_hovers(name: str) -> None:
    assert not vehicle_kind(name).flies
    assert not vehicle_kind(name).hovers


def test_wings_decide_on_hover_course_and_lying_inverted() -> None:
    plane, vtol, quad = (vehicle_kind(n) for n in ("fixed wing", "VTOL", "quadrotor"))
    assert (plane.hovers, vtol.hovers, quad.hovers) == (False, True, True)
    assert (plane.fixed_wing, vtol.fixed_wing, quad.fixed_wing) == (True, False, False)
    assert (plane.winged, vtol.winged, quad.winged) == (True, True, False)


# Numbers of flight modes and of mountings mean what MAVLink's own lists say.

OTHERWISE = {"FLY_BY_WIRE_A": "FBWA", "FLY_BY_WIRE_B": "FBWB", "INITIALIZING": "INITIALISING"} | {
    "MOTORDETECT": "MOTOR_DETECT"
}
LATER = {41: "ROLL_270_YAW_180", 42: "ROLL_270_YAW_270", 43: "PITCH_90_YAW_180", 44: "PITCH_9_YAW_180"} | {
    45: "PITCH_45",
    46: "ROLL_270_YAW_225",
    47: "ROLL_270_YAW_315",
}
"""Of PX4's rotation.h; MAVLink's list ends at 40."""


@pytest.mark.parametrize("family", ["copter", "plane", "rover", "sub"])
def test_an_ardupilot_mode_has_the_name_of_mavlinks_list(family: str) -> None:
    prefix = f"{family.upper()}_MODE_"
    listed = {n: e.name.removeprefix(prefix) for n, e in ardupilotmega.enums[f"{family.upper()}_MODE"].items()}
    named = {n: name for n, name in listed.items() if name != "ENUM_END"}
    assert {n: vehicle.ardupilot_mode(family, n) for n in named} == {n: OTHERWISE.get(x, x) for n, x in named.items()}
    older = {"copter": {8: "POSITION", 10: "OF_LOITER"}, "rover": {2: "LEARNING"}}.get(family, {})
    assert {n: vehicle.ardupilot_mode(family, n) for n in older} == older
    assert set(vehicle.ARDUPILOT_MODES[family]) == set(named) | set(older)
    assert vehicle.ardupilot_mode(family, 99) == "mode 99"


def test_a_nav_state_has_the_name_of_px4s_list() -> None:
    first = "Manual,Altitude,Position,Mission,Hold,Return,Position Slow,Recovery,Altitude Cruise,Land without GNSS,Acro"
    later = "Descend,Termination,Offboard,Stabilized,Rattitude,Takeoff,Land,Follow Me,Precision Land,Orbit,VTOL Takeoff"
    names = [*first.split(","), "mode 11", *later.split(","), *(f"External {k}" for k in range(1, 9)), "mode 31"]
    assert [vehicle.px4_mode(k) for k in range(32)] == names


def test_a_custom_mode_holds_main_mode_and_sub_mode_in_its_upper_bytes() -> None:
    main = ["Manual", "Altitude", "Position", "Auto", "Acro", "Offboard", "Stabilized", "Rattitude"]
    assert [vehicle.px4_custom_mode(k << 16 | 0xABCD) for k in range(1, 9)] == main
    auto = ["Ready", "Takeoff", "Hold", "Mission", "Return", "Land", "Auto", "Follow Me", "Precision Land", "Auto"]
    assert [vehicle.px4_custom_mode(k << 24 | 4 << 16) for k in range(1, 11)] == auto
    assert vehicle.px4_custom_mode(3 << 24 | 2 << 16) == "Altitude"
    assert vehicle.px4_custom_mode(9 << 16) == "mode 589824"


def test_rates_and_servos_command_no_attitude_and_a_hold_in_the_air_does() -> None:
    assert [vehicle.commands_attitude(m) for m in ("Acro", "ACRO", "Manual", "HOLD", "Ready")] == [False] * 5
    assert [vehicle.commands_attitude(m) for m in ("Hold", "STABILIZE", "mode 99")] == [True] * 3


def test_a_mounting_turns_by_the_angles_in_its_name() -> None:
    listed = {n: e.name.removeprefix("MAV_SENSOR_ROTATION_") for n, e in _rotations().items() if n < 41} | LATER
    assert list(listed) == list(range(48))
    for n, name in listed.items():
        angles = {axis: float(size) for axis, size in re.findall(r"(ROLL|PITCH|YAW)_(\d+)", name)}
        want = Rotation.from_euler("ZYX", [angles.get(a, 0.0) for a in ("YAW", "PITCH", "ROLL")], degrees=True)
        np.testing.assert_allclose(calibration.mounting_matrix(n), want.as_matrix(), atol=1e-12, err_msg=name)


def _rotations() -> dict[int, ardupilotmega.EnumEntry]:
    found: dict[int, ardupilotmega.EnumEntry] = ardupilotmega.enums["MAV_SENSOR_ORIENTATION"]
    return found


def test_a_number_that_is_none_of_the_mountings_turns_nothing() -> None:
    assert [calibration.mounting_matrix(n) for n in (None, -1.0, 48.0, 100.0)] == [None] * 4
    assert calibration.mounting_matrix(47.9) is not None
