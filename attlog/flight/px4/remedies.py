"""PX4's settings against faults; only parameters that the log holds are named.

Source: the parameter reference and the sensor calibration pages of docs.px4.io.
"""

from __future__ import annotations

from collections.abc import Mapping

from attlog.flight.remedies import GENERAL, Fault


def of(values: Mapping[str, float]) -> dict[Fault, str]:
    """Remedies for a vehicle with these parameters (may be empty)."""
    found = dict(GENERAL)
    if "SENS_BOARD_ROT" in values:
        now = f"{values['SENS_BOARD_ROT']:g}"
        found["mounting"] = f"Compare the mounting with SENS_BOARD_ROT {now}, then calibrate the level."
    if "CAL_MAG0_ROT" in values:
        now = f"{values['CAL_MAG0_ROT']:g}"
        found["compass_mounting"] = f"Compare the mounting with CAL_MAG0_ROT {now}, then calibrate the compass."
    if values.get("CAL_MAG_COMP_TYP") == 0:
        found["interference"] += " CAL_MAG_COMP_TYP is 0: nothing compensates for them."
    if "TC_G_ENABLE" in values:
        now = f"{values['TC_G_ENABLE']:g}"
        found["temperature"] = f"Run the thermal calibration from a cold start (TC_G_ENABLE is {now}; 1 uses it)."
    return found
