"""The table ``[gates.health]`` of a gate file: what is wrong with it, each with its key, and the gates that it holds.

[gates.health]
compass_offset = { max = 5 }                                # uT, on every compass
vibration_level = { verdict = "warning", sensors = ["IMU.0"] }
gnss_delay = { verdict = "ok", unknown = "pass" }           # skipped where the log cannot tell
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from attlog.base.errors import suggestion
from attlog.base.validation import NumberRange, Parsed, checked_or_problems
from attlog.compare.gates.limits import GateLimit
from attlog.compare.gates.sensors import SensorGate
from attlog.result import TOPICS

KEY = "health"
"""The table's name within that of all gates."""


def _names(value: Any) -> Any:
    """Names or patterns of sensors as a list."""
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list) or not value or "" in value:
        raise ValueError("must be a list of names or patterns of sensors, such as MAG.0")
    return value


@dataclass
class SensorGateTable:
    """What the gate of one question may say. ``max`` is of the value's size, ``verdict`` the worst that is allowed."""

    min: Annotated[float, NumberRange()] | None = None
    max: Annotated[float, NumberRange(0.0)] | None = None
    verdict: Literal["ok", "warning"] | None = None
    sensors: Annotated[list[str], Parsed(_names)] | None = None
    unknown: Literal["pass", "fail"] = "fail"
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}


def sensor_gates(table: Any) -> tuple[list[SensorGate], list[tuple[str, str, str]]]:
    """The gates of the table, and what is wrong with it: (question, key, sentence)."""
    if not isinstance(table, Mapping):
        return [], [(KEY, "", f"is {table!r}; write compass_offset = {{ max = 5 }} below [gates.{KEY}]")]
    gates: list[SensorGate] = []
    wrong: list[tuple[str, str, str]] = []
    for question, value in table.items():
        for one in value if isinstance(value, list) and value else [value]:
            gate, problems = _sensor_gate(question, one)
            gates += [] if gate is None else [gate]
            wrong += [(question, key, sentence) for key, sentence in problems]
    return gates, wrong


def _sensor_gate(question: str, table: Any) -> tuple[SensorGate | None, list[tuple[str, str]]]:
    if question not in TOPICS:
        return None, [("", f"there is no such question about a sensor{suggestion(question, list(TOPICS))}")]
    if not isinstance(table, Mapping):
        return None, [("", f'is {table!r}; write {question} = {{ verdict = "warning" }}')]
    found, problems = checked_or_problems(SensorGateTable, table, strict=True)
    wrong = [(str(place[0]), sentence) for place, sentence in problems]
    if found is None:
        return None, wrong
    if found.min is not None and found.max is not None and found.min > found.max:
        wrong.append(("min", f"min={found.min:g} is above max={found.max:g}"))
    limits = [GateLimit("min", found.min)] if found.min is not None else []
    limits += [GateLimit("max", found.max)] if found.max is not None else []
    if not limits and found.verdict is None:
        wrong.append(("", "has no limit; give one of min, max, verdict"))
    if wrong:
        return None, wrong
    sensors = None if found.sensors is None else tuple(found.sensors)
    return SensorGate(question, tuple(limits), found.verdict, sensors, found.unknown == "pass"), []
