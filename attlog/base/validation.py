"""What pydantic finds wrong with a file, in words: a line each, with its place and the key that was meant."""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

from attlog.base.errors import suggestion

if TYPE_CHECKING:
    from pydantic import ValidationError

NOT_A_TABLE = ("dataclass_type", "dict_type", "dataclass_exact_type")
ALTERNATIVE = re.compile(
    r"int|float|str|bool|none|(literal|tuple|list|constrained-\w+|nullable|function-\w+)\[.*|function-\w+\(.*"
)
"""What pydantic adds to the place of a value that may be one of several kinds."""


def lines(error: ValidationError, kind: type) -> list[str]:
    """One line per thing that is wrong in values for the dataclass ``kind``."""
    return [f"{where}: {what}" if where else what for where, what in problems(error, kind)]


def problems(error: ValidationError, kind: type) -> list[tuple[str, str]]:
    """(place, sentence) of each; the place is empty where the sentence names it.

    Of a value that is none of several kinds the sentence tells them all.
    """
    found: dict[tuple[int | str, ...], list[Any]] = {}
    for item in error.errors(include_url=False):
        loc = item["loc"]
        while len(loc) > 1 and isinstance(loc[-1], str) and ALTERNATIVE.fullmatch(loc[-1]):
            loc = loc[:-1]
        found.setdefault(loc, []).append(item)
    return [_problem(loc, items, kind) for loc, items in found.items()]


def _problem(loc: tuple[int | str, ...], items: list[Any], kind: type) -> tuple[str, str]:
    where, got = place(loc), items[0].get("input")
    match items[0]["type"]:
        case "unexpected_keyword_argument":
            return "", f"unknown key {where}{suggestion(str(loc[-1]), _keys(kind, loc[:-1]))}"
        case "missing" | "missing_argument":
            return where, "is missing"
        case "string_pattern_mismatch":
            return where, f"{got!r} is no name of a file"
        case "tuple_type" if (inner := _at(kind, loc)) is not None:
            keys = ", ".join(f.name for f in dataclasses.fields(inner)[:2])
            return where, f"must be a list of tables, [[{where}]] each, with keys such as {keys} (got {got!r})"
        case "tuple_type":
            return where, f"must be a list of values (got {got!r})"
        case "too_long":
            return where, f"must have {items[0]['ctx']['max_length']} values (got {got!r})"
        case "float_type" | "int_type" if isinstance(got, str) and len(items) == 1:
            return where, f"must be a number without quotes; its unit stands in the key (got {got!r})"
        case told if told in NOT_A_TABLE:
            return where, f"must be a table (got {got!r})"
    words = dict.fromkeys(str(i["msg"]).removeprefix("Value error, ").replace("Input should be ", "") for i in items)
    told = " or ".join(words)
    must = "must be " if "Input should be" in items[0]["msg"] else ""
    return where, f"{must}{told} (got {got!r:.80})"


def place(loc: tuple[int | str, ...]) -> str:
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
