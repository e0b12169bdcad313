"""PX4's settings against faults; only parameters that the log holds are named.

Source: the parameter reference and the sensor calibration pages of docs.px4.io.
"""

from __future__ import annotations

from collections.abc import Mapping

from attlog.flight.calibration.px4 import SLOTS, slot_of
from attlog.flight.model import Mag
from attlog.flight.remedies import GENERAL, Fault


def of(values: Mapping[str, float], mag: Mag | None = None) -> dict[Fault, str]:
    """Remedies for a vehicle with these parameters (may be empty); ``mag``: the compass in use."""
    found = dict(GENERAL)
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
        return slot_of("MAG", values, int(mag.device))
    slots = [n for n in range(SLOTS) if values.get(f"CAL_MAG{n}_ID")]
    slots = [n for n in slots if values.get(f"CAL_MAG{n}_EN", 1.0) != 0 and values.get(f"CAL_MAG{n}_PRIO", 1.0) != 0]
    return slots[0] if len(slots) == 1 else None
