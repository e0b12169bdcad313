"""What a pilot does about a fault of sensors or estimator; each firmware adds its own settings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

Fault = Literal[
    "gyro_bias",
    "accelerometer",
    "mounting",
    "compass",
    "compass_mounting",
    "compass_wiring",
    "interference",
    "vibration",
    "declination",
    "trim",
    "gaps",
    "gnss",
    "bus",
    "clock",
    "gyro_scale",
    "temperature",
]
"""What a remedy is asked for."""

GENERAL: Mapping[Fault, str] = {
    "gyro_bias": "Calibrate the gyro, and keep it still as it starts.",
    "accelerometer": "Calibrate the accelerometer in six positions.",
    "mounting": "Check the mounting and the orientation that is set, then calibrate the level.",
    "compass": "Calibrate the compass outdoors, away from iron.",
    "compass_mounting": "Check the orientation that is set for the compass, and calibrate it again.",
    "compass_wiring": "Check wiring and supply of the compass.",
    "interference": "Move the compass away from motors and power wires.",
    "vibration": "Balance propellers, check bearings and arms, mount the autopilot softer.",
    "declination": "Set the declination of the place.",
    "trim": "Calibrate the level, and correct a tilted mounting in the frame and not in software.",
    "gaps": "Use a faster memory card or log less.",
    "gnss": "Raise the antenna above power wires and transmitters.",
    "bus": "Check the sensor's connection, or fly on another unit.",
    "clock": "Log raw samples with their time of measurement, or fly on another unit.",
    "gyro_scale": "Fly on another unit, and replace this one.",
    "temperature": "Switch on, wait until the sensors are warm, then calibrate them and take off.",
}
"""Where nothing is known of the firmware."""
