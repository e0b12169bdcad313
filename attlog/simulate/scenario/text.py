"""A scenario as TOML with every value, also those that nobody set: to read, and to start from."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from datetime import datetime
from typing import Any

from attlog.simulate.scenario.scenario import Scenario


def as_toml(scenario: Scenario) -> str:
    """The text; ``build(tomllib.loads(text))`` is the scenario again. What is None is left out."""
    return "\n".join(_table("", _plain(scenario))).strip() + "\n"


def _plain(table: Any) -> dict[str, Any]:
    """The keys of a table and their values, None left out."""
    if isinstance(table, Mapping):
        return dict(table)
    return {f.name: value for f in fields(table) if (value := getattr(table, f.name)) is not None}


def _table(path: str, values: dict[str, Any]) -> Iterator[str]:
    """Lines of a table: first its own values, then the tables below it."""
    below: list[tuple[str, Any]] = []
    for key, value in values.items():
        if is_dataclass(value) or isinstance(value, Mapping) or _is_list_of_tables(value):
            below.append((key, value))
        else:
            yield f"{key} = {_value(value)}"
    for key, value in below:
        name = f"{path}.{key}" if path else key
        if _is_list_of_tables(value):
            for item in value:
                yield f"\n[[{name}]]"
                yield from _table(name, _plain(item))
        elif _plain(value):
            yield f"\n[{name}]"
            yield from _table(name, _plain(value))


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, tuple) and bool(value) and is_dataclass(value[0])


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(_value(item) for item in value)}]"
    return repr(value)
