"""Can the accelerometers and gyros be trusted: offsets, scale, temperature, and one unit against another?"""

from __future__ import annotations

from collections.abc import Callable

from attlog.health.assessments.inertial import (
    accelerometer_offset,
    accelerometer_rest,
    gyro_bias,
    gyro_scale,
    imu_instances,
    temperature,
)
from attlog.health.assessments.model import Assessment, HealthCase

QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {
    "accelerometer offset": accelerometer_offset.answer,
    "accelerometer rest": accelerometer_rest.answer,
    "IMU instances": imu_instances.answer,
    "gyro bias": gyro_bias.answer,
    "gyro scale": gyro_scale.answer,
    "gyro temperature": temperature.gyro,
    "accelerometer temperature": temperature.accelerometer,
}
"""By name, in the order of the table."""
