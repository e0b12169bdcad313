"""Which values can a quantity of a flight have at all?

Logs are damaged, and drivers, parameters and clocks go wrong: a height of 1e30 m or a
field of 1e34 T is a perfectly good float. Every value that a reader takes from a log is
held against this table where it enters (:class:`~attlog.flight.builder.LogBuilder`),
left out where it lies outside, and counted. The limits are those of sensors, of the
earth and of what flies, wide enough that no flight meets them; what is merely wrong is
the business of ``attlog/health``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base.limits import ACC_LIMIT_M_S2, GYRO_LIMIT_RAD_S, MAG_LIMIT_T

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Quantity:
    """``name`` in ``unit`` lies within ``low`` and ``high``, because of ``why``; NaN is no value and never outside."""

    name: str
    low: float
    high: float
    unit: str
    why: str

    def outside(self, x: Array) -> NDArray[np.bool_]:
        """Which values of x (any shape) are impossible."""
        beyond: NDArray[np.bool_] = (x < self.low) | (x > self.high)
        return beyond

    @property
    def limits(self) -> str:
        """The limits in words."""
        low, high = (f"{x:,.10g}".replace("-", "−") for x in (self.low, self.high))
        return f"{low} to {high} {self.unit}".rstrip()


def _symmetric(name: str, limit: float, unit: str, why: str) -> Quantity:
    return Quantity(name, -limit, limit, unit, why)


GYRO = _symmetric("gyro", GYRO_LIMIT_RAD_S, "rad/s", "no gyro of an autopilot measures beyond 4,000 deg/s")
ACC = _symmetric("accelerometer", ACC_LIMIT_M_S2, "m/s^2", "no accelerometer of an autopilot measures beyond 200 g")
FIELD = _symmetric("magnetic field", MAG_LIMIT_T, "T", "the earth's field is below 70 uT, and a compass ends near 5 mT")
TEMPERATURE = Quantity("sensor temperature", -100.0, 200.0, "degC", "no chip works there")

LATITUDE = _symmetric("GNSS latitude", 90.0, "deg", "poles")
LONGITUDE = _symmetric("GNSS longitude", 180.0, "deg", "date line")
HEIGHT = Quantity("GNSS height", -1_000.0, 100_000.0, "m", "the Dead Sea lies at −430 m, balloons burst below 54 km")
SPEED = _symmetric(
    "GNSS speed", 1_000.0, "m/s", "receivers stop at 515 m/s, and nothing with these autopilots is faster"
)
PLACE_ACCURACY = Quantity("GNSS position accuracy", 0.0, 1e5, "m", "worse is no position")
SPEED_ACCURACY = Quantity("GNSS speed accuracy", 0.0, 1e4, "m/s", "worse is no speed")
SATELLITES = Quantity("satellites", 0.0, 100.0, "", "no receiver uses more; 255 stands for unknown")
HDOP = Quantity("horizontal dilution of precision", 0.1, 50.0, "", "99.99 and more stand for unknown")
GNSS_YAW = _symmetric("GNSS heading", 2.0 * math.pi, "rad", "one turn")
ESTIMATED_YAW = _symmetric("estimated heading", 2.0 * math.pi, "rad", "one turn")

BARO = Quantity("barometric height", -5_000.0, 100_000.0, "m", "pressures between 1 and 1,800 hPa")
RANGE = Quantity("distance to the ground", 0.0, 5_000.0, "m", "no rangefinder of an autopilot reaches further")
AIRSPEED = Quantity("airspeed", -100.0, 1_000.0, "m/s", "no pitot tube of an autopilot measures more")
THROTTLE = _symmetric("throttle", 10.0, "", "1 is full")
RPM = _symmetric("rotor speed", 1e6, "rpm", "small motors reach 100,000, counted electrically 7 times that")
VOLTAGE = Quantity("battery voltage", 0.0, 1_000.0, "V", "no vehicle with these autopilots carries more")
CURRENT = _symmetric("battery current", 10_000.0, "A", "no battery of a vehicle gives more")
RATE_SETPOINT = _symmetric("rate set-point", 200.0, "rad/s", "twice what a gyro can measure")
ACC_BIAS = _symmetric("accelerometer bias", 10.0, "m/s^2", "estimators bound theirs far below 1 g")
GYRO_BIAS = _symmetric("gyro bias", 10.0, "rad/s", "estimators bound theirs below 0.5 rad/s")
VIBRATION = Quantity("vibration", 0.0, ACC_LIMIT_M_S2, "m/s^2", "no accelerometer measures more")
TEST_RATIO = Quantity("test ratio", 0.0, 1e6, "", "a thousand standard deviations, squared")
QUATERNION_NORM = Quantity(
    "norm of the quaternion", 0.95, 1.05, "", "an attitude has norm 1; float16 and integers of 16 bits keep it to 0.001"
)
EULER_DEG = _symmetric("Euler angle", 720.0, "deg", "two turns, as estimators that do not wrap write them")

CLOCK_US = Quantity(
    "boot clock", 0, 4_102_444_800_000_000, "us", "autopilots without a real clock count from 0, others end in 2100"
)
UTC_US = Quantity(
    "GNSS date",
    1_262_304_000_000_000,
    4_102_444_800_000_000,
    "us",
    "before 2010 no autopilot wrote such logs, and 2100 is not yet; a receiver whose week counter has turned over is "
    "1,024 weeks behind",
)

RAW_HZ, FUSED_HZ, AIDING_HZ = 40_000.0, 10_000.0, 500.0
"""Fastest records: a gyro's own samples (32 kHz), what a loop makes of them (8 kHz), GNSS and battery (100 Hz).

Faster ones have stamps of another unit: a log in ms read as us is a thousand times too fast.
"""
LONGEST_S = 3 * 86_400.0
"""What lies further from the first sample is of another flight, or its time is false: boats run for a day."""
ENOUGH_FOR_A_RATE = 20
"""Fewer records in a burst tell no rate."""
