"""Conversion of dataclasses, arrays and numpy scalars to plain JSON values."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler
    from pydantic_core import CoreSchema

# ``field(metadata={IN_JSON: False})`` keeps a field out of the document.
IN_JSON = "json"


@dataclasses.dataclass(frozen=True, slots=True)
class NumberArray:
    """Pydantic annotation of an array, a list in documents.

    ``Annotated[Array, NumberArray(float)]``; null is NaN.
    """

    number: type

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read a list of numbers into an array."""
        from pydantic_core import core_schema

        number = core_schema.float_schema(), core_schema.int_schema()
        item = number[1] if self.number is int else core_schema.nullable_schema(number[0])
        return core_schema.no_info_after_validator_function(
            lambda values: np.asarray(values, self.number), core_schema.list_schema(item)
        )


class NullAsNaN:
    """Pydantic annotation of a number that is null for NaN: ``Annotated[float, NullAsNaN()]``."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read a number or null."""
        from pydantic_core import core_schema

        number = core_schema.nullable_schema(core_schema.float_schema())
        return core_schema.no_info_after_validator_function(lambda x: math.nan if x is None else x, number)


def to_plain(value: Any, defaults: bool = True) -> Any:
    """Return dataclasses, arrays and numpy scalars as JSON types; non-finite numbers become None.

    Without ``defaults`` fields of dataclasses that have their default are left out.
    """
    kind: Any = type(value)
    if kind is float:
        return value if math.isfinite(value) else None
    if kind in PLAIN_TYPES:
        return value
    if kind is dict:
        return {str(k): v if type(v) in PLAIN_TYPES else to_plain(v, defaults) for k, v in value.items()}
    if kind is list or kind is tuple:
        return [v if type(v) in PLAIN_TYPES else to_plain(v, defaults) for v in value]
    written = _document_fields(kind)
    if written is None:
        return _rare_to_plain(value, defaults)
    document = {}
    for name, default in written:
        item = getattr(value, name)
        if not defaults and (item is default or _equals(item, default)):
            continue
        if type(item) not in PLAIN_TYPES:
            item = to_plain(item, defaults)
        document[name] = item
    return document


PLAIN_TYPES = frozenset((str, int, bool, type(None)))


@functools.cache
def _document_fields(kind: type) -> tuple[tuple[str, Any], ...] | None:
    """Return a dataclass's documented fields with defaults, None for other types."""
    if not dataclasses.is_dataclass(kind):
        return None
    return tuple(
        (f.name, f.default if f.default_factory is dataclasses.MISSING else f.default_factory())
        for f in dataclasses.fields(kind)
        if f.metadata.get(IN_JSON, True)
    )


def _equals(item: Any, default: Any) -> bool:
    """Return whether a value and its type are those of the default."""
    return type(item) is type(default) and not isinstance(item, np.ndarray) and item == default


def _rare_to_plain(value: Any, defaults: bool) -> Any:
    """Convert sets, arrays, numpy scalars; anything else becomes text."""
    if isinstance(value, dict):
        return {str(k): to_plain(v, defaults) for k, v in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [to_plain(v, defaults) for v in (sorted(value) if isinstance(value, (set, frozenset)) else value)]
    if isinstance(value, np.ndarray):
        finite = value.dtype.kind == "f" and np.isfinite(value).all()
        return value.tolist() if finite else to_plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


def json_text(value: Any) -> str:
    """Return plain values as compact JSON."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def rounded_document(value: Any, digits: int) -> Any:
    """Round all floats of a plain value to significant digits."""
    text = f"%.{digits}g"

    def rounded(value: Any) -> Any:
        if isinstance(value, list):
            return [float(text % v) if type(v) is float else rounded(v) for v in value]
        if isinstance(value, dict):
            return {k: float(text % v) if type(v) is float else rounded(v) for k, v in value.items()}
        return float(text % value) if isinstance(value, float) else value

    return rounded(value)


def without_keys(value: Any, keys: tuple[str, ...]) -> Any:
    """Return the document without the named keys at every level."""
    if isinstance(value, dict):
        return {k: without_keys(v, keys) for k, v in value.items() if k not in keys}
    if isinstance(value, list):
        return [without_keys(v, keys) for v in value]
    return value
