"""Can the accelerometers and gyros be trusted: offsets, scale, temperature, and one unit against another?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from attlog.core.errors import guarded
from attlog.core.log_cache import log_cache
from attlog.health import (
    accelerometer,
    baro,
    compass,
    delays,
    gnss,
    gravity,
    gyro,
    imu_pairs,
    innovations,
    notch,
    sources,
    temperature,
)
from attlog.health.check import Assessment, HealthCase, finite, unknown

INERTIAL_QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {
    "accelerometer offset": accelerometer.accelerometer_offsets,
    "accelerometer rest": gravity.gravity_at_rest,
    "IMU instances": imu_pairs.imu_differences,
    "gyro bias": gyro.gyro_bias,
    "gyro scale": gyro.gyro_scale,
    "gyro temperature": temperature.gyro_temperature,
    "accelerometer temperature": temperature.accelerometer_temperature,
}
"""By name, in the order of the table."""


# Does the onboard estimator know the delays of its aids, does it accept them, and are its aids any good?

ONBOARD_QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {
    "GNSS delay": delays.gnss_delays,
    "magnetometer delay": delays.compass_delay,
    "IMU delay": delays.imu_delay,
    "innovations": innovations.innovation_ratios,
    "lanes": sources.lane_errors,
    "GNSS quality": gnss.gnss_quality,
    "barometer": baro.barometer_noise,
}
"""By name, in the order of the table."""


# Every question about the sensors of a log, in the order of the table.

QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {
    **compass.COMPASS_QUESTIONS,
    **INERTIAL_QUESTIONS,
    **notch.VIBRATION_QUESTIONS,
    **ONBOARD_QUESTIONS,
}
"""By name: each gives no, one or several assessments, with ids of :data:`attlog.health.check.TOPICS`."""


def assess(case: HealthCase) -> list[Assessment]:
    """Every question about the sensors of a log, in a fixed order; one that ends in a bug is unknown and says so."""
    found: list[Assessment] = []
    with log_cache():
        for name, answer in QUESTIONS.items():
            failed = partial(_failed_question, name)
            found += guarded(f"The question {name}", partial(answer, case), failed)
    return list(map(finite, found))


def _failed_question(name: str, sentence: str) -> list[Assessment]:
    return [unknown("", name.replace(" ", "_"), sentence)]
