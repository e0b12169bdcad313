"""Notch filters of the gyro: active ones, and parameters for a new one."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from attlog.flight.advice import GYRO_FIFO
from attlog.flight.limits import documented_range
from attlog.flight.model import FlightLog
from attlog.flight.vehicle import version_number

# --- notches that flew -------------------------------------------------------------------------------------------

# INS_HNTCH_MODE of throttle; 2 (RPM sensor), 3 (ESC), 4 (FFT) and 5 (second RPM sensor) follow a measurement.
FOLLOWS_THROTTLE = 1


class ActiveNotch(NamedTuple):
    """Notch filter of the gyro at ``frequency`` Hz with ``width`` Hz.

    ``follows``: "throttle" or "measurement" (rotor speeds, FFT), empty for a fixed notch.
    """

    name: str
    frequency: float
    width: float
    follows: str

    def covers(self, frequency: float) -> bool:
        """Return whether a frequency lies in the stop band, True for a notch that follows a measurement."""
        return self.follows == "measurement" or abs(frequency - self.frequency) <= 0.5 * self.width


def active_notches(log: FlightLog) -> list[ActiveNotch]:
    """Return the notches that were enabled by the log's parameters."""
    found = []
    for group in ("INS_HNTCH", "INS_HNTC2"):
        frequency, width = log.param(f"{group}_FREQ"), log.param(f"{group}_BW")
        if (log.param(f"{group}_ENABLE") or 0.0) < 1.0 or frequency is None or width is None:
            continue
        mode, reference = log.param(f"{group}_MODE") or 0.0, log.param(f"{group}_REF") or 0.0
        follows = "" if mode == 0 or reference == 0 else "throttle" if mode == FOLLOWS_THROTTLE else "measurement"
        found.append(ActiveNotch(group, _at_hover(log, frequency, reference) if follows == "throttle" else frequency,
                           width, follows))  # fmt: skip
    frequency = log.param("INS_NOTCH_FREQ") or 0.0
    if (log.param("INS_NOTCH_ENABLE") or 0.0) >= 1.0 and frequency > 0.0:
        found.append(ActiveNotch("INS_NOTCH", frequency, log.param("INS_NOTCH_BW") or 0.0, ""))
    for frequency_name, width_name in (*FIXED_NOTCHES[1:], ("IMU_GYRO_NF1_FRQ", "IMU_GYRO_NF1_BW")):
        frequency = log.param(frequency_name) or 0.0
        if frequency > 0.0:
            found.append(ActiveNotch(frequency_name, frequency, log.param(width_name) or 0.0, ""))
    if (log.param("IMU_GYRO_DNF_EN") or 0.0) > 0.0:
        found.append(ActiveNotch("IMU_GYRO_DNF_EN", 0.0, log.param("IMU_GYRO_DNF_BW") or 0.0, "measurement"))
    return found


def _at_hover(log: FlightLog, frequency: float, reference: float) -> float:
    """Return the frequency of a throttle notch at the learned hover throttle (MOT_THST_HOVER)."""
    hover = log.param("MOT_THST_HOVER")
    return frequency * float(np.sqrt(hover / reference)) if hover and reference > 0.0 and hover > 0.0 else frequency


# --- notches that would help -------------------------------------------------------------------------------------
#
# ArduPilot: ardupilot.org, "Throttle Based Dynamic Notch Setup" (INS_HNTCH_FREQ at hover, BW half of it, REF the hover
# throttle) and "ESC Telemetry Based Harmonic Notch Setup" (REF 1, FREQ below the slowest rotor). PX4: docs.px4.io, "MC
# Filter Tuning".

# Values of INS_HNTCH_MODE.
THROTTLE_MODE, RPM_MODE, ESC_MODE = 1, 2, 3
# INS_HNTCH_HMNCS with the first and second harmonic.
DEFAULT_HARMONICS = 3
# INS_HNTCH_FREQ of a notch on rotor speed, as a share of the slowest speed in flight: the notch goes no lower.
BELOW_SLOWEST = 0.9
# Bits of IMU_GYRO_DNF_EN.
DNF_ESC, DNF_FFT = 1, 2
# Default of IMU_GYRO_NF0_BW, and the narrowest width offered.
PX4_WIDTH_HZ = 20.0
# Parameters of a fixed notch's centre and width.
FIXED_NOTCHES = (
    ("INS_HNTCH_FREQ", "INS_HNTCH_BW"),
    ("IMU_GYRO_NF0_FRQ", "IMU_GYRO_NF0_BW"),
    ("IMU_GYRO_NF_FREQ", "IMU_GYRO_NF_BW"),
)


class WantedNotch(NamedTuple):
    """Notch that would remove a peak at ``frequency`` Hz, at the usual ``throttle`` (0 to 1, None if not logged).

    ``follows``: throttle or rotor speed. ``harmonic``: multiple of the rotor speed, whose lowest value is ``slowest``
    Hz. ``spread``: variation of the peak in flight in Hz.
    """

    frequency: float
    follows: Literal["throttle", "rotors"]
    throttle: float | None = None
    harmonic: int = 0
    slowest: float | None = None
    spread: float = 0.0


def notch_parameters(log: FlightLog, notch: WantedNotch) -> dict[str, tuple[float, str]]:
    """Return value and unit of every parameter of a notch, including those already set.

    Empty if the firmware has no such notch or a value lies outside its documented range.
    """
    make = harmonic_notch_parameters if log.firmware.name == "ArduPilot" else px4_notch_parameters
    made = make(log, notch)
    limits = {name: documented_range(name) or (math.inf, -math.inf) for name in made}
    return made if all(low <= made[name][0] <= high for name, (low, high) in limits.items()) else {}


def harmonic_notch_parameters(log: FlightLog, notch: WantedNotch) -> dict[str, tuple[float, str]]:
    """Return the INS_HNTCH_* parameters of a notch, empty if the firmware has none.

    ArduPilot logs the others only while INS_HNTCH_ENABLE is 1.
    """
    if log.param("INS_HNTCH_ENABLE") is None:
        return {}
    harmonics = int(log.param("INS_HNTCH_HMNCS") or DEFAULT_HARMONICS)
    if notch.follows == "rotors" and notch.slowest is not None and log.power.rpm is not None:
        mode, reference = (ESC_MODE if log.power.rpm.source == "ESC" else RPM_MODE), 1.0
        frequency = float(np.floor(BELOW_SLOWEST * notch.slowest))
        harmonics |= 1 << max(notch.harmonic - 1, 0)
    else:
        hover = log.param("MOT_THST_HOVER")
        if not hover or not notch.throttle or not 0.0 < hover < 1.0:
            return {}
        mode, reference = THROTTLE_MODE, round(float(hover), 3)
        frequency = float(round(notch.frequency * float(np.sqrt(hover / notch.throttle))))
    made = {
        "INS_HNTCH_ENABLE": (1.0, ""),
        "INS_HNTCH_MODE": (float(mode), ""),
        "INS_HNTCH_FREQ": (frequency, "Hz"),
        "INS_HNTCH_BW": (float(round(0.5 * frequency)), "Hz"),
        "INS_HNTCH_REF": (reference, ""),
    }
    if log.param("INS_HNTCH_HMNCS") is not None or harmonics != DEFAULT_HARMONICS:
        made["INS_HNTCH_HMNCS"] = (float(harmonics), "")
    return made


def px4_notch_parameters(log: FlightLog, notch: WantedNotch) -> dict[str, tuple[float, str]]:
    """Return the parameters of PX4's dynamic notch, or of a fixed one.

    The dynamic notch serves peaks that follow rotor speed, and any peak with the onboard FFT. Empty if neither suits.
    """
    dynamic = log.param("IMU_GYRO_DNF_EN")
    by_fft = (log.param("IMU_GYRO_FFT_EN") or 0.0) >= 1.0
    if notch.follows == "rotors" and dynamic is not None:
        return {"IMU_GYRO_DNF_EN": (float(int(dynamic) | DNF_ESC), "")}
    if by_fft and dynamic is not None:
        low, high = log.param("IMU_GYRO_FFT_MIN") or 0.0, log.param("IMU_GYRO_FFT_MAX") or np.inf
        return {"IMU_GYRO_DNF_EN": (float(int(dynamic) | DNF_FFT), "")} if low <= notch.frequency <= high else {}
    width = max(PX4_WIDTH_HZ, float(np.ceil(notch.spread)))
    names = next((n for n in FIXED_NOTCHES[1:] if all(log.param(k) is not None for k in n)), None)
    if names is None or width > 0.5 * notch.frequency:
        return {}
    return {names[0]: (float(round(notch.frequency)), "Hz"), names[1]: (width, "Hz")}


def fixed_notch(values: dict[str, float]) -> tuple[str, float, float] | None:
    """Return the frequency parameter, centre and width in Hz of a notch, None without a centre frequency."""
    return next(((f, values[f], values.get(w, 0.0)) for f, w in FIXED_NOTCHES if f in values), None)


def advise_reboot(values: dict[str, float]) -> str:
    """Return the advice to enable the notch and reboot first, empty if not needed."""
    if "INS_HNTCH_ENABLE" in values:
        return "Set INS_HNTCH_ENABLE and reboot first: only then do the others exist."
    return ""


# --- logging of vibration ----------------------------------------------------------------------------------------

# Firmware whose vibration level is a difference of successive samples, which it can log at full rate.
DIFFERENCE_FIRMWARE = "PX4"
NO_LEVEL = {
    "PX4": "No vehicle_imu_status (PX4 1.11 and later) and no samples at full rate: vibration is not measured.",
    "ArduPilot": "No VIBE record, which ArduPilot 3.4 and later write with the IMU's bit of LOG_BITMASK.",
    "": "This log holds no vibration level of the autopilot, and its samples are too slow for one.",
}
FLIGHT_ADVICE = "fly two minutes with changes of throttle"


def filters_gyro(log: FlightLog) -> bool:
    """Return whether the firmware's notch parameters are known."""
    return log.firmware.name in ("PX4", "ArduPilot")


def measures_differences(log: FlightLog) -> bool:
    """Return whether the firmware's own level can be computed from the logged samples."""
    return log.firmware.name == DIFFERENCE_FIRMWARE


def advise_vibration_level(log: FlightLog) -> str:
    """Return the reason for a missing vibration level and the advice on logging it."""
    return NO_LEVEL.get(log.firmware.name, NO_LEVEL[""])


def advise_fast_gyro(log: FlightLog) -> str:
    """Return the advice on logging the gyro at the sensor's rate."""
    if log.firmware.name == "ArduPilot":
        mask = log.param("INS_LOG_BAT_MASK")
        if mask is None:
            return "ArduPilot 3.7 and later log bursts at full rate with INS_LOG_BAT_MASK 1."
        if mask == 0:
            return f"Set INS_LOG_BAT_MASK to 1, reboot and {FLIGHT_ADVICE}."
        return f"INS_LOG_BAT_MASK is set already: {FLIGHT_ADVICE}."
    if log.firmware.name != "PX4":
        return ""
    profile = log.param("SDLOG_PROFILE")
    if version_number(log.firmware.version) < (1, 12) or profile is None:
        return "PX4 1.12 and later log the gyro at full rate with bit 8 of SDLOG_PROFILE."
    if int(profile) >> GYRO_FIFO & 1:
        return f"Bit 8 of SDLOG_PROFILE is set already: {FLIGHT_ADVICE}."
    return f"Set bit 8 of SDLOG_PROFILE (gyro FIFO) and {FLIGHT_ADVICE}."
