"""Which parameter tells the onboard estimator how late a receiver or compass is, what it was, and what it may be?

PX4 subtracts EKF2_GPS_DELAY from the record's stamp, since 2026 SENS_GPSn_DELAY (VehicleGPSPosition). ArduPilot's EKF
subtracts ``AP_GPS::get_lag`` from GPA.SMS: GPS_DELAY_MS, or where that is 0 the driver's own number, of u-blox by
hardware (AP_GPS_UBLOX.cpp). EKF2 of Copter 3.4 has EK2_GPS_DELAY instead.
The delay of a compass is 60 ms there, a constant (``magDelay_ms``); PX4 has EKF2_MAG_DELAY.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from attlog.flight.model import FlightLog, Gnss

U_BLOX_MS = {0x0004: 220.0, 0x0007: 120.0, 0x0008: 120.0, 0x0019: 120.0, 0x000A: 120.0}
"""By the upper half of the hardware number of ``u-blox 1 HW: 00080000``: 5 and 6, 7, M8, F9, M10."""
BY_DRIVER_MS = (50.0, 220.0)
"""What the drivers of all receivers take for their own delay lies between these (AP_GPS, ``get_lag``)."""


@dataclass(frozen=True, slots=True)
class DelayParameter:
    """``name`` was ``old`` ms when flown: the estimator took the delay for something from ``low`` to ``high`` ms.

    ``most`` ms is the end of its documented range. ``words``: how it was told.
    """

    name: str
    old: float
    low: float
    high: float
    most: float
    words: str


def of_receiver(log: FlightLog, receiver: Gnss, t: float) -> DelayParameter | str:
    """The parameter at ``t`` s, or a sentence why it is not known."""
    if log.firmware.name == "PX4":
        return _px4(log, receiver, t)
    if log.firmware.name == "ArduPilot":
        return _ardupilot(log, receiver, t)
    return "The log does not say which firmware flew."


def _known(log: FlightLog, name: str, t: float) -> float | None:
    value = log.param(name, t)
    return float(value) if isinstance(value, int | float) and value == value else None


def _px4(log: FlightLog, receiver: Gnss, t: float) -> DelayParameter | str:
    if _known(log, "SENS_GPS_MASK", t) and len(log.gnss) > 1:
        return "The autopilot blends its receivers (SENS_GPS_MASK), so no delay belongs to one of them."
    for name in (f"SENS_GPS{receiver.index}_DELAY", "EKF2_GPS_DELAY"):
        old = _known(log, name, t)
        if old is not None and (receiver.index == 0 or name.startswith("SENS")):
            return DelayParameter(name, old, old, old, 300.0, f"{name} says {old:.0f} ms")
    return "The log holds no delay parameter of this receiver."


def _ardupilot(log: FlightLog, receiver: Gnss, t: float) -> DelayParameter | str:
    slot = receiver.index + 1
    name = next((n for n in (f"GPS{slot}_DELAY_MS", f"GPS_DELAY_MS{'' if slot == 1 else slot}") if n in log.params), "")
    old = _known(log, name, t) if name else None
    second = _known(log, "EK2_GPS_DELAY", t)
    if old is None and second is None:
        return "The log holds no delay parameter of this receiver."
    if _known(log, "AHRS_EKF_TYPE", t) not in (2, 3):
        return "No EKF flew that takes a delay (AHRS_EKF_TYPE)."
    if receiver.received is None:
        return "GPA.SMS is not logged, from which the EKF subtracts the delay."
    if _known(log, "AHRS_EKF_TYPE", t) == 2 and second is not None:
        if old is None and slot == 1:
            return DelayParameter("EK2_GPS_DELAY", second, second, second, 250.0, f"EK2_GPS_DELAY says {second:.0f} ms")
        return "This version has both EK2_GPS_DELAY and GPS_DELAY_MS: the log does not say which one counted."
    if old is None:
        return "The log holds no delay parameter of this receiver."
    if old > 0:
        return DelayParameter(name, old, old, old, 250.0, f"{name} says {old:.0f} ms")
    assumed = _by_hardware(log, slot)
    if assumed is None:
        low, high = BY_DRIVER_MS
        return DelayParameter(
            name, old, low, high, 250.0, f"{name} 0 leaves it to the driver ({low:.0f} to {high:.0f})"
        )
    return DelayParameter(name, old, assumed, assumed, 250.0, f"{name} 0 stands for the driver's {assumed:.0f} ms")


def _by_hardware(log: FlightLog, slot: int) -> float | None:
    """The delay that ArduPilot's driver takes for a u-blox receiver, ms, where its text names the hardware."""
    for _, _, text in log.texts:
        found = re.match(rf"u-blox {slot} HW: ([0-9A-F]{{4}})([0-9A-F]{{4}})", text)
        if found:
            return U_BLOX_MS.get(int(found.group(1), 16))
    return None


COMPASS_MS = 60.0
"""ArduPilot's constant."""


def of_compass(log: FlightLog, t: float) -> DelayParameter | str:
    """What the estimator took at ``t`` s for the delay of a compass; ``most`` is 0 where no parameter sets it."""
    if log.firmware.name == "ArduPilot":
        return DelayParameter("", COMPASS_MS, 0.0, COMPASS_MS, 0.0, f"the EKF takes {COMPASS_MS:.0f} ms")
    old = _known(log, "EKF2_MAG_DELAY", t)
    if old is None:
        return "The log holds no parameter for the delay of a compass."
    return DelayParameter("EKF2_MAG_DELAY", old, old, old, 300.0, f"EKF2_MAG_DELAY says {old:.0f} ms")


def buffer(log: FlightLog, t: float) -> DelayParameter | None:
    """How long PX4's estimator keeps its past (since 1.14): no aid may be later. None where nothing is told."""
    old = _known(log, "EKF2_DELAY_MAX", t)
    return None if old is None else DelayParameter("EKF2_DELAY_MAX", old, old, old, 1000.0, "")
