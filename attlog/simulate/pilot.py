"""The autopilot of a simulated quadrotor: estimator, navigation, guidance, controller, once per period of the loop."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.estimators import EstimatorSpec
from attlog.simulate import controller
from attlog.simulate.flight import Onboard, SensorInputs
from attlog.simulate.guidance import Guidance, Navigator
from attlog.simulate.onboard import TRUE_ATTITUDE, Live, stepping_estimator
from attlog.simulate.scenario import ROTOR_SIGNS, ROTOR_TURNS, Scenario
from attlog.simulate.sensors import is_acting, ramp_share

Array = NDArray[np.float64]

# On the mean sphere; places of a flight are within a few kilometres.
METRES_PER_DEG = math.radians(6371008.8)
ROTORS = len(ROTOR_SIGNS)


class Pilot:
    """Autopilot that flies a scenario's commands on the attitude of its estimator, or on ``truth``.

    It arms once there is an attitude. ``row``: the scenario's estimator where it is loaded already, as in the
    process of a plug-in. UsageError for an estimator that cannot fly.
    """

    def __init__(
        self, scenario: Scenario, gravity: float, declination: float, row: EstimatorSpec | None = None
    ) -> None:
        self._scenario, vehicle, sensors = scenario, scenario.vehicle, scenario.sensors
        self._dt = 1.0 / scenario.loop.rate_hz
        self._gains = controller.Gains.of(scenario.controller)
        self._packed, self._state = self._gains.pack(), controller.new_controller_state()
        self._shares = controller.mixer(ROTOR_SIGNS, ROTOR_TURNS)
        self._out = np.zeros(ROTORS + 7)
        self._guidance = Guidance(scenario.command, scenario.controller, vehicle.hover_command(gravity), gravity)
        self._attitude, self._rate = np.zeros(4), np.zeros(3)
        wanted = (self._guidance.command, self._shares, self._dt, self._out)
        self._control = controller.control.bound(self._state, self._packed, self._attitude, self._rate, *wanted)
        self._navigator = Navigator(gravity)
        name, params = scenario.estimator.name, scenario.estimator.params
        self._live: Live | None = None
        if name != TRUE_ATTITUDE:
            self._live = Live(
                row or estimator_spec(name, params),
                sensors.imu[0].rate_hz,
                sensors.mag[0].rate_hz if sensors.mag else None,
                sampling=sensors.imu[0].sampling,
                declination=math.degrees(declination),
            )
        elif params:
            raise UsageError(f"{TRUE_ATTITUDE} has no parameters, not {', '.join(params)}")
        self._q, self._bias = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
        self._gyro = np.zeros(3)
        self._ready = self._live is None
        self._mag: Array | None = None
        self._kept: list[Array] = []
        self._outputs = [f for f in scenario.fault if f.part == "output"]
        self._gain_faults = [f for f in scenario.fault if f.part == "gain"]
        self._sent = np.zeros(ROTORS)
        self._lines: dict[str, list[tuple[float, bool | str]]] = {
            "armed": [(0.0, False)],
            "landed": [(0.0, True)],
            "mode": [(0.0, "STABILIZE")],
        }

    def step(self, t: float, measured: SensorInputs) -> Array:
        """Return motor commands (4,), 0 to 1, at ``t``."""
        guidance = self._guidance
        standing = guidance.landed and not guidance.armed
        if self._live is None:
            self._q, rate, p, v = measured.truth
            placed = True
        else:
            self._feed(t, measured, self._live, standing)
            rate = self._gyro - self._bias
            p, v = self._navigator.p, self._navigator.v
            placed = self._navigator.placed(t)
        if self._ready:
            guidance.step(t, self._dt, self._q, p, v, placed)
        self._attitude[:], self._rate[:] = self._q, rate
        if self._gain_faults:
            self._packed[:] = controller.scaled_rate_gains(self._gains.pack(), self._factors(t))
        self._control()
        motors = self._out[:ROTORS].copy()
        if guidance.armed and guidance.landed:
            motors[:] = self._gains.idle
        for fault in self._outputs:
            if fault.holds(t):
                motors[fault.instance] = self._sent[fault.instance] if fault.kind == "stuck" else 0.0
        self._sent = motors
        self._note(t, motors)
        return motors

    def _factors(self, t: float) -> list[float]:
        """Return the factors of the rate gains of roll, pitch and yaw at ``t``."""
        factors = [1.0, 1.0, 1.0]
        for fault in self._gain_faults:
            if fault.holds(t):
                factors[fault.instance] *= fault.factor
        return factors

    def onboard(self) -> Onboard:
        """Return estimates and set-points of every step."""
        x = np.array(self._kept).reshape(-1, 19 + ROTORS)
        name = self._scenario.estimator.name if self._live is None else self._live.row.name
        turn = heading_error(self._scenario, x[:, 0])
        return Onboard(
            t=x[:, 0],
            q=rotation.turn_about_down(x[:, 1:5], turn) if turn.any() else x[:, 1:5],
            bias=x[:, 5:8],
            q_setpoint=rotation.turn_about_down(x[:, 8:12], turn) if turn.any() else x[:, 8:12],
            rate_setpoint=x[:, 12:15],
            torque_setpoint=x[:, 15:18],
            thrust_setpoint=x[:, 18],
            motors=x[:, 19:],
            armed=[(t, bool(v)) for t, v in self._lines["armed"]],
            landed=[(t, bool(v)) for t, v in self._lines["landed"]],
            mode=[(t, str(v)) for t, v in self._lines["mode"]],
            estimator=name,
        )

    def _feed(self, t: float, measured: SensorInputs, live: Live, standing: bool) -> None:
        """Hand new samples to estimator and navigation."""
        navigator = self._navigator
        live.aids.resting(standing)
        if measured.fix is not None:
            fix, place = measured.fix, self._scenario.place
            navigator.fix(t, fix.t_sample, fix.ned, fix.vel)
            east = METRES_PER_DEG * math.cos(math.radians(place.lat_deg))
            north, way, down = fix.ned.tolist()
            position = (place.lat_deg + north / METRES_PER_DEG, place.lon_deg + way / east, place.alt_m - down)
            live.aids.gnss(t, position, fix.vel, (math.nan, math.nan, math.nan))
        if measured.height is not None:
            navigator.height(t, measured.height, standing)
            live.aids.baro(t, measured.height)
        if measured.mag is not None:
            self._mag = measured.mag
        for row in measured.imu:
            at, dt, x, y, z = row[:5].tolist()
            rate, force = row[2:5], row[5:8]
            if math.isfinite(x + y + z):
                self._gyro = rate
            live.sample(at, rate, force, self._mag, dt)
            self._mag = None
            if live.q is not None:
                self._ready, self._q, self._bias = True, live.q, live.bias
            if self._ready:
                navigator.inertial(t, dt, self._q, force, standing)

    def _note(self, t: float, motors: Array) -> None:
        """Record this step's estimates and set-points."""
        guidance, out = self._guidance, self._out
        kept = np.empty(19 + ROTORS)
        kept[0], kept[1:5], kept[5:8] = t, self._q if self._ready else math.nan, self._bias
        kept[8:12], kept[12:19], kept[19:] = guidance.command[:4], out[ROTORS:], motors
        self._kept.append(kept)
        for name, line in self._lines.items():
            value = getattr(guidance, name)
            if value != line[-1][1]:
                line.append((t, value))


def heading_error(scenario: Scenario, t: Array) -> Array:
    """Return by how much (n,) rad the onboard heading is off at times (n,) s, by faults."""
    error = np.zeros(len(t))
    for fault in scenario.fault:
        if fault.part == "heading":
            share = ramp_share(fault, t) if fault.kind == "ramp" else is_acting(fault, t)
            error += share * math.radians(fault.value[0])
    return error


def estimator_spec(name: str, params: dict[str, bool | float | str]) -> str:
    """Return ``NAME[@PRESET]:k=v,...`` of a scenario's table."""
    if not params:
        return name
    values = ",".join(f"{k}={v!r}" if isinstance(v, float) else f"{k}={v}" for k, v in params.items())
    return f"{name}{',' if ':' in name else ':'}{values}"


def make_pilot(scenario: Scenario, gravity: float, declination: float, row: EstimatorSpec | None = None) -> Pilot:
    """Return the autopilot of a scenario at a place with this gravity (m/s^2) and declination (rad)."""
    return Pilot(scenario, gravity, declination, row)


def is_from_file(scenario: Scenario) -> EstimatorSpec | None:
    """Return the scenario's estimator if its code is a plug-in's. Errors as of :func:`stepping_estimator`."""
    if scenario.estimator.name == TRUE_ATTITUDE:
        return None
    row = stepping_estimator(estimator_spec(scenario.estimator.name, scenario.estimator.params))
    return None if row.estimator.process is None else row
