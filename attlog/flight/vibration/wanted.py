"""Which parameters make a notch of the gyro, in the firmware that flew?

ArduPilot: ardupilot.org, "Throttle Based Dynamic Notch Setup" (INS_HNTCH_FREQ at hover, BW half of it, REF the hover
throttle) and "ESC Telemetry Based Harmonic Notch Setup" (REF 1, FREQ below the slowest rotor). PX4: docs.px4.io, "MC
Filter Tuning".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from attlog.flight.model import FlightLog

RANGES = {
    "INS_HNTCH_FREQ": (10.0, 400.0),
    "INS_HNTCH_BW": (5.0, 250.0),
    "INS_HNTCH_REF": (0.0, 1.0),
    "IMU_GYRO_NF0_FRQ": (0.0, 1000.0),
    "IMU_GYRO_NF0_BW": (0.0, 100.0),
    "IMU_GYRO_NF_FREQ": (0.0, 1000.0),
    "IMU_GYRO_NF_BW": (0.0, 100.0),
}
"""Documented ranges, the narrowest of any version."""
THROTTLE, RPM_SENSOR, ESC = 1, 2, 3
"""INS_HNTCH_MODE."""
DEFAULT_HARMONICS = 3
"""INS_HNTCH_HMNCS: the first and the second."""
BELOW_SLOWEST = 0.9
"""INS_HNTCH_FREQ of a notch that measures the rotors, of the slowest speed in flight: it goes no lower."""
DNF_ESC, DNF_FFT = 1, 2
"""Bits of IMU_GYRO_DNF_EN."""
PX4_WIDTH_HZ = 20.0
"""IMU_GYRO_NF0_BW by default, and the narrowest that is offered."""
FIXED = (
    ("INS_HNTCH_FREQ", "INS_HNTCH_BW"),
    ("IMU_GYRO_NF0_FRQ", "IMU_GYRO_NF0_BW"),
    ("IMU_GYRO_NF_FREQ", "IMU_GYRO_NF_BW"),
)
"""Parameters of centre and width."""


@dataclass(frozen=True, slots=True)
class WantedNotch:
    """A notch that would help: ``frequency`` Hz at the usual ``throttle`` (0 to 1, None where not logged), which
    ``follows`` throttle or rotors, the ``harmonic`` of the ``slowest`` rotor's Hz (None without), moving by ``spread``
    Hz in flight."""

    frequency: float
    follows: Literal["throttle", "rotors"]
    throttle: float | None = None
    harmonic: int = 0
    slowest: float | None = None
    spread: float = 0.0


def values_for(log: FlightLog, notch: WantedNotch) -> dict[str, tuple[float, str]]:
    """Value and unit of every parameter of a notch, also of those that are set so already; none where this firmware
    has no such notch or a value lies outside its documented range."""
    made = harmonic_notch(log, notch) if log.firmware.name == "ArduPilot" else px4_notch(log, notch)
    inside = all(low <= made[n][0] <= high for n, (low, high) in RANGES.items() if n in made)
    return made if inside else {}


def harmonic_notch(log: FlightLog, notch: WantedNotch) -> dict[str, tuple[float, str]]:
    """INS_HNTCH_*: those below ENABLE exist wherever it does, though a log names them only where it is 1."""
    if log.param("INS_HNTCH_ENABLE") is None:
        return {}
    harmonics = int(log.param("INS_HNTCH_HMNCS") or DEFAULT_HARMONICS)
    if notch.follows == "rotors" and notch.slowest is not None and log.rpm is not None:
        mode, reference = (ESC if log.rpm.source == "ESC" else RPM_SENSOR), 1.0
        frequency = float(np.floor(BELOW_SLOWEST * notch.slowest))
        harmonics |= 1 << max(notch.harmonic - 1, 0)
    else:
        hover = log.param("MOT_THST_HOVER")
        if not hover or not notch.throttle or not 0.0 < hover < 1.0:
            return {}
        mode, reference = THROTTLE, round(float(hover), 3)
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


def px4_notch(log: FlightLog, notch: WantedNotch) -> dict[str, tuple[float, str]]:
    """The dynamic notch where the autopilot measures what the peak follows, else a fixed one as wide as it moves."""
    dynamic = log.param("IMU_GYRO_DNF_EN")
    by_fft = (log.param("IMU_GYRO_FFT_EN") or 0.0) >= 1.0
    if notch.follows == "rotors" and dynamic is not None:
        return {"IMU_GYRO_DNF_EN": (float(int(dynamic) | DNF_ESC), "")}
    if by_fft and dynamic is not None:
        low, high = log.param("IMU_GYRO_FFT_MIN") or 0.0, log.param("IMU_GYRO_FFT_MAX") or np.inf
        return {"IMU_GYRO_DNF_EN": (float(int(dynamic) | DNF_FFT), "")} if low <= notch.frequency <= high else {}
    width = max(PX4_WIDTH_HZ, float(np.ceil(notch.spread)))
    names = next((n for n in FIXED[1:] if all(log.param(k) is not None for k in n)), None)
    if names is None or width > 0.5 * notch.frequency:
        return {}
    return {names[0]: (float(round(notch.frequency)), "Hz"), names[1]: (width, "Hz")}


def placed(values: dict[str, float]) -> tuple[str, float, float] | None:
    """Name, centre and width in Hz of the notch that parameters make, None where it has no fixed place."""
    return next(((f, values[f], values.get(w, 0.0)) for f, w in FIXED if f in values), None)


def after_reboot(values: dict[str, float]) -> str:
    """What must be set first; empty where all can be set at once."""
    if "INS_HNTCH_ENABLE" in values:
        return "Set INS_HNTCH_ENABLE and reboot first: only then do the others exist."
    return ""
