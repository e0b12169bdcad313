"""Flies a scenario: motion period by period, sensors as they come, the autopilot in between."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.simulate.autopilot import Autopilot, Maker, Measured
from attlog.simulate.environment import Environment, environment, field_at
from attlog.simulate.flight import Flight, Onboard, Truth
from attlog.simulate.prescribed import moved
from attlog.simulate.scenario import Scenario
from attlog.simulate.sensors.baro import BaroSensor
from attlog.simulate.sensors.gnss import GnssSensor
from attlog.simulate.sensors.imu import ImuSensor
from attlog.simulate.sensors.imu_kernel import RAW
from attlog.simulate.sensors.mag import MagSensor
from attlog.simulate.sensors.power import battery, rpm

Array = NDArray[np.float64]
BLOCK = 2000
"""Periods of a prescribed motion that are computed at once."""


def fly(scenario: Scenario, seed: int = 0, autopilot: Maker | None = None) -> Flight:
    """The flight of a scenario; same scenario and seed, same numbers to the bit.

    ``autopilot`` makes what is on board; None takes the one of the scenario's ``estimator`` and ``controller``.
    """
    home = environment(scenario)
    truth = _no_truth(scenario)
    sensors = _Sensors(scenario, seed, home)
    pilot = None if autopilot is None else autopilot(scenario, home.gravity, home.declination)
    if scenario.motion is None:
        raise NotImplementedError("flown motion")
    _prescribed(scenario, home, truth, sensors, pilot)
    return Flight(
        scenario=scenario, seed=seed, gravity=home.gravity, declination_deg=math.degrees(home.declination), truth=truth,
        imus=[s.stream() for s in sensors.imus], mags=[s.stream() for s in sensors.mags],
        gnss=[s.stream() for s in sensors.gnss], baro=[s.stream() for s in sensors.baro],
        onboard=Onboard() if pilot is None else pilot.onboard(),
        battery=battery(scenario, seed, truth), rpm=rpm(scenario, seed, truth),
        events=[(f.t, f"fault: {f.part} {f.instance} {f.kind}") for f in scenario.fault],
    )  # fmt: skip


class _Sensors:
    """All sensors of a flight, and what of their samples the autopilot gets."""

    def __init__(self, scenario: Scenario, seed: int, home: Environment) -> None:
        kinds = scenario.sensors
        self.imus = [ImuSensor(scenario, k, seed, home.gravity) for k in range(len(kinds.imu))]
        self.mags = [MagSensor(scenario, k, seed) for k in range(len(kinds.mag))]
        self.gnss = [GnssSensor(scenario, k, seed) for k in range(len(kinds.gnss))]
        self.baro = [BaroSensor(scenario, k, seed) for k in range(len(kinds.baro))]
        self.slow = [*self.mags, *self.gnss, *self.baro]

    def advance(self, truth: Truth, step: int, raw: Array, last: int) -> None:
        """Measure the periods from number ``step`` on, whose raw rows are ``raw``, up to row ``last`` of ``truth``."""
        for imu in self.imus:
            imu.advance(step, raw)
        now = float(truth.t[last])
        for sensor in self.slow:
            sensor.advance(truth, now)

    def measured(self, truth: Truth, row: int) -> Measured:
        """What arrived since it was last asked."""
        now = float(truth.t[row])
        mag = self.mags[0].arrived(now) if self.mags else None
        baro = self.baro[0].arrived(now) if self.baro else None
        gnss = self.gnss[0].arrived(now) if self.gnss else None
        return Measured(
            imu=self.imus[0].arrived(),
            mag=None if mag is None else self.mags[0].field[mag],
            height=None if baro is None else self.baro[0].height(baro),
            fix=None if gnss is None else self.gnss[0].fix(gnss),
            truth=(truth.q[row], truth.w[row], truth.p[row], truth.v[row]),
        )


def _no_truth(scenario: Scenario) -> Truth:
    """Room for the truth of a scenario: a row for the start and one for the end of each period."""
    n = round(scenario.seconds * scenario.loop.rate_hz) + 1
    three = [np.zeros((n, 3)) for _ in range(7)]
    w, w_dot, p, v, a, wind, field = three
    t = np.arange(n) / scenario.loop.rate_hz
    return Truth(t, np.zeros((n, 4)), w, w_dot, p, v, a, np.zeros((n, 4)), wind, field, np.zeros(n, bool))


def _prescribed(
    scenario: Scenario, home: Environment, truth: Truth, sensors: _Sensors, pilot: Autopilot | None
) -> None:
    """Fill ``truth`` with the prescribed motion; with an autopilot on board its estimator runs along."""
    sub, period = scenario.loop.substeps, 1.0 / scenario.loop.rate_hz
    start = moved(scenario, truth.t)
    truth.q[:], truth.w[:], truth.w_dot[:] = start.q, start.w, start.w_dot
    truth.p[:], truth.v[:], truth.a[:] = start.p, start.v, start.a
    truth.field[:] = field_at(scenario, home, truth.p)
    truth.ground[:] = True
    down = np.array([0.0, 0.0, home.gravity])
    periods = 1 if pilot is not None else BLOCK
    for step in range(0, len(truth.t) - 1, BLOCK):
        count = min(BLOCK, len(truth.t) - 1 - step)
        m = moved(scenario, step * period + np.arange(1, count * sub + 1, dtype=np.float64) * (period / sub))
        raw = np.zeros((count * sub, RAW))
        raw[:, 0:3], raw[:, 3:6] = m.w, m.w_dot
        raw[:, 6:9] = rotation.rotate_inverse(m.q, m.a - down)
        raw[:, 8] += m.shock
        for k in range(0, count, periods):
            last = step + min(k + periods, count)
            sensors.advance(truth, step + k, raw[k * sub : (k + periods) * sub], last)
            if pilot is not None:
                pilot.step(float(truth.t[last]), sensors.measured(truth, last))
