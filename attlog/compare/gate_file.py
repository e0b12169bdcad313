"""Read gates from a TOML file; report all problems at once, with their lines.

[gates]
baseline = "main.json"          # optional: a result, a file with one result a line, a batch's folder; beside this file
strict = true                   # rows that failed or diverged count, the default
tilt_p95_deg = { max = 2.0, filters = ["mekf", "soft-*"], window = "airborne" }
lag_ms = [{ max = 5 }, { max = 10, filters = ["onboard"], optional = true }]
tilt_rmse_deg = { baseline = true }                         # not worse than it
heading_rmse_deg = { max_ratio_to_onboard = 1.2 }

[gates.health]
compass_offset = { max = 5 }                                # uT, on every compass
vibration_level = { verdict = "warning", sensors = ["IMU.0"] }
gnss_delay = { verdict = "ok", unknown = "pass" }           # skipped where the log has no answer
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from attlog.compare.gates import LIMIT_KINDS, Gate, GateLimit, Gates, SensorGate, gate_windows
from attlog.core.errors import LogUnreadable, UsageError, suggestion
from attlog.core.files import parse_toml, read_settings_text
from attlog.core.settings import NumberRange, ParsedBy, validated_or_problems
from attlog.metrics import definitions
from attlog.result import CHECKS
from attlog.segments.model import WINDOWS, Segments

GATE_TABLE, SENSOR_TABLE = "gates", "health"
# Key (empty: the whole gate) and sentence.
Problem = tuple[str, str]


def _patterns(value: Any) -> Any:
    """Return names or patterns as a list."""
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list) or not value or "" in value:
        raise ValueError("must be a list of names or patterns")
    return value


@dataclass
class GateTable:
    """Keys of one gate.

    A ratio is above 0. ``baseline`` true: not worse than the baseline of the file.
    """

    min: Annotated[float, NumberRange(0.0)] | None = None
    max: Annotated[float, NumberRange(0.0)] | None = None
    max_ratio_to_onboard: Annotated[float, NumberRange(above=0.0)] | None = None
    max_above_onboard: Annotated[float, NumberRange()] | None = None
    max_ratio_to_baseline: Annotated[float, NumberRange(above=0.0)] | None = None
    max_above_baseline: Annotated[float, NumberRange()] | None = None
    baseline: Literal[True] | str | None = None
    filters: Annotated[list[str], ParsedBy(_patterns)] | None = None
    window: str | None = None
    optional: bool = False
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    def limits(self) -> tuple[GateLimit, ...]:
        """Return the limits of the gate.

        A baseline without a limit relative to it means "not worse than the baseline".
        """
        values = [(kind, getattr(self, kind)) for kind in LIMIT_KINDS if kind != "baseline"]
        found = [GateLimit(kind, value) for kind, value in values if value is not None]
        if self.baseline is not None and not any(limit.against == "baseline" for limit in found):
            found.append(GateLimit("baseline", 0.0))
        return tuple(found)


@dataclass
class SensorGateTable:
    """Keys of a sensor's gate.

    ``max``: largest absolute value. ``verdict``: the worst allowed.
    """

    min: Annotated[float, NumberRange()] | None = None
    max: Annotated[float, NumberRange(0.0)] | None = None
    verdict: Literal["ok", "warning"] | None = None
    sensors: Annotated[list[str], ParsedBy(_patterns)] | None = None
    unknown: Literal["pass", "fail"] = "fail"
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}


@dataclass
class CommonKeys:
    """Keys of the file other than gates."""

    strict: bool = True
    baseline: str | None = None
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}


def read_gates(path: Path) -> Gates:
    """Read the gates of a file. UsageError lists every error."""
    try:
        text = read_settings_text(path)
    except LogUnreadable as error:  # LogUnreadable has exit code 66, which is for logs
        raise UsageError(str(error)) from error
    values = parse_toml(text, path)
    lines = text.splitlines()
    problems = [
        f"{_place_of_key(path, lines, key)}: unknown key {key}{suggestion(key, [GATE_TABLE])}; "
        f"gates stand below [{GATE_TABLE}]"
        for key in values
        if key != GATE_TABLE
    ]
    table = values.get(GATE_TABLE)
    if not isinstance(table, Mapping):
        raise UsageError("\n".join([*problems, f"{path}: holds no [{GATE_TABLE}]"]))
    names = {f.name for f in fields(CommonKeys)}
    common, wrong = validated_or_problems(CommonKeys, {k: v for k, v in table.items() if k in names}, strict=True)
    problems += [f"{_place_of_key(path, lines, str(place[0]))}: {said}" for place, said in wrong]
    baseline = table["baseline"] if isinstance(table.get("baseline"), str) else None
    gates: list[Gate] = []
    sensors: list[SensorGate] = []

    def note(name: str, found: list[Problem]) -> None:
        problems.extend(f"{_place_of_key(path, lines, key or name, name)}: {name}: {said}" for key, said in found)

    for metric, one in _metric_entries({k: v for k, v in table.items() if k not in (*names, SENSOR_TABLE)}):
        gate, found = _parse_gate(metric, one, path, baseline)
        note(metric, found)
        gates += [] if gate is None else [gate]
    below = table.get(SENSOR_TABLE, {})
    if not isinstance(below, Mapping):
        note(SENSOR_TABLE, [("", f"is {below!r}; write compass_offset = {{ max = 5 }} below [gates.{SENSOR_TABLE}]")])
        below = {}
    for question, one in _entries(below):
        sensor, found = _parse_sensor_gate(question, one)
        note(question, found)
        sensors += [] if sensor is None else [sensor]
    if not gates and not sensors and not problems:
        problems.append(f"{path}: [{GATE_TABLE}] holds no gate, such as lag_ms = {{ max = 5 }}")
    if problems or common is None:
        raise UsageError("\n".join(problems))
    return Gates(tuple(gates), common.strict, tuple(sensors))


def _entries(table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield (name, table) of every gate; a list has several of one name."""
    for name, value in table.items():
        for one in value if isinstance(value, list) and value else [value]:
            yield name, one


def _metric_entries(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield metrics with their tables.

    TOML splits the dots of a metric's name into tables: ``step_error_deg.0.5s = ...``.
    """
    known = definitions()
    for key, value in table.items():
        name = before + key
        inside = name not in known and any(metric.startswith(f"{name}.") for metric in known)
        if inside and isinstance(value, Mapping):
            yield from _metric_entries(value, f"{name}.")
        else:
            yield from _entries({name: value})


def _parse_gate(metric: str, table: Any, path: Path, baseline: str | None) -> tuple[Gate | None, list[Problem]]:
    """Parse one gate, or return None and all its problems."""
    if metric not in definitions():
        near = suggestion(metric, [*definitions(), "baseline", "strict", SENSOR_TABLE])
        return None, [("", f"there is no such metric{near}")]
    if not isinstance(table, Mapping):
        return None, [("", f"is {table!r}; write {metric} = {{ max = 2.0 }}")]
    found, problems = validated_or_problems(GateTable, table, strict=True)
    wrong = [(str(place[0]), said) for place, said in problems]
    if isinstance(table.get("window"), str):
        wrong += _window_problems(metric, table["window"])
    wrong += _range_problems(table.get("min"), table.get("max"))
    if found is None:
        return None, wrong
    limits = found.limits()
    if not limits:
        wrong.append(("", f"has no limit; give one of {', '.join(LIMIT_KINDS)}"))
    beside = found.baseline if isinstance(found.baseline, str) else baseline
    if any(limit.against for limit in limits) and definitions()[metric].better == "high":
        wrong.append(("", "more is better here: give min, not a limit to something else"))
    if any(limit.against == "baseline" for limit in limits) and beside is None and not wrong:
        wrong.append(("", f'needs a baseline: write baseline = "main.json" below [{GATE_TABLE}]'))
    if wrong:
        return None, wrong
    filters = None if found.filters is None else tuple(found.filters)
    place = None if beside is None else path.parent / beside
    return Gate(metric, limits, found.window, filters, found.optional, place), []


def _parse_sensor_gate(question: str, table: Any) -> tuple[SensorGate | None, list[Problem]]:
    """Parse a sensor's gate, or return None and all its problems."""
    if question not in CHECKS:
        return None, [("", f"there is no such question about a sensor{suggestion(question, list(CHECKS))}")]
    if not isinstance(table, Mapping):
        return None, [("", f'is {table!r}; write {question} = {{ verdict = "warning" }}')]
    found, problems = validated_or_problems(SensorGateTable, table, strict=True)
    wrong = [(str(place[0]), said) for place, said in problems]
    if found is None:
        return None, wrong
    wrong += _range_problems(found.min, found.max)
    limits = [GateLimit("min", found.min)] if found.min is not None else []
    limits += [GateLimit("max", found.max)] if found.max is not None else []
    if not limits and found.verdict is None:
        wrong.append(("", "has no limit; give one of min, max, verdict"))
    if wrong:
        return None, wrong
    sensors = None if found.sensors is None else tuple(found.sensors)
    return SensorGate(question, tuple(limits), found.verdict, sensors, found.unknown == "pass"), []


def _range_problems(low: Any, high: Any) -> list[Problem]:
    if isinstance(low, (int, float)) and isinstance(high, (int, float)) and low > high:
        return [("min", f"min={low:g} is above max={high:g}")]
    return []


def _window_problems(metric: str, window: str) -> list[Problem]:
    if window in WINDOWS:
        return []
    try:
        Segments([]).spans(window)
    except ValueError:
        near = suggestion(window, [*WINDOWS, "T0:T1"])
        own = gate_windows(metric, None)[0]
        return [("window", f"there is no window {window}{near}; {metric} is looked up in {own}")]
    return []


def _place_of_key(path: Path, lines: list[str], key: str, metric: str | None = None) -> str:
    """Return file, and line if found, of a key of a gate."""
    quoted = rf"""["']?{re.escape(key)}["']?"""
    begin = 0
    if metric is not None and metric != key:
        begin = next((n for n, line in enumerate(lines) if metric in line), 0)
    pattern = re.compile(rf"(^\s*\[*\s*(?:{GATE_TABLE}\s*\.\s*)?|[{{,]\s*){quoted}\s*(=|\])")
    found = next((n for n in range(begin, len(lines)) if pattern.search(lines[n])), None)
    return str(path) if found is None else f"{path}, line {found + 1}"
