"""A scenario: everything that decides a simulated flight but the seed, from TOML or as frozen dataclasses.

Units are in the names; angles are degrees here and radians inside.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic.dataclasses import dataclass

from attlog.core.errors import UsageError, suggestion
from attlog.core.files import parse_toml, read_settings_text
from attlog.core.settings import validated
from attlog.simulate.sensor_settings import STRICT, ZERO, NotNegative, Positive, SensorSettings, Three

Value = bool | float | str


@dataclass(frozen=True, config=STRICT)
class Loop:
    """Rate of controller and estimator; physics and raw sensors run ``substeps`` times as fast."""

    rate_hz: Annotated[float, Field(ge=50, le=2000)] = 400.0
    substeps: Annotated[int, Field(ge=1, le=50)] = 5


@dataclass(frozen=True, config=STRICT)
class Controller:
    """Nested loops: angle error [rad] to rate (PI), rate error [rad/s] to torque as a share of the largest (PID).

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
    """Attitude that is flown on: a filter of attlog (``mahony@huang``) with ``params``, or ``truth``."""

    name: str = "mahony_dcm@huang"
    params: dict[str, Value] = Field(default_factory=dict)


@dataclass(frozen=True, config=STRICT)
class LoggingRates:
    """Logging rates [Hz], 0 for every value; sensors have their own rates unless given.

    Without ``truth`` the log lacks the true motion, as that of a real vehicle does.
    """

    imu_hz: NotNegative = 0.0
    attitude_hz: NotNegative = 100.0
    setpoint_hz: NotNegative = 50.0
    motors_hz: NotNegative = 50.0
    truth_hz: NotNegative = 100.0
    truth: bool = True


NotNegativeThree = tuple[NotNegative, NotNegative, NotNegative]

# Rotors at (forward, right): front right, back left, front left, back right, the order of both firmwares.
ROTOR_SIGNS = ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))
# Yaw torque on the body, + to the right: the first two turn anticlockwise seen from above.
ROTOR_TURNS = (1.0, 1.0, -1.0, -1.0)


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
        """Return the rotor speed at full command [rad/s]."""
        return self.speed_max_rpm * math.pi / 30.0

    @property
    def thrust_factor(self) -> float:
        """Return the thrust of a rotor over the square of its speed [N s^2]."""
        return self.thrust_max_n / self.speed_max_rad_s**2

    def hover_command(self, gravity: float) -> float:
        """Return the command (thrust over full thrust) of each rotor in still hover."""
        return self.mass_kg * gravity / (4.0 * self.thrust_max_n)


def _date(written: object) -> object:
    """Return the time of a text; a day alone begins at midnight."""
    if not isinstance(written, str):
        return written
    try:
        return datetime.fromisoformat(written)
    except ValueError:
        raise ValueError("must be a date, 2024-03-01 or 2024-03-01T12:00:00Z") from None


@dataclass(frozen=True, config=STRICT)
class TakeoffPlace:
    """Take-off place (origin of the earth axes), time of the start, and heading then."""

    lat_deg: Annotated[float, Field(ge=-89.9, le=89.9)] = 47.397
    lon_deg: Annotated[float, Field(ge=-180, le=180)] = 8.545
    alt_m: Annotated[float, Field(ge=-500, le=6000)] = 488.0
    heading_deg: float = 0.0
    date: Annotated[datetime, BeforeValidator(_date)] = datetime(2025, 6, 1, 10, 0, tzinfo=UTC)

    @property
    def unix_time(self) -> float:
        """Return the start as Unix time [s]; a date without a zone is UTC."""
        date = self.date if self.date.tzinfo else self.date.replace(tzinfo=UTC)
        return date.timestamp()


@dataclass(frozen=True, config=STRICT)
class Gust:
    """A single gust of ``seconds`` from ``t`` on: the wind grows to ``ned_m_s`` and falls again (1 - cos)."""

    t: NotNegative
    seconds: Positive
    ned_m_s: Three


@dataclass(frozen=True, config=STRICT)
class Wind:
    """Mean wind, turbulence and gusts.

    ``mean_ned_m_s``: velocity of the air from 6 m above the ground on, less below. ``turbulence_m_s``: standard
    deviation per axis of a Dryden-like disturbance of length ``length_m``, which passes at the mean wind's speed,
    at least ``speed_m_s``.
    """

    mean_ned_m_s: Three = ZERO
    turbulence_m_s: NotNegative = 0.3
    length_m: Positive = 15.0
    speed_m_s: Positive = 4.0
    gust: tuple[Gust, ...] = ()


@dataclass(frozen=True, config=STRICT)
class Anomaly:
    """Iron at a place: adds ``field_ned_ut`` at ``ned_m``, a Gauss bell of width ``radius_m``."""

    ned_m: Three
    field_ned_ut: Three
    radius_m: Positive = 3.0


Doing = Literal["arm", "takeoff", "hold", "goto", "velocity", "attitude", "track", "land", "disarm", "kill"]


@dataclass(frozen=True, config=STRICT)
class Command:
    """A command from ``t`` s on, until the next.

    ``arm`` (rotors idle), ``takeoff`` (climb to ``up_m``), ``hold`` (stay where it is), ``goto`` (``north_m east_m
    up_m`` with up to ``speed_m_s``), ``velocity`` (``north_m_s east_m_s``, height held), ``attitude`` (``roll_deg
    pitch_deg``, height held), ``track`` (roll or pitch follows ``amplitude_deg`` as sine or square of ``period_s``,
    height held), ``land``, ``disarm``, ``kill`` (rotors stop at once). Heading turns to ``heading_deg`` with
    ``yaw_rate_dps``; None leaves it as it was.
    """

    t: NotNegative
    do: Doing
    north_m: float = 0.0
    east_m: float = 0.0
    up_m: float | None = None
    speed_m_s: Positive = 3.0
    north_m_s: float = 0.0
    east_m_s: float = 0.0
    roll_deg: Annotated[float, Field(ge=-80, le=80)] = 0.0
    pitch_deg: Annotated[float, Field(ge=-80, le=80)] = 0.0
    heading_deg: float | None = None
    yaw_rate_dps: Positive = 45.0
    axis: Literal["roll", "pitch"] = "roll"
    shape: Literal["sine", "square"] = "sine"
    amplitude_deg: Annotated[float, Field(ge=0, le=60)] = 10.0
    period_s: Positive = 4.0


@dataclass(frozen=True, config=STRICT)
class Move:
    """A smooth move to these angles and height within ``seconds`` (fifth order, no jump in rate or acceleration).

    What is not given stays. ``north_m east_m`` count from its begin. ``shock_m_s2``: impact at the end, along body
    down, that rings off in hundredths of a second.
    """

    seconds: Positive
    roll_deg: float | None = None
    pitch_deg: Annotated[float | None, Field(ge=-85, le=85)] = None
    heading_deg: float | None = None
    up_m: float | None = None
    north_m: float | None = None
    east_m: float | None = None
    shock_m_s2: NotNegative = 0.0


@dataclass(frozen=True, config=STRICT)
class PrescribedMotion:
    """Motion by hand or on a table, with the rotors off.

    It begins at these angles, makes every ``move`` in turn, then rests. It turns about a point fixed to the earth;
    ``arm_m``: from there to the centre of gravity, body axes. After commands it carries the vehicle from
    ``after_s`` on, from its place and attitude then.
    """

    roll_deg: float = 0.0
    pitch_deg: Annotated[float, Field(ge=-85, le=85)] = 0.0
    arm_m: Three = ZERO
    after_s: NotNegative | None = None
    move: tuple[Move, ...] = ()


Part = Literal["gyro", "acc", "mag", "gnss", "baro", "rotor", "output", "heading", "gain"]
Kind = Literal[
    "stuck", "silent", "zero", "offset", "ramp", "scale", "noise", "spikes", "flipped", "off", "stopped", "unbalanced"
]


@dataclass(frozen=True, config=STRICT)
class PlantedFault:
    """A fault of ``part`` number ``instance`` from ``t`` for ``seconds`` (None: to the end).

    ``stuck`` at its last value, ``silent`` (no samples), ``zero``, ``offset`` by ``value`` (SI; T for mag, m and
    m/s NED for gnss; baro: m, the first), ``ramp`` (an offset that grows to ``value`` within ``seconds`` and stays; of
    gnss the position alone), ``scale`` by ``factor``, ``noise`` of standard deviation ``size`` added (SI), ``spikes``
    of ``size`` in ``share_pct`` of the samples, ``flipped`` (x and y change sign). A rotor is ``off`` (turns without
    thrust, its propeller lost), ``stopped`` (its motor dead), ``scale`` d in thrust at once or by ``ramp``, or
    ``unbalanced``: it shakes every IMU ``factor`` times as much. ``output``: what the autopilot sends to a motor is
    ``stuck`` or ``zero``. ``heading``: the onboard one is off by the first ``value`` [deg], set-points with it.
    ``gain``: the rate gains of the axis ``instance`` (roll, pitch, yaw) are a ``scale`` times those of the controller.
    """

    t: NotNegative
    part: Part
    kind: Kind
    seconds: NotNegative | None = None
    instance: Annotated[int, Field(ge=0)] = 0
    value: Three = ZERO
    factor: float = 1.0
    size: NotNegative = 0.0
    share_pct: Annotated[float, Field(ge=0, le=100)] = 1.0

    def holds(self, t: float) -> bool:
        """Return whether it acts at ``t`` s."""
        return t >= self.t and (self.seconds is None or t < self.t + self.seconds)


@dataclass(frozen=True, config=STRICT)
class ParameterChange:
    """A parameter set at ``t`` s, logged by the firmware that has it; nothing else on board changes."""

    t: NotNegative
    firmware: Literal["ardupilot", "px4"]
    name: Annotated[str, Field(pattern=r"^[A-Z0-9_]{1,16}$")]
    value: float


LIBRARY = Path(__file__).parent / "scenarios"
# Names become file names: no path.
NAME = r"^[^/\\\x00-\x1f]*$"
# Steps of physics in a flight: an hour or two at the default rates, about 1 GB and minutes.
MAX_STEPS = 20_000_000
ROTOR_FAULTS = ("off", "stopped", "scale", "ramp", "unbalanced")
OUTPUT_FAULTS = ("stuck", "zero")
HEADING_FAULTS = ("offset", "ramp")
GAIN_FAULTS = ("scale",)


@dataclass(frozen=True, config=STRICT)
class Scenario:
    """A flight to simulate.

    With ``motion`` it is prescribed, with ``command`` it is flown; with both it is carried from ``motion.after_s``
    on.
    """

    name: Annotated[str, Field(pattern=NAME)] = ""
    title: str = ""
    seconds: Annotated[float, Field(ge=1, le=7200)] = 60.0
    place: TakeoffPlace = TakeoffPlace()
    wind: Wind = Wind()
    anomaly: tuple[Anomaly, ...] = ()
    vehicle: Vehicle = Vehicle()
    sensors: SensorSettings = SensorSettings()
    motion: PrescribedMotion | None = None
    command: tuple[Command, ...] = ()
    loop: Loop = Loop()
    controller: Controller = Controller()
    estimator: EstimatorChoice = EstimatorChoice()
    logging: LoggingRates = LoggingRates()
    fault: tuple[PlantedFault, ...] = ()
    parameter: tuple[ParameterChange, ...] = ()

    def changed(self, **values: Any) -> Scenario:
        """Return a copy with other values, validated like a file."""
        return dataclasses.replace(self, **values)


def scenario_names() -> list[str]:
    """Return the names of the library."""
    return sorted(path.stem for path in LIBRARY.glob("*.toml"))


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Load a scenario by its name in the library or by the path of a TOML file.

    LogUnreadable where the file cannot be opened; UsageError names an unknown name or everything wrong in the file.
    """
    return build_scenario(scenario_values(name_or_path), origin=scenario_path(name_or_path).name)


def scenario_path(name_or_path: str | Path) -> Path:
    """Return the TOML file of a scenario. UsageError for an unknown name."""
    path = Path(name_or_path)
    if path.suffix.lower() == ".toml" or os.path.isfile(path):
        return path
    inside = LIBRARY / f"{name_or_path}.toml"
    if not os.path.isfile(inside):
        raise UsageError(f"no scenario {name_or_path}{suggestion(str(name_or_path), scenario_names())}")
    return inside


def scenario_values(name_or_path: str | Path) -> dict[str, Any]:
    """Return the plain values of a scenario's file. Errors as of :func:`load_scenario`."""
    path = scenario_path(name_or_path)
    return {"name": path.stem} | parse_toml(read_settings_text(path), path)


def build_scenario(values: Mapping[str, Any], origin: str = "scenario") -> Scenario:
    """Build a scenario from plain values of TOML. UsageError lists every problem with its place."""
    scenario = validated(Scenario, values, origin, strict=True)
    problems = [*_refused_spans(scenario), *_contradictions(scenario)]
    if problems:
        raise UsageError("\n".join(f"{origin}: {line}" for line in problems))
    return scenario


def _contradictions(scenario: Scenario) -> list[str]:
    """Return contradictions between values."""
    found = []
    raw = scenario.loop.rate_hz * scenario.loop.substeps
    if scenario.seconds * raw > MAX_STEPS:
        found.append(
            f"seconds: {scenario.seconds:g} s at loop.rate_hz x substeps = {raw:g} are too many steps; "
            f"take up to {MAX_STEPS / raw:g} s"
        )
    for where, sensor in scenario.sensors.each():
        if sensor.rate_hz > raw:
            found.append(
                f"{where}.rate_hz: {sensor.rate_hz:g} is more than the raw rate, loop.rate_hz x substeps = {raw:g}"
            )
    for k, imu in enumerate(scenario.sensors.imu):
        if not len(imu.vibration.harmonics) == len(imu.vibration.acc_m_s2) == len(imu.vibration.gyro_dps):
            found.append(f"sensors.imu[{k}].vibration: harmonics, acc_m_s2 and gyro_dps must be equally long")
    if not scenario.sensors.imu:
        found.append("sensors.imu: at least one is needed")
    found += _both_motions(scenario)
    battery = scenario.sensors.battery
    if battery.empty_v > battery.full_v:
        found.append(f"sensors.battery: empty_v {battery.empty_v:g} is above full_v {battery.full_v:g}")
    lift, weight = 4.0 * scenario.vehicle.thrust_max_n, scenario.vehicle.mass_kg * 9.81
    if scenario.command and lift < 1.2 * weight:
        found.append(f"vehicle: four rotors lift {lift:.1f} N, too little to fly a weight of {weight:.1f} N")
    if [c.t for c in scenario.command] != sorted(c.t for c in scenario.command):
        found.append("command: the times must ascend")
    found += _impossible_faults(scenario)
    return found


def _impossible_faults(scenario: Scenario) -> Iterator[str]:
    """Return faults that their part cannot have."""
    counts = {"gyro": len(scenario.sensors.imu), "acc": len(scenario.sensors.imu), "mag": len(scenario.sensors.mag)}
    counts |= {
        "gnss": len(scenario.sensors.gnss),
        "baro": len(scenario.sensors.baro),
        "rotor": 4,
        "output": 4,
        "heading": 1,
        "gain": 3,
    }
    for k, fault in enumerate(scenario.fault):
        if fault.instance >= counts[fault.part]:
            yield f"fault[{k}].instance: there is no {fault.part} {fault.instance}"
        if fault.part == "rotor" and fault.kind not in ROTOR_FAULTS:
            yield f"fault[{k}].kind: a rotor can be {' or '.join(ROTOR_FAULTS)}, not {fault.kind}"
        if fault.part == "output" and fault.kind not in OUTPUT_FAULTS:
            yield f"fault[{k}].kind: an output can be {' or '.join(OUTPUT_FAULTS)}, not {fault.kind}"
        if fault.part == "heading" and fault.kind not in HEADING_FAULTS:
            yield f"fault[{k}].kind: a heading can have an {' or '.join(HEADING_FAULTS)}, not {fault.kind}"
        if fault.part == "gain" and fault.kind not in GAIN_FAULTS:
            yield f"fault[{k}].kind: a gain can have a {' or '.join(GAIN_FAULTS)}, not {fault.kind}"
        if fault.part != "rotor" and fault.kind in ("off", "stopped"):
            yield f"fault[{k}].kind: only a rotor is {fault.kind}; a sensor that sends nothing is silent"
        if fault.part != "rotor" and fault.kind == "unbalanced":
            yield f"fault[{k}].kind: only a rotor is unbalanced; a sensor that shakes has noise"
        if fault.kind == "ramp" and not fault.seconds:
            yield f"fault[{k}].seconds: a ramp needs the time within which it grows"


def _both_motions(scenario: Scenario) -> Iterator[str]:
    """Return contradictions between commands and a motion."""
    motion = scenario.motion
    if motion is None:
        return
    if scenario.command and motion.after_s is None:
        yield "motion, command: give one of them, or motion.after_s, from when on what flew is carried"
    if motion.after_s is not None and not scenario.command:
        yield "motion.after_s: nothing flew before; leave it out, or give commands"
    if motion.after_s is not None and scenario.command and scenario.command[-1].t > motion.after_s:
        yield f"motion.after_s: {motion.after_s:g} s is before the last command, {scenario.command[-1].t:g} s"


def _refused_spans(scenario: Scenario) -> Iterator[str]:
    """Return spans without samples that are no spans."""
    for where, sensor in scenario.sensors.each():
        for key in ("gaps", "outages"):
            for first, last in getattr(sensor, key, ()):
                if last < first:
                    yield f"{where}.{key}: [{first:g}, {last:g}] ends before it begins"
                elif first < 0.0:
                    yield f"{where}.{key}: [{first:g}, {last:g}] begins before the flight, which starts at 0 s"
