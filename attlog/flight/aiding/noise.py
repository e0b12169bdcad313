"""Which parameter tells the onboard estimator the noise of an aid, and how many standard deviations is its gate?"""

from __future__ import annotations

import math
from dataclasses import dataclass

from attlog.flight.model import FlightLog

PARAMETERS: dict[str, dict[str, tuple[str, float, float, str, float]]] = {
    "PX4": {
        "compass": ("EKF2_MAG_NOISE", 0.001, 1.0, "EKF2_MAG_GATE", 1.0),
        "velocity": ("EKF2_GPS_V_NOISE", 0.01, 5.0, "EKF2_GPS_V_GATE", 1.0),
        "position": ("EKF2_GPS_P_NOISE", 0.01, 10.0, "EKF2_GPS_P_GATE", 1.0),
        "height": ("EKF2_BARO_NOISE", 0.01, 15.0, "EKF2_BARO_GATE", 1.0),
    },
    "XK": {
        "compass": ("EK3_MAG_M_NSE", 0.01, 0.5, "EK3_MAG_I_GATE", 0.01),
        "velocity": ("EK3_VELNE_M_NSE", 0.05, 5.0, "EK3_VEL_I_GATE", 0.01),
        "position": ("EK3_POSNE_M_NSE", 0.1, 10.0, "EK3_POS_I_GATE", 0.01),
        "height": ("EK3_ALT_M_NSE", 0.1, 10.0, "EK3_HGT_I_GATE", 0.01),
    },
    "NK": {
        "compass": ("EK2_MAG_M_NSE", 0.01, 0.5, "EK2_MAG_I_GATE", 0.01),
        "velocity": ("EK2_VELNE_M_NSE", 0.05, 5.0, "EK2_VEL_I_GATE", 0.01),
        "position": ("EK2_POSNE_M_NSE", 0.1, 10.0, "EK2_POS_I_GATE", 0.01),
        "height": ("EK2_ALT_M_NSE", 0.1, 10.0, "EK2_HGT_I_GATE", 0.01),
    },
}
"""Noise, its documented range, its gate and the gate's unit in standard deviations."""


@dataclass(frozen=True, slots=True)
class NoiseParameter:
    """``name`` was ``old`` and lies between ``low`` and ``high``; the aid's gate is ``gate`` standard deviations."""

    name: str
    old: float
    low: float
    high: float
    gate: float


def of_aid(log: FlightLog, aid: str, source: str) -> NoiseParameter | None:
    """The noise of an aid whose test ratio comes from ``source``; None where the log does not hold noise and gate."""
    family = "PX4" if log.firmware.name == "PX4" else source[:2]
    known = PARAMETERS.get(family, {}).get(aid)
    if known is None:
        return None
    name, low, high, gate, unit = known
    old, sigmas = log.param(name), log.param(gate)
    if not isinstance(old, int | float) or not isinstance(sigmas, int | float):
        return None
    if not (math.isfinite(old) and math.isfinite(sigmas)) or old <= 0.0 or sigmas <= 0.0:
        return None
    return NoiseParameter(name, float(old), low, high, float(sigmas) * unit)


def not_logged(log: FlightLog) -> str:
    """What would log test ratios."""
    if log.firmware.name == "PX4":
        return "No estimator_status in flight: set bit 0 of SDLOG_PROFILE to log test ratios."
    if log.firmware.name == "ArduPilot":
        return "No XKF4 or NKF4 in flight: ATTITUDE of LOG_BITMASK logs test ratios."
    return "The log holds no test ratios of an EKF."
