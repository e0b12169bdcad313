"""ArduPilot's logging settings: LOG_BITMASK of each vehicle, rate limits, and logging before arming.

Bits: the parameter documentation of each vehicle (``@Bitmask`` of LOG_BITMASK in
ArduCopter, ArduPlane, Rover, ArduSub, Blimp and AntennaTracker ``Parameters.cpp``;
shown at ardupilot.org/copter/docs/parameters.html and its sisters). Limits and
LOG_DISARMED: ``libraries/AP_Logger/AP_Logger.cpp``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from attlog.flight.advice import What, bits_of, stand_still, version_number


@dataclass(frozen=True, slots=True)
class Bits:
    """Bits of LOG_BITMASK. ``fast_imu`` and ``raw_imu`` since 3.4, None where the vehicle has none.

    Copters log ``imu`` at 25 Hz (50 Hz before 3.4) and ``fast_imu`` in every main loop;
    planes and rovers log ``imu`` in every main loop.
    """

    attitude: int
    imu: int
    mag: int
    fast_imu: int | None = None
    raw_imu: int | None = None


BITS = {
    "copter": Bits(attitude=0, imu=7, mag=13, fast_imu=18, raw_imu=19),
    "sub": Bits(attitude=0, imu=7, mag=13, raw_imu=19),
    "plane": Bits(attitude=0, imu=7, mag=10, raw_imu=19),
    "rover": Bits(attitude=0, imu=7, mag=11, raw_imu=19),
    "blimp": Bits(attitude=0, imu=7, mag=13),
    "tracker": Bits(attitude=0, imu=3, mag=5),
}
WHEN_DISARMED = 16
"""Bit of LOG_BITMASK that stood for LOG_DISARMED in Copter 3.2 and 3.3 and the first Sub."""
SLOW_IMU, SLOW_IMU_HZ = ("copter", "sub", "blimp"), 25.0
"""Families that log ``imu`` in a task of its own at 25 Hz, and not in every main loop."""
NEAR_LIMIT = (0.6, 1.3)
"""A rate between these parts of a limit is made by the limit: it takes every k-th record of its source."""
FILE, MAVLINK, BLOCK = 1, 2, 4
"""Bits of LOG_BACKEND_TYPE."""
LIMITS = (("LOG_FILE_RATEMAX", FILE), ("LOG_MAV_RATEMAX", MAVLINK), ("LOG_BLK_RATEMAX", BLOCK))


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
        mask = bits_of(self.values.get("LOG_BITMASK"))
        if mask is None or bit is None or (bit >= 16 and (0, 0) < version_number(self.version) < (3, 2)):
            return False
        return bool(mask >> bit & 1)

    def advice(self, what: What, rate: float | None = None) -> str:
        """What would log ``what``; see :class:`attlog.flight.advice.Logging`."""
        if what == "rest":
            return self.rest()
        bits = BITS.get(self.family)
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

    def attitude(self, bits: Bits, rate: float | None) -> str:
        """What would log the attitude that flew, faster than now."""
        name = "attitude" if self.family == "tracker" else "fast attitude"
        limited = self.limits(rate)
        if self.is_set(bits.attitude):
            return limited or already(f"Bit {bits.attitude} of LOG_BITMASK ({name}) is", rate, "attitude")
        return f"Set bit {bits.attitude} of LOG_BITMASK ({name}). {limited}".rstrip()

    def inertial(self, bits: Bits, rate: float | None) -> str:
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
        return already(f"{which} of LOG_BITMASK (IMU) {'is' if len(on) == 1 else 'are'}", rate, "IMU data")

    def limits(self, rate: float | None) -> str:
        """The limits that hold the records at this rate, empty where none does."""
        backends = bits_of(self.values.get("LOG_BACKEND_TYPE"))
        named = [(n, self.values.get(n, 0.0)) for n, b in LIMITS if backends is None or backends & b]
        named.append(("LOG_DARM_RATEMAX", self.values.get("LOG_DARM_RATEMAX", 0.0)))
        active = [(n, v) for n, v in named if v > 0]
        if rate is None or not any(NEAR_LIMIT[0] * v <= rate <= NEAR_LIMIT[1] * v for _, v in active):
            return ""
        told = " and ".join(
            f"{n} {v:g} Hz" + (" (while disarmed)" if n == "LOG_DARM_RATEMAX" else "") for n, v in active
        )
        limit, them = ("limits", "it") if len(active) == 1 else ("limit", "them")
        return f"{told} {limit} the rate: set {them} to 0."

    def mag(self, bits: Bits) -> str:
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
                stand_still(f"LOG_DISARMED is {now} already") if now else stand_still(setting="Set LOG_DISARMED to 1")
            )
        number = version_number(self.version)
        if "LOG_BITMASK" not in self.values and number >= (3, 4):
            return stand_still(setting="Set LOG_DISARMED to 1")
        if self.family == "copter" and number in ((3, 2), (3, 3)):
            name = f"bit {WHEN_DISARMED} of LOG_BITMASK (log when disarmed)"
            if self.is_set(WHEN_DISARMED):
                return stand_still(f"B{name[1:]} is set already")
            return stand_still(setting=f"Set {name}")
        return stand_still()


def already(what: str, rate: float | None, records: str) -> str:
    """The sentence where the setting is made and the records are missing or slow all the same."""
    if rate is None:
        return f"{what} set already, yet the log holds no {records}: the reason is not among its logging settings."
    return f"{what} set already and no limit is near: the vehicle logs no faster than {rate:.1f} Hz."
