"""How strongly does the vehicle vibrate, at which frequencies, and which notch helps?"""

from __future__ import annotations

from attlog.health.assessments.vibration.level import levels, vibration_level
from attlog.health.assessments.vibration.notch import notch
from attlog.health.assessments.vibration.spectrum import gyro_spectrum, spectrum

__all__ = ["gyro_spectrum", "levels", "notch", "spectrum", "vibration_level"]
