"""The parameters that ``eskf`` and ``smoother`` share."""

from __future__ import annotations

from attlog.estimators.base import Parameter

MEASURED = "attlog; measured on simulated flights of both firmwares"
PRIORS = (
    Parameter("gyro_bias_sigma", 1.0, "deg/s", 0.001, 20, "spread of the gyro bias where no rest shows it", MEASURED),
    Parameter("acc_bias_sigma", 0.1, "m/s^2", 0.001, 2, "spread of the accelerometer bias", MEASURED),
    Parameter("declination_sigma", 0.6, "deg", 0.01, 20, "spread of the declination around the model's", MEASURED),
)
SOFT = Parameter("soft_gate", 2.5, "", 1, 100, "innovations beyond so many sigma count less", MEASURED)
