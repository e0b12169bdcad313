"""What stands in a scenario and changes nothing: commands and faults after its end, values that nothing asks for.

A scenario is flown all the same: a shorter flight of a longer scenario is a fair wish. But whoever wrote the value
meant something by it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from attlog.simulate.fault import PlantedFault
from attlog.simulate.scenario.commands import Command
from attlog.simulate.scenario.scenario import Scenario

TURNING = {"heading_deg", "yaw_rate_dps"}
FLYING = TURNING | {"up_m"}
ASKED_OF = {
    "arm": TURNING,
    "takeoff": FLYING,
    "hold": FLYING,
    "goto": FLYING | {"north_m", "east_m", "speed_m_s"},
    "velocity": FLYING | {"north_m_s", "east_m_s"},
    "attitude": FLYING | {"roll_deg", "pitch_deg"},
    "track": FLYING | {"axis", "shape", "amplitude_deg", "period_s"},
    "land": TURNING,
    "disarm": set(),
    "kill": set(),
}
"""The values of a command that count for what it does (:mod:`attlog.simulate.autopilot.guidance`)."""
HOW_MUCH = {"offset": "value", "scale": "factor", "unbalanced": "factor", "noise": "size", "spikes": "size"}
"""The value that says how much a fault does; all others need none."""


def without_effect(scenario: Scenario) -> list[str]:
    """A sentence with its place for everything in a scenario that changes nothing in the flight."""
    return [*_late(scenario), *_not_asked(scenario), *_harmless(scenario)]


def _late(scenario: Scenario) -> Iterator[str]:
    """What begins when the flight is over."""
    end = scenario.seconds
    over = f"the flight ends after {end:g} s (seconds)"
    for k, command in enumerate(scenario.command):
        if command.t >= end:
            yield f"command[{k}]: {command.do} at {command.t:g} s is not flown; {over}"
    begin = (scenario.motion.after_s or 0.0) if scenario.motion else 0.0
    for k, move in enumerate(scenario.motion.move if scenario.motion else ()):
        if begin >= end:
            yield f"motion.move[{k}]: begins at {begin:g} s and is not made; {over}"
        begin += move.seconds
    for k, fault in enumerate(scenario.fault):
        if fault.t >= end:
            yield f"fault[{k}]: {fault.part} {fault.kind} at {fault.t:g} s does not happen; {over}"
    for k, gust in enumerate(scenario.wind.gust):
        if gust.t >= end:
            yield f"wind.gust[{k}]: at {gust.t:g} s does not blow; {over}"
    for where, sensor in scenario.sensors.each():
        for key in ("gaps", "outages"):
            for first, last in getattr(sensor, key, ()):
                if first >= end:
                    yield f"{where}.{key}: [{first:g}, {last:g}] is not reached; {over}"
        if getattr(sensor, "first_fix_s", 0.0) >= end:
            yield f"{where}.first_fix_s: {sensor.first_fix_s:g} s is not reached, there is no fix at all; {over}"


def _not_asked(scenario: Scenario) -> Iterator[str]:
    """Values of commands that count only for others."""
    for k, command in enumerate(scenario.command):
        for field in fields(Command):
            if field.name in ("t", "do") or getattr(command, field.name) == field.default:
                continue
            if field.name not in ASKED_OF[command.do]:
                users = ", ".join(do for do, asked in ASKED_OF.items() if field.name in asked)
                yield f"command[{k}].{field.name}: does nothing in {command.do}, only in {users}"


def _harmless(scenario: Scenario) -> Iterator[str]:
    """Faults that change no number, and rotors that fail where none turns."""
    standard = {field.name: field.default for field in fields(PlantedFault)}
    for k, fault in enumerate(scenario.fault):
        needed = HOW_MUCH.get(fault.kind)
        if needed is not None and getattr(fault, needed) == standard[needed]:
            yield f"fault[{k}]: {fault.kind} changes nothing as long as {needed} is {standard[needed]}"
        if fault.seconds == 0.0:
            yield f"fault[{k}].seconds: 0 s change nothing; leave it out for a fault that lasts to the end"
        if fault.part == "rotor" and scenario.motion is not None and not scenario.command:
            yield f"fault[{k}]: rotors stand still in a prescribed motion"
