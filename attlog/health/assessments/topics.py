"""Which questions about sensors are there? Each id once: its words, and the finding that it belongs to.

Tables, gates and findings take their words and names from here, so that a new question needs its line and no more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SensorQuestion:
    """``title`` in words; ``finding``: the kind of finding (``attlog.health.findings``) that a warning belongs to."""

    title: str
    finding: str


COMPASS, ACCELEROMETER, GYRO_BIAS, VIBRATION, GNSS, ESTIMATOR = (
    "compass",
    "accelerometer",
    "gyro_bias",
    "vibration",
    "gnss",
    "estimator",
)
TOPICS: Mapping[str, SensorQuestion] = {
    "compass_offset": SensorQuestion("compass offset", COMPASS),
    "compass_motors": SensorQuestion("compass and motor current", COMPASS),
    "soft_iron": SensorQuestion("compass soft iron", COMPASS),
    "compass_choice": SensorQuestion("compass in use", COMPASS),
    "accelerometer_offset": SensorQuestion("accelerometer offset", ACCELEROMETER),
    "accelerometer_rest": SensorQuestion("gravity at rest", ACCELEROMETER),
    "accelerometer_temperature": SensorQuestion("accelerometer and temperature", ACCELEROMETER),
    "imu_instances": SensorQuestion("IMUs against each other", ACCELEROMETER),
    "gyro_bias": SensorQuestion("gyro bias", GYRO_BIAS),
    "gyro_bias_step": SensorQuestion("step of the gyro bias", GYRO_BIAS),
    "gyro_temperature": SensorQuestion("gyro bias and temperature", GYRO_BIAS),
    "gyro_scale": SensorQuestion("gyro scale", "gyro_scale"),
    "vibration_level": SensorQuestion("vibration", VIBRATION),
    "clipping": SensorQuestion("clipping", VIBRATION),
    "gyro_spectrum": SensorQuestion("gyro spectrum", VIBRATION),
    "notch": SensorQuestion("notch filter", VIBRATION),
    "gnss_delay": SensorQuestion("GNSS delay", ESTIMATOR),
    "magnetometer_delay": SensorQuestion("magnetometer delay", ESTIMATOR),
    "barometer_delay": SensorQuestion("barometer delay", ESTIMATOR),
    "imu_delay": SensorQuestion("IMU delay", "imu_delay"),
    "innovations": SensorQuestion("test ratios", ESTIMATOR),
    "lanes": SensorQuestion("estimator lane in use", ESTIMATOR),
    "gnss_quality": SensorQuestion("GNSS quality", GNSS),
    "gnss_jumps": SensorQuestion("GNSS jumps", GNSS),
    "gnss_interference": SensorQuestion("GNSS interference", GNSS),
    "barometer_noise": SensorQuestion("barometer noise", ESTIMATOR),
}
"""By question id, in the order of tables."""
