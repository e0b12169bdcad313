"""Advise on a vehicle's settings: what would log a missing quantity, and what to do about a fault.

Sources of the logging settings. ArduPilot: ``@Bitmask`` of LOG_BITMASK in ``Parameters.cpp`` of each vehicle, and
``libraries/AP_Logger/AP_Logger.cpp`` for rate limits and LOG_DISARMED. PX4: ``src/modules/logger/params.c`` and
``logged_topics.cpp`` of 1.6 to 1.16. Sources of the remedies: ardupilot.org/copter/docs on compass calibration,
magnetic interference and vibration damping; the parameter reference and the sensor calibration pages of docs.px4.io.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from attlog.core.brief import brief
from attlog.flight.calibration import px4_slot_in_use, slot_suffix
from attlog.flight.vehicle import version_number

# Missing data: any inertial data, faster inertial data, onboard attitude, magnetometer, rest before arming.
LoggingNeed = Literal["imu", "fast_imu", "attitude", "mag", "rest"]
ADVISED_REST_S = 30


def bit_mask(value: float | None) -> int | None:
    """Return a parameter's value as a bit mask (two's complement if negative), None if unknown or beyond 2^53."""
    return None if value is None or not abs(value) < 2**53 else int(value)


def advise_rest(why: str = "", setting: str = "") -> str:
    """Return the advice to stand still before take-off, behind a ``setting`` to make or a reason ``why``."""
    how = f"let the vehicle stand still with motors off for {ADVISED_REST_S} s"
    if setting:
        return f"{setting} and {how}."
    return f"{why}: {how}." if why else f"{how[0].upper()}{how[1:]}."


# --- logging ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class VehicleSettings:
    """Firmware kind, version and family of a vehicle, and its parameters at boot.

    ``name``: writing program if the kind is ``other``; suffix of the onboard log if it is ``telemetry``.
    """

    kind: Literal["PX4", "ArduPilot", "telemetry", "bag", "other", "unknown"] = "unknown"
    version: str = ""
    family: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    name: str = ""
    __repr__ = brief


_SD_CARD = "Take the log from the vehicle's SD card ({name}) instead of telemetry."
_IMU_TOPIC = "Record the IMU's topic (sensor_msgs/Imu) at its full rate."
_CONNECT_COMPASS = "Connect and calibrate a compass."
FIXED_ADVICE: dict[str, dict[LoggingNeed, str]] = {
    "telemetry": {
        "imu": _SD_CARD,
        "fast_imu": _SD_CARD,
        "attitude": _SD_CARD,
        "mag": _CONNECT_COMPASS,
        "rest": advise_rest("Record telemetry before arming"),
    },
    "bag": {
        "imu": _IMU_TOPIC,
        "fast_imu": _IMU_TOPIC,
        "attitude": _IMU_TOPIC,
        "mag": "Record a topic of sensor_msgs/MagneticField.",
        "rest": advise_rest("Begin the bag before arming"),
    },
    "other": {"imu": "{name} wrote it, which is no autopilot that attlog knows."},
}


def logging_advice(settings: VehicleSettings, need: LoggingNeed, rate: float | None = None) -> str:
    """Return a sentence on the setting that would log ``need``, empty if unknown.

    ``rate``: of the logged records in Hz, None without records. Settings that are already made, or that this firmware
    version lacks, are not advised.
    """
    if settings.kind == "PX4":
        return _px4_advice(settings, need, rate)
    if settings.kind == "ArduPilot":
        return _ardupilot_advice(settings, need, rate)
    return FIXED_ADVICE.get(settings.kind, {}).get(need, "").format(name=settings.name)


# SDLOG_PROFILE is a bit mask since the first version; its bit 0 logs ``sensor_combined`` at full rate since the second.
PX4_PROFILE_VERSION, PX4_FULL_RATE_VERSION = (1, 8), (1, 12)
# Bit of SDLOG_PROFILE that logs the gyro FIFO.
GYRO_FIFO = 8
_DEFAULT_SET, _REPLAY, _HIGH_RATE = (0, "default set"), (1, "estimator replay"), (4, "high rate")
TOPICS_FILE = "etc/logging/logger_topics.txt on the SD card"
# Values of SDLOG_MODE with which the log begins at boot.
LOG_FROM_BOOT_MODES = (1, 2)


def _px4_advice(settings: VehicleSettings, need: LoggingNeed, rate: float | None) -> str:
    values, version = settings.values, version_number(settings.version)
    if need == "rest":
        mode = values.get("SDLOG_MODE")
        if values and mode is None:
            return advise_rest(setting="Start the logger at boot (logger start -e)")
        if mode in LOG_FROM_BOOT_MODES:
            return advise_rest(f"SDLOG_MODE is {mode:g} already")
        return advise_rest(setting="Set SDLOG_MODE to 1")
    if need == "mag":
        return "Set SYS_HAS_MAG to 1." if values.get("SYS_HAS_MAG", 1.0) == 0 else _CONNECT_COMPASS
    topic = "vehicle_attitude" if need == "attitude" else "sensor_combined"
    if (0, 0) < version < PX4_PROFILE_VERSION or (values and "SDLOG_PROFILE" not in values):
        return f"Name {topic} at full rate (interval 0) in {TOPICS_FILE}."
    bits = [_HIGH_RATE] if need == "attitude" else [_REPLAY, _HIGH_RATE]
    if need != "attitude" and not (0, 0) < version < PX4_FULL_RATE_VERSION:
        bits.insert(0, _DEFAULT_SET)
    profile = bit_mask(values.get("SDLOG_PROFILE"))
    on = [(bit, name) for bit, name in bits if profile is not None and profile >> bit & 1]
    if not on:
        return f"Set bit {bits[0][0]} of SDLOG_PROFILE ({bits[0][1]}), which logs {topic} at full rate."
    text = f"Bit {on[0][0]} of SDLOG_PROFILE ({on[0][1]}) is set already and logs {topic} at full rate"
    if rate is None:
        return f"{text}, unless {TOPICS_FILE} replaces the set."
    return f"{text}: the sensors give no more than {rate:.1f} Hz, or {TOPICS_FILE} replaces the set."


class LogBits(NamedTuple):
    """Bits of LOG_BITMASK of a vehicle; ``fast_imu`` and ``raw_imu`` exist since 3.4.

    Copters log ``imu`` at 25 Hz (50 Hz before 3.4) and ``fast_imu`` in every main loop; planes and rovers log ``imu``
    in every main loop.
    """

    attitude: int
    imu: int
    mag: int
    fast_imu: int | None = None
    raw_imu: int | None = None


LOG_BITS = {
    "copter": LogBits(attitude=0, imu=7, mag=13, fast_imu=18, raw_imu=19),
    "sub": LogBits(attitude=0, imu=7, mag=13, raw_imu=19),
    "plane": LogBits(attitude=0, imu=7, mag=10, raw_imu=19),
    "rover": LogBits(attitude=0, imu=7, mag=11, raw_imu=19),
    "blimp": LogBits(attitude=0, imu=7, mag=13),
    "tracker": LogBits(attitude=0, imu=3, mag=5),
}
# Bit of LOG_BITMASK in place of LOG_DISARMED in Copter 3.2 and 3.3 and the first Sub.
LOG_WHEN_DISARMED_BIT, WHEN_DISARMED_VERSIONS = 16, ((3, 2), (3, 3))
# LOG_BITMASK has more than 16 bits, and LOG_DISARMED exists, since these versions.
WIDE_MASK_VERSION, LOG_DISARMED_VERSION = (3, 2), (3, 4)
# Families that log ``imu`` in a task of its own, and its rate.
SLOW_IMU_FAMILIES, SLOW_IMU_HZ = ("copter", "sub", "blimp"), 25.0
# A logged rate between these shares of a rate limit is attributed to the limit, which keeps every k-th record.
LIMITED_RATE_SHARE = (0.6, 1.3)
# Rate limits with their bit of LOG_BACKEND_TYPE, 0 for any.
RATE_LIMITS = (("LOG_FILE_RATEMAX", 1), ("LOG_MAV_RATEMAX", 2), ("LOG_BLK_RATEMAX", 4), ("LOG_DARM_RATEMAX", 0))


def _ardupilot_advice(settings: VehicleSettings, need: LoggingNeed, rate: float | None) -> str:
    values, family = settings.values, settings.family
    if need == "rest":
        return _ardupilot_rest(settings)
    bits = LOG_BITS.get(family)
    if bits is None:
        named = {"attitude": "fast attitude", "mag": "compass"}.get(need, "IMU")
        return f"Set the bit of LOG_BITMASK for {named}; its number depends on the vehicle."
    if need == "mag":
        for name in ("COMPASS_ENABLE", "MAG_ENABLE"):
            if values.get(name, 1.0) == 0:
                return f"Set {name} to 1."
        if not _is_set(settings, bits.mag):
            return f"Set bit {bits.mag} of LOG_BITMASK (compass)."
        return f"Bit {bits.mag} of LOG_BITMASK (compass) is set already: connect and calibrate a compass."
    if need == "attitude":
        name = "attitude" if family == "tracker" else "fast attitude"
        limited = _rate_limits(values, rate)
        if _is_set(settings, bits.attitude):
            return limited or _already_set(f"Bit {bits.attitude} of LOG_BITMASK ({name}) is", rate, "attitude")
        return f"Set bit {bits.attitude} of LOG_BITMASK ({name}). {limited}".rstrip()
    return _ardupilot_imu(settings, bits, rate)


def _ardupilot_imu(settings: VehicleSettings, bits: LogBits, rate: float | None) -> str:
    """Advise on logging inertial data: any (``rate`` None), or faster than ``rate``."""
    modern = version_number(settings.version) >= LOG_DISARMED_VERSION
    if "LOG_BITMASK" in settings.values:
        modern = "LOG_DISARMED" in settings.values
    faster = [(b, n) for b, n in ((bits.fast_imu, "fast IMU"), (bits.raw_imu, "raw IMU")) if b is not None]
    on = [b for b in (bits.imu, *(b for b, _ in faster)) if _is_set(settings, b)]
    if rate is None and not on:
        more = f" or bit {bits.fast_imu} (fast IMU)" if bits.fast_imu is not None and modern else ""
        return f"Set bit {bits.imu} of LOG_BITMASK (IMU){more}."
    missing = [f"bit {b} ({n})" for b, n in faster if b not in on]
    slow_task = settings.family in SLOW_IMU_FAMILIES and len(missing) == len(faster)
    at_full_rate = slow_task and rate is not None and rate > 0.95 * SLOW_IMU_HZ
    if limited := "" if at_full_rate else _rate_limits(settings.values, rate):
        return limited
    if rate is not None and missing:
        if modern:
            return f"Set {' or '.join(missing)} of LOG_BITMASK."
        return f"ArduPilot 3.4 and later can log the IMU faster: {' or '.join(missing)} of LOG_BITMASK."
    if not on:
        return "No bit of LOG_BITMASK logs the IMU faster."
    which = f"Bit {on[0]}" if len(on) == 1 else f"Bits {', '.join(map(str, on[:-1]))} and {on[-1]}"
    return _already_set(f"{which} of LOG_BITMASK (IMU) {'is' if len(on) == 1 else 'are'}", rate, "IMU data")


def _is_set(settings: VehicleSettings, bit: int) -> bool:
    """Return whether a bit of LOG_BITMASK is set, False if unknown."""
    mask = bit_mask(settings.values.get("LOG_BITMASK"))
    if mask is None or (bit >= 16 and (0, 0) < version_number(settings.version) < WIDE_MASK_VERSION):
        return False
    return bool(mask >> bit & 1)


def _rate_limits(values: Mapping[str, float], rate: float | None) -> str:
    """Return the advice on the rate limits that explain this rate, empty if none does."""
    backends = bit_mask(values.get("LOG_BACKEND_TYPE"))
    active = [(n, v) for n, bit in RATE_LIMITS if (not bit or backends is None or backends & bit)
              and (v := values.get(n, 0.0)) > 0]  # fmt: skip
    low, high = LIMITED_RATE_SHARE
    if rate is None or not any(low * v <= rate <= high * v for _, v in active):
        return ""
    named = " and ".join(f"{n} {v:g} Hz" + (" (while disarmed)" if n == "LOG_DARM_RATEMAX" else "") for n, v in active)
    limit, them = ("limits", "it") if len(active) == 1 else ("limit", "them")
    return f"{named} {limit} the rate: set {them} to 0."


def _ardupilot_rest(settings: VehicleSettings) -> str:
    values, version = settings.values, version_number(settings.version)
    if "LOG_DISARMED" in values:
        now = int(values["LOG_DISARMED"])
        return advise_rest(f"LOG_DISARMED is {now} already") if now else advise_rest(setting="Set LOG_DISARMED to 1")
    if "LOG_BITMASK" not in values and version >= LOG_DISARMED_VERSION:
        return advise_rest(setting="Set LOG_DISARMED to 1")
    if settings.family == "copter" and version in WHEN_DISARMED_VERSIONS:
        name = f"bit {LOG_WHEN_DISARMED_BIT} of LOG_BITMASK (log when disarmed)"
        if _is_set(settings, LOG_WHEN_DISARMED_BIT):
            return advise_rest(f"B{name[1:]} is set already")
        return advise_rest(setting=f"Set {name}")
    return advise_rest()


def _already_set(setting: str, rate: float | None, records: str) -> str:
    """Return the sentence for records that are missing or slow although the setting is made."""
    if rate is None:
        return f"{setting} set already, yet the log holds no {records}: the reason is not among its logging settings."
    return f"{setting} set already and no limit is near: the vehicle logs no faster than {rate:.1f} Hz."


# --- remedies ---------------------------------------------------------------------------------------------------

# Remedies for any firmware.
GENERAL_REMEDIES: Mapping[str, str] = {
    "gyro_bias": "Calibrate the gyro, and keep it still as it starts.",
    "accelerometer": "Calibrate the accelerometer in six positions.",
    "mounting": "Check the mounting and the orientation that is set, then calibrate the level.",
    "compass": "Calibrate the compass outdoors, away from iron.",
    "compass_mounting": "Check the orientation that is set for the compass, and calibrate it again.",
    "compass_wiring": "Check wiring and supply of the compass.",
    "interference": "Move the compass away from motors and power wires.",
    "vibration": "Balance propellers, check bearings and arms, mount the autopilot softer.",
    "declination": "Set the declination of the place.",
    "trim": "Calibrate the level, and correct a tilted mounting in the frame and not in software.",
    "gaps": "Use a faster memory card or log less.",
    "gnss": "Raise the antenna above power wires and transmitters.",
    "bus": "Check the sensor's connection, or fly on another unit.",
    "clock": "Log raw samples with their time of measurement, or fly on another unit.",
    "temperature": "Switch on, wait until the sensors are warm, then calibrate them and take off.",
}


class FirmwareRemedy(NamedTuple):
    """Remedy text that names a logged parameter ``{p}`` and its value ``{v}``.

    ``only``: the value of the parameter for which the remedy applies. A ``text`` that begins with a blank is appended
    to the general remedy; an empty one removes it.
    """

    fault: str
    parameter: str
    text: str
    only: float | None = None


# ``{slot}`` in a parameter's name is the slot of the compass in use.
FIRMWARE_REMEDIES: dict[str, tuple[FirmwareRemedy, ...]] = {
    "ArduPilot": (
        FirmwareRemedy("gyro_bias", "INS_GYR_CAL", "Set {p} to 1 and keep the vehicle still as it starts.", 0.0),
        FirmwareRemedy("mounting", "AHRS_ORIENTATION", "Compare the mounting with {p} {v}, then calibrate the level."),
        FirmwareRemedy(
            "compass_mounting", "COMPASS_ORIENT{slot}", "Compare the mounting with {p} {v}, then calibrate the compass."
        ),
        FirmwareRemedy("interference", "COMPASS_MOTCT", " Then repeat compassmot."),
        FirmwareRemedy("interference", "COMPASS_MOTCT", " Then run compassmot ({p} is 0).", 0.0),
        FirmwareRemedy("declination", "COMPASS_AUTODEC", "Set {p} to 1."),
        FirmwareRemedy("declination", "COMPASS_AUTODEC", "", 1.0),
        FirmwareRemedy(
            "temperature", "INS_TCAL1_ENABLE", "Calibrate over temperature: {p} is {v}, 2 learns from a cold start."
        ),
    ),
    "PX4": (
        FirmwareRemedy("mounting", "SENS_BOARD_ROT", "Compare the mounting with {p} {v}, then calibrate the level."),
        FirmwareRemedy(
            "compass_mounting", "CAL_MAG{slot}_ROT", "Compare the mounting with {p} {v}, then calibrate the compass."
        ),
        FirmwareRemedy("interference", "CAL_MAG_COMP_TYP", " {p} is 0: nothing compensates for them.", 0.0),
        FirmwareRemedy(
            "temperature", "TC_G_ENABLE", "Run the thermal calibration from a cold start ({p} is {v}; 1 uses it)."
        ),
    ),
}


def remedy(settings: VehicleSettings, fault: str, compass: int, device: str | None) -> str:
    """Return the remedy for a fault, empty if none is known.

    Only logged parameters are named. ``compass``, ``device``: index and device id of the compass in use.
    """
    if fault == "gaps" and settings.kind == "telemetry":
        return _SD_CARD.format(name=settings.name)
    text, values = GENERAL_REMEDIES.get(fault, ""), settings.values
    slot: object = slot_suffix(compass + 1) if settings.kind == "ArduPilot" else px4_slot_in_use(values, device)
    for known, template, words, only in FIRMWARE_REMEDIES.get(settings.kind, ()):
        name = template.format(slot=slot)
        if known == fault and name in values and only in (None, values[name]):
            said = words.format(p=name, v=f"{values[name]:g}")
            text = GENERAL_REMEDIES[fault] + said if said.startswith(" ") else said
    return text
