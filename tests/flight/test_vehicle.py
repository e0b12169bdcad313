"""One list says what a vehicle is and what it can do; MAVLink's own names are the truth."""

from __future__ import annotations

import pytest
from pymavlink import mavutil

from attlog.flight.px4 import reader
from attlog.flight.vehicle import NAME_OF_TYPE, VEHICLES, VehicleKind, family_of, kind_of, named
from tests.flight.fake import level, messages, micros

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
        assert kind_of(named(number)) is expected
    elif number not in NAME_OF_TYPE:
        assert kind_of(named(number)) is VehicleKind.OTHER


@pytest.mark.parametrize(
    "name", ["dodecarotor", "decarotor", "airship", "blimp", "parafoil", "single rotor", "unknown"]
)
def test_vehicles_whose_names_hold_car_or_ship_fly(name: str) -> None:
    assert kind_of(name).flies


@pytest.mark.parametrize("name", ["rover", "boat", "submarine", "antenna tracker", "tracker"])
def test_what_stays_on_the_ground_neither_flies_nor_hovers(name: str) -> None:
    assert not kind_of(name).flies
    assert not kind_of(name).hovers


def test_wings_decide_on_hover_course_and_lying_inverted() -> None:
    plane, vtol, quad = (kind_of(n) for n in ("fixed wing", "VTOL", "quadrotor"))
    assert (plane.hovers, vtol.hovers, quad.hovers) == (False, True, True)
    assert (plane.fixed_wing, vtol.fixed_wing, quad.fixed_wing) == (True, False, False)
    assert (plane.winged, vtol.winged, quad.winged) == (True, True, False)


def test_names_and_numbers_stand_once_in_the_list() -> None:
    names = [name for name, *_ in VEHICLES]
    numbers = [n for *_, mine in VEHICLES for n in mine]
    assert len(set(names)) == len(names)
    assert len(set(numbers)) == len(numbers)
    assert (family_of("dodecarotor"), family_of("boat"), family_of("VTOL")) == ("copter", "rover", "plane")


@pytest.mark.parametrize(
    ("vehicle_type", "kind"),
    [(1, VehicleKind.MULTIROTOR), (2, VehicleKind.PLANE), (3, VehicleKind.ROVER), (0, VehicleKind.OTHER)],
)
def test_px4_without_a_mavlink_type_tells_by_its_own(vehicle_type: int, kind: VehicleKind) -> None:
    status = {"timestamp": micros(3, 1), "vehicle_type": [vehicle_type] * 3, "arming_state": [1] * 3}
    tables = {("vehicle_attitude", 0): {"timestamp": micros(50, 50), "q": level(50)}, ("vehicle_status", 0): status}
    assert reader.read(messages("ulog", tables)).kind is kind
