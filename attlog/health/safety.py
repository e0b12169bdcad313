"""Check safety functions that parameters switch off: arming checks, failsafes, battery monitor, every compass.

Meanings and values: the parameter reference of each vehicle at ardupilot.org, and docs.px4.io (``NAV_RCL_ACT``,
``COM_LOW_BAT_ACT``, circuit breakers). A function is off only where a logged parameter says so; one without a logged
parameter is not judged. A switched-off function explains no event, so the finding is a note.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from attlog.core.spans import Span
from attlog.flight.model import FIX_3D, FlightLog
from attlog.flight.vehicle import VehicleKind, firmware_family, version_number
from attlog.health.check import Check, HealthCase, number_text, unknown

QUESTION = "unsafe_settings"
TITLES = {"PX4": "docs.px4.io, Safety Configuration", "ArduPilot": "ardupilot.org, Failsafes and Pre-Arm Checks"}
# Most functions named in the sentence; the evidence has all of them.
MAX_NAMED = 4


def _never(log: FlightLog, t: float) -> bool:
    return False


class Switch(NamedTuple):
    """Safety function and the parameters that switch it off.

    ``off``: values by parameter; the function is off where all logged ones have these, and unknown without any.
    ``families``: ArduPilot's firmware families, empty for all. ``replaced(log, t)``: True where another function does
    its work, or it has none. ``by_default``: it is off in a new autopilot, which alone is no warning. ``effect``:
    consequence. ``remedy``: parameter and value.
    """

    function: str
    off: Mapping[str, tuple[float, ...]]
    effect: str
    remedy: str
    families: tuple[str, ...] = ()
    replaced: Callable[[FlightLog, float], bool] = _never
    by_default: bool = False

    def state(self, log: FlightLog, t: float) -> bool | None:
        """Return True if the function is off at ``t`` s, None if unknown."""
        known = {name: value for name in self.off if (value := log.param(name, t)) is not None}
        if not known:
            return None
        return all(value in self.off[name] for name, value in known.items()) and not self.replaced(log, t)

    def evidence(self, log: FlightLog, t: float) -> str:
        """Return a sentence with the parameters and the consequence."""
        values = [f"{name} {number_text(value)}" for name in self.off if (value := log.param(name, t)) is not None]
        return f"{_capital(self.function)} off ({', '.join(values[:2])}): {self.effect}."


# --- conditions -------------------------------------------------------------------------------------------------

MONITORS = ("BATT_MONITOR", *(f"BATT{n}_MONITOR" for n in range(2, 10)))
# Ground station failsafe of Copter and Rover, and of Plane.
STATION_FAILSAFES = ("FS_GCS_ENABLE", "FS_GCS_ENABL")
# First version in which the ground station failsafe of Copter covers every mode.
STATION_VERSION = (4, 0)


def _is_set(log: FlightLog, t: float, names: tuple[str, ...]) -> bool:
    return any(log.param(name, t) not in (None, 0.0) for name in names)


def _station_guards(log: FlightLog, t: float) -> bool:
    """Return whether the failsafe of the ground station acts when every link is lost."""
    return version_number(log.firmware.version) >= STATION_VERSION and _is_set(log, t, STATION_FAILSAFES)


def _no_monitor(log: FlightLog, t: float) -> bool:
    return not _is_set(log, t, MONITORS)


def _battery_guarded(log: FlightLog, t: float) -> bool:
    """Return whether there is no battery to guard, or another battery's failsafe acts."""
    others = tuple(f"BATT{n}_FS_{level}_ACT" for n in range(2, 10) for level in ("LOW", "CRT"))
    return _no_monitor(log, t) or _is_set(log, t, others)


# --- switches ---------------------------------------------------------------------------------------------------

ARMS_ANYWAY = "it arms even with a failed sensor"
NO_ACTION = "losing the radio link starts no action"
EMPTY = "an empty battery starts no action"
NO_WARNING = "no warning and no failsafe before the battery is empty"
MONITORS_OFF = dict.fromkeys(MONITORS, (0.0,))
THRESHOLDS = ("BATT_LOW_VOLT", "BATT_LOW_MAH", "BATT_CRT_VOLT", "BATT_CRT_MAH")

ARDUPILOT = (
    Switch("arming checks", {"ARMING_CHECK": (0.0,)}, ARMS_ANYWAY, "ARMING_CHECK 1"),
    # From 4.7 on, a mask of checks to skip.
    Switch("arming checks", {"ARMING_SKIPCHK": (-1.0,)}, ARMS_ANYWAY, "ARMING_SKIPCHK 0"),
    Switch(
        "radio failsafe", {"FS_THR_ENABLE": (0.0,)}, NO_ACTION, "FS_THR_ENABLE 1", ("copter", "rover"), _station_guards
    ),
    Switch("radio failsafe", {"FS_ACTION": (0.0,)}, NO_ACTION, "FS_ACTION 2", ("rover",)),
    Switch("radio failsafe", {"THR_FAILSAFE": (0.0,)}, NO_ACTION, "THR_FAILSAFE 1", ("plane",), _station_guards),
    Switch("battery monitor", MONITORS_OFF, NO_WARNING, "BATT_MONITOR for its power module"),
    Switch(
        "battery failsafe",
        {"BATT_FS_LOW_ACT": (0.0,), "BATT_FS_CRT_ACT": (0.0,)},
        EMPTY,
        "BATT_FS_LOW_ACT 2",
        replaced=_battery_guarded,
        by_default=True,
    ),
    Switch("battery failsafe", {"FS_BATT_ENABLE": (0.0,)}, EMPTY, "FS_BATT_ENABLE 1", ("copter",), _no_monitor, True),
    # Actions are set, but no level triggers them.
    Switch(
        "battery failsafe",
        dict.fromkeys(THRESHOLDS, (0.0,)),
        EMPTY,
        "BATT_LOW_VOLT",
        replaced=lambda log, t: _battery_guarded(log, t) or log.param("BATT_CRT_VOLT", t) is None,
        by_default=True,
    ),
    Switch(
        "EKF failsafe", {"FS_EKF_THRESH": (0.0,)}, "it flies on with a wrong position", "FS_EKF_THRESH 0.8", ("copter",)
    ),
    Switch("crash check", {"FS_CRASH_CHECK": (0.0,)}, "motors run on after a crash", "FS_CRASH_CHECK 1", ("copter",)),
)
# Numbers that switch off a check of PX4 (circuit_breaker_params.c).
PX4 = (
    Switch("supply check", {"CBRK_SUPPLY_CHK": (894281.0,)}, "it arms without a power module", "CBRK_SUPPLY_CHK 0"),
    Switch("position check", {"CBRK_VELPOSERR": (201607.0,)}, "it flies on with a wrong position", "CBRK_VELPOSERR 0"),
    Switch("GNSS check", {"CBRK_GPSFAIL": (240024.0,)}, "losing GNSS starts no action", "CBRK_GPSFAIL 0"),
    Switch("radio failsafe", {"NAV_RCL_ACT": (0.0,), "NAV_DLL_ACT": (0.0,)}, NO_ACTION, "NAV_RCL_ACT 2"),
    Switch(
        "battery failsafe",
        {"COM_LOW_BAT_ACT": (0.0,)},
        "an empty battery only warns",
        "COM_LOW_BAT_ACT 3",
        by_default=True,
    ),
    Switch(
        "battery monitor",
        dict.fromkeys(("BAT1_SOURCE", "BAT2_SOURCE", "BAT3_SOURCE"), (-1.0,)),
        NO_WARNING,
        "BAT1_SOURCE 0",
    ),
)
SWITCHES = {"ArduPilot": ARDUPILOT, "PX4": PX4}


def switched_off(log: FlightLog, t: float) -> tuple[list[Switch], list[str]]:
    """Return the functions that are off at ``t`` s, each once, and the names of those that are on."""
    family = firmware_family(log.vehicle)
    states = [
        (switch, switch.state(log, t))
        for switch in SWITCHES.get(log.firmware.name, ())
        if not switch.families or family in switch.families
    ]
    off: dict[str, Switch] = {}
    for switch, is_off in states:
        if is_off:
            off.setdefault(switch.function, switch)
    on = dict.fromkeys(switch.function for switch, is_off in states if is_off is False and switch.function not in off)
    return list(off.values()), list(on)


# --- heading without a compass ----------------------------------------------------------------------------------

COMPASS_SWITCHES = ("MAG_ENABLE", "COMPASS_ENABLE")
COMPASSES = ("COMPASS_USE", "COMPASS_USE2", "COMPASS_USE3")
# EK3_SRC1_YAW: 1 compass, 3 GNSS with the compass as fallback.
YAW_BY_COMPASS = (1.0, 3.0)
# EK3_MAG_CAL before 4.1: 5 another yaw sensor, 6 with the compass as fallback.
OTHER_YAW = (5.0, 6.0)
# EKF2_MAG_TYPE: 5 none, 6 only at the start.
PX4_WITHOUT_COMPASS = (5.0, 6.0)
# Bits that give PX4 another heading: dual antenna and vision, until 1.13 and since.
PX4_OTHER_HEADINGS = (("EKF2_AID_MASK", 128 + 16), ("EKF2_GPS_CTRL", 8), ("EKF2_EV_CTRL", 8))
# Modes of a hovering vehicle that hold a position over ground.
POSITION_MODES = frozenset(
    "auto guided loiter rtl circle position poshold brake smart_rtl follow zigzag auto_rtl mission hold return "
    "follow_me orbit".split()
)


def every_compass_off(log: FlightLog, t: float) -> str:
    """Return the parameters by which no compass gives the heading, empty if one may."""

    def value(name: str) -> float | None:
        return log.param(name, t)

    if log.firmware.name == "PX4":
        other = any(int(value(name) or 0) & bits for name, bits in PX4_OTHER_HEADINGS)
        off = "SYS_HAS_MAG 0" if value("SYS_HAS_MAG") == 0.0 else ""
        kind = value("EKF2_MAG_TYPE")
        off = f"EKF2_MAG_TYPE {kind:.0f}" if not off and kind in PX4_WITHOUT_COMPASS else off
        return "" if other else off
    if value("EK3_SRC1_YAW") not in (None, *YAW_BY_COMPASS) or value("EK3_MAG_CAL") in OTHER_YAW:
        return ""
    off = next((f"{name} 0" for name in COMPASS_SWITCHES if value(name) == 0.0), "")
    used = [x for name in COMPASSES if (x := value(name)) is not None]
    return off or ("COMPASS_USE 0" if used and not any(used) else "")


def position_mode(log: FlightLog, flights: list[Span]) -> str:
    """Return a mode with position control that flew with GNSS, empty if none did."""
    line = log.state.mode
    if line is None or not any((gnss.fix >= FIX_3D).any() for gnss in log.gnss):
        return ""
    ends = np.append(line.t[1:], np.inf)
    for begin, end, mode in zip(line.t, ends, line.value, strict=True):
        flew = any(min(end, b) - max(begin, a) > 1.0 for a, b in flights)
        if flew and str(mode).lower().replace(" ", "_") in POSITION_MODES:
            return str(mode)
    return ""


# --- check ------------------------------------------------------------------------------------------------------


def safety_checks(case: HealthCase) -> list[Check]:
    """Check the safety functions of a real vehicle at its first arming; nothing for a simulation."""
    log = case.log
    if log.simulated or log.firmware.name not in SWITCHES:
        return []
    if not log.parameters.lines:
        return [unknown(QUESTION, "The log holds no parameters: give those of the vehicle with --params.")]
    flights = case.segments.spans("airborne")
    armed = case.segments.spans("armed") or flights
    t = armed[0][0] if armed else 0.0
    off, on = switched_off(log, t)
    names = [switch.function for switch in off]
    evidence = [switch.evidence(log, t) for switch in off]
    remedies = [switch.remedy for switch in off]
    compass, mode = every_compass_off(log, t), position_mode(log, flights)
    if compass and mode and log.kind in (VehicleKind.MULTIROTOR, VehicleKind.HELICOPTER):
        names.append("every compass")
        evidence.append(f"Every compass off ({compass}): {mode} needs a heading.")
        remedies.append(f"{compass.split()[0]} {'0' if compass.startswith('EKF2') else '1'}")
    if not names and not on:
        return [unknown(QUESTION, "The log holds none of the parameters of arming checks, failsafes and battery.")]
    source = TITLES[log.firmware.name]
    if all(switch.by_default for switch in off) and len(names) == len(off):
        text = f"Switched on: {_listed(on)}." if on else "Only the battery failsafe is off, as by default."
        return [Check(QUESTION, "ok", text, evidence=evidence, source=source)]
    action = f"Set {_listed(remedies, len(remedies))}, unless this is intended."
    return [
        Check(QUESTION, "warning", f"Switched off: {_listed(names)}.", evidence=evidence, source=source, action=action)
    ]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _listed(names: list[str], most: int = MAX_NAMED) -> str:
    """Join names by commas and "and"; more than ``most`` are counted."""
    shown = names if len(names) <= most else [*names[: most - 1], f"{len(names) - most + 1} more"]
    return " and ".join(filter(None, (", ".join(shown[:-1]), shown[-1])))
