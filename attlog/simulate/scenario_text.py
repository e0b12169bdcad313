"""A scenario as TOML text: written with every value, overridden on the command line, entries without effect."""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from datetime import datetime
from typing import Any

from attlog.core.errors import UsageError
from attlog.simulate.scenario import Command, PlantedFault, Scenario


def scenario_toml(scenario: Scenario) -> str:
    """Return a scenario as TOML with every value; entries of None are left out."""
    return "\n".join(_table_lines("", _plain_values(scenario))).strip() + "\n"


def _plain_values(table: Any) -> dict[str, Any]:
    """Return the keys of a table and their values, None left out."""
    if isinstance(table, Mapping):
        return dict(table)
    return {f.name: value for f in fields(table) if (value := getattr(table, f.name)) is not None}


def _table_lines(path: str, values: dict[str, Any]) -> Iterator[str]:
    """Return the lines of a table: its own values, then the tables below it."""
    below: list[tuple[str, Any]] = []
    for key, value in values.items():
        if is_dataclass(value) or isinstance(value, Mapping) or _is_list_of_tables(value):
            below.append((key, value))
        else:
            yield f"{key} = {_toml_text(value)}"
    for key, value in below:
        name = f"{path}.{key}" if path else key
        if _is_list_of_tables(value):
            for item in value:
                yield f"\n[[{name}]]"
                yield from _table_lines(name, _plain_values(item))
        elif _plain_values(value):
            yield f"\n[{name}]"
            yield from _table_lines(name, _plain_values(value))


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, tuple) and bool(value) and is_dataclass(value[0])


def _toml_text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(_toml_text(item) for item in value)}]"
    return repr(value)


# More files in one call are a typing error.
MAX_SEEDS = 10_000


def override_values(values: Mapping[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """Return the values of a scenario's file with ``KEY=VALUE`` set, in order.

    Dots lead down through tables, as in TOML. A list of tables (``sensors.imu``, ``fault``) takes a number from 0,
    the next new one included; without a number all are meant. Values are TOML, else text. UsageError for a setting
    without ``=`` and for a key that leads nowhere; unknown keys are reported when the scenario is built.
    """
    found = copy.deepcopy(dict(values))
    for setting in settings:
        key, equals, text = setting.partition("=")
        path = key.strip().replace("[", ".").replace("]", "").split(".")
        if not equals or not all(path):
            raise UsageError(f"--set {setting}: write KEY=VALUE, for example wind.mean_ned_m_s=[4,0,0]")
        _put_value(found, path, _parse_value(text.strip()), Scenario(), setting)
    return found


def parse_seeds(text: str) -> list[int]:
    """Return the seeds of ``7``, ``1..20`` or ``1,5,9``. UsageError for anything else."""
    found: list[int] = []
    for part in text.split(","):
        first, dots, last = part.strip().partition("..")
        if not first.isdecimal() or (dots and not last.isdecimal()):
            raise UsageError(f"--seeds {text}: write a range 1..20 or a list 1,5,9 of whole numbers from 0")
        ends = int(first), int(last or first)
        if ends[1] < ends[0] or ends[1] - ends[0] >= MAX_SEEDS:
            raise UsageError(f"--seeds {text}: {part.strip()} is no range of 1 to {MAX_SEEDS} seeds")
        found += range(ends[0], ends[1] + 1)
    return list(dict.fromkeys(found))


def _parse_value(text: str) -> Any:
    """Return a TOML value, else the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _put_value(table: dict[str, Any], path: list[str], value: Any, default: Any, setting: str) -> None:
    """Set one value below ``table``; ``default``: the scenario's value at this place."""
    key, rest = path[0], path[1:]
    default = getattr(default, key, None)
    if not rest:
        table[key] = value
        return
    listed = isinstance(table.get(key), list) or isinstance(default, tuple)
    if not listed:
        below = table.setdefault(key, {})
        if not isinstance(below, dict):
            raise UsageError(f"--set {setting}: {key} is a value and has nothing below it")
        _put_value(below, rest, value, default, setting)
        return
    tables = default if isinstance(default, tuple) and default and is_dataclass(default[0]) else ()
    items = table.setdefault(key, [{} for _ in tables])
    inner = tables[0] if tables else None
    if not rest[0].isdecimal():
        if not items:
            raise UsageError(f"--set {setting}: there is no {key} yet; write {key}.0.{'.'.join(rest)} for a new one")
        chosen = range(len(items))
    else:
        chosen = range(int(rest[0]), int(rest[0]) + 1)
        rest = rest[1:]
        if chosen[0] > len(items):
            raise UsageError(f"--set {setting}: there are {len(items)} of {key}, the next new one is {len(items)}")
    for k in chosen:
        if k == len(items):
            items.append({})
        if not rest:
            items[k] = value
        elif isinstance(items[k], dict):
            _put_value(items[k], rest, value, inner, setting)
        else:
            raise UsageError(f"--set {setting}: {key} holds values and has nothing below them")


TURN_VALUES = {"heading_deg", "yaw_rate_dps"}
FLIGHT_VALUES = TURN_VALUES | {"up_m"}
# Values that a command uses (:mod:`attlog.simulate.guidance`).
VALUES_OF_COMMAND = {
    "arm": TURN_VALUES,
    "takeoff": FLIGHT_VALUES,
    "hold": FLIGHT_VALUES,
    "goto": FLIGHT_VALUES | {"north_m", "east_m", "speed_m_s"},
    "velocity": FLIGHT_VALUES | {"north_m_s", "east_m_s"},
    "attitude": FLIGHT_VALUES | {"roll_deg", "pitch_deg"},
    "track": FLIGHT_VALUES | {"axis", "shape", "amplitude_deg", "period_s"},
    "land": TURN_VALUES,
    "disarm": set(),
    "kill": set(),
}
# Value that gives the size of a fault; all others need none.
FAULT_SIZE = {"offset": "value", "ramp": "value", "scale": "factor", "unbalanced": "factor", "noise": "size",
              "spikes": "size"}  # fmt: skip


def ineffective_entries(scenario: Scenario) -> list[str]:
    """Return a sentence with its place for every entry that changes nothing in the flight."""
    return [*_after_the_end(scenario), *_unused_values(scenario), *_harmless_faults(scenario)]


def _after_the_end(scenario: Scenario) -> Iterator[str]:
    """Return entries that begin after the flight."""
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
    for k, change in enumerate(scenario.parameter):
        if change.t >= end:
            yield f"parameter[{k}]: {change.name} at {change.t:g} s is not set; {over}"
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


def _unused_values(scenario: Scenario) -> Iterator[str]:
    """Return values of commands that only others use."""
    for k, command in enumerate(scenario.command):
        for field in fields(Command):
            if field.name in ("t", "do") or getattr(command, field.name) == field.default:
                continue
            if field.name not in VALUES_OF_COMMAND[command.do]:
                users = ", ".join(do for do, asked in VALUES_OF_COMMAND.items() if field.name in asked)
                yield f"command[{k}].{field.name}: does nothing in {command.do}, only in {users}"


def _harmless_faults(scenario: Scenario) -> Iterator[str]:
    """Return faults that change no number, and rotor faults where none turns."""
    standard = {field.name: field.default for field in fields(PlantedFault)}
    for k, fault in enumerate(scenario.fault):
        needed = "factor" if (fault.part, fault.kind) == ("rotor", "ramp") else FAULT_SIZE.get(fault.kind)
        if needed is not None and getattr(fault, needed) == standard[needed]:
            yield f"fault[{k}]: {fault.kind} changes nothing as long as {needed} is {standard[needed]}"
        if fault.seconds == 0.0:
            yield f"fault[{k}].seconds: 0 s change nothing; leave it out for a fault that lasts to the end"
        if fault.part == "rotor" and scenario.motion is not None and not scenario.command:
            yield f"fault[{k}]: rotors stand still in a prescribed motion"
