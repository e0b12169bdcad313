"""What would log vibration, and fast samples of the gyro, in the firmware that flew?"""

from __future__ import annotations

from attlog.flight.advice import version_number
from attlog.flight.model import FlightLog
from attlog.flight.px4.advice import GYRO_FIFO

DIFFERENCES = "PX4"
"""The firmware whose level is that of differences of samples that it logs at full rate itself."""
HOW = "fly two minutes with changes of throttle"


def filters_gyro(log: FlightLog) -> bool:
    """Whether this firmware has notches that are known here."""
    return log.firmware.name in ("PX4", "ArduPilot")


def measures_differences(log: FlightLog) -> bool:
    """Whether the firmware's own level can be made of the samples that it logs."""
    return log.firmware.name == DIFFERENCES


def level_missing(log: FlightLog) -> str:
    """Why a log holds no level of vibration, and what would log one."""
    if log.firmware.name == "PX4":
        return (
            "No vehicle_imu_status (PX4 1.11 and later log it) and no samples at full rate: vibration is not measured."
        )
    if log.firmware.name == "ArduPilot":
        return "This log holds no VIBE record; ArduPilot 3.4 and later write it with the IMU's bit of LOG_BITMASK."
    return "This log holds no vibration level of the autopilot, and its samples are too slow for one."


def fast_gyro(log: FlightLog) -> str:
    """What would log the gyro at the sensor's rate, with settings that are not made yet."""
    if log.firmware.name == "ArduPilot":
        mask = log.param("INS_LOG_BAT_MASK")
        if mask is None:
            return "ArduPilot 3.7 and later log bursts at full rate with INS_LOG_BAT_MASK 1."
        if mask == 0:
            return f"Set INS_LOG_BAT_MASK to 1, reboot and {HOW}."
        return f"INS_LOG_BAT_MASK is set already: {HOW}."
    if log.firmware.name != "PX4":
        return ""
    profile = log.param("SDLOG_PROFILE")
    if version_number(log.firmware.version) < (1, 12) or profile is None:
        return "PX4 1.12 and later log the gyro at full rate with bit 8 of SDLOG_PROFILE."
    if int(profile) >> GYRO_FIFO & 1:
        return f"Bit 8 of SDLOG_PROFILE is set already: {HOW}."
    return f"Set bit 8 of SDLOG_PROFILE (gyro FIFO) and {HOW}."
