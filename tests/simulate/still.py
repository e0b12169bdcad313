"""What tests of single sensors need: an autopilot that does nothing, and raw rows of a motion of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import attlog
from attlog import formats
from attlog.result import Result
from attlog.simulate.flight import Flight, ImuStream, Onboard, SensorInputs
from attlog.simulate.fly import fly
from attlog.simulate.imu import RAW_COLUMNS, ImuSensor
from attlog.simulate.logs import recording
from attlog.simulate.scenario import Scenario, build_scenario

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
    return build_scenario({"seconds": seconds, "motion": {}} | values)


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
    sensor.advance(0, np.zeros((round(seconds * 2000), RAW_COLUMNS)) if raw is None else np.ascontiguousarray(raw))
    return sensor.stream()


def rows(seconds: float, **columns: Any) -> Array:
    """Raw rows at 2000 Hz: w, w_dot, force (3 each), rotor, angle (4 each), constant or one row each; the rest 0."""
    out = np.zeros((round(seconds * 2000), RAW_COLUMNS))
    at = {"w": slice(0, 3), "w_dot": slice(3, 6), "force": slice(6, 9), "rotor": slice(9, 13), "angle": slice(13, 17)}
    for name, value in columns.items():
        out[:, at[name]] = value
    return out


# Flights made for statistics: noise, bias and lag of a size that is known, cheap enough for many seeds.

RATE = 200.0
GYRO_DPS_RTHZ, ACC_UG_RTHZ, MAG_UT_RTHZ = 0.01, 200.0, 0.05


def still(seconds: float = 80.0, walk: float = 0.0, bias: float = 0.05, **values: Any) -> Scenario:
    """A level table: white noise of gyro, accelerometer and field, a turn-on bias of the gyro, its walk
    [deg/s/sqrt(s)]. No filter runs on board, which would take as long as all the rest."""
    gyro = {"noise_dps_rthz": GYRO_DPS_RTHZ, "bias_spread_dps": bias, "walk_dps_rts": walk, "step_dps": 0.002}
    acc = {"noise_ug_rthz": ACC_UG_RTHZ, "bias_spread_m_s2": 0.0, "walk_m_s2_rts": 0.0, "step_mg": 0.05}
    mag = {"noise_ut_rthz": MAG_UT_RTHZ, "hard_iron_spread_ut": 0.0}
    return build_scenario(
        {
            "name": "statistical",
            "title": "for statistics",
            "seconds": seconds,
            "motion": {},
            "place": {"heading_deg": 40},
            "loop": {"rate_hz": RATE, "substeps": 4},
            "estimator": {"name": "truth"},
            "sensors": {"imu": [{"rate_hz": RATE, "gyro": gyro, "acc": acc, "warming_k": 0}], "mag": [mag]},
        }
        | values
    )


def strokes(late_s: float, repeats: int = 4) -> Scenario:
    """Rest, then quick turns to and fro about each axis with a gyro that is ``late_s`` s late without saying so."""
    moves: list[dict[str, float]] = [{"seconds": 12.0}]
    for _ in range(repeats):
        for axis, angle in (("roll_deg", 25.0), ("pitch_deg", 20.0), ("heading_deg", 40.0)):
            moves += [{"seconds": 0.5, axis: angle}, {"seconds": 1.3}, {"seconds": 0.5, axis: 0.0}, {"seconds": 1.3}]
    imu = {"rate_hz": RATE, "hidden_delay_s": late_s, "warming_k": 0, "gyro": {"bias_spread_dps": 0.05}}
    seconds = sum(m["seconds"] for m in moves) + 3.0
    return still(seconds, place={}, motion={"move": moves}, sensors={"imu": [imu]}, logging={"truth_hz": RATE})


def analysed(flight: Flight, folder: Path, **config: Any) -> Result:
    """What ``attlog.analyze`` says of a flight's log, truth as reference and nothing taken off the gyro."""
    path = folder / f"{flight.scenario.name}-{flight.seed}.ulg"
    formats.write(path, recording(flight, "ulog"))
    return attlog.analyze(path, {"reference": "truth", "gyro_bias": "none"} | config)


def statistical_flight(scenario: Scenario, seed: int) -> Flight:
    return fly(scenario, seed)


def answer(result: Result, row: str, metric: str, window: str) -> Any:
    """One answer of one row."""
    return next(e for e in result.estimators if e.name == row).metrics[window][metric]


def rotated_noise(seconds: float = 5.0, rate: float = RATE, many: int = 20_000) -> float:
    """exp(E ln v / 2) of v = sum r^2 / (n - 2), r: a Brownian path of unit density over ``seconds`` less its line.

    A gyro alone at rest walks so; its typical window is this number times the gyro's density. Drawn,
    because the mean logarithm of the quadratic form has no closed form; E v = T / 15 has one.
    """
    random = np.random.default_rng(0)
    n = round(seconds * rate)
    t = np.linspace(-1.0, 1.0, n)
    line = np.column_stack([np.full(n, n**-0.5), t / np.linalg.norm(t)])
    logs: list[Array] = []
    for _ in range(many // 1000):
        path = np.cumsum(random.standard_normal((1000, n)), axis=1) / np.sqrt(rate)
        r = path - (path @ line) @ line.T
        v = np.sum(r * r, axis=1) / (n - 2)
        assert abs(v.mean() / (seconds / 15.0) - 1.0) < 0.12
        logs.append(np.log(v))
    return float(np.exp(0.5 * np.mean(logs)))
