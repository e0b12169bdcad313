"""Single values of a scenario set by hand: ``sensors.imu.0.gyro.bias_dps=[1,0,0]``, and ranges of seeds."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import is_dataclass
from typing import Any

from attlog.base.errors import UsageError
from attlog.simulate.scenario.scenario import Scenario

MOST_SEEDS = 10_000
"""More files in one call are a mistake in typing."""


def overridden(values: Mapping[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """The values of a scenario's file with ``KEY=VALUE`` set, in order.

    A key goes down through tables by points, as in TOML; a list of tables (``sensors.imu``, ``fault``) takes the
    number of one, from 0, the next new one included; without a number all are meant. Values are TOML; what is
    none is text. UsageError for a setting without ``=`` and for a key that leads nowhere; what the scenario does
    not know is told when it is built.
    """
    found = copy.deepcopy(dict(values))
    for setting in settings:
        key, equals, text = setting.partition("=")
        path = key.strip().replace("[", ".").replace("]", "").split(".")
        if not equals or not all(path):
            raise UsageError(f"--set {setting}: write KEY=VALUE, for example wind.mean_ned_m_s=[4,0,0]")
        _put(found, path, _value(text.strip()), Scenario(), setting)
    return found


def seeds(text: str) -> list[int]:
    """The seeds of ``7``, ``1..20`` or ``1,5,9``. UsageError for anything else."""
    found: list[int] = []
    for part in text.split(","):
        first, dots, last = part.strip().partition("..")
        if not first.isdecimal() or (dots and not last.isdecimal()):
            raise UsageError(f"--seeds {text}: write a range 1..20 or a list 1,5,9 of whole numbers from 0")
        ends = int(first), int(last or first)
        if ends[1] < ends[0] or ends[1] - ends[0] >= MOST_SEEDS:
            raise UsageError(f"--seeds {text}: {part.strip()} is no range of 1 to {MOST_SEEDS} seeds")
        found += range(ends[0], ends[1] + 1)
    return list(dict.fromkeys(found))


def _value(text: str) -> Any:
    """A TOML value, else the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _put(table: dict[str, Any], path: list[str], value: Any, default: Any, setting: str) -> None:
    """Set one value below ``table``; ``default`` is what the scenario has at this place if nothing is given."""
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
        _put(below, rest, value, default, setting)
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
            _put(items[k], rest, value, inner, setting)
        else:
            raise UsageError(f"--set {setting}: {key} holds values and has nothing below them")
