"""Parameters of the onboard estimator's aids: delays, noise, gates, and requirements on GNSS."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from attlog.flight.limits import documented_range
from attlog.flight.model import FlightLog, Gnss

# --- delays ------------------------------------------------------------------------------------------------------
#
# PX4 subtracts EKF2_GPS_DELAY from the record's stamp, since 2026 SENS_GPSn_DELAY (VehicleGPSPosition). ArduPilot's EKF
# subtracts ``AP_GPS::get_lag`` from GPA.SMS: GPS_DELAY_MS, or if it is 0 the driver's default, which for u-blox depends
# on the hardware (AP_GPS_UBLOX.cpp). EKF2 of Copter 3.4 has EK2_GPS_DELAY instead. A compass is delayed by the constant
# ``magDelay_ms`` (60 ms) in ArduPilot, and by EKF2_MAG_DELAY in PX4.

# Default delay by the upper half of the hardware number (``u-blox 1 HW: 00080000``): u-blox 5 and 6, 7, M8, F9, M10.
UBLOX_DELAY_MS = {0x0004: 220.0, 0x0007: 120.0, 0x0008: 120.0, 0x0019: 120.0, 0x000A: 120.0}
# Range of the default delays of all drivers (AP_GPS, ``get_lag``).
DRIVER_DELAY_MS = (50.0, 220.0)


class DelayParameter(NamedTuple):
    """Delay parameter ``name`` of an aid, with its logged value ``old`` in ms.

    ``low`` to ``high`` ms: delay that the estimator applied. ``most`` ms: documented maximum. ``words``: how the delay
    was set.
    """

    name: str
    old: float
    low: float
    high: float
    most: float
    words: str


def gnss_delay_parameter(log: FlightLog, receiver: Gnss, t: float) -> DelayParameter | str:
    """Return the delay parameter of a receiver at ``t`` s, or the reason why it is unknown."""
    if log.firmware.name == "PX4":
        return _px4_delay(log, receiver, t)
    if log.firmware.name == "ArduPilot":
        return _ardupilot_delay(log, receiver, t)
    return "The log does not say which firmware flew."


def _known(log: FlightLog, name: str, t: float) -> float | None:
    value = log.param(name, t)
    return float(value) if isinstance(value, int | float) and value == value else None


def _px4_delay(log: FlightLog, receiver: Gnss, t: float) -> DelayParameter | str:
    if _known(log, "SENS_GPS_MASK", t) and len(log.gnss) > 1:
        return "The autopilot blends its receivers (SENS_GPS_MASK), so no delay belongs to one of them."
    for name in (f"SENS_GPS{receiver.index}_DELAY", "EKF2_GPS_DELAY"):
        old = _known(log, name, t)
        if old is not None and (receiver.index == 0 or name.startswith("SENS")):
            return DelayParameter(name, old, old, old, 300.0, f"{name} says {old:.0f} ms")
    return "The log holds no delay parameter of this receiver."


def _ardupilot_delay(log: FlightLog, receiver: Gnss, t: float) -> DelayParameter | str:
    slot = receiver.index + 1
    name = next(
        (n for n in (f"GPS{slot}_DELAY_MS", f"GPS_DELAY_MS{'' if slot == 1 else slot}") if n in log.parameters.lines),
        "",
    )
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
        low, high = DRIVER_DELAY_MS
        return DelayParameter(
            name, old, low, high, 250.0, f"{name} 0 leaves it to the driver ({low:.0f} to {high:.0f})"
        )
    return DelayParameter(name, old, assumed, assumed, 250.0, f"{name} 0 stands for the driver's {assumed:.0f} ms")


def _by_hardware(log: FlightLog, slot: int) -> float | None:
    """Return the driver's default delay in ms of a u-blox receiver, None if its hardware is unknown."""
    for _, _, text in log.texts:
        found = re.match(rf"u-blox {slot} HW: ([0-9A-F]{{4}})([0-9A-F]{{4}})", text)
        if found:
            return UBLOX_DELAY_MS.get(int(found.group(1), 16))
    return None


# Compass delay of ArduPilot's EKF (``magDelay_ms``).
COMPASS_MS = 60.0


def of_compass(log: FlightLog, t: float) -> DelayParameter | str:
    """Return the delay parameter of a compass at ``t`` s, or the reason why it is unknown.

    ``most`` is 0 for ArduPilot, where no parameter sets the delay.
    """
    if log.firmware.name == "ArduPilot":
        return DelayParameter("", COMPASS_MS, 0.0, COMPASS_MS, 0.0, f"the EKF takes {COMPASS_MS:.0f} ms")
    old = _known(log, "EKF2_MAG_DELAY", t)
    if old is None:
        return "The log holds no parameter for the delay of a compass."
    return DelayParameter("EKF2_MAG_DELAY", old, old, old, 300.0, f"EKF2_MAG_DELAY says {old:.0f} ms")


def buffer(log: FlightLog, t: float) -> DelayParameter | None:
    """Return EKF2_DELAY_MAX (PX4 since 1.14), the largest delay of any aid; None if not logged."""
    old = _known(log, "EKF2_DELAY_MAX", t)
    return None if old is None else DelayParameter("EKF2_DELAY_MAX", old, old, old, 1000.0, "")


# --- noise and gates ---------------------------------------------------------------------------------------------

# Parts of the names of an aid's noise and gate parameters.
PX4_AIDS = {"compass": "MAG", "velocity": "GPS_V", "position": "GPS_P", "height": "BARO"}
ARDUPILOT_AIDS = {
    aid: (noise, gate)
    for aid, noise, gate in zip(PX4_AIDS, ("MAG", "VELNE", "POSNE", "ALT"), ("MAG", "VEL", "POS", "HGT"), strict=True)
}
# Number of the EKF in parameter names, by the prefix of its records.
EKF_NUMBERS = {"NK": 2, "XK": 3}


class NoiseParameter(NamedTuple):
    """Noise parameter ``name`` of an aid: logged value ``old``, documented range, ``gate`` in standard deviations."""

    name: str
    old: float
    low: float
    high: float
    gate: float


def noise_parameter(log: FlightLog, aid: str, source: str) -> NoiseParameter | None:
    """Return the noise parameter of an aid, None if noise or gate are not logged.

    ``source``: record of its test ratio, which identifies ArduPilot's EKF2 or EKF3.
    """
    if log.firmware.name == "PX4" and aid in PX4_AIDS:
        name, gate, unit = f"EKF2_{PX4_AIDS[aid]}_NOISE", f"EKF2_{PX4_AIDS[aid]}_GATE", 1.0
    elif log.firmware.name != "PX4" and source[:2] in EKF_NUMBERS and aid in ARDUPILOT_AIDS:
        prefix, (noise, test) = f"EK{EKF_NUMBERS[source[:2]]}", ARDUPILOT_AIDS[aid]
        name, gate, unit = f"{prefix}_{noise}_M_NSE", f"{prefix}_{test}_I_GATE", 0.01
    else:
        return None
    old, sigmas, limits = log.param(name), log.param(gate), documented_range(name)
    if limits is None or old is None or sigmas is None or not (0.0 < old < math.inf and 0.0 < sigmas < math.inf):
        return None
    return NoiseParameter(name, float(old), *limits, float(sigmas) * unit)


NO_TEST_RATIOS = {
    "PX4": "No estimator_status in flight: set bit 0 of SDLOG_PROFILE to log test ratios.",
    "ArduPilot": "No XKF4 or NKF4 in flight: ATTITUDE of LOG_BITMASK logs test ratios.",
    "": "The log holds no test ratios of an EKF.",
}
# Messages with test ratios in telemetry.
SENT_TEST_RATIOS = {"PX4": "ESTIMATOR_STATUS", "ArduPilot": "EKF_STATUS_REPORT (SRn_EXTRA3 sets its rate)"}
# Parameters that every ArduPilot with an EKF has.
EKF_PARAMETERS = ("AHRS_EKF_", "EKF_", "EK2_", "EK3_")


def advise_test_ratios(log: FlightLog) -> str:
    """Return the advice on logging test ratios, or why there are none."""
    name = log.firmware.name
    if log.format in ("tlog", "mavlink") and name in SENT_TEST_RATIOS:
        return f"No {SENT_TEST_RATIOS[name]} in flight."
    if (
        name == "ArduPilot"
        and log.parameters.lines
        and not any(n.startswith(EKF_PARAMETERS) for n in log.parameters.lines)
    ):
        return "This firmware has no EKF: there are no test ratios."
    return NO_TEST_RATIOS.get(name, NO_TEST_RATIOS[""])


# --- requirements on GNSS ----------------------------------------------------------------------------------------


class GnssRequirements(NamedTuple):
    """Requirements of an estimator on GNSS: satellites, HDOP, accuracy of ``speed`` m/s and ``place`` m."""

    satellites: float
    hdop: float
    speed: float
    place: float
    source: str


PX4_REQUIREMENTS = GnssRequirements(
    6, 2.5, 0.5, 3.0, "EKF2_REQ_NSATS, EKF2_REQ_PDOP, EKF2_REQ_SACC, EKF2_REQ_EPH of PX4"
)
ARDUPILOT_REQUIREMENTS = GnssRequirements(6, 2.5, 1.0, 5.0, "calcGpsGoodToAlign of ArduPilot's EKF3")


def gnss_requirements(log: FlightLog) -> GnssRequirements:
    """Return the default GNSS requirements of the log's firmware."""
    return PX4_REQUIREMENTS if log.firmware.name == "PX4" else ARDUPILOT_REQUIREMENTS
