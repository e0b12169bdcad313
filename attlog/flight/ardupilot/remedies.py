"""ArduPilot's settings against faults; only parameters that the log holds are named.

Sources: the pages on compass calibration, magnetic interference and vibration damping
at ardupilot.org/copter/docs.
"""

from __future__ import annotations

from collections.abc import Mapping

from attlog.flight.remedies import GENERAL, Fault


def of(values: Mapping[str, float], compass: int = 0) -> dict[Fault, str]:
    """Remedies for a vehicle with these parameters (may be empty); ``compass``: the one in use, by its index."""
    found = dict(GENERAL)
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
