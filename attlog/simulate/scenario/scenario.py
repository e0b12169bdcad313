"""A scenario: everything that decides a simulated flight but the seed, from TOML or as frozen dataclasses.

``load`` takes the name of one in ``scenarios/`` or the path of a TOML file and tells
everything that is wrong in it at once. Units stand in the names; angles are degrees
here and radians inside.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field
from pydantic.dataclasses import dataclass

from attlog.base.errors import UsageError, suggestion
from attlog.base.files.settings_file import text_of, toml_of
from attlog.base.validation import checked
from attlog.simulate.autopilot.loop import Controller, EstimatorChoice, LoggingRates, Loop
from attlog.simulate.fault import PlantedFault
from attlog.simulate.scenario.commands import Command, PrescribedMotion
from attlog.simulate.scenario.place import Anomaly, TakeoffPlace, Wind
from attlog.simulate.scenario.vehicle import Vehicle
from attlog.simulate.sensors.settings import STRICT, SensorSettings

LIBRARY = Path(__file__).parents[1] / "scenarios"
NAME = r"^[^/\\\x00-\x1f]*$"
"""Names are names of files: no path."""
MOST_STEPS = 20_000_000
"""Steps of physics in a flight: what an hour or two at the default rates take, about 1 GB and minutes."""
OF_ROTORS = ("off", "scale", "unbalanced")


@dataclass(frozen=True, config=STRICT)
class Scenario:
    """A flight to simulate. With ``motion`` it is prescribed, else ``command`` tells the autopilot what to do and
    when; with both it is flown, and carried from ``motion.after_s`` on."""

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

    def changed(self, **values: Any) -> Scenario:
        """A copy with other values, checked like a file: ``changed(seconds=20, estimator=Estimator("truth"))``."""
        return dataclasses.replace(self, **values)


def names() -> list[str]:
    """The scenarios that come with attlog."""
    return sorted(path.stem for path in LIBRARY.glob("*.toml"))


def load(name_or_path: str | Path) -> Scenario:
    """A scenario by its name in the library or by the path of a TOML file.

    LogUnreadable where the file cannot be opened, UsageError for a name that is not
    known and for everything wrong in a file.
    """
    return build(values_of(name_or_path), origin=place_of(name_or_path).name)


def place_of(name_or_path: str | Path) -> Path:
    """The TOML file of a scenario. UsageError for a name that is not known."""
    path = Path(name_or_path)
    if path.suffix.lower() == ".toml" or os.path.isfile(path):
        return path
    inside = LIBRARY / f"{name_or_path}.toml"
    if not os.path.isfile(inside):
        raise UsageError(f"no scenario {name_or_path}{suggestion(str(name_or_path), names())}")
    return inside


def values_of(name_or_path: str | Path) -> dict[str, Any]:
    """The plain values of a scenario's file, with the file's name where it has none; errors as of :func:`load`."""
    path = place_of(name_or_path)
    return {"name": path.stem} | toml_of(text_of(path), path)


def build(values: Mapping[str, Any], origin: str = "scenario") -> Scenario:
    """A scenario from plain values, as TOML holds them. UsageError lists every problem with its place."""
    scenario = checked(Scenario, values, origin, strict=True)
    problems = [*_refused_spans(scenario), *_contradictions(scenario)]
    if problems:
        raise UsageError("\n".join(f"{origin}: {line}" for line in problems))
    return scenario


def _contradictions(scenario: Scenario) -> list[str]:
    """What single values do not show."""
    found = []
    raw = scenario.loop.rate_hz * scenario.loop.substeps
    if scenario.seconds * raw > MOST_STEPS:
        found.append(
            f"seconds: {scenario.seconds:g} s at loop.rate_hz x substeps = {raw:g} are too many steps; "
            f"take up to {MOST_STEPS / raw:g} s"
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
    counts = {"gyro": len(scenario.sensors.imu), "acc": len(scenario.sensors.imu), "mag": len(scenario.sensors.mag)}
    counts |= {"gnss": len(scenario.sensors.gnss), "baro": len(scenario.sensors.baro), "rotor": 4}
    for k, fault in enumerate(scenario.fault):
        if fault.instance >= counts[fault.part]:
            found.append(f"fault[{k}].instance: there is no {fault.part} {fault.instance}")
        if fault.part == "rotor" and fault.kind not in OF_ROTORS:
            found.append(f"fault[{k}].kind: a rotor can be {' or '.join(OF_ROTORS)}, not {fault.kind}")
        if fault.part != "rotor" and fault.kind == "off":
            found.append(f"fault[{k}].kind: only a rotor is off; a sensor that sends nothing is silent")
        if fault.part != "rotor" and fault.kind == "unbalanced":
            found.append(f"fault[{k}].kind: only a rotor is unbalanced; a sensor that shakes has noise")
    return found


def _both_motions(scenario: Scenario) -> Iterator[str]:
    """Commands and a motion by hand go together only where one comes after the other."""
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
    """Times without samples that are none."""
    for where, sensor in scenario.sensors.each():
        for key in ("gaps", "outages"):
            for first, last in getattr(sensor, key, ()):
                if last < first:
                    yield f"{where}.{key}: [{first:g}, {last:g}] ends before it begins"
                elif first < 0.0:
                    yield f"{where}.{key}: [{first:g}, {last:g}] begins before the flight, which starts at 0 s"
