"""Which notches did the gyro fly with, and where were they?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.flight.model import FlightLog

THROTTLE = 1
"""INS_HNTCH_MODE; 2 (RPM sensor), 3 (ESC), 4 (FFT) and 5 (second RPM sensor) follow what they measure."""


@dataclass(frozen=True, slots=True)
class ActiveNotch:
    """A notch of the gyro at ``frequency`` Hz, ``width`` Hz wide; ``follows`` what moves it, empty for a fixed one."""

    name: str
    frequency: float
    width: float
    follows: str

    def covers(self, frequency: float) -> bool:
        """Whether a frequency lies in its stop band; a notch that measures its frequency is wherever the peak is."""
        return self.follows == "measurement" or abs(frequency - self.frequency) <= 0.5 * self.width


def notches(log: FlightLog) -> list[ActiveNotch]:
    """The notches that flew, by the log's parameters."""
    found = []
    for group in ("INS_HNTCH", "INS_HNTC2"):
        frequency, width = log.param(f"{group}_FREQ"), log.param(f"{group}_BW")
        if (log.param(f"{group}_ENABLE") or 0.0) < 1.0 or frequency is None or width is None:
            continue
        mode, reference = log.param(f"{group}_MODE") or 0.0, log.param(f"{group}_REF") or 0.0
        follows = "" if mode == 0 or reference == 0 else "throttle" if mode == THROTTLE else "measurement"
        found.append(ActiveNotch(group, _at_hover(log, frequency, reference) if follows == "throttle" else frequency,
                           width, follows))  # fmt: skip
    frequency = log.param("INS_NOTCH_FREQ") or 0.0
    if (log.param("INS_NOTCH_ENABLE") or 0.0) >= 1.0 and frequency > 0.0:
        found.append(ActiveNotch("INS_NOTCH", frequency, log.param("INS_NOTCH_BW") or 0.0, ""))
    for frequency_name, width_name in (
        ("IMU_GYRO_NF0_FRQ", "IMU_GYRO_NF0_BW"),
        ("IMU_GYRO_NF1_FRQ", "IMU_GYRO_NF1_BW"),
        ("IMU_GYRO_NF_FREQ", "IMU_GYRO_NF_BW"),
    ):
        frequency = log.param(frequency_name) or 0.0
        if frequency > 0.0:
            found.append(ActiveNotch(frequency_name, frequency, log.param(width_name) or 0.0, ""))
    if (log.param("IMU_GYRO_DNF_EN") or 0.0) > 0.0:
        found.append(ActiveNotch("IMU_GYRO_DNF_EN", 0.0, log.param("IMU_GYRO_DNF_BW") or 0.0, "measurement"))
    return found


def _at_hover(log: FlightLog, frequency: float, reference: float) -> float:
    """Where a notch that follows throttle is at the hover throttle that the vehicle learnt."""
    hover = log.param("MOT_THST_HOVER")
    return frequency * float(np.sqrt(hover / reference)) if hover and reference > 0.0 and hover > 0.0 else frequency
