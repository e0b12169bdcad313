"""Configurations in a TOML file: everything that is wrong with it at once, each with its line.

metrics = ["inclination_rmse_deg", "lag_ms"]    # optional, as --metric
reference = "truth"                             # optional, any option of analyze

[[configuration]]
name = "slow and quiet"                         # optional
estimator = "mahony@xu-0.6"
kp = 0.3                                        # parameters of the filter ...
lowpass = 20                                    # ... and what comes before it
gyro_offset = [0.1, 0.0, -0.2]
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from attlog.analysis.config import DEFAULTS, Config
from attlog.base.errors import AttlogError, UsageError, suggestion
from attlog.base.files.settings_file import text_of, toml_of
from attlog.compare.configurations.configuration import Configuration, build
from attlog.compare.differences.questions import asked

TABLE = "configuration"


@dataclass(slots=True)
class ConfigurationFile:
    """What a file asks for."""

    configurations: list[Configuration] = field(default_factory=list)
    metrics: list[str] = field(default_factory=list)
    options: dict[str, Any] = field(default_factory=dict)


def read(path: Path) -> ConfigurationFile:
    """The configurations, metrics and options of a file. LogUnreadable if it cannot be opened; UsageError tells
    everything that is wrong in it."""
    text = text_of(path)
    values = toml_of(text, path)
    lines, problems, found = text.splitlines(), [], ConfigurationFile()
    tables = values.pop(TABLE, None)
    found.metrics, wrong = _metrics(values.pop("metrics", []))
    problems += [f"{_at(path, lines, 'metrics')}: {w}" for w in wrong]
    known = [name for name in DEFAULTS if name != "estimators"]
    for key in [k for k in values if k not in known]:
        hint = suggestion(key, ["metrics", TABLE, *known])
        problems.append(f"{_at(path, lines, key)}: unknown key {key}{hint}")
        del values[key]
    try:
        config = Config.build(values)
        found.options = {name: getattr(config, name) for name in values}
    except UsageError as error:
        problems += [f"{_at(path, lines, text_.partition(':')[0])}: {text_}" for text_ in str(error).splitlines()]
    if not isinstance(tables, list) or not tables:
        problems.append(f"{path}: holds no [[{TABLE}]]")
        tables = []
    names: set[str] = set()
    for number, table in enumerate(tables):
        one, faults = _configuration(table)
        for key, text_ in faults:
            problems.append(f"{_at(path, lines, key, number)}: configuration {number + 1}: {text_}")
        if one is not None:
            if one.name in names:
                problems.append(
                    f"{_at(path, lines, 'name', number)}: configuration {number + 1}: {one.name} is there twice"
                )
            names.add(one.name)
            found.configurations.append(one)
    if problems:
        raise UsageError("\n".join(problems))
    return found


def _metrics(value: object) -> tuple[list[str], list[str]]:
    if not isinstance(value, list) or not all(isinstance(m, str) for m in value):
        return [], ["metrics: of the wrong type; give a list of names"]
    try:
        asked(value)
    except UsageError as error:
        return [], str(error).splitlines()
    return value, []


def _configuration(table: object) -> tuple[Configuration | None, list[tuple[str, str]]]:
    """A configuration, or what is wrong with it as (key, sentence)."""
    if not isinstance(table, Mapping):
        return None, [("", f"is no table; write [[{TABLE}]] above it")]
    values = dict(table)
    estimator, name = values.pop("estimator", None), values.pop("name", None)
    wrong = []
    if not isinstance(estimator, str):
        near = next((k for k in values if k in ("filter", "est", "estimators")), "")
        wrong.append((near, f"has no estimator{'; did you mean estimator?' if near else ''}"))
    if name is not None and (not isinstance(name, str) or not name.strip()):
        wrong.append(("name", f"name={name!r}: of the wrong type; give a text"))
        name = None
    if not isinstance(estimator, str):
        return None, wrong
    try:
        base = build(estimator, {})
    except AttlogError as error:
        return None, [*wrong, ("estimator", str(error))]
    for key, value in values.items():
        try:
            base.with_value(key, value)
        except UsageError as error:
            wrong.append((key, str(error)))
    if wrong:
        return None, wrong
    try:
        return build(estimator, values, name), []
    except UsageError as error:
        return None, [("estimator", str(error))]


def _at(path: Path, lines: list[str], key: str, table: int | None = None) -> str:
    """The file and, where it can be found, the line of a key: of the n-th table, or above all of them."""
    seen, begin = -1, 0
    for number, line in enumerate(lines, 1):
        if re.match(rf"\s*\[\[\s*{TABLE}\s*\]\]", line):
            seen += 1
            begin = number if seen == table else begin
        inside = seen == table if table is not None else seen == -1
        if key and inside and re.match(rf"""\s*["']?{re.escape(key)}["']?\s*=""", line):
            return f"{path}, line {number}"
    return f"{path}, line {begin}" if begin else str(path)
