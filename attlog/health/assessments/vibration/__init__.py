"""How strongly does the vehicle vibrate, at which frequencies, and which notch helps?"""

from __future__ import annotations

from collections.abc import Callable

from attlog.health.assessments.model import Assessment, HealthCase
from attlog.health.assessments.vibration.level import levels, vibration_level
from attlog.health.assessments.vibration.notch import notch
from attlog.health.assessments.vibration.spectrum import gyro_spectrum, spectrum

__all__ = ["QUESTIONS", "gyro_spectrum", "levels", "notch", "spectrum", "vibration_level"]

QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {
    "vibration level": vibration_level,
    "gyro spectrum": gyro_spectrum,
    "notch": notch,
}
"""By name, in the order of the table."""
