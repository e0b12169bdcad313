"""ArduPilot's settings against faults; only parameters that the log holds are named.

Sources: the pages on compass calibration, magnetic interference and vibration damping
at ardupilot.org/copter/docs.
"""

from __future__ import annotations

from collections.abc import Mapping

from attlog.flight.advice import GENERAL_REMEDIES, Fault
from attlog.flight.calibration import PX4_SLOTS, px4_slot
from attlog.flight.model import Mag


def ardupilot_remedies(values: Mapping[str, float], compass: int = 0) -> dict[Fault, str]:
    """Remedies for a vehicle with these parameters (may be empty); ``compass``: the one in use, by its index."""
    found = dict(GENERAL_REMEDIES)
    if "INS_GYR_CAL" in values and values["INS_GYR_CAL"] == 0:
        found["gyro_bias"] = "Set INS_GYR_CAL to 1 and keep the vehicle still as it starts."
    if "AHRS_ORIENTATION" in values:
        now = f"{values['AHRS_ORIENTATION']:g}"
        found["mounting"] = f"Compare the mounting with AHRS_ORIENTATION {now}, then calibrate the level."
    orientation = "COMPASS_ORIENT" if compass == 0 else f"COMPASS_ORIENT{compass + 1}"
    if orientation in values:
        now = f"{values[orientation]:g}"
        found["compass_mounting"] = f"Compare the mounting with {orientation} {now}, then calibrate the compass."
    if "COMPASS_MOTCT" in values:
        mode = values["COMPASS_MOTCT"]
        found["interference"] += (
            " Then run compassmot (COMPASS_MOTCT is 0)." if mode == 0 else " Then repeat compassmot."
        )
    if values.get("COMPASS_AUTODEC") == 1:
        del found["declination"]
    elif "COMPASS_AUTODEC" in values:
        found["declination"] = "Set COMPASS_AUTODEC to 1."
    if "INS_TCAL1_ENABLE" in values:
        now = f"{values['INS_TCAL1_ENABLE']:g}"
        found["temperature"] = f"Calibrate over temperature: INS_TCAL1_ENABLE is {now}, 2 learns from a cold start."
    return found


def compass_switches(values: Mapping[str, float]) -> dict[int, str]:
    """The parameters that say whether a compass is used, by its index, of those that the log holds."""
    names = dict(enumerate(("COMPASS_USE", "COMPASS_USE2", "COMPASS_USE3")))
    return {index: name for index, name in names.items() if name in values}


def compass_first(values: Mapping[str, float]) -> str:
    """The parameter that says with which compass NavEKF2 starts (``InitialiseVariablesMag``), used or not.

    Empty where none does: since 4.1 the first one that is used is taken.
    """
    return "COMPASS_PRIMARY" if "COMPASS_PRIMARY" in values else ""


# PX4's settings against faults; only parameters that the log holds are named.
#
# Source: the parameter reference and the sensor calibration pages of docs.px4.io.


def px4_remedies(values: Mapping[str, float], mag: Mag | None = None) -> dict[Fault, str]:
    """Remedies for a vehicle with these parameters (may be empty); ``mag``: the compass in use."""
    found = dict(GENERAL_REMEDIES)
    if "SENS_BOARD_ROT" in values:
        now = f"{values['SENS_BOARD_ROT']:g}"
        found["mounting"] = f"Compare the mounting with SENS_BOARD_ROT {now}, then calibrate the level."
    rotation = f"CAL_MAG{_slot_in_use(values, mag)}_ROT"
    if rotation in values:
        now = f"{values[rotation]:g}"
        found["compass_mounting"] = f"Compare the mounting with {rotation} {now}, then calibrate the compass."
    if values.get("CAL_MAG_COMP_TYP") == 0:
        found["interference"] += " CAL_MAG_COMP_TYP is 0: nothing compensates for them."
    if "TC_G_ENABLE" in values:
        now = f"{values['TC_G_ENABLE']:g}"
        found["temperature"] = f"Run the thermal calibration from a cold start (TC_G_ENABLE is {now}; 1 uses it)."
    return found


def _slot_in_use(values: Mapping[str, float], mag: Mag | None) -> int | None:
    """The calibration slot of a compass, by its device; of one without a name the only slot that is enabled."""
    if mag is not None and mag.device is not None and mag.device.isdigit():
        return px4_slot("MAG", values, int(mag.device))
    slots = [n for n in range(PX4_SLOTS) if values.get(f"CAL_MAG{n}_ID")]
    slots = [n for n in slots if values.get(f"CAL_MAG{n}_EN", 1.0) != 0 and values.get(f"CAL_MAG{n}_PRIO", 1.0) != 0]
    return slots[0] if len(slots) == 1 else None
