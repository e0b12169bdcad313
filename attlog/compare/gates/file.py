"""Gates in a TOML file: everything that is wrong with it at once, each with its line.

[gates]
baseline = "main.json"          # optional: a result, a file with one result a line, a batch's folder; beside this file
strict = true                   # rows that failed or diverged count, the default
inclination_p95_deg = { max = 2.0, filters = ["mekf", "soft-*"], window = "airborne" }
lag_ms = [{ max = 5 }, { max = 10, filters = ["onboard"], optional = true }]
inclination_rmse_deg = { baseline = true }              # not worse than it
heading_rmse_deg = { max_ratio_to_onboard = 1.2 }
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from attlog.base.errors import LogUnreadable, UsageError, suggestion
from attlog.base.files.settings_file import text_of, toml_of
from attlog.compare.gates.gates import Gate, Gates
from attlog.compare.gates.limits import KINDS, GateLimit
from attlog.compare.gates.rows import windows
from attlog.metrics import definitions
from attlog.segments.model import WINDOWS, Segments

TABLE = "gates"
KEYS = (*KINDS, "filters", "window", "optional")


class _Wrong(Exception):
    """What is wrong with one gate: sentences with the key that each is about."""

    def __init__(self, *told: tuple[str, str]) -> None:
        super().__init__(told)
        self.told = told


def read(path: Path) -> Gates:
    """The gates of a file. UsageError tells everything that is wrong in it."""
    try:
        text = text_of(path)
    except LogUnreadable as error:  # 66 means that the logs cannot be read
        raise UsageError(str(error)) from error
    values = toml_of(text, path)
    lines = text.splitlines()
    problems = [
        f"{_at(path, lines, key)}: unknown key {key}{suggestion(key, [TABLE])}; gates stand below [{TABLE}]"
        for key in values
        if key != TABLE
    ]
    table = values.get(TABLE)
    if not isinstance(table, Mapping):
        problems.append(f"{path}: holds no [{TABLE}]")
        raise UsageError("\n".join(problems))
    common = dict(table)
    strict, baseline = common.pop("strict", True), common.pop("baseline", None)
    if not isinstance(strict, bool):
        problems.append(f"{_at(path, lines, 'strict')}: strict={strict!r}: use true or false")
    if baseline is not None and not isinstance(baseline, str):
        problems.append(f"{_at(path, lines, 'baseline')}: baseline={baseline!r}: give the name of a file or folder")
        baseline = None
    gates = []
    for metric, one in _entries(common):
        try:
            gates.append(_gate(metric, one, path, baseline))
        except _Wrong as wrong:
            problems += [f"{_at(path, lines, key or metric, metric)}: {metric}: {said}" for key, said in wrong.told]
    if not gates and not problems:
        problems.append(f"{path}: [{TABLE}] holds no gate, such as lag_ms = {{ max = 5 }}")
    if problems:
        raise UsageError("\n".join(problems))
    return Gates(tuple(gates), bool(strict))


def _entries(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """(metric, its table) of every gate. A metric's own dots may have made tables: ``step_error_deg.0.5s = ...``."""
    known = definitions()
    for key, value in table.items():
        name = before + key
        inside = name not in known and any(metric.startswith(f"{name}.") for metric in known)
        if inside and isinstance(value, Mapping):
            yield from _entries(value, f"{name}.")
            continue
        for one in value if isinstance(value, list) and value else [value]:
            yield name, one


def _gate(metric: str, table: Any, path: Path, baseline: str | None) -> Gate:
    """A gate of its table. _Wrong tells all that is wrong with it."""
    if metric not in definitions():
        raise _Wrong(("", f"there is no such metric{suggestion(metric, [*definitions(), 'baseline', 'strict'])}"))
    if not isinstance(table, Mapping):
        raise _Wrong(("", f"is {table!r}; write {metric} = {{ max = 2.0 }}"))
    wrong = [(k, f"unknown key {k}{suggestion(k, KEYS)}") for k in table if k not in KEYS]
    filters, window, optional = table.get("filters"), table.get("window"), table.get("optional", False)
    if isinstance(filters, str):
        filters = [filters]
    if filters is not None and not (
        isinstance(filters, list) and filters and all(isinstance(f, str) and f for f in filters)
    ):
        wrong.append(("filters", f"filters={filters!r}: give a list of names or patterns"))
    if window is not None:
        wrong += _window(metric, window)
    if not isinstance(optional, bool):
        wrong.append(("optional", f"optional={optional!r}: use true or false"))
    limits, place = [], table.get("baseline")
    for kind in (k for k in KINDS if k != "baseline" and k in table):
        try:
            limits.append(GateLimit(kind, _number(kind, table[kind], metric)))
        except ValueError as error:
            wrong.append((kind, str(error)))
    if place is not None and place is not True and not isinstance(place, str):
        wrong.append(("baseline", f"baseline={place!r}: give true, or the name of a file or folder"))
        place = None
    if place is not None and not any(limit.against == "baseline" for limit in limits):
        limits.append(GateLimit("baseline", 0.0))
    low, high = (next((v.value for v in limits if v.kind == k), None) for k in ("min", "max"))
    if low is not None and high is not None and low > high:
        wrong.append(("min", f"min={low:g} is above max={high:g}"))
    if not limits and not wrong:
        wrong.append(("", f"has no limit; give one of {', '.join(KINDS)}"))
    beside = place if isinstance(place, str) else baseline
    if any(limit.against for limit in limits) and definitions()[metric].better == "high":
        wrong.append(("", "more is better here: give min, not a limit to something else"))
    if any(limit.against == "baseline" for limit in limits) and beside is None and not wrong:
        wrong.append(("", f'needs a baseline: write baseline = "main.json" below [{TABLE}]'))
    if wrong:
        raise _Wrong(*wrong)
    return Gate(
        metric,
        tuple(limits),
        window,
        None if filters is None else tuple(filters),
        optional,
        path.parent / beside if beside is not None else None,
    )


def _number(kind: str, value: Any, metric: str) -> float:
    """The number of a limit. ValueError says what is wrong with it."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{kind}={value!r}: give a number")
    if "ratio" in kind and value <= 0.0:
        raise ValueError(f"{kind}={value:g}: give a ratio above 0")
    if value < 0.0 and kind in ("min", "max"):
        good = "its size counts" if definitions()[metric].better == "zero" else "it is never negative"
        raise ValueError(f"{kind}={value:g}: give a number from 0 on: {good}")
    return float(value)


def _window(metric: str, window: Any) -> list[tuple[str, str]]:
    """What is wrong with a window."""
    if not isinstance(window, str):
        return [("window", f"window={window!r}: give a name")]
    if window in WINDOWS:
        return []
    try:
        Segments([]).spans(window)
    except ValueError:
        near = suggestion(window, [*WINDOWS, "T0:T1"])
        return [("window", f"there is no window {window}{near}; {metric} is looked up in {windows(metric, None)[0]}")]
    return []


def _at(path: Path, lines: list[str], key: str, metric: str | None = None) -> str:
    """The file and, where it can be found, the line of a key: inside the metric's gate, or of its own."""
    quoted = rf"""["']?{re.escape(key)}["']?"""
    begin = 0
    if metric is not None and metric != key:
        begin = next((n for n, line in enumerate(lines) if metric in line), 0)
    pattern = re.compile(rf"(^\s*\[*\s*(?:{TABLE}\s*\.\s*)?|[{{,]\s*){quoted}\s*(=|\])")
    found = next((n for n in range(begin, len(lines)) if pattern.search(lines[n])), None)
    return str(path) if found is None else f"{path}, line {found + 1}"
