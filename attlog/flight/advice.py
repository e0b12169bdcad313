"""What a vehicle's logging settings are asked for; each firmware answers in its own folder."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

LoggingNeed = Literal["imu", "fast_imu", "attitude", "mag", "rest"]
"""Inertial data at all, inertial data faster than now, the attitude that flew, a magnetometer, time before arming."""

ADVISED_REST_S = 30


class LoggingAdvice(Protocol):
    """The logging settings of the vehicle that wrote a log."""

    def advice(self, what: LoggingNeed, rate: float | None = None) -> str:
        """A sentence on what would log ``what``; ``rate`` (Hz) of the records that are there, None without any.

        Never names a setting that is already made or that this version does not have.
        """
        ...


def advise_rest(why: str = "", setting: str = "") -> str:
    """The advice to rest: after a ``setting`` that is missing, or because (``why``) none is."""
    how = f"let the vehicle stand still with motors off for {ADVISED_REST_S} s"
    if setting:
        return f"{setting} and {how}."
    return f"{why}: {how}." if why else f"{how[0].upper()}{how[1:]}."


def version_number(version: str) -> tuple[int, int]:
    """Major and minor number in a version text, (0, 0) where it holds none."""
    match = re.search(r"(\d+)\.(\d+)", version)
    return (int(match[1]), int(match[2])) if match else (0, 0)


def bit_mask(value: float | None) -> int | None:
    """A bit mask from a parameter's value (two's complement where it is negative), None where it is unknown."""
    return None if value is None or not abs(value) < 2**53 else int(value)


# ArduPilot's logging settings: LOG_BITMASK of each vehicle, rate limits, and logging before arming.
#
# Bits: the parameter documentation of each vehicle (``@Bitmask`` of LOG_BITMASK in
# ArduCopter, ArduPlane, Rover, ArduSub, Blimp and AntennaTracker ``Parameters.cpp``;
# shown at ardupilot.org/copter/docs/parameters.html and its sisters). Limits and
# LOG_DISARMED: ``libraries/AP_Logger/AP_Logger.cpp``.


@dataclass(frozen=True, slots=True)
class LogBits:
    """Bits of LOG_BITMASK. ``fast_imu`` and ``raw_imu`` since 3.4, None where the vehicle has none.

    Copters log ``imu`` at 25 Hz (50 Hz before 3.4) and ``fast_imu`` in every main loop;
    planes and rovers log ``imu`` in every main loop.
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
LOG_WHEN_DISARMED_BIT = 16
"""Bit of LOG_BITMASK that stood for LOG_DISARMED in Copter 3.2 and 3.3 and the first Sub."""
SLOW_IMU, SLOW_IMU_HZ = ("copter", "sub", "blimp"), 25.0
"""Families that log ``imu`` in a task of its own at 25 Hz, and not in every main loop."""
LIMITED_RATE_SHARE = (0.6, 1.3)
"""A rate between these parts of a limit is made by the limit: it takes every k-th record of its source."""
FILE_BACKEND, MAVLINK_BACKEND, BLOCK_BACKEND = 1, 2, 4
"""Bits of LOG_BACKEND_TYPE."""
RATE_LIMITS = (
    ("LOG_FILE_RATEMAX", FILE_BACKEND),
    ("LOG_MAV_RATEMAX", MAVLINK_BACKEND),
    ("LOG_BLK_RATEMAX", BLOCK_BACKEND),
)


@dataclass(frozen=True, slots=True)
class ArduPilotLogging:
    """Logging settings of one vehicle: its firmware family, version text and parameters at boot (may be empty)."""

    family: str
    version: str
    values: Mapping[str, float]

    @property
    def modern(self) -> bool:
        """Whether this is 3.4 or later, by its parameters where the log holds them."""
        if "LOG_BITMASK" in self.values:
            return "LOG_DISARMED" in self.values
        return version_number(self.version) >= (3, 4)

    def is_set(self, bit: int | None) -> bool:
        """Whether LOG_BITMASK holds a bit; False where it is unknown. Before 3.2 it had 16 bits."""
        mask = bit_mask(self.values.get("LOG_BITMASK"))
        if mask is None or bit is None or (bit >= 16 and (0, 0) < version_number(self.version) < (3, 2)):
            return False
        return bool(mask >> bit & 1)

    def advice(self, what: LoggingNeed, rate: float | None = None) -> str:
        """What would log ``what``; see :class:`attlog.flight.advice.Logging`."""
        if what == "rest":
            return self.rest()
        bits = LOG_BITS.get(self.family)
        if bits is None:
            named = {"attitude": "fast attitude", "mag": "compass"}.get(what, "IMU")
            return f"Set the bit of LOG_BITMASK for {named}; its number depends on the vehicle."
        if what == "mag":
            return self.mag(bits)
        if what == "attitude":
            return self.attitude(bits, rate)
        if rate is None and not any(self.is_set(b) for b in (bits.imu, bits.fast_imu, bits.raw_imu)):
            faster = f" or bit {bits.fast_imu} (fast IMU)" if bits.fast_imu is not None and self.modern else ""
            return f"Set bit {bits.imu} of LOG_BITMASK (IMU){faster}."
        return self.inertial(bits, rate)

    def attitude(self, bits: LogBits, rate: float | None) -> str:
        """What would log the attitude that flew, faster than now."""
        name = "attitude" if self.family == "tracker" else "fast attitude"
        limited = self.limits(rate)
        if self.is_set(bits.attitude):
            return limited or setting_already_made(f"Bit {bits.attitude} of LOG_BITMASK ({name}) is", rate, "attitude")
        return f"Set bit {bits.attitude} of LOG_BITMASK ({name}). {limited}".rstrip()

    def inertial(self, bits: LogBits, rate: float | None) -> str:
        """What would log inertial data, or log it faster than now."""
        known = [(b, n) for b, n in ((bits.fast_imu, "fast IMU"), (bits.raw_imu, "raw IMU")) if b is not None]
        slow_source = self.family in SLOW_IMU and not any(self.is_set(b) for b, _ in known)
        limited = "" if slow_source and rate is not None and rate > 0.95 * SLOW_IMU_HZ else self.limits(rate)
        if limited:
            return limited
        missing = [f"bit {b} ({n})" for b, n in known if not self.is_set(b)]
        on = [str(b) for b in (bits.imu, *(b for b, _ in known)) if self.is_set(b)]
        if rate is not None and missing:
            if self.modern:
                return f"Set {' or '.join(missing)} of LOG_BITMASK."
            return f"ArduPilot 3.4 and later can log the IMU faster: {' or '.join(missing)} of LOG_BITMASK."
        if not on:
            return "No bit of LOG_BITMASK logs the IMU faster."
        which = f"Bit {on[0]}" if len(on) == 1 else f"Bits {', '.join(on[:-1])} and {on[-1]}"
        return setting_already_made(f"{which} of LOG_BITMASK (IMU) {'is' if len(on) == 1 else 'are'}", rate, "IMU data")

    def limits(self, rate: float | None) -> str:
        """The limits that hold the records at this rate, empty where none does."""
        backends = bit_mask(self.values.get("LOG_BACKEND_TYPE"))
        named = [(n, self.values.get(n, 0.0)) for n, b in RATE_LIMITS if backends is None or backends & b]
        named.append(("LOG_DARM_RATEMAX", self.values.get("LOG_DARM_RATEMAX", 0.0)))
        active = [(n, v) for n, v in named if v > 0]
        if rate is None or not any(LIMITED_RATE_SHARE[0] * v <= rate <= LIMITED_RATE_SHARE[1] * v for _, v in active):
            return ""
        told = " and ".join(
            f"{n} {v:g} Hz" + (" (while disarmed)" if n == "LOG_DARM_RATEMAX" else "") for n, v in active
        )
        limit, them = ("limits", "it") if len(active) == 1 else ("limit", "them")
        return f"{told} {limit} the rate: set {them} to 0."

    def mag(self, bits: LogBits) -> str:
        """What would log a compass."""
        for name in ("COMPASS_ENABLE", "MAG_ENABLE"):
            if self.values.get(name, 1.0) == 0:
                return f"Set {name} to 1."
        if not self.is_set(bits.mag):
            return f"Set bit {bits.mag} of LOG_BITMASK (compass)."
        return f"Bit {bits.mag} of LOG_BITMASK (compass) is set already: connect and calibrate a compass."

    def rest(self) -> str:
        """What would log the vehicle at rest with motors off."""
        if "LOG_DISARMED" in self.values:
            now = int(self.values["LOG_DISARMED"])
            return (
                advise_rest(f"LOG_DISARMED is {now} already") if now else advise_rest(setting="Set LOG_DISARMED to 1")
            )
        number = version_number(self.version)
        if "LOG_BITMASK" not in self.values and number >= (3, 4):
            return advise_rest(setting="Set LOG_DISARMED to 1")
        if self.family == "copter" and number in ((3, 2), (3, 3)):
            name = f"bit {LOG_WHEN_DISARMED_BIT} of LOG_BITMASK (log when disarmed)"
            if self.is_set(LOG_WHEN_DISARMED_BIT):
                return advise_rest(f"B{name[1:]} is set already")
            return advise_rest(setting=f"Set {name}")
        return advise_rest()


def setting_already_made(what: str, rate: float | None, records: str) -> str:
    """The sentence where the setting is made and the records are missing or slow all the same."""
    if rate is None:
        return f"{what} set already, yet the log holds no {records}: the reason is not among its logging settings."
    return f"{what} set already and no limit is near: the vehicle logs no faster than {rate:.1f} Hz."


# PX4's logging settings: SDLOG_PROFILE, SDLOG_MODE and the topic list on the SD card.
#
# Source: ``src/modules/logger/params.c`` and ``logged_topics.cpp`` of 1.6 to 1.16. SDLOG_PROFILE is a bit mask since 1.8; its bit 0
# logged ``sensor_combined`` at 10 Hz before 1.12 and at full rate since.

DEFAULT, REPLAY, HIGH_RATE, GYRO_FIFO, ACCEL_FIFO = 0, 1, 4, 8, 9
"""Bits of SDLOG_PROFILE."""
TOPICS_FILE = "etc/logging/logger_topics.txt on the SD card"
LOG_FROM_BOOT_MODES = (1, 2)
"""Values of SDLOG_MODE with which the log begins at boot."""


@dataclass(frozen=True, slots=True)
class Px4Logging:
    """Settings of the ULog logger: the version's text and the parameters at boot (may be empty)."""

    version: str
    values: Mapping[str, float]

    @property
    def profile(self) -> int | None:
        """SDLOG_PROFILE as a mask, None where the log does not tell."""
        return bit_mask(self.values.get("SDLOG_PROFILE"))

    @property
    def by_file(self) -> bool:
        """Whether this version has no bits to choose topics with: before 1.8."""
        if (0, 0) < version_number(self.version) < (1, 8):
            return True
        return bool(self.values) and "SDLOG_PROFILE" not in self.values

    def advice(self, what: LoggingNeed, rate: float | None = None) -> str:
        """What would log ``what``; see :class:`attlog.flight.advice.Logging`."""
        if what == "rest":
            return self.rest()
        if what == "mag":
            return self.mag()
        topic = "vehicle_attitude" if what == "attitude" else "sensor_combined"
        if self.by_file:
            return f"Name {topic} at full rate (interval 0) in {TOPICS_FILE}."
        if what == "attitude":
            wanted = [(HIGH_RATE, "high rate")]
        elif (0, 0) < version_number(self.version) < (1, 12):
            wanted = [(REPLAY, "estimator replay"), (HIGH_RATE, "high rate")]
        else:
            wanted = [(DEFAULT, "default set"), (REPLAY, "estimator replay"), (HIGH_RATE, "high rate")]
        on = [(bit, name) for bit, name in wanted if self.profile is not None and self.profile >> bit & 1]
        if not on:
            bit, name = wanted[0]
            return f"Set bit {bit} of SDLOG_PROFILE ({name}), which logs {topic} at full rate."
        bit, name = on[0]
        text = f"Bit {bit} of SDLOG_PROFILE ({name}) is set already and logs {topic} at full rate"
        if rate is None:
            return f"{text}, unless {TOPICS_FILE} replaces the set."
        return f"{text}: the sensors give no more than {rate:.1f} Hz, or {TOPICS_FILE} replaces the set."

    def mag(self) -> str:
        """What would log a compass."""
        if self.values.get("SYS_HAS_MAG", 1.0) == 0:
            return "Set SYS_HAS_MAG to 1."
        return "Connect and calibrate a compass."

    def rest(self) -> str:
        """What would log the vehicle at rest with motors off."""
        if self.values and "SDLOG_MODE" not in self.values:
            return advise_rest(setting="Start the logger at boot (logger start -e)")
        mode = self.values.get("SDLOG_MODE")
        if mode in LOG_FROM_BOOT_MODES:
            return advise_rest(f"SDLOG_MODE is {mode:g} already")
        return advise_rest(setting="Set SDLOG_MODE to 1")


@dataclass(frozen=True, slots=True)
class OtherLogging:
    """A ULog of a program that is no autopilot: there is nothing to set, so its name is all that is told."""

    program: str

    def advice(self, what: LoggingNeed, rate: float | None = None) -> str:
        """That it is no autopilot, where inertial data are missing; nothing else."""
        return f"{self.program} wrote it, which is no autopilot that attlog knows." if what == "imu" else ""


# What a telemetry log lacks is usually in the vehicle's own log.

LOG_FILE_SUFFIX = {"PX4": ".ulg", "ArduPilot": ".bin"}


@dataclass(frozen=True, slots=True)
class TelemetryLogging:
    """Telemetry of an autopilot."""

    firmware: str

    def advice(self, what: LoggingNeed, rate: float | None = None) -> str:
        """What would log ``what``; see :class:`attlog.flight.advice.Logging`."""
        if what == "rest":
            return advise_rest("Record telemetry before arming")
        if what == "mag":
            return "Connect and calibrate a compass."
        kind = LOG_FILE_SUFFIX.get(self.firmware, ".bin or .ulg")
        return f"Take the log from the vehicle's SD card ({kind}) instead of telemetry."


# What a bag lacks has to be recorded by another topic.


@dataclass(frozen=True, slots=True)
class BagLogging:
    """Messages of sensors in a bag."""

    def advice(self, what: LoggingNeed, rate: float | None = None) -> str:
        """What would record ``what``; see :class:`attlog.flight.advice.Logging`."""
        if what == "rest":
            return advise_rest("Begin the bag before arming")
        if what == "mag":
            return "Record a topic of sensor_msgs/MagneticField."
        return "Record the IMU's topic (sensor_msgs/Imu) at its full rate."


# What a pilot does about a fault of sensors or estimator; each firmware adds its own settings.

Fault = Literal[
    "gyro_bias",
    "accelerometer",
    "mounting",
    "compass",
    "compass_mounting",
    "compass_wiring",
    "interference",
    "vibration",
    "declination",
    "trim",
    "gaps",
    "gnss",
    "bus",
    "clock",
    "gyro_scale",
    "temperature",
]
"""What a remedy is asked for."""

GENERAL_REMEDIES: Mapping[Fault, str] = {
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
    "gyro_scale": "Fly on another unit, and replace this one.",
    "temperature": "Switch on, wait until the sensors are warm, then calibrate them and take off.",
}
"""Where nothing is known of the firmware."""
