"""A rigid body with four rotors of the tests' own: the controller is not judged by the simulator it was made for."""

from __future__ import annotations

import numpy as np

from attlog.core import rotation
from attlog.simulate import controller
from attlog.simulate.scenario import ROTOR_SIGNS, ROTOR_TURNS, Vehicle

Array = np.ndarray


def authority(vehicle: Vehicle) -> Array:
    """Angular acceleration (3,) rad/s^2 per unit of torque asked for: rotors change by half of their thrust."""
    reach = vehicle.arm_m / np.sqrt(2.0)
    levers = np.array([reach, reach, vehicle.torque_m])
    return 4 * 0.5 * vehicle.thrust_max_n * levers / np.array(vehicle.inertia_kg_m2)


class Body:
    """Attitude, rate and rotor thrust shares; Newton-Euler with first-order rotors, no air, parts of a period."""

    def __init__(self, vehicle: Vehicle, q: Array, hover: float) -> None:
        self.vehicle, self.q, self.w = vehicle, np.array(q, float), np.zeros(3)
        self.f = np.full(4, hover)
        self.place = np.array(ROTOR_SIGNS) * vehicle.arm_m / np.sqrt(2.0)
        self.spins = np.array(ROTOR_TURNS)

    def move(self, shares: Array, dt: float, parts: int = 2) -> None:
        v, h = self.vehicle, dt / parts
        inertia = np.array(v.inertia_kg_m2)
        for _ in range(parts):
            # Means over the part: taken at its end, they would be ahead of their time by half of it.
            before = self.f.copy()
            self.f = before + (shares - before) * -np.expm1(-h / v.motor_lag_s)
            thrust = v.thrust_max_n * 0.5 * (before + self.f)
            torque = np.array(
                [-thrust @ self.place[:, 1], thrust @ self.place[:, 0], v.torque_m * (thrust @ self.spins)]
            )
            (p, q, r), (a, b, c) = self.w.tolist(), (inertia * self.w).tolist()
            turn = h * (torque - [q * c - r * b, r * a - p * c, p * b - q * a]) / inertia
            self.q = rotation.normalize(rotation.multiply(self.q, rotation.from_rotvec((self.w + 0.5 * turn) * h)))
            self.w = self.w + turn


def flown(
    gains: controller.Gains,
    q0: Array,
    wanted: Array,
    seconds: float,
    thrust: float = 0.4,
    hz: float = 400.0,
    vehicle: Vehicle | None = None,
    waiting: int = 0,
) -> tuple[Array, Array, Array]:
    """Times (n,), attitudes (n, 4) and what the controller put out (n, 11); ``wanted`` (4,) or (n, 4).

    Rotors are told ``waiting`` periods late.
    """
    vehicle = vehicle or Vehicle()
    body, state, packed = Body(vehicle, q0, thrust), controller.new_controller_state(), gains.pack()
    shares = controller.mixer(ROTOR_SIGNS, ROTOR_TURNS)
    t = np.arange(int(seconds * hz)) / hz
    wanted = np.broadcast_to(wanted, (len(t), 4))
    step, out = controller.control, np.zeros(11)
    qs, outs = np.empty((len(t), 4)), np.empty((len(t), 11))
    for k in range(len(t)):
        qs[k] = body.q
        command = np.array([*wanted[k], thrust, 1.0])
        step(state, packed, body.q, body.w, command, shares, 1.0 / hz, out)
        outs[k] = out
        body.move(outs[max(k - waiting, 0), :4], 1.0 / hz)
    return t, qs, outs
