"""Can these sensors be trusted, and what should be set? One file per question; each answers with assessments."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from attlog.base.barrier import guarded
from attlog.health.assessments.inertial import (
    accelerometer_offset,
    accelerometer_rest,
    gyro_bias,
    gyro_scale,
    imu_instances,
    temperature,
)
from attlog.health.assessments.model import Assessment, HealthCase, MotionAttitude, Setting, Verdict, unknown
from attlog.segments.once import once

__all__ = ["Assessment", "HealthCase", "MotionAttitude", "Setting", "Verdict", "assess", "unknown"]

QUESTIONS: dict[str, Callable[[HealthCase], list[Assessment]]] = {
    "accelerometer offset": accelerometer_offset.answer,
    "accelerometer rest": accelerometer_rest.answer,
    "IMU instances": imu_instances.answer,
    "gyro bias": gyro_bias.answer,
    "gyro scale": gyro_scale.answer,
    "gyro temperature": temperature.gyro,
    "accelerometer temperature": temperature.accelerometer,
}
"""By name, in the order of the table: each gives no, one or several assessments."""


def assess(case: HealthCase) -> list[Assessment]:
    """Every question about the sensors of a log, in a fixed order; one that ends in a bug is unknown and says so."""
    found: list[Assessment] = []
    with once():
        for name, answer in QUESTIONS.items():
            failed = partial(_failed, name)
            found += guarded(f"The question {name}", partial(answer, case), failed)
    return found


def _failed(name: str, sentence: str) -> list[Assessment]:
    return [unknown("", name.replace(" ", "_"), sentence)]
