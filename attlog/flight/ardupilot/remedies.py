"""ArduPilot's settings against faults; only parameters that the log holds are named.

Sources: the pages on compass calibration, magnetic interference, vibration damping and
the throttle-based notch filter at ardupilot.org/copter/docs.
"""

from __future__ import annotations

from collections.abc import Mapping

from attlog.flight.remedies import GENERAL, Fault


def of(values: Mapping[str, float]) -> dict[Fault, str]:
    """Remedies for a vehicle with these parameters (may be empty)."""
    found = dict(GENERAL)
    if "INS_GYR_CAL" in values and values["INS_GYR_CAL"] == 0:
        found["gyro_bias"] = "Set INS_GYR_CAL to 1 and keep the vehicle still while it starts."
    if "AHRS_ORIENTATION" in values:
        now = f"{values['AHRS_ORIENTATION']:g}"
        found["mounting"] = f"Compare the mounting with AHRS_ORIENTATION ({now}), then calibrate the level."
    if "COMPASS_ORIENT" in values:
        now = f"{values['COMPASS_ORIENT']:g}"
        found["compass_mounting"] = (
            f"Compare the mounting with COMPASS_ORIENT ({now}), and calibrate the compass away from iron."
        )
    if "COMPASS_MOTCT" in values:
        mode = values["COMPASS_MOTCT"]
        found["interference"] += (
            " Then measure what is left with compassmot (COMPASS_MOTCT is 0: no compensation)."
            if mode == 0
            else f" Then repeat compassmot (COMPASS_MOTCT is {mode:g} already)."
        )
    if values.get("INS_HNTCH_ENABLE") == 0:
        found["vibration"] += " INS_HNTCH_ENABLE is 0: the harmonic notch filter is off."
    if values.get("COMPASS_AUTODEC") == 0:
        found["declination"] = "Set COMPASS_AUTODEC to 1, and calibrate the compass."
    return found
