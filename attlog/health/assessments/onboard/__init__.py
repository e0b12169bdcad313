"""Does the onboard estimator know the delays of its aids, does it accept them, and are its aids any good?"""

from __future__ import annotations

from collections.abc import Callable

from attlog.health.assessments.model import Assessment, HealthCase
from attlog.health.assessments.onboard import barometer, field_delay, gnss_delay, gnss_quality, innovations, lanes

QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {
    "GNSS delay": gnss_delay.assessments,
    "magnetometer delay": field_delay.assessments,
    "IMU delay": field_delay.of_imu,
    "innovations": innovations.assessments,
    "lanes": lanes.assessments,
    "GNSS quality": gnss_quality.assessments,
    "barometer": barometer.assessments,
}
"""By name, in the order of the table."""
