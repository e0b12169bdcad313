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


def vehicle_name(mav_type: int) -> str:
    """The vehicle for a MAV_TYPE number, "unknown" where it is none."""
    return NAME_OF_TYPE.get(mav_type, "unknown")


def vehicle_kind(name: str) -> VehicleKind:
    """The kind of a vehicle by its whole name in the list, OTHER for any other name."""
    return KIND_OF.get(name, VehicleKind.OTHER)


def firmware_family(name: str) -> str:
    """ArduPilot's firmware family (copter, plane, rover, sub, blimp, tracker) for a vehicle; empty if none flies it."""
    return FAMILY_OF.get(name, "")


# Names of flight modes.
#
# Sources: PX4 msg/VehicleStatus.msg, ArduPilot
# ``mode.h`` of each vehicle. Numbers that PX4 gave a second meaning are named by
# their newest one.

PX4_MODES = {
    0: "Manual",
    1: "Altitude",
    2: "Position",
    3: "Mission",
    4: "Hold",
    5: "Return",
    6: "Position Slow",
    7: "Recovery",
    8: "Altitude Cruise",
    9: "Land without GNSS",
    10: "Acro",
    12: "Descend",
    13: "Termination",
    14: "Offboard",
    15: "Stabilized",
    16: "Rattitude",
    17: "Takeoff",
    18: "Land",
    19: "Follow Me",
    20: "Precision Land",
    21: "Orbit",
    22: "VTOL Takeoff",
    23: "External 1",
    24: "External 2",
    25: "External 3",
    26: "External 4",
    27: "External 5",
    28: "External 6",
    29: "External 7",
    30: "External 8",
}

COPTER_MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    5: "LOITER",
    6: "RTL",
    7: "CIRCLE",
    8: "POSITION",
    9: "LAND",
    10: "OF_LOITER",
    11: "DRIFT",
    13: "SPORT",
    14: "FLIP",
    15: "AUTOTUNE",
    16: "POSHOLD",
    17: "BRAKE",
    18: "THROW",
    19: "AVOID_ADSB",
    20: "GUIDED_NOGPS",
    21: "SMART_RTL",
    22: "FLOWHOLD",
    23: "FOLLOW",
    24: "ZIGZAG",
    25: "SYSTEMID",
    26: "AUTOROTATE",
    27: "AUTO_RTL",
    28: "TURTLE",
}

PLANE_MODES = {
    0: "MANUAL",
    1: "CIRCLE",
    2: "STABILIZE",
    3: "TRAINING",
    4: "ACRO",
    5: "FBWA",
    6: "FBWB",
    7: "CRUISE",
    8: "AUTOTUNE",
    10: "AUTO",
    11: "RTL",
    12: "LOITER",
    13: "TAKEOFF",
    14: "AVOID_ADSB",
    15: "GUIDED",
    16: "INITIALISING",
    17: "QSTABILIZE",
    18: "QHOVER",
    19: "QLOITER",
    20: "QLAND",
    21: "QRTL",
    22: "QAUTOTUNE",
    23: "QACRO",
    24: "THERMAL",
    25: "LOITER_ALT_QLAND",
    26: "AUTOLAND",
}

ROVER_MODES = {
    0: "MANUAL",
    1: "ACRO",
    2: "LEARNING",
    3: "STEERING",
    4: "HOLD",
    5: "LOITER",
    6: "FOLLOW",
    7: "SIMPLE",
    8: "DOCK",
    9: "CIRCLE",
    10: "AUTO",
    11: "RTL",
    12: "SMART_RTL",
    15: "GUIDED",
    16: "INITIALISING",
}

SUB_MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    7: "CIRCLE",
    9: "SURFACE",
    16: "POSHOLD",
    19: "MANUAL",
    20: "MOTOR_DETECT",
    21: "SURFTRAK",
}

ARDUPILOT_MODES = {"copter": COPTER_MODES, "plane": PLANE_MODES, "rover": ROVER_MODES, "sub": SUB_MODES}

WITHOUT_ATTITUDE = frozenset(
    (
        "manual",
        "acro",
        "rattitude",
        "training",
        "flip",
        "throw",
        "turtle",
        "qacro",
        "learning",
        "steering",
        "hold",
        "simple",
        "dock",
        "motor_detect",
        "initialising",
        "termination",
        "ready",
    )
)
"""Modes in which nobody commands an attitude: rates, servos or wheels are steered, or nothing is."""
HOLDS_ATTITUDE = frozenset(("Hold",))
"""PX4 writes Hold for holding a position in the air; HOLD is a rover that stands."""


def commands_attitude(mode: str) -> bool:
    """Whether the attitude set-point of a mode means anything; modes that are not known command one."""
    return mode in HOLDS_ATTITUDE or mode.lower() not in WITHOUT_ATTITUDE


def px4_mode(nav_state: int) -> str:
    """The mode for a PX4 nav_state, "mode N" where the number has no name."""
    return PX4_MODES.get(nav_state, f"mode {nav_state}")


def px4_custom_mode(custom_mode: int) -> str:
    """The mode for PX4's MAVLink custom_mode (main mode in bits 16 to 23, sub mode in 24 to 31)."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == 4:
        auto = {
            1: "Ready",
            2: "Takeoff",
            3: "Hold",
            4: "Mission",
            5: "Return",
            6: "Land",
            8: "Follow Me",
            9: "Precision Land",
        }
        return auto.get(sub, "Auto")
    names = {1: "Manual", 2: "Altitude", 3: "Position", 5: "Acro", 6: "Offboard", 7: "Stabilized", 8: "Rattitude"}
    return names.get(main, f"mode {custom_mode}")


def ardupilot_mode(family: str, number: int) -> str:
    """The mode for an ArduPilot number in a firmware family (copter, plane, rover, sub)."""
    return ARDUPILOT_MODES.get(family, {}).get(number, f"mode {number}")
