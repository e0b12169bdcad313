"""Battery current from the rotors' power, and rotor speeds as the speed controllers tell them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.flight import BatteryStream, RpmStream, Truth
from attlog.simulate.physics.streams import generator
from attlog.simulate.scenario.scenario import Scenario
from attlog.simulate.sensors.base import at
from attlog.simulate.sensors.timing import instants

Array = NDArray[np.float64]


def current(scenario: Scenario, rotor: Array) -> Array:
    """Battery current (n,) A at rotor speeds (n, 4) rad/s: idle and shaft power over efficiency and mean voltage."""
    b, v = scenario.sensors.battery, scenario.vehicle
    shaft = v.torque_m * v.thrust_factor * np.sum(np.abs(rotor) ** 3, axis=1)
    total: Array = b.idle_a + shaft / (b.efficiency * 0.5 * (b.full_v + b.empty_v))
    return total


def battery(scenario: Scenario, seed: int, truth: Truth) -> BatteryStream:
    """What the battery's monitor tells: its noisy current and voltage, and the charge used by its own account."""
    b, period = scenario.sensors.battery, 1.0 / scenario.loop.rate_hz
    random = generator(seed, "battery", 0, "noise")
    t = instants(b.rate_hz, scenario.seconds, 0.0, random)
    t = t[t <= truth.t[-1]]
    drawn = current(scenario, truth.rotor)
    used = np.cumsum(drawn) * period / 3600.0
    volts = b.full_v - (b.full_v - b.empty_v) * used / b.capacity_ah - b.resistance_ohm * drawn
    noise = random.standard_normal((len(t), 2))
    told = np.maximum(at(drawn, t, period) + b.noise_a * noise[:, 0], 0.0)
    return BatteryStream(t, at(volts, t, period) + b.noise_v * noise[:, 1], told, at(used, t, period))


def rpm(scenario: Scenario, seed: int, truth: Truth) -> RpmStream | None:
    """Rotor speeds as told; None without such telemetry. Standing rotors tell 0."""
    s = scenario.sensors.rpm
    if s is None:
        return None
    random = generator(seed, "rpm", 0, "noise")
    t = instants(s.rate_hz, scenario.seconds, 0.0, random)
    t = t[t <= truth.t[-1]]
    true = at(truth.rotor, t, 1.0 / scenario.loop.rate_hz) * 30.0 / math.pi
    told = np.where(true > 1.0, np.maximum(true + s.noise_rpm * random.standard_normal(true.shape), 0.0), 0.0)
    return RpmStream(t, s.step_rpm * np.round(told / s.step_rpm) if s.step_rpm > 0 else told)
