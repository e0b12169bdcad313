"""Names of flight modes.

Sources: PX4 msg/VehicleStatus.msg, ArduPilot
``mode.h`` of each vehicle. Numbers that PX4 gave a second meaning are named by
their newest one.
"""

from __future__ import annotations

PX4_MODES = {
    0: "Manual", 1: "Altitude", 2: "Position", 3: "Mission", 4: "Hold", 5: "Return", 6: "Position Slow",
    7: "Recovery", 8: "Altitude Cruise", 9: "Land without GNSS", 10: "Acro", 12: "Descend", 13: "Termination",
    14: "Offboard", 15: "Stabilized", 16: "Rattitude", 17: "Takeoff", 18: "Land", 19: "Follow Me",
    20: "Precision Land", 21: "Orbit", 22: "VTOL Takeoff", 23: "External 1", 24: "External 2", 25: "External 3",
    26: "External 4", 27: "External 5", 28: "External 6", 29: "External 7", 30: "External 8",
}

COPTER_MODES = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 7: "CIRCLE",
    8: "POSITION", 9: "LAND", 10: "OF_LOITER", 11: "DRIFT", 13: "SPORT", 14: "FLIP", 15: "AUTOTUNE", 16: "POSHOLD",
    17: "BRAKE", 18: "THROW", 19: "AVOID_ADSB", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 22: "FLOWHOLD", 23: "FOLLOW",
    24: "ZIGZAG", 25: "SYSTEMID", 26: "AUTOROTATE", 27: "AUTO_RTL", 28: "TURTLE",
}

PLANE_MODES = {
    0: "MANUAL", 1: "CIRCLE", 2: "STABILIZE", 3: "TRAINING", 4: "ACRO", 5: "FBWA", 6: "FBWB", 7: "CRUISE",
    8: "AUTOTUNE", 10: "AUTO", 11: "RTL", 12: "LOITER", 13: "TAKEOFF", 14: "AVOID_ADSB", 15: "GUIDED",
    16: "INITIALISING", 17: "QSTABILIZE", 18: "QHOVER", 19: "QLOITER", 20: "QLAND", 21: "QRTL", 22: "QAUTOTUNE",
    23: "QACRO", 24: "THERMAL", 25: "LOITER_ALT_QLAND", 26: "AUTOLAND",
}

ROVER_MODES = {
    0: "MANUAL", 1: "ACRO", 2: "LEARNING", 3: "STEERING", 4: "HOLD", 5: "LOITER", 6: "FOLLOW", 7: "SIMPLE",
    8: "DOCK", 9: "CIRCLE", 10: "AUTO", 11: "RTL", 12: "SMART_RTL", 15: "GUIDED", 16: "INITIALISING",
}

SUB_MODES = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 7: "CIRCLE", 9: "SURFACE", 16: "POSHOLD",
    19: "MANUAL", 20: "MOTOR_DETECT", 21: "SURFTRAK",
}

ARDUPILOT_MODES = {"copter": COPTER_MODES, "plane": PLANE_MODES, "rover": ROVER_MODES, "sub": SUB_MODES}

WITHOUT_ATTITUDE = frozenset(
    ("manual", "acro", "rattitude", "training", "flip", "throw", "turtle", "qacro", "learning", "steering", "hold",
     "simple", "dock", "motor_detect", "initialising", "termination", "ready")
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
        auto = {1: "Ready", 2: "Takeoff", 3: "Hold", 4: "Mission", 5: "Return", 6: "Land", 8: "Follow Me",
                9: "Precision Land"}
        return auto.get(sub, "Auto")
    names = {1: "Manual", 2: "Altitude", 3: "Position", 5: "Acro", 6: "Offboard", 7: "Stabilized", 8: "Rattitude"}
    return names.get(main, f"mode {custom_mode}")


def ardupilot_mode(family: str, number: int) -> str:
    """The mode for an ArduPilot number in a firmware family (copter, plane, rover, sub)."""
    return ARDUPILOT_MODES.get(family, {}).get(number, f"mode {number}")
