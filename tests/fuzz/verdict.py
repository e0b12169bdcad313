"""What must hold of every result, whatever the log: sound JSON and no number outside physics that nothing marks."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterator
from typing import Any

from attlog.flight import physics
from attlog.result.restored import expanded
from attlog.result.schema import schema

DAY_S = physics.LONGEST_S
BY_UNIT = {
    "deg": 720.0,
    "rad": 4 * math.pi,
    "deg/s": 6000.0,
    "rad/s": 110.0,
    "m/s^2": 4000.0,
    "uT": 1e4,
    "T": 1e-2,
    "Hz": physics.RAW_HZ,
    "s": DAY_S,
    "ms": 1e3 * DAY_S,
    "1": 1e6,
    "%": 1e6,
    "deg/min": 1e6,
    "m": 2e5,
    "m/s": 3e3,
}
"""Largest sizes that a number in a unit may have in a result."""
BY_NAME = {
    "rate_hz": (0.0, physics.RAW_HZ),
    "lat": (-90.0, 90.0),
    "lon": (-180.0, 180.0),
    "delay_ms": (0.0, 1000.0),
    "alt_m": (physics.HEIGHT.low, physics.HEIGHT.high),
    "duration_s": (0.0, DAY_S),
    "t": (-DAY_S, DAY_S),
    "t0": (-DAY_S, DAY_S),
    "t1": (-DAY_S, DAY_S),
    "t0_us": (0.0, physics.CLOCK_US.high),
    "seconds": (0.0, DAY_S),
    "utc_offset": (-physics.CLOCK_US.high * 1e-6, physics.UTC_US.high * 1e-6),
    "scoring_start_s": (-DAY_S, DAY_S),
    "floor_deg": (0.0, 180.0),
    "earth_turn_deg_per_min": (-1.0, 1.0),
    "start_s": (-DAY_S, DAY_S),
}
UNKNOWN = ("params", "params_changed", "detail", "config", "timing", "count", "size", "offset", "boot", "ns_per_update")
"""What may be any number: what the vehicle was set to is shown as it is, counts and places depend on the file."""
LARGEST = 1e9
IN_UNIT = ("value", "each", "floor", "ci95", "disagree", "changes")
"""What of an answer is in its unit: ends of intervals are numbers that people read, too."""


def wrong(text: str) -> list[str]:
    """Everything that is wrong with the JSON text of a result, with the place; empty for a sound one."""
    try:
        document = json.loads(text, parse_constant=_refused)
    except ValueError as error:
        return [f"no JSON: {error}"]
    found = [f"schema: {e.json_path}: {e.message[:200]}" for e in _validator().iter_errors(document)]
    return found + list(unphysical(expanded(document)))


def unphysical(value: Any, path: str = "", name: str = "", unit: str = "") -> Iterator[str]:
    """Places of numbers that no flight has."""
    if name in UNKNOWN:
        return
    if isinstance(value, dict):
        own = str(value.get("unit", ""))
        for key, inner in value.items():
            yield from unphysical(inner, f"{path}.{key}", key, own if key in IN_UNIT else "")
        yield from _interval(value, path)
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from unphysical(inner, f"{path}[{k}]", name, unit)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        size = BY_UNIT.get(unit, LARGEST)
        low, high = BY_NAME.get(name, (-size, size))
        if not low <= value <= high:
            yield f"{path} = {value:g} {unit}"


def _interval(answer: dict[str, Any], path: str) -> Iterator[str]:
    """What is wrong with the interval of an answer: it holds the value, in order, and rests on something."""
    value, ci95 = answer.get("value"), answer.get("ci95")
    if isinstance(value, int | float) and isinstance(ci95, list) and len(ci95) == 2:
        slack = 1e-9 * max(1.0, abs(value))
        if not ci95[0] - slack <= value <= ci95[1] + slack:
            yield f"{path}: {value:g} outside its interval {ci95[0]:g} to {ci95[1]:g}"
        if answer.get("n") == 0:
            yield f"{path}: an interval from nothing"


@functools.cache
def _validator() -> Any:
    import jsonschema  # type: ignore[import-untyped]

    return jsonschema.Draft202012Validator(schema())


def _refused(word: str) -> float:
    raise ValueError(f"{word} in a result")
