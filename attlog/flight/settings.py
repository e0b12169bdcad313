"""Which setting of the vehicle would log what is missing, by firmware and vehicle.

PX4: SDLOG_PROFILE and SDLOG_MODE (src/modules/logger/params.c). ArduPilot:
LOG_BITMASK of each vehicle, INS_RAW_LOG_OPT (4.5 and later) and LOG_DISARMED.
"""

from __future__ import annotations

import re


def number(version: str) -> tuple[int, int]:
    """Major and minor number in a version text, (0, 0) where it holds none."""
    match = re.search(r"(\d+)\.(\d+)", version)
    return (int(match[1]), int(match[2])) if match else (0, 0)


def how_to_log(firmware: str, version: str, what: str, telemetry: bool = False) -> str:
    """The sentence on how to log ``what`` (imu, fast_imu, attitude, mag, rest, gnss), empty for unknown firmware."""
    if telemetry:
        return "Take the log from the vehicle's SD card (.bin or .ulg) instead of telemetry."
    if firmware == "ArduPilot":
        return ardupilot(version, what)
    return px4(version, what) if firmware == "PX4" else ""


def px4(version: str, what: str) -> str:
    """PX4's settings; before 1.8 the topics of a log were listed in a file on the SD card."""
    if what == "rest":
        return "Set SDLOG_MODE to 1 (log from boot) and let the vehicle stand still with motors off for 30 s."
    if what == "mag":
        return "Enable and calibrate a compass (SYS_HAS_MAG 1, CAL_MAGn_PRIO above 0)."
    if what == "gnss":
        return "Fly with GNSS, or log vehicle_gps_position (bit 0 of SDLOG_PROFILE)."
    if (0, 0) < number(version) < (1, 8):
        topic = {"attitude": "vehicle_attitude"}.get(what, "sensor_combined")
        return f"Name {topic} at full rate in /etc/logging/logger_topics.txt on the SD card."
    if what == "attitude":
        return "Set bit 4 of SDLOG_PROFILE (high rate) for the attitude at full rate."
    return "Set bit 0 of SDLOG_PROFILE (default set: sensor_combined at full rate), or bits 8 and 9 (every IMU sample)."


def ardupilot(version: str, what: str) -> str:
    """ArduPilot's settings; the vehicle stands at the start of the version text."""
    plane = version.startswith(("Plane", "Rover"))
    if what == "rest":
        return "Set LOG_DISARMED to 1 and let the vehicle stand still with motors off for 30 s."
    if what == "mag":
        return f"Set bit {10 if plane else 13} of LOG_BITMASK (compass) and COMPASS_USE to 1."
    if what == "gnss":
        return "Set bit 2 of LOG_BITMASK (GPS)."
    if what == "attitude":
        return "Set bit 0 of LOG_BITMASK (fast attitude)."
    if what == "imu":
        return "Set bit 7 of LOG_BITMASK (IMU)" + (" or bit 18 (fast IMU)." if not plane else ".")
    raw = "INS_RAW_LOG_OPT to 1 (raw samples of the primary gyro)" if number(version) >= (4, 5) else (
        "bit 19 of LOG_BITMASK (raw IMU)")  # fmt: skip
    return f"Set {raw}" + ("." if plane else ", or bit 18 of LOG_BITMASK (fast IMU).")
