"""What kind of vehicle flew: the one list that every log format and every firmware is read with.

Sources: MAVLink common.xml (MAV_TYPE), PX4 ``msg/VehicleStatus.msg`` (vehicle_type), ArduPilot's firmware
families and FRAME_CLASS.
"""

from __future__ import annotations

from enum import Enum


class VehicleKind(Enum):
    """What a vehicle can do, whatever it is called."""

    MULTIROTOR = "multirotor"
    HELICOPTER = "helicopter"
    PLANE = "plane"
    VTOL = "vtol"
    ORNITHOPTER = "ornithopter"
    AIRSHIP = "airship"
    BALLOON = "balloon"
    PARAFOIL = "parafoil"
    ROCKET = "rocket"
    ROVER = "rover"
    BOAT = "boat"
    SUB = "sub"
    TRACKER = "tracker"
    OTHER = "other"

    @property
    def flies(self) -> bool:
        """Whether it can leave the ground; an unknown vehicle may."""
        return self not in (VehicleKind.ROVER, VehicleKind.BOAT, VehicleKind.SUB, VehicleKind.TRACKER)

    @property
    def hovers(self) -> bool:
        """Whether it can stand in the air without wind; an unknown vehicle may."""
        return self.flies and self not in (VehicleKind.PLANE, VehicleKind.PARAFOIL, VehicleKind.ROCKET)

    @property
    def fixed_wing(self) -> bool:
        """Whether it always flies where its nose points, so that its course tells its heading."""
        return self in (VehicleKind.PLANE, VehicleKind.ORNITHOPTER)

    @property
    def winged(self) -> bool:
        """Whether it may fly steeply banked or inverted: a plane, or a VTOL in forward flight."""
        return self.fixed_wing or self is VehicleKind.VTOL


VEHICLES: tuple[tuple[str, VehicleKind, str, tuple[int, ...]], ...] = (
    ("generic", VehicleKind.OTHER, "", (0,)),
    ("fixed wing", VehicleKind.PLANE, "plane", (1,)),
    ("quadrotor", VehicleKind.MULTIROTOR, "copter", (2,)),
    ("coaxial helicopter", VehicleKind.HELICOPTER, "copter", (3,)),
    ("helicopter", VehicleKind.HELICOPTER, "copter", (4,)),
    ("antenna tracker", VehicleKind.TRACKER, "tracker", (5,)),
    ("airship", VehicleKind.AIRSHIP, "blimp", (7,)),
    ("balloon", VehicleKind.BALLOON, "", (8,)),
    ("rocket", VehicleKind.ROCKET, "", (9,)),
    ("rover", VehicleKind.ROVER, "rover", (10,)),
    ("boat", VehicleKind.BOAT, "rover", (11,)),
    ("ground quadruped", VehicleKind.ROVER, "rover", (46,)),
    ("submarine", VehicleKind.SUB, "sub", (12,)),
    ("hexarotor", VehicleKind.MULTIROTOR, "copter", (13,)),
    ("octorotor", VehicleKind.MULTIROTOR, "copter", (14,)),
    ("tricopter", VehicleKind.MULTIROTOR, "copter", (15,)),
    ("flapping wing", VehicleKind.ORNITHOPTER, "", (16,)),
    ("VTOL", VehicleKind.VTOL, "plane", (19, 20, 21, 22, 23, 24, 25, 47)),
    ("parafoil", VehicleKind.PARAFOIL, "", (28,)),
    ("dodecarotor", VehicleKind.MULTIROTOR, "copter", (29,)),
    ("decarotor", VehicleKind.MULTIROTOR, "copter", (35,)),
    ("multirotor", VehicleKind.MULTIROTOR, "copter", (43,)),
    ("single rotor", VehicleKind.HELICOPTER, "copter", ()),
    ("blimp", VehicleKind.AIRSHIP, "blimp", ()),
    ("tracker", VehicleKind.TRACKER, "tracker", ()),
)
"""Name, kind, ArduPilot's firmware family (it decides what a mode number means) and MAV_TYPE numbers."""

KIND_OF = {name: kind for name, kind, _, _ in VEHICLES}
FAMILY_OF = {name: family for name, _, family, _ in VEHICLES}
NAME_OF_TYPE = {number: name for name, _, _, numbers in VEHICLES for number in numbers}
PX4_TYPES = {1: "multirotor", 2: "fixed wing", 3: "rover", 4: "airship"}
"""``vehicle_status.vehicle_type``; 0 is unknown."""


def named(mav_type: int) -> str:
    """The vehicle for a MAV_TYPE number, "unknown" where it is none."""
    return NAME_OF_TYPE.get(mav_type, "unknown")


def kind_of(name: str) -> VehicleKind:
    """The kind of a vehicle by its whole name in the list, OTHER for any other name."""
    return KIND_OF.get(name, VehicleKind.OTHER)


def family_of(name: str) -> str:
    """ArduPilot's firmware family (copter, plane, rover, sub, blimp, tracker) for a vehicle; empty if none flies it."""
    return FAMILY_OF.get(name, "")
