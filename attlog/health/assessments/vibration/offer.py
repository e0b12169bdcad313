"""Which parameters make a notch for a peak of the gyro, and which settings would log one?

ArduPilot: ardupilot.org, "Throttle Based Dynamic Notch Setup" (INS_HNTCH_FREQ at hover, BW half of it, REF the hover
throttle) and "ESC Telemetry Based Harmonic Notch Setup" (REF 1, FREQ below the slowest rotor). PX4: docs.px4.io, "MC
Filter Tuning".
"""

from __future__ import annotations

import numpy as np

from attlog.flight.advice import version_number
from attlog.flight.model import FlightLog
from attlog.flight.px4.advice import GYRO_FIFO
from attlog.health.assessments.model import Setting
from attlog.health.assessments.vibration.origin import at_windows, rotors
from attlog.health.assessments.vibration.peaks import Peak, track
from attlog.health.assessments.vibration.spectra import Spectra

RANGES = {
    "INS_HNTCH_FREQ": (10.0, 400.0), "INS_HNTCH_BW": (5.0, 250.0), "INS_HNTCH_REF": (0.0, 1.0),
    "IMU_GYRO_NF0_FRQ": (0.0, 1000.0), "IMU_GYRO_NF0_BW": (0.0, 100.0),
}  # fmt: skip
"""Documented ranges, the narrowest of any version."""
THROTTLE, RPM_SENSOR, ESC = 1, 2, 3
"""INS_HNTCH_MODE."""
DNF_ESC, DNF_FFT = 1, 2
"""Bits of IMU_GYRO_DNF_EN."""
PX4_WIDTH_HZ = 20.0
"""IMU_GYRO_NF0_BW by default, and the narrowest that is offered."""


def settings_for(log: FlightLog, spectra: Spectra, peak: Peak) -> list[Setting]:
    """Every parameter of a notch for a peak whose frequency is known, those that are set already too; none where this
    firmware has no such notch or a value lies outside its documented range."""
    made = _ardupilot(log, spectra, peak) if log.firmware.name == "ArduPilot" else _px4(log, spectra, peak)
    return made if all(_allowed(s) for s in made) else []


def _ardupilot(log: FlightLog, spectra: Spectra, peak: Peak) -> list[Setting]:
    """The harmonic notch; the parameters below INS_HNTCH_ENABLE exist wherever it does, and are logged when it is 1."""
    if log.param("INS_HNTCH_ENABLE") is None or peak.true is None:
        return []
    speeds = rotors(log, spectra)
    harmonics = int(log.param("INS_HNTCH_HMNCS") or 3)
    if peak.follows == "rotors" and speeds is not None and log.rpm is not None:
        slowest = float(np.floor(0.9 * np.nanquantile(speeds, 0.05)))
        mode, reference, frequency = ESC if log.rpm.source == "ESC" else RPM_SENSOR, 1.0, slowest
        harmonics |= 1 << (peak.harmonic - 1)
    else:
        hover = log.param("MOT_THST_HOVER")
        usual = _throttle(log, spectra)
        if not hover or not usual:
            return []
        mode, reference = THROTTLE, round(hover, 3)
        frequency = float(round(peak.true * float(np.sqrt(hover / usual))))
    new = {"ENABLE": 1.0, "MODE": float(mode), "FREQ": frequency, "BW": float(round(0.5 * frequency)), "REF": reference,
           "HMNCS": float(harmonics)}  # fmt: skip
    units = {"FREQ": "Hz", "BW": "Hz"}
    if harmonics == 3 and log.param("INS_HNTCH_HMNCS") is None:
        del new["HMNCS"]  # its default
    return [Setting(f"INS_HNTCH_{n}", log.param(f"INS_HNTCH_{n}"), v, units.get(n, "")) for n, v in new.items()]


def _throttle(log: FlightLog, spectra: Spectra) -> float | None:
    """The usual throttle 0 to 1 over the windows, None where it is not logged."""
    if log.throttle is None or len(log.throttle.t) < 2:
        return None
    values = at_windows(log.throttle, spectra)[:, 0]
    return float(np.nanmedian(values)) if np.isfinite(values).any() else None


def _px4(log: FlightLog, spectra: Spectra, peak: Peak) -> list[Setting]:
    """The dynamic notch where PX4 measures what the peak follows, else a fixed one that covers where the peak goes."""
    dynamic = log.param("IMU_GYRO_DNF_EN")
    bit = DNF_ESC if peak.follows == "rotors" else DNF_FFT if (log.param("IMU_GYRO_FFT_EN") or 0.0) >= 1.0 else 0
    low, high = log.param("IMU_GYRO_FFT_MIN") or 0.0, log.param("IMU_GYRO_FFT_MAX") or np.inf
    if peak.true is None or (bit == DNF_FFT and not low <= peak.true <= high):
        return []
    if dynamic is not None and bit:
        return [Setting("IMU_GYRO_DNF_EN", dynamic, float(int(dynamic) | bit))]
    places = track(spectra, peak.frequency)
    places = places[np.isfinite(places)]
    spread = float(np.ptp(np.quantile(places, [0.05, 0.95]))) if len(places) else 0.0
    width = max(PX4_WIDTH_HZ, float(np.ceil(spread)))
    if width > 0.5 * peak.true:
        return []
    names = ("IMU_GYRO_NF0_FRQ", "IMU_GYRO_NF0_BW")
    if log.param(names[0]) is None:
        names = ("IMU_GYRO_NF_FREQ", "IMU_GYRO_NF_BW")
    values = (float(round(peak.true)), width)
    old = [log.param(n) for n in names]
    return [] if None in old else [Setting(n, o, v, "Hz") for n, o, v in zip(names, old, values, strict=True)]


def _allowed(setting: Setting) -> bool:
    """Whether a value lies in its documented range."""
    low, high = RANGES.get(setting.name.replace("_NF_FREQ", "_NF0_FRQ").replace("_NF_BW", "_NF0_BW"), (0.0, 65_535.0))
    return low <= setting.new <= high


def to_log(log: FlightLog) -> str:
    """What would log the gyro fast enough, with settings that are not made yet."""
    if log.firmware.name == "ArduPilot":
        mask = log.param("INS_LOG_BAT_MASK")
        if mask is None:
            return "ArduPilot 3.7 and later log bursts at full rate with INS_LOG_BAT_MASK 1."
        if mask == 0:
            return "Set INS_LOG_BAT_MASK to 1, reboot and fly two minutes with changes of throttle."
        return "INS_LOG_BAT_MASK is set already: fly longer, with changes of throttle."
    profile = log.param("SDLOG_PROFILE")
    if version_number(log.firmware.version) < (1, 12) or profile is None:
        return "PX4 1.12 and later log the gyro at full rate with bit 8 of SDLOG_PROFILE."
    if int(profile) >> GYRO_FIFO & 1:
        return "Bit 8 of SDLOG_PROFILE is set already: fly longer, with changes of throttle."
    return "Set bit 8 of SDLOG_PROFILE (gyro FIFO) and fly two minutes with changes of throttle."
