"""Validate user settings (options, scenarios, gates) with pydantic, with one line per problem.

Pydantic is imported only where something is checked.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import re
from collections.abc import Callable, Mapping
from datetime import date, time
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_type_hints

from attlog.core.errors import UsageError, suggestion

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, TypeAdapter, ValidationError
    from pydantic_core import CoreSchema

T = TypeVar("T")
Place = tuple[int | str, ...]
TABLE_ERRORS = ("dataclass_type", "dict_type", "dataclass_exact_type")
# Components that pydantic adds to the place of a union's value.
ALTERNATIVE = re.compile(
    r"int|float|str|bool|none|(literal|tuple|list|constrained-\w+|nullable|function-\w+)\[.*|function-\w+\(.*"
)
# Components that pydantic adds to the name of the expected kind.
MESSAGE_DETAIL = re.compile(r", (unable to|got a) .*")


@dataclasses.dataclass(frozen=True, slots=True)
class NumberRange:
    """Pydantic annotation of a number's range: ``Annotated[float, NumberRange(0.0, 1e6)]``; booleans are refused."""

    least: float | None = None
    largest: float | None = None
    above: float | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return the schema of the number with its bounds."""
        from pydantic_core import PydanticCustomError, core_schema

        bounds: dict[str, Any] = {"ge": self.least, "le": self.largest, "gt": self.above}
        number: Any = dict(handler(source))
        number.update({key: value for key, value in bounds.items() if value is not None})
        if source is float:
            number["allow_inf_nan"] = False

        def no_truth_value(value: Any) -> Any:
            if isinstance(value, bool):
                raise PydanticCustomError("number", "Input should be a number")
            return value

        return core_schema.no_info_before_validator_function(no_truth_value, number)


@dataclasses.dataclass(frozen=True, slots=True)
class ParsedBy:
    """Pydantic annotation of a parser: ``Annotated[list[str], ParsedBy(items)]``.

    ``parse`` raises ValueError with a sentence that begins with "must".
    """

    parse: Callable[[Any], Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return the schema of the parsed value."""
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(self.parse, handler(source))


def _adapter(kind: Any) -> TypeAdapter[Any]:
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


# Checks plain values and makes an instance of a dataclass.
adapter: Callable[[Any], TypeAdapter[Any]] = functools.cache(_adapter)


def validated(kind: type[T], values: Mapping[str, Any], origin: str = "", strict: bool = False) -> T:
    """Return an instance of a dataclass from plain values.

    UsageError lists every problem in a line that begins with ``origin``.
    """
    found, wrong = validated_or_problems(kind, values, strict)
    if found is None:
        raise UsageError("\n".join(f"{origin}: {text}" if origin else text for _, text in wrong))
    return found


def validated_or_problems(
    kind: type[T], values: Mapping[str, Any], strict: bool = False
) -> tuple[T | None, list[tuple[Place, str]]]:
    """Return an instance of a dataclass, or None and its :func:`problems`.

    ``strict``: accept only numbers as numbers, neither "15" nor true, as in files.
    """
    from pydantic import ValidationError

    try:
        if strict:  # in JSON a list may be a tuple and a table a dataclass
            return adapter(kind).validate_json(json.dumps(dict(values), default=_toml_value_as_text), strict=True), []
        return adapter(kind).validate_python(dict(values)), []
    except ValidationError as error:
        return None, problems(error, kind)


def _toml_value_as_text(value: object) -> str:
    """Return TOML's dates and times as text. TypeError for anything else."""
    if isinstance(value, (date, time)):
        return value.isoformat()
    raise TypeError(f"{value!r} is no value of a TOML file")


def problem_lines(error: ValidationError, kind: type) -> list[str]:
    """Return one line per problem."""
    return [text for _, text in problems(error, kind)]


def problems(error: ValidationError, kind: type) -> list[tuple[Place, str]]:
    """Return place and sentence of each problem."""
    found: dict[Place, list[Any]] = {}
    for item in error.errors(include_url=False):
        loc = item["loc"]
        while len(loc) > 1 and isinstance(loc[-1], str) and ALTERNATIVE.fullmatch(loc[-1]):
            loc = loc[:-1]
        found.setdefault(loc, []).append(item)
    described = [(loc, *_problem(loc, items, kind)) for loc, items in found.items()]
    return [(loc, f"{where}: {what}" if where else what) for loc, where, what in described]


def _problem(loc: Place, items: list[Any], kind: type) -> tuple[str, str]:
    where, got = place_text(loc), items[0].get("input")
    match items[0]["type"]:
        case "unexpected_keyword_argument":
            return "", f"unknown key {where}{suggestion(str(loc[-1]), _keys(kind, loc[:-1]))}"
        case "missing" | "missing_argument":
            return where, "is missing"
        case "string_pattern_mismatch":
            return where, f"{got!r} is no name of a file"
        case "tuple_type" if (inner := _table_at(kind, loc)) is not None:
            keys = ", ".join(f.name for f in dataclasses.fields(inner)[:2])
            return where, f"must be a list of tables, [[{where}]] each, with keys such as {keys} (got {got!r})"
        case "tuple_type":
            return where, f"must be a list of values (got {got!r})"
        case "too_long":
            return where, f"must have {items[0]['ctx']['max_length']} values (got {got!r})"
        case "float_type" | "int_type" if isinstance(got, str) and len(items) == 1:
            return where, f"must be a number without quotes; its unit is in the key (got {got!r})"
        case kind if kind in TABLE_ERRORS:
            return where, f"must be a table (got {got!r})"
    messages = [MESSAGE_DETAIL.sub("", str(item["msg"]).removeprefix("Value error, ")) for item in items]
    kinds = " or ".join(dict.fromkeys(message.replace("Input should be ", "") for message in messages))
    must = "must be " if "Input should be" in messages[0] else ""
    return where, f"{must}{kinds} (got {got!r:.80})"


def place_text(loc: Place) -> str:
    """Return ``sensors.imu[0].rate_hz`` for a place in the values."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)
    return text.lstrip(".") or "the file"


def _table_at(kind: type, loc: Place) -> Any:
    """Return the dataclass of the tables at a place, None without one."""
    table: Any = kind
    for part in loc:
        if isinstance(part, str) and table is not None:
            table = _table_type(get_type_hints(table).get(part))
    return table


def _keys(kind: type, loc: Place) -> list[str]:
    """Return the keys that the table at a place may have."""
    table = _table_at(kind, loc)
    return [] if table is None else [f.name for f in dataclasses.fields(table)]


def _table_type(kind: Any) -> Any:
    """Return the dataclass within a declared type, None without one.

    Such as ``tuple[Imu, ...]`` or ``Motion | None``.
    """
    if dataclasses.is_dataclass(kind):
        return kind
    return next((found for inner in get_args(kind) if (found := _table_type(inner)) is not None), None)
