"""What is wrong with single values of a scenario's file: a line each, with its place and the key that was meant."""

from __future__ import annotations

import dataclasses
from typing import Any, get_args, get_type_hints

from pydantic import ValidationError

from attlog.base.errors import suggestion

NOT_A_TABLE = ("dataclass_type", "dict_type", "dataclass_exact_type")


def lines(error: ValidationError, kind: type) -> list[str]:
    """One line per thing that is wrong in values for the dataclass ``kind``."""
    return [_line(item, kind) for item in error.errors(include_url=False)]


def _line(item: Any, kind: type) -> str:
    loc: tuple[int | str, ...] = item["loc"]
    where, got = _place(loc), item.get("input")
    match item["type"]:
        case "unexpected_keyword_argument":
            return f"unknown key {where}{suggestion(str(loc[-1]), _keys(kind, loc[:-1]))}"
        case "missing" | "missing_argument":
            return f"{where}: is missing"
        case "string_pattern_mismatch":
            return f"{where}: {got!r} is no name of a file"
        case "tuple_type" if (inner := _at(kind, loc)) is not None:
            keys = ", ".join(f.name for f in dataclasses.fields(inner)[:2])
            return f"{where}: must be a list of tables, [[{where}]] each, with keys such as {keys} (got {got!r})"
        case "tuple_type":
            return f"{where}: must be a list of values (got {got!r})"
        case "too_long":
            return f"{where}: must have {item['ctx']['max_length']} values (got {got!r})"
        case "float_type" | "int_type" if isinstance(got, str):
            return f"{where}: must be a number without quotes; its unit stands in the key (got {got!r})"
        case told if told in NOT_A_TABLE:
            return f"{where}: must be a table (got {got!r})"
    words = str(item["msg"]).removeprefix("Value error, ").replace("Input should be", "must be")
    return f"{where}: {words} (got {got!r})"


def _place(loc: tuple[int | str, ...]) -> str:
    """``sensors.imu[0].rate_hz`` of a place in the values."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)
    return text.lstrip(".") or "the file"


def _at(kind: type, loc: tuple[int | str, ...]) -> Any:
    """The dataclass of the tables at a place, None where there are none."""
    table: Any = kind
    for part in loc:
        if isinstance(part, str) and table is not None:
            table = _table(get_type_hints(table).get(part))
    return table


def _keys(kind: type, loc: tuple[int | str, ...]) -> list[str]:
    """The keys that the table at a place may have."""
    table = _at(kind, loc)
    return [] if table is None else [f.name for f in dataclasses.fields(table)]


def _table(kind: Any) -> Any:
    """The table within a declared type such as ``tuple[Imu, ...]`` or ``Motion | None``, None if there is none."""
    if dataclasses.is_dataclass(kind):
        return kind
    return next((found for inner in get_args(kind) if (found := _table(inner)) is not None), None)
