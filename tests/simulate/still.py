"""What tests of single sensors need: an autopilot that does nothing, and raw rows of a motion of one's own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.autopilot.autopilot import SensorInputs
from attlog.simulate.flight import Flight, ImuStream, Onboard
from attlog.simulate.fly import fly
from attlog.simulate.scenario.scenario import Scenario, build
from attlog.simulate.sensors.imu import ImuSensor
from attlog.simulate.sensors.imu_kernel import RAW

Array = NDArray[np.float64]
G = 9.80665
PERFECT: dict[str, Any] = {
    "gyro": {"noise_dps_rthz": 0, "bias_spread_dps": 0, "walk_dps_rts": 0, "step_dps": 0},
    "acc": {"noise_ug_rthz": 0, "bias_spread_m_s2": 0, "walk_m_s2_rts": 0, "step_mg": 0},
    "warming_k": 0,
}
"""An inertial unit without errors; tests add one at a time."""


class Idle:
    """An autopilot that commands nothing and keeps what it was handed."""

    def __init__(self, *_: object) -> None:
        self.got: list[tuple[float, SensorInputs]] = []

    def step(self, t: float, measured: SensorInputs) -> Array:
        self.got.append((t, measured))
        return np.zeros(4)

    def onboard(self) -> Onboard:
        return Onboard()


def scenario(seconds: float = 10.0, **values: Any) -> Scenario:
    """A prescribed rest unless told otherwise."""
    return build({"seconds": seconds, "motion": {}} | values)


def flown(one: Scenario, seed: int = 0) -> Flight:
    """A flight without an autopilot."""
    return fly(one, seed, Idle)


def perfect(gyro: dict[str, Any] | None = None, acc: dict[str, Any] | None = None, **imu: Any) -> dict[str, Any]:
    """A perfect inertial unit with these errors, as a scenario's table."""
    return PERFECT | {"gyro": PERFECT["gyro"] | (gyro or {}), "acc": PERFECT["acc"] | (acc or {})} | imu


def unit(imu: dict[str, Any], raw: Array | None = None, seconds: float = 10.0, seed: int = 0) -> ImuStream:
    """What a unit tells of raw rows (n, 17), a rest at 0 rate and 0 force unless given, at 2000 Hz."""
    one = scenario(seconds, sensors={"imu": [imu]})
    sensor = ImuSensor(one, 0, seed, G)
    sensor.advance(0, np.zeros((round(seconds * 2000), RAW)) if raw is None else np.ascontiguousarray(raw))
    return sensor.stream()


def rows(seconds: float, **columns: Any) -> Array:
    """Raw rows at 2000 Hz: w, w_dot, force (3 each), rotor, angle (4 each), constant or one row each; the rest 0."""
    out = np.zeros((round(seconds * 2000), RAW))
    at = {"w": slice(0, 3), "w_dot": slice(3, 6), "force": slice(6, 9), "rotor": slice(9, 13), "angle": slice(13, 17)}
    for name, value in columns.items():
        out[:, at[name]] = value
    return out
