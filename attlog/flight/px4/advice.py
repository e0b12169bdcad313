"""PX4's logging settings: SDLOG_PROFILE, SDLOG_MODE and the topic list on the SD card; sdlog2 before them.

Source: ``src/modules/logger/params.c`` and ``logged_topics.cpp`` of 1.6 to 1.16,
``src/modules/sdlog2/params.c``. SDLOG_PROFILE is a bit mask since 1.8; its bit 0
logged ``sensor_combined`` at 10 Hz before 1.12 and at full rate since.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from attlog.flight.advice import What, bits_of, stand_still, version_number

DEFAULT, REPLAY, HIGH_RATE, GYRO_FIFO, ACCEL_FIFO = 0, 1, 4, 8, 9
"""Bits of SDLOG_PROFILE."""
TOPICS_FILE = "etc/logging/logger_topics.txt on the SD card"
FROM_BOOT = (1, 2)
"""Values of SDLOG_MODE with which the log begins at boot."""
SDLOG2_HZ = 200


@dataclass(frozen=True, slots=True)
class Px4Logging:
    """Settings of the ULog logger: the version's text and the parameters at boot (may be empty)."""

    version: str
    values: Mapping[str, float]

    @property
    def profile(self) -> int | None:
        """SDLOG_PROFILE as a mask, None where the log does not tell."""
        return bits_of(self.values.get("SDLOG_PROFILE"))

    @property
    def by_file(self) -> bool:
        """Whether this version has no bits to choose topics with: before 1.8."""
        if (0, 0) < version_number(self.version) < (1, 8):
            return True
        return bool(self.values) and "SDLOG_PROFILE" not in self.values

    def advice(self, what: What, rate: float | None = None) -> str:
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
            return stand_still(setting="Start the logger at boot (logger start -e)")
        mode = self.values.get("SDLOG_MODE")
        if mode in FROM_BOOT:
            return stand_still(f"SDLOG_MODE is {mode:g} already")
        return stand_still(setting="Set SDLOG_MODE to 1")


@dataclass(frozen=True, slots=True)
class Sdlog2Logging:
    """Settings of sdlog2, the logger before ULog: one rate for everything."""

    values: Mapping[str, float]

    def advice(self, what: What, rate: float | None = None) -> str:
        """What would log ``what``; see :class:`attlog.flight.advice.Logging`."""
        if what == "rest":
            return stand_still(setting="Start the logger at boot (sdlog2 start -e)")
        if what == "mag":
            return "Connect and calibrate a compass."
        if self.values.get("SDLOG_RATE", -1.0) >= SDLOG2_HZ:
            return f"SDLOG_RATE is {self.values['SDLOG_RATE']:g} Hz already: the board logs no faster."
        by_parameter = f"Set SDLOG_RATE to {SDLOG2_HZ}" if "SDLOG_RATE" in self.values else "Raise the log rate"
        return f"{by_parameter} (sdlog2 start -r {SDLOG2_HZ})."


@dataclass(frozen=True, slots=True)
class OtherLogging:
    """A ULog of a program that is no autopilot: there is nothing to set, so its name is all that is told."""

    program: str

    def advice(self, what: What, rate: float | None = None) -> str:
        """That it is no autopilot, where inertial data are missing; nothing else."""
        return f"{self.program} wrote it, which is no autopilot that attlog knows." if what == "imu" else ""
