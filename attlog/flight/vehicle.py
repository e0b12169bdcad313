"""Name vehicles and flight modes: the lists for every log format and every firmware.

Sources: MAVLink common.xml (MAV_TYPE), PX4 ``msg/VehicleStatus.msg`` (vehicle_type, nav_state), ArduPilot's firmware
families, FRAME_CLASS and ``mode.h`` of each vehicle. Numbers that PX4 gave a second meaning have their newest name.
"""

from __future__ import annotations

import re
from enum import Enum


class VehicleKind(Enum):
    """Kind of a vehicle, with its abilities."""

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
        """True if the vehicle can leave the ground, also if unknown."""
        return self not in (VehicleKind.ROVER, VehicleKind.BOAT, VehicleKind.SUB, VehicleKind.TRACKER)

    @property
    def hovers(self) -> bool:
        """True if the vehicle can hover, also if unknown."""
        return self.flies and self not in (VehicleKind.PLANE, VehicleKind.PARAFOIL, VehicleKind.ROCKET)

    @property
    def fixed_wing(self) -> bool:
        """True if the vehicle always flies along its nose, so that course is heading."""
        return self in (VehicleKind.PLANE, VehicleKind.ORNITHOPTER)

    @property
    def winged(self) -> bool:
        """True if the vehicle may fly steeply banked or inverted: a plane, or a VTOL in forward flight."""
        return self.fixed_wing or self is VehicleKind.VTOL


# Name, kind, ArduPilot's firmware family (it decides what a mode number means) and MAV_TYPE numbers.
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

KIND_OF = {name: kind for name, kind, _, _ in VEHICLES}
FAMILY_OF = {name: family for name, _, family, _ in VEHICLES}
NAME_OF_TYPE = {number: name for name, _, _, numbers in VEHICLES for number in numbers}
# ``vehicle_status.vehicle_type``; 0 is unknown.
PX4_TYPES = {1: "multirotor", 2: "fixed wing", 3: "rover", 4: "airship"}
# Lowest byte of a release number.
RELEASE_TYPES = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: ""}


def vehicle_name(mav_type: int) -> str:
    """Return the vehicle of a MAV_TYPE number, "unknown" for any other number."""
    return NAME_OF_TYPE.get(mav_type, "unknown")


def vehicle_kind(name: str) -> VehicleKind:
    """Return the kind of a vehicle by its whole name in the list, OTHER for any other name."""
    return KIND_OF.get(name, VehicleKind.OTHER)


def firmware_family(name: str) -> str:
    """Return ArduPilot's firmware family (copter, plane, rover, sub, blimp, tracker) of a vehicle, empty for none."""
    return FAMILY_OF.get(name, "")


def px4_version(number: int) -> str:
    """Return the version text of a release number: a byte each for major, minor, patch and type."""
    version = f"{number >> 24}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}"
    kind = RELEASE_TYPES.get(number & 0xFF, f"type {number & 0xFF}")
    return f"{version} {kind}" if kind else version


def version_number(version: str) -> tuple[int, int]:
    """Return major and minor number of a version text, (0, 0) without any."""
    match = re.search(r"(\d+)\.(\d+)", version)
    return (int(match[1]), int(match[2])) if match else (0, 0)


# --- flight modes -----------------------------------------------------------------------------------------------


def _numbered(names: str) -> dict[int, str]:
    """Return names by number from 0; "-" for a number without a mode."""
    return {number: name for number, name in enumerate(names.split(", ")) if name != "-"}


PX4_MODES = _numbered(
    "Manual, Altitude, Position, Mission, Hold, Return, Position Slow, Recovery, Altitude Cruise, Land without "
    "GNSS, Acro, -, Descend, Termination, Offboard, Stabilized, Rattitude, Takeoff, Land, Follow Me, Precision "
    "Land, Orbit, VTOL Takeoff, External 1, External 2, External 3, External 4, External 5, External 6, External 7, "
    "External 8"
)
COPTER_MODES = _numbered(
    "STABILIZE, ACRO, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, CIRCLE, POSITION, LAND, OF_LOITER, DRIFT, -, SPORT, "
    "FLIP, AUTOTUNE, POSHOLD, BRAKE, THROW, AVOID_ADSB, GUIDED_NOGPS, SMART_RTL, FLOWHOLD, FOLLOW, ZIGZAG, "
    "SYSTEMID, AUTOROTATE, AUTO_RTL, TURTLE"
)
PLANE_MODES = _numbered(
    "MANUAL, CIRCLE, STABILIZE, TRAINING, ACRO, FBWA, FBWB, CRUISE, AUTOTUNE, -, AUTO, RTL, LOITER, TAKEOFF, "
    "AVOID_ADSB, GUIDED, INITIALISING, QSTABILIZE, QHOVER, QLOITER, QLAND, QRTL, QAUTOTUNE, QACRO, THERMAL, "
    "LOITER_ALT_QLAND, AUTOLAND"
)
ROVER_MODES = _numbered(
    "MANUAL, ACRO, LEARNING, STEERING, HOLD, LOITER, FOLLOW, SIMPLE, DOCK, CIRCLE, AUTO, RTL, SMART_RTL, -, -, "
    "GUIDED, INITIALISING"
)
SUB_MODES = _numbered(
    "STABILIZE, ACRO, ALT_HOLD, AUTO, GUIDED, -, -, CIRCLE, -, SURFACE, -, -, -, -, -, -, POSHOLD, -, -, MANUAL, "
    "MOTOR_DETECT, SURFTRAK"
)
ARDUPILOT_MODES = {"copter": COPTER_MODES, "plane": PLANE_MODES, "rover": ROVER_MODES, "sub": SUB_MODES}
# Main modes of PX4's MAVLink custom_mode, and sub modes of the automatic one.
PX4_AUTO = 4
PX4_MAIN_MODES = _numbered("-, Manual, Altitude, Position, -, Acro, Offboard, Stabilized, Rattitude")
PX4_AUTO_MODES = _numbered("-, Ready, Takeoff, Hold, Mission, Return, Land, -, Follow Me, Precision Land")

# Modes without a commanded attitude: rates, servos, wheels or nothing is commanded.
WITHOUT_ATTITUDE = frozenset(
    "manual acro rattitude training flip throw turtle qacro learning steering hold simple dock motor_detect "
    "initialising termination ready".split()
)
# PX4 writes Hold for holding a position in the air; HOLD is a rover at rest.
HOLDS_ATTITUDE = frozenset(("Hold",))


def commands_attitude(mode: str) -> bool:
    """Return whether a mode commands its attitude set-point; unknown modes do."""
    return mode in HOLDS_ATTITUDE or mode.lower() not in WITHOUT_ATTITUDE


def px4_mode(nav_state: int) -> str:
    """Return the mode of a PX4 nav_state, "mode N" without a name."""
    return PX4_MODES.get(nav_state, f"mode {nav_state}")


def px4_custom_mode(custom_mode: int) -> str:
    """Return the mode of PX4's MAVLink custom_mode (main mode in bits 16 to 23, sub mode in 24 to 31)."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == PX4_AUTO:
        return PX4_AUTO_MODES.get(sub, "Auto")
    return PX4_MAIN_MODES.get(main, f"mode {custom_mode}")


def ardupilot_mode(family: str, number: int) -> str:
    """Return the mode of an ArduPilot number in a firmware family (copter, plane, rover, sub)."""
    return ARDUPILOT_MODES.get(family, {}).get(number, f"mode {number}")
