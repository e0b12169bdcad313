"""Parse configurations and logs of a command line, and configurations in a TOML file.

metrics = ["tilt_rmse_deg", "lag_ms"]           # optional, as --metric
reference = "truth"                             # optional, any option of analyze

[[configuration]]
name = "slow and quiet"                         # optional
estimator = "mahony@xu-0.6"
kp = 0.3                                        # parameters of the filter ...
lowpass = 20                                    # ... and what comes before it
gyro_offset = [0.1, 0.0, -0.2]
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from attlog import estimators
from attlog.compare.comparison import select_questions
from attlog.compare.setting import Configuration, build_configuration, flown_filter, parse_configuration, refusal_of
from attlog.core.errors import AttlogError, UsageError, suggestion
from attlog.core.files import parse_toml, read_settings_text
from attlog.estimators.registry import FLOWN
from attlog.flight.parameters import read_parameter_file
from attlog.flight.recalibration import calibrates
from attlog.pipeline.config import DEFAULTS, Config

CONFIGURATION_TABLE = "configuration"
KEY_PATTERN = re.compile(r"[^:]*:[A-Za-z_]\w*=")
# Filters that re-run a firmware's estimator. The first match takes the parameters of a file.
REPLICAS = (*FLOWN, "px4_q", "ap_dcm")


@dataclass(slots=True)
class ComparisonRequest:
    """Logs (files, folders, patterns), configurations, metrics and options, in order.

    ``repeats``: sentences on words that repeat a configuration.
    """

    logs: list[Path] = field(default_factory=list)
    configurations: list[Configuration] = field(default_factory=list)
    metrics: list[str] = field(default_factory=list)
    options: dict[str, Any] = field(default_factory=dict)
    repeats: list[str] = field(default_factory=list)


def select_words(words: Sequence[str]) -> ComparisonRequest:
    """Sort command-line words into logs and configurations. UsageError lists every error.

    A configuration is a filter's name, alone or with ``@`` or ``:``, a ``.py`` or ``.csv`` file, or a ``.toml`` file of
    configurations; all other words are logs. ``./`` before a word marks a file whose name is that of a filter. A
    parameter of a firmware's EKF (``EKF2_GPS_DELAY=250``) is compared with the flown filter, which is inserted before
    it.
    """
    found, filters = ComparisonRequest(), frozenset((*estimators.names(), *FLOWN))
    problems: list[str] = []
    names: dict[str, Configuration] = {}
    as_given: dict[str, str] = {}
    code = UsageError.exit_code
    for word in words:
        try:
            if word.lower().endswith(".toml"):
                file = read_configurations(Path(word))
                found.metrics += file.metrics
                found.options |= file.options
                for one in file.configurations:
                    names.setdefault(one.name, one)
            elif is_configuration(word, filters):
                one = parse_configuration(word)
                if flown := flown_filter(word):
                    names.setdefault(flown, parse_configuration(flown))
                if one.name in names:
                    other = as_given.get(one.name, one.name)
                    same = "given twice" if word == other else f"the same configuration as {other}"
                    found.repeats.append(f"{word} is {same}")
                as_given.setdefault(one.name, word)
                names.setdefault(one.name, one)
            elif (why := refusal_of(word)) and not os.path.exists(word):
                problems.append(f"{word}: {why}")
            elif not os.path.exists(word) and not set("*?[/\\.") & set(word):
                known = [*estimators.names(), *FLOWN, "default", "all"]
                problems.append(f"{word}: neither a file nor a filter{suggestion(word, known)}")
            else:
                found.logs.append(Path(word))
        except AttlogError as error:
            problems.append(str(error))
            code = error.exit_code
    if problems:
        refused = UsageError("\n".join(problems))
        refused.exit_code = code if len(problems) == 1 else UsageError.exit_code
        raise refused
    found.configurations = list(names.values())
    return found


def is_configuration(word: str, filters: Collection[str]) -> bool:
    """Return whether a word means a configuration, not a log."""
    head = re.split(r"[@:]", word, maxsplit=1)[0]
    if head in filters or re.search(r"\.(py|csv)(@|:|$)", word, re.IGNORECASE):
        return True
    named = flown_filter(word) or KEY_PATTERN.match(word) is not None or ("@" in word and "/" not in word)
    return bool(named) and not os.path.exists(word)


def with_params_file(configurations: Sequence[Configuration], path: Path) -> list[Configuration]:
    """Add configurations with the firmware parameters of a file.

    Each configuration that takes firmware parameters gets a copy with those of the file. A file that calibrates a
    compass or an accelerometer applies to every filter. Without configurations the first firmware filter with
    parameters in the file is used. UsageError where no filter takes them.
    """
    set_there = set(read_parameter_file(path))
    named = list(configurations)
    if not named:
        replicas = map(parse_configuration, REPLICAS)
        named = [c for c in replicas if set_there & {p.name for p in c.row.estimator.parameters}]
        calibrated = "px4_ekf2" if any(n.startswith("CAL_") for n in set_there) else "ap_ekf3"
        named = named[:1] or [parse_configuration(calibrated)] * calibrates(set_there)
    samples = calibrates(set_there)
    runs = [c for c in named if "params" not in c.before and not estimators.is_recorded(c.row.estimator.origin)]
    taking = [c for c in runs if samples or c.row.estimator.from_log is not None or c.is_flown]
    if not taking:
        raise UsageError(f"--params {path}: name a filter that takes these parameters ({', '.join(REPLICAS)})")
    found: dict[str, Configuration] = {}
    for c in named:
        found[c.name] = c
        if c in taking:
            new = c.with_value("params", str(path), None if c.name == c.text else f"{c.name}, {path.name}")
            found[new.name] = new
    return list(found.values())


def read_configurations(path: Path) -> ComparisonRequest:
    """Read configurations, metrics and options from a TOML file.

    LogUnreadable if it cannot be opened; UsageError lists every error with its line.
    """
    text = read_settings_text(path)
    values = parse_toml(text, path)
    lines, found = text.splitlines(), ComparisonRequest()
    problems: list[tuple[str, int | None, str]] = []  # key, index of its table, sentence
    tables = values.pop(CONFIGURATION_TABLE, None)
    found.metrics, wrong = _check_metrics(values.pop("metrics", []))
    problems += [("metrics", None, w) for w in wrong]
    known = [name for name in DEFAULTS if name != "estimators"]
    for key in [k for k in values if k not in known]:
        hint = suggestion(key, ["metrics", CONFIGURATION_TABLE, *known])
        problems.append((key, None, f"unknown key {key}{hint}"))
        del values[key]
    try:
        config = Config.build(values)
        found.options = {name: getattr(config, name) for name in values}
    except UsageError as error:
        problems += [(line.partition(":")[0], None, line) for line in str(error).splitlines()]
    names: set[str] = set()
    for number, table in enumerate(tables if isinstance(tables, list) else []):
        one, faults = _check_table(table)
        problems += [(key, number, f"configuration {number + 1}: {said}") for key, said in faults]
        if one is not None:
            if one.name in names:
                problems.append(("name", number, f"configuration {number + 1}: {one.name} is there twice"))
            names.add(one.name)
            found.configurations.append(one)
    said = [f"{_place_of_key(path, lines, key, number)}: {sentence}" for key, number, sentence in problems]
    if not isinstance(tables, list) or not tables:
        said.append(f"{path}: holds no [[{CONFIGURATION_TABLE}]]")
    if said:
        raise UsageError("\n".join(said))
    return found


def _check_metrics(value: object) -> tuple[list[str], list[str]]:
    if not isinstance(value, list) or not all(isinstance(m, str) for m in value):
        return [], ["metrics: of the wrong type; give a list of names"]
    try:
        select_questions(value)
    except UsageError as error:
        return [], str(error).splitlines()
    return value, []


def _check_table(table: object) -> tuple[Configuration | None, list[tuple[str, str]]]:
    """Return a configuration, or its problems as (key, sentence)."""
    if not isinstance(table, Mapping):
        return None, [("", f"is no table; write [[{CONFIGURATION_TABLE}]] above it")]
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
        base = build_configuration(estimator, {})
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
        return build_configuration(estimator, values, name), []
    except UsageError as error:
        return None, [("estimator", str(error))]


def _place_of_key(path: Path, lines: list[str], key: str, table: int | None = None) -> str:
    """Return file, and line if found, of a key in a table."""
    seen, begin = -1, 0
    for number, line in enumerate(lines, 1):
        if re.match(rf"\s*\[\[\s*{CONFIGURATION_TABLE}\s*\]\]", line):
            seen += 1
            begin = number if seen == table else begin
        inside = seen == table if table is not None else seen == -1
        if key and inside and re.match(rf"""\s*["']?{re.escape(key)}["']?\s*=""", line):
            return f"{path}, line {number}"
    return f"{path}, line {begin}" if begin else str(path)
