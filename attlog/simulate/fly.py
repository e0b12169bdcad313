"""A scenario flown: motion period by period, sensors, the autopilot in between; and its flights as files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.files import staging_folder
from attlog.core.own_files import SIMULATED_LOG
from attlog.core.workers import in_processes
from attlog.estimators import Estimator, EstimatorSpec
from attlog.simulate.environment import Environment, environment, field_at, share_at, wind_at
from attlog.simulate.flight import (
    Autopilot,
    Flight,
    Maker,
    SensorInputs,
    Truth,
    check_samples,
    check_truth,
    flight_events,
)
from attlog.simulate.imu import RAW_COLUMNS, ImuSensor
from attlog.simulate.logs import write
from attlog.simulate.rigid_body import POINTS, TOUCHING, Body, prescribed_motion
from attlog.simulate.scenario import Scenario
from attlog.simulate.sensors import BaroSensor, GnssSensor, MagSensor, rotor_health, sample_battery, sample_rpm

Array = NDArray[np.float64]
# Before the start the vehicle leans into the wind on its feet for this time.
SETTLING_S = 1.0
# Periods of a prescribed motion computed at once.
BLOCK = 2000


def fly(scenario: Scenario, seed: int = 0, autopilot: Maker | None = None) -> Flight:
    """Fly a scenario; the same scenario and seed give the same numbers to the bit.

    ``autopilot`` makes what is on board, by default of the scenario's ``estimator`` and ``controller``. A flight on
    a plug-in is flown in the plug-in's process: step by step across processes it would take several times as long.
    UsageError where motion or samples cannot be computed or written; PluginError and PluginTimeout as in a replay.
    """
    from attlog.simulate.pilot import is_from_file, make_pilot

    row = None if autopilot is not None else is_from_file(scenario)
    if row is not None and row.estimator.process is not None:
        return row.estimator.process.call(_there, row.preset, dict(row.params), scenario, seed, also_s=scenario.seconds)
    home = environment(scenario)
    truth = _no_truth(scenario)
    sensors = _Sensors(scenario, seed, home)
    pilot = (autopilot or make_pilot)(scenario, home.gravity, home.declination)
    with np.errstate(all="ignore"):  # overflow is reported below with its time
        first = 0
        if scenario.command or scenario.motion is None:
            first = _flown(scenario, home, truth, sensors, pilot, seed)
        if scenario.motion is not None:
            _prescribed(scenario, home, truth, sensors, pilot, first)
    check_truth(truth)
    imus = [s.stream() for s in sensors.imus]
    check_samples([(f"imu[{k}]", imu) for k, imu in enumerate(imus)])
    return Flight(
        scenario=scenario,
        seed=seed,
        gravity=home.gravity,
        declination_deg=math.degrees(home.declination),
        truth=truth,
        imus=imus,
        mags=[s.stream() for s in sensors.mags],
        gnss=[s.stream() for s in sensors.gnss],
        baro=[s.stream() for s in sensors.baro],
        onboard=pilot.onboard(),
        battery=sample_battery(scenario, seed, truth),
        rpm=sample_rpm(scenario, seed, truth),
        events=flight_events(scenario, truth, imus),
    )


class _Sensors:
    """All sensors of a flight, and their samples for the autopilot."""

    def __init__(self, scenario: Scenario, seed: int, home: Environment) -> None:
        kinds = scenario.sensors
        self.imus = [ImuSensor(scenario, k, seed, home.gravity) for k in range(len(kinds.imu))]
        self.mags = [MagSensor(scenario, k, seed) for k in range(len(kinds.mag))]
        self.gnss = [GnssSensor(scenario, k, seed) for k in range(len(kinds.gnss))]
        self.baro = [BaroSensor(scenario, k, seed) for k in range(len(kinds.baro))]
        self.slow = [*self.mags, *self.gnss, *self.baro]

    def advance(self, truth: Truth, step: int, raw: Array, end: int) -> None:
        """Measure the periods from number ``step`` on, with raw rows ``raw``, up to row ``end`` of ``truth``."""
        for imu in self.imus:
            imu.advance(step, raw)
        now = float(truth.t[end])
        for sensor in self.slow:
            sensor.advance(truth, now)

    def measured(self, truth: Truth, row: int) -> SensorInputs:
        """Return the samples since the last call."""
        now = float(truth.t[row])
        mag = self.mags[0].arrived(now) if self.mags else None
        baro = self.baro[0].arrived(now) if self.baro else None
        gnss = self.gnss[0].arrived(now) if self.gnss else None
        return SensorInputs(
            imu=self.imus[0].arrived(now),
            mag=None if mag is None else self.mags[0].field[mag],
            height=None if baro is None else self.baro[0].height(baro),
            fix=None if gnss is None else self.gnss[0].fix(gnss),
            truth=(truth.q[row], truth.w[row], truth.p[row], truth.v[row]),
        )


def _no_truth(scenario: Scenario) -> Truth:
    """Return an empty truth: a row for the start and one for the end of each period."""
    n = round(scenario.seconds * scenario.loop.rate_hz) + 1
    three = [np.zeros((n, 3)) for _ in range(7)]
    w, w_dot, p, v, a, wind, field = three
    t = np.arange(n) / scenario.loop.rate_hz
    return Truth(t, np.zeros((n, 4)), w, w_dot, p, v, a, np.zeros((n, 4)), wind, field, np.zeros(n, bool))


def _prescribed(
    scenario: Scenario, home: Environment, truth: Truth, sensors: _Sensors, pilot: Autopilot, first: int
) -> None:
    """Fill ``truth`` from row ``first`` on with the prescribed motion.

    The estimator runs along, its commands move nothing.
    """
    sub, period = scenario.loop.substeps, 1.0 / scenario.loop.rate_hz
    lying = (truth.q[first].copy(), truth.p[first].copy()) if first else None
    rows = slice(first, None)
    known = prescribed_motion(scenario, truth.t[rows] - truth.t[first], lying)
    truth.q[rows], truth.w[rows], truth.w_dot[rows] = known.q, known.w, known.w_dot
    truth.p[rows], truth.v[rows], truth.a[rows] = known.p, known.v, known.a
    truth.field[rows] = field_at(scenario, home, truth.p[rows])
    truth.ground[rows] = True
    down = np.array([0.0, 0.0, home.gravity])
    for step in range(first, len(truth.t) - 1, BLOCK):
        count = min(BLOCK, len(truth.t) - 1 - step)
        now, since = step + count, (step - first) * period
        m = prescribed_motion(scenario, since + np.arange(1, count * sub + 1, dtype=np.float64) * (period / sub), lying)
        raw = np.zeros((count * sub, RAW_COLUMNS))
        raw[:, 0:3], raw[:, 3:6] = m.w, m.w_dot
        raw[:, 6:9] = rotation.rotate_inverse(m.q, m.a - down)
        raw[:, 8] += m.shock
        sensors.advance(truth, step, raw, now)
        for row in range(step + 1, now + 1):
            pilot.step(float(truth.t[row]), sensors.measured(truth, row))


def _flown(scenario: Scenario, home: Environment, truth: Truth, sensors: _Sensors, pilot: Autopilot, seed: int) -> int:
    """Fill ``truth`` with the motion under the autopilot's commands.

    Returns the last row, of the flight's end or of the carrying.
    """
    sub, period = scenario.loop.substeps, 1.0 / scenario.loop.rate_hz
    body = Body(scenario.vehicle, home.gravity, home.density, math.radians(scenario.place.heading_deg))
    truth.wind[:], truth.field[:] = wind_at(scenario.wind, truth.t, seed), home.field_t
    health = rotor_health(scenario, truth.t)
    stopped = [f for f in scenario.fault if f.kind == "stopped"]
    last = len(truth.t) - 1
    if scenario.motion is not None and scenario.motion.after_s is not None:
        last = min(round(scenario.motion.after_s / period), last)
    raw = np.zeros((sub, RAW_COLUMNS))
    command = np.zeros(4)
    truth.wind[0] *= share_at(scenario.vehicle.foot_m)
    for _ in range(round(SETTLING_S / period)):
        body.advance(command, truth.wind[0], period / sub, raw)
    _note(scenario, home, truth, body, 0)
    for k in range(last):
        body.health[:] = health[k]
        for fault in stopped:
            if fault.holds(float(truth.t[k])):
                command[fault.instance] = 0.0
        truth.wind[k + 1] *= share_at(-float(truth.p[k, 2]))
        body.advance(command, truth.wind[k + 1], period / sub, raw)
        _note(scenario, home, truth, body, k + 1)
        sensors.advance(truth, k, raw, k + 1)
        command = np.array(pilot.step(float(truth.t[k + 1]), sensors.measured(truth, k + 1)), np.float64)
    return last


def _note(scenario: Scenario, home: Environment, truth: Truth, body: Body, row: int) -> None:
    """Write the body's state into a row of the truth."""
    s = body.state
    truth.p[row], truth.v[row], truth.q[row], truth.w[row] = s[0:3], s[3:6], s[6:10], s[10:13]
    truth.a[row], truth.w_dot[row], truth.rotor[row] = body.now[0:3], body.now[3:6], s[13:17]
    if scenario.anomaly:
        truth.field[row] = field_at(scenario, home, truth.p[row : row + 1])[0]
    truth.ground[row] = any(s[TOUCHING : TOUCHING + POINTS].tolist())


def _there(
    estimator: Estimator, preset: str | None, params: dict[str, float | str], scenario: Scenario, seed: int
) -> Flight:
    """Run :func:`fly` in the process of the scenario's estimator."""
    from attlog.simulate.pilot import make_pilot

    return fly(scenario, seed, partial(make_pilot, row=EstimatorSpec(estimator, preset, params)))


# Each path with its bytes, or the error.
WrittenFlight = list[tuple[Path, int]] | Exception


def plan_flights(
    scenario: Scenario, work: Mapping[int, Sequence[Path]], params: Mapping[str, float | int], jobs: int = 1
) -> Iterator[tuple[int, WrittenFlight]]:
    """Write the flights of ``work`` (paths by seed).

    Yields seed and result in order, or as ``jobs`` processes finish.
    """
    if jobs == 1 or len(work) == 1:
        for seed, paths in work.items():
            yield seed, write_flights(scenario, seed, paths, params)
        return
    calls = {seed: (scenario, seed, paths, params) for seed, paths in work.items()}
    yield from in_processes(write_flights, calls, jobs)


def write_flights(
    scenario: Scenario, seed: int, paths: Sequence[Path], params: Mapping[str, float | int]
) -> WrittenFlight:
    """Fly one seed and write every log of it, all or none."""
    try:
        flight = fly(scenario, seed)
        with ExitStack() as stages:
            stage = {
                folder: stages.enter_context(staging_folder(folder, SIMULATED_LOG))
                for folder in {p.parent for p in paths}
            }
            for path in paths:
                write(stage[path.parent] / path.name, flight, params)
        return [(path, path.stat().st_size) for path in paths]
    except Exception as error:
        return error
