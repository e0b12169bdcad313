"""What happens on board: controller, estimator in the loop, what is logged how often."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from attlog.simulate.sensors.settings import STRICT, NotNegative, Positive

Value = bool | float | str


@dataclass(frozen=True, config=STRICT)
class Loop:
    """``rate_hz`` of controller and estimator; physics and raw sensors run ``substeps`` times as fast."""

    rate_hz: Annotated[float, Field(ge=50, le=2000)] = 400.0
    substeps: Annotated[int, Field(ge=1, le=50)] = 5


@dataclass(frozen=True, config=STRICT)
class Controller:
    """Nested loops: angle error [rad] to rate (PI), rate error [rad/s] to torque as share of the greatest (PID).

    Roll and pitch as in Huang (tables 2, 3); the others are ours.
    """

    angle_kp: NotNegative = 4.5
    angle_ki: NotNegative = 0.35
    rate_kp: NotNegative = 0.14
    rate_ki: NotNegative = 0.015
    rate_kd: NotNegative = 0.0025
    yaw_angle_kp: NotNegative = 2.5
    yaw_rate_kp: NotNegative = 0.6
    yaw_rate_ki: NotNegative = 0.1
    rate_max_dps: Positive = 220.0
    yaw_rate_max_dps: Positive = 120.0
    tilt_max_deg: Annotated[float, Field(gt=0, le=80)] = 35.0
    position_kp: NotNegative = 0.95
    velocity_kp: NotNegative = 2.0
    velocity_ki: NotNegative = 0.4
    height_kp: NotNegative = 1.2
    climb_kp: NotNegative = 4.0
    climb_ki: NotNegative = 1.5


@dataclass(frozen=True, config=STRICT)
class EstimatorChoice:
    """The attitude that is flown on: a filter of attlog by name (``mahony@huang``), or ``truth``; ``params`` are
    its own."""

    name: str = "mahony_dcm@huang"
    params: dict[str, Value] = Field(default_factory=dict)


@dataclass(frozen=True, config=STRICT)
class LoggingRates:
    """How often a log holds what [Hz]; 0 is every value there is. Sensors are logged at their own rates unless
    given."""

    imu_hz: NotNegative = 0.0
    attitude_hz: NotNegative = 100.0
    setpoint_hz: NotNegative = 50.0
    motors_hz: NotNegative = 50.0
    truth_hz: NotNegative = 100.0
