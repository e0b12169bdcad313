"""What flies: mass, rotors, drag and feet of a quadrotor in X, 1.5 kg with 10 inch propellers unless said otherwise."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from attlog.simulate.sensors.settings import STRICT, NotNegative, Positive

NotNegativeThree = tuple[NotNegative, NotNegative, NotNegative]

ROTOR_SIGNS = ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))
"""Rotors at (forward, right): front right, back left, front left, back right, the order of both firmwares."""
ROTOR_TURNS = (1.0, 1.0, -1.0, -1.0)
"""Yaw torque on the body, + to the right: the first two turn anticlockwise seen from above."""


@dataclass(frozen=True, config=STRICT)
class Vehicle:
    """A rigid body with four rotors, body axes forward-right-down.

    ``arm_m`` from the centre of gravity to a rotor, ``thrust_max_n`` and ``speed_max_rpm`` of one rotor; thrust
    grows with the square of the speed and the drag torque is ``torque_m`` times the thrust. ``motor_lag_s`` is the
    time constant of the speed, ``rotor_inertia_kg_m2`` of one rotor about its axis. Air drag: ``drag_n_s_m``
    (linear, mostly of the rotors) and ``drag_area_m2`` (area times coefficient, quadratic), each per body axis;
    ``damping_n_m_s`` against turning. ``foot_m``: feet below the centre; ``friction`` of the ground.
    """

    mass_kg: Positive = 1.5
    inertia_kg_m2: tuple[Positive, Positive, Positive] = (0.0165, 0.0165, 0.029)
    arm_m: Positive = 0.225
    thrust_max_n: Positive = 8.5
    speed_max_rpm: Positive = 8500.0
    torque_m: NotNegative = 0.016
    motor_lag_s: NotNegative = 0.025
    rotor_inertia_kg_m2: NotNegative = 4e-5
    drag_n_s_m: NotNegativeThree = (0.3, 0.3, 0.15)
    drag_area_m2: NotNegativeThree = (0.012, 0.012, 0.03)
    damping_n_m_s: NotNegativeThree = (0.003, 0.003, 0.003)
    foot_m: Positive = 0.12
    friction: Annotated[float, Field(ge=0, le=2)] = 0.7

    @property
    def speed_max_rad_s(self) -> float:
        """Rotor speed at full command [rad/s]."""
        return self.speed_max_rpm * math.pi / 30.0

    @property
    def thrust_factor(self) -> float:
        """Thrust of a rotor over the square of its speed [N s^2]."""
        return self.thrust_max_n / self.speed_max_rad_s**2

    def hover_command(self, gravity: float) -> float:
        """The command (0 to 1, thrust over full thrust) of each rotor that carries the weight in still air."""
        return self.mass_kg * gravity / (4.0 * self.thrust_max_n)
